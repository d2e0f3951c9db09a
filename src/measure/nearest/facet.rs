//! A facet: the part of a plane within a box, and its nearest point, exact but for the rounding of doubles.

use crate::geom::{add_scaled, dot};

/// Part of a box's section below which differences of areas are rounded too much, and the same for rises.
const ROUNDED: f64 = 1e-4;

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

/// A point relative to a facet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Relative {
    /// From the middle of its box.
    from: [f64; 3],
    /// Height over the facet's plane.
    pub(super) height: f64,
}

impl Facet {
    /// The plane `normal . u = offset` of a box's own coordinates, -1 to 1; the box has a middle and half edges, and these
    /// many of the latter lie in a mm.
    #[inline]
    pub(super) fn new(
        middle: [f64; 3],
        [half, per_mm]: [[f64; 3]; 2],
        normal: [i32; 3],
        offset: f64,
    ) -> Self {
        let across: [f64; 3] = std::array::from_fn(|a| f64::from(normal[a]) * per_mm[a]);
        let scale = 1.0 / dot(across, across).sqrt();
        Self { middle, half, normal: across.map(|c| c * scale), offset: offset * scale }
    }

    /// A point relative to the facet.
    #[inline]
    pub(super) fn relative(&self, point: [f64; 3]) -> Relative {
        let from = minus(point, self.middle);
        Relative { from, height: dot(self.normal, from) - self.offset }
    }

    /// Height of a point over the plane.
    #[inline]
    pub(super) fn height(&self, point: [f64; 3]) -> f64 {
        self.relative(point).height
    }

    /// False only if a point's squared distance is more than `most`: the facet lies within its box, and within a disc around
    /// the foot of the box's middle.
    #[inline]
    pub(super) fn may_reach(&self, Relative { from, height }: Relative, most: f64) -> bool {
        let over: [f64; 3] = std::array::from_fn(|a| positive(from[a].abs() - self.half[a]));
        if dot(over, over) > most || height * height > most {
            return false;
        }
        let across = add_scaled(from, -(height + self.offset), self.normal);
        let (across, radius) =
            (dot(across, across), positive(dot(self.half, self.half) - self.offset * self.offset));
        // Beyond the disc, without roots: sqrt(across) - sqrt(radius) is the distance along the plane.
        let left = most - height * height;
        let beyond = across - radius - left;
        beyond <= 0.0 || beyond * beyond <= 4.0 * left * radius
    }

