//! A ray and the surface within a cell: a plane, or the trilinear interpolation of eight corners.
//!
//! A hit is decided by the ray's points of entry and exit. A cell is hit where the ray is inside as it enters, or else
//! where it comes to be inside on its way. The plane's side of a point of entry or exit is a sign of integers: with
//! `o`, `d` the ray's and `n / c` the time of the crossing, the sign of `sum N_a ((o_a - middle_a) c + d_a n) - offset
//! 2^15 c`. Within the cell each bracket is at most `2^15 c`, so the sum stays below 2^53 and sums that wrap on the way
//! do no harm.
//!
//! The time of a crossing within is one division of two integers that doubles hold exactly; it is off by less
//! than 2^-36 cell along the ray in the largest grid.
//!
//! Along a ray the interpolation of corners is a cubic. Most rays are decided quickly, by its values at the points of
//! entry and exit and its Bernstein coefficients. Others are followed in doubles by operations in a fixed order: every
//! form and machine finds the same. On a face whose corners are all inside it is at least 1, so rounding opens no gap.

use crate::format::cell::{CORNERS, Plane};
use crate::geom::dot;
use crate::load::{CellItems, CellShape, ModelView, NodeView};

use super::ray::{FRACTION_BITS, Ray};
use super::surface::{Approach, Crossing, Estimate, Glance, Passage, Surface};
use super::traverse::Hit;
use super::walls::{self, Hidden};

/// The larger of two numbers, without the rules of [`f64::max`] for NaN.
#[inline(always)]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, like [`larger`].
#[inline(always)]
pub(super) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Half the edge of a cell in units of a ray's origin.
pub(super) const HALF_CELL: i64 = 1 << (FRACTION_BITS - 1);
/// [`HALF_CELL`] as a double.
const HALF: f64 = HALF_CELL as f64;

/// Square of the least cosine, in index space, between the stored direction of a cell with corners and the direction of
/// its surface at the hit: 60 degrees, as where normals are blended.
const NEAR_OWN: f64 = 0.25;

/// Cells between samples, each with the surface within it; boxes above them count as solid.
#[derive(Clone, Copy, Debug)]
pub struct Cells<'a> {
    items: CellItems<'a>,
    /// Hidden labels, and the label that rays start in; `None` if rays start in background and all labels are visible.
    hidden: Option<(&'a Hidden, u16)>,
}

impl<'a> Cells<'a> {
    /// The surface of a model of cells.
    pub fn new(items: CellItems<'a>) -> Self {
        Self { items, hidden: None }
    }

    /// The same surface for rays within the label `from` that do not see hidden labels: a hit is an entry into another
    /// label.
    pub(crate) fn hiding(self, hidden: &'a Hidden, from: u16) -> Self {
        Self { hidden: Some((hidden, from)), ..self }
    }

    /// Outward direction in index space, of any length, at a point of a cell in its own coordinates (-1..=1).
    ///
    /// For a cell with corners, its stored direction, which is smooth, as long as it is near the surface's own at that
    /// point; there may be two surfaces in the cell.
    pub fn normal(&self, cell: u64, u: [f64; 3]) -> [f64; 3] {
        let stored = self.items.normal(cell).map(f64::from);
        match self.items.shape(cell) {
            CellShape::Plane(_) => stored,
            CellShape::Corners(corners) => {
                let own = Trilinear::new(corners).gradient(u).map(|c| -c);
                let along = dot(stored, own);
                let is_near = along * along >= NEAR_OWN * dot(stored, stored) * dot(own, own);
                if along >= 0.0 && is_near { stored } else { own }
            }
        }
    }

    /// The stored items of the cells.
    pub(crate) fn items(&self) -> CellItems<'a> {
        self.items
    }

    /// True if the cell has corners instead of a plane.
    #[inline]
    pub(crate) fn has_corners(&self, cell: u64) -> bool {
        self.items.plane(cell).is_none()
    }
}

