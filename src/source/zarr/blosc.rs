//! Chunks of C-Blosc 1: blocks of bytes that are shuffled and then packed.

use std::io;
use std::ops::Range;

use super::array::ChunkLocation;
use super::packing::{Sink, damaged, short};
use crate::fault::bad;

const HEADER: u64 = 16;

/// State of zstd's decoder; the others need less.
const DECODER: u64 = 256 << 10;

/// Fewest bytes of a part of a block that is packed on its own, and most parts.
const MIN_PART: usize = 128;
const MAX_PARTS: usize = 16;

/// Codec of the parts of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Inner {
    BloscLz,
    Lz4,
    Zlib,
    Zstd,
}

/// Header before the blocks.
pub(super) struct Header {
    /// True for a chunk stored plain, without blocks.
    plain: bool,
    shuffled: bool,
    bits_shuffled: bool,
    /// True if the bytes of samples, one place after the other, are packed on their own.
    split: bool,
    inner: u8,
    sample: usize,
    bytes: u64,
    block: usize,
    packed: u64,
}

impl Header {
    pub(super) fn read(place: &ChunkLocation) -> io::Result<Self> {
        if place.length < HEADER {
            return Err(short());
        }
        let mut head = [0; 16];
        place.file.read_exact_at(&mut head, place.at)?;
        let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let flags = head[2];
        let header = Self {
            plain: flags & 2 != 0,
            shuffled: flags & 1 != 0,
            bits_shuffled: flags & 4 != 0,
            split: flags & 16 == 0,
            inner: flags >> 5,
            sample: usize::from(head[3]).max(1),
            bytes: u64::from(number(4)),
            block: number(8) as usize,
            packed: u64::from(number(12)),
        };
        let is_sound = header.bytes == 0 || (header.block > 0 && header.block as u64 <= header.bytes);
        if head[0] > 2 || !is_sound || header.packed < HEADER {
            return Err(damaged("no Blosc header"));
        }
        Ok(header)
    }

    /// Three blocks: packed, shuffled and plain.
    pub(super) fn memory_bytes(&self) -> u64 {
        DECODER + 3 * self.block as u64 + 4 * self.blocks()
    }

    fn blocks(&self) -> u64 {
        self.bytes.div_ceil(self.block.max(1) as u64)
    }

    fn inner(&self) -> io::Result<Inner> {
        let unread = |what: &str| {
            bad!("holds {}, which is not read; pass the array to `infobyte.build` in Python, which reads any chunks", (format!("chunks that Blosc packed with {what}")).escape_debug()).in_stream()
        };
        match self.inner {
            0 => Ok(Inner::BloscLz),
            1 => Ok(Inner::Lz4),
            2 => Err(unread("Snappy")),
            3 => Ok(Inner::Zlib),
            4 => Ok(Inner::Zstd),
            _ => Err(unread("an unknown codec")),
        }
    }

    pub(super) fn block_bytes(&self) -> u64 {
        if self.plain { 1 } else { self.block as u64 }
    }

