//! Cells of a solid that gives the crossings of its surface with the edges between samples, and the normals there.
//!
//! ```text
//!   bits of a brick's slice --> edges whose ends differ --crossings offered--> plane of every cell, or its corners
//! ```
//!
//! If an edge is crossed several times, the crossing next to the outside end counts: from there on the edge is inside.
//! Ties go by the normals, so that the order in which crossings are offered does not matter.
#![expect(
    clippy::cast_possible_truncation,
    reason = "coordinates are below 2^17, places along an edge within 0..=1"
)]

use super::corner::EDGES;
use super::items::CellItems;
use super::single_fit::{CellShape, pick_crossed};
use crate::builder::item::ItemForm;
use crate::builder::skin::BRICK_ROWS;
use crate::builder::solid::{EdgeCrossing, SkinSlice};
use crate::format::Channel;
use crate::geom::Dims;

/// Samples of a brick's cells along x and y.
const SIDE: usize = BRICK_ROWS + 1;
/// Families of edges: along x and y in the lower and the upper slice of samples, and along z.
const FAMILIES: usize = 5;
/// Parts of an edge: the resolution of a crossing.
const PARTS: f64 = 65536.0;
/// Parts of a unit normal.
const NORMAL: f64 = 16384.0;
const LOW_33: u64 = (1 << SIDE) - 1;

/// A crossing of an edge: its distance from the outside end, and the normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Crossing {
    away: u32,
    normal: [i16; 3],
}

const NOT_CROSSED: Crossing = Crossing { away: u32::MAX, normal: [0; 3] };

/// An edge between two samples, one of them inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CellEdge {
    /// The sample at its low end; -1 before the first one.
    pub(crate) low: [i32; 3],
    pub(crate) axis: usize,
    pub(crate) low_inside: bool,
}

/// Rounds to the nearest integer, halves up, without `floor`, which is a function call on older processors.
#[inline(always)]
fn rounded(v: f64) -> i32 {
    let up = v + 0.5;
    let whole = up as i32;
    whole - i32::from(f64::from(whole) > up)
}

/// The edges of a brick's cells in one slice, and the items of these cells.
pub(crate) struct CellEdges {
    /// The lowest sample.
    corner: [i32; 3],
    /// Edges whose ends differ, by their low sample: bit x of row y.
    wanted: [[u64; SIDE]; FAMILIES],
    low_inside: [[u64; SIDE]; FAMILIES],
    crossings: Vec<Crossing>,
    /// The last offered normal, and its parts at length 1: as given and negated.
    facing: ([f64; 3], [[i16; 3]; 2]),
    items: CellItems,
}

impl CellEdges {
    pub(crate) const BYTES: u64 =
        (size_of::<Self>() + Self::MAX_EDGES * size_of::<Crossing>() + CellItems::BYTES) as u64;

    /// Most edges of a brick's cells in one slice.
    pub(crate) const MAX_EDGES: usize = FAMILIES * SIDE * SIDE;

    pub(crate) fn new() -> Self {
        Self {
            corner: [0; 3],
            wanted: [[0; SIDE]; FAMILIES],
            low_inside: [[0; SIDE]; FAMILIES],
            crossings: vec![NOT_CROSSED; Self::MAX_EDGES],
            facing: ([0.0; 3], [[0; 3]; 2]),
            items: CellItems::new(),
        }
    }

    pub(crate) fn form(channel: Channel) -> Option<ItemForm> {
        super::cell_form(channel)
    }

    /// Items of the cells that were described last.
    pub(crate) fn items(&self, channel: Channel) -> &[u8] {
        self.items.of(channel)
    }

    /// Begins a slice of cells: finds the edges whose ends differ, and forgets their crossings.
    pub(crate) fn begin(&mut self, skin: &SkinSlice<'_>) {
        [self.corner, _] = Self::samples_of(skin);
        self.wanted = [[0; SIDE]; FAMILIES];
        self.low_inside = [[0; SIDE]; FAMILIES];
        for (y, row) in skin.rows().iter().enumerate() {
            if *row == 0 {
                continue;
            }
            let [a, b, c, d] = skin.corner_samples(y).map(|samples| samples & LOW_33);
            let along_x = |samples: u64| (samples ^ samples >> 1) & (LOW_33 >> 1);
            let mut want = |family: usize, y: usize, edges: u64, low: u64| {
                self.wanted[family][y] |= edges;
                self.low_inside[family][y] |= low;
            };
            want(0, y, along_x(a), a);
            want(0, y + 1, along_x(b), b);
            want(1, y, along_x(c), c);
            want(1, y + 1, along_x(d), d);
            want(2, y, a ^ b, a);
            want(3, y, c ^ d, c);
            want(4, y, a ^ c, a);
            want(4, y + 1, b ^ d, b);
        }
        self.forget();
    }

