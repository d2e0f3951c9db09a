//! Planes of cells in batches, without branches so that the loops over a batch vectorise.

use super::anisotropy::{Anisotropy, Fit};
use super::corner::{EDGES, SAME_SURFACE, TOLERANCE, for_each_edge, on_edge, pull, signed_depth};
use super::jet::{CellSamples, Jet};
use super::sharp_features::{Sharp, SharpCell, directions, near};
use super::single_fit;
use crate::builder::item::eighth;
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::cell::{CORNERS, SEPARABLE};
use crate::format::normal;

/// Curvature per voxel from which a cell lies at an edge: normals of neighbours are some 30 degrees apart.
const EDGE_BEND: f32 = 0.55;

/// Most cells of a batch.
pub(super) const BATCH: usize = 128;

/// Cells that wait to be fitted, as a structure of arrays.
pub(super) struct Batch {
    len: usize,
    cells: [[u32; 3]; BATCH],
    /// Corners inside, as bits.
    mask: [u32; BATCH],
    /// Depths inside the range at the corners.
    depth: [[f32; BATCH]; CORNERS],
    /// Direction of rising depths: first at the middle of the cell, then at the mean of its crossings; NaN for cells at
    /// the border.
    gradient: [[f32; BATCH]; 3],
    second: [[f32; BATCH]; 6],
    /// Crossing of each edge, from its first corner; NaN for edges that are not crossed.
    crossing: [[f32; BATCH]; 12],
    /// Mean of the crossings, in voxels from the middle of the cell.
    mean: [[f32; BATCH]; 3],
    /// Largest distance of the smooth plane from the crossings.
    near: [f32; BATCH],
    /// 1 where two values alone place the surface: one inside, one outside.
    two_values: [u32; BATCH],
    code: [u16; BATCH],
    offset: [f32; BATCH],
    badness: [f32; BATCH],
    covers: [u32; BATCH],
    fitted: [u32; BATCH],
    strays: [u32; BATCH],
    steepness: [u16; BATCH],
    is_label: bool,
    sharp: Sharp,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Plane,
    /// No plane describes the cell.
    Corners,
    /// The cell lies at the border, or two values alone place the surface.
    OneByOne,
}

