//! Corners and edges of a cell, and tolerances of its plane.

use crate::format::normal;

/// Weight of the guess when a plane is fitted near a direction, in square voxels. Batches fit in single precision,
/// single cells in double: sums of either decide stored bytes, so one cannot replace the other.
pub(super) const TOWARDS_GUESS: f64 = 0.05;

/// Depth by which a plane may cover an outside corner, in voxels of the index space.
pub(super) const TOLERANCE: f32 = 0.1;

/// Largest distance of the smooth gradient's plane from the crossings and from corners on the wrong side: where the
/// surface is smooth, and where it bends. Smaller values give sharper edges, and normals more exposed to noise.
///
/// Measured on a turned box and a noisy ball of 192 voxels: 99th percentile of the distance of hits from the true
/// surface, and mean error of the normal in degrees:
///
/// | smooth, bent, from a curvature of | box | noise |
/// |---|---|---|
/// | .15 everywhere | .057 .91 | .075 .93 |
/// | .10, .05, .25 | .042 .85 | .076 1.02 |
/// | .15, .05, .25 | .044 .85 | .075 .93 |
/// | .15, .05, .12 | .034 .82 | .075 .93 |
/// | a marching-cubes mesh | .023 1.65 | .088 4.27 |
pub(super) const NEAR_SMOOTH: f32 = 0.15;
pub(super) const NEAR_BENT: f32 = 0.05;

/// Curvature from which a surface counts as bent, per voxel of the index space.
pub(super) const BENT: f32 = 0.12;

/// Strength by which a fitted plane is finally turned towards the smooth gradient, in square voxels: equal to
/// [`TOWARDS_GUESS`] where crossings are .27 voxel off the gradient's plane, eight where they are .05 off. So smooth
/// cells keep the gradient, edges follow the crossings, and neighbouring normals do not come from two estimates.
///
/// Share of neighbours of a head's bone whose gradients agree within 4 degrees and whose normals are more than 12
/// apart: 17.6 % with the switch by [`NEAR_SMOOTH`] alone, 10.5 % with this. Rejected: a pull of .5 everywhere turns a
/// noisy ball's normals by .93 instead of .66 degrees, 1 instead of .3 bevels a box.
const PULL: f32 = 0.3;
const PULL_AT: f32 = 0.15;
const PULL_NEAREST: f32 = 0.001;

/// The pull of a gradient whose plane has its farthest crossing at this distance in voxels.
#[inline(always)]
pub(super) fn pull(off: f32) -> f32 {
    let off = if off > PULL_NEAREST { off } else { PULL_NEAREST };
    let ratio = PULL_AT / off;
    PULL * ratio * ratio * ratio
}

/// Square of the cosine between a plane's normal and a gradient down to which both belong to the same surface: 60
/// degrees.
pub(super) const SAME_SURFACE: f32 = 0.25;

/// The twelve edges as pairs of corners.
pub(super) const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Statements for every edge, whose number is a literal in them, so that a loop over cells vectorises and keeps sums in
/// registers. Fits took 1.7 times as long with a loop over cells for each edge, whose sums were arrays. A closure called
/// twelve times is not inlined, nor compiled for the caller's instruction set.
macro_rules! for_each_edge {
    ($edge:ident => $body:block) => {
        for_each_edge!($edge => $body, 0 1 2 3 4 5 6 7 8 9 10 11);
    };
    ($edge:ident => $body:block, $($number:literal)*) => {$(
        {
            let $edge: usize = $number;
            $body
        }
    )*};
}
pub(super) use for_each_edge;

/// The point of an edge at `t` from its first corner, as seen from another point, in voxels; both points and the cell's
/// corners are relative to the cell's middle.
#[inline(always)]
pub(super) fn on_edge(edge: usize, t: f32, from: [f32; 3]) -> [f32; 3] {
    let (p, q) = EDGES[edge];
    let along = |a: usize| {
        let side = if p >> a & 1 == 1 { 0.5 } else { -0.5 };
        (if (p ^ q) >> a & 1 == 1 { side + t } else { side }) - from[a]
    };
    [along(0), along(1), along(2)]
}

/// Least and greatest size of a depth: keeps 1 / 0 and infinity less infinity out of the arithmetic.
pub(super) const MIN_DEPTH: f32 = 1e-20;
pub(super) const MAX_DEPTH: f32 = 1e30;

/// A depth with the sign of its side, and neither zero nor infinite.
#[inline(always)]
pub(super) fn signed_depth(depth: f32, inside: bool) -> f32 {
    let size = if inside { depth } else { -depth };
    // NaN becomes the least.
    let size = if size > MIN_DEPTH { size } else { MIN_DEPTH };
    let size = if size < MAX_DEPTH { size } else { MAX_DEPTH };
    if inside { size } else { -size }
}

/// Code of the direction against a gradient; `None` for a zero gradient.
pub(super) fn outward(gradient: [f64; 3]) -> Option<u16> {
    encode(gradient.map(|c| -c))
}

/// Code of a direction of any length.
#[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
pub(super) fn encode(direction: [f64; 3]) -> Option<u16> {
    let longest = direction.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    let is_direction = longest > 0.0 && longest < f64::INFINITY && direction.iter().all(|c| c.is_finite());
    is_direction.then(|| normal::encode(direction.map(|c| (c / longest) as f32)))
}
