//! Masks: one byte a voxel, 1 inside and 0 outside, as NRRD (nrrd.sourceforge.net, format 5) or NIfTI-1 (nifti_1.h).

use std::fs::File;
use std::io::{self, BufWriter, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::bits::Bits;
use crate::geom::{Affine, Dims};

/// The longest side that a header of NIfTI-1 can state.
pub(super) const NIFTI_MOST: u32 = 32767;

/// The form of a mask's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MaskForm {
    /// Samples gzipped behind a header of text.
    Nrrd,
    /// A header of 352 bytes, then samples.
    Nifti,
    /// The same, gzipped altogether.
    NiftiGz,
}

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
    slices: u32,
    inside: u64,
}

impl Mask {
    /// Begins a mask of `dims` voxels; `affine` leads from indices to LPS mm.
    pub(super) fn new(out: File, form: MaskForm, dims: Dims, affine: &Affine) -> io::Result<Self> {
        let mut plain = BufWriter::with_capacity(1 << 18, out);
        let out = match form {
            MaskForm::Nrrd => {
                plain.write_all(nrrd(dims, affine).as_bytes())?;
                Out::Gzip(GzEncoder::new(plain, Compression::fast()))
            }
            MaskForm::Nifti => {
                plain.write_all(&nifti(dims, affine))?;
                Out::Plain(plain)
            }
            MaskForm::NiftiGz => {
                let mut out = GzEncoder::new(plain, Compression::fast());
                out.write_all(&nifti(dims, affine))?;
                Out::Gzip(out)
            }
        };
        Ok(Self { out, dims, row: vec![0; dims.nx() as usize], slices: 0, inside: 0 })
    }

    /// Voxels inside so far.
    pub(super) fn inside(&self) -> u64 {
        self.inside
    }

    /// Slices up to `end` without a voxel.
    pub(super) fn empty_until(&mut self, end: u32) -> io::Result<()> {
        self.row.fill(0);
        for _ in self.slices..end.min(self.dims.nz()) {
            (0..self.dims.ny()).try_for_each(|_| self.out.put(&self.row))?;
        }
        self.slices = self.slices.max(end.min(self.dims.nz()));
        Ok(())
    }

    /// The next slice; `low` is the voxel at the first sample of the first row, which may lie before the volume.
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

    /// Completes the file.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.empty_until(self.dims.nz())?;
        match self.out {
            Out::Plain(mut out) => out.flush(),
            Out::Gzip(out) => out.finish()?.flush(),
        }
    }
}

fn nrrd(dims: Dims, affine: &Affine) -> String {
    let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
    let [nx, ny, nz] = dims.to_array();
    let axes = [0, 1, 2].map(|axis| vector(affine.column(axis))).join(" ");
    format!(
        "NRRD0005\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: {axes}\nkinds: domain domain domain\nencoding: gzip\nspace origin: {}\n\n",
        vector(affine.origin())
    )
}

/// The header of NIfTI-1, whose axes run to the right, the front and the head.
#[expect(
    clippy::cast_possible_truncation,
    reason = "sides are checked before; the header holds 32-bit floats"
)]
fn nifti(dims: Dims, affine: &Affine) -> Vec<u8> {
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
    // Unsigned bytes.
    put(70, &2_i16.to_le_bytes());
    put(72, &8_i16.to_le_bytes());
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
