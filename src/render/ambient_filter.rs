//! A patch of a picture with its surroundings: openness as a mean over similar pixels, and differences between
//! neighbours.
//!
//! One ray a pixel tells little of a point's openness; the 64 rays of eight by eight pixels, which go out in as many
//! directions, tell much, if they see one surface. So the mean of four by four pixels is taken, and then the mean of
//! four such means, over those of similar depth and normal: of all 64, where these are one surface.
//!
//! Neighbours differ where one hits and the other does not, where depth jumps, and at creases. A jump is a step in
//! depth of more than a voxel that differs from the slope of the surface, that is, from the steps before and behind it.
//!
//! A patch also holds four pixels more on every side, which come from other tiles and bands.

use super::tile::TILE;
use crate::cpu::{Form, Kernel, Lanes};

/// Columns of a patch, and pixels that it holds on every side of its own.
pub(crate) const WIDE: usize = 256;
const AROUND: usize = 4;
const STRIDE: usize = WIDE + 2 * AROUND;
const HIGH: usize = TILE + 2 * AROUND;

/// Offsets along a line for a mean, first of pixels, then of means: together 3 pixels before, the pixel, and 4 behind.
const PIXELS: [isize; 4] = [-1, 0, 1, 2];
const MEANS: [isize; 2] = [-2, 2];
/// Weight of a pixel's own mean for each of the four that belongs to another surface.
const OWN: f32 = 0.5;

/// Differences in depth, in voxels and in slopes, and cosine between normals, up to which pixels show one surface.
const ALIKE_DEPTH: f32 = 2.0;
const ALIKE_COSINE: f32 = 0.8;
/// Weight of pixels at the same depth with another normal: without them a pixel with a unique normal, as in a rough
/// skin, would be left with its own ray, which is all or nothing.
const TURNED: f32 = 0.125;

/// Least difference of a jump from the steps before and behind it: this many voxels plus this part of it.
const JUMP: f32 = 0.5;

type Rows = [[f32; STRIDE]; HIGH];

/// The depth of a voxel or of a pixel, whichever is more, at a depth in mm: the unit of depth steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepSize {
    pub(crate) voxel_mm: f32,
    /// A pixel's height in mm, and its growth with each mm of depth.
    pub(crate) pixel_mm: [f32; 2],
    /// Cosine between the normals of neighbours below which there is a crease.
    pub(crate) crease: f32,
}

impl StepSize {
    /// Cosine of creases of 35 degrees; and a value for none.
    pub(crate) const CREASE: f32 = 0.819;
    pub(crate) const NO_CREASE: f32 = -2.0;
}

impl StepSize {
    #[inline(always)]
    fn at(&self, depth: f32) -> f32 {
        let pixel = self.pixel_mm[0] + self.pixel_mm[1] * depth;
        if pixel > self.voxel_mm { pixel } else { self.voxel_mm }
    }
}

/// Depths, normals and openness of some pixels, row by row. Memory: 120 KiB.
pub(crate) struct Patch {
    /// Depth in mm; NaN for background.
    depth: Box<Rows>,
    normal: Box<[Rows; 3]>,
    /// Openness, 0 to 1: before and after the first mean, and after the second.
    open: Box<[Rows; 3]>,
    /// Pixels that differ from a neighbour.
    differs: [[bool; WIDE]; TILE],
}

impl Patch {
    pub(crate) fn new() -> Self {
        let rows = [[0.0; STRIDE]; HIGH];
        Self {
            depth: Box::new(rows),
            normal: Box::new([rows; 3]),
            open: Box::new([rows; 3]),
            differs: [[false; WIDE]; TILE],
        }
    }

