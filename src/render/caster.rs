//! Rays in world coordinates, with hits in world coordinates: one, or many at once.

use std::ops::Deref;

use super::batch::Batch;
use super::cells::Cells;
use super::image::refill;
use super::normals::shading_normal::cell_coordinates;
use super::ray::{BadRay, Ray};
use super::single;
use super::surface::Skin;
use super::tile::{Layout, Listed, RAYS, Tracer};
use super::traverse::Hit;
use super::{GridSpace, RenderError};
use crate::cpu::Form;
use crate::fault::{Fault, usage};
use crate::geom::{NodeIndex, VoxelIndex};
use crate::load::{Model, ModelView, NodeView};
use crate::render::RenderFault;

/// Rays set up together before they are traced: 140 KiB with their hits.
const AT_ONCE: usize = 1024;

/// Limit on the skipping of tiles after tiles that did not fit: base-2 logarithm of one more than the skipped number.
const MAX_UNFIT: u32 = 6;

/// Traces rays through a model, in world coordinates (LPS mm).
///
/// `P` is a handle of the model: `&Model`, or `Arc<Model>` where the caster has to outlive the code that opened it.
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

/// Intersection of a ray with a surface.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point on the voxel's face, or on the surface within the cell, in LPS mm.
    pub position_mm: [f64; 3],
    /// Distance along the ray, as a multiple of the direction's length.
    pub t: f64,
    /// Index of the skin voxel (x, y, z), or of the cell: cell i lies between samples i - 1 and i.
    pub voxel: [u32; 3],
    /// Number in the order of the file, as in [`Model::voxels`]; for a larger leaf, [`Hits::NOTHING`] - 1 less the
    /// number of its node.
    pub number: u64,
    /// Unit vector out of the surface, where the model has normals.
    pub normal: Option<[f64; 3]>,
}

impl SurfacePoint {
    const NONE: Self = Self {
        position_mm: [f64::NAN; 3],
        t: f64::INFINITY,
        voxel: [0; 3],
        number: Hits::NOTHING,
        normal: None,
    };
}

fn other_count(rays: usize, others: usize) -> Fault {
    usage!("{rays} origins and {others} directions or answers; give as many of each")
}

/// The hits of many rays: arrays with an item for each ray, in their order, to be reused for the next rays.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hits {
    /// [`SurfacePoint::t`]; infinity for a ray without a hit.
    pub t: Vec<f64>,
    /// [`SurfacePoint::position_mm`]; NaN for a ray without a hit.
    pub position_mm: Vec<[f64; 3]>,
    /// [`SurfacePoint::normal`]; NaN without one.
    pub normal: Vec<[f64; 3]>,
    /// [`SurfacePoint::voxel`]; 0 for a ray without a hit.
    pub voxel: Vec<[u32; 3]>,
    /// [`SurfacePoint::number`]; [`Hits::NOTHING`] for a ray without a hit.
    pub number: Vec<u64>,
}

impl Hits {
    /// Number of a ray without a hit.
    pub const NOTHING: u64 = u64::MAX;

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// True without rays.
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

    /// Resets the arrays to `rays` rays without a hit.
    fn reset(&mut self, rays: usize) {
        refill(&mut self.t, rays, f64::INFINITY);
        refill(&mut self.position_mm, rays, [f64::NAN; 3]);
        refill(&mut self.normal, rays, [f64::NAN; 3]);
        refill(&mut self.voxel, rays, [0; 3]);
        refill(&mut self.number, rays, Self::NOTHING);
    }
}

/// Receiver of the hits of an array's rays.
trait Found {
    /// True if it suffices to know that a ray hits anything.
    const ANY: bool;
    /// Called with the hit of a ray, or with `None` if any hit will do.
    fn take(&mut self, ray: usize, hit: Option<&Hit>);
}

/// Rays with a hit at a parameter of at most `t_max`; with `ANY` the limit is ignored.
struct Met<'a, const ANY: bool> {
    t_max: f64,
    met: &'a mut [bool],
}

