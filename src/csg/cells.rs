//! A tree as a solid of cells: planes at the crossings of its leaves with the edges between voxel middles.
//!
//! The leaves that an edge crosses are turned in order from the edge's outside end; the one with which the tree turns
//! to inside gives the crossing, and the first of the tree where two cross at one place. So cells do not depend on
//! boxes and the pruned programs in them.

use super::leaf::{Leaf, Rows};
use super::program::{self, Step};
use super::sampled::ROWS;
use super::solid::{CsgSolid, CsgWorker, Keep};
use crate::builder::{
    CellEdge, CellEdges, Cover, EdgeCrossing, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid,
    SolidWorker, Tile, VoxelBox,
};
use crate::format::{Channel, Metadata, SurfaceKind};
use crate::geom::Dims;
use crate::mesh::Crossings;
use crate::volume::SourceError;

pub(super) struct CsgCells<'a> {
    pub(super) tree: CsgSolid<'a>,
    pub(super) dims: Dims,
}

impl Solid for CsgCells<'_> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn inner(&self) -> Option<&dyn Solid> {
        Some(&self.tree)
    }

    fn surface(&self) -> SurfaceKind {
        SurfaceKind::Cells
    }

    fn lookbehind(&self) -> u32 {
        self.tree.sampled.iter().map(|leaf| leaf.solid.lookbehind()).fold(self.tree.lookbehind(), u32::max)
    }

    fn metadata(&self, found: &ScanSummary) -> Metadata {
        self.tree.metadata(found)
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        CellEdges::form(channel)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        let crossed =
            self.tree.counts[1] * size_of::<LeafCrossing>() + CellEdges::MAX_EDGES * size_of::<CellEdge>();
        self.tree.worker_bytes(tile)
            + (1 + self.tree.sampled.len() as u64) * CellEdges::BYTES
            + (crossed + self.tree.most_steps() * size_of::<Step>() + BodyBits::bytes(&self.tree)) as u64
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(CellWorker {
            samples: self.tree.place.dims,
            tree: CsgWorker::new(&self.tree, tile, Keep::Outermost),
            edges: CellEdges::new(),
            list: Vec::with_capacity(CellEdges::MAX_EDGES),
            of_sampled: self.tree.sampled.iter().map(|_| CellEdges::new()).collect(),
            crossed: Vec::with_capacity(self.tree.program.len()),
            at_edge: Vec::with_capacity(self.tree.most_steps()),
            bodies: BodyBits::new(&self.tree),
        })
    }
}

struct CellWorker<'a> {
    samples: Dims,
    tree: CsgWorker<'a>,
    edges: CellEdges,
    list: Vec<CellEdge>,
    /// Edges of sampled leaves.
    of_sampled: Vec<CellEdges>,
    crossed: Vec<LeafCrossing>,
    /// The rest of a program at one edge.
    at_edge: Vec<Step>,
    bodies: BodyBits,
}

/// Steps of a program above which it is pruned for every edge.
const MANY: usize = 16;

/// Fewest edges of a brick's slice for which bodies are swept row by row; for fewer, each end is asked for by itself.
const MIN_EDGES: usize = 8;

/// The samples at the corners of a brick's slice of cells that lie in bodies, a bit each: to ask a body for one costs
/// nearly as much as for all of a row.
struct BodyBits {
    /// Place of a leaf among those held, if that one is the leaf's.
    places: Vec<u32>,
    /// Leaves, and their rows in the lower and the upper slice.
    held: Vec<(u32, [[u64; ROWS]; 2])>,
    corner: [i32; 3],
}

impl BodyBits {
    /// Most bodies held.
    const MOST: usize = 64;

    /// Most bodies of a tree that are held, and its leaves if there are any.
    fn sizes(tree: &CsgSolid<'_>) -> [usize; 2] {
        let bodies = tree.leaves.iter().filter(|leaf| matches!(leaf, Leaf::Body(_))).count();
        [bodies.min(Self::MOST), if bodies > 0 { tree.leaves.len() } else { 0 }]
    }

    fn bytes(tree: &CsgSolid<'_>) -> usize {
        let [bodies, leaves] = Self::sizes(tree);
        bodies * size_of::<(u32, [[u64; ROWS]; 2])>() + leaves * size_of::<u32>()
    }

    fn new(tree: &CsgSolid<'_>) -> Self {
        let [bodies, leaves] = Self::sizes(tree);
        Self { places: vec![0; leaves], held: Vec::with_capacity(bodies), corner: [0; 3] }
    }

