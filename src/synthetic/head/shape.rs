//! Solids of the synthetic head and their signed distances along one row.
//!
//! All lengths are millimetres, all arithmetic is IEEE single `+ - * / sqrt` in a fixed order, and
//! what a shape does to a column depends on that column's position alone, never on the columns read
//! with it. Shapes are mirrored: they see `|x|`, so one entry at x > 0 describes both sides.

use std::ops::Range;

/// A solid, seen at `(|x|, y, z)`.
#[derive(Clone, Copy, Debug)]
pub(super) enum Solid {
    /// Centre and semi-axes, parallel to the volume's axes.
    Ellipsoid([f32; 3], [f32; 3]),
    /// Two end points and the radius at each: a limb whose radius changes linearly.
    Capsule([f32; 3], [f32; 3], [f32; 2]),
}

/// How a solid joins those before it.
#[derive(Clone, Copy, Debug)]
pub(super) enum Join {
    /// Union, the seam rounded over so many mm.
    Add(f32),
    /// Difference, the rim rounded over so many mm.
    Cut(f32),
}

impl Join {
    fn blend(self) -> f32 {
        match self {
            Self::Add(blend) | Self::Cut(blend) => blend,
        }
    }

    /// The effect of the join deep inside the solid.
    fn fill(self, out: &mut [f32]) {
        out.fill(match self {
            Self::Add(_) => -FAR,
            Self::Cut(_) => FAR,
        });
    }
}

/// One step of a recipe; a recipe is fastest when its widest seams come first.
pub(super) type Step = (Join, Solid);

/// Distance of places far from every solid.
pub(super) const FAR: f32 = 1.0e6;

/// Distances beyond this cannot change a sample: ramps are under 1.5 voxels wide and a voxel of the
/// coarsest useful head is a few mm.
const REACH: f32 = 3.0;

/// Columns in one piece; a piece's buffers live on the stack.
pub(super) const PIECE: usize = 256;

/// Positions of up to [`PIECE`] neighbouring columns of a row.
pub(super) struct Columns<'a> {
    /// x of each column in mm, increasing.
    pub(super) x: &'a [f32],
    /// y of the row.
    pub(super) y: f32,
    /// z of the slice.
    pub(super) z: f32,
    /// Edge of a voxel in mm.
    pub(super) voxel: f32,
}

impl Columns<'_> {
    /// Indices of the columns with `lo <= x <= hi`.
    fn between(&self, lo: f32, hi: f32) -> Range<usize> {
        let start = self.x.partition_point(|x| *x < lo);
        let end = self.x.partition_point(|x| *x <= hi);
        start..end.max(start)
    }

    /// The (at most two) runs of columns with `lo <= |x| <= hi`; the second is empty if they touch.
    fn mirrored(&self, lo: f32, hi: f32) -> [Range<usize>; 2] {
        if lo <= 0.0 { [self.between(-hi, hi), 0..0] } else { [self.between(-hi, -lo), self.between(lo, hi)] }
    }
}

/// Runs a recipe: signed distance in mm (negative inside) of every column, exact enough near the
/// surface for partial-volume ramps; `out` starts as [`FAR`], stays so where nothing is near, and is
/// minus that deep inside. Returns whether anything is near.
pub(super) fn distances(recipe: &[Step], at: &Columns<'_>, out: &mut [f32]) -> bool {
    let mut near = false;
    for (i, (join, solid)) in recipe.iter().enumerate() {
        // A solid matters as far away as this or any later step rounds its seam.
        let blend = recipe[i..].iter().fold(0.0_f32, |most, (join, _)| most.max(join.blend()));
        let reach = blend + REACH.max(1.5 * at.voxel);
        match *solid {
            Solid::Ellipsoid(c, r) => {
                let (ry, rz) = ((at.y - c[1]) / r[1], (at.z - c[2]) / r[2]);
                let off = ry * ry + rz * rz;
                // k0 >= 1 + reach / r_min implies a distance of at least `reach` (see `ellipsoid`).
                let k = 1.0 + reach / r[0].min(r[1]).min(r[2]);
                let left = k * k - off;
                if left <= 0.0 {
                    continue;
                }
                let half = r[0] * left.sqrt();
                let steep = (ry / r[1]) * (ry / r[1]) + (rz / r[2]) * (rz / r[2]);
                // Likewise k0 <= 1 - reach / r_min is at least `reach` deep; only solids on the midplane
                // are large enough for that to save time.
                let k = 2.0 - k;
                let left = k * k - off;
                let deep = if c[0] == 0.0 && k > 0.0 && left > 0.0 {
                    let half = r[0] * left.sqrt();
                    at.between(-half, half)
                } else {
                    0..0
                };
                let mut runs = at.mirrored(c[0] - half, c[0] + half);
                if !deep.is_empty() {
                    join.fill(&mut out[deep.clone()]);
                    runs = [runs[0].start..deep.start, deep.end..runs[0].end];
                }
                for run in runs {
                    near |= !run.is_empty();
                    apply(*join, &at.x[run.clone()], &mut out[run], |x| {
                        ellipsoid(x - c[0], 1.0 / r[0], off, steep)
                    });
                }
                near |= !deep.is_empty();
            }
            Solid::Capsule(a, b, r) => {
                let margin = r[0].max(r[1]) + reach;
                let outside = |p: f32, i: usize| p < a[i].min(b[i]) - margin || p > a[i].max(b[i]) + margin;
                if outside(at.y, 1) || outside(at.z, 2) {
                    continue;
                }
                let ab = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
                let (py, pz) = (at.y - a[1], at.z - a[2]);
                let inverse = 1.0 / (ab[0] * ab[0] + ab[1] * ab[1] + ab[2] * ab[2]);
                let yz = py * ab[1] + pz * ab[2];
                for run in at.mirrored(a[0].min(b[0]) - margin, a[0].max(b[0]) + margin) {
                    near |= !run.is_empty();
                    apply(*join, &at.x[run.clone()], &mut out[run], |x| {
                        let px = x - a[0];
                        let t = ((px * ab[0] + yz) * inverse).clamp(0.0, 1.0);
                        let (dx, dy, dz) = (px - t * ab[0], py - t * ab[1], pz - t * ab[2]);
                        (dx * dx + dy * dy + dz * dz).sqrt() - (r[0] + t * (r[1] - r[0]))
                    });
                }
            }
        }
    }
    near
}

