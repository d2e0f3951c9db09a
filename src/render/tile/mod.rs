//! Primary rays: 8 x 8 neighbours walk the octree together.

mod beam;
mod prove;
mod walk;

use crate::load::NodeView;

use super::form::Form;
use super::ray::Face;
use super::sight::Sight;
use super::surface::Surface;
use super::traverse::Hit;

pub use beam::{RAYS, TILE};

/// Which rays to trace, and how far down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Column and row of the picture's pixel at the tile's top left.
    pub corner: (usize, usize),
    /// Columns and rows to trace, up to [`TILE`] each.
    pub limits: (usize, usize),
    /// Boxes of an edge of 2^this cells count as surface; 0 for voxels.
    pub lod_edge_log2: u32,
}

impl Tile {
    /// The rays to trace, as bits: ray `8 y + x` is that of column x and row y.
    fn live(&self) -> u64 {
        let (columns, rows) = (self.limits.0.min(TILE), self.limits.1.min(TILE));
        let row = (1_u64 << columns) - 1;
        (0..rows).fold(0, |live, y| live | row << (TILE * y))
    }
}

/// What a tile's rays hit.
#[derive(Clone, Debug)]
pub struct TileHits {
    /// Rays that hit, as bits.
    hits: u64,
    number: [u64; RAYS],
    cell: [[u32; RAYS]; 3],
    edge_log2: u32,
    t: [f64; RAYS],
    /// 2 axis + high, or [`NO_FACE`].
    face: [u8; RAYS],
    steps: [u32; RAYS],
}

/// Of a ray that starts in what it hits.
const NO_FACE: u8 = u8::MAX;

impl TileHits {
    const fn new() -> Self {
        Self {
            hits: 0,
            number: [0; RAYS],
            cell: [[0; RAYS]; 3],
            edge_log2: 0,
            t: [0.0; RAYS],
            face: [NO_FACE; RAYS],
            steps: [0; RAYS],
        }
    }

    fn clear(&mut self, edge_log2: u32) {
        self.hits = 0;
        self.edge_log2 = edge_log2;
        self.steps = [0; RAYS];
    }

    #[expect(clippy::cast_possible_truncation, reason = "an axis is 0, 1 or 2")]
    fn set(&mut self, ray: usize, hit: &Hit) {
        let ray = ray % RAYS;
        self.hits |= 1 << ray;
        self.number[ray] = hit.box_number;
        for a in 0..3 {
            self.cell[a][ray] = hit.cell[a];
        }
        self.edge_log2 = hit.edge_log2;
        self.t[ray] = hit.t;
        self.face[ray] = hit.face.map_or(NO_FACE, |f| 2 * f.axis + u8::from(f.high));
    }

    /// The hits of a row that begins with ray `first`.
    #[inline(always)]
    fn set_row(&mut self, first: usize, hits: u32, entries: &prove::Entries, mirror: u32) {
        self.hits |= u64::from(hits) << first;
        let high = |axis: u32| (mirror >> axis & 1) as u8;
        for (i, t) in entries.t.iter().enumerate() {
            let by = |axis: usize| entries.by_axis[axis] >> i & 1 == 1;
            let ray = (first + i) % RAYS;
            self.t[ray] = *t;
            self.face[ray] = if by(0) {
                high(0)
            } else if by(1) {
                2 + high(1)
            } else if by(2) {
                4 + high(2)
            } else {
                NO_FACE
            };
        }
    }

    /// Rays that hit, as bits: ray `8 y + x` is that of column x and row y.
    #[inline]
    pub fn bits(&self) -> u64 {
        self.hits
    }

    /// The hit of a ray, if it hit.
    #[inline]
    pub fn hit(&self, ray: usize) -> Option<Hit> {
        let face = *self.face.get(ray)?;
        (self.hits >> ray & 1 == 1).then(|| Hit {
            box_number: self.number[ray],
            cell: [0, 1, 2].map(|a| self.cell[a][ray]),
            edge_log2: self.edge_log2,
            face: (face != NO_FACE).then(|| Face::new(usize::from(face / 2), face % 2 == 1)),
            t: self.t[ray],
        })
    }

    /// Bricks that a ray was compared with, alone or with its tile.
    #[inline]
    pub fn steps(&self, ray: usize) -> u32 {
        self.steps.get(ray).copied().unwrap_or(0)
    }
}

/// Traces tiles, one after the other. Memory: 7 KiB.
pub struct Tracer {
    form: Form,
    scratch: walk::Scratch,
    hits: TileHits,
}

impl std::fmt::Debug for Tracer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracer").field("form", &self.form).finish_non_exhaustive()
    }
}

impl Default for Tracer {
    fn default() -> Self {
        Self::new(Form::best())
    }
}

impl Tracer {
    /// A tracer of this form.
    pub const fn new(form: Form) -> Self {
        Self { form, scratch: walk::Scratch::new(), hits: TileHits::new() }
    }

    /// First hits of a tile's rays: those of [`super::traverse::first_hit_sealed`], for every form.
    ///
    /// The view must be as deep as the sight's grid. Any view is safe, whatever it answers.
    #[inline]
    pub fn trace<V: NodeView, S: Surface<V>>(
        &mut self,
        view: &V,
        surface: &S,
        sight: &Sight<'_>,
        tile: Tile,
    ) -> &TileHits {
        let Self { form, scratch, hits } = self;
        form.run(walk::Walk { view, surface, sight, tile, scratch, hits });
        hits
    }
}
