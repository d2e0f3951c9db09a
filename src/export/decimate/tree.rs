//! How far a point is from triangles: a tree of boxes around them.

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
}

/// A box: of a leaf the number of its first triangle; else its first half follows it, and `second` is the other.
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    first: u32,
    second: u32,
}

impl Node {
    fn square(&self, p: [f64; 3]) -> f64 {
        box_square([self.low, self.high], p)
    }
}

fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(NO_HALF)
}

impl Tree {
    pub(super) fn new(mut triangles: Vec<[[f32; 3]; 3]>) -> Self {
        let mut nodes = Vec::new();
        split(&mut nodes, &mut triangles, 0);
        Self { triangles, nodes }
    }

    /// Squared distance of a point, infinite without triangles, or a distance no greater than `enough` if it is no greater
    /// either; `seed`: the triangle that was nearest to a point before.
    pub(super) fn square(&self, p: [f64; 3], seed: &mut usize, enough: f64) -> f64 {
        let mut best = self.triangles.get(*seed).map_or(f64::INFINITY, |triangle| square(triangle, p));
        self.descend(0, p, &mut best, seed, enough);
        best
    }

    /// The middle of a triangle, as of a point without triangles.
    pub(super) fn middle(&self, number: usize) -> [f32; 3] {
        let [a, b, c] = self.triangles.get(number).copied().unwrap_or_default();
        std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0)
    }

    fn descend(&self, at: usize, p: [f64; 3], best: &mut f64, seed: &mut usize, enough: f64) {
        let Some(node) = self.nodes.get(at) else { return };
        if *best <= enough {
            return;
        }
        if node.second == NO_HALF {
            let first = node.first as usize;
            // Where a leaf has fewer, triangles of the next one do no harm.
            let end = (first + LEAF).min(self.triangles.len());
            for (number, triangle) in (first..end).zip(&self.triangles[first..end]) {
                if box_square(around(triangle), p) < *best {
                    let square = square(triangle, p);
                    if square < *best {
                        (*best, *seed) = (square, number);
                    }
                }
            }
            return;
        }
        let (one, other) = (at + 1, node.second as usize);
        let mut halves = [(self.nodes[one].square(p), one), (self.nodes[other].square(p), other)];
        if halves[1].0 < halves[0].0 {
            halves.swap(0, 1);
        }
        for (square, half) in halves {
            if square < *best {
                self.descend(half, p, best, seed, enough);
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

/// The box around a triangle.
#[inline(always)]
fn around([a, b, c]: &[[f32; 3]; 3]) -> [[f32; 3]; 2] {
    let (mut low, mut high) = (*a, *a);
    for k in 0..3 {
        low[k] = a[k].min(b[k]).min(c[k]);
        high[k] = a[k].max(b[k]).max(c[k]);
    }
    [low, high]
}

/// Squared distance of a point from a box.
#[inline(always)]
fn box_square([low, high]: [[f32; 3]; 2], p: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    for ((low, high), p) in low.iter().zip(high).zip(p) {
        let over = (f64::from(*low) - p).max(p - f64::from(high)).max(0.0);
        sum += over * over;
    }
    sum
}

/// Adds the node of some triangles, the first of which has this number.
fn split(nodes: &mut Vec<Node>, triangles: &mut [[[f32; 3]; 3]], first: usize) {
    let of = |fold: fn(f32, f32) -> f32| {
        let corners = triangles.as_flattened().iter().copied();
        corners.reduce(|a, b| std::array::from_fn(|k| fold(a[k], b[k]))).unwrap_or_default()
    };
    let (low, high) = (of(f32::min), of(f32::max));
    let at = nodes.len();
    nodes.push(Node { low, high, first: number(first), second: NO_HALF });
    if triangles.len() <= LEAF {
        return;
    }
    let length = |a: &usize| high[*a] - low[*a];
    let axis = (0..3).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let half = triangles.len() / 2;
    let middle = |triangle: &[[f32; 3]; 3]| triangle.iter().map(|corner| corner[axis]).sum::<f32>();
    triangles.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (low, high) = triangles.split_at_mut(half);
    split(nodes, low, first);
    nodes[at].second = number(nodes.len());
    split(nodes, high, first + half);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_all_triangles() {
        let mut state = 5_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * 10.0
        };
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
