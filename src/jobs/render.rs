//! Pictures of models and scenes in memory: request and report; and the traversal's self-check.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Serialize;

use super::picture_memory::PictureMemory;
use crate::fault::usage;
use crate::format::ColorMap;
use crate::geom::{Affine, Dims, NodeIndex, VoxelIndex};
use crate::load::{ModelView, NodeView};
use crate::progress::{Progress, Silent};
use crate::render::annotate::{Entry, Ramp, Style};
use crate::render::picture::{Traversal, check_size, pool};
use crate::render::reference::BitVolume;
use crate::render::selfcheck::{self, Mismatches};
use crate::render::shade::{Shader, linear_of};
use crate::render::{
    Camera, Image, NamedView, Projection, RenderError, Samples, Shading, Smoothing, ViewPoint,
};
use crate::scene::{self, Counts, Instance, LabelRule, PictureSettings, Scene, Section, Seen, Watch};

/// A picture of a model or of a scene. `None` leaves an option to the scene; a single model has the defaults that are
/// stated.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderRequest {
    /// Width and height in pixels; 1024 x 1024.
    pub size: Option<[u32; 2]>,
    /// Position of the camera; the front.
    pub point: Option<ViewPoint>,
    /// Projection of the camera; parallel.
    pub projection: Option<Projection>,
    /// Angle in degrees between the bottom and the top of the picture; [`RenderRequest::FOV_DEG`].
    pub fov_deg: Option<f64>,
    /// Magnification about the picture's middle, 0.01 to 1000.
    pub zoom: f64,
    /// Light; soft, or a scene's own lights.
    pub shading: Option<Shading>,
    /// Normals of the shading and of the normal image.
    pub smoothing: Smoothing,
    /// Ambient occlusion rays per pixel, at most 1024, unless light is plain; averaging over nearby pixels makes them
    /// about sixteen times as many. 0 for the default: 1 for soft light, 4 for ambient occlusion, or the scene's own
    /// number. Cost: half a microsecond each, one in cells.
    pub ambient_rays: u32,
    /// Rays of a pixel's colours; `Auto`.
    pub samples: Option<Samples>,
    /// True to stop at nodes about as small as a pixel instead of at voxels. Models of which labels are hidden,
    /// translucent or cut are shown exactly.
    pub lod: bool,
    /// With `lod`, boxes are larger by 2^this.
    pub lod_bias: i8,
    /// Target of the rays: the first box that the line intersects, or the voxel of the paper's discrete ray.
    pub traversal: Traversal,
    /// Colour (sRGB) of models without colours of their own; the colour of bone, or of a scene's materials.
    pub color: Option<[u8; 3]>,
    /// Colour map of measured values; the quantity's own.
    pub value_map: Option<ColorMap>,
    /// Lowest and highest value of the colours; the quantity's own. Diverging maps are symmetric around 0.
    pub value_range: Option<[f64; 2]>,
    /// Colour (sRGB) behind everything; transparent.
    pub background: Option<[u8; 3]>,
    /// The part of all models that is shown: low and high bounds along each axis in mm, which may be infinite.
    pub clip_mm: Option<[[f64; 2]; 3]>,
    /// A slice instead of a view; it has no light and takes precedence over the camera.
    pub section: Option<Section>,
    /// Visibility of labels; later rules override earlier ones, and rules of a scene.
    pub labels: Vec<LabelRule>,
    /// True to draw a scale bar and the patient's sides, or the axes, below the picture.
    pub annotate: bool,
    /// True to make a depth image, too.
    pub depth: bool,
    /// True to make a normal image, too.
    pub normals: bool,
    /// True to make an image of the numbers of boxes or labels, too ([`Image::ids`]).
    pub ids: bool,
    /// Threads; 0 counts as 1. The picture does not depend on them.
    pub threads: usize,
    /// Cap of the whole process's resident memory in bytes; kept only where files are rendered.
    pub memory_bytes: Option<u64>,
}