    /// Hands on the `wanted` part of a chunk of `bytes` bytes, whose stored form is `length` long.
    pub(super) fn unpack(
        &self,
        (place, length): (&ChunkLocation, u64),
        bytes: u64,
        wanted: &Range<u64>,
        (buffers, sink): (&mut Buffers, &mut Sink<'_>),
    ) -> io::Result<()> {
        if self.bytes != bytes {
            return Err(damaged("its length"));
        }
        if self.packed > length {
            return Err(short());
        }
        if self.plain {
            if self.packed != HEADER + bytes {
                return Err(damaged("its length"));
            }
            let mut piece = vec![0; super::packing::PIECE];
            let mut done = wanted.start;
            while done < wanted.end {
                let part = usize::try_from(wanted.end - done).unwrap_or(usize::MAX).min(piece.len());
                place.file.read_exact_at(&mut piece[..part], place.at + HEADER + done)?;
                sink(&piece[..part])?;
                done += part as u64;
            }
            return Ok(());
        }
        let mut unpacker = Unpacker { of: self, place, inner: self.inner()?, buffers };
        let block = self.block as u64;
        let blocks = wanted.start / block..wanted.end.div_ceil(block);
        let count = usize::try_from(blocks.end - blocks.start).unwrap_or(usize::MAX);
        if HEADER + 4 * self.blocks() > self.packed {
            return Err(short());
        }
        let mut starts = vec![0; 4 * count];
        place.file.read_exact_at(&mut starts, place.at + HEADER + 4 * blocks.start)?;
        for (number, start) in blocks.zip(starts.as_chunks().0) {
            let first = number * block;
            let size = usize::try_from(bytes - first).unwrap_or(usize::MAX).min(self.block);
            let samples = unpacker.block(u32::from_le_bytes(*start).into(), size)?;
            let within = |at: u64| usize::try_from(at.saturating_sub(first)).unwrap_or(size).min(size);
            sink(&samples[within(wanted.start)..within(wanted.end)])?;
        }
        Ok(())
    }

    /// The bytes of a block in their order.
    fn unshuffled<'a>(&self, shuffled: &'a [u8], plain: &'a mut [u8]) -> &'a [u8] {
        let size = self.sample;
        let count = shuffled.len() / size;
        // Bits of samples beyond the last multiple of eight are not shuffled.
        if self.bits_shuffled && count > 0 && count.is_multiple_of(8) {
            unshuffle_bits(shuffled, plain, size);
        } else if self.shuffled && !self.bits_shuffled && size > 1 && count > 0 {
            unshuffle(shuffled, plain, size);
        } else {
            return shuffled;
        }
        plain
    }
}

/// Buffers and decoder for blocks, kept from one slab to the next: asking the system for pages again costs more than
/// filling them.
#[derive(Default)]
pub(super) struct Buffers {
    /// Made when the first block needs it.
    decoder: Option<zstd::bulk::Decompressor<'static>>,
    packed: Vec<u8>,
    shuffled: Vec<u8>,
    plain: Vec<u8>,
}

/// Unpacks the blocks of a chunk, one after the other.
struct Unpacker<'a> {
    of: &'a Header,
    place: &'a ChunkLocation,
    inner: Inner,
    buffers: &'a mut Buffers,
}

impl Unpacker<'_> {
    /// The bytes of a block of this size, which begins there in the chunk.
    fn block(&mut self, start: u64, size: usize) -> io::Result<&[u8]> {
        let Self { of, place, inner, buffers: Buffers { decoder, packed, shuffled, plain } } = self;
        for buffer in [&mut *packed, &mut *shuffled, &mut *plain] {
            buffer.resize(buffer.len().max(of.block), 0);
        }
        let (shuffled, plain) = (&mut shuffled[..size], &mut plain[..size]);
        let is_last = size < of.block;
        let is_split = of.split
            && !is_last
            && of.sample <= MAX_PARTS
            && of.block / of.sample >= MIN_PART
            && of.block.is_multiple_of(of.sample);
        let parts = if is_split { of.sample } else { 1 };
        let mut at = start;
        for part in shuffled.chunks_mut(size / parts) {
            let mut count = [0; 4];
            if at.checked_add(4).is_none_or(|end| end > of.packed) {
                return Err(damaged("the place of a block"));
            }
            place.file.read_exact_at(&mut count, place.at + at)?;
            let count = u64::from(u32::from_le_bytes(count));
            at += 4;
            // A packed part is not longer than a plain one.
            if count > part.len() as u64 || at + count > of.packed {
                return Err(damaged("the length of a block"));
            }
            let packed = &mut packed[..usize::try_from(count).unwrap_or(0)];
            place.file.read_exact_at(packed, place.at + at)?;
            at += count;
            if packed.len() == part.len() {
                part.copy_from_slice(packed);
                continue;
            }
            let made = match inner {
                Inner::BloscLz => blosclz(packed, part),
                Inner::Lz4 => lz4(packed, part),
                Inner::Zstd => {
                    let decoder = match decoder {
                        Some(decoder) => decoder,
                        None => decoder.insert(zstd::bulk::Decompressor::new()?),
                    };
                    decoder.decompress_to_buffer(packed, part).ok()
                }
                Inner::Zlib => inflated(packed, part),
            };
            if made != Some(part.len()) {
                return Err(damaged("a block"));
            }
        }
        Ok(of.unshuffled(shuffled, plain))
    }
}

