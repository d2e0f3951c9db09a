//! Rays from the world and back to it: one, or many at once.

use std::ops::Deref;

use super::batch::Batch;
use super::cells::Cells;
use super::image::refill;
use super::normals::shown::cell_coordinates;
use super::ray::{BadRay, Ray};
use super::single;
use super::surface::Skin;
use super::tile::{Listed, TILE, Tracer, row_of};
use super::traverse::Hit;
use super::{GridSpace, RenderError};
use crate::cpu::Form;
use crate::geom::{NodeIndex, VoxelIndex};
use crate::load::{Model, ModelView, NodeView};
use crate::render::RenderFault;

/// Rays that are made before they are traced: 140 KiB with their hits.
const AT_ONCE: usize = 1024;

/// Traces rays through a model, in world coordinates (LPS mm).
///
/// `P` is what leads to the model: `&Model`, or `Arc<Model>` where the caster has to outlive the place that opened it.
/// Casters can be shared by threads.
///
/// Every decision is exact, as in pictures: the ray is rounded once, and no ray slips between two voxels that
/// touch. Cost: some hundred nanoseconds a ray, fewer where many are traced by [`RayCaster::first_hits`]; for pictures,
/// [`crate::render()`] is several times faster.
///
/// ```
/// # use infobyte::{BuildOptions, Dims, Model, Threshold, RayCaster, Voxels};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("box.oct");
/// # let cube = Voxels::from_fn(Dims::new(8, 8, 8).unwrap(), |p| u8::from(p.iter().all(|v| (2..6).contains(v))));
/// # infobyte::build(&cube, &BuildOptions { threshold: Threshold::Iso(1.0), ..Default::default() }, &path)?;
/// let model = Model::open(&path)?;
/// let hit = RayCaster::new(&model)?.first_hit([4.0, 4.0, -10.0], [0.0, 0.0, 1.0])?;
/// assert!((1.0..=2.0).contains(&hit.unwrap().position_mm[2]));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct RayCaster<P> {
    model: P,
    space: GridSpace,
}

/// Where a ray meets a surface.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point on the voxel's face, or on the surface within the cell, in LPS mm.
    pub position_mm: [f64; 3],
    /// Distance along the ray, as a multiple of the direction's length.
    pub t: f64,
    /// Index of the skin voxel (x, y, z), or of the cell: cell i lies between samples i - 1 and i.
    pub voxel: [u32; 3],
    /// Its number in the order of the file, as [`Model::voxels`] has it; of a larger leaf [`Hits::NOTHING`] - 1 less the number of its node.
    pub number: u64,
    /// Unit vector out of the surface, where the model has normals.
    pub normal: Option<[f64; 3]>,
}

/// The hits of many rays: arrays with an item for each ray, in their order, to be used again for the next rays.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hits {
    /// [`SurfacePoint::t`]; infinity for a ray that meets nothing.
    pub t: Vec<f64>,
    /// [`SurfacePoint::position_mm`]; NaN for a ray that meets nothing.
    pub position_mm: Vec<[f64; 3]>,
    /// [`SurfacePoint::normal`]; NaN without one.
    pub normal: Vec<[f64; 3]>,
    /// [`SurfacePoint::voxel`]; 0 for a ray that meets nothing.
    pub voxel: Vec<[u32; 3]>,
    /// [`SurfacePoint::number`]; [`Hits::NOTHING`] for a ray that meets nothing.
    pub number: Vec<u64>,
}

impl Hits {
    /// The number of no voxel.
    pub const NOTHING: u64 = u64::MAX;

    /// Rays.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Are there no rays?
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The hit of a ray, if any.
    pub fn get(&self, ray: usize) -> Option<SurfacePoint> {
        let number = *self.number.get(ray).filter(|number| **number != Self::NOTHING)?;
        Some(SurfacePoint {
            position_mm: *self.position_mm.get(ray)?,
            t: *self.t.get(ray)?,
            voxel: *self.voxel.get(ray)?,
            number,
            normal: self.normal.get(ray).copied().filter(|normal| !normal[0].is_nan()),
        })
    }

    fn set(&mut self, ray: usize, point: &SurfacePoint) {
        self.t[ray] = point.t;
        self.position_mm[ray] = point.position_mm;
        self.normal[ray] = point.normal.unwrap_or([f64::NAN; 3]);
        self.voxel[ray] = point.voxel;
        self.number[ray] = point.number;
    }

    /// So many rays that meet nothing.
    fn reset(&mut self, rays: usize) {
        refill(&mut self.t, rays, f64::INFINITY);
        refill(&mut self.position_mm, rays, [f64::NAN; 3]);
        refill(&mut self.normal, rays, [f64::NAN; 3]);
        refill(&mut self.voxel, rays, [0; 3]);
        refill(&mut self.number, rays, Self::NOTHING);
    }
}

/// Rays that are traced eight in turns, some at a time.
struct Turns<'a> {
    view: &'a ModelView<'a>,
    cells: Option<&'a Cells<'a>>,
    /// Is it enough to know that something is met?
    any: bool,
    found: &'a mut dyn FnMut(usize, Option<&Hit>),
    batch: Batch,
    numbers: Vec<usize>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    met: Vec<bool>,
}

