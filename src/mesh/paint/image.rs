//! PNG and JPEG, row by row, as the images of textures.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use png::{ColorType, DecodingError, Limits, Transformations};

use super::super::read::Image;
use crate::codec::{CodecError, FrameFormat, RowSink, jpeg};
use crate::platform::{FileExt, PositionalFile};
use std::borrow::Cow;

/// Memory that a decoder of PNG may allocate.
const DECODER_BYTES: usize = 4 << 20;
/// Bytes for a texel of a row: in rows of the decoder, in a row of every size of the image, and in a waiting one.
const ROW_TEXEL: u64 = 40;
const MAX_SIDE: u32 = 32_768;
/// Most texels of an image with a small file, and more for each of its bytes.
const MAX_TEXELS: u64 = 1 << 24;
const MAX_TEXELS_PER_BYTE: u64 = 64;

const UNKNOWN: &str = "is not read: it is not a PNG or JPEG of 8 bits in grey or colour; convert it";
const WEBP: &str = "is a WebP image, which is not read; write it as PNG or JPEG";
const KTX: &str = "is a KTX2 image, which is not read; write it as PNG or JPEG";
const DAMAGED: &str = "is damaged or cut short; copy it again";

/// Reason to refuse an image: it is wrong or unreadable, or the scratch file cannot be written.
#[derive(Debug)]
pub(super) enum Stop {
    Wrong(Cow<'static, str>),
    Read(io::Error),
    Scratch(io::Error),
}

/// Receives an image: its size, then its rows, three bytes a texel (sRGB).
pub(super) trait Rows {
    fn begin(&mut self, width: u32, height: u32) -> io::Result<()>;
    fn row(&mut self, texels: &[u8]) -> io::Result<()>;
}

/// Bytes of a file from a place on.
struct FileRange<'a> {
    file: &'a PositionalFile,
    offset: u64,
    bytes: u64,
    at: u64,
}

impl Read for FileRange<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.bytes.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let most = out.len().min(left);
        let got = self.file.read_at(out.get_mut(..most).unwrap_or_default(), self.offset + self.at)?;
        self.at += got as u64;
        Ok(got)
    }
}

impl Seek for FileRange<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.bytes.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

fn check_size(width: u32, height: u32, bytes: u64) -> Result<(), Cow<'static, str>> {
    let most = MAX_TEXELS + bytes.saturating_mul(MAX_TEXELS_PER_BYTE);
    if width == 0 || height == 0 {
        return Err(DAMAGED.into());
    }
    if width > MAX_SIDE || height > MAX_SIDE || u64::from(width) * u64::from(height) > most {
        return Err(format!(
            "would have {width} x {height} texels, which is more than 32768 along a side or than its bytes justify; make it smaller"
        )
        .into());
    }
    Ok(())
}

fn range_of(image: &Image) -> FileRange<'_> {
    FileRange { file: &image.file, offset: image.offset, bytes: image.bytes, at: 0 }
}

/// Memory that reading an image takes beyond any decoder's: rows, and the whole image if its samples come in several
/// passes over it (JPEG; PNG samples wait in a scratch file). Only headers are read.
pub(in crate::mesh) fn needed_bytes(image: &Image) -> u64 {
    let mut run = range_of(image);
    let mut head = [0; 24];
    let is_long = run.read(&mut head).is_ok_and(|got| got == head.len());
    run.at = 0;
    match head {
        [0x89, b'P', b'N', b'G', .., a, b, c, d, _, _, _, _] if is_long => {
            ROW_TEXEL * u64::from(u32::from_be_bytes([a, b, c, d]).min(MAX_SIDE))
        }
        [0xff, 0xd8, 0xff, ..] => {
            // An image is refused twice: for its tables, and for its samples.
            let (mut allowed, mut width) = (0, Width(0));
            for _ in 0..2 {
                run.at = 0;
                let refused = jpeg::decode(&mut BufReader::new(&mut run), allowed, &mut width);
                let Err(CodecError::Memory { needed_bytes, .. }) = refused else { break };
                allowed = needed_bytes;
            }
            allowed + ROW_TEXEL * u64::from(width.0.min(MAX_SIDE))
        }
        _ => 0,
    }
}

