//! Cells that the smooth gradient does not describe, in batches: edges, noise, thin walls.
//!
//! Two more normals are tried, each by the plane that fits the crossings best near a direction: the gradient of the
//! trilinear interpolation at their mean and, where that does not do, the direction from the inside corners to the
//! outside ones. The plane nearest to the crossings is taken, including the smooth one. Cells whose best plane still
//! covers an outside corner are left to [`super::single_fit`], as are cells that no plane separates. Finally all planes are
//! turned towards the gradient by one rule ([`super::fit`]).

use super::corner::{TOWARDS_GUESS, for_each_edge, on_edge};
use super::fit::{BATCH, Fitted, fit_plane};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::cell::CORNERS;
use crate::format::normal;

/// Cells of a batch that need more candidates, as a structure of arrays.
pub(super) struct Sharp {
    len: usize,
    slot: [usize; BATCH],
    mask: [u32; BATCH],
    depth: [[f32; BATCH]; CORNERS],
    crossing: [[f32; BATCH]; 12],
    mean: [[f32; BATCH]; 3],
    near: [f32; BATCH],
    two_values: [u32; BATCH],
    /// Direction out of the inside, as guessed.
    normal: [[f32; BATCH]; 3],
    tried: Planes,
    best: Planes,
}

struct Planes {
    code: [u16; BATCH],
    offset: [f32; BATCH],
    badness: [f32; BATCH],
    covers: [u32; BATCH],
}

/// Input for one cell, from its batch.
pub(super) struct SharpCell {
    pub(super) slot: usize,
    pub(super) mask: u32,
    pub(super) depth: [f32; CORNERS],
    pub(super) crossing: [f32; 12],
    pub(super) mean: [f32; 3],
    pub(super) near: f32,
    pub(super) code: u16,
    pub(super) fitted: Fitted,
    pub(super) two_values: u32,
}

impl Sharp {
    pub(super) const fn new() -> Self {
        const NONE: [f32; BATCH] = [0.0; BATCH];
        Self {
            len: 0,
            slot: [0; BATCH],
            mask: [0; BATCH],
            depth: [NONE; CORNERS],
            crossing: [NONE; 12],
            mean: [NONE; 3],
            near: NONE,
            two_values: [0; BATCH],
            normal: [NONE; 3],
            tried: Planes::NONE,
            best: Planes::NONE,
        }
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    pub(super) fn push(&mut self, cell: &SharpCell) {
        let at = self.len % BATCH;
        (self.slot[at], self.mask[at], self.near[at]) = (cell.slot, cell.mask, cell.near);
        for (all, depth) in self.depth.iter_mut().zip(cell.depth) {
            all[at] = depth;
        }
        for (all, t) in self.crossing.iter_mut().zip(cell.crossing) {
            all[at] = t;
        }
        for (all, mean) in self.mean.iter_mut().zip(cell.mean) {
            all[at] = mean;
        }
        self.two_values[at] = cell.two_values;
        self.best.set(at, cell.code, cell.fitted);
        self.len += 1;
    }

    pub(super) fn fit(&mut self) {
        dispatch(SharpKernel(self));
    }

    /// Slot, code and plane of each cell.
    pub(super) fn found(&self) -> impl Iterator<Item = (usize, u16, Fitted)> + '_ {
        (0..self.len.min(BATCH)).map(|i| (self.slot[i], self.best.code[i], self.best.at(i)))
    }
}

impl Planes {
    const NONE: Self =
        Self { code: [0; BATCH], offset: [0.0; BATCH], badness: [0.0; BATCH], covers: [0; BATCH] };

    #[inline(always)]
    fn at(&self, i: usize) -> Fitted {
        Fitted { offset: self.offset[i], badness: self.badness[i], covers: self.covers[i] }
    }

    #[inline(always)]
    fn set(&mut self, i: usize, code: u16, plane: Fitted) {
        (self.code[i], self.offset[i]) = (code, plane.offset);
        (self.badness[i], self.covers[i]) = (plane.badness, plane.covers);
    }
}

struct SharpKernel<'a>(&'a mut Sharp);

impl Kernel for SharpKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let s = self.0;
        // Whole groups of 8 become vectors; slots past the end hold old cells and are not used.
        let len = s.len.next_multiple_of(8).min(BATCH);
        for i in 0..len {
            let depth: [f32; CORNERS] = std::array::from_fn(|c| s.depth[c][i]);
            let g = outwards(depth, [s.mean[0][i], s.mean[1][i], s.mean[2][i]]);
            (s.normal[0][i], s.normal[1][i], s.normal[2][i]) = (g[0], g[1], g[2]);
        }
        try_near(s, len, true);
        for i in 0..len {
            let g = across(s.mask[i]);
            (s.normal[0][i], s.normal[1][i], s.normal[2][i]) = (g[0], g[1], g[2]);
        }
        try_near(s, len, false);
    }
}

