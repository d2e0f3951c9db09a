//! Masks: one byte a voxel, 1 inside and 0 outside, or two with the number of its label; as NRRD (nrrd.sourceforge.net, format 5) or NIfTI-1 (nifti_1.h).

use std::fs::File;
use std::io::{self, BufWriter, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::ExportForm;
use super::bits::Bits;
use super::fault::ExportFault;
use crate::geom::{Affine, Dims};

/// The longest side that a header of NIfTI-1 can state.
const NIFTI_MOST: u32 = 32767;

enum Out {
    Plain(BufWriter<File>),
    Gzip(GzEncoder<BufWriter<File>>),
}

impl Out {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Plain(out) => out.write_all(bytes),
            Self::Gzip(out) => out.write_all(bytes),
        }
    }
}

/// Writes one slice after the other.
pub(super) struct Mask {
    out: Out,
    dims: Dims,
    row: Vec<u8>,
    /// A row of labels, if they are written.
    labels: Option<Vec<u16>>,
    slices: u32,
    inside: u64,
}

impl Mask {
    /// Begins a mask of `dims` voxels, or a map of labels; `affine` maps indices to LPS mm. NRRD has gzipped samples
    /// behind a header of text, NIfTI a header of 352 bytes, then samples, and may be gzipped as a whole.
    pub(super) fn new(
        out: File,
        form: ExportForm,
        dims: Dims,
        affine: &Affine,
        labelled: bool,
    ) -> io::Result<Self> {
        let side = dims.to_array().into_iter().max().unwrap_or(0);
        if form != ExportForm::Nrrd && side > NIFTI_MOST {
            return Err(ExportFault::TooWide { side }.into());
        }
        let width = dims.nx() as usize;
        let mut plain = BufWriter::with_capacity(1 << 18, out);
        let out = match form {
            ExportForm::Nrrd => {
                plain.write_all(nrrd(dims, affine, labelled).as_bytes())?;
                Out::Gzip(GzEncoder::new(plain, Compression::fast()))
            }
            ExportForm::Nifti => {
                plain.write_all(&nifti(dims, affine, labelled))?;
                Out::Plain(plain)
            }
            _ => {
                let mut out = GzEncoder::new(plain, Compression::fast());
                out.write_all(&nifti(dims, affine, labelled))?;
                Out::Gzip(out)
            }
        };
        let row = vec![0; if labelled { 2 * width } else { width }];
        let labels = labelled.then(|| vec![0; width]);
        Ok(Self { out, dims, row, labels, slices: 0, inside: 0 })
    }

    /// Voxels inside so far.
    pub(super) fn inside(&self) -> u64 {
        self.inside
    }

    /// Writes empty slices up to `end`.
    pub(super) fn empty_until(&mut self, end: u32) -> io::Result<()> {
        self.row.fill(0);
        for _ in self.slices..end.min(self.dims.nz()) {
            (0..self.dims.ny()).try_for_each(|_| self.out.put(&self.row))?;
        }
        self.slices = self.slices.max(end.min(self.dims.nz()));
        Ok(())
    }

    /// Writes the next slice; `low` is the voxel at the first sample of the first row, which may lie outside the
    /// volume.
    pub(super) fn slice(&mut self, samples: &Bits, low: [i64; 2]) -> io::Result<()> {
        if self.slices >= self.dims.nz() {
            return Ok(());
        }
        self.slices += 1;
        for y in 0..i64::from(self.dims.ny()) {
            self.row.fill(0);
            let row = usize::try_from(y - low[1]).unwrap_or(usize::MAX);
            for stretch in samples.stretches(row) {
                let [start, end] = stretch.map(|x| usize::try_from(i64::from(x) + low[0]).unwrap_or(0));
                let end = end.min(self.row.len());
                if let Some(part) = self.row.get_mut(start..end) {
                    part.fill(1);
                    self.inside += part.len() as u64;
                }
            }
            self.out.put(&self.row)?;
        }
        Ok(())
    }

    /// Writes the next slice of labels; `fill` puts the labels of a row into a row of zeros.
    pub(super) fn label_slice(&mut self, fill: impl Fn(u32, &mut [u16])) -> io::Result<()> {
        let Some(labels) = &mut self.labels else { return Ok(()) };
        if self.slices >= self.dims.nz() {
            return Ok(());
        }
        self.slices += 1;
        for y in 0..self.dims.ny() {
            labels.fill(0);
            fill(y, labels);
            self.inside += labels.iter().filter(|label| **label != 0).count() as u64;
            for (bytes, label) in self.row.as_chunks_mut().0.iter_mut().zip(&*labels) {
                *bytes = label.to_le_bytes();
            }
            self.out.put(&self.row)?;
        }
        Ok(())
    }

    /// Completes the file.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.empty_until(self.dims.nz())?;
        match self.out {
            Out::Plain(mut out) => out.flush(),
            Out::Gzip(out) => out.finish()?.flush(),
        }
    }
}

fn nrrd(dims: Dims, affine: &Affine, labelled: bool) -> String {
    let kind = if labelled { "uint16\nendian: little" } else { "uint8" };
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let [nx, ny, nz] = dims.to_array();
    let axes = [0, 1, 2].map(|axis| vector(affine.column(axis))).join(" ");
    format!(
        "NRRD0005\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {axes}\nkinds: domain domain domain\nencoding: gzip\nspace origin: {}\n\n",
        vector(affine.origin())
    )
}

/// The header of NIfTI-1, with axes to the right, the front and the head.
#[expect(
    clippy::cast_possible_truncation,
    reason = "sides are checked before; the header holds 32-bit floats"
)]
fn nifti(dims: Dims, affine: &Affine, labelled: bool) -> Vec<u8> {
    let mut head = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| {
        if let Some(place) = head.get_mut(at..at + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    };
    put(0, &348_i32.to_le_bytes());
    let sides = dims.to_array().map(|n| n.min(NIFTI_MOST) as i16);
    let dim = [3, sides[0], sides[1], sides[2], 1, 1, 1, 1];
    dim.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
    // Codes of unsigned samples of two bytes or one.
    let (code, bits) = if labelled { (512_i16, 16_i16) } else { (2, 8) };
    put(70, &code.to_le_bytes());
    put(72, &bits.to_le_bytes());
    let spacing = affine.spacing_mm().map(|s| s as f32);
    [1.0, spacing[0], spacing[1], spacing[2]]
        .iter()
        .enumerate()
        .for_each(|(i, s)| put(76 + 4 * i, &s.to_le_bytes()));
    put(108, &352_f32.to_le_bytes());
    // Slope 1; millimetres; the affine in rows, with code 1 for the scanner's axes.
    put(112, &1_f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1_i16.to_le_bytes());
    for (i, row) in affine.rows.iter().enumerate() {
        let sign = if i < 2 { -1.0 } else { 1.0 };
        row.iter()
            .enumerate()
            .for_each(|(j, v)| put(280 + 16 * i + 4 * j, &((sign * v) as f32).to_le_bytes()));
    }
    put(344, b"n+1\0");
    head
}
