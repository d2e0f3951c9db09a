//! The skin of every label, walls between neighbours included.
//!
//! ```text
//!   slice z+2   --read-->  ring of 5 slices
//!   slice z     skin: a label with a face neighbour that has another one, or none
//!               normal: gradient of the voxel's own label on z-2 ..= z+2; label
//! ```
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

use super::LabelSolid;
use super::ring::{self, CHUNK, LANES, Ring, bits_of};
use crate::builder::estimator::{Estimate, Taps};
use crate::builder::gradient::{Codes, Gradients, REACH, SLICE_VOXELS, outward};
use crate::builder::range::Ordered;
use crate::builder::simd::{Isa, Kernel, dispatch};
use crate::builder::slices::Reach;
use crate::builder::solid::{OccupancyRows, ScanSummary, SkinSlice, SolidWorker, Tile, VoxelBox};
use crate::format::Channel;
use crate::volume::{SourceError, VolumeInfo};

/// Columns, rows and slices before a voxel that its normal looks at.
const HALO: usize = REACH as usize;
const RING: usize = 2 * HALO + 1;
const AROUND: Reach = Reach { low: REACH, high: REACH };

/// Bytes that one worker holds.
pub(super) fn worker_bytes(info: &VolumeInfo, tile: &Tile) -> u64 {
    ring::bytes(info, AROUND, tile) + SLICE_VOXELS as u64 * 21
}

/// One thread's ring, and the voxels described last.
pub(super) struct SkinWorker<'a, T> {
    ring: Ring<'a, T>,
    normals: bool,
    gradients: Box<Gradients>,
    codes: Box<Codes>,
    /// Of the skin voxels that are described, the places of the first of the samples around them.
    places: Vec<u32>,
    labels: Vec<u8>,
}

impl<'a, T: Ordered> SkinWorker<'a, T> {
    pub(super) fn new(solid: &'a LabelSolid<'a>, to_number: fn(T) -> f64, tile: &Tile) -> Self {
        Self {
            ring: Ring::new(solid, to_number, AROUND, tile),
            normals: tile.channels.contains(Channel::Normal),
            gradients: Gradients::new(&solid.rule),
            codes: Codes::new(solid.bits),
            places: Vec::with_capacity(SLICE_VOXELS),
            labels: Vec::with_capacity(2 * SLICE_VOXELS),
        }
    }
}

/// Where a row's labels have a face neighbour with another one, or none: the rows before and behind along z and y,
/// and the row itself with a sample more at either end.
struct WallKernel<'a> {
    around: [&'a [u16]; 4],
    row: &'a [u16],
    out: &'a mut [u64],
}

impl Kernel for WallKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, isa: impl Isa) {
        let [down, up, north, south] = self.around.map(|row| row.as_chunks::<CHUNK>().0);
        let [west, here, east] =
            std::array::from_fn(|i| self.row.get(i..).unwrap_or_default().as_chunks::<CHUNK>().0);
        for (i, out) in self.out.iter_mut().enumerate() {
            *out = 0;
            for half in 0..2 {
                let at = 2 * i + half;
                let (Some(here), Some(west), Some(east)) = (here.get(at), west.get(at), east.get(at)) else {
                    continue;
                };
                let mut differ = [0_u16; CHUNK];
                for (k, differ) in differ.iter_mut().enumerate() {
                    *differ = (here[k] ^ west[k]) | (here[k] ^ east[k]);
                }
                for around in [down, up, north, south] {
                    let Some(around) = around.get(at) else { continue };
                    for (differ, (a, b)) in differ.iter_mut().zip(here.iter().zip(around)) {
                        *differ |= a ^ b;
                    }
                }
                for (differ, here) in differ.iter_mut().zip(here) {
                    *differ = if *here == 0 { 0 } else { *differ };
                }
                *out |= u64::from(bits_of(isa, &differ)) << (32 * half);
            }
        }
    }
}

/// Weights of the samples around a voxel, row by row.
pub(super) struct Weights {
    /// Of a row's samples in the sums along x, y and z, by slice and row.
    rows: [[[i16; 3]; RING]; RING],
    /// Of the sums' lanes: the derivative along x, and the smoothing along it.
    along: [[i16; LANES]; 2],
}

impl Weights {
    pub(super) fn new(Taps { smooth, derive }: Taps) -> Self {
        let even = |axis: usize, i: usize| i16::from(smooth[axis][i.abs_diff(HALO)]);
        let odd = |i: usize| match i {
            0 => -i16::from(derive[1]),
            1 => -i16::from(derive[0]),
            3 => i16::from(derive[0]),
            4 => i16::from(derive[1]),
            _ => 0,
        };
        let row = |j: usize, k: usize| [even(1, j) * even(2, k), odd(j) * even(2, k), even(1, j) * odd(k)];
        let lane = |i: usize, of: &dyn Fn(usize) -> i16| if i < RING { of(i) } else { 0 };
        Self {
            rows: std::array::from_fn(|k| std::array::from_fn(|j| row(j, k))),
            along: [
                std::array::from_fn(|i| lane(i, &odd)),
                std::array::from_fn(|i| lane(i, &|i| even(0, i))),
            ],
        }
    }

