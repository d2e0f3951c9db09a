//! Rays from the world and back to it: one, or many at once.

use std::ops::Deref;

use super::batch::Batch;
use super::cells::Cells;
use super::form::Form;
use super::image::refill;
use super::normals::shown::cell_coordinates;
use super::ray::{BadRay, Ray};
use super::single;
use super::surface::Skin;
use super::traverse::Hit;
use super::{GridSpace, RenderError};
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
/// assert_eq!(hit.unwrap().voxel, [4, 4, 2]);
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

    /// The first hits of many rays, bit for bit those of [`RayCaster::first_hit`]: eight rays are in flight at a time,
    /// so that they wait for memory together. For rays in any order; those of a picture are traced faster by
    /// [`crate::render()`].
    ///
    /// Memory: `hits` has 88 bytes a ray, and keeps them for the next call; the call itself takes 160 KiB. It runs on
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
        let (mut batch, mut found) = (Batch::default(), Vec::with_capacity(AT_ONCE));
        let traced = self.unchanged_in_parts(origins_mm, directions, &mut |numbers, rays| {
            match &cells {
                Some(cells) => batch.nearest(&view, cells, rays, 0, &mut found),
                None => batch.nearest(&view, &Skin, rays, 0, &mut found),
            }
            for (ray, hit) in numbers.iter().zip(&found) {
                if let Some(hit) = hit {
                    let line = (origins_mm[*ray], directions[*ray]);
                    hits.set(*ray, &self.point(&view, cells.as_ref(), hit, line));
                }
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
        let view = self.model.view();
        let cells = view.cells().map(Cells::new);
        let (mut batch, mut found, mut nearest) = (Batch::default(), Vec::new(), Vec::new());
        self.unchanged_in_parts(origins_mm, directions, &mut |numbers, rays| {
            if t_max == f64::INFINITY {
                match &cells {
                    Some(cells) => batch.any(&view, cells, rays, 0, &mut found),
                    None => batch.any(&view, &Skin, rays, 0, &mut found),
                }
            } else {
                match &cells {
                    Some(cells) => batch.nearest(&view, cells, rays, 0, &mut nearest),
                    None => batch.nearest(&view, &Skin, rays, 0, &mut nearest),
                }
                found.clear();
                found.extend(nearest.iter().map(|hit| hit.is_some_and(|hit| hit.t <= t_max)));
            }
            numbers.iter().zip(&found).for_each(|(ray, is_met)| met[*ray] = *is_met);
        })
    }

    /// [`RayCaster::in_parts`] through a model whose file nothing is written to meanwhile.
    fn unchanged_in_parts(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        trace: &mut dyn FnMut(&[usize], &[Ray]),
    ) -> Result<(), RenderError> {
        self.model.unchanged_during(|| self.in_parts(origins_mm, directions, trace))
    }

    /// Hands rays that reach the grid to `trace`, with their numbers, some at a time.
    fn in_parts(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        trace: &mut dyn FnMut(&[usize], &[Ray]),
    ) -> Result<(), RenderError> {
        if origins_mm.len() != directions.len() {
            return Err(RenderFault::RayCount { rays: origins_mm.len(), others: directions.len() }.into());
        }
        let (mut numbers, mut rays) = (Vec::with_capacity(AT_ONCE), Vec::with_capacity(AT_ONCE));
        for (index, (origin, direction)) in origins_mm.iter().zip(directions).enumerate() {
            let at = |fault: BadRay| RenderError::from(RenderFault::RayAt { index, fault });
            if let Some(ray) = self.space.ray(*origin, *direction).map_err(at)? {
                numbers.push(index);
                rays.push(ray);
            }
            if rays.len() == AT_ONCE {
                trace(&numbers, &rays);
                numbers.clear();
                rays.clear();
            }
        }
        if !rays.is_empty() {
            trace(&numbers, &rays);
        }
        Ok(())
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
