//! Contact of two models, and its place: both octrees are descended together (the paper, section 5.1).
//!
//! Two boxes of the finest level touch if they have a point in common, faces and corners included, to within 1e-9 of a
//! box. Their placement is arbitrary: boxes of one model are parallelepipeds on the grid of the other. Two such boxes
//! are apart if and only if one of 15 planes separates them: along a face of either, or along an edge of each
//! (Gottschalk, Lin and Manocha 1996); the planes' directions are the same for all pairs.
//!
//! A solid that lies deep inside another does not touch it: models hold skins.

use crate::geom::{Affine, BoxIndex, Octant, cross, dot};
use crate::load::{ModelView, NodeView, PlanePart};

/// Distance in boxes up to which boxes touch.
const NEAR: f64 = 1e-9;

/// Contact of one model with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intersection {
    /// Boxes of the finest level of this model that touch the other model.
    pub boxes: u64,
    /// The middle of the first of these boxes in Morton order, in mm.
    pub first_mm: [f64; 3],
    /// Least and greatest coordinates of their middles, in mm.
    pub range_mm: [[f64; 3]; 2],
}

/// A model and its placement.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    /// Octree of the model.
    pub view: &'a ModelView<'a>,
    /// Index of a box (its middle at integers) to mm, placement included.
    pub affine: Affine,
}

/// The boxes of `one` that touch `other`; `None` if no box does, or if one of the affines is singular.
///
/// Both models must be sound (see [`crate::load::verify()`]). Cost: follows the surface where the models are near each
/// other, and the depth of the trees elsewhere.
pub fn intersection(one: Placed<'_>, other: Placed<'_>) -> Option<Intersection> {
    // Affines of the boxes' low corners.
    let [one_corners, other_corners] = [one, other].map(|placed| placed.affine.starting_at([-0.5; 3]));
    let onto = one_corners.inverse()?.after(&other_corners);
    let mut search = Search {
        one: one.view,
        other: other.view,
        axes: separating_axes(&onto),
        scale: onto.spacing_mm().into_iter().fold(0.0, f64::max),
        onto,
        to_mm: one.affine,
        near: vec![Cube::root(other.view)],
        found: None,
    };
    search.descend(Cube::root(one.view), 0);
    search.found
}

/// A direction along which two boxes may be apart, and the reach of boxes of edge 1 along it from their middles.
#[derive(Clone, Copy, Debug)]
struct SeparatingAxis {
    across: [f64; 3],
    one: f64,
    other: f64,
}

/// The 15 directions, on the grid of the first model.
fn separating_axes(onto: &Affine) -> Vec<SeparatingAxis> {
    let own = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let edges = [0, 1, 2].map(|a| onto.column(a));
    let faces = [0, 1, 2].map(|a| cross(edges[(a + 1) % 3], edges[(a + 2) % 3]));
    let between = own.iter().flat_map(|e| edges.iter().map(|c| cross(*e, *c)));
    let reach = |edges: [[f64; 3]; 3], across| edges.iter().map(|e| dot(*e, across).abs()).sum::<f64>() / 2.0;
    let all = own.into_iter().chain(faces).chain(between);
    all.map(|across| SeparatingAxis { across, one: reach(own, across), other: reach(edges, across) })
        .collect()
}

/// A box of some level.
#[derive(Clone, Copy, Debug)]
struct Cube {
    number: BoxIndex,
    low: [u32; 3],
    level: u32,
    /// Plane of a larger leaf's part.
    leaf: Option<PlanePart>,
}

impl Cube {
    fn root(view: &ModelView<'_>) -> Self {
        Self { number: BoxIndex::ROOT, low: [0; 3], level: view.depth(), leaf: None }
    }

    fn edge(self) -> f64 {
        f64::from(1_u32 << self.level)
    }

    fn middle(self) -> [f64; 3] {
        self.low.map(|c| f64::from(c) + self.edge() / 2.0)
    }