impl Surface for Cells<'_> {
    const SOLID: bool = false;

    #[inline(always)]
    fn predict(&self, view: &ModelView<'_>, approach: &Approach) -> Estimate {
        if self.hidden.is_some() {
            return Estimate::Unsure;
        }
        let Some(plane) = self.items.plane(approach.box_number.wrapping_sub(view.node_count())) else {
            return Estimate::Unsure;
        };
        let (start, slope) = along(&plane, approach);
        // Crossing of the ray with the plane, from the middle of the cell and times the slope's size; for a ray that
        // comes to be in front of the plane instead of behind it, as seen from the other end.
        let at = each3!(A => approach.direction[A] * start - approach.from_middle[A] * slope);
        let half = HALF * slope.abs();
        let farthest = larger(larger(at[0], at[1]), at[2]);
        if farthest > half + CROSSING_SLACK {
            // Beyond an exit face: the ray is in front of the plane until then.
            return Estimate::Past;
        }
        let nearest = smaller(smaller(at[0], at[1]), at[2]);
        if (slope < 0.0)
            & (start > 0.0)
            & (farthest < half - CROSSING_SLACK)
            & (nearest > CROSSING_SLACK - half)
        {
            return Estimate::Within { distance: start, component: -slope };
        }
        Estimate::Unsure
    }

    #[inline(always)]
    fn planes(&self) -> Option<CellItems<'_>> {
        self.hidden.is_none().then_some(self.items)
    }

    #[inline]
    fn look(&self, view: &ModelView<'_>, glance: &Glance) -> Estimate {
        let cell = glance.approach.box_number.wrapping_sub(view.node_count());
        if self.hidden.is_some() {
            return Estimate::Unsure;
        }
        let Some(plane) = self.items.plane(cell) else {
            if self.items.has_walls() {
                return Estimate::Unsure;
            }
            return look_at_corners(self.items.corners(cell), glance);
        };
        // Times are at most 2^5 and off by 2^-40, so that the following values are off by less than a unit.
        let (start, slope) = along(&plane, &glance.approach);
        let (first, last) = (start + slope * glance.enter, start + slope * glance.leave);
        if first < -1.0 {
            Estimate::Entry
        } else if first > 1.0 && last > 1.0 {
            Estimate::Past
        } else if first > 1.0 && last < -1.0 {
            Estimate::Within { distance: start, component: -slope }
        } else {
            Estimate::Unsure
        }
    }

    #[inline]
    fn meet(&self, view: &ModelView<'_>, ray: &Ray, passage: &Passage) -> Option<Hit> {
        if passage.edge_log2 > 0 {
            return Some(passage.entry_hit(ray));
        }
        let cell = passage.box_number.wrapping_sub(view.node_count());
        if let Some((hidden, from)) = self.hidden {
            return walls::meet(&view.walls(cell)?, |label| hidden.seen(label), from, ray, passage);
        }
        match self.items.plane(cell) {
            Some(plane) => meet_plane(&plane, ray, passage),
            None if self.items.has_walls() => walls::meet(&view.walls(cell)?, |label| label, 0, ray, passage),
            None => meet_corners(self.items.corners(cell), ray, passage),
        }
    }
}

/// Error bound of a ray's crossing with a plane, times the slope: products below 2^71, rounded to 53 bits.
pub(super) const CROSSING_SLACK: f64 = (1_u64 << 20) as f64;

/// Distance of a ray's start in front of a plane, and its change along the ray: integers below 2^42, exact.
#[inline(always)]
fn along(plane: &Plane, approach: &Approach) -> (f64, f64) {
    let n = each3!(A => {
        let n = f64::from(plane.normal[A]);
        if approach.mirror >> A & 1 == 1 { -n } else { n }
    });
    let (from, d) = (approach.from_middle, approach.direction);
    (
        n[0] * from[0] + n[1] * from[1] + n[2] * from[2] - f64::from(plane.offset) * HALF,
        n[0] * d[0] + n[1] * d[1] + n[2] * d[2],
    )
}

/// The moment when a ray starts.
const START: Crossing = Crossing { axis: 0, distance: 0, component: 1 };