impl Batch {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self {
            len: 0,
            cells: [[0; 3]; BATCH],
            mask: [0; BATCH],
            depth: [[0.0; BATCH]; CORNERS],
            gradient: [[0.0; BATCH]; 3],
            second: [[0.0; BATCH]; 6],
            crossing: [[0.0; BATCH]; 12],
            mean: [[0.0; BATCH]; 3],
            near: [0.0; BATCH],
            two_values: [0; BATCH],
            code: [0; BATCH],
            offset: [0.0; BATCH],
            badness: [0.0; BATCH],
            covers: [0; BATCH],
            fitted: [0; BATCH],
            strays: [0; BATCH],
            steepness: [0; BATCH],
            is_label: false,
            sharp: Sharp::new(),
        })
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends the cells of a row, the first possible one at `corner`; `samples` come from `SkinSlice::corner_samples`.
    /// Returns the slot of the first; the depths of the inner cells are put later.
    pub(super) fn push_row(&mut self, corner: [u32; 3], row: u32, samples: [u64; 4], inner: u32) -> usize {
        let first = self.len;
        let mut left = row;
        while left != 0 {
            let bit = left.trailing_zeros();
            left &= left - 1;
            let slot = self.len % BATCH;
            self.cells[slot] = [corner[0] + bit, corner[1], corner[2]];
            let pair = |edge: usize| (samples[edge] >> bit & 3) as u32;
            self.mask[slot] = pair(0) | pair(1) << 2 | pair(2) << 4 | pair(3) << 6;
            if inner >> bit & 1 == 0 {
                self.put(slot, &CellSamples { corners: [0.0; CORNERS], jet: Jet::UNKNOWN });
            }
            self.len += 1;
        }
        first
    }

    #[inline(always)]
    pub(super) fn put(&mut self, slot: usize, seen: &CellSamples) {
        let slot = slot % BATCH;
        for (all, depth) in self.depth.iter_mut().zip(seen.corners) {
            all[slot] = depth;
        }
        for (all, gradient) in self.gradient.iter_mut().zip(seen.jet.gradient) {
            all[slot] = gradient;
        }
        for (all, second) in self.second.iter_mut().zip(seen.jet.second) {
            all[slot] = second;
        }
    }

    pub(super) fn cell(&self, at: usize) -> [u32; 3] {
        self.cells[at]
    }

    pub(super) fn mask(&self, at: usize) -> u8 {
        self.mask[at].to_le_bytes()[0]
    }

    /// Values of a cell of a fitted batch: the depths at its corners, the gradient at the mean of its crossings and the
    /// largest distance of the smooth plane from them; `None` for a cell at the border.
    pub(super) fn inner(&self, at: usize) -> Option<([f32; CORNERS], [f32; 3], f32)> {
        let gradient: [f32; 3] = std::array::from_fn(|a| self.gradient[a][at]);
        let depth = || std::array::from_fn(|c| self.depth[c][at]);
        (!gradient[0].is_nan()).then(|| (depth(), gradient, self.near[at]))
    }

    /// Finds the steepness of all cells of a fitted batch.
    pub(super) fn find_steepness(&mut self, spacing_mm: [f32; 3]) {
        dispatch(SteepnessKernel { batch: self, spacing_mm });
    }

    /// Steepness of the cells once it is found, as codes of [`eighth`]: change of depths per mm across the surface, by
    /// trilinear interpolation at the mean of the crossings; 0 at the border and at edges, which blur rounds.
    pub(super) fn steepness(&mut self) -> &mut [u16] {
        &mut self.steepness[..self.len.min(BATCH)]
    }

    /// The result for a cell of a fitted batch.
    pub(super) fn outcome(&self, at: usize) -> Outcome {
        let is_inner = !self.gradient[0][at].is_nan();
        if self.fitted[at] != 0 {
            return if self.strays[at] != 0 { Outcome::Corners } else { Outcome::Plane };
        }
        let may_be_label = self.is_label || self.has_two_values(at);
        if is_inner && !may_be_label { Outcome::Corners } else { Outcome::OneByOne }
    }

    /// Normal code and offset of a fitted cell.
    #[expect(clippy::cast_possible_truncation, reason = "-127..=127")]
    pub(super) fn plane(&self, at: usize) -> (u16, i8) {
        (self.code[at], self.offset[at] as i8)
    }

    /// Fits all cells of the batch; [`Batch::outcome`] gives the results. With a single value inside, only the smooth
    /// gradient is tried.
    pub(super) fn fit(&mut self, is_label: bool, stretch: &Anisotropy) {
        dispatch(FitKernel(self));
        self.is_label = is_label;
        if is_label {
            return;
        }
        self.sharp.clear();
        for i in 0..self.len.min(BATCH) {
            let is_inner = !self.gradient[0][i].is_nan();
            let two_values = self.covers[i] != 0 && self.has_two_values(i);
            if self.fitted[i] != 0 || !is_inner || two_values || !SEPARABLE[usize::from(self.mask(i))] {
                continue;
            }
            self.sharp.push(&SharpCell {
                slot: i,
                mask: self.mask[i],
                depth: std::array::from_fn(|c| self.depth[c][i]),
                crossing: std::array::from_fn(|e| self.crossing[e][i]),
                mean: std::array::from_fn(|a| self.mean[a][i]),
                near: self.near[i],
                code: self.code[i],
                fitted: Fitted { offset: self.offset[i], badness: self.badness[i], covers: self.covers[i] },
                two_values: self.two_values[i],
            });
        }
        self.sharp.fit();
        for (slot, code, plane) in self.sharp.found() {
            (self.code[slot], self.offset[slot]) = (code, plane.offset);
            self.fitted[slot] = u32::from(plane.covers == 0);
        }
        // In long cells the gradient would turn planes off the surface of thin bone.
        if stretch.is_long {
            dispatch(StrayKernel { batch: self, stretch });
        } else {
            dispatch(GradientKernel(self));
        }
    }

    #[inline(always)]
    fn jet(&self, i: usize) -> Jet {
        Jet {
            gradient: [self.gradient[0][i], self.gradient[1][i], self.gradient[2][i]],
            second: std::array::from_fn(|k| self.second[k][i]),
        }
    }

    /// True if all inside corners have one depth, and all outside corners have one depth.
    fn has_two_values(&self, at: usize) -> bool {
        single_fit::has_two_values(self.mask(at), &std::array::from_fn(|c| self.depth[c][at]))
    }
}