impl RenderRequest {
    /// Default angle of perspective pictures, in degrees.
    pub const FOV_DEG: f64 = 35.0;

    /// Default sides of pictures in pixels.
    pub(super) const SIZE: [u32; 2] = [1024; 2];
}

impl Default for RenderRequest {
    /// 1024 x 1024, parallel from the front, exact voxels, soft light, smooth edges, one thread per core; options of a
    /// scene are left to it.
    fn default() -> Self {
        Self {
            size: None,
            point: None,
            projection: None,
            fov_deg: None,
            zoom: 1.0,
            shading: None,
            smoothing: Smoothing::Smooth,
            ambient_rays: 0,
            samples: None,
            lod: false,
            lod_bias: 0,
            traversal: Traversal::Exact,
            color: None,
            value_map: None,
            value_range: None,
            background: None,
            clip_mm: None,
            section: None,
            labels: Vec::new(),
            annotate: false,
            depth: false,
            normals: false,
            ids: false,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: None,
        }
    }
}

/// Figures of a picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RenderReport {
    /// Pixels in a row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// Worker threads.
    pub threads: usize,
    /// Models in the picture.
    pub models: usize,
    /// Files of the models; models may share a file.
    pub files: usize,
    /// Traversal of the rays.
    pub traversal: Traversal,
    /// Light; null for a scene's own lights.
    pub shading: Option<Shading>,
    /// Rays of a pixel.
    pub samples: Samples,
    /// Rays traced, those for soft edges included.
    pub rays: u64,
    /// Rays that hit the model.
    pub hits: u64,
    /// Rays towards lights.
    pub shadow_rays: u64,
    /// Mirrored rays.
    pub mirrored_rays: u64,
    /// Refracted rays.
    pub refracted_rays: u64,
    /// Rays of ambient occlusion.
    pub ambient_rays: u64,
    /// Seconds of setup: camera and threads.
    pub setup_s: f64,
    /// Seconds of tracing rays from the eye.
    pub trace_s: f64,
    /// Seconds of shading.
    pub shade_s: f64,
    /// Seconds of looking around for soft light or ambient occlusion, whose rays are not in `rays`; 0 without it. With
    /// several models, or one that is cut, this is part of the shading.
    pub ambient_s: f64,
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
    /// Labels that the legend had no room for.
    #[serde(skip)]
    pub unlisted: usize,
}

impl RenderReport {
    /// The sums of this picture and another one.
    pub(super) fn and(self, other: &Self) -> Self {
        let mut sum = self;
        crate::render::add_counts!(sum, other: rays, hits, shadow_rays, mirrored_rays, refracted_rays, ambient_rays,
            setup_s, trace_s, shade_s, ambient_s, refined_pixels, wall_s, steps);
        let rays = sum.rays as f64;
        sum.rays_per_s = if sum.trace_s > 0.0 { rays / sum.trace_s } else { 0.0 };
        sum.max_steps = sum.max_steps.max(other.max_steps);
        sum.smallest_box = sum.smallest_box.min(other.smallest_box);
        sum.depth_near_mm = sum.depth_near_mm.min(other.depth_near_mm);
        sum.depth_far_mm = sum.depth_far_mm.max(other.depth_far_mm);
        sum
    }
}

/// Makes a picture of a model placed by `dims` and `affine`.
///
/// The picture depends on the model and the request only: not on the machine, nor on the threads. Rules about labels
/// need a table of labels, which a view lacks.
///
/// # Errors
/// [`RenderError`] for a camera or a size that makes no sense, and for a model without a volume.
pub fn render_view(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    request: &RenderRequest,
) -> Result<(Image, RenderReport), RenderError> {
    render_within(view, (dims, affine), request, &PictureMemory::none())
}