    /// The nearest point of the facet, and its squared distance.
    ///
    /// Among points `x` of the box with `m . x = k` the nearest to `p` is `clamp(p - l m)` for some `l`, and `m . x(l)` falls
    /// with `l`, in straight pieces between the six places where a coordinate meets a side of the box.
    #[inline]
    pub(super) fn nearest(&self, Relative { from, height }: Relative) -> (f64, [f64; 3]) {
        let foot = add_scaled(from, -height, self.normal);
        if (0..3).all(|a| foot[a].abs() <= self.half[a]) {
            return (height * height, add_scaled(self.middle, 1.0, foot));
        }
        let held = |l: f64| -> [f64; 3] {
            std::array::from_fn(|a| clamped(from[a] - l * self.normal[a], self.half[a]))
        };
        // Two kinks an axis, NaN or infinite along the plane, and their heights, NaN there.
        let kink = |k: usize| {
            let side = if k < 3 { -self.half[k % 3] } else { self.half[k % 3] };
            (from[k % 3] - side) / self.normal[k % 3]
        };
        let kinks = [0, 1, 2, 3, 4, 5].map(kink);
        let mut heights = [0.0; 6];
        for ((from, normal), half) in from.into_iter().zip(self.normal).zip(self.half) {
            for (l, height) in kinks.iter().zip(&mut heights) {
                *height += normal * clamped(from - l * normal, half);
            }
        }
        // The last kink over the plane and the first one below it.
        let (mut last, mut first) = ((f64::NEG_INFINITY, 0.0), (f64::INFINITY, 0.0));
        for (l, height) in kinks.into_iter().zip(heights) {
            let at = height - self.offset;
            if at >= 0.0 && l > last.0 {
                last = (l, at);
            }
            if at <= 0.0 && l < first.0 {
                first = (l, at);
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

    /// The two axes that the facet faces least, and the third.
    pub(super) fn axes(&self) -> [usize; 3] {
        let [x, y, z] = self.normal.map(f64::abs);
        let w = if x >= y && x >= z {
            0
        } else if y >= z {
            1
        } else {
            2
        };
        [(w + 1) % 3, (w + 2) % 3, w]
    }

    /// The corners of the facet along its first two axes, one after the other; some may be the same.
    ///
    /// The plane stays within the box where its rise along these axes is near the offset: the rectangle between two
    /// parallel lines. Of each side the part between them counts.
    #[inline]
    fn outline(&self, [u, v, w]: [usize; 3], mut each: impl FnMut([f64; 2])) {
        let (a, b) = (self.half[u], self.half[v]);
        let slack = 1e-12 * (a + b + self.half[w]);
        let reach = self.normal[w].abs() * self.half[w] + slack;
        let (least, most) = (self.offset - reach, self.offset + reach);
        let rise = |at: [f64; 2]| self.normal[u] * at[0] + self.normal[v] * at[1];
        let corners = [[-a, -b], [a, -b], [a, b], [-a, b]];
        let heights = corners.map(rise);
        for i in 0..4 {
            let after = (i + 1) % 4;
            let (from, to) = (heights[i], heights[after]);
            if from.max(to) < least || from.min(to) > most {
                continue;
            }
            let at = |height: f64| {
                let part = (height - from) / (to - from);
                [0, 1].map(|k| corners[i][k] + part * (corners[after][k] - corners[i][k]))
            };
            each(if from < least {
                at(least)
            } else if from > most {
                at(most)
            } else {
                corners[i]
            });
            if to < least {
                each(at(least));
            } else if to > most {
                each(at(most));
            }
        }
    }

    /// The place on the plane with these coordinates along the first two axes.
    fn lifted(&self, at: [f64; 2], [u, v, w]: [usize; 3]) -> [f64; 3] {
        let rise = (self.offset - self.normal[u] * at[0] - self.normal[v] * at[1]) * (1.0 / self.normal[w]);
        let mut place = self.middle;
        (place[u], place[v]) = (place[u] + at[0], place[v] + at[1]);
        place[w] += clamped(rise, self.half[w]);
        place
    }

    /// The corners of the facet.
    pub(crate) fn corners(&self, mut each: impl FnMut([f64; 3])) {
        let axes = self.axes();
        self.outline(axes, |corner| each(self.lifted(corner, axes)));
    }

    /// Area and centroid of the facet; of a facet that is a point or a line, the point nearest to the box's middle.
    #[inline]
    pub(crate) fn section(&self) -> (f64, [f64; 3]) {
        let (area, centroid) = self.section_by_heights();
        if area.is_nan() { self.section_by_corners() } else { (area, centroid) }
    }

    /// The same in closed form, without branches so that loops over facets vectorise; NaN for the area of slivers and
    /// planes along an axis, where rounding would show.
    #[inline(always)]
    pub(super) fn section_by_heights(&self) -> (f64, [f64; 3]) {
        // Values along the two axes that the facet faces least, and the third, as in `axes`.
        let [x, y, z] = [self.normal[0].abs(), self.normal[1].abs(), self.normal[2].abs()];
        let (is_x, is_y) = ((x >= y) & (x >= z), y >= z);
        let of_u = |v: [f64; 3]| select(is_x, v[1], select(is_y, v[2], v[0]));
        let of_v = |v: [f64; 3]| select(is_x, v[2], select(is_y, v[0], v[1]));
        let of_w = |v: [f64; 3]| select(is_x, v[0], select(is_y, v[1], v[2]));
        let (normal_u, normal_v, normal_w) = (of_u(self.normal), of_v(self.normal), of_w(self.normal));
        let (half_u, half_v, half_w) = (of_u(self.half), of_v(self.half), of_w(self.half));
        // Rise of the plane across the box along the two axes, and the heights over its lowest corner of the two lines.
        let (rise, other) = (2.0 * normal_u.abs() * half_u, 2.0 * normal_v.abs() * half_v);
        let (sum, reach) = (rise + other, normal_w.abs() * half_w);
        let low = least(positive(self.offset + sum / 2.0 - reach), sum);
        let high = least(positive(self.offset + sum / 2.0 + reach), sum);
        let steepness = 1.0 / normal_w;
        let face = 4.0 * half_u * half_v * steepness.abs();
        let is_whole = (high - low == sum) & (self.offset.abs() <= reach * (1.0 + 1e-12));
        let (low, high) = (below(low, rise, other), below(high, rise, other));
        let (area, first, second) = (high.0 - low.0, high.1 - low.1, high.2 - low.2);
        let whole = rise * other;
        let is_rounded = (rise < ROUNDED * other) | (other < ROUNDED * rise) | (area < ROUNDED * whole);
        let reciprocal = 1.0 / (area * whole);
        // Part of the way along an axis, 0 to 2.
        let at_u = half_u * (2.0 * (first * other) * reciprocal - 1.0);
        let at_v = half_v * (2.0 * (second * rise) * reciprocal - 1.0);
        let at_u = select(is_whole, 0.0, select(normal_u < 0.0, -at_u, at_u));
        let at_v = select(is_whole, 0.0, select(normal_v < 0.0, -at_v, at_v));
        let at_w = clamped((self.offset - normal_u * at_u - normal_v * at_v) * steepness, half_w);
        let area = select(is_rounded, f64::NAN, face * (area * area * reciprocal));
        let centroid = [
            self.middle[0] + select(is_x, at_w, select(is_y, at_v, at_u)),
            self.middle[1] + select(is_x, at_u, select(is_y, at_w, at_v)),
            self.middle[2] + select(is_x, at_v, select(is_y, at_u, at_w)),
        ];
        (select(is_whole, face, area), centroid)
    }

    /// The same from the corners.
    #[cold]
    pub(super) fn section_by_corners(&self) -> (f64, [f64; 3]) {
        let axes = self.axes();
        // Twice the area, and six times the moments, of the triangles between the first corner and two others.
        let (mut first, mut last) = (None, [0.0; 2]);
        let (mut twice, mut sum) = (0.0, [0.0; 2]);
        self.outline(axes, |corner| {
            let origin = *first.get_or_insert(corner);
            let next = [corner[0] - origin[0], corner[1] - origin[1]];
            let part = last[0] * next[1] - last[1] * next[0];
            twice += part;
            sum = [sum[0] + part * (last[0] + next[0]), sum[1] + part * (last[1] + next[1])];
            last = next;
        });
        let Some(origin) = first.filter(|_| twice > 0.0) else {
            return (0.0, self.nearest(self.relative(self.middle)).1);
        };
        let at = [0, 1].map(|k| origin[k] + sum[k] / (3.0 * twice));
        (twice / 2.0 / self.normal[axes[2]].abs(), self.lifted(at, axes))
    }
}

/// Area and moments of a section below a line, in units of rise: of the triangle at the lowest corner, without those beyond
/// the two sides.
#[inline(always)]
fn below(line: f64, rise: f64, other: f64) -> (f64, f64, f64) {
    let (all, across, along) = (positive(line), positive(line - rise), positive(line - other));
    let (two, two_across, two_along) = (all * all / 2.0, across * across / 2.0, along * along / 2.0);
    let cubes = (all * two - across * two_across - along * two_along) / 3.0;
    (two - two_across - two_along, cubes - rise * two_across, cubes - other * two_along)
}

#[inline(always)]
fn select(is_first: bool, first: f64, second: f64) -> f64 {
    if is_first { first } else { second }
}

/// The lesser of two numbers that are not NaN.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// A number, or 0 in place of a negative one.
#[inline]
fn positive(number: f64) -> f64 {
    if number > 0.0 { number } else { 0.0 }
}

/// A number no farther from 0 than `most`; NaN stays NaN.
#[inline]
fn clamped(number: f64, most: f64) -> f64 {
    let number = if number < -most { -most } else { number };
    if number > most { most } else { number }
}

#[inline]
pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