/// Tries the planes near the directions in `normal`: for all cells, or for those without a good plane.
#[inline(always)]
fn try_near(s: &mut Sharp, len: usize, all: bool) {
    #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
    let held = TOWARDS_GUESS as f32;
    for i in 0..len {
        let guess = [s.normal[0][i], s.normal[1][i], s.normal[2][i]];
        let crossing: [f32; 12] = std::array::from_fn(|e| s.crossing[e][i]);
        let mean = [s.mean[0][i], s.mean[1][i], s.mean[2][i]];
        s.tried.code[i] = normal::encode(near(guess, crossing, mean, held));
    }
    for i in 0..len {
        let depth: [f32; CORNERS] = std::array::from_fn(|c| s.depth[c][i]);
        let crossing: [f32; 12] = std::array::from_fn(|e| s.crossing[e][i]);
        let mean = [s.mean[0][i], s.mean[1][i], s.mean[2][i]];
        let plane = fit_plane(s.tried.code[i], depth, crossing, mean);
        s.tried.offset[i] = plane.offset;
        s.tried.badness[i] = plane.badness;
        s.tried.covers[i] = plane.covers | s.two_values[i];
    }
    let (tried, best) = (&s.tried, &mut s.best);
    for i in 0..len {
        let wanted = all | (best.badness[i] > s.near[i] * s.near[i]);
        let better = wanted & (tried.badness[i] < best.badness[i]);
        best.code[i] = if better { tried.code[i] } else { best.code[i] };
        best.offset[i] = choose(better, tried.offset[i], best.offset[i]);
        best.badness[i] = choose(better, tried.badness[i], best.badness[i]);
        best.covers[i] = if better { tried.covers[i] } else { best.covers[i] };
    }
}

/// Direction against the gradient of the trilinear interpolation at a point, in voxels from the middle of the cell.
#[inline(always)]
fn outwards(depth: [f32; CORNERS], [x, y, z]: [f32; 3]) -> [f32; 3] {
    let d = depth;
    let part = |low: f32, high: f32, at: f32| low * (0.5 - at) + high * (0.5 + at);
    // Differences along an axis on its four edges, interpolated along the other two.
    let of =
        |e: [f32; 4], first: f32, second: f32| part(part(e[0], e[1], first), part(e[2], e[3], first), second);
    [
        of([d[0] - d[1], d[2] - d[3], d[4] - d[5], d[6] - d[7]], y, z),
        of([d[0] - d[2], d[1] - d[3], d[4] - d[6], d[5] - d[7]], x, z),
        of([d[0] - d[4], d[1] - d[5], d[2] - d[6], d[3] - d[7]], x, y),
    ]
}

/// Direction from the middle of the inside corners to the middle of the outside ones.
#[inline(always)]
fn across(mask: u32) -> [f32; 3] {
    let (mut inside, mut sum) = (0.0_f32, [0.0_f32; 3]);
    for c in 0..CORNERS {
        let is_in = mask >> c & 1 == 1;
        inside += choose(is_in, 1.0, 0.0);
        for (a, sum) in sum.iter_mut().enumerate() {
            *sum += choose(is_in, if c >> a & 1 == 1 { 1.0 } else { -1.0 }, 0.0);
        }
    }
    // The outside corners sum to the negative.
    let weight = -1.0 / inside - 1.0 / (8.0 - inside);
    [sum[0] * weight, sum[1] * weight, sum[2] * weight]
}

/// Normal of the plane that fits the crossings best, near a guess of any length: least squares over the guess of length 1
/// plus an orthogonal term, which `held` keeps small.
#[inline(always)]
pub(super) fn near(guess: [f32; 3], crossing: [f32; 12], mean: [f32; 3], held: f32) -> [f32; 3] {
    let [g, e1, e2] = directions(guess);
    // Sums of products of the coordinates along the two directions, and of these with the one along the guess.
    let (mut s11, mut s12, mut s22, mut r1, mut r2) = (held, 0.0, held, 0.0, 0.0);
    for_each_edge!(edge => {
        let at = on_edge(edge, crossing[edge], mean);
        let along = |d: [f32; 3]| choose(crossing[edge] >= 0.0, at[0] * d[0] + at[1] * d[1] + at[2] * d[2], 0.0);
        let (along, u, v) = (along(g), along(e1), along(e2));
        s11 += u * u;
        s12 += u * v;
        s22 += v * v;
        r1 += u * along;
        r2 += v * along;
    });
    let determinant = s11 * s22 - s12 * s12;
    let u = (r2 * s12 - r1 * s22) / determinant;
    let v = (r1 * s12 - r2 * s11) / determinant;
    [g[0] + (u * e1[0] + v * e2[0]), g[1] + (u * e1[1] + v * e2[1]), g[2] + (u * e1[2] + v * e2[2])]
}

/// Selects one of two numbers without a branch.
#[inline(always)]
fn choose(first: bool, one: f32, other: f32) -> f32 {
    let mask = 0_u32.wrapping_sub(u32::from(first));
    f32::from_bits(one.to_bits() & mask | other.to_bits() & !mask)
}

/// A guess scaled to length 1, and two orthogonal directions (Duff and others 2017); z for a guess without direction.
#[inline(always)]
pub(super) fn directions(guess: [f32; 3]) -> [[f32; 3]; 3] {
    // Scaled first, so that squares stay finite.
    let (x, y, z) = (guess[0].abs(), guess[1].abs(), guess[2].abs());
    let most = if x > y { x } else { y };
    let most = if most > z { most } else { z };
    let usable = (most > 0.0) & (most < f32::INFINITY);
    let [x, y, z] = [guess[0] / most, guess[1] / most, guess[2] / most];
    let length = (x * x + y * y + z * z).sqrt();
    let (x, y) = (choose(usable, x / length, 0.0), choose(usable, y / length, 0.0));
    let z = choose(usable, z / length, 1.0);
    let sign = 1.0_f32.copysign(z);
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    [[x, y, z], [1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]]
}
