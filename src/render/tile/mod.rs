//! Primary rays: 8 x 8 neighbours walk the octree together.
//!
//! ```text
//! Sight --Pencil--> Beam: nodes, two levels at a time, over-estimated for all 64 rays at once
//!   |                 |  brick of 4 x 4 x 4 finest boxes
//!   |                 v
//!   |               which rays come near it; for each, which boxes its line intersects
//!   |                 |  lowest occupied one: a candidate
//!   '-----Row-------> prove: eight exact rays decide in integers --> TileHits
//!                     |  not proved, or no beam: one ray alone (`single`)
//! ```
//!
//! 1. **Two levels at once.** `occupancy` gives the 4 x 4 x 4 boxes below a node as 64 bits.
//! 2. **Order for free.** In mirrored coordinates no ray runs backwards, so Morton order is front to back for
//!    all of them, and the first hit is the lowest set bit of intersected and occupied.
//! 3. **Boxes by three projections.** Three intervals on a line have a point in common if every two have; so a line
//!    intersects a box if and only if it does so in the projections onto xy, xz and yz. Each is a plane of 16 cells:
//!    one comparison of 16 lanes, extruded along the third axis to 64 bits.
//! 4. **Estimates are wide, the decision is exact.** Nodes are estimated for the whole beam with singles that
//!    start from doubles in the node; a slack of 2^-12 box (more where a pixel covers many boxes) covers their
//!    rounding and that of the rays. What is left is decided once a ray in integers.
//! 5. **Surfaces within boxes** are looked at box by box with the ray's integers as doubles (`exact`): nearly
//!    always that is certain, and what is not is decided in integers. With VBMI2 the pairs of a ray and a plane in a
//!    brick are listed and compared sixteen at a time in singles first (`planes`; with AVX2, which gathers slowly, `words`), and
//!    what is sure is taken. The plane of
//!    a larger leaf (`larger`) is compared with all 64 rays at once; those of 2 x 2 x 2 cells are listed with the cells.
//! 6. **Alone** go the rays of a tile in which an axis changes its sign, of one that has looked at more than
//!    1024 bricks, and those whose candidate was not entered after all.
//!
//! Arrays of rays with an image's layout also make tiles: `listed` fits the affine functions that tiles need, and
//! measures the rays' distances from them. With VBMI2, 1024^2 pixels of 512^3 samples: 10 to 14 M first hits a second,
//! 3.8 to 4.7 by [`super::batch`]. Coarse pictures fit less well and are left to that.
//!
//! The volume's box needs no test: a beam descends into occupied boxes only, so air around a flat volume
//! costs nothing.
//!
//! # What was tried
//!
//! One thread, AVX2, 1024^2 pixels, on two virtual cores (Zen 3) that other work shared: only the two sides
//! of a line were measured in turns.
//!
//! | step | effect |
//! |---|---|
//! | vectors in closures, as `array::map` takes them, against loops and a macro | 3.6 -> 19 M rays/s (256^3): closures are inlined after their intrinsics, if at all, and every instruction is a call |
//! | candidates, cells and faces written once, worked out when read | 14 % less time (1024^3) |
//! | ranks and infobytes always inlined | about 20 % less: the call had no population count, and all registers were saved around it |
//! | the next brick fetched while rays are compared with one | 2 to 9 % more time: ranks of bricks that no living ray is near; dropped |
//! | what lies behind a ray asked for only in bricks that do not lie beyond all origins along some axis | parallel 1.2 to 1.3 times as fast, where the picture's plane lies in the grid (AVX-512) |
//! | fused multiply-add | not used: without it every form gives the same bits, steps included |
//!
//! A tile of that picture compares 12 bricks with its beam (9 of them have a ray near), its rays with 81
//! bricks (2.5 a hit), opens 9 inner nodes and proves 4 rows of 8. Time goes to: rays against bricks 20 %,
//! infobytes and ranks 20 %, exact rays and proof 16 %, beam against bricks and nodes 16 %, keeping
//! candidates 10 %, setting up a tile 5 %.
//!
//! Cells, with AVX2: the same picture of 1024^3 samples, perspective. A hit takes 2.9 bricks compared with a ray (of voxels 2.2)
//! and 2.75 planes looked at, two of three of which the ray goes past. Voxels take 48 ms.
//!
//! | step | effect |
//! |---|---|
//! | where a ray crosses the plane, instead of when it enters and leaves the cell: no division, no face to choose | 108 -> 97 ms (parallel 113 -> 97) |
//! | the same with an axis in each of four lanes of doubles, with or without the normal decoded there | 93 to 98 ms; dropped |
//! | all pairs of a ray and a cell in a brick listed, asked without a branch, then read | 100 ms: a quarter of them lie behind a hit; dropped |
//! | eight such pairs at a time in singles, about a point of the ray near the brick | 111 ms: listing and gathering take what the arithmetic saves; dropped |
//! | pairs of a brick listed and compared sixteen at a time in singles, by how far the ray passes by the brick's middle; a row's hits proved in doubles at once | the same pictures in 10 % more time: gathering a group from the tile's arrays takes as long as looking at its planes one by one; dropped |
//! | the cells of a ray in a brick (1.6 of them) as four lanes of doubles, one choice for all | as many instructions, 40 % fewer wrong guesses, the same time (within 5 %); dropped |
//! | normals from a table of all codes, an axis in each lane, no decoding | 15 % fewer instructions of the whole, the same time; dropped |
//! | the same for two cells at once, the first that is met chosen without a branch | the same time; dropped |
//! | with VBMI2: pairs listed by compression, the planes of a brick decoded at once, sixteen pairs compared, times a row at a time (kept) | perspective .68 to .71, parallel .55 to .64 of the time at 512^3 samples: .74 of voxels' speed |
//! | with AVX2: a word for each plane and pair, rays from their column and row instead of gathers, a bit scan a ray (kept) | .75 to .95 of the time of cell after cell at 512^3 samples, on a machine that others used |
//! | larger leaves: all 64 rays and a plane at once, those of 2 x 2 x 2 cells listed with the cells of a brick (kept) | .72 to .81 of the time of one ray after the other |
//! | number of a leaf counted in whole parts of 64 bytes with a comparison | twice the time of a picture; dropped |
//! | each tile traced twice in turn | twice the time: cells do not wait for their planes to come from memory |