/// [`render_view`] within what `relief` allows.
fn render_within(
    view: &ModelView<'_>,
    (dims, affine): (Dims, &Affine),
    request: &RenderRequest,
    relief: &PictureMemory<'_>,
) -> Result<(Image, RenderReport), RenderError> {
    let scene = Scene::of_model(std::path::PathBuf::new()).shown_as(request.color, request.clip_mm);
    let parts = scene
        .models
        .iter()
        .map(|model| Ok(Instance::alone(view, dims, affine)?.made_of(model.material, model.clip.clone())));
    let parts: Vec<Instance<'_>> = parts.collect::<Result<_, RenderError>>()?;
    let bodies = Bodies { parts: &parts, scene: &scene, legend: None, ramp: None, is_patient: true };
    let (image, report, _) = paint_whole(&bodies, request, &Silent, relief)?;
    Ok((image, report))
}

/// Models in their places, and the options of their scene.
pub(super) struct Bodies<'a> {
    pub(super) parts: &'a [Instance<'a>],
    pub(super) scene: &'a Scene,
    /// Entries of visible labels, if a legend is wanted.
    pub(super) legend: Option<Vec<(Seen, Entry)>>,
    /// The colours of values, if a legend is wanted and values are shown.
    pub(super) ramp: Option<Ramp>,
    /// True if the axes of all models are a patient's.
    pub(super) is_patient: bool,
}

