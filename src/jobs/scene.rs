//! `oct render SCENE.toml`: several models on disk into one picture.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::frame::{Frame, label_entries};
use super::opened::open_model;
use super::picture::Outputs;
use super::shots::{self, Shots};
use crate::budget::mapped_rss_bytes;
use crate::error::{Error, UsageError};
use crate::format::Label;
use crate::load::{LoadError, LoadFault, Model, ModelView};
use crate::platform::open_file;
use crate::progress::Progress;
use crate::render::annotate::{Entry, Style};
use crate::render::shade::{Shader, linear_of};
use crate::render::{Camera, Image, NamedView, Projection, RenderFault, ViewPoint};
pub(crate) use crate::scene::Section;
use crate::scene::{
    self, Coloring, Colors, Key, LabelRule, Look, MAX_BYTES, Opacity, Painted, Part, Rays, Scene, SceneError,
    SceneFault, SceneModel, Seen, Table,
};
use crate::text::shown;

/// What the command line says of a scene's picture; it counts before what the scene says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneRequest {
    /// Pixels in a row, and rows.
    pub size: Option<[u32; 2]>,
    /// Where the camera stands.
    pub point: Option<ViewPoint>,
    /// How its lines of sight run.
    pub projection: Option<Projection>,
    /// Angle in degrees between the bottom and the top of the picture.
    pub fov_deg: Option<f64>,
    /// Rays of each point that tell how open its surroundings are.
    pub ambient_rays: Option<u32>,
    /// Magnification about the picture's middle, 0.01 to 1000.
    pub zoom: Option<f64>,
    /// Colour (sRGB) behind everything.
    pub background: Option<[u8; 3]>,
    /// Colour (sRGB) of a model without colours; scenes have materials.
    pub color: Option<[u8; 3]>,
    /// What is left of all models: low and high bounds along each axis in mm, which may be infinite.
    pub clip_mm: Option<[[f64; 2]; 3]>,
    /// A slice instead of a view; it counts before where the camera stands.
    pub section: Option<Section>,
    /// Which labels of a model are seen, later rules before earlier ones; models of scenes have their own.
    pub labels: Vec<LabelRule>,
    /// Draw a scale bar and the patient's sides.
    pub annotate: bool,
    /// Threads; 0 counts as 1. The picture does not depend on them.
    pub threads: usize,
}

/// How a scene was shown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SceneReport {
    /// Pixels in a row.
    pub width: u32,
    /// Rows of pixels.
    pub height: u32,
    /// Worker threads.
    pub threads: usize,
    /// Models in the scene.
    pub models: usize,
    /// Files of the models; models may share a file.
    pub files: usize,
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
    /// Seconds of setup: camera and threads; for a scene everything but tracing.
    pub setup_s: f64,
    /// Seconds of tracing; for a scene with shading.
    pub trace_s: f64,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// `rays` / `trace_s`.
    pub rays_per_s: f64,
    /// Bytes of model files that came into memory, in whole pages, read-ahead included; null for a model that is not a
    /// mapped file.
    pub bytes_touched: Option<u64>,
    /// Depth in mm of grey 1 of the depth picture.
    pub depth_near_mm: f64,
    /// Depth in mm of grey 65535: depth = near + (grey - 1) / 65534 * (far - near).
    pub depth_far_mm: f64,
}

/// Is a file the text of a scene, and not a model? Its name says so.
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("toml"))
}

/// Reads the text of a scene.
///
/// # Errors
/// The file cannot be read, or [`Error::Scene`] with what is wrong in it.
pub fn read_scene(path: &Path) -> Result<Scene, Error> {
    let unreadable =
        |cause| Error::Load(LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause }));
    let wrong = |fault| Error::Scene(SceneError { path: path.to_path_buf(), fault });
    let file = open_file(path).map_err(unreadable)?;
    let bytes = file.metadata().map_err(unreadable)?.len();
    if bytes > MAX_BYTES {
        return Err(wrong(SceneFault::TooLong { bytes, most: MAX_BYTES }));
    }
    let mut text = Vec::new();
    file.take(MAX_BYTES).read_to_end(&mut text).map_err(unreadable)?;
    let text = String::from_utf8(text).map_err(|_| wrong(SceneFault::NotText))?;
    scene::read(&text).map_err(wrong)
}

