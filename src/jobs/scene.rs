//! Models on disk in their places: a scene of several, or a single one.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::frame::label_entries;
use super::open_model::open_model;
use super::picture_memory::PictureMemory;
use super::render::{Bodies, RenderReport, RenderRequest, paint_whole};
use crate::budget::mapped_rss_bytes;
use crate::error::Error;
use crate::fault::{Fault, bad, usage};
use crate::format::Label;
use crate::load::{LoadError, LoadFault, Model, ModelView};
use crate::platform::PositionalFile;
use crate::progress::{Progress, Silent};
use crate::render::annotate::{Entry, Ramp};
use crate::render::shade::Shader;
use crate::render::{Image, Projection, RenderFault, ViewPoint};
use crate::scene::{
    self, Coloring, Colors, Instance, Key, MAX_BYTES, Opacity, Scene, SceneError, SceneModel, Seen, Table,
};
pub(crate) use crate::scene::{LabelPick, LabelRule, Section};
use crate::text::names::{INFO, LABELS, LEGEND, SECTION};
use crate::text::{Short, nearest, shown};

/// True if a file's name says that it is the text of a scene, not a model.
pub fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("toml"))
}

/// Reads the text of a scene.
///
/// # Errors
/// The file cannot be read, or [`Error::Scene`] with the fault in it.
pub fn read_scene(path: &Path) -> Result<Scene, Error> {
    let unreadable =
        |cause| Error::Load(LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause }));
    let wrong = |fault| Error::Scene(SceneError { path: path.to_path_buf(), fault });
    let file = PositionalFile::open(path).map_err(unreadable)?;
    let bytes = file.metadata().map_err(unreadable)?.len();
    if bytes > MAX_BYTES {
        return Err(wrong(bad!("{bytes} bytes are too long for a scene; write at most {MAX_BYTES}")));
    }
    let mut text = Vec::new();
    file.onwards(0).take(MAX_BYTES).read_to_end(&mut text).map_err(unreadable)?;
    let text =
        String::from_utf8(text).map_err(|_| wrong(bad!("is not text; a scene is a TOML file in UTF-8")))?;
    scene::read(&text).map_err(wrong)
}

/// The scene of a single model.
fn alone(path: &Path) -> Scene {
    Scene::of_model(PathBuf::from(path.file_name().unwrap_or(path.as_os_str())))
}

/// A plane that meets nothing is refused.
fn check_section(path: &Path, section: Section, bodies: &Bodies<'_>) -> Result<(), Fault> {
    let mut normal = [0.0; 3];
    normal[section.axis] = 1.0;
    let reach = |direction| bodies.support_of_visible(direction);
    let (from_mm, to_mm) = (-reach(normal.map(|c: f64| -c)), reach(normal));
    if (from_mm..=to_mm).contains(&section.at_mm) {
        return Ok(());
    }
    let axis = ['x', 'y', 'z'][section.axis];
    let (from_mm, to_mm) = (Short(from_mm), Short(to_mm));
    Err(usage!("the plane does not intersect what is shown; choose {SECTION} with {axis} from {from_mm} to {to_mm} mm")
        .at(path))
}

/// Lines for the labels of all models, and for models without labels.
fn legend<D: AsRef<[u8]>>(
    path: &Path,
    models: &[Placed<'_, D>],
    request: &RenderRequest,
) -> Result<Vec<(Seen, Entry)>, Fault> {
    let mut entries = Vec::new();
    let shader = Shader::new();
    for (number, (placed, model, _, file)) in models.iter().enumerate() {
        let labels = &model.frame().labels;
        if !labels.is_empty() {
            let rules = rules_of(placed, request, labels);
            let is_hidden = |label: &Label| {
                let rule = rules.iter().rev().find(|rule| rule.labels.contains(label));
                rule.is_some_and(|rule| rule.opacity <= 0.0)
            };
            entries.extend(label_entries(number, labels.iter().filter(|label| !is_hidden(label))));
        } else if is_scene(path) {
            let name = shown(file.file_stem().unwrap_or_default()).to_string();
            let color = placed.material.color.map(|c| shader.encode(c));
            let plain = format!("model {}", number + 1);
            entries.push(((number, 0), Entry { color, name, plain }));
        } else {
            let fault =
                usage!("has no labels to list; leave out {LEGEND}, or build a map of labels with {LABELS}");
            return Err(fault.at(file));
        }
    }
    Ok(entries)
}

/// The rules on labels of a model: its own, and the request's for its labels.
fn rules_of(placed: &SceneModel, request: &RenderRequest, table: &[Label]) -> Vec<LabelRule> {
    let names_one = |rule: &&LabelRule| table.iter().any(|label| rule.labels.contains(label));
    placed.labels.iter().chain(request.labels.iter().filter(names_one)).cloned().collect()
}

/// A model of a scene, its file, its view with the file's number, and its path.
type Placed<'a, D> = (&'a SceneModel, &'a Model<D>, (&'a ModelView<'a>, usize), &'a Path);

