//! NIfTI-1 and NIfTI-2 (<https://nifti.nimh.nih.gov>): `.nii`, `.nii.gz`, and pairs of `.hdr` and `.img`.
//!
//! Axes stay as they are stored, i is x. The affine is the sform if the header has one, else the qform, else
//! the bare spacing with a warning; NIfTI's RAS becomes LPS. Several time points are several volumes.
//! Samples keep their type: `scl_slope` and `scl_inter` become the rescale.

mod geometry;

use std::path::{Path, PathBuf};

use super::OpenOptions;
use super::header::{check_links, files_beside, unpacked, unreadable, unusable};
use super::payload::{Encoding, Samples, Skip, StoredLayout};
use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::volume::{Endian, Note, Rescale, Result, ScalarType, VolumeSource};
use geometry::Placement;
use std::borrow::Cow;

/// Bytes of a NIfTI-1 header, and of an ANALYZE 7.5 one.
const NIFTI1_BYTES: usize = 348;

/// Bytes of a NIfTI-2 header.
const NIFTI2_BYTES: usize = 540;

/// Bytes after the magic of NIfTI-2, which a text-mode transfer would change.
const NIFTI2_TAIL: &[u8] = b"\0\r\n\x1a\n";

/// True for a NIfTI or ANALYZE header, gzipped or not.
pub(super) fn recognise(head: &[u8], path: &Path) -> bool {
    let mut plain = [0; NIFTI1_BYTES];
    if head.starts_with(b"\x1f\x8b") {
        let got = unpacked(flate2::bufread::GzDecoder::new(head), &mut plain);
        return is_header(plain.get(..got).unwrap_or_default(), path);
    }
    is_header(head, path)
}

/// Recognised by the magic; without one (ANALYZE, or damage) by the size field, but only with a name for it.
fn is_header(head: &[u8], path: &Path) -> bool {
    let magic =
        |at: usize, list: &[&[u8]]| head.get(at..).is_some_and(|h| list.iter().any(|m| h.starts_with(m)));
    if magic(344, &[b"n+1\0", b"ni1\0"]) || magic(4, &[b"n+2\0", b"ni2\0"]) {
        return true;
    }
    let size = head.first_chunk::<4>().map(|b| [u32::from_le_bytes(*b), u32::from_be_bytes(*b)]);
    let sized = size.is_some_and(|sizes| sizes.iter().any(|n| *n == 348 || *n == 540));
    sized && ["hdr", "nii", "img"].iter().any(|e| extension(path).is_some_and(|(_, x)| x == *e))
}

/// The path without `.gz`, and its extension in lower case.
fn extension(path: &Path) -> Option<(PathBuf, String)> {
    let ends = |p: &Path, e: &str| p.extension().is_some_and(|x| x.eq_ignore_ascii_case(e));
    let bare = if ends(path, "gz") { path.with_extension("") } else { path.to_path_buf() };
    let extension = bare.extension()?.to_string_lossy().to_lowercase();
    Some((bare, extension))
}

/// The header of a pair whose samples were given: `brain.hdr` or `brain.hdr.gz` for `brain.img`.
pub(super) fn header_of_samples(path: &Path) -> Option<PathBuf> {
    let (bare, _) = extension(path).filter(|(_, e)| e == "img")?;
    ["hdr", "hdr.gz", "HDR"].iter().map(|e| bare.with_extension(e)).find(|p| p.is_file())
}

/// Opens a header and finds its samples.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let encoding = encoding_of(&file).map_err(|cause| unreadable(path, cause))?;
    let mut bytes = [0; NIFTI2_BYTES];
    let got = unpacked(encoding.open(&file, 0, Samples::Plain(ScalarType::U8)), &mut bytes);
    let header =
        Header::parse(bytes.get(..got).unwrap_or_default()).map_err(|fault| unusable(path, fault))?;
    let mut files = files_beside(path);
    let (data, encoding, skip) = if header.single {
        let least = if header.version == 1 { NIFTI1_BYTES } else { NIFTI2_BYTES } as u64;
        // Some writers leave the offset 0 and mean the end of the header.
        let offset = if header.offset == 0 { least + 4 } else { header.offset };
        if offset < least {
            return Err(unusable(path, bad!("its samples begin at byte {offset}, within its header")));
        }
        (path.to_path_buf(), encoding, offset)
    } else {
        let data = samples_of_header(path).ok_or_else(|| {
            unusable(path, bad!("is the header of a pair, and no .img file lies beside it; copy both"))
        })?;
        let mut beside = files_beside(path);
        beside.push(Path::new(data.file_name().unwrap_or_default()));
        check_links(path, &beside, options.follow_links)?;
        let file = PositionalFile::open(&data).map_err(|cause| unreadable(&data, cause))?;
        let encoding = encoding_of(&file).map_err(|cause| unreadable(&data, cause))?;
        (data, encoding, header.offset)
    };
    files.push(Path::new(data.file_name().unwrap_or_default()));
    let samples = header.samples().map_err(|fault| unusable(path, fault))?;
    let (size, volumes) = header.size().map_err(|fault| unusable(path, fault))?;
    let mut notes = Vec::new();
    let affine = header.placement.affine(&mut notes);
    let rescale = header.rescale(&mut notes).map_err(|fault| unusable(path, fault))?;
    let raw = encoding == Encoding::Raw;
    StoredLayout {
        header: path.to_path_buf(),
        format: "nifti",
        files,
        size,
        volumes,
        samples,
        endian: header.endian,
        encoding,
        skip: Skip::Bytes(if raw { skip } else { 0 }),
        skip_unpacked: Skip::Bytes(if raw { 0 } else { skip }),
        rescale,
        affine,
        notes,
        labels: Vec::new(),
    }
    .open()
}