struct FitKernel<'a>(&'a mut Batch);

impl Kernel for FitKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let b = self.0;
        // Whole groups of 8 become vectors; slots past the end hold old cells and are not used.
        let len = b.len.next_multiple_of(8).min(BATCH);
        find_crossings(b, len);
        for i in 0..len {
            let gradient = b.jet(i).at([b.mean[0][i], b.mean[1][i], b.mean[2][i]]);
            (b.gradient[0][i], b.gradient[1][i], b.gradient[2][i]) = (gradient[0], gradient[1], gradient[2]);
        }
        for i in 0..len {
            let jet = b.jet(i);
            b.near[i] = jet.near_crossings(jet.gradient);
        }
        for i in 0..len {
            b.code[i] = normal::encode([-b.gradient[0][i], -b.gradient[1][i], -b.gradient[2][i]]);
        }
        for i in 0..len {
            let depth: [f32; CORNERS] = std::array::from_fn(|c| b.depth[c][i]);
            let crossing: [f32; 12] = std::array::from_fn(|e| b.crossing[e][i]);
            let mean = [b.mean[0][i], b.mean[1][i], b.mean[2][i]];
            let fitted = fit_plane(b.code[i], depth, crossing, mean);
            let covers = fitted.covers | b.two_values[i];
            let agrees = (fitted.badness <= b.near[i] * b.near[i]) & (covers == 0);
            (b.offset[i], b.badness[i], b.covers[i]) = (fitted.offset, fitted.badness, covers);
            b.fitted[i] = u32::from(agrees & !b.gradient[0][i].is_nan());
        }
    }
}

/// Turns the fitted planes towards the smooth gradient: one estimate for all cells.
struct GradientKernel<'a>(&'a mut Batch);

impl Kernel for GradientKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let b = self.0;
        let len = b.len.next_multiple_of(8).min(BATCH);
        let (mut same, mut codes, mut offsets) = ([0_u32; BATCH], [0_u16; BATCH], [0.0; BATCH]);
        for i in 0..len {
            let gradient = [-b.gradient[0][i], -b.gradient[1][i], -b.gradient[2][i]];
            let [unit, ..] = directions(gradient);
            same[i] = u32::from(is_same_surface(gradient, unit, b.code[i])) & b.fitted[i];
            let crossing: [f32; 12] = std::array::from_fn(|e| b.crossing[e][i]);
            let mean = [b.mean[0][i], b.mean[1][i], b.mean[2][i]];
            let mut most = 0.0_f32;
            for_each_edge!(edge => {
                let at = on_edge(edge, crossing[edge], mean);
                let off = (at[0] * unit[0] + at[1] * unit[1] + at[2] * unit[2]).abs();
                // NaN for edges that are not crossed.
                most = if off > most { off } else { most };
            });
            codes[i] = normal::encode(near(unit, crossing, mean, pull(most)));
        }
        for i in 0..len {
            let depth: [f32; CORNERS] = std::array::from_fn(|c| b.depth[c][i]);
            let crossing: [f32; 12] = std::array::from_fn(|e| b.crossing[e][i]);
            let mean = [b.mean[0][i], b.mean[1][i], b.mean[2][i]];
            let fitted = fit_plane(codes[i], depth, crossing, mean);
            offsets[i] = fitted.offset;
            same[i] &= 1 - (fitted.covers | b.two_values[i]);
        }
        for i in 0..len {
            b.code[i] = if same[i] != 0 { codes[i] } else { b.code[i] };
            b.offset[i] = if same[i] != 0 { offsets[i] } else { b.offset[i] };
        }
    }
}