    /// Sweeps the bodies of a program.
    fn sweep(&mut self, corner: [i32; 3], steps: &[Step], solid: &CsgSolid<'_>, crossings: &mut Crossings) {
        self.corner = corner;
        let [x, y, z] = corner;
        for (leaf, _) in steps.iter().filter_map(|step| program::leaf_of(*step)) {
            let own = &solid.leaves[leaf as usize];
            if self.held.len() == self.held.capacity() {
                return;
            }
            if matches!(own, Leaf::Body(_)) {
                let mut slices = [[0; ROWS]; 2];
                for (slice, z) in slices.iter_mut().zip(z..) {
                    own.fill(Rows { x, y, z }, slice, crossings);
                }
                self.places[leaf as usize] = u32::try_from(self.held.len()).unwrap_or(0);
                self.held.push((leaf, slices));
            }
        }
    }

    /// True for a sample in the body of a leaf; `None` for leaves that are not held.
    fn contains(&self, leaf: u32, at: [i32; 3]) -> Option<bool> {
        let place = *self.places.get(leaf as usize)?;
        let (_, slices) = self.held.get(place as usize).filter(|held| held.0 == leaf)?;
        let [x, y, z] = [0, 1, 2].map(|k| at[k] - self.corner[k]);
        let row = slices.get(usize::try_from(z).ok()?)?.get(usize::try_from(y).ok()?)?;
        Some(row >> x & 1 == 1)
    }
}

/// A leaf of a program that an edge may cross.
struct LeafCrossing {
    leaf: u32,
    /// State of the leaf at the far end, and at the other: true for inside.
    outer: bool,
    inner: bool,
    /// Position of the crossing, as a part of the way from the outside end.
    away: f64,
    found: Option<EdgeCrossing>,
}

impl SolidWorker for CellWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.tree.start(column)
    }

    fn cover(&mut self, region: &VoxelBox) -> Cover {
        let [nx, ny, nz] = self.samples.to_array();
        let exists = region.x.end <= nx && region.y.end <= ny && region.z.end <= nz;
        match self.tree.cover(region) {
            // Beyond the grid all is outside.
            Cover::Inside if !exists => Cover::Mixed,
            cover => cover,
        }
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        self.tree.occupancy(rows)?;
        rows.clear_beyond(self.samples);
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let Self { samples, tree, edges, list, of_sampled, crossed, at_edge, bodies } = self;
        edges.begin(skin);
        let [_, _, z] = skin.corner();
        tree.ready(z + 2)?;
        let (solid, near, samplers, crossings) = tree.near(skin);
        for (at, own) in of_sampled.iter_mut().enumerate() {
            let is_near = near.iter().any(|step| {
                let leaf = program::leaf_of(*step).map(|(leaf, _)| &solid.leaves[leaf as usize]);
                matches!(leaf, Some(Leaf::Sampled(number)) if *number as usize == at)
            });
            own.begin_among(edges, |p| is_near && samplers[at].contains(p));
            if is_near {
                samplers[at].worker.crossings(skin, &mut |crossing| own.offer(crossing))?;
            }
        }
        list.clear();
        list.extend(edges.wanted());
        bodies.held.clear();
        if list.len() >= MIN_EDGES {
            let [corner, _] = CellEdges::samples_of(skin);
            bodies.sweep(corner, near, solid, crossings);
        }
        let contains = |leaf: u32, at: [i32; 3]| match &solid.leaves[leaf as usize] {
            Leaf::Sampled(number) => samplers[*number as usize].contains(at),
            own => bodies.contains(leaf, at).unwrap_or_else(|| own.contains(at)),
        };
        let sides = samples.to_array();
        for edge in list {
            // Beyond the wall of the grid there is no edge: the wall is the surface.
            let exists = (0..3).all(|k| {
                let last = edge.low[k] + i32::from(k == edge.axis);
                edge.low[k] >= 0 && last.cast_unsigned() < sides[k]
            });
            if !exists {
                continue;
            }
            let steps = if near.len() > MANY { left_at(edge, near, solid, contains, at_edge) } else { near };
            if let Some(found) = outermost(edge, steps, solid, contains, of_sampled, crossed) {
                edges.offer(&found);
            }
        }
        edges.describe(skin, *samples);
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        self.edges.items(channel)
    }

    fn found(&self) -> ScanSummary {
        self.tree.found()
    }
}