    /// Takes the depths, normals and openness of the pixels from column `left` and row `top` of the picture on. Returns
    /// true if any is a hit.
    pub(crate) fn fill(
        &mut self,
        pixel: impl Fn(usize, usize) -> Option<(f32, [f32; 3], u8)>,
        [left, top]: [usize; 2],
    ) -> bool {
        let mut any = false;
        for y in 0..HIGH {
            for x in 0..STRIDE {
                let seen = (left + x).checked_sub(AROUND).zip((top + y).checked_sub(AROUND));
                let seen = seen.and_then(|(x, y)| pixel(x, y));
                let (depth, normal, open) = seen
                    .map_or((f32::NAN, [0.0; 3], 0.0), |(depth, normal, open)| {
                        (depth, normal, f32::from(open) / 255.0)
                    });
                any |= !depth.is_nan();
                self.depth[y][x] = depth;
                for (rows, part) in self.normal.iter_mut().zip(normal) {
                    rows[y][x] = part;
                }
                self.open[0][y][x] = open;
            }
        }
        any
    }

    /// Computes the means of openness.
    pub(crate) fn soften(&mut self, form: Form, step: &StepSize) {
        let [raw, once, twice] = &mut *self.open;
        let (depth, normal) = (&*self.depth, &*self.normal);
        form.run(Mean { depth, normal, step, places: PIXELS, own: 0.0, from: raw, to: once });
        form.run(Mean { depth, normal, step, places: MEANS, own: OWN, from: once, to: twice });
    }

    /// Finds the pixels that differ from a neighbour.
    pub(crate) fn compare(&mut self, form: Form, step: &StepSize) {
        let (depth, normal) = (&*self.depth, &*self.normal);
        form.run(Compare { depth, normal, step, out: &mut self.differs });
    }

    /// True if a pixel of the patch differs from one of its neighbours.
    #[inline]
    pub(crate) fn differs(&self, x: usize, y: usize) -> bool {
        self.differs[y % TILE][x % WIDE]
    }

    /// Openness of a pixel's surroundings, after the means.
    #[inline]
    pub(crate) fn open(&self, x: usize, y: usize) -> f64 {
        self.open[2][y % TILE + AROUND][x % WIDE + AROUND].into()
    }

    /// Openness of a hit at a depth within a pixel, from the pixel around with the nearest depth.
    pub(crate) fn open_at(&self, x: usize, y: usize, depth: f32) -> f64 {
        let (mut nearest, mut open) = (f32::INFINITY, 1.0);
        for row in y % TILE + AROUND - 1..=y % TILE + AROUND + 1 {
            for column in x % WIDE + AROUND - 1..=x % WIDE + AROUND + 1 {
                let apart = (self.depth[row][column] - depth).abs();
                if apart < nearest {
                    (nearest, open) = (apart, self.open[2][row][column]);
                }
            }
        }
        open.into()
    }
}

/// A mean over the similar pixels around each pixel.
struct Mean<'a, const N: usize> {
    depth: &'a Rows,
    normal: &'a [Rows; 3],
    step: &'a StepSize,
    places: [isize; N],
    own: f32,
    from: &'a Rows,
    to: &'a mut Rows,
}

impl<const N: usize> Kernel for Mean<'_, N> {
    type Output = ();

    // Loops over columns: they are vectorised for the form that runs them.
    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { depth, normal, step, places, own, from, to } = self;
        let (before, behind) = (places[0].unsigned_abs(), places[N - 1].unsigned_abs());
        for y in before..HIGH - behind {
            let (mut sum, mut count) = ([0.0_f32; STRIDE], [0.0_f32; STRIDE]);
            let mut limit = [0.0_f32; STRIDE];
            for x in before..STRIDE - behind {
                let here = depth[y][x];
                // Along a steep surface depth also changes by the slope, taken on the flatter side.
                let flatter = |one: f32, other: f32| {
                    let (one, other) = ((one - here).abs(), (other - here).abs());
                    let least = if one < other { one } else { other };
                    if least.is_nan() { 0.0 } else { least }
                };
                let across = flatter(depth[y][x - 1], depth[y][x + 1]);
                let down = flatter(depth[y - 1][x], depth[y + 1][x]);
                limit[x] = ALIKE_DEPTH * (step.at(here) + across + down);
            }
            for row in places.map(|place| y.wrapping_add_signed(place) % HIGH) {
                for across in places {
                    for here in before..STRIDE - behind {
                        let there = here.wrapping_add_signed(across);
                        let apart = (depth[row][there] - depth[y][here]).abs();
                        let cosine = normal[0][row][there] * normal[0][y][here]
                            + normal[1][row][there] * normal[1][y][here]
                            + normal[2][row][there] * normal[2][y][here];
                        let weight = if cosine >= ALIKE_COSINE { 1.0 } else { TURNED };
                        let weight = if apart <= limit[here] { weight } else { 0.0 };
                        sum[here] += weight * from[row][there];
                        count[here] += weight;
                    }
                }
            }
            for x in before..STRIDE - behind {
                let rest = own * ((N * N) as f32 - count[x]);
                let (sum, count) = (sum[x] + rest * from[y][x], count[x] + rest);
                to[y][x] = if count > 0.0 { sum / count } else { from[y][x] };
            }
        }
    }
}

