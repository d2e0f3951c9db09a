//! Normals of cells, smooth where the surface is and sharp where it is not: a mean over the 3 x 3 x 3 cells around a hit.
//!
//! A cell's weight has three factors. The distance of its middle from the hit along each axis: zero at a cell and a
//! half, so that the mean changes without steps as the hit moves. The hit's distance from its plane: zero at a cell, so
//! that anything beside the surface, such as the other side of a thin wall, has no part. And the similarity of its
//! normal to the hit cell's: zero from 72 degrees on, so that edges stay sharp.
//!
//! On a head's bone, 2.5 times as many cells count as the eight of [`super::blend`]; light specks of 10,000 smooth
//! pixels fall from 49 to 15. Cost: 50 to 100 ns a hit, and 250 ns once for each cell that a worker meets.

use super::neighborhood::Neighborhood;
use crate::cpu::{Form, Kernel, Lanes};
use crate::format::LabelItems;
use crate::geom::dot;
use crate::load::{CellItems, ModelView, NodeView};

/// Slots for neighbours: 27 and some that stay empty, in whole groups of [`LANES`].
const SLOTS: usize = 32;
const LANES: usize = 8;

/// Distance along an axis at which a cell's weight is zero, in cells.
const REACH: f32 = 1.5;
/// Assumed distance of the hit from a cell without a plane.
const WITH_CORNERS: f32 = 0.25;
/// Cosine between normals up to which a cell's weight is zero, and the rise from there to full weight.
const APART: f32 = 0.3;
const TO_ALIKE: f32 = 0.5;

/// Cached neighbourhoods of a worker.
const KEPT: usize = 64;

/// Vectors from the middle of the hit cell to the middles of the others, axis by axis.
const MIDDLES: [[f32; SLOTS]; 3] = {
    let mut middles = [[0.0; SLOTS]; 3];
    let mut slot = 0;
    while slot < 27 {
        let places = [slot % 3, slot / 3 % 3, slot / 9];
        let mut a = 0;
        while a < 3 {
            middles[a][slot] = places[a] as f32 - 1.0;
            a += 1;
        }
        slot += 1;
    }
    middles
};

/// Key of a neighbourhood: the hit cell, and its assumed position, as rounding may put the point beside it.
type Key = (u64, [i64; 3], [i32; 3]);

/// The cells around a cell.
#[derive(Clone, Debug)]
struct Neighbourhood {
    key: Key,
    /// Unit normals.
    normal: [[f32; SLOTS]; 3],
    /// Position of the plane: its distance from the cell's middle along the normal.
    offset: [f32; SLOTS],
    /// 1 for a cell with a plane, 0 for one with corners.
    has_plane: [f32; SLOTS],
    /// Similarity of the normal; 0 for an empty slot.
    alike: [f32; SLOTS],
}

/// The neighbourhoods used last by a worker; empty until the first. Memory: 60 KiB.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbourhoods(Vec<Neighbourhood>);

impl Neighbourhood {
    /// A neighbourhood without cells, whose normals have a length.
    const NOWHERE: Self = Self {
        key: (u64::MAX, [0; 3], [0; 3]),
        normal: [[0.0; SLOTS], [0.0; SLOTS], [1.0; SLOTS]],
        offset: [0.0; SLOTS],
        has_plane: [0.0; SLOTS],
        alike: [0.0; SLOTS],
    };

    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small numbers")]
    fn gather(
        &mut self,
        (view, cells): (&ModelView<'_>, CellItems<'_>),
        around: &mut Neighborhood,
        key: Key,
        own: [f64; 3],
    ) {
        *self = Self { key, ..Self::NOWHERE };
        let nodes = view.node_count();
        // Between labels cells of the same wall count, and where several walls meet, similar cells.
        let hit = key.0.wrapping_sub(nodes);
        let labels = view.labels().filter(|_| cells.has_walls());
        let wall = labels.and_then(|labels| cells.wall(hit).and_then(|_| labels.pair(hit)));
        let is_of_wall = |cell: u64| {
            let is_other = |labels: LabelItems<'_>| {
                cells.wall(cell).is_none() || wall.is_some_and(|wall| labels.pair(cell) != Some(wall))
            };
            cell == hit || !labels.is_some_and(is_other)
        };
        around.neighbours(view, view.depth(), key.1, |slot, number| {
            let (slot, cell) = (slot % SLOTS, number.wrapping_sub(nodes));
            if !is_of_wall(cell) {
                return;
            }
            for (all, part) in self.normal.iter_mut().zip(cells.normal(cell)) {
                all[slot] = part as f32;
            }
            if let Some(plane) = cells.wall(cell).filter(|_| labels.is_some()).or_else(|| cells.plane(cell)) {
                (self.has_plane[slot], self.offset[slot]) = (1.0, plane.offset as f32);
            }
            self.alike[slot] = 1.0;
        });
        Form::best().run(Measure { around: self, own: own.map(|c| c as f32) });
    }
}

