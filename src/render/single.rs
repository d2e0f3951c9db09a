//! One ray at a time, two levels at a time, skipping air: for rays without neighbours.
//!
//! At each node the ray's `Line` is compared with the 4 x 4 x 4 boxes two levels below at once. Those that are
//! intersected and occupied wait in Morton order, which in mirrored coordinates is front to back. At the last level
//! `mirrored_ray` decides in integers.
//!
//! Cost: some 40 ns a node, most of it waiting for memory: the rank of a node, then its children's
//! infobytes. Memory: under 1 KiB of stack.

use crate::cpu::{Form, Kernel, Lanes};
use crate::geom::NodeIndex;
use crate::load::ModelView;

use super::leaves;
use super::line::Line;
use super::mirrored_ray::MirroredRay;
use super::occupancy::{Brick, place};
use super::ray::{MAX_DEPTH, Ray};
use super::surface::Surface;
use super::traverse::Trace;

/// Levels of bricks from the root to a box: a power of two, so that an index is masked instead of checked.
pub(super) const BRICK_LEVELS: usize = 8;

/// Base-2 logarithm of the edge of the boxes two levels below the top brick, for a tree of this depth, at least 1.
#[inline]
pub(super) fn top_edge(depth: u32) -> u32 {
    (depth - 1) / 2 * 2
}

/// A larger leaf (SPEC 4.9) on a ray's way.
#[derive(Clone, Copy, Debug)]
pub(super) struct LargerLeaf {
    pub(super) node: u64,
    /// Its lowest box of the finest level, in mirrored coordinates, and its edge in such boxes as a power of two.
    pub(super) low: [u32; 3],
    pub(super) edge: u32,
}

/// A brick whose boxes are being visited.
#[derive(Clone, Copy)]
pub(super) struct OpenBrick {
    pub(super) brick: Brick,
    /// Boxes still to visit.
    pub(super) pending: u64,
    /// Number of the first box.
    pub(super) first: u64,
    /// Lowest box of the finest level in the brick, in mirrored coordinates.
    pub(super) low: [u32; 3],
}

impl OpenBrick {
    /// The larger leaf that box `v`, of edge `2^edge`, is or belongs to; its boxes are then marked as visited.
    #[inline(always)]
    pub(super) fn larger_leaf(&mut self, view: &ModelView<'_>, v: u32, edge: u32) -> Option<LargerLeaf> {
        if !view.has_leaves() {
            return None;
        }
        let at = |v: u32| {
            let at = place(v);
            each3!(A => self.low[A].wrapping_add(at[A].wrapping_shl(edge)))
        };
        if self.brick.larger >> v & 1 == 1 {
            let (node, boxes) = self.brick.leaf(v);
            self.pending &= !boxes;
            return Some(LargerLeaf { node, low: at(v & 56), edge: edge.wrapping_add(1) });
        }
        let node = self.first.wrapping_add(self.brick.before(v));
        (edge > 0 && view.is_leaf(NodeIndex::new(node))).then(|| LargerLeaf { node, low: at(v), edge })
    }

    /// The brick at `low` with the boxes `near` to visit.
    #[inline(always)]
    pub(super) fn new(view: &ModelView<'_>, brick: Brick, near: u64, low: [u32; 3]) -> Self {
        let pending = brick.boxes & near;
        Self { brick, pending, first: if pending == 0 { 0 } else { brick.first(view) }, low }
    }
}

/// First hit of a ray, sealed (see [`super::traverse`]), the same for every form.
///
/// The ray must have been made for the depth of this view; boxes with an edge of `2^lod_edge_log2` cells count as
/// surface. Any view is safe, right or wrong. [`Trace::steps`] counts the nodes visited.
#[inline]
pub fn trace<S: Surface>(
    form: Form,
    view: &ModelView<'_>,
    surface: &S,
    ray: &Ray,
    lod_edge_log2: u32,
) -> Trace {
    form.run(Single { view, surface, ray, lod_edge_log2 })
}

/// One ray, for any lanes.
struct Single<'a, S> {
    view: &'a ModelView<'a>,
    surface: &'a S,
    ray: &'a Ray,
    lod_edge_log2: u32,
}

impl<S: Surface> Kernel for Single<'_, S> {
    type Output = Trace;

    #[inline(always)]
    fn run(self, lanes: impl Lanes) -> Trace {
        first_hit(lanes, self.view, self.surface, self.ray, self.lod_edge_log2)
    }
}

/// [`trace`] within a kernel.
#[inline(always)]
pub(crate) fn first_hit<L: Lanes, S: Surface>(
    lanes: L,
    view: &ModelView<'_>,
    surface: &S,
    ray: &Ray,
    lod_edge_log2: u32,
) -> Trace {
    let exact = MirroredRay::new(ray);
    let grid = ray.depth().min(MAX_DEPTH);
    let unit = lod_edge_log2.min(grid);
    let mut trace = Trace { hit: None, steps: 0 };
    if view.is_empty() {
        return trace;
    }
    let depth = grid - unit;
    let meet = |number, low: [u32; 3]| {
        let low = low.map(|c| c.wrapping_shl(unit));
        exact.passage(number, low, unit).and_then(|passage| surface.meet(view, ray, &passage))
    };
    if depth == 0 {
        return Trace { hit: meet(0, [0; 3]), steps: 1 };
    }
    let line = Line::new(lanes, ray, &exact, unit);
    let near = |low, edge| line.intersected(lanes, low, edge) & line.ahead(low, edge);

    let mirror = exact.mirror;
    let mut edge = top_edge(depth);
    let brick = Brick::top(lanes, view, depth, mirror);
    let low = [0; 3];
    let mut open = OpenBrick { brick, pending: brick.boxes & near(low, edge), first: 0, low };
    open.first = brick.first(view);
    trace.steps = 1;
    let mut waiting = [open; BRICK_LEVELS];
    loop {
        if open.pending == 0 {
            edge = edge.wrapping_add(2);
            if edge > top_edge(depth) {
                return trace;
            }
            open = waiting[edge as usize / 2 % BRICK_LEVELS];
            continue;
        }
        let v = open.pending.trailing_zeros();
        open.pending &= open.pending.wrapping_sub(1);
        if let Some(leaf) = open.larger_leaf(view, v, edge) {
            let low = leaf.low.map(|c| c.wrapping_shl(unit));
            trace.hit = leaves::meet(view, ray, &exact, leaf.node, low, leaf.edge.wrapping_add(unit));
            if trace.hit.is_some() {
                return trace;
            }
            continue;
        }
        let number = open.first.wrapping_add(open.brick.before(v));
        let at = place(v);
        let low: [u32; 3] = std::array::from_fn(|a| open.low[a].wrapping_add(at[a].wrapping_shl(edge)));
        if edge == 0 {
            trace.hit = meet(number, low);
            if trace.hit.is_some() {
                return trace;
            }
            continue;
        }
        waiting[edge as usize / 2 % BRICK_LEVELS] = open;
        edge = edge.wrapping_sub(2);
        let brick = Brick::of(lanes, view, number, mirror);
        open = OpenBrick::new(view, brick, near(low, edge), low);
        trace.steps = trace.steps.wrapping_add(1);
    }
}