/// Vector from the middle of a cell to the ray's origin.
#[inline(always)]
fn from_middle(ray: &Ray, cell: [u32; 3]) -> [i64; 3] {
    let origin = ray.origin();
    std::array::from_fn(|a| origin[a] - (i64::from(cell[a]) << FRACTION_BITS) - HALF_CELL)
}

/// Hit of the ray with the space behind a plane, in a cell or a larger leaf.
#[inline]
pub(super) fn meet_plane(plane: &Plane, ray: &Ray, passage: &Passage) -> Option<Hit> {
    let side = Side::new(plane, ray, passage);
    if side.at_entry() <= 0 {
        return Some(passage.entry_hit(ray));
    }
    if side.at_exit() > 0 {
        return None;
    }
    let Passage { box_number, cell, edge_log2, .. } = *passage;
    Some(Hit { box_number, cell, edge_log2, face: None, t: side.crossing(ray) })
}

/// The side of a plane on which a ray is, on its way through a box.
pub(super) struct Side<'p> {
    passage: &'p Passage,
    /// Vector from the middle of the box to the ray's origin, and the ray's direction.
    from: [i64; 3],
    direction: [i64; 3],
    normal: [i64; 3],
    offset: i64,
}

impl<'p> Side<'p> {
    #[inline]
    pub(super) fn new(plane: &Plane, ray: &Ray, passage: &'p Passage) -> Self {
        let half = HALF_CELL << (passage.edge_log2 & 31);
        let origin = ray.origin();
        let low = |a: usize| i64::from(passage.cell[a]) << FRACTION_BITS;
        Self {
            passage,
            from: std::array::from_fn(|a| origin[a] - low(a) - half),
            direction: ray.direction(),
            normal: plane.normal.map(i64::from),
            offset: i64::from(plane.offset) * half,
        }
    }

    #[inline]
    fn at(&self, at: &Crossing) -> i64 {
        let (from, d) = (self.from, self.direction);
        (0..3).fold(self.offset.wrapping_mul(at.component).wrapping_neg(), |sum, a| {
            let within = from[a].wrapping_mul(at.component).wrapping_add(d[a].wrapping_mul(at.distance));
            sum.wrapping_add(self.normal[a].wrapping_mul(within))
        })
    }

    /// Positive if the ray enters in front of the plane.
    #[inline]
    pub(super) fn at_entry(&self) -> i64 {
        self.at(self.passage.enter.as_ref().unwrap_or(&START))
    }

    /// Positive if it leaves in front of the plane.
    #[inline]
    pub(super) fn at_exit(&self) -> i64 {
        self.at(&self.passage.leave)
    }

    /// t at the crossing with the plane, which must exist.
    #[inline]
    pub(super) fn crossing(&self, ray: &Ray) -> f64 {
        let dot = |v: [i64; 3]| self.normal[0] * v[0] + self.normal[1] * v[1] + self.normal[2] * v[2];
        let (distance, component) = (dot(self.from) - self.offset, -dot(self.direction));
        if component < 0 { ray.t_after(-distance, -component) } else { ray.t_after(distance, component) }
    }
}

/// Values of an interpolation above which a point is certainly inside, and below minus which it is outside: points of
/// entry and exit are off by less than 2^-20 of the cell, and values change by 381 over it at most.
const SURELY: f64 = 0.01;

/// Quick test of a cell with corners.
#[inline(never)]
fn look_at_corners(corners: [i8; CORNERS], glance: &Glance) -> Estimate {
    let mirror = glance.approach.mirror as usize & (CORNERS - 1);
    let field = Trilinear::new(std::array::from_fn(|c| corners[c ^ mirror]));
    let point = |t: f64| -> [f64; 3] {
        std::array::from_fn(|a| {
            (glance.approach.from_middle[a] + glance.approach.direction[a] * t) * (1.0 / HALF)
        })
    };
    let (first, last) = (point(glance.enter), point(glance.leave));
    let at_first = field.at(first);
    if at_first > SURELY {
        return Estimate::Entry;
    }
    let at_last = field.at(last);
    let slope = |at: [f64; 3]| {
        let g = field.gradient(at);
        g[0] * (last[0] - first[0]) + g[1] * (last[1] - first[1]) + g[2] * (last[2] - first[2])
    };
    // A cubic lies below the greatest of its four Bernstein coefficients.
    let (second, third) = (at_first + slope(first) * (1.0 / 3.0), at_last - slope(last) * (1.0 / 3.0));
    let is_below = [at_first, second, third, at_last].iter().all(|c| *c < -SURELY);
    if is_below { Estimate::Past } else { Estimate::Unsure }
}

