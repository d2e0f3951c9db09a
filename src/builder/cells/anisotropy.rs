//! Volumes whose samples are further apart along one axis than along another, such as slices thicker than pixels.
//!
//! A plane near the crossings in a cell's own coordinates does not describe a cell many times as long as wide: a tenth
//! of its length may be a voxel of the finest spacing. So distances here are in voxels of the finest spacing, and a
//! cell in which the interpolated surface strays from the plane keeps its corners.
//!
//! Rejected: to judge the normals by the same lengths. Then 6 and 18 % of a head's cells keep their corners instead of
//! 36 and 42 %, but sharp normals replace smooth ones: on a ball of slices six times as thick as pixels (96 voxels),
//! normals were off by 3.2 degrees instead of 1.5.

use super::corner::{EDGES, for_each_edge, on_edge};
use crate::format::cell::{CORNERS, at_corner};
use crate::format::normal;

/// Ratio of the longest to the finest spacing from which cells are tested.
///
/// At slices six times as thick, planes are truer than a mesh and than the interpolation of eight samples, and corners
/// would take the model beyond a tenth of a mesh's bytes. At 192 voxels, RMS distance from the true surface and bytes:
/// ball .257 voxel and 151 kB with planes, .265 and 264 kB with corners where planes stray (a mesh .258 and 2.1 MB);
/// torus .202 and 117 kB, .215 and 207 kB (.210 and 1.7 MB).
const STRETCHED: f64 = 8.0;

/// Limits in models without a bound, or with a smaller one (SPEC 4.9): the distance of a crossing from the plane and
/// the depth of an outside corner behind it; and the distance of the interpolated surface within the cell. In voxels of
/// the finest spacing.
///
/// Measured on a head with slices eleven times as thick as pixels, skin and bone, against the interpolation of its
/// samples: rays that hit or miss wrongly in percent, 99th percentile of the depth in voxels, cells with corners in
/// percent.
///
/// | at the edges, within | skin | bone |
/// |---|---|---|
/// | no bound | .18, .85, .1 | .44, 1.9, .6 |
/// | .20, .10 | .06, .27, 26 | .19, .38, 34 |
/// | .15, .08 at the middle only | .05, .22, 34 | .17, .33, 40 |
/// | .15, .08 | .05, .20, 36 | .17, .28, 42 |
/// | .10, .05 | .03, .12, 50 | .14, .15, 55 |
/// | corners everywhere | .00, .04, 100 | .01, .05, 100 |
const AT_EDGES: f32 = 0.15;
const WITHIN: f32 = 0.08;
/// The same limits in parts of a bound.
const BOUND_AT_EDGES: f32 = 1.0;
const BOUND_WITHIN: f32 = 0.8;

/// Ratios of the spacings along the axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anisotropy {
    /// Squares of the finest spacing divided by each axis's.
    squares: [f32; 3],
    /// True for cells far from cubes.
    pub(super) is_long: bool,
    at_edges: f32,
    within: f32,
}

impl Anisotropy {
    /// The stretch for spacings in mm; `bound` is the bound of larger leaves in voxels of the finest spacing, 0 without
    /// them.
    #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
    pub(super) fn new(spacing: [f64; 3], bound: f64) -> Self {
        let [finest, longest] = [f64::min, f64::max].map(|of| of(of(spacing[0], spacing[1]), spacing[2]));
        let is_long = longest >= STRETCHED * finest;
        let square = |s: f64| if is_long { (finest / s * (finest / s)) as f32 } else { 1.0 };
        let [at_edges, within] = [(AT_EDGES, BOUND_AT_EDGES), (WITHIN, BOUND_WITHIN)]
            .map(|(least, part)| least.max(bound as f32 * part));
        Self { squares: spacing.map(square), is_long, at_edges, within }
    }

    /// Square of the length of a normal of index space, which scales its values to voxels of the finest spacing.
    #[inline(always)]
    pub(super) fn square(&self, n: [f32; 3]) -> f32 {
        let [x, y, z] = self.squares;
        n[0] * n[0] * x + n[1] * n[1] * y + n[2] * n[2] * z
    }
}

