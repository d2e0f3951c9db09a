//! The pixels of one TIFF page, read in place or unpacked, row by row.

use std::io::{self, BufRead, ErrorKind, Read};

use weezl::decode::Decoder;
use weezl::{BitOrder, LzwStatus};

use super::directory::{Directory, Entry, Tiff, damaged};
use crate::fault::bad;
use crate::geom::Dims;
use crate::source::payload::{Samples, Section, Target, section};
use crate::volume::{Endian, Result, ScalarType};

/// Bytes that are written to the spool at a time, if rows are shorter.
const BATCH_BYTES: usize = 64 << 10;

/// The decoder of a compressed TIFF page: an inflater's window or a table of LZW codes, and the directory.
const TIFF_DECODER: u64 = 160 << 10;

/// The machine's own byte order.
const NATIVE: Endian = if cfg!(target_endian = "little") { Endian::Little } else { Endian::Big };

pub(super) mod tag {
    pub(in crate::source::tiff) const WIDTH: u16 = 256;
    pub(in crate::source::tiff) const HEIGHT: u16 = 257;
    pub(super) const BITS: u16 = 258;
    pub(super) const COMPRESSION: u16 = 259;
    pub(super) const PHOTOMETRIC: u16 = 262;
    pub(super) const FILL_ORDER: u16 = 266;
    pub(super) const STRIP_OFFSETS: u16 = 273;
    pub(super) const SAMPLES_PER_PIXEL: u16 = 277;
    pub(super) const ROWS_PER_STRIP: u16 = 278;
    pub(super) const STRIP_BYTES: u16 = 279;
    pub(super) const PREDICTOR: u16 = 317;
    pub(super) const TILE_WIDTH: u16 = 322;
    pub(super) const TILE_HEIGHT: u16 = 323;
    pub(super) const TILE_OFFSETS: u16 = 324;
    pub(super) const TILE_BYTES: u16 = 325;
    pub(super) const SAMPLE_FORMAT: u16 = 339;
}

/// Packing of chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Packing {
    None,
    Lzw,
    Deflate,
    PackBits,
}

/// A page, as far as its pixels are concerned.
pub(super) struct Raster {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) samples: Samples,
    /// True if 0 is white.
    pub(super) inverted: bool,
    packing: Packing,
    predictor: u64,
    /// Size of a chunk: a strip is as wide as the page.
    chunk: [u32; 2],
    tiled: bool,
    offsets: Entry,
    counts: Option<Entry>,
}