/// The scene of a text, or a model by itself, as the request wants it.
fn scene_at(path: &Path, request: &SceneRequest) -> Result<Scene, Error> {
    let mut scene = if is_scene(path) { read_scene(path)? } else { scene_of(path, request) };
    if let Some(bounds) = request.clip_mm {
        scene.cut(bounds);
    }
    scene.background = request.background.map(linear_of).or(scene.background);
    Ok(scene)
}

/// A model by itself.
fn scene_of(path: &Path, request: &SceneRequest) -> Scene {
    let mut scene = Scene::of_model(PathBuf::from(path.file_name().unwrap_or_default()));
    for model in &mut scene.models {
        model.material.color = request.color.map_or(model.material.color, linear_of);
        model.labels.clone_from(&request.labels);
    }
    scene
}

/// The files of a scene, each opened once.
struct Files {
    paths: Vec<PathBuf>,
    models: Vec<Model>,
    /// The file of each model of the scene.
    of: Vec<usize>,
}

impl Files {
    /// Opens what a scene names, beside its own file.
    fn open(scene_path: &Path, scene: &Scene) -> Result<Self, Error> {
        let folder = scene_path.parent().unwrap_or(Path::new(""));
        let (mut known, mut files): (Vec<PathBuf>, _) =
            (Vec::new(), Self { paths: Vec::new(), models: Vec::new(), of: Vec::new() });
        for (number, model) in (1..).zip(&scene.models) {
            let path = folder.join(&model.file);
            // Two names of one file are one file.
            let real = path.canonicalize().unwrap_or_else(|_| path.clone());
            let at = match known.iter().position(|other| *other == real) {
                Some(at) => at,
                None => {
                    files.models.push(open_model(&path).map_err(|error| match error {
                        Error::Load(cause) if is_scene(scene_path) => {
                            let key = Key { table: Table::Model(number), name: "file" };
                            let fault = SceneFault::File { key, told: cause.to_string() };
                            Error::Scene(SceneError { path: scene_path.to_path_buf(), fault })
                        }
                        other => other,
                    })?);
                    files.paths.push(path);
                    known.push(real);
                    known.len() - 1
                }
            };
            files.of.push(at);
        }
        Ok(files)
    }

    fn bytes_touched(&self) -> Option<u64> {
        self.models.iter().map(|model| mapped_rss_bytes(model.bytes())).sum()
    }
}

