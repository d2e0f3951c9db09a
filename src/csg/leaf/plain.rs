//! Spheres, boxes along the axes and half-spaces: whole numbers throughout.

use std::cmp::Ordering;

use super::{Face, Rows, bits, leads_in};
use crate::builder::Cover;
use crate::csg::place::{centre, voxels_between};

/// Points whose distance from a middle is less than a radius, and points at that distance that are moved in.
#[derive(Clone, Copy, Debug)]
pub(in crate::csg) struct Ball {
    /// Middle and radius, below 2^29.
    pub(in crate::csg) middle: [i32; 3],
    pub(in crate::csg) radius: i32,
}

/// The root of a whole number below 2^62, rounded down.
#[inline]
#[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "corrected below")]
fn root(of: i64) -> i64 {
    let near = (of as f64).sqrt() as i64;
    if near * near > of {
        near - 1
    } else if (near + 1) * (near + 1) <= of {
        near + 1
    } else {
        near
    }
}

impl Ball {
    fn squared(&self) -> i64 {
        i64::from(self.radius).pow(2)
    }

    pub(super) fn cover(&self, region: &[(i64, i64); 3]) -> Cover {
        let (mut nearest, mut farthest) = (0, 0);
        for ((low, high), c) in region.iter().zip(self.middle.map(i64::from)) {
            nearest += (c.clamp(*low, *high) - c).pow(2);
            farthest += (low - c).abs().max((high - c).abs()).pow(2);
        }
        match self.squared() {
            r if farthest < r => Cover::Inside,
            r if nearest > r => Cover::Outside,
            _ => Cover::Mixed,
        }
    }

    #[inline]
    pub(super) fn fill(&self, at: Rows, out: &mut [u64]) {
        let [cx, cy, cz] = self.middle.map(i64::from);
        let first = i64::from(at.x);
        let of_slice = self.squared() - (centre(at.z) - cz).pow(2);
        for (word, y) in out.iter_mut().zip(at.y..) {
            let left = of_slice - (centre(y) - cy).pow(2);
            *word = if left < 0 {
                0
            } else {
                let half = root(left);
                // A middle at the high end is moved in by -e, one at the low end out.
                let open = i64::from(
                    half * half == left && !(half == 0 && self.contains([cx, centre(y), centre(at.z)])),
                );
                let (from, to) = voxels_between(cx - half + open, cx + half);
                bits(from - first, to - first)
            };
        }
    }

    /// Square of a point's distance from the middle, less the square of the radius.
    #[inline]
    pub(super) fn beyond(&self, p: [i64; 3]) -> i64 {
        (0..3).map(|k| (p[k] - i64::from(self.middle[k])).pow(2)).sum::<i64>() - self.squared()
    }

    #[inline]
    pub(super) fn contains(&self, p: [i64; 3]) -> bool {
        match self.beyond(p).cmp(&0) {
            Ordering::Less => true,
            Ordering::Equal => leads_in(self.outwards(p)),
            Ordering::Greater => false,
        }
    }

    /// True if a point is inside, and its surface may be within `steps` lattice steps.
    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "with room")]
    pub(in crate::csg) fn contains_within(&self, p: [i64; 3], steps: f64) -> bool {
        let beyond = self.beyond(p);
        // The distance is the difference of the squares by the sum of the roots, which is at most two radii.
        let most = (steps + 1.0) * 2.0 * f64::from(self.radius);
        beyond <= 0 && -(beyond as f64) <= most && (beyond < 0 || self.contains(p))
    }

    /// Direction away from the middle.
    #[expect(clippy::cast_precision_loss, reason = "a direction")]
    pub(super) fn outwards(&self, p: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| (p[k] - i64::from(self.middle[k])) as f64)
    }

    pub(super) fn face(&self, voxel: [i32; 3]) -> Face {
        let outwards = self.outwards(voxel.map(centre));
        let away = outwards.iter().map(|c| c * c).sum::<f64>().sqrt();
        Face { outwards, distance: (away - f64::from(self.radius)).abs() }
    }
}

/// A box along the axes.
#[derive(Clone, Copy, Debug)]
pub(in crate::csg) struct Block {
    pub(in crate::csg) low: [i64; 3],
    pub(in crate::csg) high: [i64; 3],
}

impl Block {
    /// First and last voxel along an axis.
    #[inline]
    fn voxels(&self, axis: usize) -> (i64, i64) {
        let (low, high) = (self.low[axis], self.high[axis]);
        if axis == 0 { voxels_between(low + 1, high) } else { voxels_between(low, high - 1) }
    }