    /// Children of the box; of a larger leaf the boxes within it that its plane passes through.
    fn children(self, view: &ModelView<'_>) -> impl Iterator<Item = Self> {
        let node = self.number.node();
        let leaf = self.leaf.or_else(|| view.is_leaf(node).then(|| PlanePart::of(view.leaf_plane(node))));
        let (infobyte, first) = match leaf {
            Some(_) => (u8::MAX, self.number),
            None => (view.infobyte(node), view.first_child(node)),
        };
        let level = self.level.saturating_sub(1);
        Octant::ALL.into_iter().filter(move |octant| octant.is_in(infobyte)).filter_map(move |octant| {
            let high = octant.high();
            let low = std::array::from_fn(|a| self.low[a] + (high[a] << level));
            match leaf.map(|leaf| leaf.octant(octant)) {
                Some(leaf) => {
                    leaf.is_crossed().then_some(Self { number: first, low, level, leaf: Some(leaf) })
                }
                None => Some(Self { number: first.after(octant.rank_in(infobyte)), low, level, leaf: None }),
            }
        })
    }
}

struct Search<'a> {
    one: &'a ModelView<'a>,
    other: &'a ModelView<'a>,
    /// Maps the grid of the other model to the grid of the first.
    onto: Affine,
    axes: Vec<SeparatingAxis>,
    /// Length of the other model's longest edge, in boxes of the first.
    scale: f64,
    to_mm: Affine,
    /// Boxes of the other model near the present box, after those near its ancestors.
    near: Vec<Cube>,
    found: Option<Intersection>,
}