/// Renders the scene at `path`, or a model that is cut, to `output`, and to the depth and normal images if named.
///
/// # Errors
/// The scene is wrong, a model cannot be used, the camera makes no sense, or a picture cannot be written.
pub fn render_scene(
    path: &Path,
    outputs: &Outputs<'_>,
    request: &SceneRequest,
    progress: &dyn Progress,
) -> Result<SceneReport, Error> {
    let start = Instant::now();
    outputs.refuse_clash(path)?;
    let scene = scene_at(path, request)?;
    if let (None, Some([width, height])) = (request.size, scene.size) {
        check_size(path, width, height)?;
    }
    let files = Files::open(path, &scene)?;
    for model in &files.paths {
        outputs.refuse_clash(model)?;
    }
    let layers = outputs.create()?;
    let views: Vec<ModelView<'_>> = files.models.iter().map(Model::view).collect();
    let placed: Vec<_> = scene
        .models
        .iter()
        .zip(&files.of)
        .map(|(placed, file)| (placed, &files.models[*file], (&views[*file], *file), &*files.paths[*file]))
        .collect();
    let parts = parts(path, &placed)?;
    let whole @ [width, height] = request.size.or(scene.size).unwrap_or([1024, 1024]);
    crate::render::picture::check_size(width, height)?;
    if let Some(section) = request.section {
        check_section(path, section, &parts)?;
    }
    let title = outputs.title_of(path, |direction| support(&parts, direction));
    let legend = outputs.legend.then(|| legend(&scene, &files, is_scene(path))).transpose()?;
    let frame = Frame::new(whole, ground(&scene), title, legend);
    let begin = request.point.or(scene.camera.view.map(ViewPoint::Named));
    let mut report = SceneReport {
        width,
        height,
        threads: request.threads.max(1),
        models: parts.len(),
        files: files.models.len(),
        depth_near_mm: f64::INFINITY,
        ..SceneReport::default()
    };
    shots::write(outputs.shots, layers, &frame, begin, progress, |shot, seen, progress| {
        let request =
            SceneRequest { size: Some(shot.size), point: shot.point.or(request.point), ..request.clone() };
        let (painted, (near, far)) = one((path, &scene, &parts), &request, outputs, progress)?;
        let Painted { image, rays, seen: own, traced } = painted;
        for (model, path) in files.models.iter().zip(&files.paths) {
            model.check_unchanged(path)?;
        }
        seen.extend(own);
        report.count(rays);
        report.trace_s += traced.as_secs_f64();
        report.depth_near_mm = report.depth_near_mm.min(near);
        report.depth_far_mm = report.depth_far_mm.max(far);
        Ok(image)
    })?;
    report.bytes_touched = files.bytes_touched();
    report.wall_s = start.elapsed().as_secs_f64();
    report.setup_s = (report.wall_s - report.trace_s).max(0.0);
    #[expect(clippy::cast_precision_loss, reason = "a rate")]
    let rays = report.rays as f64;
    report.rays_per_s = rays / report.trace_s.max(1e-9);
    Ok(report)
}