    /// A crossing in its stored form, for an edge whose lower end is inside if `low_inside`: position and normal are
    /// rounded, the normal is turned outwards.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to 16 bits")]
    pub(crate) fn kept(crossing: &EdgeCrossing, low_inside: bool) -> EdgeCrossing {
        let EdgeCrossing { low, axis, along, normal } = *crossing;
        let turned = |along: f64| if low_inside { 1.0 - along } else { along };
        let away = f64::from(rounded(turned(along).clamp(0.0, 1.0) * PARTS)) / PARTS;
        let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        let sign = if (normal[axis] >= 0.0) == low_inside { NORMAL } else { -NORMAL };
        let normal = normal.map(|c| f64::from(rounded(c / length * sign) as i16));
        EdgeCrossing { low, axis, along: turned(away), normal }
    }

    /// Begins with those edges of `others` whose ends differ by `inside`.
    pub(crate) fn begin_among(&mut self, others: &Self, inside: impl Fn([i32; 3]) -> bool) {
        self.corner = others.corner;
        self.wanted = [[0; SIDE]; FAMILIES];
        self.low_inside = [[0; SIDE]; FAMILIES];
        for CellEdge { low, axis, .. } in others.wanted() {
            let mut high = low;
            high[axis] += 1;
            let low_inside = inside(low);
            if let (true, Some([family, y, x])) = (low_inside != inside(high), others.place(low, axis)) {
                self.wanted[family][y] |= 1 << x;
                self.low_inside[family][y] |= u64::from(low_inside) << x;
            }
        }
        self.forget();
    }

    /// Forgets the crossings of the edges whose ends differ.
    fn forget(&mut self) {
        let Self { wanted, crossings, .. } = self;
        for (rows, family) in wanted.iter().zip(crossings.chunks_exact_mut(SIDE * SIDE)) {
            for (edges, row) in rows.iter().zip(family.chunks_exact_mut(SIDE)) {
                let mut left = *edges;
                while left != 0 {
                    row[left.trailing_zeros() as usize] = NOT_CROSSED;
                    left &= left - 1;
                }
            }
        }
    }

    /// The lowest and the highest sample at the corners of a slice's cells.
    #[expect(clippy::cast_possible_wrap, reason = "coordinates are below 2^17")]
    pub(crate) fn samples_of(skin: &SkinSlice<'_>) -> [[i32; 3]; 2] {
        let [x, y, z] = skin.corner().map(|c| c as i32 - 1);
        let last = BRICK_ROWS as i32;
        [[x, y, z], [x + last, y + last, z + 1]]
    }

