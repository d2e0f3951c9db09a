//! A CT-like head of any size, computed on demand: the demonstration volume.
//!
//! Every sample is a function of `(x, y, z, side)` alone, so rows may be read in any order and size,
//! nothing is held but one small table, and the volume is the same on every machine: the arithmetic
//! is IEEE `+ - * / sqrt` and integer hashing, without a mathematical library.
//!
//! ```text
//!   z up                      the cube is 230.4 mm a side, centred on the origin (LPS);
//!   |   / y to the back       the face looks to -y, so x grows to the right of a viewer
//!   |  /                      in front of it: the patient's left
//!   | /
//!   +------ x to the patient's left
//! ```
//!
//! Outside the brain the head is symmetric but for two marks on the patient's **left** (+x): a burr
//! hole in the forehead's bone and a ring in the ear lobe. They show a mirrored picture at once.

mod anatomy;
mod shape;

use std::ops::Range;

use self::shape::{Columns, FAR, PIECE, Step, distances};
use super::description;
use super::spec::HEAD;
use crate::geom::{Affine, Dims};
use crate::volume::{Rescale, Result, ScalarType, VolumeInfo, VolumeSource};

/// Edge of the cube in mm at every `side`; 0.45 mm a voxel at 512.
const EDGE_MM: f32 = 230.4;

/// Width of the partial-volume ramp at every surface, in voxels.
const RAMP_VOXELS: f32 = 1.5;

// Values in Hounsfield units. Brain and fluid lie further apart than in a patient, so that a range
// can separate the folds from the fluid in spite of the noise.
const AIR_HU: f32 = -1000.0;
const SOFT_HU: f32 = 50.0;
const FLUID_HU: f32 = 0.0;
const BRAIN_HU: f32 = 90.0;
const BONE_HU: f32 = 1100.0;
const TOOTH_HU: f32 = 2200.0;
const METAL_HU: f32 = 3000.0;

/// Largest deviation by noise; its distribution is a triangle (standard deviation 5 HU).
const NOISE_HU: f32 = 12.0;

/// Burr hole in the left forehead: centre and radius.
const BURR_HOLE: ([f32; 3], f32) = ([33.0, -48.0, 70.0], 8.5);
/// Ring in the left ear lobe: centre, radius of the ring, radius of the wire; its axis is y.
const EAR_RING: ([f32; 3], f32, f32) = ([75.0, 8.0, -44.0], 8.0, 1.6);

/// Spatial frequency of the brain's folds, radians per mm.
const FOLD_FREQUENCY: f32 = 0.30;
/// A fold's crest is where the wave stays above this; it sets the width of the furrows.
const FOLD_LEVEL: f32 = 0.26;

/// A head with skin, skull, teeth and a folded brain, `side` cubed, as 16-bit signed Hounsfield units.
///
/// Memory: a table of 8 bytes per column, and 10 KiB of stack while reading. Cost: about 11 ns
/// per voxel on average, least in air.
#[derive(Debug)]
pub struct SyntheticHead {
    info: VolumeInfo,
    side: u32,
    voxel_mm: f32,
    /// Sine and cosine of the fold wave at every voxel position of an axis.
    waves: Vec<[f32; 2]>,
}

impl SyntheticHead {
    /// Threshold for the skull.
    pub(crate) const BONE_ISO_HU: f64 = 400.0;

    /// A head of `side` voxels along each axis, or `None` unless that is 1..=65536.
    pub fn new(side: u32) -> Option<Self> {
        let dims = Dims::new(side, side, side)?;
        let spacing = f64::from(EDGE_MM) / f64::from(side);
        let mut affine = Affine::from_spacing([spacing; 3]);
        for row in &mut affine.rows {
            row[3] = -0.5 * spacing * f64::from(side - 1);
        }
        #[expect(clippy::cast_possible_truncation, reason = "a length in mm")]
        let voxel_mm = spacing as f32;
        let waves = (0..side).map(|i| sin_cos(FOLD_FREQUENCY * position(i, side, voxel_mm))).collect();
        let info = VolumeInfo {
            dims,
            scalar: ScalarType::I16,
            rescale: Rescale::IDENTITY,
            spacing_mm: [spacing; 3],
            affine,
            description: description(HEAD, dims, ScalarType::I16),
            notes: Vec::new(),
        };
        Some(Self { info, side, voxel_mm, waves })
    }