/// The models in their places.
fn parts<'a, D: AsRef<[u8]>>(
    path: &Path,
    models: &[Placed<'a, D>],
    request: &RenderRequest,
) -> Result<Vec<Instance<'a>>, Error> {
    let tables =
        || models.iter().map(|(_, model, ..)| &*model.frame().labels).filter(|table| !table.is_empty());
    let is_idle = |rule: &&LabelRule| !tables().flatten().any(|label| rule.labels.contains(label));
    if let Some(rule) = request.labels.iter().find(is_idle) {
        let mut known = tables().flatten().peekable();
        let is_unlabelled = known.peek().is_none();
        return Err(if is_unlabelled { unlabelled(path) } else { no_label(&rule.labels, known, path) }.into());
    }
    let mut parts = Vec::with_capacity(models.len());
    for (number, (placed, model, view, file)) in (1..).zip(models.iter().copied()) {
        let affine = model.affine();
        let half = model.dims().to_array().map(|side| (f64::from(side) - 1.0) / 2.0);
        let placement = placed.place.affine(affine.apply(half));
        let (material, clip) = (placed.material, placed.clip.clone());
        let key = |name| Key { table: Table::Model(number), name };
        let wrong = |fault| SceneError { path: path.to_path_buf(), fault };
        let opacity = opacity(model, file, placed, request)?;
        // A single model is shown in its colours, and models everywhere in the colours of their labels.
        let shown = match placed.coloring {
            Coloring::Own if opacity.is_some() || !is_scene(path) || view.0.value_colors().is_some() => {
                &Coloring::Stored
            }
            _ => &placed.coloring,
        };
        let colors = Colors::of(model, shown);
        if let (None, Some(channel)) = (&colors, placed.coloring.channel()) {
            return Err(wrong(bad!("{}: takes its colour from the channel {}, which the model lacks; build the model with it, or choose another material", key("material"), channel.name())).into());
        }
        let part =
            Instance::new(view, model.dims(), &affine, &placement, material, clip).map_err(|error| {
                if is_scene(path) { wrong(scene::flat(&key("scale"))).into() } else { Error::from(error) }
            })?;
        parts.push(part.colored(colors).labelled(opacity));
    }
    Ok(parts)
}

/// The colours of the first model that shows measured values.
fn ramp<D: AsRef<[u8]>>(models: &[Placed<'_, D>], parts: &[Instance<'_>]) -> Option<Ramp> {
    let ((_, model, ..), part) = models.iter().zip(parts).find(|(_, part)| part.shows_values())?;
    Some(Ramp::new(model.frame().quantity.as_ref()?, *part.view.value_colors()?))
}