impl<const ANY: bool> Found for Met<'_, ANY> {
    const ANY: bool = ANY;

    #[inline]
    fn take(&mut self, ray: usize, hit: Option<&Hit>) {
        self.met[ray] = hit.is_none_or(|hit| hit.t <= self.t_max);
    }
}

/// Hits that are transformed to the world together.
struct Points<'a, F> {
    space: &'a GridSpace,
    view: &'a ModelView<'a>,
    cells: Option<&'a Cells<'a>>,
    lines: (&'a [[f64; 3]], &'a [[f64; 3]]),
    count: usize,
    rays: [usize; RAYS],
    points: [SurfacePoint; RAYS],
    /// Stored normals, by axis.
    normals: [[f64; RAYS]; 3],
    out: F,
}

impl<F: FnMut(usize, &SurfacePoint)> Found for Points<'_, F> {
    const ANY: bool = false;

    #[inline]
    fn take(&mut self, ray: usize, hit: Option<&Hit>) {
        let (Some(hit), at) = (hit, self.count % RAYS) else { return };
        let (origin, direction) = (self.lines.0[ray], self.lines.1[ray]);
        let (point, normal) = stored(self.view, self.cells, self.space, hit, (origin, direction));
        self.rays[at] = ray;
        self.points[at] = point;
        for (normals, part) in self.normals.iter_mut().zip(normal.unwrap_or([f64::NAN; 3])) {
            normals[at] = part;
        }
        self.count = at + 1;
        if self.count == RAYS {
            self.give();
        }
    }
}

impl<F: FnMut(usize, &SurfacePoint)> Points<'_, F> {
    /// Emits the gathered points.
    fn give(&mut self) {
        self.space.normals_to_world(Form::best(), self.cells.is_some(), &mut self.normals);
        for (at, (ray, point)) in self.rays.iter().zip(&mut self.points).take(self.count).enumerate() {
            let normal = [0, 1, 2].map(|a| self.normals[a][at]);
            point.normal = (!normal[0].is_nan()).then_some(normal);
            (self.out)(*ray, point);
        }
        self.count = 0;
    }
}

/// Rays traced eight in turns, in batches.
struct Turns<'a, F> {
    view: &'a ModelView<'a>,
    cells: Option<&'a Cells<'a>>,
    found: &'a mut F,
    batch: Batch,
    numbers: Vec<usize>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    met: Vec<bool>,
}

impl<'a, F: Found> Turns<'a, F> {
    fn new(view: &'a ModelView<'a>, cells: Option<&'a Cells<'a>>, found: &'a mut F) -> Self {
        let (numbers, rays) = (Vec::with_capacity(AT_ONCE), Vec::with_capacity(AT_ONCE));
        let batch = Batch::default();
        Self { view, cells, found, batch, numbers, rays, hits: Vec::new(), met: Vec::new() }
    }

    fn take(&mut self, number: usize, ray: Ray) {
        self.numbers.push(number);
        self.rays.push(ray);
        if self.rays.len() == AT_ONCE {
            self.trace();
        }
    }