/// True if a unit gradient is within 60 degrees of a plane's normal.
#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "small integers")]
fn is_same_surface(gradient: [f32; 3], unit: [f32; 3], code: u16) -> bool {
    let n = normal::decode_l1(code).map(|c| c as f32);
    let along = unit[0] * n[0] + unit[1] * n[1] + unit[2] * n[2];
    let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    let size = gradient[0].abs() + gradient[1].abs() + gradient[2].abs();
    (along > 0.0) & (along * along >= SAME_SURFACE * square) & (size > 0.0) & (size < f32::INFINITY)
}

struct SteepnessKernel<'a> {
    batch: &'a mut Batch,
    spacing_mm: [f32; 3],
}

impl Kernel for SteepnessKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let (b, per_mm) = (self.batch, self.spacing_mm.map(|mm| 1.0 / mm));
        for i in 0..b.len.next_multiple_of(8).min(BATCH) {
            let gradient = [b.gradient[0][i], b.gradient[1][i], b.gradient[2][i]];
            let depth: [f32; CORNERS] = std::array::from_fn(|c| b.depth[c][i]);
            let (across, square) = b.jet(i).bend(gradient);
            let mean = [b.mean[0][i], b.mean[1][i], b.mean[2][i]];
            let rise =
                [rise(depth, mean, [0, 1, 2]), rise(depth, mean, [1, 0, 2]), rise(depth, mean, [2, 0, 1])];
            let [x, y, z] = [gradient[0] * per_mm[0], gradient[1] * per_mm[1], gradient[2] * per_mm[2]];
            let length = (x * x + y * y + z * z).sqrt();
            let along = rise[0] * per_mm[0] * x + rise[1] * per_mm[1] * y + rise[2] * per_mm[2] * z;
            let steepness = (along / length).abs();
            // False for NaN.
            let is_smooth = (across <= EDGE_BEND * EDGE_BEND * square) & (steepness < f32::INFINITY);
            b.steepness[i] = if is_smooth { eighth(steepness) as u16 } else { 0 };
        }
    }
}

/// Change along an axis of what is interpolated between eight corners, at a place from the middle; the other two axes are
/// named, too.
#[inline(always)]
fn rise(depth: [f32; CORNERS], place: [f32; 3], [axis, u, v]: [usize; 3]) -> f32 {
    let (at_u, at_v) = (part(place[u]), part(place[v]));
    let edge = |corner: usize| depth[corner | 1 << axis] - depth[corner];
    let [low, high] = [
        edge(0) + at_u * (edge(1 << u) - edge(0)),
        edge(1 << v) + at_u * (edge(1 << u | 1 << v) - edge(1 << v)),
    ];
    low + at_v * (high - low)
}

/// Part of the way through a cell, 0 to 1, at a place from its middle.
#[inline(always)]
fn part(place: f32) -> f32 {
    let part = place + 0.5;
    let part = if part < 0.0 { 0.0 } else { part };
    if part > 1.0 { 1.0 } else { part }
}

struct StrayKernel<'a> {
    batch: &'a mut Batch,
    stretch: &'a Anisotropy,
}

impl Kernel for StrayKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let (b, stretch) = (self.batch, *self.stretch);
        let len = b.len.next_multiple_of(8).min(BATCH);
        for i in 0..len {
            let fit = Fit {
                code: b.code[i],
                offset: b.offset[i],
                mask: b.mask[i],
                depth: std::array::from_fn(|c| b.depth[c][i]),
                crossing: std::array::from_fn(|e| b.crossing[e][i]),
                mean: [b.mean[0][i], b.mean[1][i], b.mean[2][i]],
            };
            b.strays[i] = u32::from(fit.strays(&stretch));
        }
    }
}