/// The ends of an edge.
fn ends(edge: &CellEdge) -> [[i32; 3]; 2] {
    let mut high = edge.low;
    high[edge.axis] += 1;
    [edge.low, high]
}

/// The rest of a program at an edge; `contains` is true for a leaf and a sample in it.
fn left_at<'p>(
    edge: &CellEdge,
    steps: &'p [Step],
    solid: &CsgSolid<'_>,
    contains: impl Fn(u32, [i32; 3]) -> bool,
    out: &'p mut Vec<Step>,
) -> &'p [Step] {
    let side = |k: usize| {
        let first = edge.low[k].cast_unsigned();
        first..first + 1 + u32::from(k == edge.axis)
    };
    let region = VoxelBox { x: side(0), y: side(1), z: side(2) };
    let of_leaf = |leaf| match ends(edge).map(|at| contains(leaf, at)) {
        [true, true] => Cover::Inside,
        [false, false] => Cover::Outside,
        _ => Cover::Mixed,
    };
    match solid.prune_by(of_leaf, steps, &region, Keep::Outermost, out) {
        Some(Cover::Mixed) => out,
        _ => steps,
    }
}

/// The first crossing of an edge, from its outside end, with which the tree turns to inside.
fn outermost(
    edge: &CellEdge,
    steps: &[Step],
    solid: &CsgSolid<'_>,
    contains: impl Fn(u32, [i32; 3]) -> bool,
    of_sampled: &[CellEdges],
    crossed: &mut Vec<LeafCrossing>,
) -> Option<EdgeCrossing> {
    crossed.clear();
    for (leaf, _) in steps.iter().filter_map(|step| program::leaf_of(*step)) {
        let placed = &solid.leaves[leaf as usize];
        let [low, high] = ends(edge).map(|at| contains(leaf, at));
        let (outer, inner) = if edge.low_inside { (high, low) } else { (low, high) };
        let found = if outer == inner {
            None
        } else {
            match placed {
                Leaf::Sampled(at) => of_sampled[*at as usize].crossing(edge.low, edge.axis),
                own => own.crossing(edge.low, edge.axis, low),
            }
        };
        let along = found.map_or(0.5, |found| found.along);
        let away = if edge.low_inside { 1.0 - along } else { along };
        crossed.push(LeafCrossing { leaf, outer, inner, away, found });
    }
    let value = |passed: f64, last: u32, crossed: &[LeafCrossing]| {
        let mut at = 0;
        let value = program::value(steps, |_| {
            let LeafCrossing { leaf, outer, inner, away, .. } = crossed[at];
            at += 1;
            let is_passed = (away, leaf) <= (passed, last);
            if if is_passed { inner } else { outer } { u64::MAX } else { 0 }
        });
        value != 0
    };
    let mut passed = (-1.0, 0);
    loop {
        let next = crossed
            .iter()
            .filter(|one| one.outer != one.inner && (one.away, one.leaf) > passed)
            .min_by(|a, b| a.away.total_cmp(&b.away).then(a.leaf.cmp(&b.leaf)))?;
        passed = (next.away, next.leaf);
        if value(passed.0, passed.1, crossed) {
            return next.found;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::facets;
    use super::super::leaf::{Ball, Block, Body, Leaf};
    use super::super::place::LatticeGrid;
    use super::*;
    use crate::geom::Affine;
    use crate::mesh::{Bounds, GridChoice, STEPS};

    const SIDE: i32 = 24;

    /// Balls and boxes in nearly one place, joined at random.
    fn random(count: u32, next: &mut impl FnMut(i32) -> i32) -> CsgSolid<'static> {
        let (middle, about) = (SIDE / 2 * STEPS, 1 + next(3 * STEPS));
        let leaves: Vec<Leaf> = (0..count)
            .map(|_| {
                let middle: [i32; 3] = std::array::from_fn(|_| middle + next(about));
                let reach = 7 * STEPS + next(about);
                if next(3) > 0 {
                    return Leaf::Ball(Ball { middle, radius: reach });
                }
                let of = |sign: i32| middle.map(|c| i64::from(c + sign * reach));
                Leaf::Block(Box::new(Block { low: of(-1), high: of(1) }))
            })
            .collect();
        let (and, or) = (1 << 31, 1 << 30);
        let usual = if next(2) == 0 { and } else { or };
        let sign = u32::from(next(2) == 0);
        let mut program = vec![sign];
        for leaf in 1..count {
            program.push(leaf << 1 | if next(9) == 0 { 1 - sign } else { sign });
            program.push(if next(9) == 0 { and + or - usual } else { usual });
        }
        solid(leaves, program)
    }

    fn solid(leaves: Vec<Leaf>, program: Vec<Step>) -> CsgSolid<'static> {
        let choice = GridChoice::Side { voxels: SIDE.cast_unsigned(), margin: 1 };
        let place = LatticeGrid::around(choice, &Bounds { low: [0.0; 3], high: [1.0; 3] }).unwrap();
        let extents = leaves.iter().map(Leaf::extent).collect();
        let counts = [leaves.len(), program.len()];
        let name = String::new();
        CsgSolid { name, place, leaves, extents, program, sampled: Vec::new(), counts, text: None }
    }

    #[test]
    fn swept_bodies_hold_the_samples_that_they_contain() {
        let mut to_lattice = Affine::from_spacing([f64::from(STEPS); 3]);
        to_lattice.rows.iter_mut().for_each(|row| row[3] = 11.3 * f64::from(STEPS));
        let faces = [facets::sphere(9.0, 30), facets::cylinder([-8.0, 5.0], [3.0, 10.0], 7)];
        let bodies = faces.map(|faces| Leaf::Body(Box::new(Body::new(&faces, &to_lattice, 1).unwrap())));
        let solid = solid(bodies.into(), vec![0, 2, 1 << 30]);
        let (mut bits, mut inside) = (BodyBits::new(&solid), 0);
        for corner in [[-1, -1, 4], [7, 3, 11], [-1, 15, 0]] {
            bits.held.clear();
            bits.sweep(corner, &solid.program, &solid, &mut Crossings::new(1, ROWS));
            for at in 0..2 * 33 * 33 {
                let p = [corner[0] + at % 33, corner[1] + at / 33 % 33, corner[2] + at / 33 / 33];
                for leaf in 0..2 {
                    let contained = solid.leaves[leaf as usize].contains(p);
                    assert_eq!(bits.contains(leaf, p), Some(contained), "{leaf} {p:?}");
                    inside += u32::from(contained);
                }
            }
        }
        assert!(inside > 500, "{inside}");
    }

    /// Leaves that are left out because they lie within others, in boxes within boxes, change no voxel and no crossing.
    #[test]
    fn nested_leaves_change_nothing() {
        let mut state = 5_u32;
        let mut next = |n: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from(state >> 8).unwrap() % n
        };
        let (mut compared, mut left_out) = (0, 0);
        for round in 0..60 {
            let solid = random(2 + 3 * round, &mut next);
            let [mut first, mut second] = [(); 2].map(|()| Vec::with_capacity(solid.program.len()));
            for _ in 0..600 {
                let low: [i32; 3] = std::array::from_fn(|_| 1 + next(SIDE - 3));
                let axis = usize::try_from(next(3)).unwrap();
                let mut high = low;
                high[axis] += 1;
                let inside = |steps: &[Step], at: [i32; 3]| {
                    program::value(steps, |leaf| if solid.contains(leaf, at) { u64::MAX } else { 0 }) != 0
                };
                let whole = [low, high].map(|at| inside(&solid.program, at));
                // A box around the edge, and the edge.
                let side = |k: usize| {
                    let at = low[k].cast_unsigned();
                    at.saturating_sub(5)..(at + 7).min(SIDE.cast_unsigned())
                };
                let region = VoxelBox { x: side(0), y: side(1), z: side(2) };
                let near = match solid.prune(&solid.program, &region, Keep::Outermost, &mut first) {
                    Some(Cover::Mixed) => &first,
                    Some(cover) => {
                        assert_eq!(whole, [cover == Cover::Inside; 2]);
                        continue;
                    }
                    None => &solid.program,
                };
                assert_eq!([low, high].map(|at| inside(near, at)), whole);
                left_out += solid.program.len() - near.len();
                let edge = CellEdge { low, axis, low_inside: whole[0] };
                if whole[0] == whole[1] {
                    continue;
                }
                let contains = |leaf, at| solid.contains(leaf, at);
                let at_edge = left_at(&edge, near, &solid, contains, &mut second);
                let [all, few] = [&solid.program, at_edge].map(|steps| {
                    let found = outermost(&edge, steps, &solid, contains, &[], &mut Vec::new());
                    found.map(|found| (found.along, found.normal))
                });
                assert_eq!(all, few, "{edge:?}");
                compared += 1;
            }
        }
        assert!(compared > 500 && left_out > 100_000, "{compared} {left_out}");
    }
}
