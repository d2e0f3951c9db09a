//! Coarse boxes that their surface fills in part: what is behind shows through.
//!
//! A box of a level of detail is about as large as a pixel, and the skin in it covers a part of what the box covers of the
//! picture. The projections of the box's eight octants onto its faces, each face as wide as it looks along the ray, tell
//! how much. Where it is not all, the ray goes on to the boxes behind, and the colour is the mean of what was seen, in
//! linear light, by how much of it: the surface of a pixel lies in several boxes more often than in one. How much of the
//! pixel the model covers is told by rays around the middle, traced to boxes half as large; so a silhouette is not wider
//! by the size of the coarse boxes.
//!
//! ```text
//!   ray --> [1/4] --> [3/4] full         ray --> [1/4] --> background
//! ```
//!
//! Nothing is stored for this: the octants are the box's own infobyte, a byte a box that is seen.

use crate::geom::NodeIndex;
use crate::load::NodeView;

use super::around::Surroundings;
use super::picture::Painter;
use super::ray::Ray;
use super::shown::{Line, Seen};
use super::single;
use super::surface::Surface;

/// From here on a pixel is full.
const FULL: f64 = 0.97;

/// Boxes that a ray looks at most; then the pixel is full.
const MOST_BOXES: usize = 8;

/// What is added to where a ray leaves a box, in its edges: rounding must not keep it there.
const BEYOND: f64 = 1e-4;

/// Part of what a box covers that its octants cover, seen along a direction of the grid.
pub(super) fn covered(infobyte: u8, direction: [f64; 3]) -> f64 {
    let cells = |shift: u32, kept: u8| f64::from(((infobyte | infobyte >> shift) & kept).count_ones());
    let [x, y, z] = direction;
    let (x, y, z) = (x.abs(), y.abs(), z.abs());
    (x * cells(1, 0x55) + y * cells(2, 0x33) + z * cells(4, 0x0f)) / (4.0 * (x + y + z))
}

impl<V: NodeView, S: Surface<V>> Painter<'_, V, S> {
    /// Light and opacity of a pixel of coarse boxes; `None` where the first of them fills it.
    pub(super) fn mixed(
        &self,
        around: &mut Surroundings,
        first: Seen,
        line: Line,
        pixel: [usize; 2],
    ) -> Option<([f64; 3], f64)> {
        let space = self.sight.space();
        let (origin, direction) = (space.to_grid(line.0), space.world_to_grid().apply_vector(line.1));
        let part = |seen: Seen| covered(self.view.infobyte(NodeIndex::new(seen.box_number())), direction);
        let mut own = part(first);
        if own >= FULL {
            return None;
        }
        let edge = f64::from(1_u32 << self.canvas.lod_edge_log2.min(31));
        let (mut light, mut sum) = ([0.0; 3], 0.0);
        let mut seen = first;
        for _ in 0..MOST_BOXES {
            let own_light = self.light(seen, self.normals.normal(around, seen, line), line, pixel);
            let share = own.min(1.0 - sum);
            for c in 0..3 {
                light[c] += share * own_light[c];
            }
            sum += share;
            if sum >= FULL {
                break;
            }
            let after = leaves(origin, direction, f64::from(seen.depth()), edge);
            let behind = Ray::new(space.dims().depth(), origin, direction, after).ok().flatten();
            let Some(ray) = behind else { break };
            let trace = single::trace(self.form, self.view, &self.surface, &ray, self.canvas.lod_edge_log2);
            seen = Seen::new(&trace);
            if !seen.is_hit() {
                break;
            }
            own = part(seen);
        }
        Some((light.map(|c| c / sum), self.opacity(pixel)))
    }

    /// Part of a pixel that boxes half as large as those shown cover.
    fn opacity(&self, [x, y]: [usize; 2]) -> f64 {
        let finer = self.canvas.lod_edge_log2 - 1;
        let hits = |dx: f64, dy: f64| {
            let ray = self.sight.ray(x as f64 + dx, y as f64 + dy);
            let hit = ray.is_some_and(|ray| {
                single::trace(self.form, self.view, &self.surface, &ray, finer).hit.is_some()
            });
            u32::from(hit)
        };
        let few = hits(0.125, 0.125) + hits(0.875, 0.125) + hits(0.125, 0.875) + hits(0.875, 0.875);
        if few == 4 {
            return 1.0;
        }
        let many: u32 =
            (0..16_u32).map(|i| hits(0.125 + 0.25 * f64::from(i % 4), 0.125 + 0.25 * f64::from(i / 4))).sum();
        f64::from(many) / 16.0
    }
}

/// When a ray leaves the box of this edge that it enters after `enters`, and a little later.
fn leaves(origin: [f64; 3], direction: [f64; 3], enters: f64, edge: f64) -> f64 {
    let fastest = direction.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
    // A little within, to be in the box and not before it.
    let within = enters + BEYOND * edge / fastest;
    let mut after = f64::INFINITY;
    for a in 0..3 {
        if direction[a] != 0.0 {
            let cell = ((origin[a] + within * direction[a]) / edge).floor();
            let border = if direction[a] > 0.0 { cell + 1.0 } else { cell };
            after = after.min((border * edge - origin[a]) / direction[a]);
        }
    }
    after + BEYOND * edge / fastest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octants_cover_what_they_hide() {
        let along = |axis: usize| std::array::from_fn(|a| if a == axis { -3.0 } else { 0.0 });
        for axis in 0..3 {
            assert_eq!(covered(0xff, along(axis)), 1.0);
            assert_eq!(covered(0x01, along(axis)), 0.25);
            // A slab across the axis covers all of it, and half as seen from its edges.
            let slab = [0x55, 0x33, 0x0f][axis];
            for seen in 0..3 {
                assert_eq!(covered(slab, along(seen)), if seen == axis { 1.0 } else { 0.5 });
            }
        }
        assert_eq!(covered(0x81, [1.0, 1.0, 1.0]), 0.5);
    }

    #[test]
    fn rays_leave_boxes_by_their_far_faces() {
        let after = leaves([-10.0, 1.0, 5.0], [1.0, 0.0, -0.25], 10.0, 4.0);
        assert!((after - 14.0).abs() < 0.01, "{after}");
        let after = leaves([10.0, 1.0, 5.0], [-2.0, 0.0, 0.0], 1.0, 8.0);
        assert!((after - 5.0).abs() < 0.01, "{after}");
    }
}
