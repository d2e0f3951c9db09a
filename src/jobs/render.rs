//! `oct render`, `oct thumbnail` and the traversal's self-check.

use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Serialize;

use super::relief::Relief;
use crate::geom::{Affine, Dims, NodeIndex, VoxelIndex};
use crate::load::{ModelView, NodeView};
use crate::progress::{Progress, Silent};
use crate::render::annotate::Style;
use crate::render::picture::{self, Canvas, Counts, Traversal, Watch};
use crate::render::reference::BitVolume;
use crate::render::selfcheck::{self, Mismatches};
use crate::render::{
    Camera, GridSpace, Image, NamedView, Projection, RenderError, RenderFault, Samples, Shading, Smoothing,
    ViewPoint,
};

/// What picture to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderRequest {
    /// Pixels in a row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// Where the camera stands.
    pub point: ViewPoint,
    /// How its lines of sight run.
    pub projection: Projection,
    /// Angle in degrees between the bottom and the top of the picture.
    pub fov_deg: f64,
    /// Threads; 0 counts as 1. The picture does not depend on them.
    pub threads: usize,
    /// Stop at nodes about as small as a pixel instead of at voxels.
    pub lod: bool,
    /// With `lod`, boxes 2^this times as large as they would be.
    pub lod_bias: i8,
    /// Cap of the whole process's resident memory in bytes; looked after by what renders files.
    pub memory_bytes: Option<u64>,
    /// Rays of a pixel's colours.
    pub samples: Samples,
    /// Make a depth image, too.
    pub depth: bool,
    /// Make a normal image, too.
    pub normals: bool,
    /// Make an image of the numbers of boxes, too ([`Image::ids`]).
    pub ids: bool,
    /// The light.
    pub shading: Shading,
    /// Colour (sRGB) of a model without colours of its own; `None` for that of bone.
    pub color: Option<[u8; 3]>,
    /// Colour (sRGB) behind the model; `None` leaves it transparent.
    pub background: Option<[u8; 3]>,
    /// Magnification about the picture's middle, 0.01 to 1000.
    pub zoom: f64,
    /// The normals that are shown, in the normal image, too.
    pub smoothing: Smoothing,
    /// Ambient occlusion rays per pixel, at most 1024, unless light is plain; averaging over nearby pixels makes them
    /// about sixteen times as many. 0 for the default: 1 for soft light, 4 for ambient occlusion. Cost: half a
    /// microsecond each, one in cells.
    pub ambient_rays: u32,
    /// What the rays hit: the box that the line pierces first, or the voxel of the paper's discrete ray.
    pub traversal: Traversal,
    /// Draw a scale bar and the patient's sides below the picture.
    pub annotate: bool,
}

impl RenderRequest {
    /// Default angle of perspective pictures, in degrees.
    pub const FOV_DEG: f64 = 35.0;

    /// How scale bar and sides are written, if they are.
    fn style(&self) -> Option<Style> {
        Style::of([self.width, self.height], self.background).filter(|_| self.annotate)
    }

    /// Puts the background behind the model.
    fn finish(&self, part: &mut Image) {
        if let Some(background) = self.background {
            part.lay_on(background);
        }
    }
}

impl Default for RenderRequest {
    /// 1024 x 1024, parallel from the front, exact voxels, soft light, smooth edges, one thread per core.
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            point: ViewPoint::Named(NamedView::Front),
            projection: Projection::Parallel,
            fov_deg: Self::FOV_DEG,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            lod: false,
            lod_bias: 0,
            memory_bytes: None,
            samples: Samples::Auto,
            depth: false,
            normals: false,
            ids: false,
            shading: Shading::Soft,
            color: None,
            background: None,
            zoom: 1.0,
            smoothing: Smoothing::Smooth,
            ambient_rays: 0,
            traversal: Traversal::Exact,
            annotate: false,
        }
    }
}