/// First-order distance to an ellipsoid: `k0 (k0 - 1) / k1`, with k0 = |p / r| and k1 = |p / r^2|
/// (the implicit function over its gradient); at least `(k0 - 1) r_min` outside.
#[inline(always)]
fn ellipsoid(x: f32, inverse_r: f32, off: f32, steep: f32) -> f32 {
    let q = x * inverse_r;
    let s = q * inverse_r;
    let square = q * q + off;
    // The centre itself has no gradient; the tiny term keeps the quotient finite there.
    (square - square.sqrt()) / (s * s + steep + 1.0e-12).sqrt()
}

/// Joins one solid to the distances so far.
#[inline(always)]
fn apply(join: Join, x: &[f32], out: &mut [f32], distance: impl Fn(f32) -> f32) {
    match join {
        Join::Add(blend) => {
            for (d, x) in out.iter_mut().zip(x) {
                *d = union(*d, distance(x.abs()), blend);
            }
        }
        Join::Cut(blend) => {
            for (d, x) in out.iter_mut().zip(x) {
                *d = -union(-*d, distance(x.abs()), blend);
            }
        }
    }
}

/// Minimum, rounded off by a parabola where the two differ by less than `blend`.
#[inline(always)]
pub(super) fn union(a: f32, b: f32, blend: f32) -> f32 {
    let h = (blend - (a - b).abs()).max(0.0);
    a.min(b) - h * h / (4.0 * blend)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(x: &[f32], y: f32, z: f32) -> Columns<'_> {
        Columns { x, y, z, voxel: 0.5 }
    }

    #[test]
    fn distances_vanish_on_the_surface_and_are_mirrored() {
        let recipe = [
            (Join::Add(0.5), Solid::Ellipsoid([30.0, 0.0, 0.0], [5.0, 8.0, 20.0])),
            (Join::Add(0.5), Solid::Capsule([60.0, 0.0, -9.0], [60.0, 0.0, 9.0], [4.0, 4.0])),
        ];
        let x: Vec<f32> = (-80..=80).map(|i| i as f32).collect();
        let mut out = vec![FAR; x.len()];
        distances(&recipe, &columns(&x, 0.0, 0.0), &mut out);
        for (at, want) in [(25, 0.0), (35, 0.0), (36, 1.0), (56, 0.0), (57, -1.0), (65, 1.0), (0, FAR)] {
            assert!((out[80 + at] - want).abs() < 0.2, "x {at}: {} wanted {want}", out[80 + at]);
            assert_eq!(out[80 + at].to_bits(), out[80 - at].to_bits());
        }
    }

    #[test]
    fn what_is_skipped_as_far_could_not_have_mattered() {
        let solid = Solid::Ellipsoid([20.0, 3.0, 1.0], [4.0, 30.0, 9.0]);
        let x: Vec<f32> = (0..400).map(|i| 0.25 * i as f32).collect();
        for y in [-40.0, -20.0, 0.0, 3.0, 17.0, 38.0] {
            let mut near = vec![FAR; x.len()];
            distances(&[(Join::Add(2.0), solid)], &columns(&x, y, 4.0), &mut near);
            // A blend so wide that nothing is skipped; far from FAR it does not change the distance.
            let mut all = vec![FAR; x.len()];
            distances(&[(Join::Add(1.0e4), solid)], &columns(&x, y, 4.0), &mut all);
            for (n, a) in near.iter().zip(&all) {
                assert!(n == a || (*n == FAR && *a > 5.0 - 1.0e-3), "{n} {a}");
            }
        }
    }

    #[test]
    fn what_is_filled_as_deep_is_deep() {
        let x: Vec<f32> = (-80..=80).map(|i| 0.5 * i as f32).collect();
        let mut filled = 0;
        for y in [-17.0, -9.0, 0.0, 3.0, 14.0] {
            let at = columns(&x, y, 4.0);
            let mut d = vec![FAR; x.len()];
            let solid = Solid::Ellipsoid([0.0, 3.0, 1.0], [30.0, 22.0, 19.0]);
            assert!(distances(&[(Join::Add(2.0), solid)], &at, &mut d));
            for (d, x) in d.iter().zip(&x).filter(|(d, _)| **d == -FAR) {
                let (q, ry, rz) = (x / 30.0, (y - 3.0) / 22.0, 3.0 / 19.0);
                let depth = (1.0 - (q * q + ry * ry + rz * rz).sqrt()) * 19.0;
                assert!(depth > 5.0 - 1.0e-3, "{d} at {x} {y}: {depth}");
                filled += 1;
            }
        }
        assert!(filled > 100);
        let mut d = [FAR; 4];
        assert!(!distances(
            &[(Join::Add(2.0), Solid::Ellipsoid([0.0; 3], [9.0; 3]))],
            &columns(&x[..4], 0.0, 20.0),
            &mut d
        ));
        assert_eq!(d, [FAR; 4]);
    }
}
