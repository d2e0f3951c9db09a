//! Where the surface passes through a cube between eight samples.

use super::cases::{CASES, EDGES, ends, is_inside};
use super::signs::Boxes;
use super::tint::{Light, Lights, Mixture};
use crate::format::cell::Plane;
use crate::geom::VoxelIndex;
use crate::load::{CellItems, CellShape, ModelView, NodeView};
use crate::render::GridSpace;

/// Vertices keep this far from the faces of their cubes, in edges: so each sample stays on its side of the surface,
/// also after coordinates were rounded.
const MARGIN: f64 = 1.0 / 256.0;

/// A point of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spot {
    /// In edges of the cube, from its middle.
    pub(super) at: [f64; 3],
    /// Outward, of the patient's axes, of any length; zeros where nothing is known.
    pub(super) normal: [f64; 3],
    /// Black where the model has no colours.
    pub(super) light: Light,
}

/// Finds where patches lie.
pub(super) trait Spots {
    /// The point where a patch has its vertex.
    fn spot(&self, place: Patch) -> Spot;
}

/// The same point, kept away from the faces of its cube.
pub(super) fn held_within(at: [f64; 3]) -> [f64; 3] {
    let within = 0.5 - MARGIN;
    at.map(|c| c.clamp(-within, within))
}

/// A cube: between the samples `x - 1` and `x` along each axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) x: u32,
    pub(super) row: usize,
    pub(super) case: u8,
    pub(super) patch: u8,
}

/// The surface of a model in a layer of cubes.
pub(super) struct Layer<'a> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) space: &'a GridSpace,
    /// For voxels the slices below and above; for cells the slice itself.
    pub(super) boxes: [&'a Boxes; 2],
    /// If the model has colours.
    pub(super) lights: Option<&'a Lights>,
}

impl Spots for Layer<'_> {
    fn spot(&self, place: Patch) -> Spot {
        let spot = match self.view.cells() {
            Some(items) => self.in_cell(items, place),
            None => {
                let (normal, light) = self.of_voxels(place);
                Spot { at: middle(place, |_| 0.5), normal, light }
            }
        };
        Spot { at: held_within(spot.at), ..spot }
    }
}

impl Layer<'_> {
    /// The sum of the normals of the patch's inside voxels, and the mean of their colours.
    fn of_voxels(&self, place: Patch) -> ([f64; 3], Light) {
        let mut sum = [0.0; 3];
        let mut mixture = Mixture::default();
        let corners = patch_edges(place).map(|edge| ends(edge).map(|c| (c, is_inside(place.case, c))));
        let inside = corners.flat_map(|ends| ends.into_iter().filter(|(_, inside)| *inside));
        let seen = inside.fold(0_u8, |bits, (corner, _)| bits | 1 << corner);
        for corner in (0..8_u32).filter(|corner| seen >> corner & 1 == 1) {
            let x = place.x - 1 + (corner & 1);
            let row = place.row - 1 + (corner as usize >> 1 & 1);
            let skin = self.boxes[corner as usize >> 2].skin.row(row);
            let Ok(at) = skin.binary_search_by_key(&x, |(x, _)| *x) else { continue };
            let voxel = VoxelIndex::new(skin[at].1);
            if let Some(lights) = self.lights
                && let Some(color) = self.view.voxel_color(voxel)
            {
                mixture.add(lights.of(color));
            }
            let Some(code) = self.view.voxel_normal(voxel) else { continue };
            let normal = self.space.normal_to_world(crate::format::normal::decode(code).map(f64::from));
            (0..3).for_each(|a| sum[a] += normal[a]);
        }
        (sum, mixture.mean(self.lights.map_or([0; 3], Lights::nothing)))
    }

    fn in_cell(&self, items: CellItems<'_>, place: Patch) -> Spot {
        let skin = self.boxes[0].skin.row(place.row);
        let cell = skin.binary_search_by_key(&place.x, |(x, _)| *x).ok().map(|at| skin[at].1);
        let light = self.lights.map_or([0; 3], |lights| {
            let color = cell.and_then(|cell| self.view.voxel_color(VoxelIndex::new(cell)));
            color.map_or_else(|| lights.nothing(), |color| lights.of(color))
        });
        match cell.map(|cell| items.shape(cell)) {
            Some(CellShape::Plane(plane)) => Spot { light, ..self.on_plane(plane, place) },
            Some(CellShape::Corners(samples)) => {
                let value = |corner: usize| f64::from(samples[corner]);
                let at = middle(place, |edge| {
                    let [low, high] = ends(edge).map(value);
                    if (low > 0.0) == (high > 0.0) { 0.5 } else { low / (low - high) }
                });
                let slope = |axis: usize| -> f64 {
                    let along =
                        |corner: usize| if corner >> axis & 1 == 1 { -value(corner) } else { value(corner) };
                    (0..8).map(along).sum()
                };
                let normal = self.space.index_normal_to_world([0, 1, 2].map(slope));
                Spot { at, normal, light }
            }
            None => Spot { at: middle(place, |_| 0.5), normal: [0.0; 3], light },
        }
    }

    /// The point of the plane that is nearest to where it meets the patch's edges.
    fn on_plane(&self, plane: Plane, place: Patch) -> Spot {
        let n = plane.normal.map(f64::from);
        // A plane's own coordinates run from -1 to 1.
        let offset = f64::from(plane.offset) / 2.0;
        let value = |p: [f64; 3]| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - offset;
        let mean = middle(place, |edge| {
            let [low, high] = ends(edge).map(|corner| value(corner_at(corner)));
            if low == high { 0.5 } else { (low / (low - high)).clamp(0.0, 1.0) }
        });
        let square = n.iter().map(|c| c * c).sum::<f64>().max(1.0);
        let off = value(mean) / square;
        let at = std::array::from_fn(|a| mean[a] - off * n[a]);
        Spot { at, normal: self.space.index_normal_to_world(n), light: [0; 3] }
    }
}

/// The point of a plane that is nearest to the middle of its cell, held within it.
pub(super) fn nearest_on_plane(plane: Plane) -> [f64; 3] {
    let n = plane.normal.map(f64::from);
    let square = n.iter().map(|c| c * c).sum::<f64>().max(1.0);
    n.map(|c| (c * f64::from(plane.offset) / 2.0 / square).clamp(-0.5, 0.5))
}

/// A corner of a cube, from its middle.
pub(super) fn corner_at(corner: usize) -> [f64; 3] {
    [0, 1, 2].map(|a| if corner >> a & 1 == 1 { 0.5 } else { -0.5 })
}

/// The edges that a patch crosses.
fn patch_edges(place: Patch) -> impl Iterator<Item = usize> {
    let case = CASES[usize::from(place.case)];
    (0..EDGES).filter(move |edge| case.patch_of[*edge] == place.patch)
}

/// The mean of where a patch crosses its edges: `along` gives how far along each, 0 to 1.
pub(super) fn middle(place: Patch, along: impl Fn(usize) -> f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for edge in patch_edges(place) {
        let [low, _] = ends(edge);
        let mut at = corner_at(low);
        at[edge / 4] += along(edge);
        (0..3).for_each(|a| sum[a] += at[a]);
        count += 1.0;
    }
    sum.map(|c| c / f64::max(count, 1.0))
}