fn inflated(packed: &[u8], out: &mut [u8]) -> Option<usize> {
    let mut stream = flate2::Decompress::new(true);
    stream.decompress(packed, out, flate2::FlushDecompress::Finish).ok()?;
    usize::try_from(stream.total_out()).ok()
}

/// Unpacks a block of LZ4. Shuffled samples are long runs of few bytes, which `lz4_flex` without `unsafe` copies one by
/// one: a tenth of the time of a build.
fn lz4(packed: &[u8], out: &mut [u8]) -> Option<usize> {
    let (mut at, mut made) = (0, 0);
    let extended = |at: &mut usize, short: usize| {
        let mut length = short;
        let mut more = if short == 15 { 255 } else { 0 };
        while more == 255 {
            more = *packed.get(*at)?;
            length += usize::from(more);
            *at += 1;
        }
        Some(length)
    };
    loop {
        let token = usize::from(*packed.get(at)?);
        at += 1;
        let literals = extended(&mut at, token >> 4)?;
        let run = packed.get(at..at + literals)?;
        out.get_mut(made..made + literals)?.copy_from_slice(run);
        (at, made) = (at + literals, made + literals);
        if at == packed.len() {
            return Some(made);
        }
        let back = packed.get(at..)?.first_chunk()?;
        at += 2;
        let length = extended(&mut at, token & 15)? + 4;
        repeat(out, made, u16::from_le_bytes(*back).into(), length)?;
        made += length;
    }
}

/// Copies bytes that begin `back` before; if these are fewer than `length` they repeat: the span doubles with every
/// step.
fn repeat(out: &mut [u8], made: usize, back: usize, length: usize) -> Option<()> {
    let from = made.checked_sub(back).filter(|_| back > 0 && made + length <= out.len())?;
    let mut done = 0;
    while done < length {
        let now = (back + done).min(length - done);
        out.copy_within(from..from + now, made + done);
        done += now;
    }
    Some(())
}

/// Unpacks BloscLZ, a kind of FastLZ: runs of literal bytes, and copies of earlier output, within 8 KiB in two bytes
/// and up to 64 KiB further in four.
fn blosclz(packed: &[u8], out: &mut [u8]) -> Option<usize> {
    const NEAR: usize = 8191;
    let mut input = packed.iter().copied();
    let mut made = 0;
    let mut control = usize::from(input.next()? & 31);
    loop {
        if control < 32 {
            let run = out.get_mut(made..made + control + 1)?;
            for to in run {
                *to = input.next()?;
            }
            made += control + 1;
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                loop {
                    let more = input.next()?;
                    length += usize::from(more);
                    if more < 255 {
                        break;
                    }
                }
            }
            let (high, low) = (control & 31, usize::from(input.next()?));
            let mut back = (high << 8) + low + 1;
            if high == 31 && low == 255 {
                back = (usize::from(input.next()?) << 8) + usize::from(input.next()?) + NEAR + 1;
            }
            repeat(out, made, back, length)?;
            made += length;
        }
        match input.next() {
            Some(next) => control = usize::from(next),
            None => return Some(made),
        }
    }
}

