//! How far a point is from triangles: a tree of boxes around them.

use super::near::Facet;

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// Triangles in a tree of boxes, halved along their longest axis.
///
/// Memory: some 150 bytes a triangle. Cost: a microsecond a point.
pub(super) struct Tree {
    facets: Vec<Facet>,
    nodes: Vec<Node>,
}

/// A box: of a leaf the range of its triangles; else its first half follows it, and `second` is the other.
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    first: usize,
    end: usize,
    second: usize,
}

impl Node {
    fn square(&self, p: [f64; 3]) -> f64 {
        (0..3).fold(0.0, |sum, a| {
            let over = (self.low[a] - p[a]).max(p[a] - self.high[a]).max(0.0);
            sum + over * over
        })
    }
}

impl Tree {
    pub(super) fn new(triangles: impl Iterator<Item = [[f64; 3]; 3]>) -> Self {
        let mut tree = Self { facets: triangles.map(Facet::new).collect(), nodes: Vec::new() };
        let mut facets = std::mem::take(&mut tree.facets);
        tree.split(&mut facets, 0);
        tree.facets = facets;
        tree
    }

    /// Adds the node of some triangles, the first of which has this number.
    fn split(&mut self, facets: &mut [Facet], first: usize) {
        let mut node =
            Node { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3], first, end: first, second: 0 };
        for [low, high] in facets.iter().map(Facet::span) {
            for a in 0..3 {
                (node.low[a], node.high[a]) = (node.low[a].min(low[a]), node.high[a].max(high[a]));
            }
        }
        let length = |a: &usize| node.high[*a] - node.low[*a];
        let axis = (0..3).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0);
        let at = self.nodes.len();
        if facets.len() <= LEAF {
            node.end = first + facets.len();
            self.nodes.push(node);
            return;
        }
        self.nodes.push(node);
        let half = facets.len() / 2;
        let middle = |facet: &Facet| facet.span().map(|end| end[axis]).iter().sum::<f64>();
        facets.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
        let (low, high) = facets.split_at_mut(half);
        self.split(low, first);
        self.nodes[at].second = self.nodes.len();
        self.split(high, first + half);
    }

    /// Squared distance of a point, infinite without triangles; `seed`: the triangle that was nearest to a point before.
    pub(super) fn square(&self, p: [f64; 3], seed: &mut usize) -> f64 {
        let mut best = self.facets.get(*seed).map_or(f64::INFINITY, |facet| facet.square(p));
        self.descend(0, p, &mut best, seed);
        best
    }

    fn descend(&self, at: usize, p: [f64; 3], best: &mut f64, seed: &mut usize) {
        let Some(node) = self.nodes.get(at) else { return };
        if node.second == 0 {
            for number in node.first..node.end {
                let square = self.facets[number].square(p);
                if square < *best {
                    (*best, *seed) = (square, number);
                }
            }
            return;
        }
        let mut halves = [at + 1, node.second].map(|half| (self.nodes[half].square(p), half));
        halves.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (square, half) in halves {
            if square < *best {
                self.descend(half, p, best, seed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_all_triangles() {
        let mut state = 5_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) * 10.0
        };
        for count in [0, 1, 5, 300] {
            let triangles: Vec<[[f64; 3]; 3]> =
                (0..count).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next()))).collect();
            let (tree, mut seed) = (Tree::new(triangles.iter().copied()), 0);
            for _ in 0..300 {
                let p = std::array::from_fn(|_| next() * 2.0 - 5.0);
                let due = triangles.iter().map(|t| Facet::new(*t).square(p)).fold(f64::INFINITY, f64::min);
                assert!(tree.square(p, &mut seed) == due, "{p:?}");
            }
        }
    }
}
