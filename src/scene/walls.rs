//! Lines between the labels of a body (SPEC 4.12): from wall to wall, and the label at a point.

use crate::geom::{add_scaled, dot};
use crate::load::NodeView;
use crate::render::cells::Cells;
use crate::render::normals::shading_normal::{Line, NEAR_WALL, cell_coordinates};
use crate::render::single;
use crate::render::surface::Skin;
use crate::render::traverse::Hit;

use super::body::Body;

/// Greatest length of a sliver between two cells' planes, in boxes.
const SLIVER: f64 = 0.5;

impl Body<'_> {
    /// True if there are walls between labels.
    pub(super) fn has_walls(&self) -> bool {
        self.cells.is_some_and(|cells| cells.items().has_walls())
    }

    /// The label at a point, and the box that determines it: the first that a line along an axis meets.
    pub(super) fn label_at(&self, at: [f64; 3]) -> Option<(Hit, u16)> {
        for axis in 0..6 {
            let mut direction = [0.0; 3];
            direction[axis / 2] = if axis % 2 == 0 { 1.0 } else { -1.0 };
            let line = (at, direction);
            let (ray, _) = self.ray(line, 0.0, None)?;
            let hit = single::trace(self.form, self.part.view, &Skin, &ray, 0).hit?;
            // A hit at an edge is inconclusive; the next line decides.
            let [before, behind] = self.part.sides(line, &hit)?;
            if before == behind {
                return Some((hit, behind));
            }
        }
        None
    }

    /// Segments of a line from outside within visible labels: start, end, and the label.
    pub(super) fn runs(&self, line: Line) -> Vec<([f64; 2], u16)> {
        let (mut runs, mut now): (Vec<([f64; 2], u16)>, _) = (Vec::new(), (0.0, 0));
        let first = || {
            let (ray, before) = self.ray(line, 0.0, None)?;
            let cells = Cells::new(self.part.view.cells()?).hiding(self.part.hidden()?, 0);
            let hit = single::trace(self.form, self.part.view, &cells, &ray, 0).hit?;
            Some(Hit { t: before + hit.t, ..hit })
        };
        let mut met = first();
        while let Some(hit) = met {
            let sides = self.part.sides(line, &hit);
            let (Some([_, behind]), Some(hidden)) = (sides, self.part.hidden()) else { break };
            if now.1 > 0 {
                runs.push(([now.0, hit.t], now.1));
            }
            now = (hit.t, hidden.seen(behind));
            met = self.beyond(line, &hit);
        }
        runs
    }

    /// The next wall behind a wall met at t = 0, ignoring slivers: planes of neighbouring cells are a little apart, and
    /// of two planes crossed at once the last one counts.
    pub(super) fn next_wall(&self, line: Line, wall: &Hit) -> Option<Hit> {
        let mut met = self.beyond(line, &Hit { t: 0.0, ..*wall })?;
        loop {
            let [before, behind] = self.part.sides(line, &met)?;
            if before == behind {
                met = self.beyond(line, &met)?;
                continue;
            }
            let next = self.beyond(line, &met).filter(|next| self.boxes(line, next.t - met.t) < SLIVER);
            match next {
                Some(next) if self.part.sides(line, &next)?[1] == before => met = self.beyond(line, &next)?,
                _ => return Some(met),
            }
        }
    }

    /// The next change of label behind a wall.
    pub(super) fn beyond(&self, line: Line, wall: &Hit) -> Option<Hit> {
        let (part, hidden) = (self.part, self.part.hidden()?);
        let walls = part.view.walls(wall.voxel(part.view)?)?;
        let [_, behind] = part.beside(&walls, line, wall);
        let mut label = hidden.seen(behind);
        // Within the cell, in its own coordinates.
        let u = cell_coordinates(&part.space, wall.cell, add_scaled(line.0, wall.t, line.1));
        let way = part.space.world_to_grid().apply_vector(line.1).map(|c| 2.0 * c);
        let end = (0..3).filter(|a| way[*a] != 0.0).map(|a| (way[a].signum() - u[a]) / way[a]);
        let end = end.fold(f64::INFINITY, f64::min);
        let mut crossings = walls.crossings(u, way);
        crossings.retain(|t| *t > NEAR_WALL / dot(way, way).sqrt() && *t < end);
        for (at, t) in crossings.iter().enumerate() {
            let next = crossings.get(at + 1).copied().unwrap_or(end);
            let here = hidden.seen(walls.at(add_scaled(u, f64::midpoint(*t, next), way)));
            if here != label {
                return Some(Hit { face: None, t: wall.t + t, ..*wall });
            }
            label = here;
        }
        let (ray, before) = self.ray(line, wall.t, Some(wall))?;
        let cells = Cells::new(part.view.cells()?).hiding(hidden, label);
        let hit = single::trace(self.form, part.view, &cells, &ray, 0).hit?;
        Some(Hit { t: before + hit.t, ..hit })
    }
}