/// Calls `job` with the models in their places; refuses an impossible size, and a slice that meets nothing.
fn with_bodies<D: AsRef<[u8]>, T>(
    path: &Path,
    scene: &Scene,
    models: &[Placed<'_, D>],
    (request, has_legend): (&RenderRequest, bool),
    job: impl FnOnce(&Bodies<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    let parts = parts(path, models, request)?;
    let ramp = ramp(models, &parts);
    if ramp.is_none() && (request.value_map.is_some() || request.value_range.is_some()) {
        return Err(usage!("no measured values are shown, so there are no colours to choose; `oct compare -o` and `oct thickness -o` write models that have them").at(path).into());
    }
    let ramp = ramp.filter(|_| has_legend);
    let legend = (has_legend && ramp.is_none()).then(|| legend(path, models, request)).transpose()?;
    let is_patient = models.iter().all(|(_, model, ..)| model.metadata().source.is_patient());
    let bodies = Bodies { parts: &parts, scene, legend, ramp, is_patient };
    let [width, height] = bodies.size(request);
    let of_scene = is_scene(path);
    crate::render::picture::check_size(width, height).map_err(|error| match *error.fault() {
        RenderFault::Size { width, height, most_side, most_pixels } if of_scene && request.size.is_none() => {
            let fault = bad!("size: a picture of {width}x{height} is not possible; choose sides of 1 to {most_side} and at most {most_pixels} pixels");
            SceneError { path: path.to_path_buf(), fault }.into()
        }
        _ => Error::from(error),
    })?;
    if let Some(section) = request.section {
        check_section(path, section, &bodies)?;
    }
    job(&bodies).map_err(|error| match error {
        // An error of the command line is reported as elsewhere.
        Error::Render(error) if of_scene && request.point.is_none() && request.fov_deg.is_none() => {
            match error.fault() {
                RenderFault::Camera(fault) => {
                    let fault = bad!("[camera]: {fault}");
                    Error::Scene(SceneError { path: path.to_path_buf(), fault })
                }
                _ => error.into(),
            }
        }
        other => other,
    })
}

/// [`with_bodies`] for one model in memory; `path` is its name in sentences.
pub(super) fn with_model<D: AsRef<[u8]>, T>(
    path: &Path,
    model: &Model<D>,
    (request, has_legend): (&RenderRequest, bool),
    job: impl FnOnce(&Bodies<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    let scene = alone(path).shown_as(request.color, request.clip_mm);
    let view = model.view_in_colors(request.value_map, request.value_range);
    let placed: Vec<Placed<'_, D>> =
        scene.models.iter().map(|placed| (placed, model, (&view, 0), path)).collect();
    with_bodies(path, &scene, &placed, (request, has_legend), job)
}

/// A picture of one model in memory; `path` is its name in sentences.
///
/// # Errors
/// The camera makes no sense, or there is no such label.
pub(crate) fn picture_of<D: AsRef<[u8]>>(
    path: &Path,
    model: &Model<D>,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<(Image, RenderReport), Error> {
    with_model(path, model, (request, false), |bodies| {
        let (image, report, _) = paint_whole(bodies, request, progress, &PictureMemory::none())?;
        Ok((image, report))
    })
}

/// The grid of a model in memory, and the camera of its picture.
///
/// # Errors
/// The camera makes no sense.
#[cfg(feature = "python")]
pub(crate) fn camera_of<D: AsRef<[u8]>>(
    model: &Model<D>,
    request: &RenderRequest,
) -> Result<(crate::render::GridSpace, crate::render::Camera), Error> {
    with_model(Path::new(""), model, (request, false), |bodies| {
        let request = RenderRequest { annotate: false, ..request.clone() };
        let camera = super::render::Prepared::new(bodies, &request, &PictureMemory::none())?.look.camera;
        let space = bodies.parts.first().map(|part| part.space.clone()).ok_or(Error::Internal)?;
        Ok((space, camera))
    })
}

/// A scene, or a single model, with its files open.
pub(super) struct OpenScene {
    path: PathBuf,
    scene: Scene,
    /// Paths of the files, each once.
    paths: Vec<PathBuf>,
    models: Vec<Model>,
    /// Index of the file of each model of the scene.
    file_of: Vec<usize>,
}

impl OpenScene {
    /// Opens a scene or a model, with the colour and cut of a request.
    pub(super) fn open(path: &Path, request: &RenderRequest) -> Result<Self, Error> {
        let scene = if is_scene(path) { read_scene(path)? } else { alone(path) };
        let scene = scene.shown_as(request.color, request.clip_mm);
        let folder = path.parent().unwrap_or(Path::new(""));
        let (mut known, mut paths, mut models, mut file_of) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (number, model) in (1..).zip(&scene.models) {
            let file = folder.join(&model.file);
            // Two names of one file are one file.
            let real = file.canonicalize().unwrap_or_else(|_| file.clone());
            if let Some(at) = known.iter().position(|other| *other == real) {
                file_of.push(at);
                continue;
            }
            models.push(open_model(&file).map_err(|error| match error {
                Error::Load(cause) if is_scene(path) => {
                    let key = Key { table: Table::Model(number), name: "file" };
                    Error::Scene(SceneError { path: path.to_path_buf(), fault: bad!("{key}: {cause}") })
                }
                other => other,
            })?);
            file_of.push(paths.len());
            paths.push(file);
            known.push(real);
        }
        Ok(Self { path: path.to_path_buf(), scene, paths, models, file_of })
    }

    /// Paths of the models' files.
    pub(super) fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Bytes of all files.
    pub(super) fn bytes(&self) -> u64 {
        self.models.iter().map(|model| model.bytes().len() as u64).sum()
    }

    /// Bytes of the files that are in memory.
    pub(super) fn bytes_touched(&self) -> Option<u64> {
        self.models.iter().map(|model| mapped_rss_bytes(model.bytes())).sum()
    }

    /// Gives the pages of all files back to the system.
    pub(super) fn give_back(&self) {
        self.models.iter().for_each(Model::give_back);
    }

    /// # Errors
    /// A file was changed since it was opened.
    pub(super) fn check_unchanged(&self) -> Result<(), Error> {
        let mut files = self.models.iter().zip(&self.paths);
        Ok(files.try_for_each(|(model, path)| model.check_unchanged(path))?)
    }

    /// First view of a turntable.
    pub(super) fn view(&self) -> Option<ViewPoint> {
        self.scene.camera.view.map(ViewPoint::Named)
    }

    /// Calls `work` with the models in their places, and a legend of them if that is wanted.
    pub(super) fn with<T>(
        &self,
        wanted: (&RenderRequest, bool),
        job: impl FnOnce(&Bodies<'_>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let (map, range) = (wanted.0.value_map, wanted.0.value_range);
        let views: Vec<_> = self.models.iter().map(|model| model.view_in_colors(map, range)).collect();
        let of_file = |(placed, file): (_, &usize)| {
            (placed, &self.models[*file], (&views[*file], *file), &*self.paths[*file])
        };
        let placed: Vec<_> = self.scene.models.iter().zip(&self.file_of).map(of_file).collect();
        with_bodies(&self.path, &self.scene, &placed, wanted, job)
    }

    /// Least and greatest corner of all models, in LPS mm.
    pub(super) fn extent(&self) -> Result<[[f64; 3]; 2], Error> {
        self.with((&RenderRequest::default(), false), |bodies| {
            let reach = |axis: usize, sign: f64| {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                sign * bodies.support(direction)
            };
            Ok([-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign))))
        })
    }

    /// Its own view, in the form that pages write; empty without one.
    pub(super) fn start(&self) -> String {
        let own = &self.scene.camera;
        let text = |v: [f64; 3]| format!("{},{},{}", v[0], v[1], v[2]);
        let perspective = if own.projection == Some(Projection::Perspective) { "&p=1" } else { "" };
        match (own.eye, own.view) {
            (Some([eye, look_at]), _) => {
                let forward: [f64; 3] = std::array::from_fn(|a| look_at[a] - eye[a]);
                let up = text(own.up.unwrap_or([0.0, 0.0, 1.0]));
                let fov = own.fov_deg.unwrap_or(RenderRequest::FOV_DEG).to_radians();
                let half = forward.iter().map(|c| c * c).sum::<f64>().sqrt() * (fov / 2.0).tan();
                format!("f={}&u={up}&t={}&h={half}{perspective}", text(forward), text(look_at))
            }
            (None, Some(view)) => format!("v={}{perspective}", view.name()),
            (None, None) => perspective.trim_start_matches('&').to_owned(),
        }
    }

    /// Its picture, by the request's camera or its own.
    pub(super) fn picture(&self, request: &RenderRequest) -> Result<Image, Error> {
        let image = self.with((request, false), |bodies| {
            Ok(paint_whole(bodies, request, &Silent, &PictureMemory::none())?.0)
        })?;
        self.check_unchanged()?;
        Ok(image)
    }
}

pub(super) fn unlabelled(path: &Path) -> Fault {
    usage!("has no labels to choose from; build a map of labels with {LABELS}").at(path)
}

pub(super) fn no_label<'t>(
    pick: &LabelPick,
    table: impl IntoIterator<Item = &'t Label>,
    path: &Path,
) -> Fault {
    let near = match pick {
        LabelPick::Name(name) => nearest(name, table.into_iter().map(|label| (&*label.name, &*label.name))),
        _ => None,
    };
    let meant = near.map_or_else(String::new, |name| format!("; did you mean '{}'?", shown(name)));
    usage!("has no label {pick}{meant}; {INFO} lists the labels of a model").at(path)
}

/// The light that the labels of a model stop; `None` for one without labels.
fn opacity<'a, D: AsRef<[u8]>>(
    model: &'a Model<D>,
    path: &Path,
    placed: &SceneModel,
    request: &RenderRequest,
) -> Result<Option<Opacity<'a>>, Fault> {
    match model.view().labels() {
        None if placed.labels.is_empty() => Ok(None),
        None => Err(unlabelled(path)),
        Some(labels) => {
            let table = &model.frame().labels;
            Opacity::of(&rules_of(placed, request, table), labels, table)
                .map(Some)
                .map_err(|pick| no_label(pick, table, path))
        }
    }
}