impl Raster {
    /// Reads the fields of a page.
    pub(super) fn read(tiff: &Tiff<'_>, directory: &Directory) -> io::Result<Self> {
        let value = |tag: u16, default: u64| tiff.value(directory, tag, default);
        let side = |n: u64| u32::try_from(n).ok().filter(|n| (1..=Dims::MAX_SIDE).contains(n));
        let (width, height) = (value(tag::WIDTH, 0)?, value(tag::HEIGHT, 0)?);
        let (Some(width), Some(height)) = (side(width), side(height)) else {
            return Err(damaged(bad!(
                "a page of {}x{} pixels is out of range",
                ([width, height])[0],
                ([width, height])[1]
            )));
        };
        let per_pixel = value(tag::SAMPLES_PER_PIXEL, 1)?;
        let photometric = value(tag::PHOTOMETRIC, 1)?;
        if per_pixel != 1 || photometric > 1 {
            return Err(damaged(bad!(
                "it has {}, and grey values are needed; convert it to grey",
                colours(photometric, per_pixel)
            )));
        }
        let (bits, format) = (value(tag::BITS, 1)?, value(tag::SAMPLE_FORMAT, 1)?);
        let samples = match (bits, format) {
            // Undefined (4) is read as unsigned, as most programs do.
            (8, 1 | 4) => Samples::Plain(ScalarType::U8),
            (8, 2) => Samples::Plain(ScalarType::I8),
            (16, 1 | 4) => Samples::Plain(ScalarType::U16),
            (16, 2) => Samples::Plain(ScalarType::I16),
            (16, 3) => Samples::F16,
            (32, 1 | 4) => Samples::Plain(ScalarType::U32),
            (32, 2) => Samples::Plain(ScalarType::I32),
            (32, 3) => Samples::Plain(ScalarType::F32),
            (64, 1) => Samples::U64,
            (64, 2) => Samples::I64,
            (64, 3) => Samples::Plain(ScalarType::F64),
            _ => {
                return Err(damaged(bad!(
                    "samples of {bits} bits in format {format} are not read; convert it to 8, 16 or 32 bits"
                )));
            }
        };
        let packing = match value(tag::COMPRESSION, 1)? {
            1 => Packing::None,
            5 => Packing::Lzw,
            8 | 32946 => Packing::Deflate,
            32773 => Packing::PackBits,
            code => {
                return Err(damaged(bad!(
                    "its compression {code} ({}) is not read; save it with LZW, deflate or none",
                    compression(code)
                )));
            }
        };
        if packing != Packing::None && value(tag::FILL_ORDER, 1)? == 2 {
            return Err(damaged(bad!("its compressed bits are in reversed order, which is not read")));
        }
        let predictor = if packing == Packing::None { 1 } else { value(tag::PREDICTOR, 1)? };
        let float = matches!(samples.delivered(), ScalarType::F32 | ScalarType::F64) && format == 3;
        if !(predictor == 1 || predictor == 2 || predictor == 3 && float) {
            return Err(damaged(bad!("its predictor {predictor} does not fit its samples")));
        }
        let tiled = directory.get(tag::TILE_OFFSETS).is_some();
        let (chunk, offsets, counts) = if tiled {
            let (tile_width, tile_height) = (value(tag::TILE_WIDTH, 0)?, value(tag::TILE_HEIGHT, 0)?);
            let (Some(w), Some(h)) = (side(tile_width), side(tile_height)) else {
                return Err(damaged(bad!(
                    "tiles of {}x{} are out of range",
                    ([tile_width, tile_height])[0],
                    ([tile_width, tile_height])[1]
                )));
            };
            ([w, h], directory.get(tag::TILE_OFFSETS), directory.get(tag::TILE_BYTES))
        } else {
            let rows = value(tag::ROWS_PER_STRIP, u64::from(height))?.clamp(1, u64::from(height));
            let rows = u32::try_from(rows).unwrap_or(height);
            ([width, rows], directory.get(tag::STRIP_OFFSETS), directory.get(tag::STRIP_BYTES))
        };
        let offsets = *offsets.ok_or_else(|| damaged(bad!("a page names no strips")))?;
        let counts = counts.copied();
        if packing != Packing::None && counts.is_none() {
            return Err(damaged(bad!("a page does not state the lengths of its strips")));
        }
        let raster = Self {
            width,
            height,
            samples,
            inverted: photometric == 0 && directory.get(tag::PHOTOMETRIC).is_some(),
            packing,
            predictor,
            chunk,
            tiled,
            offsets,
            counts,
        };
        let chunks = u64::from(raster.columns()) * u64::from(height.div_ceil(chunk[1]));
        if raster.offsets.count < chunks {
            return Err(damaged(bad!(
                "a page names {} strips or tiles where it needs {chunks}",
                raster.offsets.count
            )));
        }
        Ok(raster)
    }

    /// Chunks side by side.
    fn columns(&self) -> u32 {
        self.width.div_ceil(self.chunk[0].max(1))
    }