impl<'a> Turns<'a> {
    fn new(
        view: &'a ModelView<'a>,
        cells: Option<&'a Cells<'a>>,
        any: bool,
        found: &'a mut dyn FnMut(usize, Option<&Hit>),
    ) -> Self {
        let (numbers, rays) = (Vec::with_capacity(AT_ONCE), Vec::with_capacity(AT_ONCE));
        let batch = Batch::default();
        Self { view, cells, any, found, batch, numbers, rays, hits: Vec::new(), met: Vec::new() }
    }

    fn take(&mut self, number: usize, ray: Ray) {
        self.numbers.push(number);
        self.rays.push(ray);
        if self.rays.len() == AT_ONCE {
            self.trace();
        }
    }

    /// Traces what was taken.
    fn trace(&mut self) {
        let Self { view, cells, any, found, batch, numbers, rays, hits, met } = self;
        match (*any, cells) {
            (true, Some(cells)) => batch.any(view, *cells, rays, 0, met),
            (true, None) => batch.any(view, &Skin, rays, 0, met),
            (false, Some(cells)) => batch.nearest(view, *cells, rays, 0, hits),
            (false, None) => batch.nearest(view, &Skin, rays, 0, hits),
        }
        for (at, ray) in numbers.iter().enumerate() {
            let hit = hits.get(at).and_then(Option::as_ref);
            if hit.is_some() || (*any && met.get(at).is_some_and(|met| *met)) {
                found(*ray, hit);
            }
        }
        numbers.clear();
        rays.clear();
    }
}

impl<P: Deref<Target = Model<D>>, D: AsRef<[u8]>> RayCaster<P> {
    /// Prepares rays through a model.
    ///
    /// # Errors
    /// [`RenderError`] for a model whose axes span no volume, or whose file was changed ([`Model::open`]).
    pub fn new(model: P) -> Result<Self, RenderError> {
        let space = model.unchanged_during(|| GridSpace::new(model.dims(), &model.affine()))?;
        Ok(Self { model, space })
    }

    /// The first skin voxel on a ray, if it meets one: `origin_mm` in LPS mm, `direction` of any length. A ray that
    /// starts in a skin voxel meets that one.
    ///
    /// # Errors
    /// [`RenderError`] for a ray that is not finite or has no direction.
    pub fn first_hit(
        &self,
        origin_mm: [f64; 3],
        direction: [f64; 3],
    ) -> Result<Option<SurfacePoint>, RenderError> {
        let Some(ray) = self.space.ray(origin_mm, direction)? else { return Ok(None) };
        let view = self.model.view();
        let cells = view.cells().map(Cells::new);
        let trace = match &cells {
            Some(cells) => single::trace(Form::best(), &view, cells, &ray, 0),
            None => single::trace(Form::best(), &view, &Skin, &ray, 0),
        };
        Ok(trace.hit.map(|hit| self.point(&view, cells.as_ref(), &hit, (origin_mm, direction))))
    }

    /// The first hits of many rays, bit for bit those of [`RayCaster::first_hit`]. Rays of an image, row by row, at least
    /// 8 x 8 of them, are traced in tiles as pictures are, several times faster: rows are found by where rays jump, and
    /// each tile is measured. Other rays may be in any order: eight of them are in flight at a time, so that they wait for
    /// memory together.
    ///
    /// Memory: `hits` has 88 bytes a ray, and keeps them for the next call; the call itself takes 180 KiB. It runs on
    /// the caller's thread: threads of its own take parts of the rays, with a `Hits` each.
    ///
    /// ```
    /// # fn main() -> Result<(), infobyte::Error> {
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
    /// use infobyte::{Hits, Model, RayCaster};
    ///
    /// let model = std::sync::Arc::new(Model::open(path)?);
    /// let caster = RayCaster::new(model)?;
    /// let origins: Vec<_> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), -50.0]).collect();
    /// let mut hits = Hits::default();
    /// caster.first_hits(&origins, &[[0.0, 0.0, 1.0]; 100], &mut hits)?;
    /// assert_eq!(hits.get(42), caster.first_hit(origins[42], [0.0, 0.0, 1.0])?);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`RenderError`] for the first ray that is not finite or has no direction,
    /// unless there are as many directions as origins, and if the model's file is changed; `hits` is empty then.
    pub fn first_hits(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        hits: &mut Hits,
    ) -> Result<(), RenderError> {
        hits.reset(origins_mm.len());
        let view = self.model.view();
        let cells = view.cells().map(Cells::new);
        let traced = self.trace(origins_mm, directions, false, &mut |ray, hit| {
            if let Some(hit) = hit {
                let line = (origins_mm[ray], directions[ray]);
                hits.set(ray, &self.point(&view, cells.as_ref(), hit, line));
            }
        });
        if traced.is_err() {
            hits.reset(0);
        }
        traced
    }

