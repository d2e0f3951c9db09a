//! Position of the surface in a cube between eight samples.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "components of 8 bits")]

use super::cases::{CROSSED, Crossed, EDGES, ENDS, is_inside};
use super::sample_signs::Item;
use super::vertex_color::{Light, Lights, Mixture};
use super::write::unit;
use crate::format::cell::{CORNERS, HAS_CORNERS};
use crate::format::normal;
use crate::geom::VoxelIndex;
use crate::interior::Rows;
use crate::load::{CellItems, ModelView, NodeView};
use crate::render::GridSpace;

/// Distance that vertices keep from the faces of their cubes, in edges: so each sample stays on its side of the
/// surface, also after coordinates were rounded.
const MARGIN: f64 = 1.0 / 256.0;

/// A point of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PatchPoint {
    /// Position in edges of the cube, from its middle.
    pub(super) at: [f64; 3],
    /// Outward unit normal in the patient's axes; zeros where none is known.
    pub(super) normal: [f32; 3],
    /// Colour; black for a model without colours.
    pub(super) light: Light,
}

/// The point, kept away from the faces of its cube.
#[inline(always)]
fn held_within(at: [f64; 3]) -> [f64; 3] {
    let within = 0.5 - MARGIN;
    [at[0].clamp(-within, within), at[1].clamp(-within, within), at[2].clamp(-within, within)]
}

/// A cube: between the samples `x - 1` and `x` along each axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) x: u32,
    pub(super) row: usize,
    pub(super) case: u8,
    pub(super) patch: u8,
}

/// The unit normal in world space of a vector in index space.
#[inline(always)]
fn in_world(space: &GridSpace, n: [f64; 3]) -> [f32; 3] {
    unit(singles(space.index_normal_to_world(n)))
}

#[expect(clippy::cast_possible_truncation, reason = "files hold 32-bit coordinates")]
#[inline(always)]
pub(super) fn singles(v: [f64; 3]) -> [f32; 3] {
    [v[0] as f32, v[1] as f32, v[2] as f32]
}

/// The surface of a model in a layer of cubes.
pub(super) struct Layer<'a> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) space: &'a GridSpace,
    /// Items of the slices below and above for voxels; of the layer itself for cells.
    pub(super) items: [&'a Rows<Item>; 2],
    /// Table of colours, if the model has colours.
    pub(super) lights: Option<&'a Lights>,
    /// The row of the last cube, and the first cell at or after it.
    pub(super) at: (usize, usize),
}

impl Layer<'_> {
    /// The vertex of a patch. Cubes come in rows, in each from left to right.
    #[inline(always)]
    pub(super) fn spot(&mut self, place: Patch) -> PatchPoint {
        let spot = match self.view.cells() {
            Some(items) => self.in_cell(items, place),
            None => {
                let (normal, light) = self.of_voxels(place);
                PatchPoint { at: middle(place, |_| 0.5), normal: unit(singles(normal)), light }
            }
        };
        PatchPoint { at: held_within(spot.at), ..spot }
    }

    /// The sum of the normals of the patch's inside voxels, and the mean of their colours.
    fn of_voxels(&self, place: Patch) -> ([f64; 3], Light) {
        let mut sum = [0.0; 3];
        let mut mixture = Mixture::default();
        let corners = patch_edges(place).map(|edge| ENDS[edge].map(|c| (c, is_inside(place.case, c))));
        let inside = corners.flat_map(|ends| ends.into_iter().filter(|(_, inside)| *inside));
        let seen = inside.fold(0_u8, |bits, (corner, _)| bits | 1 << corner);
        for corner in (0..8_u32).filter(|corner| seen >> corner & 1 == 1) {
            let x = place.x - 1 + (corner & 1);
            let row = place.row - 1 + (corner as usize >> 1 & 1);
            let skin = self.items[corner as usize >> 2].row(row);
            let Ok(at) = skin.binary_search_by_key(&x, |item| item.x) else { continue };
            let voxel = VoxelIndex::new(skin[at].number);
            if let Some(lights) = self.lights
                && let Some(color) = self.view.voxel_color(voxel)
            {
                mixture.add(lights.of(color));
            }
            let Some(code) = self.view.voxel_normal(voxel) else { continue };
            let normal = self.space.normal_to_world(normal::decode(code).map(f64::from));
            (0..3).for_each(|a| sum[a] += normal[a]);
        }
        (sum, mixture.mean(self.lights.map_or([0; 3], Lights::nothing)))
    }

    #[inline(always)]
    fn in_cell(&mut self, items: CellItems<'_>, place: Patch) -> PatchPoint {
        let (row, mut at) = self.at;
        if row != place.row {
            at = 0;
        }
        let skin = self.items[0].row(place.row);
        while skin.get(at).is_some_and(|item| item.x < place.x) {
            at += 1;
        }
        self.at = (place.row, at);
        let cell = skin.get(at).filter(|item| item.x == place.x);
        let light = self.lights.map_or([0; 3], |lights| {
            let color = cell.and_then(|cell| self.view.voxel_color(VoxelIndex::new(cell.number)));
            color.map_or_else(|| lights.nothing(), |color| lights.of(color))
        });
        match cell {
            Some(cell) if cell.offset == HAS_CORNERS => {
                let (at, normal) = between_corners(items.corners(cell.number), place);
                PatchPoint { at, normal: in_world(self.space, normal), light }
            }
            Some(cell) => {
                let crossed = &CROSSED[usize::from(place.case)][usize::from(place.patch)];
                let n = normal::decode_l1(cell.code);
                let at = on_plane(n, cell.offset, crossed);
                PatchPoint { at, normal: in_world(self.space, n.map(f64::from)), light }
            }
            None => PatchPoint { at: middle(place, |_| 0.5), normal: [0.0; 3], light },
        }
    }
}