mod beam;
mod exact;
mod larger;
mod layout;
mod listed;
mod planes;
mod prove;
mod walk;
mod words;

use crate::load::ModelView;

use super::pixel_rays::PixelRays;
use super::ray::Face;
use super::surface::Surface;
use super::traverse::Hit;
use crate::cpu::Form;

pub use beam::{RAYS, TILE};
pub(crate) use layout::Layout;
pub(crate) use listed::Listed;

/// The rays to trace, and the finest level.
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
    /// Mask of the rays to trace: ray `8 y + x` is at column x and row y.
    pub(crate) fn live(&self) -> u64 {
        let (columns, rows) = (self.limits.0.min(TILE), self.limits.1.min(TILE));
        let row = (1_u64 << columns) - 1;
        (0..rows).fold(0, |live, y| live | row << (TILE * y))
    }
}

/// The hits of a tile's rays.
#[derive(Clone, Debug)]
pub struct TileHits {
    /// Mask of the rays that hit.
    hits: u64,
    number: [u64; RAYS],
    /// Lowest cell of the box in mirrored coordinates.
    low: [[f64; RAYS]; 3],
    t: [f64; RAYS],
    /// Masks of rays that enter by a face of axis x, y, z, and of those that enter by a high one.
    by_axis: [u64; 3],
    by_high: u64,
    steps: [u32; RAYS],
    /// Mask of the mirrored axes, and the side of the grid.
    mirror: u32,
    side: u32,
    /// Edge of each box as a power of two.
    edge_log2: [u8; RAYS],
}

impl TileHits {
    const fn new() -> Self {
        Self {
            hits: 0,
            number: [0; RAYS],
            low: [[0.0; RAYS]; 3],
            t: [0.0; RAYS],
            by_axis: [0; 3],
            by_high: 0,
            steps: [0; RAYS],
            mirror: 0,
            side: 0,
            edge_log2: [0; RAYS],
        }
    }

    fn clear(&mut self) {
        (self.hits, self.by_axis, self.by_high) = (0, [0; 3], 0);
        (self.mirror, self.side, self.edge_log2) = (0, 0, [0; RAYS]);
        self.steps = [0; RAYS];
    }

    /// Sets the mirror of all following coordinates, and the edge `2^edge_log2` of boxes.
    fn mirrored(&mut self, mirror: u32, side: u32, edge_log2: u32) {
        (self.mirror, self.side, self.edge_log2) = (mirror, side, [edge_log2.to_le_bytes()[0]; RAYS]);
    }

    /// The coordinate of a ray's box along an axis, mirrored if the axis is; and back.
    fn mirror(&self, ray: usize, axis: usize, cell: u32) -> u32 {
        let edge = 1_u32.wrapping_shl(self.edge_log2[ray % RAYS].into());
        if self.mirror >> axis & 1 == 1 { self.side.wrapping_sub(edge).wrapping_sub(cell) } else { cell }
    }

    fn set(&mut self, ray: usize, hit: &Hit) {
        let ray = ray % RAYS;
        self.edge_log2[ray] = hit.edge_log2.to_le_bytes()[0];
        self.number[ray] = hit.box_number;
        self.t[ray] = hit.t;
        for a in 0..3 {
            self.low[a][ray] = f64::from(self.mirror(ray, a, hit.cell[a]));
        }
        self.hits |= 1 << ray;
        if let Some(face) = hit.face {
            self.by_axis[usize::from(face.axis) % 3] |= 1 << ray;
            self.by_high |= u64::from(face.high) << ray;
        }
    }

