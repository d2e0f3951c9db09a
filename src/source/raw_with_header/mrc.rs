//! MRC and CCP4 maps (<https://www.ccpem.ac.uk/mrc-format/mrc2014/>): 1024 bytes of 4-byte words, an extended header,
//! samples.
//! Lengths are in ångströms. `MAPC`, `MAPR` and `MAPS` name the axes of the cell along which columns, rows and sections
//! run; cells need not be rectangular. The place is `ORIGIN`, or where that is 0 the first column, row and section.

use std::io::Read as _;
use std::path::Path;

use super::{Headed, Read, missing, refused, sample_type, unread};
use crate::geom::Affine;
use crate::platform::PositionalFile;
use crate::source::OpenOptions;
use crate::source::header::{unpacked, unreadable};
use crate::source::payload::{Encoding, Samples};
use crate::volume::{Endian, Note, Result, ScalarType, VolumeSource};

const HEADER: usize = 1024;
const MM: f64 = 1e-7;
/// IMOD's mark, and its flag for signed bytes.
const IMOD: i32 = 1_146_047_817;

/// True for an MRC file, gzipped or not.
pub(in crate::source) fn recognise(head: &[u8], path: &Path) -> bool {
    let mut plain = [0; HEADER];
    if is_packed(head) {
        let got = unpacked(flate2::bufread::GzDecoder::new(head), &mut plain);
        return plain.get(..got).is_some_and(is_marked)
            || (got == HEADER && stated_bytes(&plain).is_some_and(|stated| is_unpacked_to(stated, path)));
    }
    is_marked(head) || head.first_chunk().and_then(stated_bytes).is_some_and(|stated| is_long(stated, path))
}

fn is_packed(head: &[u8]) -> bool {
    head.starts_with(b"\x1f\x8b")
}

/// True for a file with the mark that is written since 2000.
fn is_marked(head: &[u8]) -> bool {
    head.get(208..211).is_some_and(|mark| mark == b"MAP")
}

/// Bytes of a file by its sizes and its mode: an older file has exactly as many.
fn stated_bytes(head: &[u8; HEADER]) -> Option<u64> {
    let headed = header(head, Encoding::Raw).ok()?;
    let [x, y, z] = headed.size;
    let voxels = x.checked_mul(y)?.checked_mul(z)?.checked_mul(headed.volumes)?;
    voxels.checked_mul(headed.samples.bytes() as u64)?.checked_add(headed.at).filter(|_| voxels > 0)
}

fn is_long(bytes: u64, path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|meta| meta.len() == bytes)
}

/// True for a gzipped file of as many bytes: its last four are their number modulo 2^32.
fn is_unpacked_to(bytes: u64, path: &Path) -> bool {
    let unpacked = || {
        let file = PositionalFile::open(path).ok()?;
        let mut length = [0; 4];
        file.read_exact_at(&mut length, file.metadata().ok()?.len().checked_sub(4)?).ok()?;
        Some(u64::from(u32::from_le_bytes(length)))
    };
    unpacked() == Some(bytes & u64::from(u32::MAX))
}

pub(in crate::source) fn open(path: &Path, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let mut magic = [0; 2];
    file.read_exact_at(&mut magic, 0).map_err(|cause| unreadable(path, cause))?;
    let encoding = if is_packed(&magic) { Encoding::Gzip } else { Encoding::Raw };
    let mut head = [0; HEADER];
    let mut stream = encoding.open(&file, 0, Samples::Plain(ScalarType::U8));
    stream.read_exact(&mut head).map_err(|cause| unreadable(path, cause))?;
    header(&head, encoding).map_err(refused(path))?.open(path, None)
}