/// Compares neighbours along rows and columns.
struct Compare<'a> {
    depth: &'a Rows,
    normal: &'a [Rows; 3],
    step: &'a StepSize,
    out: &'a mut [[bool; WIDE]; TILE],
}

/// Neighbours in a row of a patch.
const PAIRS: usize = WIDE + 1;

impl Compare<'_> {
    /// Sets 1 for every pair of neighbours that differ, among the pixels from `first` and `second` on, column and row.
    /// `before` and `behind` are the pixels next to them on the same line. Plain loops, which are vectorised.
    #[inline(always)]
    fn pairs(&self, [before, first, second, behind]: [[usize; 2]; 4], out: &mut [u32; PAIRS]) {
        let depth = |[x, y]: [usize; 2]| &self.depth[y][x..x + PAIRS];
        let normal = |[x, y]: [usize; 2], a: usize| &self.normal[a][y][x..x + PAIRS];
        let (z_before, z_first, z_second, z_behind) =
            (depth(before), depth(first), depth(second), depth(behind));
        let (x_first, y_first, z_normal) = (normal(first, 0), normal(first, 1), normal(first, 2));
        let (x_second, y_second, z_other) = (normal(second, 0), normal(second, 1), normal(second, 2));
        for (i, out) in out.iter_mut().enumerate() {
            let (hit, other) = (!z_first[i].is_nan(), !z_second[i].is_nan());
            let size = self.step.at(z_first[i]);
            let step = z_second[i] - z_first[i];
            let least = JUMP * size + JUMP * step.abs();
            // Background beyond the model counts as another surface.
            let bend_before = (step - (z_first[i] - z_before[i])).abs();
            let bend_behind = (z_behind[i] - z_second[i] - step).abs();
            let differs_before = (bend_before > least) | bend_before.is_nan();
            let differs_behind = (bend_behind > least) | bend_behind.is_nan();
            let jumps = (step.abs() > size) & differs_before & differs_behind;
            let cosine = x_first[i] * x_second[i] + y_first[i] * y_second[i] + z_normal[i] * z_other[i];
            *out = u32::from((hit != other) | (hit & other & (jumps | (cosine < self.step.crease))));
        }
    }
}

impl Kernel for Compare<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        // From the column before the first on.
        let x = AROUND - 1;
        let (mut along, mut above, mut below) = ([0; PAIRS], [0; PAIRS], [0; PAIRS]);
        self.pairs([[x, x - 1], [x, x], [x, x + 1], [x, x + 2]], &mut above);
        for row in 0..TILE {
            let y = row + AROUND;
            self.pairs([[x - 1, y], [x, y], [x + 1, y], [x + 2, y]], &mut along);
            self.pairs([[x, y - 1], [x, y], [x, y + 1], [x, y + 2]], &mut below);
            for (i, differs) in self.out[row].iter_mut().enumerate() {
                *differs = along[i] | along[i + 1] | above[i + 1] | below[i + 1] != 0;
            }
            above = below;
        }
    }
}
