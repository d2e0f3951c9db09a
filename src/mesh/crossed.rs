//! A mesh as a solid of cells: planes at the crossings of its triangles with the edges between voxel centres.
//!
//! The centres that are inside are the same as for skin. An edge with one end inside is crossed where it meets a
//! triangle; a triangle holds its border here, as no crossings are counted. The normal there is the triangle's. So
//! neither the order of triangles nor memory nor threads change a cell.
#![expect(
    clippy::cast_possible_truncation,
    reason = "coordinates are below 2^17 voxels, and places are known within 2^-16 voxel"
)]

use super::lattice::{HALF, STEPS, Triangle, first_centre, last_centre, span};
use super::solid::{MeshSolid, MeshWorker};
use crate::builder::{
    CellEdges, Cover, EdgeCrossing, ItemForm, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker,
    Tile, VoxelBox,
};
use crate::format::{Channel, Metadata, SurfaceKind};
use crate::geom::Dims;
use crate::volume::SourceError;

/// Distance from a centre, in voxels, below which a crossing belongs to both edges that end there.
const SAME: f64 = 1.0 / 65536.0;
/// The source of its planes, for the model.
const ESTIMATOR: &str = "triangle planes";

/// The cells of a mesh whose triangles have been binned for [`cell_dims`](crate::builder::cell_dims).
pub(super) struct MeshCells {
    pub(super) mesh: MeshSolid,
    pub(super) dims: Dims,
}

impl Solid for MeshCells {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn inner(&self) -> Option<&dyn Solid> {
        Some(&self.mesh)
    }

    fn surface(&self) -> SurfaceKind {
        SurfaceKind::Cells
    }

    fn metadata(&self, found: &ScanSummary) -> Metadata {
        Metadata { gradient: ESTIMATOR.into(), ..self.mesh.metadata(found) }
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        CellEdges::form(channel).or_else(|| self.mesh.wanted?.form(channel))
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        self.mesh.worker_bytes(tile) + CellEdges::BYTES
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(CellWorker {
            samples: self.mesh.dims(),
            mesh: MeshWorker::new(&self.mesh, tile),
            edges: CellEdges::new(),
        })
    }
}

struct CellWorker<'a> {
    samples: Dims,
    mesh: MeshWorker<'a>,
    edges: CellEdges,
}

impl SolidWorker for CellWorker<'_> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.mesh.start(column)
    }

    fn cover(&mut self, region: &VoxelBox) -> Cover {
        self.mesh.cover(region)
    }

    fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        self.mesh.occupancy(rows)?;
        rows.clear_beyond(self.samples);
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.edges.begin(skin);
        let (samples, edges) = (CellEdges::samples_of(skin), &mut self.edges);
        self.mesh.each_near(skin, &mut |t| {
            cross_edges(t, samples, &mut |crossing| edges.offer(crossing));
        })?;
        self.edges.describe(skin, self.samples);
        match &mut self.mesh.painter {
            Some(painter) => {
                let [codes, offsets] = [Channel::Normal, Channel::Offset].map(|of| self.edges.items(of));
                painter.cells(skin, codes, offsets)
            }
            None => Ok(()),
        }
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match (channel, &self.mesh.painter) {
            (Channel::Color | Channel::Material, Some(painter)) => painter.items(channel),
            _ => self.edges.items(channel),
        }
    }
}

/// Offers the crossings of a triangle with the edges between samples, of a box of these.
pub(crate) fn cross_edges(
    t: &Triangle,
    [lowest, highest]: [[i32; 3]; 2],
    offer: &mut impl FnMut(&EdgeCrossing),
) {
    let (mut from, mut to, mut normal) = ([0; 3], [0; 3], None);
    for k in 0..3 {
        let (low, high) = span(t, k);
        if last_centre(high) + 1 < lowest[k] || first_centre(low) - 1 > highest[k] {
            return;
        }
        from[k] = first_centre(low).max(lowest[k]);
        to[k] = last_centre(high).min(highest[k]);
    }
    for axis in 0..3 {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        if from[b] > to[b] || from[c] > to[c] {
            continue;
        }
        let at = |vertex: usize, k: usize| i64::from(t[3 * vertex + k]);
        let area =
            (at(1, b) - at(0, b)) * (at(2, c) - at(0, c)) - (at(1, c) - at(0, c)) * (at(2, b) - at(0, b));
        if area == 0 {
            continue;
        }
        let sign = area.signum();
        let centre = |c: i32| i64::from(c) * i64::from(STEPS) + i64::from(HALF);
        let start = [centre(from[b]), centre(from[c])];
        // Twice the area between a side and a line, 0 or more within: at the first centre, and how it changes from one
        // to the next.
        let side = |p: usize, q: usize| {
            let (y, z) = (sign * (at(q, b) - at(p, b)), sign * (at(q, c) - at(p, c)));
            let first = y * (start[1] - at(p, c)) - z * (start[0] - at(p, b));
            [first, -z * i64::from(STEPS), y * i64::from(STEPS)]
        };
        let ([first_0, right_0, up_0], [first_1, right_1, up_1]) = (side(1, 2), side(2, 0));
        let [first_2, right_2, up_2] = side(0, 1);
        // Scalars: an array would go through memory, and each step would wait for it.
        let (mut row_0, mut row_1, mut row_2) = (first_0, first_1, first_2);
        for row in from[c]..=to[c] {
            let (mut next_0, mut next_1, mut next_2) = (row_0, row_1, row_2);
            (row_0, row_1, row_2) = (row_0 + up_0, row_1 + up_1, row_2 + up_2);
            for column in from[b]..=to[b] {
                let (w0, w1, w2) = (next_0, next_1, next_2);
                (next_0, next_1, next_2) = (w0 + right_0, w1 + right_1, w2 + right_2);
                if w0 | w1 | w2 < 0 {
                    continue;
                }
                let part = |weight: i64, vertex: usize| weight as f64 * f64::from(t[3 * vertex + axis]);
                let sum = part(w0, 0) + part(w1, 1) + part(w2, 2);
                let place = (sum / area.abs() as f64 - f64::from(HALF)) / f64::from(STEPS);
                let below = place as i32;
                let first = below - i32::from(f64::from(below) > place);
                let along = place - f64::from(first);
                let mut low = [0; 3];
                (low[axis], low[b], low[c]) = (first, column, row);
                let normal = *normal.get_or_insert_with(|| normal_of(t));
                offer(&EdgeCrossing { low, axis, along, normal });
                if along <= SAME {
                    low[axis] -= 1;
                    offer(&EdgeCrossing { low, axis, along: 1.0, normal });
                } else if along >= 1.0 - SAME {
                    low[axis] += 1;
                    offer(&EdgeCrossing { low, axis, along: 0.0, normal });
                }
            }
        }
    }
}

/// The normal, of any length.
fn normal_of(t: &Triangle) -> [f64; 3] {
    let way = |vertex: usize, k: usize| i64::from(t[3 * vertex + k]) - i64::from(t[k]);
    [0, 1, 2].map(|k| {
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        (way(1, b) * way(2, c) - way(1, c) * way(2, b)) as f64
    })
}
