//! The samples around one cell, for cells that are not fitted in batches.

use super::jet::{Jet, jet_of};
use crate::builder::labels::Members;
use crate::format::cell::CORNERS;

/// Samples of a cell's widest neighbourhood along an axis; the cell lies between the third and the fourth.
pub(super) const EDGE: usize = 6;
const LOW: usize = EDGE / 2 - 1;

/// The mean of depths; `None` without any.
fn mean(depths: impl Iterator<Item = f32>) -> Option<f32> {
    let (sum, count) = depths.fold((0.0, 0.0), |(sum, count), depth| (sum + depth, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Depths and sides of the samples around a cell, `[z][y][x]`.
pub(super) struct Field {
    depth: [[[f32; EDGE]; EDGE]; EDGE],
    inside: [[[bool; EDGE]; EDGE]; EDGE],
    /// True for samples beyond the volume.
    beyond: [[[bool; EDGE]; EDGE]; EDGE],
}

impl Field {
    pub(super) const EMPTY: Self = Self {
        depth: [[[0.0; EDGE]; EDGE]; EDGE],
        inside: [[[false; EDGE]; EDGE]; EDGE],
        beyond: [[[false; EDGE]; EDGE]; EDGE],
    };

    pub(super) fn set(&mut self, [x, y, z]: [usize; 3], depth: f32, inside: bool) {
        self.depth[z][y][x] = depth;
        self.inside[z][y][x] = inside;
    }

    /// Sets a sample beyond the volume, which is outside.
    pub(super) fn set_beyond(&mut self, [x, y, z]: [usize; 3], depth: f32) {
        self.set([x, y, z], depth, false);
        self.beyond[z][y][x] = true;
    }

    /// Replaces samples that are NaN or infinite: each gets the mean depth of its neighbours on the other side, so that
    /// the surface lies midway.
    pub(super) fn mend(&mut self) {
        let depths = self.depth.as_flattened().as_flattened();
        if depths.iter().all(|depth| depth.is_finite()) {
            return;
        }
        let known = depths.iter().map(|depth| depth.abs()).filter(|depth| depth.is_finite());
        let around = mean(known).unwrap_or(1.0);
        let from = self.depth;
        let near = |at: usize| at.saturating_sub(1)..(at + 2).min(EDGE);
        for (z, y, x) in (0..EDGE.pow(3)).map(|at| (at / EDGE / EDGE, at / EDGE % EDGE, at % EDGE)) {
            if from[z][y][x].is_finite() {
                continue;
            }
            let is_inside = self.inside[z][y][x];
            let beside = near(z).flat_map(|k| near(y).flat_map(move |j| near(x).map(move |i| (k, j, i))));
            let others = beside.filter(|(k, j, i)| self.inside[*k][*j][*i] != is_inside);
            let sizes = others.map(|(k, j, i)| from[k][j][i].abs()).filter(|depth| depth.is_finite());
            let size = mean(sizes).unwrap_or(around);
            self.depth[z][y][x] = if is_inside { size } else { -size };
        }
    }

    /// Sets the sides of the cell's corners; a NaN then lies at the surface, but outside.
    pub(super) fn set_corners(&mut self, mask: u8) {
        for c in 0..CORNERS {
            self.inside[LOW + (c >> 2)][LOW + (c >> 1 & 1)][LOW + (c & 1)] = mask >> c & 1 == 1;
        }
    }

    pub(super) fn is_corner_inside(&self, c: usize) -> bool {
        self.inside[LOW + (c >> 2)][LOW + (c >> 1 & 1)][LOW + (c & 1)]
    }

    pub(super) fn corners(&self) -> [f32; CORNERS] {
        std::array::from_fn(|c| self.depth[LOW + (c >> 2)][LOW + (c >> 1 & 1)][LOW + (c & 1)])
    }

    /// The smooth kernel's result in the middle of the cell.
    pub(super) fn jet(&self) -> Jet {
        jet_of(|[x, y, z]| self.depth[z + 1][y + 1][x + 1])
    }

    /// True if all inside depths of the volume are equal, and all outside depths are equal.
    pub(super) fn has_two_values(&self) -> bool {
        let depths = self.depth.as_flattened().as_flattened();
        let sides = self.inside.as_flattened().as_flattened();
        let beyond = self.beyond.as_flattened().as_flattened();
        let first = |side: bool| (0..depths.len()).find(|at| sides[*at] == side && !beyond[*at]);
        let [outside, inside] = [first(false), first(true)].map(|at| at.map_or(0.0, |at| depths[at]));
        let mut has_others = false;
        for ((depth, is_inside), is_beyond) in depths.iter().zip(sides).zip(beyond) {
            has_others |= !is_beyond & (*depth != if *is_inside { inside } else { outside });
        }
        !has_others
    }

    /// The inside ones of 8^3 samples around the cell, a bit each; the outermost sides go on beyond.
    pub(super) fn inside(&self) -> Members {
        let within = |i: usize| i.clamp(1, EDGE) - 1;
        let mut members = [0; 64];
        for (at, members) in members.iter_mut().enumerate() {
            let row = &self.inside[within(at / 8)][within(at % 8)];
            let mut bytes = [0; 8];
            for x in 0..8 {
                bytes[x] = u8::from(row[within(x)]);
            }
            // Each byte's bit becomes a bit of the highest byte.
            let bits = u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080);
            *members = bits.to_le_bytes()[7];
        }
        members
    }
}