/// Puts the bytes of samples together: first all first bytes, then all second ones.
fn unshuffle(shuffled: &[u8], plain: &mut [u8], size: usize) {
    let count = plain.len() / size;
    let mut places = shuffled.chunks_exact(count.max(1));
    // Pairs and fours are put together in registers.
    match (size, places.next(), places.next(), places.next(), places.next()) {
        (2, Some(a), Some(b), ..) => {
            let samples = plain.as_chunks_mut().0.iter_mut();
            samples.zip(a).zip(b).for_each(|((sample, a), b)| *sample = [*a, *b]);
        }
        (4, Some(a), Some(b), Some(c), Some(d)) => {
            let samples = plain.as_chunks_mut().0.iter_mut().zip(a).zip(b).zip(c).zip(d);
            samples.for_each(|((((sample, a), b), c), d)| *sample = [*a, *b, *c, *d]);
        }
        _ => {
            for (at, sample) in plain[..count * size].chunks_exact_mut(size).enumerate() {
                sample.iter_mut().enumerate().for_each(|(byte, to)| *to = shuffled[byte * count + at]);
            }
        }
    }
    let whole = plain.len() / size * size;
    plain[whole..].copy_from_slice(&shuffled[whole..]);
}

/// Puts the bits of samples together: row `8 * byte + bit` holds this bit of each sample.
fn unshuffle_bits(shuffled: &[u8], plain: &mut [u8], size: usize) {
    let count = plain.len() / size;
    let row = count / 8;
    for byte in 0..size {
        let rows = &shuffled[byte * 8 * row..][..8 * row];
        for group in 0..row {
            let mut bits = 0_u64;
            for bit in 0..8 {
                bits |= u64::from(rows[bit * row + group]) << (8 * bit);
            }
            let bits = transposed(bits).to_le_bytes();
            for (at, value) in bits.iter().enumerate() {
                plain[(group * 8 + at) * size + byte] = *value;
            }
        }
    }
    plain[count * size..].copy_from_slice(&shuffled[count * size..]);
}

/// Eight rows of eight bits, turned over the diagonal (Warren, Hacker's Delight, 7-3).
fn transposed(mut bits: u64) -> u64 {
    for (shift, mask) in
        [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)]
    {
        let swap = (bits ^ (bits >> shift)) & mask;
        bits ^= swap ^ (swap << shift);
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_lz4_are_unpacked_as_by_its_library_whole_or_damaged() {
        let mut state = 7_u64;
        let mut random = move |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            usize::try_from(state >> 33).unwrap() % below
        };
        let byte = |value: usize| u8::try_from(value).unwrap();
        for _ in 0..500 {
            let (count, kinds) = (random(3000), 1 + random(5));
            let mut plain = Vec::new();
            while plain.len() < count {
                let (value, run) = (byte(random(kinds)), 1 + random(40));
                plain.extend(std::iter::repeat_n(value, run));
            }
            let mut packed = lz4_flex::block::compress(&plain);
            let mut out = vec![0; plain.len()];
            assert_eq!(lz4(&packed, &mut out), Some(plain.len()));
            assert_eq!(out, plain);
            // Damage may give any result within the block, but no panic.
            let at = random(packed.len());
            packed[at] = byte(random(256));
            let made = lz4(&packed, &mut out);
            assert!(made.is_none_or(|made| made <= out.len()));
        }
    }

    #[test]
    fn bytes_and_bits_return_to_their_places() {
        for size in [1_usize, 2, 3, 4, 8, 11] {
            let plain: Vec<u8> =
                (0..size * 40).map(|i| u8::try_from((i * 37 + i / 7) % 256).unwrap()).collect();
            let count = plain.len() / size;
            let (mut bytes, mut bits) = (vec![0; plain.len()], vec![0; plain.len()]);
            for (at, sample) in plain.chunks(size).enumerate() {
                for (byte, value) in sample.iter().enumerate() {
                    bytes[byte * count + at] = *value;
                    for bit in 0..8 {
                        bits[(byte * 8 + bit) * count / 8 + at / 8] |= (value >> bit & 1) << (at % 8);
                    }
                }
            }
            let mut out = vec![0; plain.len()];
            unshuffle(&bytes, &mut out, size);
            assert_eq!(out, plain, "bytes of {size}");
            unshuffle_bits(&bits, &mut out, size);
            assert_eq!(out, plain, "bits of {size}");
        }
    }
}