    /// Does each of many rays meet anything at `t` of at most `t_max`, a multiple of the direction's length? For shadows
    /// of a light, give the way to it as the direction, and 1; for rays without an end, [`f64::INFINITY`], which costs
    /// less. Otherwise as [`RayCaster::first_hits`].
    ///
    /// # Errors
    /// As [`RayCaster::first_hits`]; also unless there are as many answers as rays. What is in
    /// `met` then means nothing.
    pub fn any_hit(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        t_max: f64,
        met: &mut [bool],
    ) -> Result<(), RenderError> {
        if met.len() != origins_mm.len() {
            return Err(RenderFault::RayCount { rays: origins_mm.len(), others: met.len() }.into());
        }
        met.fill(false);
        self.trace(origins_mm, directions, t_max == f64::INFINITY, &mut |ray, hit| {
            met[ray] = hit.is_none_or(|hit| hit.t <= t_max);
        })
    }

    /// Traces rays: in tiles where they stand in the array as those of an image do, eight in turns elsewhere. `found` is
    /// given the rays that meet something, and what; with `any` perhaps not that.
    fn trace(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        any: bool,
        found: &mut dyn FnMut(usize, Option<&Hit>),
    ) -> Result<(), RenderError> {
        let rays = origins_mm.len();
        if rays != directions.len() {
            return Err(RenderFault::RayCount { rays, others: directions.len() }.into());
        }
        self.model.unchanged_during(|| {
            let view = self.model.view();
            let cells = view.cells().map(Cells::new);
            let mut turns = Turns::new(&view, cells.as_ref(), any, found);
            if !self.in_tiles(origins_mm, directions, &mut turns) {
                for (index, (origin, direction)) in origins_mm.iter().zip(directions).enumerate() {
                    let at = |fault: BadRay| RenderError::from(RenderFault::RayAt { index, fault });
                    if let Some(ray) = self.space.ray(*origin, *direction).map_err(at)? {
                        turns.take(index, ray);
                    }
                }
            }
            turns.trace();
            Ok(())
        })
    }

    /// Traces rays eight by eight, if they stand in the array as those of an image do. Tiles that are not nearly affine
    /// are left to `turns`. `false`, perhaps after some of them, where that is not so or a ray is refused.
    fn in_tiles(&self, origins_mm: &[[f64; 3]], directions: &[[f64; 3]], turns: &mut Turns<'_>) -> bool {
        let Some(columns) = row_of(origins_mm, directions).filter(|columns| *columns >= TILE) else {
            return false;
        };
        let rows = origins_mm.len() / columns;
        if rows < TILE || rows * columns != origins_mm.len() {
            return false;
        }
        let (mut tracer, mut listed) = (Tracer::default(), Listed::new(self.space.dims().depth()));
        // The last tile of a row or column has some rays of the one before it.
        let starts = |count: usize| (0..count).step_by(TILE).map(move |at| (at, at.min(count - TILE)));
        for (wanted_row, row) in starts(rows) {
            for (wanted_column, column) in starts(columns) {
                let number = |ray: usize| (row + ray / TILE) * columns + column + ray % TILE;
                let lines = |ray: usize| (origins_mm[number(ray)], directions[number(ray)]);
                if listed.fill(&self.space, lines).is_err() {
                    return false;
                }
                let in_row = (0xff_u64 << (wanted_column - column) & 0xff) * 0x0101_0101_0101_0101;
                let asked = in_row & u64::MAX << (TILE * (wanted_row - row));
                let (hits, mut left) = match turns.cells {
                    Some(cells) => tracer.trace_listed(turns.view, cells, &listed, asked),
                    None => tracer.trace_listed(turns.view, &Skin, &listed, asked),
                };
                let mut bits = hits.bits();
                while bits != 0 {
                    let ray = bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    (turns.found)(number(ray), hits.hit(ray).as_ref());
                }
                while left != 0 {
                    let ray = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let (origin, direction) = lines(ray);
                    if let Ok(Some(exact)) = self.space.ray(origin, direction) {
                        turns.take(number(ray), exact);
                    }
                }
            }
        }
        true
    }

    /// A hit in the world.
    fn point(
        &self,
        view: &ModelView<'_>,
        cells: Option<&Cells<'_>>,
        hit: &Hit,
        (origin_mm, direction): ([f64; 3], [f64; 3]),
    ) -> SurfacePoint {
        let position_mm = std::array::from_fn(|i| origin_mm[i] + hit.t * direction[i]);
        // Larger leaves have no number among the cells: those below the greatest are theirs.
        let number = hit.voxel(view).unwrap_or(Hits::NOTHING - 1 - hit.box_number);
        let normal = match cells {
            Some(cells) => {
                let normal = if hit.edge_log2 > 0 {
                    view.leaf_plane(NodeIndex::new(hit.box_number)).normal.map(f64::from)
                } else {
                    cells.normal(number, cell_coordinates(&self.space, hit.cell, position_mm))
                };
                Some(self.space.index_normal_to_world(normal))
            }
            None => view
                .voxel_direction(VoxelIndex::new(number))
                .map(|stored| self.space.normal_to_world(stored.map(f64::from))),
        };
        SurfacePoint { position_mm, t: hit.t, voxel: hit.cell, number, normal }
    }
}