/// A plane in a cell, and the samples at its corners.
pub(super) struct Fit {
    pub(super) code: u16,
    pub(super) offset: f32,
    /// Mask of the inside corners.
    pub(super) mask: u32,
    pub(super) depth: [f32; CORNERS],
    /// Crossing of each edge, from its first corner; NaN for edges that are not crossed.
    pub(super) crossing: [f32; 12],
    /// Mean of the crossings, in voxels from the middle of the cell.
    pub(super) mean: [f32; 3],
}

impl Fit {
    /// True if the interpolated surface is further from the plane than allowed.
    ///
    /// Tested are the crossings, the outside corners, the mean of the crossings, and the points half-way between it and
    /// them.
    #[inline(always)]
    #[expect(clippy::cast_precision_loss, reason = "small integers")]
    pub(super) fn strays(&self, stretch: &Anisotropy) -> bool {
        let whole = normal::decode_l1(self.code);
        let n = whole.map(|c| c as f32);
        let square = stretch.square(n);
        let corner: [f32; CORNERS] = std::array::from_fn(|c| at_corner(whole, c) as f32);
        let mut worst = 0.0_f32;
        let mut strays = self.strays_at(self.mean, n, square, stretch);
        for_each_edge!(edge => {
            let ((p, q), t) = (EDGES[edge], self.crossing[edge]);
            let off = corner[p] + t * (corner[q] - corner[p]) - self.offset;
            worst = if off * off > worst { off * off } else { worst };
            // Half-way between the crossing and the mean.
            let at = on_edge(edge, t, [0.0; 3]);
            let point =
                [0.5 * (self.mean[0] + at[0]), 0.5 * (self.mean[1] + at[1]), 0.5 * (self.mean[2] + at[2])];
            strays |= (t >= 0.0) & self.strays_at(point, n, square, stretch);
        });
        for (c, value) in corner.into_iter().enumerate() {
            let behind = self.offset - value;
            let is_covered = (self.mask >> c & 1 == 0) & (behind > 0.0) & (behind * behind > worst);
            worst = if is_covered { behind * behind } else { worst };
        }
        // Coordinates are in half cells.
        strays | (worst > 4.0 * stretch.at_edges * stretch.at_edges * square)
    }

    /// True if it is too far at a point, in voxels from the middle of the cell.
    #[inline(always)]
    fn strays_at(&self, at: [f32; 3], n: [f32; 3], square: f32, stretch: &Anisotropy) -> bool {
        let d = &self.depth;
        let part = |low: f32, high: f32, at: f32| low * (0.5 - at) + high * (0.5 + at);
        let [x, y, z] = at;
        let along_x = [part(d[0], d[1], x), part(d[2], d[3], x), part(d[4], d[5], x), part(d[6], d[7], x)];
        let along_xy = [part(along_x[0], along_x[1], y), part(along_x[2], along_x[3], y)];
        let depth = part(along_xy[0], along_xy[1], z);
        let by_x = [d[1] - d[0], d[3] - d[2], d[5] - d[4], d[7] - d[6]];
        let gradient = [
            part(part(by_x[0], by_x[1], y), part(by_x[2], by_x[3], y), z),
            part(along_x[1] - along_x[0], along_x[3] - along_x[2], z),
            along_xy[1] - along_xy[0],
        ];
        // Slope of depths along the plane's normal, times the normal's length in voxels of the finest spacing.
        let [sx, sy, sz] = stretch.squares;
        let falls = -(gradient[0] * n[0] * sx + gradient[1] * n[1] * sy + gradient[2] * n[2] * sz);
        // Depths behind the surface and behind the plane, both times twice that length and the slope.
        let behind = self.offset - 2.0 * (n[0] * x + n[1] * y + n[2] * z);
        let apart = (2.0 * depth * square - behind * falls).abs();
        !((falls > 0.0) & (apart <= 2.0 * stretch.within * square.sqrt() * falls))
    }
}