    pub(super) fn cover(&self, region: &[(i64, i64); 3]) -> Cover {
        let mut all = true;
        for (axis, (low, high)) in region.iter().enumerate() {
            let (from, to) = self.voxels(axis);
            let (first, last) = voxels_between(*low, *high);
            if last < from || first > to {
                return Cover::Outside;
            }
            all &= first >= from && last <= to;
        }
        if all { Cover::Inside } else { Cover::Mixed }
    }

    pub(super) fn fill(&self, at: Rows, out: &mut [u64]) {
        let within = |axis: usize, v: i32| {
            let (from, to) = self.voxels(axis);
            (from..=to).contains(&i64::from(v))
        };
        let (from, to) = self.voxels(0);
        let row = if within(2, at.z) { bits(from - i64::from(at.x), to - i64::from(at.x)) } else { 0 };
        for (word, y) in out.iter_mut().zip(at.y..) {
            *word = if within(1, y) { row } else { 0 };
        }
    }

    pub(super) fn contains(&self, p: [i64; 3]) -> bool {
        let low = p[0] > self.low[0] && p[1] >= self.low[1] && p[2] >= self.low[2];
        low && p[0] <= self.high[0] && p[1] < self.high[1] && p[2] < self.high[2]
    }

    /// The face between two neighbours, which lies across the axis that joins them.
    #[expect(clippy::cast_precision_loss, reason = "a distance")]
    pub(super) fn face(&self, voxel: [i32; 3], beside: [i32; 3], is_inside: bool) -> Face {
        let mut face = Face { outwards: [0.0; 3], distance: 0.0 };
        for axis in 0..3 {
            let (from, to) = self.voxels(axis);
            let within = |v: i32| (from..=to).contains(&i64::from(v));
            if within(voxel[axis]) == within(beside[axis]) {
                continue;
            }
            let way = f64::from(beside[axis] - voxel[axis]);
            face.outwards[axis] = if is_inside { way } else { -way };
            let is_high = (way > 0.0) == is_inside;
            let at = if is_high { self.high[axis] } else { self.low[axis] };
            face.distance = (at - centre(voxel[axis])).abs() as f64;
        }
        face
    }
}

/// Points p with normal . p < bound, and points with normal . p = bound that are moved in.
#[derive(Clone, Copy, Debug)]
pub(in crate::csg) struct Half {
    /// Normal whose largest part is 2^28.
    pub(in crate::csg) normal: [i64; 3],
    /// Bound of normal . p, below 2^60.
    pub(in crate::csg) bound: i64,
}

impl Half {
    /// The greatest normal . p of a point inside.
    #[inline]
    fn most(&self) -> i64 {
        self.bound - i64::from(!leads_in(self.outwards()))
    }

    pub(super) fn cover(&self, region: &[(i64, i64); 3]) -> Cover {
        let (mut least, mut most) = (0, 0);
        for ((low, high), n) in region.iter().zip(self.normal) {
            let (a, b) = (n * low, n * high);
            least += a.min(b);
            most += a.max(b);
        }
        if most <= self.most() {
            Cover::Inside
        } else if least > self.most() {
            Cover::Outside
        } else {
            Cover::Mixed
        }
    }

    pub(super) fn fill(&self, at: Rows, out: &mut [u64]) {
        let [nx, ny, nz] = self.normal;
        let (first, most) = (i64::from(at.x), self.most());
        for (word, y) in out.iter_mut().zip(at.y..) {
            let left = most - ny * centre(y) - nz * centre(at.z);
            *word = if nx > 0 {
                bits(0, voxels_between(0, left.div_euclid(nx)).1 - first)
            } else if nx < 0 {
                // -|nx| x <= left: x >= -left / |nx|, rounded up.
                bits(voxels_between(-(left.div_euclid(-nx)), 0).0 - first, 63)
            } else if left >= 0 {
                u64::MAX
            } else {
                0
            };
        }
    }

    pub(super) fn contains(&self, p: [i64; 3]) -> bool {
        (0..3).map(|k| self.normal[k] * p[k]).sum::<i64>() <= self.most()
    }

    #[expect(clippy::cast_precision_loss, reason = "a direction")]
    pub(super) fn outwards(&self) -> [f64; 3] {
        self.normal.map(|n| n as f64)
    }

    #[expect(clippy::cast_precision_loss, reason = "a distance")]
    pub(super) fn face(&self, voxel: [i32; 3]) -> Face {
        let over: i64 = (0..3).map(|k| self.normal[k] * centre(voxel[k])).sum::<i64>() - self.bound;
        let outwards = self.outwards();
        let length = outwards.iter().map(|c| c * c).sum::<f64>().sqrt();
        Face { outwards, distance: (over as f64 / length).abs() }
    }
}
