//! Packing of chunks, and unpacking in pieces.

use std::io::{self, Read as _};
use std::ops::Range;

use super::array::{ChunkLocation, unread};
use super::blosc::Buffers;
use super::{Read, blosc};

use crate::fault::bad;
use crate::platform::PositionalFile;
use crate::source::payload::section;

/// Bytes that are handed on at a time.
pub(super) const PIECE: usize = 64 << 10;

/// Memory of an inflater and its read-ahead.
const STREAM: u64 = 192 << 10;

/// State of zstd's decoder besides its window.
const ZSTD: u64 = 512 << 10;

/// Receives a chunk in pieces, in order.
pub(super) type Sink<'a> = dyn FnMut(&[u8]) -> io::Result<()> + 'a;

/// Packing of chunks: one codec, and a checksum behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Packing {
    codec: Codec,
    /// True if a CRC-32C of all bytes before follows, in four bytes.
    checked: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Codec {
    #[default]
    None,
    Gzip,
    Zlib,
    Zstd,
    /// One block behind its length in four bytes, as numcodecs writes it.
    Lz4,
    Blosc,
}

pub(super) fn damaged(what: &'static str) -> io::Error {
    bad!("is a chunk that is damaged ({what}); copy it again").in_stream()
}

pub(super) fn short() -> io::Error {
    bad!("is a chunk that is cut short; copy it again").in_stream()
}

/// The error of a chunk that holds more bytes than its array states.
pub(super) fn long(length: u64, stated: u64) -> io::Error {
    bad!(
        "is a chunk of {length} bytes, and its array states {stated}; correct the sizes of its chunks or its data type"
    )
    .in_stream()
}

impl Packing {
    /// This packing with another codec behind it.
    pub(super) fn then(self, name: &str) -> Read<Self> {
        let codec = match name {
            "crc32c" if !self.checked => return Ok(Self { checked: true, ..self }),
            "gzip" => Codec::Gzip,
            "zlib" | "numcodecs.zlib" => Codec::Zlib,
            "zstd" => Codec::Zstd,
            "lz4" | "numcodecs.lz4" => Codec::Lz4,
            "blosc" => Codec::Blosc,
            other => return Err(unread(format!("the codec `{other}`"))),
        };
        if self != Self::default() {
            return Err(unread("chunks that are packed twice"));
        }
        Ok(Self { codec, ..self })
    }

    pub(super) fn is_packed(self) -> bool {
        self.codec != Codec::None
    }

    pub(super) fn is_checked(self) -> bool {
        self.checked
    }

    /// Memory that unpacking a chunk takes, by its first bytes; `bytes` is the length of a whole chunk.
    ///
    /// # Errors
    /// The chunk cannot be read, or begins wrongly.
    pub(super) fn memory_bytes(self, place: &ChunkLocation, bytes: u64) -> io::Result<u64> {
        let piece = 3 * PIECE as u64;
        Ok(piece
            + match self.codec {
                Codec::None => 0,
                Codec::Gzip | Codec::Zlib => STREAM,
                Codec::Zstd => ZSTD + zstd_window(place, bytes)?,
                Codec::Lz4 => bytes + place.length,
                Codec::Blosc => blosc::Header::read(place)?.memory_bytes(),
            })
    }

    /// Bytes of the blocks that are packed one by one, if a chunk has them and may be unpacked in parts.
    pub(super) fn block_bytes(self, place: &ChunkLocation) -> Option<u64> {
        let may = self.codec == Codec::Blosc && !self.checked;
        may.then(|| blosc::Header::read(place).ok()).flatten().map(|header| header.block_bytes())
    }

