//! The reference for cells and larger leaves: the walk from cell to cell, with the plane of each box that it comes to,
//! in exact fractions.
//!
//! Cost: some 10 us a ray in a grid of 512^3.

use crate::format::cell::Plane;
use crate::geom::{NodeIndex, Octant};
use crate::load::{ModelView, NodeView};
use crate::render::cells::Cells;
use crate::render::mirrored_ray::MirroredRay;
use crate::render::ray::Ray;
use crate::render::surface::Surface;

use super::{CELL, walk_until};

/// A box of the octree around a cell.
#[derive(Clone, Copy, Debug)]
struct Around {
    low: [u32; 3],
    edge_log2: u32,
    /// Number of the box; `None` for an empty one.
    number: Option<u64>,
}

impl Around {
    /// The largest box that holds a cell and is empty, a larger leaf, or the cell itself.
    fn of(view: &ModelView<'_>, cell: [u32; 3]) -> Self {
        let (mut node, mut level) = (NodeIndex::ROOT, view.depth());
        let found =
            |number, level: u32| Self { low: cell.map(|c| c >> level << level), edge_log2: level, number };
        while level > 0 {
            if view.is_leaf(node) {
                return found(Some(node.get()), level);
            }
            level -= 1;
            let octant = (0..3).fold(0, |octant, a| octant | (cell[a] >> level & 1) << a);
            let Some(child) = view.child(node, Octant::low_bits(octant)) else { return found(None, level) };
            if level == 0 {
                return found(Some(child.get()), 0);
            }
            node = child.node();
        }
        found(Some(0), 0)
    }

    fn holds(&self, cell: [u32; 3]) -> bool {
        (0..3).all(|a| cell[a] >> self.edge_log2 == self.low[a] >> self.edge_log2)
    }
}

/// Number of the cell or larger leaf in which a ray first meets the inside: by exact fractions, except that cells with
/// corners use the arithmetic of the traversal. The view must be of cells.
pub fn first_box(view: &ModelView<'_>, ray: &Ray) -> Option<u64> {
    let items = view.cells()?;
    let cells = Cells::new(items);
    let (mut around, mut met): (Option<Around>, _) = (None, None);
    walk_until(view.depth(), ray, true, |cell| {
        if around.is_some_and(|around| around.holds(cell)) {
            return false;
        }
        let here = Around::of(view, cell);
        around = Some(here);
        let Some(number) = here.number else { return false };
        let plane = if here.edge_log2 > 0 {
            Some(view.leaf_plane(NodeIndex::new(number)))
        } else {
            items.plane(number.wrapping_sub(view.node_count()))
        };
        let is_met = match plane {
            Some(plane) => meets(&plane, ray, &here),
            None => {
                let mirrored = MirroredRay::new(ray);
                let last = (1_u32 << view.depth()) - 1;
                let low =
                    [0, 1, 2].map(|a| if mirrored.mirror >> a & 1 == 1 { last - cell[a] } else { cell[a] });
                let passage = mirrored.passage(number, low, 0);
                passage.is_some_and(|passage| cells.meet(view, ray, &passage).is_some())
            }
        };
        met = is_met.then_some(number);
        is_met
    })?;
    met
}

/// True if a ray comes to be behind a plane within its box. Times `n / d` have d > 0.
fn meets(plane: &Plane, ray: &Ray, around: &Around) -> bool {
    let (origin, direction) = (ray.origin().map(i128::from), ray.direction().map(i128::from));
    let edge = 1_i128 << around.edge_log2;
    let (mut enter, mut leave): ((i128, i128), Option<(i128, i128)>) = ((0, 1), None);
    for a in 0..3 {
        let d = direction[a];
        if d == 0 {
            continue;
        }
        let low = i128::from(around.low[a]) * CELL;
        let (near, far) = if d > 0 { (low, low + edge * CELL) } else { (low + edge * CELL, low) };
        let (into, out) =
            (((near - origin[a]) * d.signum(), d.abs()), ((far - origin[a]) * d.signum(), d.abs()));
        if into.0 * enter.1 > enter.0 * into.1 {
            enter = into;
        }
        if leave.is_none_or(|leave| out.0 * leave.1 < leave.0 * out.1) {
            leave = Some(out);
        }
    }
    // N . (2 p - 2 low - edge) <= offset * edge, in units of the ray.
    let is_behind = |(n, d): (i128, i128)| {
        let along = (0..3).fold(0, |sum, a| {
            let middle = (2 * i128::from(around.low[a]) + edge) * CELL;
            sum + i128::from(plane.normal[a]) * (2 * (origin[a] * d + direction[a] * n) - middle * d)
        });
        along <= i128::from(plane.offset) * edge * CELL * d
    };
    is_behind(enter) || leave.is_some_and(is_behind)
}