    /// Bytes of a page as stored, unpacked.
    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * self.samples.bytes() as u64
    }

    pub(super) fn packed(&self) -> bool {
        self.packing != Packing::None
    }

    /// Bytes held while a page is unrolled.
    pub(super) fn memory_bytes(&self) -> u64 {
        let row = u64::from(self.chunk[0]) * self.samples.delivered().bytes() as u64;
        TIFF_DECODER + row.max(BATCH_BYTES as u64) + row
    }

    /// Offset of the pixels where they are stored plain, row after row.
    pub(super) fn placed(&self, tiff: &Tiff<'_>) -> io::Result<Option<u64>> {
        let strips = self.height.div_ceil(self.chunk[1]);
        if self.packed() || (self.tiled && self.chunk[0] != self.width) {
            return Ok(None);
        }
        let strip_bytes = u64::from(self.chunk[0]) * u64::from(self.chunk[1]) * self.samples.bytes() as u64;
        let first = tiff.element(&self.offsets, 0)?;
        for strip in 1..strips {
            let expected = first.saturating_add(u64::from(strip).saturating_mul(strip_bytes));
            if tiff.element(&self.offsets, strip.into())? != expected {
                return Ok(None);
            }
        }
        Ok(Some(first))
    }

    /// The bytes of chunk `index`, unpacked.
    fn open<'a>(&self, tiff: &Tiff<'a>, index: u64) -> io::Result<Box<dyn Read + 'a>> {
        let offset = tiff.element(&self.offsets, index)?;
        let length = match &self.counts {
            Some(counts) if self.packed() => tiff.element(counts, index)?,
            _ => u64::from(self.chunk[0]) * u64::from(self.chunk[1]) * self.samples.bytes() as u64,
        };
        let bytes = section(tiff.file, offset, length);
        Ok(match self.packing {
            Packing::None => Box::new(bytes),
            Packing::Deflate => Box::new(flate2::bufread::ZlibDecoder::new(bytes)),
            Packing::Lzw => {
                let decoder = Decoder::with_tiff_size_switch(BitOrder::Msb, 8);
                Box::new(Lzw { inner: bytes, decoder, ended: false })
            }
            Packing::PackBits => Box::new(PackBits { inner: bytes, left: 0, repeated: None }),
        })
    }

    /// Unpacks the page into slice `z`.
    pub(super) fn unroll(&self, tiff: &Tiff<'_>, z: u32, target: &Target<'_>) -> Result<Result, io::Error> {
        let (stored, delivered) = (self.samples.bytes(), self.samples.delivered().bytes());
        let chunk_row = self.chunk[0] as usize;
        let row_bytes = chunk_row * delivered;
        // Rows of a strip lie side by side in the spool, too, and are written together.
        let batch = if self.tiled { 1 } else { (BATCH_BYTES / row_bytes).max(1) };
        let mut buffer = vec![0; batch * row_bytes];
        let mut planes = if self.predictor == 3 { vec![0; chunk_row * stored] } else { Vec::new() };
        let mut index = 0;
        for top in (0..self.height).step_by(self.chunk[1] as usize) {
            for left in (0..self.width).step_by(chunk_row) {
                let mut stream = self.open(tiff, index)?;
                index += 1;
                let end = self.height.min(top.saturating_add(self.chunk[1]));
                let columns = self.chunk[0].min(self.width - left) as usize;
                let mut y = top;
                while y < end {
                    let rows = batch.min((end - y) as usize);
                    for row in buffer.chunks_exact_mut(row_bytes).take(rows) {
                        // Samples that have to grow wait in the tail.
                        let tail = row_bytes - chunk_row * stored;
                        let part = row.get_mut(tail..).unwrap_or_default();
                        stream.read_exact(part)?;
                        let endian = self.undo(tiff.endian, part, &mut planes);
                        self.samples.deliver(endian, row);
                    }
                    let offset = target.offset(y, z) + u64::from(left) * delivered as u64;
                    let used = (rows - 1) * row_bytes + columns * delivered;
                    if let Err(error) = target.write(buffer.get(..used).unwrap_or_default(), offset) {
                        return Ok(Err(error));
                    }
                    y += u32::try_from(rows).unwrap_or(1);
                }
            }
        }
        Ok(Ok(()))
    }

    /// Undoes the predictor on one row of a chunk; gives back the byte order that the row has then.
    fn undo(&self, endian: Endian, row: &mut [u8], planes: &mut [u8]) -> Endian {
        let width = self.samples.bytes();
        match self.predictor {
            2 => {
                endian.to_native(width, row);
                match width {
                    1 => accumulate::<1, u8>(row, u8::wrapping_add),
                    2 => accumulate::<2, u16>(row, u16::wrapping_add),
                    4 => accumulate::<4, u32>(row, u32::wrapping_add),
                    _ => accumulate::<8, u64>(row, u64::wrapping_add),
                }
                NATIVE
            }
            3 => {
                // Differences of bytes; then one plane for each byte of a sample, the highest first.
                accumulate::<1, u8>(row, u8::wrapping_add);
                planes.copy_from_slice(row);
                let count = planes.len() / width;
                for (i, sample) in row.chunks_exact_mut(width).enumerate() {
                    for (plane, byte) in sample.iter_mut().enumerate() {
                        *byte = planes.get(plane * count + i).copied().unwrap_or(0);
                    }
                }
                Endian::Big
            }
            _ => endian,
        }
    }
}

