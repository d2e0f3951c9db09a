//! Is a point within a distance of a surface?

use crate::geom::{Nearest, add_scaled, cross, dot, nearest_on_triangle};

/// Cells of the grid along each axis.
const CELLS: usize = 12;

/// A triangle made ready for many points.
pub(super) struct Facet {
    a: [f64; 3],
    ab: [f64; 3],
    ac: [f64; 3],
    products: [f64; 3],
}

/// A triangle of a cell: its number, and the box of the points that may be near to it, from the grid's corner.
struct Item {
    low: [f32; 3],
    high: [f32; 3],
    number: u32,
}

impl Item {
    #[inline(always)]
    fn may_be_near(&self, p: [f32; 3]) -> bool {
        (0..3).all(|a| self.low[a] <= p[a] && p[a] <= self.high[a])
    }
}

impl Facet {
    pub(super) fn new([a, b, c]: [[f64; 3]; 3]) -> Self {
        let (ab, ac) = (add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
        Self { a, ab, ac, products: [dot(ab, ab), dot(ab, ac), dot(ac, ac)] }
    }

    /// The box around it.
    pub(super) fn span(&self) -> [[f64; 3]; 2] {
        let corners = [self.a, add_scaled(self.a, 1.0, self.ab), add_scaled(self.a, 1.0, self.ac)];
        let of = |fold: fn(f64, f64) -> f64| {
            std::array::from_fn(|a| corners.map(|p| p[a]).into_iter().reduce(fold).unwrap_or(0.0))
        };
        [of(f64::min), of(f64::max)]
    }

    /// Of length 1; NaN without an area.
    fn normal(&self) -> [f64; 3] {
        let normal = cross(self.ab, self.ac);
        let length = dot(normal, normal).sqrt();
        normal.map(|c| c / length)
    }

    /// Squared distance of a point.
    #[inline]
    pub(super) fn square(&self, p: [f64; 3]) -> f64 {
        let ap = add_scaled(p, -1.0, self.a);
        let [v, w] = match nearest_on_triangle([dot(self.ab, ap), dot(self.ac, ap)], self.products) {
            Nearest::Border(weights) => weights,
            Nearest::Face([va, vb, vc]) => [vb, vc].map(|area| area / (va + vb + vc)),
        };
        let away = add_scaled(add_scaled(ap, -v, self.ab), -w, self.ac);
        dot(away, away)
    }
}

/// Triangles by the cells of a grid that they come near to.
///
/// Memory: 96 bytes a triangle, and 28 for each of its cells. Cost of a point: the triangles of its cell.
pub(super) struct Near {
    low: [f64; 3],
    /// Cells a mm.
    scale: [f64; 3],
    facets: Vec<Facet>,
    /// Where each cell begins in `items`.
    starts: Vec<u32>,
    items: Vec<Item>,
    within: f64,
    /// The triangle that was near the last point.
    last: usize,
}

impl Near {
    /// Triangles for points of a box that are asked whether they lie `within` so many mm.
    pub(super) fn new(
        [low, high]: [[f64; 3]; 2],
        within: f64,
        triangles: impl Iterator<Item = [[f64; 3]; 3]>,
    ) -> Self {
        let side: [f64; 3] = std::array::from_fn(|a| (high[a] - low[a]).max(within) / CELLS as f64);
        let facets: Vec<Facet> = triangles.map(Facet::new).collect();
        let mut near = Self {
            low,
            scale: side.map(|side| 1.0 / side),
            facets,
            starts: vec![0; CELLS * CELLS * CELLS + 1],
            items: Vec::new(),
            within,
            last: 0,
        };
        let mut pairs = Vec::new();
        for (number, facet) in (0_u32..).zip(&near.facets) {
            near.cells(facet, side, &mut |cell| pairs.push((cell, number)));
        }
        pairs.sort_unstable();
        for (cell, _) in &pairs {
            near.starts[cell + 1] += 1;
        }
        for cell in 1..near.starts.len() {
            near.starts[cell] += near.starts[cell - 1];
        }
        // More than coordinates err in single precision.
        let reach = within + 1e-5 * side.into_iter().fold(0.0, f64::max);
        let item = |(_, number): (usize, u32)| {
            let [lows, highs] = near.facets[number as usize].span();
            let local = |at: f64, axis: usize| single(at - near.low[axis]);
            let low = std::array::from_fn(|a| local(lows[a] - reach, a));
            let high = std::array::from_fn(|a| local(highs[a] + reach, a));
            Item { low, high, number }
        };
        near.items = pairs.into_iter().map(item).collect();
        near
    }