/// One picture of the size that is asked for, with its scale bar; and the depths of what it shows, in mm.
fn one(
    (path, scene, parts): (&Path, &Scene, &[Part<'_>]),
    request: &SceneRequest,
    outputs: &Outputs<'_>,
    progress: &dyn Progress,
) -> Result<(Painted, (f64, f64)), Error> {
    let [width, height] = request.size.unwrap_or_default();
    let style = Style::of([width, height], ground(scene)).filter(|_| request.annotate);
    let size = [width, height - style.map_or(0, Style::bar_rows)];
    let look = look(path, scene, parts, &SceneRequest { size: Some(size), ..request.clone() }, outputs)?;
    progress.stage("render", look.height.into());
    let rows_done = |rows: u32| progress.advance(rows.into());
    let mut painted = match request.section {
        Some(section) => scene::slice(parts, &look, section, &rows_done)?,
        None => scene::paint(parts, &look, &rows_done)?,
    };
    let (near, far) = look.camera.depth_range_mm(|direction| support(parts, direction));
    if let Some(style) = style {
        let bar = style.bar(&painted.image, &look.camera, (look.height, (near + far) / 2.0));
        painted.image.append(&bar);
    }
    Ok((painted, (near, far)))
}

/// The background of a scene, as it is stored in pictures.
fn ground(scene: &Scene) -> Option<[u8; 3]> {
    scene.background.map(|color| color.map(|c| Shader::new().encode(c)))
}

/// A slice of one model into memory, with title and legend as `outputs` says, whose `image` is the model's path.
///
/// # Errors
/// The plane does not meet the model, or the model has no labels for a legend.
#[cfg(feature = "python")]
pub(crate) fn sliced<D: AsRef<[u8]>>(
    model: &Model<D>,
    outputs: &Outputs<'_>,
    request: &SceneRequest,
    progress: &dyn Progress,
) -> Result<Image, Error> {
    let path = outputs.image;
    let [width, height] = request.size.unwrap_or_default();
    crate::render::picture::check_size(width, height)?;
    let mut scene = scene_of(path, request);
    scene.background = request.background.map(linear_of);
    let view = model.view();
    let placed: Vec<_> = scene.models.iter().map(|placed| (placed, model, (&view, 0), path)).collect();
    let parts = parts(path, &placed)?;
    if let Some(section) = request.section {
        check_section(path, section, &parts)?;
    }
    let labels = &model.frame().labels;
    if outputs.legend && labels.is_empty() {
        return Err(UsageError::NoLegend { path: path.to_path_buf() }.into());
    }
    let title = outputs.title_of(path, |direction| support(&parts, direction));
    let legend = outputs.legend.then(|| label_entries(0, labels.iter()));
    let frame = Frame::new([width, height], ground(&scene), title, legend);
    let request = SceneRequest { size: Some(frame.inner()), ..request.clone() };
    let (painted, _) = one((path, &scene, &parts), &request, outputs, progress)?;
    Ok(frame.around(painted.image, Some(&painted.seen)))
}

/// A plane that meets nothing is refused.
fn check_section(path: &Path, section: Section, parts: &[Part<'_>]) -> Result<(), UsageError> {
    let mut normal = [0.0; 3];
    normal[section.axis] = 1.0;
    let (from_mm, to_mm) = (-support(parts, normal.map(|c: f64| -c)), support(parts, normal));
    if (from_mm..=to_mm).contains(&section.at_mm) {
        return Ok(());
    }
    let axis = ['x', 'y', 'z'][section.axis];
    Err(UsageError::Section { path: path.to_path_buf(), axis, from_mm, to_mm })
}

/// Lines for the labels of all models, and for models without labels.
fn legend(scene: &Scene, files: &Files, is_scene: bool) -> Result<Vec<(Seen, Entry)>, UsageError> {
    let mut entries = Vec::new();
    let shader = Shader::new();
    for (number, (placed, file)) in scene.models.iter().zip(&files.of).enumerate() {
        let (Some(model), Some(path)) = (files.models.get(*file), files.paths.get(*file)) else { continue };
        let labels = &model.frame().labels;
        if !labels.is_empty() {
            let is_hidden = |label: &Label| {
                let rule = placed.labels.iter().rev().find(|rule| rule.labels.contains(label));
                rule.is_some_and(|rule| rule.opacity <= 0.0)
            };
            entries.extend(label_entries(number, labels.iter().filter(|label| !is_hidden(label))));
        } else if is_scene {
            let name = shown(path.file_stem().unwrap_or_default()).to_string();
            let color = placed.material.color.map(|c| shader.encode(c));
            let plain = format!("model {}", number + 1);
            entries.push(((number, 0), Entry { color, name, plain }));
        } else {
            return Err(UsageError::NoLegend { path: path.clone() });
        }
    }
    Ok(entries)
}

/// A size that a scene states is a fault of the scene.
fn check_size(path: &Path, width: u32, height: u32) -> Result<(), Error> {
    crate::render::picture::check_size(width, height).map_err(|error| match *error.fault() {
        RenderFault::Size { width, height, most_side, most_pixels } => {
            let fault = SceneFault::Size { width, height, most_side, most_pixels };
            SceneError { path: path.to_path_buf(), fault }.into()
        }
        _ => error.into(),
    })
}

impl SceneReport {
    fn count(&mut self, rays: Rays) {
        self.rays += rays.primary;
        self.hits += rays.hits;
        self.shadow_rays += rays.shadow;
        self.mirrored_rays += rays.mirrored;
        self.refracted_rays += rays.refracted;
        self.ambient_rays += rays.ambient;
    }
}

/// A model as a scene has it, its file, what is read of that with its number, and its path.
type Placed<'a, D> = (&'a SceneModel, &'a Model<D>, (&'a ModelView<'a>, usize), &'a Path);

/// The models in their places.
fn parts<'a, D: AsRef<[u8]>>(path: &Path, scene: &[Placed<'a, D>]) -> Result<Vec<Part<'a>>, Error> {
    let mut parts = Vec::with_capacity(scene.len());
    for (number, (placed, model, view, file)) in (1..).zip(scene.iter().copied()) {
        let affine = model.affine();
        let half = model.dims().to_array().map(|side| (f64::from(side) - 1.0) / 2.0);
        let placement = placed.place.affine(affine.apply(half));
        let (material, clip) = (placed.material, placed.clip.clone());
        let key = |name| Key { table: Table::Model(number), name };
        let wrong = |fault| SceneError { path: path.to_path_buf(), fault };
        let opacity = opacity(model, file, placed)?;
        // By itself a model is shown in its colours, and everywhere in those of its labels.
        let shown = match placed.coloring {
            Coloring::Own if opacity.is_some() || !is_scene(path) => &Coloring::Stored,
            _ => &placed.coloring,
        };
        let colors = Colors::of(model, shown);
        if let (None, Some(channel)) = (&colors, placed.coloring.channel()) {
            return Err(wrong(SceneFault::NoChannel { key: key("material"), channel }).into());
        }
        let part = Part::new(view, model.dims(), &affine, &placement, material, clip)
            .map_err(|_| wrong(SceneFault::Flat { key: key("scale") }))?;
        parts.push(part.colored(colors).labelled(opacity));
    }
    Ok(parts)
}