    /// Samples of columns `first ..` of a row, as many as `out` has room for (at most [`PIECE`]).
    fn piece(&self, first: u32, y: u32, z: u32, out: &mut [i16]) {
        let n = out.len();
        let mut values = [AIR_HU; PIECE];
        let values = &mut values[..n];
        let (y_mm, z_mm) = (self.at(y), self.at(z));
        let mut x = [0.0; PIECE];
        for (x, i) in x.iter_mut().zip(first..) {
            *x = self.at(i);
        }
        let at = Columns { x: &x[..n], y: y_mm, z: z_mm, voxel: self.voxel_mm };
        self.tissue(&at, first, [y, z], values);
        for ((out, value), i) in out.iter_mut().zip(values).zip(first..) {
            let hash = hash(i, y, z);
            // Two independent halves, each uniform: their sum is a triangle.
            let sum = (hash & 0xFFFF) as i32 + (hash >> 16) as i32 - 0xFFFF;
            *out = round(*value + sum as f32 * (NOISE_HU / 65535.0));
        }
    }

    /// Noise-free values of one piece, starting from air.
    fn tissue(&self, at: &Columns<'_>, first: u32, row: [u32; 2], values: &mut [f32]) {
        let mut soft = [FAR; PIECE];
        let soft = &mut soft[..values.len()];
        let near = distances(anatomy::SOFT_TISSUE, at, soft);
        if near {
            self.paint(soft, &[-FAR; PIECE], SOFT_HU, values);
        }
        self.ear_ring(at, values);
        // Everything else is intersected with the skin, so columns outside it are left alone.
        let Some(run) = within(soft, 0.5 * RAMP_VOXELS * self.voxel_mm) else { return };
        let at = Columns { x: &at.x[run.clone()], ..*at };
        let (skin, values) = (&soft[run.clone()], &mut values[run.clone()]);
        self.bone(&at, skin, values);
        self.layer(anatomy::AIRWAYS, &at, skin, AIR_HU, values);
        self.layer(anatomy::TEETH, &at, skin, TOOTH_HU, values);
        if self.layer(anatomy::CRANIAL_CAVITY, &at, skin, FLUID_HU, values) {
            self.brain(&at, first as usize + run.start, row, skin, values);
        }
    }

    /// Paints one recipe under the skin; returns whether any column is touched.
    fn layer(&self, recipe: &[Step], at: &Columns<'_>, skin: &[f32], hu: f32, values: &mut [f32]) -> bool {
        let mut d = [FAR; PIECE];
        let d = &mut d[..values.len()];
        distances(recipe, at, d) && self.paint(d, skin, hu, values)
    }

    /// Bone, with the burr hole.
    fn bone(&self, at: &Columns<'_>, skin: &[f32], values: &mut [f32]) {
        let mut d = [FAR; PIECE];
        let d = &mut d[..values.len()];
        if !distances(anatomy::BONE, at, d) {
            return;
        }
        let (c, r) = BURR_HOLE;
        let (dy, dz) = (at.y - c[1], at.z - c[2]);
        if dy.abs() < 2.0 * r && dz.abs() < 2.0 * r {
            for (d, x) in d.iter_mut().zip(at.x) {
                let dx = x - c[0];
                *d = d.max(r - (dx * dx + dy * dy + dz * dz).sqrt());
            }
        }
        self.paint(d, skin, BONE_HU, values);
    }

    /// The ring in the left ear lobe.
    fn ear_ring(&self, at: &Columns<'_>, values: &mut [f32]) {
        let (c, ring, wire) = EAR_RING;
        let (dy, dz) = (at.y - c[1], at.z - c[2]);
        let reach = wire + RAMP_VOXELS * self.voxel_mm;
        if dy.abs() > reach || dz.abs() > ring + reach {
            return;
        }
        let mut d = [FAR; PIECE];
        let d = &mut d[..values.len()];
        for (d, x) in d.iter_mut().zip(at.x) {
            let dx = x - c[0];
            let off = (dx * dx + dz * dz).sqrt() - ring;
            *d = (off * off + dy * dy).sqrt() - wire;
        }
        self.paint(d, &[-FAR; PIECE], METAL_HU, values);
    }

    /// Brain: its outline, cut by the sheets of a gyroid wave outside the core. `first` is the column
    /// of `at.x[0]`.
    fn brain(&self, at: &Columns<'_>, first: usize, [y, z]: [u32; 2], skin: &[f32], values: &mut [f32]) {
        let mut d = [FAR; PIECE];
        let mut core = [FAR; PIECE];
        let (d, core) = (&mut d[..values.len()], &mut core[..values.len()]);
        distances(anatomy::BRAIN, at, d);
        distances(anatomy::BRAIN_CORE, at, core);
        let wave = |i: u32| self.waves.get(i as usize).copied().unwrap_or_default();
        let ([sy, cy], [sz, cz]) = (wave(y), wave(z));
        let waves = self.waves.get(first..).unwrap_or_default();
        for ((d, core), [sx, cx]) in d.iter_mut().zip(core).zip(waves) {
            let gyroid = sx * cy + sy * cz + sz * cx;
            // Over its typical slope the wave is a distance to the furrow's wall in mm.
            let furrow = (FOLD_LEVEL - gyroid.abs()) * (1.0 / (1.4 * FOLD_FREQUENCY));
            *d = d.max(core.min(furrow));
        }
        self.paint(d, skin, BRAIN_HU, values);
    }

