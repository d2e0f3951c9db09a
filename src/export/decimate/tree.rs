//! How far a point is from triangles: a tree of boxes around them.

use super::number;
use crate::geom::{Nearest, add_scaled, dot, nearest_on_triangle};

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// In place of the second half of a leaf.
const NO_HALF: u32 = u32::MAX;

/// A triangle made ready for many points.
pub(super) struct Facet {
    a: [f64; 3],
    ab: [f64; 3],
    ac: [f64; 3],
    products: [f64; 3],
}

impl Facet {
    pub(super) fn new([a, b, c]: [[f64; 3]; 3]) -> Self {
        let (ab, ac) = (add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
        Self { a, ab, ac, products: [dot(ab, ab), dot(ab, ac), dot(ac, ac)] }
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

/// Triangles in a tree of boxes, halved along their longest axis.
///
/// Memory: some 60 bytes a triangle. Cost: a microsecond a point.
pub(super) struct Tree {
    triangles: Vec<[[f32; 3]; 3]>,
    nodes: Vec<Node>,
    /// Greatest coordinate.
    size: f32,
}

/// Three numbers, and 0: as many as processors take at a time.
type Four = [f32; 4];

/// A box: of a leaf the number of its first triangle; else its first half follows it, and `second` is the other.
struct Node {
    low: [f32; 3],
    first: u32,
    high: [f32; 3],
    second: u32,
}

impl Node {
    fn sides(&self) -> [Four; 2] {
        [self.low, self.high].map(|[x, y, z]| [x, y, z, 0.0])
    }
}

/// A point, and places on both sides of it in single precision, more than any rounding apart.
struct Query {
    p: [f64; 3],
    above: Four,
    below: Four,
}

impl Query {
    #[expect(clippy::cast_possible_truncation, reason = "to single precision")]
    fn new(p: [f64; 3], size: f32) -> Self {
        let [x, y, z] = p.map(|c| c as f32);
        let slack = 8.0 * f32::EPSILON * [x, y, z].iter().fold(size, |most, c| most.max(c.abs()));
        let near = |slack: f32| [x + slack, y + slack, z + slack, 0.0];
        Self { p, above: near(slack), below: near(-slack) }
    }

    /// Squared distance from a box, at most the distance to the points in it but for the last bits.
    #[inline(always)]
    fn square(&self, [low, high]: [Four; 2]) -> f32 {
        let greater = |a: f32, b: f32| if a > b { a } else { b };
        let over: Four =
            std::array::from_fn(|k| greater(greater(low[k] - self.above[k], self.below[k] - high[k]), 0.0));
        (over[0] * over[0] + over[1] * over[1]) + (over[2] * over[2] + over[3] * over[3])
    }
}

/// Part by which a squared distance in single precision may be too great.
const LAST_BITS: f64 = 1.0 + 1e-6;

impl Tree {
    pub(super) fn new(mut triangles: Vec<[[f32; 3]; 3]>) -> Self {
        let (mut nodes, [low, high]) = (Vec::new(), around(triangles.as_flattened()));
        let sides = std::array::from_fn(|k| high[k] - low[k]);
        split(&mut nodes, &mut triangles, 0, sides);
        let size = low.iter().chain(&high).fold(0.0_f32, |most, c| most.max(c.abs()));
        Self { triangles, nodes, size }
    }

    /// Squared distance of a point, infinite without triangles, or a distance no greater than `enough` if it is no greater
    /// either; `seed`: the triangle that was nearest to a point before.
    pub(super) fn square(&self, p: [f64; 3], seed: &mut usize, enough: f64) -> f64 {
        let mut best = self.triangles.get(*seed).map_or(f64::INFINITY, |triangle| square(triangle, p));
        if best > enough {
            self.descend(0, &Query::new(p, self.size), &mut best, seed, enough);
        }
        best
    }

    /// The middle of a triangle, as of a point without triangles.
    pub(super) fn middle(&self, number: usize) -> [f32; 3] {
        let [a, b, c] = self.triangles.get(number).copied().unwrap_or_default();
        std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0)
    }

    fn descend(&self, at: usize, query: &Query, best: &mut f64, seed: &mut usize, enough: f64) {
        let Some(node) = self.nodes.get(at) else { return };
        if *best <= enough {
            return;
        }
        if node.second == NO_HALF {
            let first = node.first as usize;
            // Where a leaf has fewer, triangles of the next one do no harm.
            let end = (first + LEAF).min(self.triangles.len());
            for (number, triangle) in (first..end).zip(&self.triangles[first..end]) {
                if f64::from(query.square(around(triangle))) < *best * LAST_BITS {
                    let square = square(triangle, query.p);
                    if square < *best {
                        (*best, *seed) = (square, number);
                    }
                }
            }
            return;
        }
        let (one, other) = (at + 1, node.second as usize);
        let mut halves = [one, other].map(|half| (query.square(self.nodes[half].sides()), half));
        if halves[1].0 < halves[0].0 {
            halves.swap(0, 1);
        }
        for (square, half) in halves {
            if f64::from(square) < *best * LAST_BITS {
                self.descend(half, query, best, seed, enough);
            }
        }
    }
}

/// Squared distance of a point from a triangle.
#[inline]
fn square([a, b, c]: &[[f32; 3]; 3], p: [f64; 3]) -> f64 {
    Facet::new([double(a), double(b), double(c)]).square(p)
}

#[inline(always)]
fn double([x, y, z]: &[f32; 3]) -> [f64; 3] {
    [f64::from(*x), f64::from(*y), f64::from(*z)]
}

/// The box around some places, without any a place.
#[inline(always)]
fn around(places: &[[f32; 3]]) -> [Four; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
    for [x, y, z] in places {
        let place = [*x, *y, *z, 0.0];
        for k in 0..4 {
            low[k] = if place[k] < low[k] { place[k] } else { low[k] };
            high[k] = if place[k] > high[k] { place[k] } else { high[k] };
        }
    }
    [low, high]
}

/// Adds the node of some triangles, the first of which has this number; `sides`: about those of their box.
fn split(nodes: &mut Vec<Node>, triangles: &mut [[[f32; 3]; 3]], first: usize, mut sides: Four) {
    let at = nodes.len();
    let leaf = around(if triangles.len() <= LEAF { triangles.as_flattened() } else { &[] });
    let [low, high] = leaf.map(|[x, y, z, _]| [x, y, z]);
    nodes.push(Node { low, first: number(first), high, second: NO_HALF });
    if triangles.len() <= LEAF {
        return;
    }
    let axis = (0..3).max_by(|a, b| sides[*a].total_cmp(&sides[*b])).unwrap_or(0);
    sides[axis] *= 0.5;
    let half = triangles.len() / 2;
    let middle = |triangle: &[[f32; 3]; 3]| triangle.iter().map(|corner| corner[axis]).sum::<f32>();
    triangles.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (low, high) = triangles.split_at_mut(half);
    split(nodes, low, first, sides);
    let other = nodes.len();
    split(nodes, high, first + half, sides);
    let halves = [at + 1, other].map(|half| &nodes[half]);
    let [low, high] = around(&[halves[0].low, halves[0].high, halves[1].low, halves[1].high]);
    let [low, high] = [low, high].map(|[x, y, z, _]| [x, y, z]);
    nodes[at] = Node { low, first: number(first), high, second: number(other) };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn distances_are_those_of_all_triangles() {
        let mut random = Random(5);
        let mut next = || random.below(1_u32 << 24) as f32 / (1 << 24) as f32 * 10.0;
        for count in [0, 1, 5, 300] {
            let triangles: Vec<[[f32; 3]; 3]> =
                (0..count).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next()))).collect();
            let (tree, mut seed) = (Tree::new(triangles.clone()), 0);
            for _ in 0..300 {
                let p = std::array::from_fn(|_| f64::from(next() * 2.0 - 5.0));
                let due = triangles.iter().map(|t| square(t, p)).fold(f64::INFINITY, f64::min);
                assert!(tree.square(p, &mut seed, 0.0) == due, "{p:?}");
                let within = tree.square(p, &mut seed, 4.0);
                assert!(within == due || due <= within && within <= 4.0, "{p:?}");
            }
        }
    }
}