/// Gives depths the signs of their sides, and finds the crossings of the edges, their mean, and the cells of two values.
#[inline(always)]
fn find_crossings(b: &mut Batch, len: usize) {
    for (c, depths) in b.depth.iter_mut().enumerate() {
        for (depth, mask) in depths[..len].iter_mut().zip(&b.mask[..len]) {
            *depth = signed_depth(*depth, mask >> c & 1 == 1);
        }
    }
    let [x, y, z] = &mut b.mean;
    for i in 0..len {
        let depth: [f32; CORNERS] = std::array::from_fn(|c| b.depth[c][i]);
        let (mut sum, mut count) = ([0.0_f32; 3], 0.0_f32);
        for_each_edge!(edge => {
            let (p, q) = EDGES[edge];
            let (d, e) = (depth[p], depth[q]);
            let t = d / (d - e);
            // All bits set where the signs differ. Conditions would become masked stores, which some machines split.
            let crosses = 0_u32.wrapping_sub((d.to_bits() ^ e.to_bits()) >> 31);
            let or_zero = |v: f32| f32::from_bits(v.to_bits() & crosses);
            let at = on_edge(edge, t, [0.0; 3]);
            sum = [sum[0] + or_zero(at[0]), sum[1] + or_zero(at[1]), sum[2] + or_zero(at[2])];
            count += or_zero(1.0);
            b.crossing[edge][i] = f32::from_bits(t.to_bits() | !crosses);
        });
        (x[i], y[i], z[i]) = (sum[0] / count, sum[1] / count, sum[2] / count);
    }
    for i in 0..len {
        let depth: [f32; CORNERS] = std::array::from_fn(|c| b.depth[c][i]);
        let (mut most, mut least) = (-f32::MAX, f32::MAX);
        for d in depth {
            most = if d > most { d } else { most };
            least = if d < least { d } else { least };
        }
        let others = depth.into_iter().fold(0, |others, d| others | u32::from((d != most) & (d != least)));
        b.two_values[i] = 1 - others;
    }
}

/// A plane that was fitted to a cell.
#[derive(Clone, Copy)]
pub(super) struct Fitted {
    pub(super) offset: f32,
    /// Greatest distance of a crossing, or of a corner on the wrong side; squared.
    pub(super) badness: f32,
    /// Not zero if the plane covers an outside corner too far; in a batch also if there are two values only, which do not
    /// place the surface between them.
    pub(super) covers: u32,
}

/// The plane with this normal through the mean of the crossings, shifted so that every inside corner lies behind it;
/// depths have the signs of their sides.
#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "small integers")]
pub(super) fn fit_plane(code: u16, depth: [f32; CORNERS], crossing: [f32; 12], mean: [f32; 3]) -> Fitted {
    let n = normal::decode_l1(code).map(|c| c as f32);

    // Values of n . u.
    let corner: [f32; CORNERS] = std::array::from_fn(|c| {
        let part = |a: usize| if c >> a & 1 == 1 { n[a] } else { -n[a] };
        part(0) + part(1) + part(2)
    });
    let mean = 2.0 * (n[0] * mean[0] + n[1] * mean[1] + n[2] * mean[2]);
    let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    let mut worst = 0.0_f32;
    for (t, (p, q)) in crossing.into_iter().zip(EDGES) {
        let off = corner[p] + t * (corner[q] - corner[p]) - mean;
        worst = if off * off > worst { off * off } else { worst };
    }
    let (mut highest_in, mut lowest_out) = (-f32::MAX, f32::MAX);
    for (d, v) in depth.into_iter().zip(corner) {
        let (ahead, behind) = (if d > 0.0 { v } else { -f32::MAX }, if d > 0.0 { f32::MAX } else { v });
        highest_in = if ahead > highest_in { ahead } else { highest_in };
        lowest_out = if behind < lowest_out { behind } else { lowest_out };
    }
    let positive = |v: f32| if v > 0.0 { v } else { 0.0 };
    let (in_front, behind) = (positive(highest_in - mean), positive(mean - lowest_out));
    worst = if in_front * in_front > worst { in_front * in_front } else { worst };
    worst = if behind * behind > worst { behind * behind } else { worst };
    let rounded = (mean + 0.5).floor();
    let offset = if rounded > highest_in { rounded } else { highest_in };
    let covered = positive(offset - lowest_out);
    let covers = covered * covered > 4.0 * TOLERANCE * TOLERANCE * square;
    Fitted { offset, badness: worst / (4.0 * square), covers: u32::from(covers) }
}