    /// Traces the gathered rays.
    fn trace(&mut self) {
        let Self { view, cells, found, batch, numbers, rays, hits, met } = self;
        match (F::ANY, cells) {
            (true, Some(cells)) => batch.any(view, *cells, rays, 0, met),
            (true, None) => batch.any(view, &Skin, rays, 0, met),
            (false, Some(cells)) => batch.nearest(view, *cells, rays, 0, hits),
            (false, None) => batch.nearest(view, &Skin, rays, 0, hits),
        }
        for (at, ray) in numbers.iter().enumerate() {
            let hit = hits.get(at).and_then(Option::as_ref);
            if hit.is_some() || (F::ANY && met.get(at).is_some_and(|met| *met)) {
                found.take(*ray, hit);
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
        Form::chosen().map_err(|sentence| usage!("{sentence}"))?;
        let space = model.unchanged_during(|| GridSpace::new(model.dims(), &model.affine()))?;
        Ok(Self { model, space })
    }

    /// The first skin voxel on a ray, if it hits: `origin_mm` in LPS mm, `direction` of any length. A ray that starts
    /// in a skin voxel hits that one.
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
        Ok(trace.hit.map(|hit| {
            let (point, normal) = stored(&view, cells.as_ref(), &self.space, &hit, (origin_mm, direction));
            let normal = normal.map(|normal| match cells {
                Some(_) => self.space.index_normal_to_world(normal),
                None => self.space.normal_to_world(normal),
            });
            SurfacePoint { normal, ..point }
        }))
    }

    /// The first hits of many rays, bit for bit equal to [`RayCaster::first_hit`]. Rays of an image, row by row, at
    /// least 8 x 8 of them, and rays of a scanner's rings or of a line are traced 64 together as in pictures, several
    /// times faster: rows of any length are detected by jumps or turns of the rays, and each group of 64 is measured.
    /// Other rays may be in any order: eight of them are in flight at a time, so that they wait for memory together.
    ///
    /// Memory: `hits` has 88 bytes a ray, and keeps them for the next call; the call itself takes 180 KiB. It runs on
    /// the caller's thread: to use several threads, give each a part of the rays and its own `Hits`.
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
    /// [`RenderError`] for the first ray that is not finite or has no direction, if the numbers of directions and
    /// origins differ, and if the model's file is changed; `hits` is empty then.
    pub fn first_hits(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        hits: &mut Hits,
    ) -> Result<(), RenderError> {
        hits.reset(origins_mm.len());
        let layout = Layout::of(origins_mm, directions, None);
        let traced = self.points(layout, origins_mm, directions, |ray, point| hits.set(ray, point));
        if traced.is_err() {
            hits.reset(0);
        }
        traced
    }

    /// [`RayCaster::first_hits`] of rays with this layout in their array; `out` receives the hits.
    pub(crate) fn points(
        &self,
        layout: Layout,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        out: impl FnMut(usize, &SurfacePoint),
    ) -> Result<(), RenderError> {
        let (view, lines) = (self.model.view(), (origins_mm, directions));
        let cells = view.cells().map(Cells::new);
        let mut points = Points {
            space: &self.space,
            view: &view,
            cells: cells.as_ref(),
            lines,
            count: 0,
            rays: [0; RAYS],
            points: [SurfacePoint::NONE; RAYS],
            normals: [[0.0; RAYS]; 3],
            out,
        };
        self.trace(layout, lines, &mut points)?;
        points.give();
        Ok(())
    }

    /// Tests each of many rays for any hit at `t` of at most `t_max`, a multiple of the direction's length. For shadows
    /// of a light, pass the way to it as the direction, and 1; for unlimited rays, [`f64::INFINITY`], which costs less.
    /// Otherwise like [`RayCaster::first_hits`].
    ///
    /// # Errors
    /// The errors of [`RayCaster::first_hits`], and unequal numbers of answers and rays. The content of `met` is then
    /// undefined.
    pub fn any_hit(
        &self,
        origins_mm: &[[f64; 3]],
        directions: &[[f64; 3]],
        t_max: f64,
        met: &mut [bool],
    ) -> Result<(), RenderError> {
        if met.len() != origins_mm.len() {
            return Err(other_count(origins_mm.len(), met.len()).into());
        }
        self.met(Layout::of(origins_mm, directions, None), (origins_mm, directions), t_max, met)
    }

    /// [`RayCaster::any_hit`] of rays with this layout in their array, as many as the answers.
    pub(crate) fn met(
        &self,
        layout: Layout,
        lines: (&[[f64; 3]], &[[f64; 3]]),
        t_max: f64,
        met: &mut [bool],
    ) -> Result<(), RenderError> {
        met.fill(false);
        if t_max == f64::INFINITY {
            return self.trace(layout, lines, &mut Met::<true> { t_max, met });
        }
        self.trace(layout, lines, &mut Met::<false> { t_max, met })
    }

    /// Traces rays: in tiles where neighbours in the array are neighbours in space, eight in turns elsewhere.
    fn trace(
        &self,
        layout: Layout,
        lines: (&[[f64; 3]], &[[f64; 3]]),
        found: &mut impl Found,
    ) -> Result<(), RenderError> {
        let rays = lines.0.len();
        if rays != lines.1.len() {
            return Err(other_count(rays, lines.1.len()).into());
        }
        self.model.unchanged_during(|| {
            let view = self.model.view();
            let cells = view.cells().map(Cells::new);
            let mut turns = Turns::new(&view, cells.as_ref(), found);
            if self.in_tiles(layout, lines, &mut turns).is_err() {
                // Some ray is invalid: finds the first.
                for index in 0..rays {
                    let at = |fault: BadRay| RenderError::from(RenderFault::RayAt { index, fault });
                    self.space.ray(lines.0[index], lines.1[index]).map_err(at)?;
                }
            }
            turns.trace();
            Ok(())
        })
    }

    /// Traces rays 64 by 64 where they are neighbours. Groups that are not nearly affine are left to `turns`.
    fn in_tiles<F: Found>(
        &self,
        layout: Layout,
        lines: (&[[f64; 3]], &[[f64; 3]]),
        turns: &mut Turns<'_, F>,
    ) -> Result<(), BadRay> {
        let (mut tracer, mut listed) = (Tracer::default(), Listed::new(self.space.dims().depth()));
        let (tiles, rest) = layout.tiles(lines.0.len());
        // Where tiles do not fit, fewer and fewer are tried.
        let (mut unfit, mut skipped) = (0_u32, 0_u32);
        for tile in tiles {
            let mut left = tile.asked;
            if skipped > 0 {
                skipped -= 1;
            } else {
                listed.fill(tracer.form(), &self.space, lines, |ray| tile.number(ray))?;
                let (hits, unfitting) = match turns.cells {
                    Some(cells) => tracer.trace_listed(turns.view, cells, &listed, tile.asked),
                    None => tracer.trace_listed(turns.view, &Skin, &listed, tile.asked),
                };
                left = unfitting;
                unfit = if left == 0 { 0 } else { (unfit + 1).min(MAX_UNFIT) };
                skipped = (1 << unfit) - 1;
                let mut bits = hits.bits();
                while bits != 0 {
                    let ray = bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    turns.found.take(tile.number(ray), hits.hit(ray).as_ref());
                }
            }
            while left != 0 {
                let number = tile.number(left.trailing_zeros() as usize);
                left &= left - 1;
                if let Some(ray) = self.space.ray(lines.0[number], lines.1[number])? {
                    turns.take(number, ray);
                }
            }
        }
        for number in rest..lines.0.len() {
            if let Some(ray) = self.space.ray(lines.0[number], lines.1[number])? {
                turns.take(number, ray);
            }
        }
        Ok(())
    }
}

/// A hit in the world; its normal is the stored one, of index space for cells.
#[inline]
fn stored(
    view: &ModelView<'_>,
    cells: Option<&Cells<'_>>,
    space: &GridSpace,
    hit: &Hit,
    (origin_mm, direction): ([f64; 3], [f64; 3]),
) -> (SurfacePoint, Option<[f64; 3]>) {
    let position_mm = each3!(A => origin_mm[A] + hit.t * direction[A]);
    // Larger leaves have no number among the cells; theirs count down from the greatest.
    let number = hit.voxel(view).unwrap_or(Hits::NOTHING - 1 - hit.box_number);
    let normal = match cells {
        Some(_) if hit.edge_log2 > 0 => {
            Some(view.leaf_plane(NodeIndex::new(hit.box_number)).normal.map(f64::from))
        }
        Some(cells) => Some(cells.normal(number, cell_coordinates(space, hit.cell, position_mm))),
        None => view.voxel_direction(VoxelIndex::new(number)).map(|stored| stored.map(f64::from)),
    };
    (SurfacePoint { position_mm, t: hit.t, voxel: hit.cell, number, normal: None }, normal)
}