    /// Mixes `hu` into the values where both distances are small or negative, over a linear ramp;
    /// returns whether any column is touched.
    fn paint(&self, d: &[f32], skin: &[f32], hu: f32, values: &mut [f32]) -> bool {
        let steep = 1.0 / (RAMP_VOXELS * self.voxel_mm);
        let mut most = 0.0_f32;
        for ((value, d), skin) in values.iter_mut().zip(d).zip(skin) {
            let share = (0.5 - d.max(*skin) * steep).clamp(0.0, 1.0);
            most = most.max(share);
            *value += (hu - *value) * share;
        }
        most > 0.0
    }

    /// Position of index `i` of any axis in mm.
    fn at(&self, i: u32) -> f32 {
        position(i, self.side, self.voxel_mm)
    }
}

impl VolumeSource for SyntheticHead {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        if cols.is_empty() {
            return Ok(());
        }
        let mut samples = [0_i16; PIECE];
        for (y, row) in rows.zip(out.chunks_mut(2 * cols.len())) {
            for (first, bytes) in cols.clone().step_by(PIECE).zip(row.chunks_mut(2 * PIECE)) {
                let samples = &mut samples[..bytes.len() / 2];
                self.piece(first, y, z, samples);
                bytes.copy_from_slice(bytemuck::cast_slice(samples));
            }
        }
        Ok(())
    }
}

/// Position in mm of voxel `i`, exactly mirrored about the middle.
fn position(i: u32, side: u32, voxel_mm: f32) -> f32 {
    (2 * i64::from(i) + 1 - i64::from(side)) as f32 * (0.5 * voxel_mm)
}

/// Nearest 16-bit integer (ties to even) of a value within its range: adding 1.5 x 2^23 leaves the
/// integer in the low bits of the mantissa, which vectorises where a saturating cast does not.
#[inline(always)]
fn round(value: f32) -> i16 {
    #[expect(clippy::cast_possible_truncation, reason = "the low 16 bits are the integer")]
    let integer = (value + 12_582_912.0).to_bits() as i16;
    integer
}

/// Shortest run of columns that holds every distance under `reach`.
fn within(d: &[f32], reach: f32) -> Option<Range<usize>> {
    let near = |d: &f32| *d < reach;
    let start = d.iter().position(near)?;
    let end = d.iter().rposition(near)? + 1;
    Some(start..end)
}

/// A 32-bit hash of a voxel: multiply and shift rounds over the three indices.
#[inline(always)]
fn hash(x: u32, y: u32, z: u32) -> u32 {
    let row = (y ^ z.wrapping_mul(0x9E37_79B1)).wrapping_mul(0x85EB_CA6B);
    let mut h = (x ^ row ^ (row >> 15)).wrapping_mul(0xC2B2_AE35);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^ (h >> 13)
}

/// Sine and cosine by Taylor polynomials of the reduced angle: error under 1e-6, the same bits
/// everywhere, which a mathematical library does not promise.
fn sin_cos(angle: f32) -> [f32; 2] {
    use std::f64::consts::FRAC_PI_2;
    let quarters = (f64::from(angle) / FRAC_PI_2).round_ties_even();
    let r = f64::from(angle) - quarters * FRAC_PI_2;
    let r2 = r * r;
    let sin = r * (1.0 + r2 * (-1.0 / 6.0 + r2 * (1.0 / 120.0 + r2 * (-1.0 / 5040.0 + r2 / 362_880.0))));
    let cos = 1.0
        + r2 * (-0.5 + r2 * (1.0 / 24.0 + r2 * (-1.0 / 720.0 + r2 * (1.0 / 40_320.0 - r2 / 3_628_800.0))));
    #[expect(clippy::cast_possible_truncation, reason = "a small whole number; rounds to single")]
    let (quadrant, sin, cos) = ((quarters as i64) & 3, sin as f32, cos as f32);
    match quadrant {
        0 => [sin, cos],
        1 => [cos, -sin],
        2 => [-sin, -cos],
        _ => [-cos, sin],
    }
}

#[cfg(test)]
mod tests;