    /// The cells within the reach of a triangle, or some more.
    fn cells(&self, facet: &Facet, side: [f64; 3], work: &mut dyn FnMut(usize)) {
        // How far a point near to a cell's lies from its middle.
        let reach = self.within + 0.5 * dot(side, side).sqrt();
        let normal = facet.normal();
        let [low, high] = facet.span();
        let ranges =
            [0, 1, 2].map(|a| self.place(low[a] - self.within, a)..=self.place(high[a] + self.within, a));
        let [xs, ys, zs] = ranges;
        for z in zs {
            for y in ys.clone() {
                for x in xs.clone() {
                    let cell = [x, y, z];
                    let middle = std::array::from_fn(|a| self.low[a] + (cell[a] as f64 + 0.5) * side[a]);
                    let along = dot(normal, add_scaled(middle, -1.0, facet.a));
                    // Also where there is none.
                    if along.abs() <= reach || along.is_nan() {
                        work((z * CELLS + y) * CELLS + x);
                    }
                }
            }
        }
    }

    /// The cell of a coordinate.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by the cells")]
    fn place(&self, at: f64, axis: usize) -> usize {
        ((at - self.low[axis]) * self.scale[axis]).clamp(0.0, (CELLS - 1) as f64) as usize
    }

    /// Does the point lie as near to the triangles as was asked?
    pub(super) fn holds(&mut self, p: [f64; 3]) -> bool {
        let is_near = |number: usize| self.facets[number].square(p) <= self.within * self.within;
        if self.last < self.facets.len() && is_near(self.last) {
            return true;
        }
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| self.place(p[a], a));
        let cell = (z * CELLS + y) * CELLS + x;
        let [start, end] = [cell, cell + 1].map(|cell| self.starts[cell] as usize);
        let local = add_scaled(p, -1.0, self.low).map(single);
        let candidates = self.items[start..end].iter().filter(|item| item.may_be_near(local));
        let found = candidates.map(|item| item.number as usize).find(|number| is_near(*number));
        if let Some(number) = found {
            self.last = number;
        }
        found.is_some()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a coordinate in single precision")]
fn single(v: f64) -> f32 {
    v as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_near_where_a_dense_search_says_so() {
        let mut state = 5_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) * 10.0
        };
        let triangles: Vec<[[f64; 3]; 3]> =
            (0..20).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next()))).collect();
        let within = 0.7;
        let mut near = Near::new([[0.0; 3], [10.0; 3]], within, triangles.iter().copied());
        let (mut inside, mut outside) = (0, 0);
        for _ in 0..2000 {
            let p = std::array::from_fn(|_| next());
            let mut least = f64::INFINITY;
            for [a, b, c] in &triangles {
                let steps = 40;
                for i in 0..=steps {
                    for j in 0..=steps - i {
                        let [v, w] = [i, j].map(|n| f64::from(n) / f64::from(steps));
                        let at: [f64; 3] =
                            std::array::from_fn(|k| a[k] + v * (b[k] - a[k]) + w * (c[k] - a[k]) - p[k]);
                        least = least.min(dot(at, at).sqrt());
                    }
                }
            }
            // The search's points lie up to a fifth apart.
            if least <= within {
                assert!(near.holds(p), "{p:?} {least}");
                inside += 1;
            } else if least > within + 0.2 {
                assert!(!near.holds(p), "{p:?} {least}");
                outside += 1;
            }
        }
        assert!(inside > 300 && outside > 300, "{inside} {outside}");
    }
}