    /// Hands the `wanted` part of a chunk of `bytes` bytes to `sink`. Besides it, only parts that cannot be unpacked
    /// alone are read.
    ///
    /// # Errors
    /// The chunk cannot be read, is damaged or of another length, or needs more memory than `allowed_bytes`.
    pub(super) fn unpack(
        self,
        place: &ChunkLocation,
        (bytes, wanted): (u64, Range<u64>),
        allowed_bytes: u64,
        (buffers, sink): (&mut Buffers, &mut Sink<'_>),
    ) -> io::Result<()> {
        let needed_bytes = self.memory_bytes(place, bytes)?;
        if needed_bytes > allowed_bytes {
            return Err(bad!("is a chunk whose blocks need {needed_bytes} bytes to be unpacked, more than the first chunk ({allowed_bytes})").in_stream());
        }
        let ChunkLocation { file, at, length } = place;
        let mut length = *length;
        if self.checked {
            length = length.checked_sub(4).ok_or_else(short)?;
            check(file, *at, length)?;
        }
        let input = || section(file, *at, length);
        let mut left = wanted.clone();
        // Hands on the wanted part of a piece, and goes on from there.
        let trimmed = &mut |piece: &[u8]| {
            let skipped = usize::try_from(left.start).unwrap_or(usize::MAX).min(piece.len());
            let taken = usize::try_from(left.end).unwrap_or(usize::MAX).min(piece.len());
            left = left.start - skipped as u64..left.end - taken as u64;
            if skipped < taken { sink(&piece[skipped..taken]) } else { Ok(()) }
        };
        match self.codec {
            Codec::None => copy(input(), bytes, trimmed),
            Codec::Gzip => copy(flate2::bufread::MultiGzDecoder::new(input()), bytes, trimmed),
            Codec::Zlib => copy(flate2::bufread::ZlibDecoder::new(input()), bytes, trimmed),
            Codec::Zstd => copy(zstd::stream::read::Decoder::with_buffer(input())?, bytes, trimmed),
            Codec::Lz4 => {
                let mut packed = vec![0; usize::try_from(length).unwrap_or(usize::MAX)];
                file.read_exact_at(&mut packed, *at)?;
                let (stated, packed) = packed.split_at_checked(4).ok_or_else(short)?;
                let stated = stated.try_into().map_or(0, u32::from_le_bytes);
                if u64::from(stated) != bytes {
                    return Err(damaged("its length"));
                }
                let mut plain = vec![0; stated as usize];
                match lz4_flex::block::decompress_into(packed, &mut plain) {
                    Ok(count) if count == plain.len() => plain.chunks(PIECE).try_for_each(trimmed),
                    _ => Err(damaged("LZ4")),
                }
            }
            Codec::Blosc => {
                blosc::Header::read(place)?.unpack((place, length), bytes, &wanted, (buffers, sink))
            }
        }
    }
}

/// Hands on a stream of exactly `bytes` bytes.
fn copy(mut stream: impl io::Read, bytes: u64, sink: &mut Sink<'_>) -> io::Result<()> {
    let mut piece = vec![0; PIECE];
    let mut left = bytes;
    let stands = |cause: io::Error| match cause.kind() {
        io::ErrorKind::UnexpectedEof => short(),
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other => {
            damaged("what packs it")
        }
        _ => cause,
    };
    while left > 0 {
        let part = piece.get_mut(..usize::try_from(left).unwrap_or(PIECE).min(PIECE)).unwrap_or_default();
        stream.read_exact(part).map_err(stands)?;
        sink(part)?;
        left -= part.len() as u64;
    }
    // The end of a stream holds its checksum.
    let more = stream.by_ref().take(1).read(&mut piece[..1]).map_err(stands)?;
    if more > 0 { Err(damaged("its length")) } else { Ok(()) }
}

/// Compares the bytes of a chunk with the CRC-32C behind them.
fn check(file: &PositionalFile, at: u64, length: u64) -> io::Result<()> {
    let mut sum = 0;
    let mut piece = vec![0; PIECE];
    let mut done = 0;
    while done < length {
        let part = usize::try_from(length - done).unwrap_or(PIECE).min(PIECE);
        file.read_exact_at(&mut piece[..part], at + done)?;
        sum = crc32c::crc32c_append(sum, &piece[..part]);
        done += part as u64;
    }
    let mut stated = [0; 4];
    file.read_exact_at(&mut stated, at + length)?;
    if sum.to_le_bytes() == stated { Ok(()) } else { Err(damaged("its checksum")) }
}

/// The window of a zstd frame (RFC 8878, section 3.1.1.1) of a chunk of `bytes` bytes.
fn zstd_window(place: &ChunkLocation, bytes: u64) -> io::Result<u64> {
    const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
    let mut head = [0; 18];
    let there = usize::try_from(place.length).unwrap_or(usize::MAX).min(head.len());
    place.file.read_exact_at(&mut head[..there], place.at)?;
    if there < 6 || head[..4] != MAGIC {
        return Err(damaged("no zstd frame"));
    }
    let (descriptor, window) = (head[4], head[5]);
    if descriptor & 0x20 == 0 {
        let base = 1_u64 << (10 + (window >> 3));
        return Ok(base + base / 8 * u64::from(window & 7));
    }
    // A single segment: the window is the content, whose length follows the dictionary's number.
    let from = 5 + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let digits = [1, 2, 4, 8][usize::from(descriptor >> 6)];
    let mut length = [0; 8];
    length[..digits].copy_from_slice(&head[from..from + digits]);
    let more = if digits == 2 { 256 } else { 0 };
    let stated = u64::from_le_bytes(length).saturating_add(more);
    if stated <= bytes { Ok(stated) } else { Err(damaged("its length")) }
}
