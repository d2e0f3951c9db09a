//! How far a point is from triangles: a tree of boxes around them.

use super::near::Facet;

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// In place of the second half of a leaf.
const NO_HALF: u32 = u32::MAX;

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
        (0..3).fold(0.0, |sum, a| {
            let over = (f64::from(self.low[a]) - p[a]).max(p[a] - f64::from(self.high[a])).max(0.0);
            sum + over * over
        })
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
                let square = square(triangle, p);
                if square < *best {
                    (*best, *seed) = (square, number);
                }
            }
            return;
        }
        let mut halves = [at + 1, node.second as usize].map(|half| (self.nodes[half].square(p), half));
        halves.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (square, half) in halves {
            if square < *best {
                self.descend(half, p, best, seed, enough);
            }
        }
    }
}

/// Squared distance of a point from a triangle.
fn square(triangle: &[[f32; 3]; 3], p: [f64; 3]) -> f64 {
    Facet::new(triangle.map(|corner| corner.map(f64::from))).square(p)
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