    /// Gradient of a label in the 5 x 5 x 5 samples of which `at` is the first, times the weights' sum.
    #[inline(always)]
    fn gradient(&self, slices: &[&[u16]; RING], at: usize, stride: usize, label: u16) -> [i32; 3] {
        let mut sums = [[0_i16; LANES]; 3];
        for (slice, weights) in slices.iter().zip(&self.rows) {
            let rows = slice.get(at..).unwrap_or_default().chunks(stride);
            for (row, weights) in rows.zip(weights) {
                let Some(row) = row.first_chunk::<LANES>() else { continue };
                let inside = row.map(|found| i16::from(found == label).wrapping_neg());
                for (sums, weight) in sums.iter_mut().zip(weights) {
                    for (sum, inside) in sums.iter_mut().zip(inside) {
                        *sum = sum.wrapping_add(weight & inside);
                    }
                }
            }
        }
        let [odd, even] = &self.along;
        let along = |sums: [i16; LANES], taps: &[i16; LANES]| {
            let products =
                sums.iter().zip(taps).map(|(sum, tap)| i32::from(*sum).wrapping_mul((*tap).into()));
            products.fold(0_i32, i32::wrapping_add)
        };
        [along(sums[0], odd), along(sums[1], even), along(sums[2], even)]
    }
}

/// The outward vectors of the skin voxels of one brick in one slice.
struct NormalKernel<'a> {
    slices: [&'a [u16]; RING],
    stride: usize,
    /// Places of the voxels' first samples in the slices.
    places: &'a [u32],
    estimate: &'a Estimate,
    weights: &'a [Weights],
    out: &'a mut Gradients,
}

impl Kernel for NormalKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Isa) {
        let Self { slices, stride, places, estimate, weights, out } = self;
        let here = slices[HALO];
        for (slot, at) in places.iter().enumerate() {
            let at = *at as usize;
            let middle = at + HALO * stride + HALO;
            let label = here[middle];
            let others = [
                here[middle - 1],
                here[middle + 1],
                here[middle - stride],
                here[middle + stride],
                slices[HALO - 1][middle],
                slices[HALO + 1][middle],
            ];
            let open = others.iter().enumerate().fold(0, |open, (f, l)| open | u8::from(*l != label) << f);
            let mut sum = [0; 3];
            for weights in weights {
                let more = weights.gradient(&slices, at, stride, label);
                sum = std::array::from_fn(|a| sum[a] + more[a]);
            }
            #[expect(clippy::cast_precision_loss, reason = "below 2^24")]
            let inward: [f32; 3] = std::array::from_fn(|a| sum[a] as f32 * estimate.per_spacing[a]);
            out.set(slot, outward(estimate, inward.map(|c| -c), open));
        }
    }
}

impl<T: Ordered> SolidWorker for SkinWorker<'_, T> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.ring.column = column.clone();
        Ok(())
    }

    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        self.ring.load(wanted.z())?;
        self.ring.occupancy(wanted);
        Ok(())
    }

    fn skin(&mut self, wanted: &mut OccupancyRows<'_>) -> bool {
        let (ring, stride) = (&self.ring, self.ring.stride);
        let [below, here, above] = ring.slices(i64::from(wanted.z()) - 1);
        for y in wanted.y() {
            let row = ring.at(ring.column.x.start, y);
            let part = |from: usize| from..from + stride - HALO;
            let around =
                [&below[part(row)], &above[part(row)], &here[part(row - stride)], &here[part(row + stride)]];
            let out = wanted.row_mut(y);
            dispatch(WallKernel { around, row: &here[row - 1..row + stride - HALO], out });
        }
        true
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let (ring, [x0, y0, z]) = (&self.ring, skin.corner());
        let (stride, slices) = (ring.stride, ring.slices(i64::from(z) - HALO as i64));
        let middle = HALO * stride + HALO;
        let corner = (ring.at(x0, y0) - middle) as u32;
        self.places.clear();
        self.places.extend(skin.voxels().map(|[x, y, _]| corner + (y - y0) * stride as u32 + (x - x0)));
        self.labels.clear();
        let labels = self.places.iter().map(|at| slices[HALO][*at as usize + middle]);
        self.labels.extend(labels.flat_map(u16::to_le_bytes));
        if self.normals {
            let (places, out) = (&self.places[..], &mut *self.gradients);
            let LabelSolid { estimate, weights, .. } = ring.solid;
            dispatch(NormalKernel { slices, stride, places, estimate, weights, out });
            self.codes.encode(&self.gradients, skin.len());
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        let count = self.labels.len() / 2;
        match channel {
            Channel::Normal => self.codes.codes(count),
            Channel::Fine => self.codes.fine(count),
            Channel::Label => &self.labels,
            _ => &[],
        }
    }

    fn found(&self) -> ScanSummary {
        self.ring.found()
    }
}