/// The mean point where the surface between eight samples crosses a patch's edges, and its slope.
fn between_corners(samples: [i8; CORNERS], place: Patch) -> ([f64; 3], [f64; 3]) {
    let value = |corner: usize| f64::from(samples[corner]);
    let at = middle(place, |edge| {
        let [low, high] = ENDS[edge].map(value);
        if (low > 0.0) == (high > 0.0) { 0.5 } else { low / (low - high) }
    });
    let slope = |axis: usize| -> f64 {
        let along = |corner: usize| if corner >> axis & 1 == 1 { -value(corner) } else { value(corner) };
        (0..8).map(along).sum()
    };
    (at, [0, 1, 2].map(slope))
}

/// Coefficients for a component of a normal: the crossing on an edge along its axis, 0 to 1, is the plane's value at
/// the low end times the first number, plus the second; half-way where the plane runs along the edge.
static PLACES: [[f64; 2]; 256] = {
    let mut places = [[0.0, 0.5]; 256];
    let mut component = -128_i32;
    while component < 128 {
        if component != 0 {
            places[(component + 128) as usize] = [-0.5 / component as f64, 0.0];
        }
        component += 1;
    }
    places
};

/// Four bits as numbers.
static NIBBLES: [[f64; 4]; 16] = {
    let mut nibbles = [[0.0; 4]; 16];
    let mut bits = 0;
    while bits < 64 {
        nibbles[bits / 4][bits % 4] = ((bits / 4) >> (bits % 4) & 1) as f64;
        bits += 1;
    }
    nibbles
};

/// The point of a plane that is nearest to the mean of its crossings with the patch's edges.
#[inline(always)]
fn on_plane(normal: [i32; 3], offset: i8, crossed: &Crossed) -> [f64; 3] {
    let n = normal.map(f64::from);
    let [x, y, z] = n.map(|c| 2.0 * c);
    // In the plane's own coordinates, from -1 to 1, values at corners are whole numbers.
    let first = -(n[0] + n[1] + n[2]) - f64::from(offset);
    let share = 1.0 / f64::from(crossed.count);
    let mean = [
        sum_along(0, [first, first + y, first + z, first + y + z], normal, crossed) * share,
        sum_along(1, [first, first + x, first + z, first + x + z], normal, crossed) * share,
        sum_along(2, [first, first + x, first + y, first + x + y], normal, crossed) * share,
    ];
    let value = n[0] * mean[0] + n[1] * mean[1] + n[2] * mean[2] - f64::from(offset) / 2.0;
    let off = value / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    [mean[0] - off * n[0], mean[1] - off * n[1], mean[2] - off * n[2]]
}

/// The sum of the crossings of a patch's edges, from the cube's middle along an axis; `lows` are the plane's values at
/// the low ends of the edges along it.
#[inline(always)]
fn sum_along(axis: usize, lows: [f64; 4], normal: [i32; 3], crossed: &Crossed) -> f64 {
    let [scale, shift] = PLACES[usize::from((normal[axis] + 128) as u8)];
    let chosen = &NIBBLES[usize::from(crossed.along[axis] & 15)];
    let mut places = [0.0; 4];
    for i in 0..4 {
        let place = lows[i] * scale + shift;
        let held = if place > 0.0 { place } else { 0.0 };
        places[i] = chosen[i] * if held < 1.0 { held } else { 1.0 };
    }
    f64::from(crossed.ends[axis]) * 0.5 + ((places[0] + places[1]) + (places[2] + places[3]))
}

/// A corner of a cube, from its middle.
pub(super) fn corner_at(corner: usize) -> [f64; 3] {
    [0, 1, 2].map(|a| if corner >> a & 1 == 1 { 0.5 } else { -0.5 })
}

/// The edges that a patch crosses, from the first on.
#[inline(always)]
fn patch_edges(place: Patch) -> impl Iterator<Item = usize> {
    let [x, y, z] = CROSSED[usize::from(place.case)][usize::from(place.patch)].along.map(u32::from);
    let mut left = x | y << 4 | z << 8;
    std::iter::from_fn(move || {
        let edge = left.trailing_zeros() as usize;
        left &= left.wrapping_sub(1);
        (edge < EDGES).then_some(edge)
    })
}

/// The mean crossing of a patch with its edges: `along` is the crossing on each edge, 0 to 1.
#[inline(always)]
fn middle(place: Patch, along: impl Fn(usize) -> f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for edge in patch_edges(place) {
        let [low, _] = ENDS[edge];
        let mut at = corner_at(low);
        at[edge / 4] += along(edge);
        (0..3).for_each(|a| sum[a] += at[a]);
        count += 1.0;
    }
    sum.map(|c| c / f64::max(count, 1.0))
}
