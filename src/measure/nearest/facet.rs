//! A facet: the part of a plane within a box, and its nearest point, exact but for the rounding of doubles.

use crate::geom::{add_scaled, dot};

/// The part of a plane within a box, in the orthonormal frame of a model (mm).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Facet {
    /// Middle of the box.
    pub(super) middle: [f64; 3],
    half: [f64; 3],
    /// Unit vector out of the surface.
    pub(crate) normal: [f64; 3],
    /// Height of the plane over the middle, along the normal.
    offset: f64,
}

impl Facet {
    /// The plane `normal . u = offset` of a box's own coordinates, -1 to 1.
    #[inline]
    pub(super) fn new(middle: [f64; 3], half: [f64; 3], normal: [i32; 3], offset: f64) -> Self {
        let across: [f64; 3] = std::array::from_fn(|a| f64::from(normal[a]) / half[a]);
        let scale = 1.0 / dot(across, across).sqrt();
        Self { middle, half, normal: across.map(|c| c * scale), offset: offset * scale }
    }

    /// Height of a point over the plane.
    #[inline]
    pub(super) fn height(&self, point: [f64; 3]) -> f64 {
        dot(self.normal, minus(point, self.middle)) - self.offset
    }

    /// False only if a point's squared distance is more than `most`: the facet lies within its box, and within a disc around
    /// the foot of the box's middle.
    #[inline]
    pub(super) fn may_reach(&self, point: [f64; 3], most: f64) -> bool {
        let from = minus(point, self.middle);
        let height = dot(self.normal, from) - self.offset;
        let over: [f64; 3] = std::array::from_fn(|a| (from[a].abs() - self.half[a]).max(0.0));
        if dot(over, over).max(height * height) > most {
            return false;
        }
        let across = add_scaled(from, -(height + self.offset), self.normal);
        let (across, radius) =
            (dot(across, across), (dot(self.half, self.half) - self.offset * self.offset).max(0.0));
        across <= radius || height * height + (across.sqrt() - radius.sqrt()).powi(2) <= most
    }

    /// The nearest point of the facet, and its squared distance.
    ///
    /// Among points `x` of the box with `m . x = k` the nearest to `p` is `clamp(p - l m)` for some `l`, and `m . x(l)` falls
    /// with `l`, in straight pieces between the six places where a coordinate meets a side of the box.
    #[inline]
    pub(super) fn nearest(&self, point: [f64; 3]) -> (f64, [f64; 3]) {
        let from = minus(point, self.middle);
        let height = dot(self.normal, from) - self.offset;
        let foot = add_scaled(from, -height, self.normal);
        if (0..3).all(|a| foot[a].abs() <= self.half[a]) {
            return (height * height, add_scaled(self.middle, 1.0, foot));
        }
        let held = |l: f64| -> [f64; 3] {
            std::array::from_fn(|a| (from[a] - l * self.normal[a]).clamp(-self.half[a], self.half[a]))
        };
        let over = |l: f64| dot(self.normal, held(l)) - self.offset;
        // The last kink over the plane and the first one below it.
        let (mut last, mut first) = ((f64::NEG_INFINITY, 0.0), (f64::INFINITY, 0.0));
        for ((from, normal), half) in from.into_iter().zip(self.normal).zip(self.half) {
            if normal == 0.0 {
                continue;
            }
            for side in [-half, half] {
                let l = (from - side) / normal;
                let at = over(l);
                if at >= 0.0 && l > last.0 {
                    last = (l, at);
                }
                if at <= 0.0 && l < first.0 {
                    first = (l, at);
                }
            }
        }
        let l = if last.0 == f64::NEG_INFINITY {
            first.0
        } else if first.0 == f64::INFINITY || last.1 <= first.1 {
            last.0
        } else {
            last.0 + (first.0 - last.0) * (last.1 / (last.1 - first.1))
        };
        let found = held(l);
        let apart = minus(from, found);
        (dot(apart, apart), add_scaled(self.middle, 1.0, found))
    }