/// Hit of the ray with the inside of a trilinear interpolation.
#[inline(never)]
fn meet_corners(corners: [i8; CORNERS], ray: &Ray, passage: &Passage) -> Option<Hit> {
    let (from, d) = (from_middle(ray, passage.cell), ray.direction());
    #[expect(clippy::cast_precision_loss, reason = "below 2^53 within the cell")]
    let point = |at: &Crossing| -> [f64; 3] {
        std::array::from_fn(|a| {
            let within = from[a].wrapping_mul(at.component).wrapping_add(d[a].wrapping_mul(at.distance));
            within as f64 / (HALF_CELL.wrapping_mul(at.component)) as f64
        })
    };
    let field = Trilinear::new(corners);
    let enter = passage.enter.as_ref().unwrap_or(&START);
    let (first, last) = (point(enter), point(&passage.leave));
    if field.at(first) >= 0.0 {
        return Some(passage.entry_hit(ray));
    }
    let along = field.first_inside(first, last)?;
    let (t_enter, t_leave) = (
        ray.t_after(enter.distance, enter.component),
        ray.t_after(passage.leave.distance, passage.leave.component),
    );
    let Passage { box_number, cell, edge_log2, .. } = *passage;
    Some(Hit { box_number, cell, edge_log2, face: None, t: t_enter + along * (t_leave - t_enter) })
}

/// Interpolation between eight corners: coefficients of products of coordinates, which the bits of the index select.
struct Trilinear([f64; CORNERS]);

/// Steps of the search for a root, each at least halving an interval or far better.
const ROOT_STEPS: u32 = 40;
/// Width at which the search ends, as a part of the way through the cell.
const ROOT_CLOSE: f64 = 1.0 / (1_u64 << 32) as f64;

impl Trilinear {
    fn new(corners: [i8; CORNERS]) -> Self {
        // For corners at -1 and 1, the coefficient of a product is the mean of the corners with its signs. Computed
        // axis by axis: sums, and differences of the high and the low one.
        let mut sums = corners.map(i32::from);
        for axis in 0..3 {
            let before = sums;
            for (term, sum) in sums.iter_mut().enumerate() {
                let (low, high) = (before[term & !(1 << axis)], before[term | 1 << axis]);
                *sum = if term >> axis & 1 == 1 { high - low } else { high + low };
            }
        }
        Self(sums.map(|sum| f64::from(sum) * 0.125))
    }

    fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let c = &self.0;
        let low = c[0] + x * c[1] + y * (c[2] + x * c[3]);
        let high = c[4] + x * c[5] + y * (c[6] + x * c[7]);
        low + z * high
    }

    /// Direction of rising values.
    fn gradient(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let c = &self.0;
        [
            c[1] + y * c[3] + z * (c[5] + y * c[7]),
            c[2] + x * c[3] + z * (c[6] + x * c[7]),
            c[4] + x * c[5] + y * (c[6] + x * c[7]),
        ]
    }

    /// The first position with a value of at least 0 on the way from `first` (0), where it is negative, to `last` (1),
    /// where it is not.
    fn first_inside(&self, first: [f64; 3], last: [f64; 3]) -> Option<f64> {
        let step: [f64; 3] = std::array::from_fn(|a| last[a] - first[a]);
        let place = |s: f64| -> [f64; 3] {
            if s == 1.0 { last } else { std::array::from_fn(|a| first[a] + s * step[a]) }
        };
        let value = |s: f64| self.at(place(s));
        // The derivative along the way is a quadratic: the value turns at its zeros.
        let slope = |s: f64| {
            let g = self.gradient(place(s));
            g[0] * step[0] + g[1] * step[1] + g[2] * step[2]
        };
        let (at_first, at_middle, at_last) = (slope(0.0), slope(0.5), slope(1.0));
        let mut stops = [1.0; 3];
        for (stop, turn) in stops.iter_mut().zip(turns(at_first, at_middle, at_last)) {
            *stop = turn;
        }
        let mut low = 0.0;
        for high in stops {
            if value(high) >= 0.0 {
                return Some(root(low, high, value, slope));
            }
            low = high;
        }
        None
    }
}

