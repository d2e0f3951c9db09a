//! PNG and JPEG, row by row, as the images of textures.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use png::{ColorType, DecodingError, Limits, Transformations};

use super::super::read::Image;
use crate::codec::{CodecError, FrameFormat, RowSink, jpeg};
use crate::facts::ImageFault;
use crate::platform::FileExt;

/// Memory of a decoder: of rows, and of images that come in several passes.
const DECODER_BYTES: usize = 4 << 20;
const PASSES_BYTES: usize = 64 << 20;
const MAX_SIDE: u32 = 32_768;
/// Texels of an image whose file is small, and more for each of its bytes.
const MAX_TEXELS: u64 = 1 << 24;
const MAX_TEXELS_PER_BYTE: u64 = 64;

/// Why an image is refused: it is wrong or unreadable, or the scratch file cannot be written.
#[derive(Debug)]
pub(super) enum Stop {
    Wrong(ImageFault),
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
    file: &'a File,
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

fn check_size(width: u32, height: u32, bytes: u64) -> Result<(), ImageFault> {
    let most = MAX_TEXELS + bytes.saturating_mul(MAX_TEXELS_PER_BYTE);
    if width == 0 || height == 0 {
        return Err(ImageFault::Damaged);
    }
    if width > MAX_SIDE || height > MAX_SIDE || u64::from(width) * u64::from(height) > most {
        return Err(ImageFault::TooLarge { width, height });
    }
    Ok(())
}

/// Hands the rows of an image on; what an image says of transparency is left out.
pub(super) fn read(image: &Image, rows: &mut dyn Rows) -> Result<(), Stop> {
    let mut run = FileRange { file: &image.file, offset: image.offset, bytes: image.bytes, at: 0 };
    let mut head = [0; 4];
    let _short = run.read(&mut head).map_err(Stop::Read)?;
    run.at = 0;
    match head {
        [0x89, b'P', b'N', b'G'] => read_png(run, rows),
        [0xff, 0xd8, 0xff, _] => read_jpeg(run, rows),
        _ => Err(Stop::Wrong(ImageFault::Unknown)),
    }
}

fn read_png(run: FileRange<'_>, rows: &mut dyn Rows) -> Result<(), Stop> {
    let bytes = run.bytes;
    let failed = |error: DecodingError| match error {
        DecodingError::IoError(cause) if cause.raw_os_error().is_some() => Stop::Read(cause),
        _ => Stop::Wrong(ImageFault::Damaged),
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
        ColorType::Indexed => return Err(Stop::Wrong(ImageFault::Damaged)),
    };
    rows.begin(width, height).map_err(Stop::Scratch)?;
    let mut texels = Vec::with_capacity(3 * width as usize);
    let mut hand_on = |row: &[u8]| {
        texels.clear();
        for texel in row.chunks_exact(samples) {
            match *texel {
                [r, g, b] | [r, g, b, _] => texels.extend([r, g, b]),
                [grey] | [grey, _] => texels.extend([grey; 3]),
                _ => {}
            }
        }
        rows.row(&texels).map_err(Stop::Scratch)
    };
    let short = || Stop::Wrong(ImageFault::Damaged);
    if interlaced {
        let size = reader.output_buffer_size().filter(|size| *size <= PASSES_BYTES);
        let mut whole = vec![0; size.ok_or(Stop::Wrong(ImageFault::TooLarge { width, height }))?];
        reader.next_frame(&mut whole).map_err(failed)?;
        return whole.chunks_exact(samples * width as usize).try_for_each(hand_on);
    }
    for _ in 0..height {
        let row = reader.next_row().map_err(failed)?.ok_or_else(short)?;
        hand_on(row.data().get(..samples * width as usize).ok_or_else(short)?)?;
    }
    Ok(())
}

/// Turns samples into rows of texels.
struct Samples<'a> {
    rows: &'a mut dyn Rows,
    bytes: u64,
    components: usize,
    /// Are they brightness and two colours?
    differences: bool,
    texels: Vec<u8>,
    wrong: Option<ImageFault>,
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
            Err(ImageFault::Unknown)
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

#[expect(clippy::cast_sign_loss, reason = "clamped")]
fn byte(v: i32) -> u8 {
    v.clamp(0, 255) as u8
}

/// Red, green and blue (ITU-T T.871, 7), in parts of 2^16.
fn rgb(y: i32, b: i32, r: i32) -> [u8; 3] {
    let y = (y << 16) + (1 << 15);
    [y + 91_881 * r, y - 22_554 * b - 46_802 * r, y + 116_130 * b].map(|c| byte(c >> 16))
}

/// Are three components brightness and colours? An Adobe marker says it; else the components' names, which are
/// R, G and B where they are not.
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
    let decoded = jpeg::decode(&mut BufReader::new(run), PASSES_BYTES as u64, &mut samples);
    decoded.map_err(|error| match (samples.wrong, error) {
        (Some(fault), _) => Stop::Wrong(fault),
        (None, CodecError::Io(cause)) if samples.scratch => Stop::Scratch(cause),
        (None, CodecError::Io(cause)) if cause.raw_os_error().is_some() => Stop::Read(cause),
        (None, CodecError::Unsupported(_)) => Stop::Wrong(ImageFault::Unknown),
        (None, _) => Stop::Wrong(ImageFault::Damaged),
    })
}