    /// The facet along the two axes that it faces least, and those axes before the third.
    fn polygon(&self) -> (Polygon, [usize; 3]) {
        let [x, y, z] = self.normal.map(f64::abs);
        let w = if x >= y && x >= z {
            0
        } else if y >= z {
            1
        } else {
            2
        };
        let (u, v) = ((w + 1) % 3, (w + 2) % 3);
        let (a, b) = (self.half[u], self.half[v]);
        let (slope, reach) = ([self.normal[u], self.normal[v]], self.normal[w].abs() * self.half[w]);
        // The plane stays within the box where its rise along u and v is near the offset.
        let slack = 1e-12 * self.half.iter().sum::<f64>();
        let mut polygon = Polygon { count: 4, ..Polygon::default() };
        polygon.corners[..4].copy_from_slice(&[[-a, -b], [a, -b], [a, b], [-a, b]]);
        let rise = slope[0].abs() * a + slope[1].abs() * b;
        if rise > reach + self.offset {
            polygon = polygon.clip(slope, self.offset + reach + slack);
        }
        if rise > reach - self.offset {
            polygon = polygon.clip(slope.map(|c| -c), slack - (self.offset - reach));
        }
        (polygon, [u, v, w])
    }

    /// The place on the plane with these coordinates along the first two axes.
    fn lifted(&self, at: [f64; 2], [u, v, w]: [usize; 3]) -> [f64; 3] {
        let rise = (self.offset - self.normal[u] * at[0] - self.normal[v] * at[1]) / self.normal[w];
        let mut place = self.middle;
        (place[u], place[v]) = (place[u] + at[0], place[v] + at[1]);
        place[w] += rise.clamp(-self.half[w], self.half[w]);
        place
    }

    /// The corners of the facet.
    pub(crate) fn corners(&self, each: impl FnMut([f64; 3])) {
        let (polygon, axes) = self.polygon();
        polygon.corners.iter().take(polygon.count).map(|corner| self.lifted(*corner, axes)).for_each(each);
    }

    /// Area and centroid of the facet; of a facet that is a point or a line, the point nearest to the box's middle.
    #[inline]
    pub(crate) fn section(&self) -> (f64, [f64; 3]) {
        let (polygon, axes) = self.polygon();
        let (area, at) = polygon.area();
        if area <= 0.0 {
            return (0.0, self.nearest(self.middle).1);
        }
        (area / self.normal[axes[2]].abs(), self.lifted(at, axes))
    }
}

#[inline]
pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// A convex polygon: a rectangle that two lines cut.
#[derive(Clone, Copy, Debug, Default)]
struct Polygon {
    corners: [[f64; 2]; 8],
    count: usize,
}

impl Polygon {
    /// The part where `slope . x <= most`.
    fn clip(self, slope: [f64; 2], most: f64) -> Self {
        let mut kept = Self::default();
        let mut add = |corner: [f64; 2]| {
            if let Some(to) = kept.corners.get_mut(kept.count) {
                *to = corner;
                kept.count += 1;
            }
        };
        let heights = self.corners.map(|x| slope[0] * x[0] + slope[1] * x[1] - most);
        if heights.iter().take(self.count).all(|height| *height <= 0.0) {
            return self;
        }
        for i in 0..self.count {
            let after = if i + 1 < self.count { i + 1 } else { 0 };
            let (one, other) = (self.corners[i], self.corners[after]);
            let (at, next) = (heights[i], heights[after]);
            if at <= 0.0 {
                add(one);
            }
            if (at <= 0.0) != (next <= 0.0) {
                let part = at / (at - next);
                add([0, 1].map(|a| one[a] + part * (other[a] - one[a])));
            }
        }
        kept
    }

    /// Area and centroid.
    fn area(&self) -> (f64, [f64; 2]) {
        let (mut area, mut sum) = (0.0, [0.0; 2]);
        let origin = self.corners[0];
        let from = |i: usize| [0, 1].map(|a| self.corners[i][a] - origin[a]);
        for i in 1..self.count.saturating_sub(1) {
            let ([a, b], [c, d]) = (from(i), from(i + 1));
            let twice = a * d - b * c;
            area += twice / 2.0;
            sum = [sum[0] + twice * (a + c), sum[1] + twice * (b + d)];
        }
        (area, [0, 1].map(|a| origin[a] + sum[a] / (6.0 * area)))
    }
}