/// Zeros between 0 and 1, rising, of a quadratic with these values at 0, 1/2 and 1; 1 for a missing one.
fn turns(first: f64, middle: f64, last: f64) -> [f64; 2] {
    let a = 2.0 * (first + last) - 4.0 * middle;
    let b = last - first - a;
    let within = |s: f64| if s > 0.0 && s < 1.0 { s } else { 1.0 };
    let discriminant = b * b - 4.0 * a * first;
    if discriminant < 0.0 {
        return [1.0; 2];
    }
    // Without cancellation: one root by the sum of terms with like signs, the other by their product.
    let sum = -0.5 * (b + discriminant.sqrt().copysign(b));
    let (one, other) = (within(sum / a), within(first / sum));
    if one < other { [one, other] } else { [other, one] }
}

/// Position where a function that rises from below 0 at `low` to 0 or more at `high` reaches 0.
fn root(low: f64, high: f64, value: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (low, high);
    let mut at = 0.5 * (low + high);
    for _ in 0..ROOT_STEPS {
        let here = value(at);
        if here >= 0.0 {
            high = at;
        } else {
            low = at;
        }
        if high - low <= ROOT_CLOSE {
            break;
        }
        let newton = at - here / slope(at);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - at).abs() <= ROOT_CLOSE {
            return next;
        }
        at = next;
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interpolation_has_its_corners_and_its_slope() {
        let corners = [5, -3, 100, -127, 1, 2, -1, 88];
        let field = Trilinear::new(corners);
        for (i, corner) in corners.iter().enumerate() {
            let u = std::array::from_fn(|a| if i >> a & 1 == 1 { 1.0 } else { -1.0 });
            assert_eq!(field.at(u), f64::from(*corner));
        }
        let (u, h) = ([0.3, -0.6, 0.1], 1e-5);
        let g = field.gradient(u);
        for (a, g) in g.into_iter().enumerate() {
            let moved = |s: f64| std::array::from_fn(|b| if a == b { u[b] + s * h } else { u[b] });
            let want = (field.at(moved(1.0)) - field.at(moved(-1.0))) / (2.0 * h);
            assert!((g - want).abs() < 1e-5);
        }
    }

    #[test]
    fn the_first_root_is_found_as_by_small_steps() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let mut hits = 0;
        for _ in 0..3000 {
            let corners = std::array::from_fn(|_| {
                let c = i8::try_from(random() % 127).unwrap() + 1;
                if random() % 2 == 0 { c } else { -c }
            });
            let field = Trilinear::new(corners);
            let mut point =
                || std::array::from_fn(|_| f64::from(u32::try_from(random() % 2001).unwrap()) / 1000.0 - 1.0);
            let (first, last): ([f64; 3], [f64; 3]) = (point(), point());
            if field.at(first) >= 0.0 {
                continue;
            }
            let at = |s: f64| field.at(std::array::from_fn(|a| first[a] + s * (last[a] - first[a])));
            let steps = 4000;
            let want = (1..=steps).map(|i| f64::from(i) / f64::from(steps)).find(|s| at(*s) >= 0.0);
            match (field.first_inside(first, last), want) {
                (Some(got), Some(want)) => {
                    assert!(got <= want + 1e-9 && at(got).abs() < 1e-5, "{corners:?} {got} {want}");
                    hits += 1;
                }
                // A touching point between two steps.
                (Some(got), None) => assert!(at(got).abs() < 1e-5),
                (None, Some(want)) => panic!("{corners:?} {first:?} {last:?} {want}"),
                (None, None) => {}
            }
        }
        assert!(hits > 500);
    }
}