/// Brings the stored normals and offsets of a neighbourhood to unit length, and compares them with the hit cell's normal.
struct Measure<'a> {
    around: &'a mut Neighbourhood,
    own: [f32; 3],
}

impl Kernel for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { around: Neighbourhood { normal: [x, y, z], offset, alike, .. }, own } = self;
        for j in 0..SLOTS {
            let length = (x[j] * x[j] + y[j] * y[j] + z[j] * z[j]).sqrt();
            (x[j], y[j], z[j]) = (x[j] / length, y[j] / length, z[j] / length);
            offset[j] /= 2.0 * length;
            let t = (x[j] * own[0] + y[j] * own[1] + z[j] * own[2] - APART) / TO_ALIKE;
            let t = if t > 0.0 { t } else { 0.0 };
            let t = if t < 1.0 { t } else { 1.0 };
            alike[j] *= t * t * (3.0 - 2.0 * t);
        }
    }
}

/// The mean of the normals around a point, in cells from the middle of the cell that was hit.
struct Mean<'a> {
    around: &'a Neighbourhood,
    at: [f32; 3],
}

impl Kernel for Mean<'_> {
    type Output = [f32; 3];

    // Lane by lane, and finally across lanes: every form adds in one order.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "loops like this one are vectorised")]
    fn run(self, _: impl Lanes) -> [f32; 3] {
        let Self { around, at } = self;
        let mut sums = [[0.0_f32; LANES]; 3];
        for first in (0..SLOTS).step_by(LANES) {
            for lane in 0..LANES {
                let j = first + lane;
                let q = [at[0] - MIDDLES[0][j], at[1] - MIDDLES[1][j], at[2] - MIDDLES[2][j]];
                let n = [around.normal[0][j], around.normal[1][j], around.normal[2][j]];
                let d = n[0] * q[0] + n[1] * q[1] + n[2] * q[2] - around.offset[j];
                let near = |part: f32| {
                    let rest = 1.0 - part * part;
                    let rest = if rest > 0.0 { rest } else { 0.0 };
                    rest * rest
                };
                let beside = near(q[0] / REACH) * near(q[1] / REACH) * near(q[2] / REACH);
                let off = around.has_plane[j] * near(d) + (1.0 - around.has_plane[j]) * WITH_CORNERS;
                let weight = beside * off * around.alike[j];
                sums[0][lane] += weight * n[0];
                sums[1][lane] += weight * n[1];
                sums[2][lane] += weight * n[2];
            }
        }
        sums.map(|lanes| lanes.iter().fold(0.0, |sum, lane| sum + lane))
    }
}

/// The displayed normal at a point of the grid within a cell, in index space; `own` is the hit's, of any length.
pub(super) fn smooth(
    (view, cells): (&ModelView<'_>, CellItems<'_>),
    around: &mut Neighborhood,
    box_number: u64,
    at: [f64; 3],
    own: [f64; 3],
) -> [f64; 3] {
    let length = dot(own, own).sqrt();
    let unit = own.map(|c| c / length);
    let side = f64::from(1_u32 << view.depth().min(31));
    #[expect(
        clippy::cast_possible_truncation,
        reason = "clamped to the grid; a direction in single precision"
    )]
    let (cell, code) = (at.map(|c| c.clamp(0.0, side - 1.0) as i64), unit.map(|c| (c * 32_768.0) as i32));
    let key = (box_number, cell, code);
    let slot = (box_number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize % KEPT;
    let mut kept = std::mem::take(&mut around.smooth);
    if kept.0.is_empty() {
        kept.0.resize(KEPT, Neighbourhood::NOWHERE);
    }
    let neighbourhood = &mut kept.0[slot];
    if neighbourhood.key != key {
        neighbourhood.gather((view, cells), around, key, unit);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "within a few cells")]
    let from = std::array::from_fn(|a| (at[a] - (cell[a] as f64 + 0.5)) as f32);
    let sum = Form::best().run(Mean { around: neighbourhood, at: from }).map(f64::from);
    around.smooth = kept;
    if dot(sum, sum) > 0.0 { sum } else { own }
}
