//! A body as a volume, with samples computed on demand.

use std::ops::Range;

use super::body::{Body, TrueSurface};
use super::description;
use super::math::{FAR, Vector, minus, noise, share_below};
use super::spec::{Sampling, Spec};
use crate::geom::{Affine, Dims, dot};
use crate::volume::{Rescale, Result, ScalarType, VolumeInfo, VolumeSource};

/// A body whose surface is known, sampled on demand.
///
/// Values are densities, 0 in air and 1 in the body, at any number of bits; **the true surface is at 1/2**. The point
/// spread acts across the surface: a sample is the share of a normal distribution that lies within the distance to the
/// surface. So the level 1/2 is the true surface itself and measured errors are the program's; a true convolution would
/// move it by `psf^2` times the mean curvature. Slices that average over their thickness do move it, as a scanner's do.
///
/// Every sample is a function of its place alone, by arithmetic that rounds alike on every machine. Memory: some
/// hundred bytes. Cost: 5 to 30 ns for each sample of density, ellipsoids and waves up to 300 ns near the surface,
/// times the number of places that a thick slice averages.
#[derive(Clone, Debug)]
pub struct AnalyticVolume {
    info: VolumeInfo,
    body: Body,
    sampling: Sampling,
    /// Distance of samples in units of the finest.
    spacing: Vector,
    unit_mm: f64,
    /// Heights above the middle of a slice that it averages, in units.
    heights: Vec<f64>,
    /// Balls of air in the body: middles and radii in units.
    pores: Vec<(Vector, f64)>,
}

/// Places averaged for each unit of a slab's thickness, with a blur and for a sharp edge: with a blur of 0.8 the rule
/// of midpoints is then off by less than 1e-9.
const PLACES_PER_UNIT: [f64; 2] = [2.0, 8.0];
/// Below this point spread an edge is sharp.
const SHARP: f64 = 0.4;

impl AnalyticVolume {
    pub(super) fn new(spec: Spec) -> Self {
        let Spec { body, dims, sampling } = spec;
        let spacing = sampling.spacing();
        let [x, y, z] = sampling.spacing_mm;
        let (scalar, steps) = match sampling {
            Sampling { binary: true, .. } => (ScalarType::U8, None),
            Sampling { bits: 32, .. } => (ScalarType::F32, None),
            Sampling { bits, .. } => (
                if bits <= 8 { ScalarType::U8 } else { ScalarType::U16 },
                Some(f64::from(1_u32 << (bits - 1))),
            ),
        };
        // Air is at a quarter and the body at three quarters of the range, to leave room for noise.
        let rescale =
            steps.map_or(Rescale::IDENTITY, |steps| Rescale { slope: 1.0 / steps, intercept: -0.5 });
        let thickness = sampling.slab * spacing[2];
        let dense = PLACES_PER_UNIT[usize::from(sampling.psf < SHARP)];
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 2 x 10^6 x 8")]
        let places = ((thickness * dense).ceil() as u32).clamp(1, 256);
        let heights =
            (0..places).map(|i| thickness * ((f64::from(i) + 0.5) / f64::from(places) - 0.5)).collect();
        let info = VolumeInfo {
            dims,
            scalar,
            rescale,
            spacing_mm: sampling.spacing_mm,
            affine: Affine::from_spacing(sampling.spacing_mm),
            description: description(body.name(), dims, scalar),
            notes: Vec::new(),
        };
        Self { info, body, sampling, spacing, unit_mm: x.min(y).min(z), heights, pores: Vec::new() }
    }

    /// The same body with balls of air in its samples: their middles, as [`Self::place_of`] gives them, and radii in units.
    /// The body stays whole.
    pub(crate) fn with_pores(self, pores: Vec<(Vector, f64)>) -> Self {
        Self { pores, ..self }
    }

    /// The body.
    pub(crate) fn body(&self) -> &Body {
        &self.body
    }

    /// Size in voxels.
    pub fn dims(&self) -> Dims {
        self.info.dims
    }

    /// The place in units, from the volume's low corner, of a point in LPS mm.
    pub(crate) fn place_of(&self, world_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| world_mm[a] / self.unit_mm + 0.5 * self.spacing[a])
    }

    /// The true surface nearest to a point in LPS mm. Axes of the world are the volume's.
    pub fn surface_at(&self, world_mm: [f64; 3]) -> TrueSurface {
        self.body.surface(self.place_of(world_mm))
    }

    /// Density of a sample, before noise and rounding.
    fn density(&self, at: [u32; 3]) -> f64 {
        let [x, y, z] = std::array::from_fn(|a| (f64::from(at[a]) + 0.5) * self.spacing[a]);
        if self.sampling.binary {
            return f64::from(u8::from(self.distance_near([x, y, z], 0.0) <= 0.0));
        }
        let sum: f64 = self.heights.iter().map(|height| self.density_at([x, y, z + height])).sum();
        let places = self.heights.len() as f64;
        sum / places
    }

    #[inline]
    fn distance_near(&self, place: Vector, reach: f64) -> f64 {
        let from = |middle: Vector| -> Vector { minus(place, middle) };
        let pores =
            self.pores.iter().map(|(middle, radius)| radius - dot(from(*middle), from(*middle)).sqrt());
        pores.fold(self.body.distance_near(place, reach), f64::max)
    }

    #[inline]
    fn density_at(&self, place: Vector) -> f64 {
        if let Some(signal) = self.body.signal(place) {
            return signal;
        }
        let psf = self.sampling.psf;
        let distance = self.distance_near(place, FAR * psf);
        if psf > 0.0 { share_below(-distance / psf) } else { f64::from(u8::from(distance <= 0.0)) }
    }

    fn sample(&self, at: [u32; 3]) -> f64 {
        let density = self.density(at);
        if self.sampling.noise == 0.0 {
            return density;
        }
        density + self.sampling.noise * noise(at, self.sampling.seed)
    }

    /// The stored number of a density: the nearest one, within the range of the bits.
    fn stored(&self, density: f64) -> f64 {
        let Sampling { binary, bits, .. } = self.sampling;
        if binary {
            return density;
        }
        let range = f64::from(1_u32 << bits);
        (0.25 * range + 0.5 * range * density).round_ties_even().clamp(0.0, range - 1.0)
    }
}

impl VolumeSource for AnalyticVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    #[expect(clippy::cast_possible_truncation, reason = "made to fit the sample's type")]
    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let width = self.info.scalar.bytes();
        for (y, row) in rows.zip(out.chunks_mut((width * cols.len()).max(1))) {
            for (x, bytes) in cols.clone().zip(row.chunks_exact_mut(width)) {
                let density = self.sample([x, y, z]);
                match self.info.scalar {
                    ScalarType::F32 => bytes.copy_from_slice(bytemuck::bytes_of(&(density as f32))),
                    ScalarType::U8 => bytes.copy_from_slice(&[self.stored(density) as u8]),
                    _ => bytes.copy_from_slice(bytemuck::bytes_of(&(self.stored(density) as u16))),
                }
            }
        }
        Ok(())
    }
}