impl Search<'_> {
    /// Descends into a box of the first model; boxes near its parent are in `near` from `from` on.
    fn descend(&mut self, cube: Cube, from: usize) {
        let own = self.near.len();
        let mut waiting: Vec<Cube> = self.near[from..own].to_vec();
        let mut touched = false;
        while let Some(other) = waiting.pop() {
            if !self.touch(cube, other) {
                continue;
            }
            if other.level > 0 && (cube.level == 0 || self.scale * other.edge() > cube.edge()) {
                waiting.extend(other.children(self.other));
            } else if cube.level == 0 {
                touched = true;
                break;
            } else {
                self.near.push(other);
            }
        }
        if touched {
            self.add(cube);
        }
        if cube.level > 0 && self.near.len() > own {
            for child in cube.children(self.one) {
                self.descend(child, own);
            }
        }
        self.near.truncate(own);
    }

    fn touch(&self, cube: Cube, other: Cube) -> bool {
        let (middle, at) = (cube.middle(), self.onto.apply(other.middle()));
        let apart: [f64; 3] = std::array::from_fn(|a| at[a] - middle[a]);
        let (edge, other) = (cube.edge() + NEAR, other.edge() + NEAR);
        self.axes.iter().all(|p| dot(apart, p.across).abs() <= p.one * edge + p.other * other)
    }

    fn add(&mut self, cube: Cube) {
        let at = self.to_mm.apply(cube.low.map(f64::from));
        let found = self.found.get_or_insert(Intersection { boxes: 0, first_mm: at, range_mm: [at, at] });
        found.boxes += 1;
        let [least, most] = &mut found.range_mm;
        for ((least, most), at) in least.iter_mut().zip(most).zip(at) {
            (*least, *most) = (least.min(at), most.max(at));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Dims;
    use crate::memory_tree::MemoryTree;
    use crate::random::Random;

    fn tree(side: u32, cells: &[[u32; 3]]) -> MemoryTree {
        MemoryTree::of_cells(Dims::new(side, side, side).unwrap(), cells.iter().copied())
    }

    fn moved(by: [f64; 3]) -> Affine {
        Affine::from_spacing([1.0; 3]).starting_at(by)
    }

    fn touching(one: &MemoryTree, a: Affine, other: &MemoryTree, b: Affine) -> Option<Intersection> {
        intersection(Placed { view: &one.view(), affine: a }, Placed { view: &other.view(), affine: b })
    }

    #[test]
    fn faces_edges_and_corners_touch_and_gaps_do_not() {
        let (one, other) = (tree(16, &[[3, 4, 5]]), tree(8, &[[0, 0, 0]]));
        for (by, due) in [
            ([3.0, 4.0, 5.0], true),
            ([4.0, 4.0, 5.0], true),
            ([4.0, 5.0, 5.0], true),
            ([4.0, 5.0, 6.0], true),
            ([2.0, 3.0, 4.0], true),
            ([4.000_001, 4.0, 5.0], false),
            ([3.0, 4.0, 6.5], false),
            ([-9.0, 4.0, 5.0], false),
        ] {
            let found = touching(&one, moved([0.0; 3]), &other, moved(by));
            assert_eq!(found.is_some(), due, "{by:?}");
            if let Some(found) = found {
                assert_eq!((found.boxes, found.first_mm), (1, [3.0, 4.0, 5.0]));
            }
        }
    }

    /// Counts contacts by testing every pair of boxes, with the coordinates of their corners.
    fn brute(one: &[[u32; 3]], a: Affine, other: &[[u32; 3]], b: Affine) -> u64 {
        let corners = |affine: &Affine, low: [u32; 3]| -> Vec<[f64; 3]> {
            let at = |i: u32| std::array::from_fn(|axis| f64::from(low[axis] + (i >> axis & 1)) - 0.5);
            (0..8).map(|i| affine.apply(at(i))).collect()
        };
        let directions = |affine: &Affine| [0, 1, 2].map(|axis| affine.column(axis));
        let (da, db) = (directions(&a), directions(&b));
        let mut across: Vec<[f64; 3]> = Vec::new();
        for d in [da, db] {
            across.extend((0..3).map(|i| cross(d[(i + 1) % 3], d[(i + 2) % 3])));
        }
        across.extend(da.iter().flat_map(|p| db.iter().map(|q| cross(*p, *q))));
        let apart = |p: &[[f64; 3]], q: &[[f64; 3]]| {
            across.iter().any(|n| {
                let range = |corners: &[[f64; 3]]| {
                    let along = corners.iter().map(|c| dot(*c, *n));
                    along.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)))
                };
                let ((al, ah), (bl, bh)) = (range(p), range(q));
                ah < bl || bh < al
            })
        };
        let others: Vec<_> = other.iter().map(|low| corners(&b, *low)).collect();
        let meets = |low: &&[u32; 3]| others.iter().any(|q| !apart(&corners(&a, **low), q));
        one.iter().filter(meets).count() as u64
    }

    #[test]
    fn the_descent_finds_what_all_pairs_find() {
        let mut random = Random(5);
        let mut met = 0;
        for round in 0..60 {
            let mut some = |side: u32, count: usize| -> Vec<[u32; 3]> {
                let mut all: Vec<[u32; 3]> =
                    (0..count).map(|_| [0; 3].map(|_: u32| random.below(side))).collect();
                all.sort_unstable();
                all.dedup();
                all
            };
            let (one, other) = (some(16, 60), some(9, 40));
            let mut affine = |spread: f64| {
                let mut number = || random.unit() * 2.0 - 1.0;
                let mut rows = [[0.0; 4]; 3];
                for (i, row) in rows.iter_mut().enumerate() {
                    row.iter_mut().for_each(|v| *v = number() * if round % 3 == 0 { 0.2 } else { 0.8 });
                    row[i] += 1.0;
                    row[3] = number() * spread;
                }
                Affine { rows }
            };
            let (a, b) = (affine(2.0), affine(20.0));
            let due = brute(&one, a, &other, b);
            let found = touching(&tree(16, &one), a, &tree(9, &other), b);
            assert_eq!(found.map_or(0, |c| c.boxes), due, "round {round}");
            // With the models exchanged they touch as well.
            let back = touching(&tree(9, &other), b, &tree(16, &one), a);
            assert_eq!(back.is_some(), due > 0);
            met += u64::from(due > 0);
        }
        assert!((10..60).contains(&met), "{met} of 60 met");
    }

    #[test]
    fn flat_placements_touch_nothing() {
        let one = tree(8, &[[1, 1, 1]]);
        let flat = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4]] };
        assert_eq!(touching(&one, flat, &one, moved([0.0; 3])), None);
    }
}