    /// The edges whose ends differ.
    pub(crate) fn wanted(&self) -> impl Iterator<Item = CellEdge> + '_ {
        let rows = self.wanted.iter().zip(&self.low_inside).zip(0_u8..);
        rows.flat_map(move |((wanted, inside), family)| {
            wanted.iter().zip(inside).zip(0_i32..).flat_map(move |((edges, inside), y)| {
                let mut left = *edges;
                std::iter::from_fn(move || {
                    let x = left.trailing_zeros();
                    left &= left.wrapping_sub(1);
                    let [x0, y0, z0] = self.corner;
                    (x < u64::BITS).then(|| CellEdge {
                        low: [x0 + x.cast_signed(), y0 + y, z0 + i32::from(family & 1 == 1)],
                        axis: usize::from(family / 2),
                        low_inside: inside >> x & 1 == 1,
                    })
                })
            })
        })
    }

    /// Slot of an edge: its family, row and column; `None` for an edge whose ends are alike.
    #[inline]
    fn place(&self, low: [i32; 3], axis: usize) -> Option<[usize; 3]> {
        let [x, y, z] = [0, 1, 2].map(|k| (low[k] - self.corner[k]).cast_unsigned() as usize);
        let family = match (axis, z) {
            (0 | 1, 0 | 1) => 2 * axis + z,
            (2, 0) => 4,
            _ => return None,
        };
        let is_wanted = x < SIDE && y < SIDE && self.wanted[family][y] >> x & 1 == 1;
        is_wanted.then_some([family, y, x])
    }

    /// Offers a crossing; ignored for edges whose ends are alike.
    #[inline]
    pub(crate) fn offer(&mut self, crossing: &EdgeCrossing) {
        let EdgeCrossing { low, axis, along, normal } = *crossing;
        let Some([family, y, x]) = self.place(low, axis) else { return };
        let low_inside = self.low_inside[family][y] >> x & 1 == 1;
        let away = if low_inside { 1.0 - along } else { along };
        // Outwards is from the inside end to the other.
        let is_turned = (normal[axis] >= 0.0) != low_inside;
        #[expect(clippy::float_cmp, reason = "a triangle's normal comes as it came before")]
        if self.facing.0 != normal {
            let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
            let parts = |sign: f64| normal.map(|c| rounded(c / length * sign) as i16);
            self.facing = (normal, [parts(NORMAL), parts(-NORMAL)]);
        }
        let crossing = Crossing {
            away: rounded(away.clamp(0.0, 1.0) * PARTS).cast_unsigned(),
            normal: self.facing.1[usize::from(is_turned)],
        };
        let known = &mut self.crossings[(family * SIDE + y) * SIDE + x];
        *known = crossing.min(*known);
    }

    /// The deciding crossing among those offered for an edge; its normal points outwards.
    pub(crate) fn crossing(&self, low: [i32; 3], axis: usize) -> Option<EdgeCrossing> {
        let [family, y, x] = self.place(low, axis)?;
        let low_inside = self.low_inside[family][y] >> x & 1 == 1;
        let Crossing { away, normal } = self.crossings[(family * SIDE + y) * SIDE + x];
        let away = f64::from(away) / PARTS;
        (away <= 1.0).then(|| EdgeCrossing {
            low,
            axis,
            along: if low_inside { 1.0 - away } else { away },
            normal: normal.map(f64::from),
        })
    }

    /// Describes the cells. Edges without a crossing are cut in the middle, as at the wall of the grid, which is half a
    /// voxel from the outermost samples, or at a hole in the surface.
    pub(crate) fn describe(&mut self, skin: &SkinSlice<'_>, samples: Dims) {
        self.items.clear();
        for (y, row) in skin.rows().iter().enumerate() {
            if *row == 0 {
                continue;
            }
            let corners = skin.corner_samples(y);
            let mut left = *row;
            while left != 0 {
                let x = left.trailing_zeros() as usize;
                left &= left - 1;
                let pair = |edge: usize| (corners[edge] >> x & 3) as u8;
                let mask = pair(0) | pair(1) << 2 | pair(2) << 4 | pair(3) << 6;
                let cell = self.cell([x, y], mask, samples);
                self.items.push(cell);
            }
        }
    }

    /// Shape of one cell by the crossings of its edges.
    fn cell(&self, [x, y]: [usize; 2], mask: u8, samples: Dims) -> CellShape {
        let (mut along, mut normals) = ([f32::NAN; 12], [[0.0_f32; 3]; 12]);
        for (at, (p, q)) in EDGES.into_iter().enumerate() {
            if (mask >> p ^ mask >> q) & 1 == 0 {
                continue;
            }
            let axis = (p ^ q).trailing_zeros() as usize;
            let (dx, dy, dz) = (p & 1, p >> 1 & 1, p >> 2);
            let family = if axis == 2 { 4 } else { 2 * axis + dz };
            let crossing = self.crossings[(family * SIDE + y + dy) * SIDE + x + dx];
            let low_inside = mask >> p & 1 == 1;
            if crossing == NOT_CROSSED {
                along[at] = 0.5;
                let low = self.corner[axis] + [x + dx, y + dy, dz][axis] as i32;
                if low < 0 || low + 1 >= samples.to_array()[axis].cast_signed() {
                    normals[at][axis] = if low_inside { 1.0 } else { -1.0 };
                }
                continue;
            }
            #[expect(clippy::cast_precision_loss, reason = "at most 2^16")]
            let away = crossing.away as f32 / PARTS as f32;
            along[at] = if low_inside { 1.0 - away } else { away };
            normals[at] = crossing.normal.map(|c| f32::from(c) / NORMAL as f32);
        }
        pick_crossed(mask, &along, &normals)
    }
}