/// A picture of one model in memory, by the request's camera, of the labels that are seen.
///
/// # Errors
/// The camera makes no sense, or there is no such label.
pub(super) fn picture_of(path: &Path, model: &Model, request: &SceneRequest) -> Result<Image, Error> {
    let (scene, view) = (scene_at(path, request)?, model.view());
    let placed: Vec<Placed<'_, _>> =
        scene.models.iter().map(|placed| (placed, model, (&view, 0), path)).collect();
    let parts = parts(path, &placed)?;
    let look = look(path, &scene, &parts, request, &plain(path))?;
    Ok(scene::paint(&parts, &look, &|_| {})?.image)
}

/// A scene held open, for pictures from many sides.
pub(super) struct OpenScene {
    path: PathBuf,
    scene: Scene,
    files: Files,
}

impl OpenScene {
    pub(super) fn open(path: &Path) -> Result<Self, Error> {
        let scene = read_scene(path)?;
        let files = Files::open(path, &scene)?;
        Ok(Self { path: path.to_path_buf(), scene, files })
    }

    fn with<T>(&self, job: impl FnOnce(&[Part<'_>]) -> Result<T, Error>) -> Result<T, Error> {
        let files = &self.files;
        let views: Vec<ModelView<'_>> = files.models.iter().map(Model::view).collect();
        let models = self.scene.models.iter().zip(&files.of);
        let placed: Vec<_> = models
            .map(|(placed, file)| {
                (placed, &files.models[*file], (&views[*file], *file), &*files.paths[*file])
            })
            .collect();
        job(&parts(&self.path, &placed)?)
    }

    /// Least and greatest corner of all that is in it, in LPS mm.
    pub(super) fn extent(&self) -> Result<[[f64; 3]; 2], Error> {
        self.with(|parts| {
            let reach = |axis: usize, sign: f64| {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                sign * support(parts, direction)
            };
            Ok([-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign))))
        })
    }

    /// Its own view, as pages write theirs; empty without one.
    pub(super) fn start(&self) -> String {
        let own = &self.scene.camera;
        let text = |v: [f64; 3]| format!("{},{},{}", v[0], v[1], v[2]);
        let perspective = if own.projection == Some(Projection::Perspective) { "&p=1" } else { "" };
        match (own.eye, own.view) {
            (Some([eye, look_at]), _) => {
                let forward: [f64; 3] = std::array::from_fn(|a| look_at[a] - eye[a]);
                let up = text(own.up.unwrap_or([0.0, 0.0, 1.0]));
                let fov = own.fov_deg.unwrap_or(super::render::RenderRequest::FOV_DEG).to_radians();
                let half = forward.iter().map(|c| c * c).sum::<f64>().sqrt() * (fov / 2.0).tan();
                format!("f={}&u={up}&t={}&h={half}{perspective}", text(forward), text(look_at))
            }
            (None, Some(view)) => format!("v={}{perspective}", view.name()),
            (None, None) => perspective.trim_start_matches('&').to_owned(),
        }
    }