fn header(head: &[u8; HEADER], encoding: Encoding) -> Read<Headed> {
    let marked = is_marked(head);
    let endian = match head[212] {
        0x44 if marked => Endian::Little,
        0x11 if marked => Endian::Big,
        // The byte order is left out: the one counts in which the kind of samples makes sense.
        _ if i32::from_le_bytes([head[12], head[13], head[14], head[15]]) < 256 => Endian::Little,
        _ => Endian::Big,
    };
    // Words are counted from 1, as the format does.
    let bytes = |word: usize| {
        let at = 4 * (word - 1);
        let bytes = [head[at], head[at + 1], head[at + 2], head[at + 3]];
        if endian == Endian::Big { bytes } else { [bytes[3], bytes[2], bytes[1], bytes[0]] }
    };
    let whole = |word| i32::from_be_bytes(bytes(word));
    let real = |word| f64::from(f32::from_be_bytes(bytes(word)));
    let whole3 = |word| [whole(word), whole(word + 1), whole(word + 2)];
    let real3 = |word| [real(word), real(word + 1), real(word + 2)];
    let signed = whole(39) != IMOD || whole(40) & 1 != 0;
    let samples = match whole(4) {
        0 => sample_type(false, signed, 8),
        1 => sample_type(false, true, 16),
        2 => sample_type(true, true, 32),
        6 => sample_type(false, false, 16),
        12 => sample_type(true, true, 16),
        3 | 4 => return Err(unread("complex numbers", "write their amplitudes as MODE 2")),
        mode => {
            return Err(unread(format!("samples of MODE {mode}"), "write them as MODE 0, 1, 2, 6 or 12"));
        }
    };
    let samples = samples.ok_or_else(|| missing("MODE"))?;
    let size = whole3(1).map(|n| u64::try_from(n).unwrap_or(0));
    let (group, sections) = (whole(23), u64::try_from(whole(10)).unwrap_or(0));
    if group == 0 && sections == 1 && size[2] > 1 {
        let cure = "reconstruct a volume first; of the slices of one volume, set MZ to their number";
        return Err(unread(format!("a stack of {} pictures (ISPG 0, MZ 1)", size[2]), cure));
    }
    let is_stack = group >= 401 && sections > 0 && size[2].is_multiple_of(sections);
    let volumes = if is_stack { size[2] / sections } else { 1 };
    let mut notes = Vec::new();
    if !marked {
        notes.push(Note::new(
            "the header has no mark (MAP); it is read as MRC because its sizes agree with those of the file",
        ));
    }
    let (intervals, cell) = (whole3(8), real3(11));
    let is_stated = (0..3).all(|k| intervals[k] > 0 && cell[k] > 0.0);
    let affine = if is_stated {
        let order = whole3(17).map(|axis| axis.saturating_sub(1));
        let along = cell_axes(real3(14)).ok_or_else(|| missing("the angles of its cell"))?;
        let axes = if order == [-1; 3] { [0, 1, 2] } else { order };
        let mut affine = Affine::from_spacing([1.0; 3]);
        // Older files have other fields where newer ones have the origin.
        let (origin, start) = (if marked { real3(50) } else { [0.0; 3] }, whole3(5));
        for axis in 0..3 {
            let k = usize::try_from(axes[axis])
                .ok()
                .filter(|k| *k < 3 && (0..axis).all(|a| axes[a] != axes[axis]));
            let k = k.ok_or_else(|| missing("MAPC, MAPR and MAPS"))?;
            let step = cell[k] / f64::from(intervals[k]) * MM;
            for (row, part) in affine.rows.iter_mut().zip(along[k]) {
                row[axis] = part * step;
                row[3] += part * step * f64::from(start[axis]);
            }
        }
        if origin.iter().any(|c| *c != 0.0) {
            (0..3).for_each(|k| affine.rows[k][3] = origin[k] * MM);
        }
        affine
    } else {
        let [a, b, c] = cell;
        notes.push(match cell.iter().any(|side| *side != 0.0) {
            true => Note::spacing(format!(
                "the header states a cell of {a} x {b} x {c} ångströms in {intervals:?} intervals, which makes no spacing; 1 mm is assumed"
            )),
            false => Note::no_spacing("the header"),
        });
        Affine::from_spacing([1.0; 3])
    };
    // The bytes of the extended header.
    let more = u64::try_from(whole(24)).map_err(|_| missing("NSYMBT"))?;
    let size = [size[0], size[1], size[2] / volumes.max(1)];
    let at = HEADER as u64 + more;
    Ok(Headed { format: "mrc", size, volumes, samples, endian, at, encoding, affine, notes })
}

/// The axes of a cell of unit length: a along x, b in the plane of x and y. Angles of 0 were left out.
fn cell_axes(degrees: [f64; 3]) -> Option<[[f64; 3]; 3]> {
    if degrees.iter().all(|angle| *angle == 90.0 || *angle == 0.0) {
        return Some([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }
    let [alpha, beta, gamma] = degrees.map(f64::to_radians);
    let y = (alpha.cos() - beta.cos() * gamma.cos()) / gamma.sin();
    let z = (1.0 - beta.cos().powi(2) - y * y).sqrt();
    let axes = [[1.0, 0.0, 0.0], [gamma.cos(), gamma.sin(), 0.0], [beta.cos(), y, z]];
    axes.iter().flatten().all(|c| c.is_finite()).then_some(axes)
}