/// How a picture was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RenderReport {
    /// Pixels in a row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// Worker threads.
    pub threads: usize,
    /// Traversal of the rays.
    pub traversal: Traversal,
    /// Light.
    pub shading: Shading,
    /// Rays of a pixel.
    pub samples: Samples,
    /// Rays traced, those for soft edges included.
    pub rays: u64,
    /// Rays that hit the model.
    pub hits: u64,
    /// Seconds of setup: camera and threads; for a scene everything but tracing.
    pub setup_s: f64,
    /// Seconds of tracing; for a scene with shading.
    pub trace_s: f64,
    /// Seconds of shading.
    pub shade_s: f64,
    /// Seconds of looking around for soft light or ambient occlusion, whose rays are not in `rays`; 0 without it.
    pub ambient_s: f64,
    /// Rays of ambient occlusion.
    pub ambient_rays: u64,
    /// Pixels of several rays.
    pub refined_pixels: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// `rays` / `trace_s`.
    pub rays_per_s: f64,
    /// Traversal steps of all rays.
    pub steps: u64,
    /// Steps of the longest ray.
    pub max_steps: u32,
    /// Edge of the smallest boxes shown, in voxels: 1 for exact voxels.
    pub smallest_box: u32,
    /// Bytes of model files that came into memory, in whole pages, read-ahead included; null for a model that is not a
    /// mapped file.
    pub bytes_touched: Option<u64>,
    /// Depth in mm of grey 1 of the depth picture.
    pub depth_near_mm: f64,
    /// Depth in mm of grey 65535: depth = near + (grey - 1) / 65534 * (far - near).
    pub depth_far_mm: f64,
}

impl RenderReport {
    /// This picture and another one, as one.
    pub(super) fn and(self, other: &Self) -> Self {
        let trace_s = self.trace_s + other.trace_s;
        let rays = self.rays + other.rays;
        Self {
            rays,
            hits: self.hits + other.hits,
            setup_s: self.setup_s + other.setup_s,
            trace_s,
            shade_s: self.shade_s + other.shade_s,
            ambient_s: self.ambient_s + other.ambient_s,
            ambient_rays: self.ambient_rays + other.ambient_rays,
            refined_pixels: self.refined_pixels + other.refined_pixels,
            wall_s: self.wall_s + other.wall_s,
            #[expect(clippy::cast_precision_loss, reason = "a rate")]
            rays_per_s: if trace_s > 0.0 { rays as f64 / trace_s } else { 0.0 },
            steps: self.steps + other.steps,
            max_steps: self.max_steps.max(other.max_steps),
            smallest_box: self.smallest_box.min(other.smallest_box),
            depth_near_mm: self.depth_near_mm.min(other.depth_near_mm),
            depth_far_mm: self.depth_far_mm.max(other.depth_far_mm),
            ..self
        }
    }
}

/// Makes a picture of a model placed by `dims` and `affine`.
///
/// The picture depends on the model and the request only: not on the machine, nor on the threads.
///
/// # Errors
/// [`RenderError`] for a camera or a size that makes no sense, and for a model without a volume.
pub fn render_view(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
) -> Result<(Image, RenderReport), RenderError> {
    render_view_watched(view, dims, affine, request, &Silent)
}