    /// Its picture, by the request's camera or its own.
    pub(super) fn picture(&self, request: &SceneRequest) -> Result<Image, Error> {
        let image = self.with(|parts| {
            let look = look(&self.path, &self.scene, parts, request, &plain(&self.path))?;
            Ok(scene::paint(parts, &look, &|_| {})?.image)
        })?;
        for (model, path) in self.files.models.iter().zip(&self.files.paths) {
            model.check_unchanged(path)?;
        }
        Ok(image)
    }
}

/// One picture, and nothing around it.
fn plain(path: &Path) -> Outputs<'_> {
    Outputs {
        image: path,
        depth: None,
        normals: None,
        ids: None,
        shots: Shots::One,
        title: None,
        legend: false,
    }
}

/// What the labels of a model let through; `None` of one without labels.
fn opacity<'a, D: AsRef<[u8]>>(
    model: &'a Model<D>,
    path: &Path,
    placed: &SceneModel,
) -> Result<Option<Opacity<'a>>, UsageError> {
    match model.view().labels() {
        None if placed.labels.is_empty() => Ok(None),
        None => Err(UsageError::Unlabelled { path: path.to_path_buf() }),
        Some(labels) => match Opacity::of(&placed.labels, labels, &model.frame().labels) {
            Ok(opacity) => Ok(Some(opacity)),
            Err(label) => Err(UsageError::NoLabel { path: path.to_path_buf(), label: label.to_string() }),
        },
    }
}

/// Camera and light, by the scene and the command line.
fn look(
    path: &Path,
    scene: &Scene,
    parts: &[Part<'_>],
    request: &SceneRequest,
    outputs: &Outputs<'_>,
) -> Result<Look, Error> {
    let [width, height] = request.size.or(scene.size).unwrap_or([1024, 1024]);
    let own = &scene.camera;
    let of_scene = match (own.eye, own.view) {
        (Some([eye, look_at]), _) => Some(ViewPoint::Free { eye, look_at, up: own.up }),
        (None, view) => view.map(ViewPoint::Named),
    };
    let slice = request.section.map(|section| ViewPoint::Named(section.view()));
    let point = slice.or(request.point).or(of_scene).unwrap_or(ViewPoint::Named(NamedView::Front));
    let framed: Vec<_> = parts.iter().zip(&scene.models).filter(|(_, model)| model.framed).collect();
    let frame = |direction| {
        let framed = framed.iter().map(|(part, _)| part.support(direction));
        let most = framed.fold(f64::NEG_INFINITY, f64::max);
        if most.is_finite() { most } else { support(parts, direction) }
    };
    let projection = match request.section {
        Some(_) => Projection::Parallel,
        None => request.projection.or(own.projection).unwrap_or_default(),
    };
    let fov = request.fov_deg.or(own.fov_deg).unwrap_or(super::render::RenderRequest::FOV_DEG);
    let aspect = f64::from(width) / f64::from(height);
    let camera = Camera::new(point, projection, fov, aspect, frame)
        .and_then(|camera| camera.zoomed(request.zoom.unwrap_or(1.0)))
        .map_err(|error| match *error.fault() {
            // A fault of the command line is reported as elsewhere.
            RenderFault::Camera(fault) if request.point.is_none() && request.fov_deg.is_none() => {
                Error::Scene(SceneError { path: path.to_path_buf(), fault: SceneFault::Camera(fault) })
            }
            _ => error.into(),
        })?;
    let mut ambient = scene.ambient;
    ambient.rays = request.ambient_rays.unwrap_or(ambient.rays);
    Ok(Look {
        width,
        height,
        near_mm: own.near_mm,
        lights: scene.lights.clone(),
        ambient,
        background: scene.background,
        bounces: scene.bounces,
        samples: scene.samples,
        threads: request.threads,
        depth_range_mm: outputs.depth.map(|_| camera.depth_range_mm(|direction| support(parts, direction))),
        normals: outputs.normals.is_some(),
        camera,
    })
}

/// Greatest `direction . p` over the points p of all models, in mm.
fn support(parts: &[Part<'_>], direction: [f64; 3]) -> f64 {
    parts.iter().map(|part| part.support(direction)).fold(f64::NEG_INFINITY, f64::max)
}