/// Receiver of the width of an image, and of no row.
struct Width(u32);

impl RowSink for Width {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        self.0 = format.columns;
        Ok(())
    }

    fn row(&mut self, _: &[i32]) -> Result<(), CodecError> {
        Err(refused())
    }
}

/// Hands the rows of an image on; transparency is left out.
pub(super) fn read(image: &Image, folder: &Path, rows: &mut dyn Rows) -> Result<(), Stop> {
    let mut run = range_of(image);
    let mut head = [0; 12];
    let _short = run.read(&mut head).map_err(Stop::Read)?;
    run.at = 0;
    match head {
        [0x89, b'P', b'N', b'G', ..] => read_png(run, folder, rows),
        [0xff, 0xd8, 0xff, ..] => read_jpeg(run, rows),
        [b'R', b'I', b'F', b'F', .., b'W', b'E', b'B', b'P'] => Err(Stop::Wrong(WEBP.into())),
        [0xab, b'K', b'T', b'X', ..] => Err(Stop::Wrong(KTX.into())),
        _ => Err(Stop::Wrong(UNKNOWN.into())),
    }
}

/// Rows of an interlaced image, in a file: their parts come in seven passes.
struct Passes {
    file: File,
    row: Vec<u8>,
}

/// First column and row of each pass, and the steps between its columns and rows (PNG, 8.2).
const PASSES: [[usize; 4]; 7] =
    [[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]];

impl Passes {
    /// Puts texels into a row at some of its places.
    fn put(&mut self, texels: &[u8], y: usize, first: usize, step: usize) -> io::Result<()> {
        let at = (y * self.row.len()) as u64;
        self.file.read_exact_at(&mut self.row, at)?;
        let places = self.row.as_chunks_mut::<3>().0.iter_mut().skip(first).step_by(step);
        places.zip(texels.as_chunks::<3>().0).for_each(|(place, texel)| *place = *texel);
        self.file.write_all_at(&self.row, at)
    }
}

fn read_png(run: FileRange<'_>, folder: &Path, rows: &mut dyn Rows) -> Result<(), Stop> {
    let bytes = run.bytes;
    let failed = |error: DecodingError| match error {
        DecodingError::IoError(cause) if cause.raw_os_error().is_some() => Stop::Read(cause),
        _ => Stop::Wrong(DAMAGED.into()),
    };
    let mut decoder = png::Decoder::new_with_limits(BufReader::new(run), Limits { bytes: DECODER_BYTES });
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_transformations(Transformations::normalize_to_color8());
    let head = decoder.read_header_info().map_err(failed)?;
    let (width, height, interlaced) = (head.width, head.height, head.interlaced);
    check_size(width, height, bytes).map_err(Stop::Wrong)?;
    let mut reader = decoder.read_info().map_err(failed)?;
    let samples = match reader.output_color_type().0 {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return Err(Stop::Wrong(DAMAGED.into())),
    };
    rows.begin(width, height).map_err(Stop::Scratch)?;
    let (width, height) = (width as usize, height as usize);
    let mut texels = Vec::with_capacity(3 * width);
    // Calls `put` with the texels of the next row, `count` of them.
    let mut next = |count: usize, put: &mut dyn FnMut(&[u8]) -> io::Result<()>| {
        let short = || Stop::Wrong(DAMAGED.into());
        let row = reader.next_row().map_err(failed)?.ok_or_else(short)?;
        texels.clear();
        for texel in row.data().get(..samples * count).ok_or_else(short)?.chunks_exact(samples) {
            match *texel {
                [r, g, b] | [r, g, b, _] => texels.extend([r, g, b]),
                [grey] | [grey, _] => texels.extend([grey; 3]),
                _ => {}
            }
        }
        put(&texels).map_err(Stop::Scratch)
    };
    if !interlaced {
        return (0..height).try_for_each(|_| next(width, &mut |texels| rows.row(texels)));
    }
    let file = crate::scratch::unnamed(folder).map_err(Stop::Scratch)?;
    file.set_len((3 * width * height) as u64).map_err(Stop::Scratch)?;
    let mut passes = Passes { file, row: vec![0; 3 * width] };
    for [x, y, right, down] in PASSES {
        let count = width.saturating_sub(x).div_ceil(right);
        for line in (y..height).step_by(down).filter(|_| count > 0) {
            next(count, &mut |texels| passes.put(texels, line, x, right))?;
        }
    }
    (0..height).try_for_each(|line| {
        let at = (line * passes.row.len()) as u64;
        passes
            .file
            .read_exact_at(&mut passes.row, at)
            .and_then(|()| rows.row(&passes.row))
            .map_err(Stop::Scratch)
    })
}

