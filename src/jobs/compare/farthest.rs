//! The cells of a model that are farthest from the other one, whose corners are measured, too.

use super::super::pass::PageRelief;
use super::rule::{Measured, Row, Rule};

/// Cells whose corners are measured.
const MAX_CELLS: usize = 1024;

/// The farthest cells of a pass: distance in the order of its bits, number, place.
///
/// Memory: 64 KiB.
#[derive(Debug, Default)]
pub(super) struct Farthest {
    cells: Vec<(u64, u64, [u32; 3])>,
    /// Bits of a distance that as many cells exceed as are kept.
    least: u64,
}

impl Farthest {
    pub(super) fn add(&mut self, row: &Row) {
        let Some(distance) = row.distance.filter(|_| row.area_mm2 > 0.0) else { return };
        let distance = distance.to_bits();
        if distance < self.least {
            return;
        }
        self.cells.push((distance, row.number, row.cell));
        if self.cells.len() == 2 * MAX_CELLS {
            self.keep_farthest();
            self.least = self.cells.last().map_or(0, |cell| cell.0);
        }
    }

    fn keep_farthest(&mut self) {
        self.cells.sort_unstable_by(|one, other| other.cmp(one));
        self.cells.truncate(MAX_CELLS);
    }

    /// The greatest distance of the middles and the polygons' corners of these cells; infinite beyond the radius.
    pub(super) fn distance_mm(
        mut self,
        rule: &Rule,
        one: &Measured<'_>,
        other: &Measured<'_>,
    ) -> Option<f64> {
        self.keep_farthest();
        let mut greatest = f64::from_bits(self.cells.first()?.0);
        let mut search = other.surface.search();
        let models = [one.model, other.model];
        let mut relief = PageRelief::new(&models);
        for (_, number, cell) in self.cells {
            one.surface.facets(one.surface.cell_place(number, cell), |_, facet| {
                facet.corners(|corner| {
                    let at_mm = rule.placement.apply(one.surface.space.to_world(corner));
                    let (_, (distance, _)) = rule.nearest(&mut search, other.surface.space.to_frame(at_mm));
                    greatest = distance.map_or(greatest, |distance| greatest.max(distance));
                });
            });
            // The next cell is elsewhere.
            relief.look();
        }
        Some(greatest)
    }
}