/// Gzip is recognised by its first bytes, not by the name.
fn encoding_of(file: &PositionalFile) -> std::io::Result<Encoding> {
    let mut magic = [0; 2];
    let got = file.read_at(&mut magic, 0)?;
    Ok(if got == 2 && magic == [0x1f, 0x8b] { Encoding::Gzip } else { Encoding::Raw })
}

/// The file of samples next to the header of a pair.
fn samples_of_header(path: &Path) -> Option<PathBuf> {
    let (bare, _) = extension(path)?;
    ["img", "img.gz", "IMG"].iter().map(|e| bare.with_extension(e)).find(|p| p.is_file())
}

/// A header, as far as it matters.
struct Header {
    version: u8,
    endian: Endian,
    /// True if the samples are in the same file.
    single: bool,
    dim: [i64; 8],
    datatype: i16,
    offset: u64,
    slope: f64,
    intercept: f64,
    placement: Placement,
}

/// Fields at byte offsets; the header was checked to be long enough, and a wrong offset reads 0.
struct Fields<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

impl Fields<'_> {
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut out = [0; N];
        if let Some(found) = self.bytes.get(offset..).and_then(|rest| rest.first_chunk::<N>()) {
            out = *found;
        }
        // Bytes in little-endian order, as the readers below expect.
        if self.endian == Endian::Big {
            out.reverse();
        }
        out
    }

    fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    fn f32(&self, offset: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.at(offset)))
    }

    fn f64(&self, offset: usize) -> f64 {
        f64::from_le_bytes(self.at(offset))
    }
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let short = bad!("ends after {} bytes, within its NIfTI header; copy the file again", bytes.len());
        let Some(size) = bytes.first_chunk::<4>() else { return Err(short) };
        let (endian, size) = match (u32::from_le_bytes(*size), u32::from_be_bytes(*size)) {
            (n @ (348 | 540), _) => (Endian::Little, n),
            (_, n @ (348 | 540)) => (Endian::Big, n),
            _ => return Err(bad!("its NIfTI header is damaged: it states another length than 348 or 540")),
        };
        if bytes.len() < size as usize {
            return Err(short);
        }
        let fields = Fields { bytes, endian };
        let header = if size == 348 { Self::first(&fields)? } else { Self::second(&fields)? };
        if !(1..=7).contains(&header.dim[0]) {
            return Err(bad!("its NIfTI header is damaged: it has {} dimensions", header.dim[0]));
        }
        Ok(header)
    }

    fn first(fields: &Fields<'_>) -> Result<Self, Fault> {
        let single = match fields.bytes.get(344..348) {
            Some(b"n+1\0") => true,
            Some(b"ni1\0") => false,
            _ => {
                return Err(bad!(
                    "is ANALYZE 7.5, or has a damaged NIfTI header: left and right cannot be distinguished, so it is not read; convert it to NIfTI"
                ));
            }
        };
        let offset = fields.f32(108);
        #[expect(clippy::cast_possible_truncation, reason = "checked: 0 to 2^53, whole")]
        let offset = (0.0..9e15).contains(&offset).then_some(offset as u64);
        let row = |at: usize| [0, 4, 8, 12].map(|i| fields.f32(at + i));
        Ok(Self {
            version: 1,
            endian: fields.endian,
            single,
            dim: [0, 1, 2, 3, 4, 5, 6, 7].map(|i| i64::from(fields.i16(40 + 2 * i))),
            datatype: fields.i16(70),
            offset: offset.ok_or_else(|| bad!("its NIfTI header is damaged: its samples begin nowhere"))?,
            slope: fields.f32(112),
            intercept: fields.f32(116),
            placement: Placement {
                pixdim: [0, 1, 2, 3].map(|i| fields.f32(76 + 4 * i)),
                units: i32::from(fields.bytes.get(123).copied().unwrap_or(0)),
                qform_code: fields.i16(252).into(),
                sform_code: fields.i16(254).into(),
                quaternion: [0, 4, 8].map(|i| fields.f32(256 + i)),
                offset: [0, 4, 8].map(|i| fields.f32(268 + i)),
                rows: [row(280), row(296), row(312)],
            },
        })
    }

    fn second(fields: &Fields<'_>) -> Result<Self, Fault> {
        let single = match fields.bytes.get(4..7) {
            Some(b"n+2") => true,
            Some(b"ni2") => false,
            _ => return Err(bad!("its NIfTI-2 header is damaged: it has no magic")),
        };
        if fields.bytes.get(7..12) != Some(NIFTI2_TAIL) {
            return Err(bad!(
                "its NIfTI-2 header was changed by a transfer as text; copy the file as binary"
            ));
        }
        let row = |at: usize| [0, 8, 16, 24].map(|i| fields.f64(at + i));
        Ok(Self {
            version: 2,
            endian: fields.endian,
            single,
            dim: [0, 1, 2, 3, 4, 5, 6, 7].map(|i| fields.i64(16 + 8 * i)),
            datatype: fields.i16(12),
            offset: u64::try_from(fields.i64(168))
                .map_err(|_| bad!("its NIfTI header is damaged: its samples begin nowhere"))?,
            slope: fields.f64(176),
            intercept: fields.f64(184),
            placement: Placement {
                pixdim: [0, 1, 2, 3].map(|i| fields.f64(104 + 8 * i)),
                units: fields.i32(500),
                qform_code: fields.i32(344),
                sform_code: fields.i32(348),
                quaternion: [0, 8, 16].map(|i| fields.f64(352 + i)),
                offset: [0, 8, 16].map(|i| fields.f64(376 + i)),
                rows: [row(400), row(432), row(464)],
            },
        })
    }

    /// Voxels along the axes, and volumes.
    fn size(&self) -> Result<([u64; 3], u64), Fault> {
        let count = usize::try_from(self.dim[0]).unwrap_or(0);
        let at = |i: usize| {
            if i > count {
                return 1;
            }
            self.dim.get(i).and_then(|n| u64::try_from(*n).ok()).unwrap_or(0)
        };
        let more: Vec<u64> = (5..8).map(at).filter(|n| *n > 1).collect();
        if !more.is_empty() {
            return Err(bad!(
                "has {} dimensions, so a voxel has several values; extract one component into a file of its own",
                self.dim[0]
            ));
        }
        // Some writers state four dimensions and leave the fourth 0.
        Ok(([at(1), at(2).max(u64::from(count < 2)), at(3)], at(4).max(1)))
    }

    fn samples(&self) -> Result<Samples, Fault> {
        let plain = |scalar| Ok(Samples::Plain(scalar));
        match self.datatype {
            2 => plain(ScalarType::U8),
            4 => plain(ScalarType::I16),
            8 => plain(ScalarType::I32),
            16 => plain(ScalarType::F32),
            64 => plain(ScalarType::F64),
            256 => plain(ScalarType::I8),
            512 => plain(ScalarType::U16),
            768 => plain(ScalarType::U32),
            1024 => Ok(Samples::I64),
            1280 => Ok(Samples::U64),
            code => Err(bad!("its samples are {}, which is not read", type_name(code))),
        }
    }

    /// A slope of 0 means none, and so does NaN as some programs write it; an infinite one gives no values.
    fn rescale(&self, notes: &mut Vec<Note>) -> Result<Rescale, Fault> {
        let Self { slope, intercept, .. } = *self;
        if slope == 0.0 {
            return Ok(Rescale::IDENTITY);
        }
        if slope.is_nan() && !intercept.is_infinite() {
            notes.push(Note::new(format!(
                "the header states a slope of {slope}, which is ignored: values are as stored"
            )));
            return Ok(Rescale::IDENTITY);
        }
        if slope.is_finite() && intercept.is_finite() {
            return Ok(Rescale { slope, intercept });
        }
        Err(bad!("slope {slope} and intercept {intercept} give no values"))
    }
}

fn type_name(code: i16) -> Cow<'static, str> {
    match code {
        1 => "single bits".into(),
        32 | 1792 | 2048 => "complex numbers".into(),
        128 | 2304 => "colours (RGB)".into(),
        1536 => "128-bit floats".into(),
        other => format!("of the unknown type {other}").into(),
    }
}

#[cfg(test)]
mod tests;