/// Turns samples into rows of texels.
struct Samples<'a> {
    rows: &'a mut dyn Rows,
    bytes: u64,
    components: usize,
    /// True for brightness and two colours.
    differences: bool,
    texels: Vec<u8>,
    wrong: Option<Cow<'static, str>>,
    scratch: bool,
}

fn refused() -> CodecError {
    CodecError::Io(io::ErrorKind::InvalidData.into())
}

impl RowSink for Samples<'_> {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        let components = usize::from(format.components);
        let fits = if matches!(components, 1 | 3) && format.precision == 8 {
            check_size(format.columns, format.rows, self.bytes)
        } else {
            Err(UNKNOWN.into())
        };
        if let Err(fault) = fits {
            self.wrong = Some(fault);
            return Err(refused());
        }
        self.components = components;
        self.scratch = true;
        self.rows.begin(format.columns, format.rows)?;
        self.scratch = false;
        Ok(())
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        self.texels.clear();
        for texel in samples.chunks_exact(self.components.max(1)) {
            self.texels.extend(match *texel {
                [y, b, r] if self.differences => rgb(y, b - 128, r - 128),
                [r, g, b] => [r, g, b].map(byte),
                _ => [byte(texel.first().copied().unwrap_or(0)); 3],
            });
        }
        self.scratch = true;
        self.rows.row(&self.texels)?;
        self.scratch = false;
        Ok(())
    }
}

fn byte(v: i32) -> u8 {
    v.clamp(0, 255) as u8
}

/// Red, green and blue (ITU-T T.871, 7), in parts of 2^16.
fn rgb(y: i32, b: i32, r: i32) -> [u8; 3] {
    let y = (y << 16) + (1 << 15);
    [y + 91_881 * r, y - 22_554 * b - 46_802 * r, y + 116_130 * b].map(|c| byte(c >> 16))
}

/// True if three components are brightness and colours. An Adobe marker decides; else the components' names, which are
/// R, G and B otherwise.
fn has_differences(run: &mut FileRange<'_>) -> io::Result<bool> {
    run.at = 2;
    let mut four = [0; 4];
    while run.read(&mut four)? == 4 && four[0] == 0xff {
        let (marker, length) = (four[1], u64::from(four[2]) << 8 | u64::from(four[3]));
        let behind = (run.at + length).saturating_sub(2);
        let mut body = [0; 15];
        let got = run.read(&mut body)?;
        match marker {
            0xee if got >= 12 && body.starts_with(b"Adobe") => return Ok(body[11] != 0),
            0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(&marker) => {
                return Ok([body[6], body[9], body[12]] != *b"RGB");
            }
            0xda => break,
            _ => {}
        }
        run.at = behind.max(run.at.saturating_sub(got as u64));
    }
    Ok(true)
}

fn read_jpeg(mut run: FileRange<'_>, rows: &mut dyn Rows) -> Result<(), Stop> {
    let differences = has_differences(&mut run).map_err(Stop::Read)?;
    run.at = 0;
    let bytes = run.bytes;
    let mut samples =
        Samples { rows, bytes, components: 0, differences, texels: Vec::new(), wrong: None, scratch: false };
    // Its memory was counted before.
    let decoded = jpeg::decode(&mut BufReader::new(run), u64::MAX, &mut samples);
    decoded.map_err(|error| match (samples.wrong, error) {
        (Some(fault), _) => Stop::Wrong(fault),
        (None, CodecError::Io(cause)) if samples.scratch => Stop::Scratch(cause),
        (None, CodecError::Io(cause)) if cause.raw_os_error().is_some() => Stop::Read(cause),
        (None, CodecError::Unsupported(_)) => Stop::Wrong(UNKNOWN.into()),
        (None, _) => Stop::Wrong(DAMAGED.into()),
    })
}