/// As [`render_view`]; `progress` gets the rows that are done.
///
/// # Errors
/// As [`render_view`].
pub(crate) fn render_view_watched(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<(Image, RenderReport), RenderError> {
    render_view_relieved(view, dims, affine, request, progress, &Relief::new(None, 1, 0, (0, &|| {})))
}

/// As [`render_view_watched`], with a look at the process's memory now and then.
pub(super) fn render_view_relieved(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
    progress: &dyn Progress,
    relief: &Relief<'_>,
) -> Result<(Image, RenderReport), RenderError> {
    let mut scene = Prepared::new(view, dims, affine, request, relief)?;
    scene.canvas.most_band_pixels =
        relief.band_pixels(&scene.canvas, scene.boxes_wide(), view.cells().is_some())?;
    progress.stage("render", scene.canvas.height.into());
    let watch = Watch { rows_done: &|rows: u32| progress.advance(rows.into()), between: &|| relief.look() };
    let Prepared { space, camera, canvas, .. } = &scene;
    let (mut image, counts) = picture::paint_watched(view, space, camera, *canvas, watch)?;
    request.finish(&mut image);
    if let Some(strip) = scene.strip(request, &image) {
        image.append(&strip);
    }
    Ok((image, scene.report(request, &counts)))
}

/// As [`render_view_watched`], but hands on some rows after the others: the picture is never held as a whole. Each part
/// has the width of the picture.
///
/// # Errors
/// As [`render_view`], and what `take` says.
pub(super) fn render_view_parts(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
    progress: &dyn Progress,
    relief: &Relief<'_>,
    take: &mut (dyn FnMut(&Image) -> Result<(), RenderError> + Send),
) -> Result<RenderReport, RenderError> {
    let mut scene = Prepared::new(view, dims, affine, request, relief)?;
    progress.stage("render", scene.canvas.height.into());
    scene.canvas.most_band_pixels =
        relief.band_pixels(&scene.canvas, scene.boxes_wide(), view.cells().is_some())?;
    let watch = Watch { rows_done: &|rows: u32| progress.advance(rows.into()), between: &|| relief.look() };
    let Prepared { space, camera, canvas, .. } = &scene;
    let mut strip = None;
    let counts = picture::paint_parts(view, space, camera, *canvas, watch, &mut |part| {
        request.finish(part);
        strip = strip.take().or_else(|| scene.strip(request, part));
        take(part)
    })?;
    strip.map_or(Ok(()), |strip| take(&strip))?;
    Ok(scene.report(request, &counts))
}

/// The camera of a picture, and the place of the model before it.
///
/// # Errors
/// As [`render_view`].
#[cfg(feature = "python")]
pub(crate) fn camera(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
) -> Result<(GridSpace, Camera), RenderError> {
    let request = RenderRequest { annotate: false, ..*request };
    let prepared = Prepared::new(view, dims, affine, &request, &Relief::new(None, 1, 0, (0, &|| {})))?;
    Ok((prepared.space, prepared.camera))
}

/// A model in its place before its camera.
struct Prepared {
    start: Instant,
    space: GridSpace,
    camera: Camera,
    canvas: Canvas,
    /// Time that it took to get here.
    setup: Duration,
    /// Depths of the model in mm.
    range_mm: (f64, f64),
}

impl Prepared {
    fn new(
        view: &ModelView<'_>,
        dims: Dims,
        affine: &Affine,
        request: &RenderRequest,
        relief: &Relief<'_>,
    ) -> Result<Self, RenderError> {
        let start = Instant::now();
        picture::check_size(request.width, request.height)?;
        let space = GridSpace::new(dims, affine)?;
        let height = request.height - request.style().map_or(0, Style::bar_rows);
        let aspect = f64::from(request.width) / f64::from(height);
        let (mut lod_edge_log2, mut finest) = (0, 0);
        if request.lod {
            // A first look, by boxes of which there are few, tells how large the boxes of the picture are; more of the
            // file is not needed to place the camera.
            let few = dims.depth().saturating_sub(FIRST_LOOK_LEVELS);
            let support = |direction| {
                relief.look_now();
                space.support_to(view, direction, few)
            };
            let camera = Camera::new(request.point, request.projection, request.fov_deg, aspect, support)?
                .zoomed(request.zoom)?;
            let near_mm = camera.depth_range_mm(support).0;
            lod_edge_log2 = level_of_detail(view, &space, &camera, (height, request.lod_bias), near_mm);
            finest = lod_edge_log2;
        }
        let support = |direction| {
            relief.look_now();
            space.support_to(view, direction, finest)
        };
        let camera = Camera::new(request.point, request.projection, request.fov_deg, aspect, support)?
            .zoomed(request.zoom)?;
        let range_mm = camera.depth_range_mm(support);
        let canvas = Canvas {
            width: request.width,
            height,
            threads: request.threads,
            lod_edge_log2,
            samples: request.samples,
            // Pictures by level of detail are made for speed.
            creases: !request.lod,
            shading: request.shading,
            color: request.color,
            smoothing: request.smoothing,
            depth_range_mm: request.depth.then_some(range_mm),
            normals: request.normals,
            ids: request.ids,
            ambient_rays: request.ambient_rays,
            traversal: request.traversal,
            most_band_pixels: None,
        };
        Ok(Self { start, space, camera, canvas, setup: start.elapsed(), range_mm })
    }

    /// Boxes side by side in the farthest pixel.
    fn boxes_wide(&self) -> f64 {
        let least_mm = self.space.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let edge_mm = least_mm * f64::from(1_u32 << self.canvas.lod_edge_log2.min(31));
        self.camera.pixel_mm(self.canvas.height, self.range_mm.1) / edge_mm
    }

    /// The strip below the picture, whose bar is true at the model's middle; with the layers of `like`.
    fn strip(&self, request: &RenderRequest, like: &Image) -> Option<Image> {
        let middle_mm = (self.range_mm.0 + self.range_mm.1) / 2.0;
        Some(request.style()?.bar(like, &self.camera, (self.canvas.height, middle_mm)))
    }

    fn report(&self, request: &RenderRequest, counts: &Counts) -> RenderReport {
        let wall = self.start.elapsed();
        let trace_s = counts.trace.as_secs_f64();
        RenderReport {
            width: request.width,
            height: request.height,
            threads: request.threads.max(1),
            traversal: request.traversal,
            shading: request.shading,
            samples: request.samples,
            rays: counts.rays,
            hits: counts.hits,
            setup_s: self.setup.as_secs_f64(),
            trace_s,
            shade_s: counts.shade.as_secs_f64(),
            ambient_s: counts.ambient.as_secs_f64(),
            ambient_rays: counts.ambient_rays,
            refined_pixels: counts.refined,
            wall_s: wall.as_secs_f64(),
            #[expect(clippy::cast_precision_loss, reason = "a rate")]
            rays_per_s: if trace_s > 0.0 { counts.rays as f64 / trace_s } else { 0.0 },
            steps: counts.steps,
            max_steps: counts.max_steps,
            smallest_box: 1 << self.canvas.lod_edge_log2,
            bytes_touched: None,
            depth_near_mm: self.range_mm.0,
            depth_far_mm: self.range_mm.1,
        }
    }
}

/// Levels of the octree that tell roughly where a model is.
const FIRST_LOOK_LEVELS: u32 = 6;

/// Largest k such that boxes of 2^k voxels are no larger than 1.5 pixels, at the model's nearest point, or as much more
/// as is asked for; 0 when that is under 4 voxels, below which there are no mean normals, or when the model has normals
/// but no mean ones.
fn level_of_detail(
    view: &ModelView<'_>,
    space: &GridSpace,
    camera: &Camera,
    (height, bias): (u32, i8),
    near_mm: f64,
) -> u32 {
    if view.voxel_normal(VoxelIndex::new(0)).is_some() && view.node_normal(NodeIndex::ROOT).is_none() {
        return 0;
    }
    let most_mm = 1.5 * camera.pixel_mm(height, near_mm) * 2.0_f64.powi(bias.into());
    let edge_mm = |k: u32| f64::from(1_u32 << k) * space.largest_spacing_mm();
    let k = (1..=space.dims().depth()).take_while(|k| edge_mm(*k) <= most_mm).last().unwrap_or(0);
    if k >= 2 { k } else { 0 }
}

/// A volume is flat if it shows this many times more of itself from another side than from the front.
const FLAT: f64 = 4.0;

/// The front, or the side from which a flat volume (one slice, a few) shows what is in it: axial slices from
/// below, as they are read in radiology, sagittal ones from the patient's left.
fn thumbnail_view(dims: Dims, affine: &Affine) -> NamedView {
    let sides = dims.to_array();
    // Extent of the box along each patient axis.
    let extent = [0, 1, 2]
        .map(|axis| (0..3).map(|i| (affine.column(i)[axis] * f64::from(sides[i])).abs()).sum::<f64>());
    let [x, y, z] = extent;
    let front = x * z;
    if x * y >= FLAT * front && x * y >= y * z {
        NamedView::Bottom
    } else if y * z >= FLAT * front {
        NamedView::Left
    } else {
        NamedView::Front
    }
}

/// Makes a square thumbnail: the view that shows the most of a flat volume, else the front, framed, level of detail on, soft silhouette,
/// transparent background.
///
/// # Errors
/// As [`render_view`].
pub fn thumbnail(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    size: u32,
    threads: usize,
) -> Result<(Image, RenderReport), RenderError> {
    let request = RenderRequest {
        width: size,
        height: size,
        point: ViewPoint::Named(thumbnail_view(dims, affine)),
        threads,
        lod: true,
        ..RenderRequest::default()
    };
    render_view(view, dims, affine, &request)
}

/// Rays that one task of the self-check compares.
const SELFCHECK_TASK: u64 = 1 << 15;

/// Compares the traversal with the exact reference on random rays; [`Mismatches::total`] must be 0.
///
/// The rays depend on `rays` and `seed` only. Memory: one bit per grid cell, at most 128 MiB; of models with larger leaves
/// none.
///
/// # Errors
/// [`RenderError`] when the grid is too deep to be decoded, or the threads do not start.
pub fn selfcheck(
    view: &ModelView<'_>,
    rays: u64,
    seed: u64,
    threads: usize,
) -> Result<Mismatches, RenderError> {
    // Of larger leaves only the cells are compared, which needs no volume.
    let bits = if view.has_leaves() { BitVolume::new(0) } else { BitVolume::decode(view) };
    let bits = bits.ok_or_else(|| {
        RenderError::from(RenderFault::TooDeep { depth: view.depth(), most: BitVolume::MAX_DEPTH })
    })?;
    let tasks = rays.div_ceil(SELFCHECK_TASK);
    let task = |i: u64| {
        let count = SELFCHECK_TASK.min(rays - i * SELFCHECK_TASK);
        // Tasks far apart in the generator's sequence: its seeds are mixed, not counted up.
        let task_seed = selfcheck::Random::new(seed ^ i.wrapping_mul(0xd134_2543_de82_ef95)).bits();
        selfcheck::mismatches(view, &bits, count, task_seed)
    };
    let all = || (0..tasks).into_par_iter().map(task).reduce(Mismatches::default, Mismatches::plus);
    Ok(picture::pool(threads)?.install(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_volumes_are_shown_from_their_flat_side() {
        let axial = Affine::from_spacing([0.5, 0.5, 5.0]);
        let of = |x, y, z, affine: &Affine| Dims::new(x, y, z).map(|dims| thumbnail_view(dims, affine));
        assert_eq!(of(512, 512, 1, &axial), Some(NamedView::Bottom));
        assert_eq!(of(512, 512, 28, &axial), Some(NamedView::Front));
        // x runs to posterior, y to inferior, z to the left.
        let sagittal = Affine { rows: [[0.0, 0.0, 5.0, 0.0], [0.5, 0.0, 0.0, 0.0], [0.0, -0.5, 0.0, 0.0]] };
        assert_eq!(of(256, 256, 4, &sagittal), Some(NamedView::Left));
        assert_eq!(of(256, 256, 40, &sagittal), Some(NamedView::Front));
        assert_eq!(of(1, 1, 1, &Affine::from_spacing([1.0; 3])), Some(NamedView::Front));
    }
}