    /// Sets the hit of a ray in the coordinates of [`TileHits::mirrored`]; `axis` is the axis of the face.
    #[inline(always)]
    fn set_mirrored(&mut self, ray: usize, number: u64, low: [u32; 3], axis: Option<usize>, t: f64) {
        let ray = ray % RAYS;
        (self.number[ray], self.t[ray]) = (number, t);
        for (all, low) in self.low.iter_mut().zip(low) {
            all[ray] = f64::from(low);
        }
        self.hits |= 1 << ray;
        if let Some(axis) = axis {
            self.by_axis[axis % 3] |= 1 << ray;
            self.by_high |= u64::from(self.mirror >> axis & 1) << ray;
        }
    }

    /// Sets the hits of a row that begins with ray `first`; numbers and cells are written already.
    #[inline(always)]
    fn set_row(&mut self, first: usize, hits: u32, entries: &prove::Entries) {
        self.hits |= u64::from(hits) << first;
        for (axis, by) in entries.by_axis.into_iter().enumerate() {
            let by = u64::from(by & hits) << first;
            self.by_axis[axis] |= by;
            self.by_high |= if self.mirror >> axis & 1 == 1 { by } else { 0 };
        }
        self.t.as_chunks_mut().0[first / TILE] = entries.t;
    }

    /// Mask of the rays that hit: ray `8 y + x` is at column x and row y.
    #[inline]
    pub fn bits(&self) -> u64 {
        self.hits
    }

    /// The hit of a ray, if it hit.
    #[inline]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells of the grid")]
    pub fn hit(&self, ray: usize) -> Option<Hit> {
        if ray >= RAYS || self.hits >> ray & 1 == 0 {
            return None;
        }
        let by = |axis: usize| self.by_axis[axis] >> ray & 1 == 1;
        let face = |axis| Face::new(axis, self.by_high >> ray & 1 == 1);
        Some(Hit {
            box_number: self.number[ray],
            cell: each3!(A => self.mirror(ray, A, self.low[A][ray] as u32)),
            edge_log2: self.edge_log2[ray].into(),
            face: (0..3).find(|axis| by(*axis)).map(face),
            t: self.t[ray],
        })
    }

    /// Bricks that a ray was compared with, alone or with its tile.
    #[inline]
    pub(crate) fn steps(&self, ray: usize) -> u32 {
        self.steps.get(ray).copied().unwrap_or(0)
    }
}

/// Traces tiles, one after the other. Memory: 17 KiB.
pub struct Tracer {
    form: Form,
    rays: beam::Rays,
    exact: exact::ExactRays,
    pairs: planes::Pairs,
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
        Self {
            form,
            rays: beam::Rays::new(),
            exact: exact::ExactRays::new(),
            pairs: planes::Pairs::new(),
            hits: TileHits::new(),
        }
    }

    /// The tracer's form.
    pub(crate) fn form(&self) -> Form {
        self.form
    }

    /// First hits of a tile's rays: those of [`super::single::trace`], for every form.
    ///
    /// The view must be as deep as the sight's grid. Any view is safe, right or wrong.
    #[inline]
    pub fn trace<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        sight: &PixelRays<'_>,
        tile: Tile,
    ) -> &TileHits {
        self.trace_some(view, surface, sight, tile, u64::MAX)
    }

    /// [`Tracer::trace`] for the rays whose bits in `asked` are set: ray `8 y + x` is at column x and row y.
    #[inline]
    pub(crate) fn trace_some<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        sight: &PixelRays<'_>,
        tile: Tile,
        asked: u64,
    ) -> &TileHits {
        self.walk(view, surface, sight, tile, asked);
        &self.hits
    }

    /// [`Tracer::trace`] for the rays of `listed` whose bits in `asked` are set, at the finest level; also returns
    /// those rays, all or none, if they do not form a tile and have to be traced in another way.
    #[inline]
    pub(crate) fn trace_listed<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        listed: &Listed,
        asked: u64,
    ) -> (&TileHits, u64) {
        let tile = Tile { corner: (0, 0), limits: (TILE, TILE), lod_edge_log2: 0 };
        let left = self.walk(view, surface, listed, tile, asked);
        (&self.hits, left)
    }

    #[inline]
    fn walk<S: Surface, R: listed::Source>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        source: R,
        tile: Tile,
        asked: u64,
    ) -> u64 {
        let Self { form, rays, exact, pairs, hits } = self;
        exact.clear();
        if !S::SOLID {
            pairs.clear();
        }
        form.run(walk::Walk { view, surface, source, tile, asked, rays, exact, pairs, hits })
    }
}