impl Bodies<'_> {
    /// Greatest `direction . p` over the points p of all models, in mm.
    pub(super) fn support(&self, direction: [f64; 3]) -> f64 {
        self.parts.iter().map(|part| part.support(direction)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// [`Bodies::support`] of what is visible, or of all if nothing is.
    pub(super) fn support_of_visible(&self, direction: [f64; 3]) -> f64 {
        let all: Vec<_> = self.parts.iter().map(|part| (part, 0)).collect();
        support(&all, direction, &PictureMemory::none())
    }

    /// The colour behind a picture (sRGB).
    pub(super) fn ground(&self, request: &RenderRequest) -> Option<[u8; 3]> {
        let own = || Some(self.scene.background?.map(|light| Shader::new().encode(light)));
        request.background.or_else(own)
    }

    /// The size of a picture in pixels.
    pub(super) fn size(&self, request: &RenderRequest) -> [u32; 2] {
        request.size.or(self.scene.size).unwrap_or(RenderRequest::SIZE)
    }

    /// Model files.
    fn files(&self) -> usize {
        self.parts.iter().map(|part| part.file + 1).max().unwrap_or(0)
    }
}

/// A picture in memory, and the labels that it shows if the request or a legend needs them.
///
/// # Errors
/// Errors of [`render_view`].
pub(super) fn paint_whole(
    bodies: &Bodies<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
    relief: &PictureMemory<'_>,
) -> Result<(Image, RenderReport, BTreeSet<Seen>), RenderError> {
    let [_, height] = bodies.size(request);
    let mut whole: Option<Image> = None;
    let (report, seen) = paint_parts(bodies, request, progress, relief, &mut |part| {
        let whole = whole.get_or_insert_with(|| {
            let mut empty = Image::blank([part.width, 0], part.layers());
            empty.reserve(height);
            empty
        });
        whole.append(part);
        Ok(())
    })?;
    Ok((whole.unwrap_or_else(|| Image::blank([0; 2], [false; 3])), report, seen))
}

/// [`paint_whole`] in bands of rows: the picture is never held as a whole. Each part has the width of the picture.
///
/// # Errors
/// Errors of [`render_view`] and of `take`.
pub(super) fn paint_parts(
    bodies: &Bodies<'_>,
    request: &RenderRequest,
    progress: &dyn Progress,
    relief: &PictureMemory<'_>,
    take: &mut (dyn FnMut(&Image) -> Result<(), RenderError> + Send),
) -> Result<(RenderReport, BTreeSet<Seen>), RenderError> {
    let mut prepared = Prepared::new(bodies, request, relief)?;
    let has_cells = bodies.parts.iter().any(|part| part.view.cells().is_some());
    prepared.look.max_band_pixels =
        relief.band_pixels(&prepared.look, bodies.files(), prepared.boxes_wide(bodies), has_cells)?;
    progress.stage("render", prepared.look.height.into());
    let watch = Watch {
        rows_done: &|rows: u32| progress.advance(rows.into()),
        between: &|| relief.look(),
        is_stopped: &|| progress.stopped(),
    };
    let (mut strip, ground) = (None, bodies.ground(request));
    let (counts, seen) = scene::paint_parts(bodies.parts, &prepared.look, watch, &mut |part| {
        ground.into_iter().for_each(|ground| part.lay_on(ground));
        strip = strip.take().or_else(|| prepared.strip(part));
        take(part)
    })?;
    strip.map_or(Ok(()), |strip| take(&strip))?;
    Ok((prepared.report(bodies, request, &counts), seen))
}

/// A picture with its camera placed.
pub(super) struct Prepared {
    start: Instant,
    pub(super) look: PictureSettings,
    /// Style of the strip below the picture.
    style: Option<Style>,
    is_patient: bool,
    /// Time of the preparation.
    setup: Duration,
    /// Nearest and farthest depth of the models in mm.
    range_mm: (f64, f64),
}

impl Prepared {
    pub(super) fn new(
        bodies: &Bodies<'_>,
        request: &RenderRequest,
        relief: &PictureMemory<'_>,
    ) -> Result<Self, RenderError> {
        let start = Instant::now();
        let Bodies { parts, scene, .. } = *bodies;
        let [width, height] = bodies.size(request);
        check_size(width, height)?;
        let style = Style::of([width, height], bodies.ground(request)).filter(|_| request.annotate);
        let height = height - style.map_or(0, Style::bar_rows);
        let mut levels = vec![0; parts.len()];
        if request.lod && request.section.is_none() {
            // A first pass over a few large boxes tells how large the boxes of the picture are; to place the camera, no
            // more of the file is needed.
            let few = |part: &Instance<'_>| part.space.dims().depth().saturating_sub(FIRST_LOOK_LEVELS);
            let first = |number: usize| parts.get(number).map_or(0, few);
            let camera = place(bodies, request, [width, height], relief, &first)?;
            for (level, part) in levels.iter_mut().zip(parts) {
                let support = |direction| support(&[(part, few(part))], direction, relief);
                let near_mm = camera.depth_range_mm(support).0;
                *level = part.level(level_of_detail(part, &camera, (height, request.lod_bias), near_mm));
            }
        }
        let level = |number: usize| levels.get(number).copied().unwrap_or(0);
        let camera = place(bodies, request, [width, height], relief, &level)?;
        let shown: Vec<_> = parts.iter().enumerate().map(|(number, part)| (part, level(number))).collect();
        let range_mm = camera.depth_range_mm(|direction| support(&shown, direction, relief));
        let mut ambient = scene.ambient;
        if request.ambient_rays > 0 || request.shading.is_some() {
            ambient.rays = request.ambient_rays;
        }
        let shows_values = parts.iter().any(Instance::shows_values);
        let look = PictureSettings {
            width,
            height,
            near_mm: scene.camera.near_mm,
            // Light would falsify the colours of values against the legend.
            shading: request
                .shading
                .or(scene.shading.map(|own| if shows_values { Shading::Flat } else { own })),
            lights: scene.lights.clone(),
            ambient,
            background: bodies.ground(request).map(linear_of),
            bounces: scene.bounces,
            samples: request.samples.or(scene.samples).unwrap_or_default(),
            // Pictures by level of detail favour speed.
            creases: !request.lod,
            smoothing: request.smoothing,
            traversal: request.traversal,
            levels,
            section: request.section,
            threads: request.threads,
            depth_range_mm: request.depth.then_some(range_mm),
            normals: request.normals,
            ids: request.ids,
            seen: bodies.legend.is_some(),
            max_band_pixels: None,
            camera,
        };
        Ok(Self { start, look, style, is_patient: bodies.is_patient, setup: start.elapsed(), range_mm })
    }

    /// Boxes side by side in the farthest pixel, for the model with the smallest ones.
    fn boxes_wide(&self, bodies: &Bodies<'_>) -> f64 {
        let pixel_mm = self.look.camera.pixel_mm(self.look.height, self.range_mm.1);
        let wide = bodies.parts.iter().zip(&self.look.levels).map(|(part, level)| {
            let least_mm = part.space.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
            pixel_mm / (least_mm * f64::from(1_u32 << level.min(&31)))
        });
        wide.fold(0.0, f64::max)
    }

    /// The strip below the picture, whose bar is true at the models' middle; with the layers of `like`.
    fn strip(&self, like: &Image) -> Option<Image> {
        let middle_mm = (self.range_mm.0 + self.range_mm.1) / 2.0;
        Some(self.style?.bar(like, (&self.look.camera, self.is_patient), (self.look.height, middle_mm)))
    }

    fn report(&self, bodies: &Bodies<'_>, request: &RenderRequest, counts: &Counts) -> RenderReport {
        let wall = self.start.elapsed();
        let trace_s = counts.trace.as_secs_f64();
        let [width, height] = bodies.size(request);
        RenderReport {
            width,
            height,
            threads: request.threads.max(1),
            models: bodies.parts.len(),
            files: bodies.files(),
            traversal: request.traversal,
            shading: self.look.shading,
            samples: self.look.samples,
            rays: counts.rays,
            hits: counts.hits,
            shadow_rays: counts.shadow,
            mirrored_rays: counts.mirrored,
            refracted_rays: counts.refracted,
            ambient_rays: counts.ambient,
            setup_s: self.setup.as_secs_f64(),
            trace_s,
            shade_s: counts.shade.as_secs_f64(),
            ambient_s: counts.around.as_secs_f64(),
            refined_pixels: counts.refined,
            wall_s: wall.as_secs_f64(),
            rays_per_s: if trace_s > 0.0 { counts.rays as f64 / trace_s } else { 0.0 },
            steps: counts.steps,
            max_steps: counts.max_steps,
            smallest_box: 1 << self.look.levels.iter().min().copied().unwrap_or(0),
            bytes_touched: None,
            depth_near_mm: self.range_mm.0,
            depth_far_mm: self.range_mm.1,
            unlisted: 0,
        }
    }
}

/// Greatest `direction . p` over the visible points p of models in boxes of 2^k voxels, in mm; over all points where
/// every label is hidden.
fn support(parts: &[(&Instance<'_>, u32)], direction: [f64; 3], relief: &PictureMemory<'_>) -> f64 {
    relief.look_now();
    let visible = parts.iter().map(|(part, finest)| part.support_to(direction, *finest, &|| relief.look()));
    let most = visible.fold(f64::NEG_INFINITY, f64::max);
    let all = || parts.iter().map(|(part, _)| part.support(direction)).fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() { most } else { all() }
}

/// The camera of a picture of this size, before models as boxes of 2^`finest` voxels.
fn place(
    bodies: &Bodies<'_>,
    request: &RenderRequest,
    [width, height]: [u32; 2],
    relief: &PictureMemory<'_>,
    finest: &dyn Fn(usize) -> u32,
) -> Result<Camera, RenderError> {
    let Bodies { parts, scene, .. } = *bodies;
    let own = &scene.camera;
    let of_scene = match (own.eye, own.view) {
        (Some([eye, look_at]), _) => Some(ViewPoint::Free { eye, look_at, up: own.up }),
        (None, view) => view.map(ViewPoint::Named),
    };
    let slice = request.section.map(|section| ViewPoint::Named(section.view()));
    let point = slice.or(request.point).or(of_scene).unwrap_or(ViewPoint::Named(NamedView::Front));
    let all = || (0..).zip(parts).map(|(number, part)| (part, finest(number)));
    let mut framed: Vec<_> =
        all().zip(&scene.models).filter(|(_, model)| model.framed).map(|(part, _)| part).collect();
    if framed.is_empty() {
        framed = all().collect();
    }
    let frame = |direction| match request.section {
        // Slices of different labels have the same frame.
        Some(_) => framed.iter().map(|(part, _)| part.support(direction)).fold(f64::NEG_INFINITY, f64::max),
        None => support(&framed, direction, relief),
    };
    let projection = match request.section {
        Some(_) => Projection::Parallel,
        None => request.projection.or(own.projection).unwrap_or_default(),
    };
    let fov = request.fov_deg.or(own.fov_deg).unwrap_or(RenderRequest::FOV_DEG);
    let aspect = f64::from(width) / f64::from(height);
    Camera::new(point, projection, fov, aspect, frame)?.zoomed(request.zoom)
}

/// Levels of the octree for a rough extent of a model.
const FIRST_LOOK_LEVELS: u32 = 6;

/// Largest k such that boxes of 2^k voxels are no larger than 1.5 pixels, at the model's nearest point, plus the bias;
/// 0 when that is under 4 voxels, below which there are no mean normals, or when the model has normals but no mean
/// ones.
fn level_of_detail(part: &Instance<'_>, camera: &Camera, (height, bias): (u32, i8), near_mm: f64) -> u32 {
    let (view, space) = (part.view, &part.space);
    if view.voxel_normal(VoxelIndex::new(0)).is_some() && view.node_normal(NodeIndex::ROOT).is_none() {
        return 0;
    }
    let most_mm = 1.5 * camera.pixel_mm(height, near_mm) * 2.0_f64.powi(bias.into());
    let edge_mm = |k: u32| f64::from(1_u32 << k) * space.largest_spacing_mm();
    let k = (1..=space.dims().depth()).take_while(|k| edge_mm(*k) <= most_mm).last().unwrap_or(0);
    if k >= 2 { k } else { 0 }
}

/// Ratio of the area from another side to the area from the front beyond which a volume is flat.
const FLAT: f64 = 4.0;

/// The front, or the side from which a flat volume (one slice, a few) shows its content: axial slices from below, as
/// they are read in radiology, sagittal ones from the patient's left.
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
/// Errors of [`render_view`].
pub fn thumbnail(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    size: u32,
    threads: usize,
) -> Result<(Image, RenderReport), RenderError> {
    thumbnail_within(view, (dims, affine), (size, threads), &PictureMemory::none())
}

/// [`thumbnail`] within what `relief` allows.
pub(super) fn thumbnail_within(
    view: &ModelView<'_>,
    (dims, affine): (Dims, &Affine),
    (size, threads): (u32, usize),
    relief: &PictureMemory<'_>,
) -> Result<(Image, RenderReport), RenderError> {
    let request = RenderRequest {
        size: Some([size; 2]),
        point: Some(ViewPoint::Named(thumbnail_view(dims, affine))),
        threads,
        lod: true,
        ..RenderRequest::default()
    };
    render_within(view, (dims, affine), &request, relief)
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
    // With larger leaves only the cells are compared, which needs no volume.
    let bits = if view.has_leaves() { BitVolume::new(0) } else { BitVolume::decode(view) };
    let bits = bits.ok_or_else(|| {
        let (depth, most) = (view.depth(), BitVolume::MAX_DEPTH);
        usage!("a grid of 2^{depth} cells a side is too large to be compared cell by cell; choose a model of at most 2^{most}")
    })?;
    let tasks = rays.div_ceil(SELFCHECK_TASK);
    let task = |i: u64| {
        let count = SELFCHECK_TASK.min(rays - i * SELFCHECK_TASK);
        // Tasks far apart in the generator's sequence: its seeds are mixed, not counted up.
        let task_seed = selfcheck::Random::new(seed ^ i.wrapping_mul(0xd134_2543_de82_ef95)).bits();
        selfcheck::mismatches(view, &bits, count, task_seed)
    };
    let all = || (0..tasks).into_par_iter().map(task).reduce(Mismatches::default, Mismatches::plus);
    Ok(pool(threads)?.install(all))
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