/// Turns differences into values, in native order.
fn accumulate<const N: usize, T: bytemuck::Pod>(row: &mut [u8], add: impl Fn(T, T) -> T) {
    let mut last: T = bytemuck::Zeroable::zeroed();
    for sample in row.as_chunks_mut::<N>().0 {
        last = add(last, bytemuck::pod_read_unaligned(sample.as_slice()));
        sample.copy_from_slice(bytemuck::bytes_of(&last));
    }
}

/// LZW as TIFF has it.
struct Lzw<'a> {
    inner: Section<'a>,
    decoder: Decoder,
    ended: bool,
}

impl Read for Lzw<'_> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        while !self.ended && !buf.is_empty() {
            let input = self.inner.fill_buf()?;
            let empty = input.is_empty();
            let result = self.decoder.decode_bytes(input, buf);
            self.inner.consume(result.consumed_in);
            match result.status {
                Ok(LzwStatus::Done) => self.ended = true,
                Ok(LzwStatus::NoProgress) if empty => self.ended = true,
                Ok(_) => {
                    if empty && result.consumed_out == 0 {
                        self.ended = true;
                    }
                }
                Err(cause) => return Err(damaged(bad!("LZW: {cause}"))),
            }
            if result.consumed_out > 0 {
                return Ok(result.consumed_out);
            }
        }
        Ok(0)
    }
}

/// Runs of bytes as Apple's PackBits has them.
struct PackBits<'a> {
    inner: Section<'a>,
    left: usize,
    /// The byte of a run; `None` within literal bytes.
    repeated: Option<u8>,
}

impl PackBits<'_> {
    fn byte(&mut self) -> io::Result<Option<u8>> {
        let byte = self.inner.fill_buf()?.first().copied();
        self.inner.consume(usize::from(byte.is_some()));
        Ok(byte)
    }
}

impl Read for PackBits<'_> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        while self.left == 0 {
            let Some(head) = self.byte()? else { return Ok(0) };
            match head.cast_signed() {
                n @ 0.. => (self.left, self.repeated) = (usize::from(n.unsigned_abs()) + 1, None),
                -128 => {}
                n => {
                    let byte = self.byte()?.ok_or_else(|| io::Error::from(ErrorKind::UnexpectedEof))?;
                    (self.left, self.repeated) = (usize::from(n.unsigned_abs()) + 1, Some(byte));
                }
            }
        }
        let most = self.left.min(buf.len());
        let part = buf.get_mut(..most).unwrap_or_default();
        let got = match self.repeated {
            Some(byte) => {
                part.fill(byte);
                most
            }
            None => self.inner.read(part)?,
        };
        self.left -= got;
        Ok(got)
    }
}

fn colours(photometric: u64, samples: u64) -> String {
    match photometric {
        2 => "RGB colours".to_owned(),
        3 => "colours of a palette".to_owned(),
        0 | 1 => format!("{samples} samples a pixel"),
        other => format!("pixels of the photometric interpretation {other}"),
    }
}

fn compression(code: u64) -> &'static str {
    match code {
        2..=4 => "fax",
        6 | 7 => "JPEG",
        33003 | 33005 | 34712 => "JPEG 2000",
        50000 | 34926 => "Zstandard",
        50001 | 34927 => "WebP",
        34925 => "LZMA",
        _ => "unknown",
    }
}
