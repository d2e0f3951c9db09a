//! A tree as a solid of cells: planes from where its leaves are crossed by the edges between voxel middles.
//!
//! Of the leaves that an edge crosses, those next to its outside end are turned first; the one with which the tree is
//! inside gives the crossing, and the first of the tree where two are crossed at one place. So neither boxes nor what
//! is left of programs in them change a cell.

use std::path::Path;

use super::leaf::Leaf;
use super::program::{self, Step};
use super::sampled::Sampler;
use super::solid::{CsgSolid, CsgWorker};
use crate::builder::BuildError;
use crate::builder::{
    CellEdge, CellEdges, Cover, EdgeCrossing, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid,
    SolidWorker, Tile, VoxelBox,
};
use crate::facts::SourceError;
use crate::format::{Channel, Metadata, SurfaceKind};
use crate::geom::Dims;

pub(super) struct CsgCells<'a> {
    pub(super) tree: CsgSolid<'a>,
    pub(super) dims: Dims,
}

impl Solid for CsgCells<'_> {
    fn dims(&self) -> Dims {
        self.dims
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

    fn name(&self) -> String {
        self.tree.name()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.tree.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.tree.check_unchanged()
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        CellEdges::form(channel)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        let crossed =
            self.tree.counts[1] * size_of::<LeafCrossing>() + CellEdges::MAX_EDGES * size_of::<CellEdge>();
        self.tree.worker_bytes(tile)
            + (1 + self.tree.sampled.len() as u64) * CellEdges::BYTES
            + crossed as u64
    }

    fn input_bytes(&self) -> u64 {
        self.tree.input_bytes()
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(CellWorker {
            samples: self.tree.place.dims,
            tree: CsgWorker::new(&self.tree, tile),
            edges: CellEdges::new(),
            list: Vec::with_capacity(CellEdges::MAX_EDGES),
            of_sampled: self.tree.sampled.iter().map(|_| CellEdges::new()).collect(),
            crossed: Vec::with_capacity(self.tree.program.len()),
        })
    }

    fn nothing_inside(&self) -> BuildError {
        self.tree.nothing_inside()
    }
}

struct CellWorker<'a> {
    samples: Dims,
    tree: CsgWorker<'a>,
    edges: CellEdges,
    list: Vec<CellEdge>,
    /// Those of sampled leaves.
    of_sampled: Vec<CellEdges>,
    crossed: Vec<LeafCrossing>,
}

/// A leaf of a program that an edge may cross.
struct LeafCrossing {
    leaf: u32,
    /// Is its far end inside, and its other end?
    outer: bool,
    inner: bool,
    /// Part of the way from the outside end to the crossing.
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
        let Self { samples, tree, edges, list, of_sampled, crossed } = self;
        edges.begin(skin);
        let [_, _, z] = skin.corner();
        tree.ready(z + 2)?;
        let (solid, near, samplers) = tree.near(skin);
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
        let sides = samples.to_array();
        for edge in list {
            // At the wall of the grid the wall is the surface.
            let exists = (0..3).all(|k| {
                let last = edge.low[k] + i32::from(k == edge.axis);
                edge.low[k] >= 0 && last.cast_unsigned() < sides[k]
            });
            if exists && let Some(found) = outermost(edge, near, solid, samplers, of_sampled, crossed) {
                edges.offer(&found);
            }
        }
        edges.describe(skin, *samples);
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        self.edges.items(channel)
    }
}

/// The crossing of an edge with which the tree comes to be inside, from its outside end.
fn outermost(
    edge: &CellEdge,
    steps: &[Step],
    solid: &CsgSolid<'_>,
    samplers: &[Sampler<'_>],
    of_sampled: &[CellEdges],
    crossed: &mut Vec<LeafCrossing>,
) -> Option<EdgeCrossing> {
    let mut high = edge.low;
    high[edge.axis] += 1;
    let (outer, inner) = if edge.low_inside { (high, edge.low) } else { (edge.low, high) };
    crossed.clear();
    for (leaf, _) in steps.iter().filter_map(|step| program::leaf_of(*step)) {
        let placed = &solid.leaves[leaf as usize];
        let contains = |p: [i32; 3]| match placed {
            Leaf::Sampled(at) => samplers[*at as usize].contains(p),
            own => own.contains(p),
        };
        let (outer, inner) = (contains(outer), contains(inner));
        let found = if outer == inner {
            None
        } else {
            match placed {
                Leaf::Sampled(at) => of_sampled[*at as usize].crossing(edge.low, edge.axis),
                own => own.crossing(edge.low, edge.axis),
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
