//! `oct export`: a model as triangles, points or a mask, in files that other programs read, or as a page.

mod labels;

pub(super) use labels::with_labels;
pub use labels::{LabelSurface, export_each};

use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::info::has_values;
use super::open_model::open_model;
use super::render::RenderRequest;
use super::scene::picture_of;
use super::verify::{verify_file, verify_unless_packed};
use crate::atomic::AtomicFile;
use crate::budget::{Bytes, peak_rss_bytes};
use crate::builder::Tolerance;
use crate::error::{Error, keeps_part};
use crate::export::{ExportFault, ExportForm, ExportStop, Exported, Exporter, Mesh};
use crate::fault::{Fault, usage};
use crate::geom::{Affine, Dims};
use crate::load::{Model, ModelView, verify};
use crate::page::{self, Shown, Transport};
use crate::progress::Progress;
use crate::render::GridSpace;
use crate::scene::LabelRule;
use crate::text::names::{
    EACH, ERROR, FILL_CAVITIES, FORM, KEEP_LARGEST, LABELS, OUTPUT, SMOOTH, TRIANGLES, VIEW,
};
use crate::text::{Count, Rounded, Short, data, shown};

pub use crate::builder::MAX_SMOOTH;

/// Kind of file, and its options.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportRequest<'a> {
    /// Kind of file.
    pub form: ExportForm,
    /// True to set only the skin in a mask, not the voxels that it encloses.
    pub skin_only: bool,
    /// Corners are removed while the surface stays this close to the full one, as measured: at corners and middles of
    /// its triangles, and half a voxel apart on the new ones.
    pub error: Option<Tolerance>,
    /// Number of triangles to reduce the surface to, by removing and moving corners; with `error` until either is
    /// reached. With labels, the total of all.
    pub triangles: Option<u64>,
    /// Limit in voxels along each axis to which walls of labels are smoothed away from the voxels' sides, 0 to
    /// [`MAX_SMOOTH`], the default. At 0 they are the voxels' sides, and volumes are exact.
    pub smooth: Option<f64>,
    /// Labels that are left out: those that stop no light by these rules. The surfaces of others are as without rules.
    pub labels: &'a [LabelRule],
}

impl ExportRequest<'_> {
    /// All of a form.
    pub fn of(form: ExportForm) -> Self {
        Self { form, skin_only: false, error: None, triangles: None, smooth: None, labels: &[] }
    }

    /// True if the result depends on the inside, not on the skin alone.
    fn needs_inside(&self) -> bool {
        self.form.has_triangles() || self.form.is_mask() && !self.skin_only
    }
}

/// Figures of a written file.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ExportReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Output as named on the command line.
    pub output: String,
    /// Kind of file.
    pub form: ExportForm,
    /// Corners of triangles, or points.
    pub vertices: u64,
    /// Triangles written.
    pub triangles: u64,
    /// Triangles before they were made fewer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fine_triangles: Option<u64>,
    /// Greatest distance in mm between the written surface and the fine triangles, as measured up to some 8 million of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_mm: Option<f64>,
    /// Place of that distance, in LPS mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_at_mm: Option<[f32; 3]>,
    /// Bound of that distance: the error, or the known bound where it was not measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within_mm: Option<f64>,
    /// Root mean square distance in mm of the fine surface from the written one, at up to 20,000 of its corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_mm: Option<f64>,
    /// For triangles, true where each edge has as many on one side as on the other, of labels in the surface of each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed: Option<bool>,
    /// Separate bodies that a closed surface encloses; they are not counted for labels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub separate_bodies: Option<u64>,
    /// Cavities that a closed surface encloses within its bodies; they are not counted for labels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cavities: Option<u64>,
    /// Separate parts of the surface, the smallest ones, that were left out to reach a number of triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parts_gone: Option<u64>,
    /// Voxels set in a mask; 0 for other forms.
    pub inside_voxels: u64,
    /// Enclosed voxels whose normals do not tell inside from outside; written as the likelier, as inside without
    /// normals.
    pub unknown_voxels: u64,
    /// The surface of each label; empty for other models.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<LabelSurface>,
    /// True if the surface enclosed one body before triangles were made fewer.
    #[serde(skip)]
    pub was_one: bool,
    /// True for a model of a volume, whose build can leave out bodies and cavities.
    #[serde(skip)]
    pub is_of_volume: bool,
    /// True if coordinates of 32 bits are too coarse for the place of the model: more than 1/128 of a voxel.
    #[serde(skip)]
    pub is_far: bool,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Greatest distance of larger leaves from the surface, in voxels of the finest spacing; null for a model without
    /// them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub apart_voxels: Option<f64>,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Writes the model at `input` in another form to `output`, in millimetres of the patient's axes (LPS).
///
/// Triangles are a closed surface without holes or edges of more than two triangles; it passes between the samples
/// inside and outside. A model of cells has a surface of subvoxel accuracy, skin voxels one half-way between samples.
/// Larger leaves are taken apart into cells: the surface lies on their planes, as far from the true one as these do.
///
/// Reduction holds the surface in memory, some 260 bytes a triangle, up to 8 million of these (2.1 GB). Larger surfaces
/// are first reduced in slabs of so many triangles, within a part of the error or a quarter of a voxel, and then as a
/// whole. Cost: 5 to 35 microseconds a triangle.
///
/// A model of labels becomes a closed part for each label, with its name and colour where the format has them; where two
/// labels touch, both have the same triangles. As a mask it becomes the map of its labels again.
///
/// Memory: four slices of skin, some bits a box of two slices, and two layers of corners; for voxels 5 bytes more for each
/// separate part of the outside and the inside; the model is mapped. Temporary disk: for PLY and GLB as much as the
/// triangles take, and the unpacked model if it is packed. Cost: the checks of `oct verify`, and one pass over a model of
/// cells, two over voxels.
///
/// Memory for labels: two layers of cells; for STL 12 bytes a corner. Temporary disk: 24 bytes a corner and 12 a
/// triangle. Cost: one pass.
///
/// # Errors
/// The model is damaged, or keeps only what can be seen and its inside is asked for; the format cannot hold it; the
/// output cannot be written. A file at `output` is untouched then.
pub fn export(
    input: &Path,
    output: &Path,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let start = Instant::now();
    let unwritable = |cause| Error::Output { path: output.to_path_buf(), cause };
    refuse_input(input, output)?;
    let form = request.form;
    if !(request.labels.is_empty() || form.has_triangles() || form.is_mask() || form == ExportForm::Html) {
        let fault = usage!(
            "is of the form {}, which holds all labels; some alone are shown by a page in one file (html), or written as triangles or \
             as a mask ({FORM})",
            form.name()
        );
        return Err(fault.at(output).into());
    }
    // A flipped bit could make a closed surface of another solid: all is read anyway, so that all is checked.
    verify_unless_packed(input)?;
    if form.is_page() {
        return export_page(input, output, request, progress);
    }
    let model = open_model(input)?;
    refuse_part(&model, input, request)?;
    if (form.has_triangles() || form.is_mask()) && !model.frame().labels.is_empty() {
        return labels::export_labels(input, output, &model, request, progress);
    }
    if request.smooth.is_some() {
        return Err(one_surface(input).into());
    }
    let out = AtomicFile::create(output).map_err(unwritable)?;
    let made = exported(&model, [input, output], request, |exporter| {
        exporter.write(form, out.file(), folder_of(output), progress)
    })?;
    let bytes = commit(out, output, progress)?;
    Ok(report([input, output], request, &model, (made, bytes, Vec::new()), start))
}

/// Notes on triangles that are fewer than were asked for, or more, and on parts that were left out.
fn shortfalls(request: ExportRequest<'_>, made: &Exported, labels: usize) -> Vec<String> {
    let Exported { triangles, fine_triangles, parts_gone, pieces_gone, .. } = *made;
    let mut notes = Vec::new();
    let each = if labels > 1 { ", as each label keeps 4 at least" } else { "" };
    match request.triangles {
        Some(wanted) if wanted >= fine_triangles => notes.push(format!(
            "the surface has {fine_triangles} triangles, no more than asked for; none was left out"
        )),
        Some(wanted) if request.error.is_none() && triangles > wanted => notes.push(format!(
            "no closed surface of {wanted} triangles was found{each}; {triangles} are the fewest that were tried"
        )),
        _ if request.error.is_some() && triangles == fine_triangles => notes.push(
            "no closed surface of fewer triangles was found within that error; none was left out".to_owned(),
        ),
        _ => {}
    }
    if labels > 1 && triangles < fine_triangles {
        notes.push("each label was reduced by itself, so the walls of two neighbours differ by up to twice the distance".to_owned());
    }
    if pieces_gone > 0 {
        notes.push(format!(
            "left out: {} that came apart from the body at thin bridges, where triangles are few; more triangles keep them",
            Count(pieces_gone, "piece")
        ));
    }
    if let Some(parts_gone @ 1..) = parts_gone {
        notes.push(format!(
            "left out, smallest first, to keep to so few triangles: {} of the surface",
            Count(parts_gone, "separate part")
        ));
    }
    notes
}

/// Gives the finished file its name, unless the job is stopped; returns its size.
pub(super) fn commit(out: AtomicFile, output: &Path, progress: &dyn Progress) -> Result<u64, Error> {
    let unwritable = |cause| Error::Output { path: output.to_path_buf(), cause };
    let bytes = out.file().metadata().map_err(unwritable)?.len();
    if progress.stopped() {
        return Err(Error::Stopped);
    }
    out.commit().map_err(unwritable)?;
    Ok(bytes)
}

/// Counts, bytes, and the surface of each label.
type Written = (Exported, u64, Vec<LabelSurface>);

fn report(
    [input, output]: [&Path; 2],
    request: ExportRequest<'_>,
    model: &Model,
    (made, bytes, surfaces): Written,
    start: Instant,
) -> ExportReport {
    let form = request.form;
    let is_far = form.has_coordinates() && is_far(&model.affine(), model.dims());
    let mut warnings: Vec<String> = unknown_inside(made.unknown).into_iter().collect();
    if is_far {
        warnings.push(
            "the model lies so far from the origin that 32-bit coordinates are off by more than 1/128 of a voxel".into(),
        );
    }
    warnings.extend(shortfalls(request, &made, surfaces.len()));
    ExportReport {
        input: data(input),
        output: data(output),
        form,
        vertices: made.vertices,
        triangles: made.triangles,
        fine_triangles: Some(made.fine_triangles).filter(|count| *count > 0),
        distance_mm: made.distance_mm,
        distance_at_mm: made.distance_at,
        within_mm: made.within_mm,
        closed: made.is_closed,
        rms_mm: made.rms_mm,
        separate_bodies: made.bodies.map(|[bodies, _]| bodies),
        cavities: made.bodies.map(|[_, cavities]| cavities),
        parts_gone: made.parts_gone,
        was_one: made.was_one,
        is_of_volume: has_values(model.metadata()),
        inside_voxels: made.inside,
        unknown_voxels: made.unknown,
        warnings,
        surfaces,
        is_far,
        apart_voxels: model.metadata().error.map(|found| found.most).filter(|_| !form.is_page()),
        bytes,
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    }
}

/// Refuses the inside of a model that keeps only what can be seen, and rules that leave no label.
fn refuse_part<D: AsRef<[u8]>>(
    model: &Model<D>,
    input: &Path,
    request: ExportRequest<'_>,
) -> Result<(), Error> {
    labels::wanted(model, input, request)?;
    if request.needs_inside() {
        refuse_seen(model, input)?;
    }
    Ok(())
}

/// Refuses a model that keeps only what can be seen.
pub(super) fn refuse_seen<D: AsRef<[u8]>>(model: &Model<D>, path: &Path) -> Result<(), Fault> {
    model.metadata().seen_from().map_or(Ok(()), |seen_from| Err(keeps_part(seen_from, path)))
}

/// A model without labels, where surfaces of labels are asked for.
pub(super) fn one_surface(input: &Path) -> Fault {
    usage!("has a single surface and no labels; leave out {EACH} and {SMOOTH}, or build a map of labels with {LABELS}").at(input)
}

/// Refuses an output that is the input.
pub(super) fn refuse_input(input: &Path, output: &Path) -> Result<(), Error> {
    match (input.canonicalize(), output.canonicalize()) {
        (Ok(from), Ok(to)) if from == to => {
            let fault = usage!("is the input, and would be replaced; name another file with {OUTPUT}");
            Err(fault.at(output).into())
        }
        _ => Ok(()),
    }
}

/// The result of `work` with an exporter of the model at `input`.
///
/// # Errors
/// Errors of `work`, and a file that was changed meanwhile.
pub(super) fn exported<T>(
    model: &Model,
    [input, output]: [&Path; 2],
    request: ExportRequest<'_>,
    work: impl FnOnce(&Exporter<'_>) -> Result<T, ExportStop>,
) -> Result<T, Error> {
    let (view, space) = (model.view(), GridSpace::new(model.dims(), &model.affine())?);
    let give_back = || model.give_back();
    let made = work(&exporter_of(model, &view, &space, request, &give_back));
    let made = made.map_err(|stop| failed(stop, model, input, output))?;
    model.check_unchanged(input)?;
    Ok(made)
}

fn exporter_of<'a, D: AsRef<[u8]>>(
    model: &'a Model<D>,
    view: &'a ModelView<'a>,
    space: &'a GridSpace,
    request: ExportRequest<'_>,
    give_back: &'a dyn Fn(),
) -> Exporter<'a> {
    Exporter {
        view,
        dims: model.dims(),
        affine: model.affine(),
        space,
        skin_only: request.skin_only && request.form.is_mask(),
        error_mm: request.error.map(|error| error.mm(model.affine().spacing_mm())).filter(|mm| *mm > 0.0),
        triangles: request.triangles,
        give_back,
    }
}

/// Folder of scratch files: the output's own.
fn folder_of(output: &Path) -> &Path {
    output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The error of a failed export.
pub(super) fn failed(stop: ExportStop, model: &Model, input: &Path, output: &Path) -> Error {
    stopped(stop, [output; 2], || {
        // A full check names the fault.
        let changed = model.check_unchanged(input).map_err(Error::from);
        changed.and_then(|()| verify_file(input)).err().unwrap_or(Error::Internal)
    })
}

/// The error of an export that stopped: of what the format cannot hold at the first path, and of the disk at the second.
fn stopped(stop: ExportStop, [path, output]: [&Path; 2], damage: impl FnOnce() -> Error) -> Error {
    match stop {
        ExportStop::Damaged => damage(),
        ExportStop::Output(cause) => match cause.downcast::<ExportFault>() {
            Ok(fault) => usage!("{fault}").at(path).into(),
            Err(cause) => Error::Output { path: output.to_path_buf(), cause },
        },
        ExportStop::Stopped => Error::Stopped,
    }
}

/// Pixels along a side of the picture that a page shows where it cannot draw the model.
pub(super) const STILL: u32 = 720;

/// The picture of a page, as a PNG of so many pixels a side, of the labels that the rules show.
///
/// # Errors
/// [`RenderError`](crate::render::RenderError).
pub(super) fn still(
    model: &Model,
    side: u32,
    labels: &[LabelRule],
    progress: &dyn Progress,
) -> Result<Vec<u8>, Error> {
    let request =
        RenderRequest { size: Some([side; 2]), labels: labels.to_vec(), ..RenderRequest::default() };
    let (image, _) = picture_of(Path::new(""), model, &request, progress)?;
    let mut png = Vec::new();
    image.write_png_to(&mut png).map_err(|_| Error::Internal)?;
    Ok(png)
}

/// Writes a page that shows the model in a browser.
///
/// # Errors
/// As [`export`], and a model that is too large for one page; a packed one where the page is to fetch it.
fn export_page(
    input: &Path,
    output: &Path,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<ExportReport, Error> {
    let (start, form) = (Instant::now(), request.form);
    let unwritable = |cause| Error::Output { path: output.to_path_buf(), cause };
    let is_linked = form == ExportForm::Linked;
    let model = if is_linked { Model::map(input)? } else { open_model(input)? };
    let labels = model.frame().labels.len();
    // A linked page shows coarse levels of such models.
    if labels > page::MAX_LABELS && !is_linked {
        let fault = usage!(
            "has {labels} labels, and a page holds {}; build it of fewer ({LABELS}), or look at it with {VIEW}",
            page::MAX_LABELS
        );
        return Err(fault.at(input).into());
    }
    let bytes = model.header().file_bytes;
    if bytes > page::MAX_BYTES && !is_linked {
        let fault = usage!(
            "has {}, more than a page in a browser holds ({}); build it on a coarser grid or within a bound ({ERROR}), or look at it with {VIEW}",
            Bytes(bytes),
            Bytes(page::MAX_BYTES)
        );
        return Err(fault.at(input).into());
    }
    let wanted = labels::wanted(&model, input, request)?;
    let hidden = model.frame().labels.iter().zip(wanted).filter(|(_, is_wanted)| !is_wanted);
    let hidden: Vec<u16> = hidden.map(|(label, _)| label.number).collect();
    let picture = still(&model, STILL, request.labels, progress)?;
    let out = AtomicFile::create(output).map_err(unwritable)?;
    let title = output.file_stem().map_or_else(String::new, |stem| data(Path::new(stem)));
    let space = GridSpace::new(model.dims(), &model.affine())?;
    progress.stage("page", 1);
    let name = input.file_name().map(|name| data(Path::new(name)));
    let (what, way) = match form {
        ExportForm::Linked => (Shown::Linked(name.as_deref()), Transport::Linked),
        _ if hidden.is_empty() => (Shown::Model(&model, &space, String::new()), Transport::File),
        _ => (Shown::Model(&model, &space, page::front_of(&model, &space, &hidden)), Transport::File),
    };
    page::write(&what, &title, &picture, way, &mut BufWriter::new(out.file())).map_err(unwritable)?;
    model.check_unchanged(input)?;
    let bytes = commit(out, output, progress)?;
    let written = (Exported::default(), bytes, Vec::new());
    Ok(report([input, output], ExportRequest::of(form), &model, written, start))
}

/// The triangles of a model in memory: the same as [`export`] writes to a PLY file, in the same order.
///
/// Memory: 24 bytes a triangle, beyond what [`export`] takes. Cost: one pass over
/// a model of cells, two over voxels. Its bytes are not verified as they are by [`export`]: [`verify`] does so.
///
/// ```
/// # fn main() -> Result<(), infobyte::Error> {
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
/// let model = infobyte::Model::open(path)?;
/// let mesh = infobyte::triangles(&model, &infobyte::progress::Silent)?;
/// let corners = mesh.faces[0].map(|number| mesh.vertices[number as usize]);
/// assert_eq!(mesh.vertices.len(), mesh.normals.len());
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// The model is damaged, its file is changed meanwhile, or it keeps only what can be seen; it has more than 2^32 corners;
/// [`Error::Stopped`].
pub fn triangles<D: AsRef<[u8]> + Sync>(model: &Model<D>, progress: &dyn Progress) -> Result<Mesh, Error> {
    let path = PathBuf::from(&model.metadata().source.kind);
    Ok(triangles_of(model, &path, ExportRequest::of(ExportForm::Ply), progress)?.0)
}

/// [`triangles`] of the model at a path: fewer, or with rules the surfaces of labels, one after the other, which wait in a
/// temporary file before. Fewer have a distance in mm from all of them, where it was measured.
pub(crate) fn triangles_of<D: AsRef<[u8]> + Sync>(
    model: &Model<D>,
    path: &Path,
    request: ExportRequest<'_>,
    progress: &dyn Progress,
) -> Result<(Mesh, Option<f64>), Error> {
    // All labels together have one surface, which can have fewer triangles.
    let asked = if request.labels.is_empty() { ExportRequest::of(request.form) } else { request };
    refuse_part(model, path, asked)?;
    let (view, space) = (model.view(), GridSpace::new(model.dims(), &model.affine())?);
    let exporter = exporter_of(model, &view, &space, request, &|| {});
    let scratch = std::env::temp_dir();
    // Checking all of it says what is wrong.
    let damage = || verify(model).err().map_or(Error::Internal, |fault| fault.at(path).into());
    let wanted = labels::wanted(model, path, asked)?;
    let mesh = || {
        if request.labels.is_empty() {
            return exporter.triangles(progress);
        }
        let all = &model.frame().labels;
        let labels = exporter.label_mesh(all, &wanted, MAX_SMOOTH, &scratch, progress)?;
        Ok((labels.in_memory()?, labels.distance_mm()))
    };
    model.unchanged_during(|| mesh().map_err(|stop| stopped(stop, [path, &scratch], damage)))
}

/// True if a step of 32-bit numbers, at the corner farthest from the origin, is more than 1/128 of a voxel.
fn is_far(affine: &Affine, dims: Dims) -> bool {
    let corner = |i: usize| {
        let sides = dims.to_array();
        affine.apply(std::array::from_fn(|a| if i >> a & 1 == 1 { f64::from(sides[a]) } else { 0.0 }))
    };
    let farthest = (0..8).flat_map(corner).map(f64::abs).fold(0.0, f64::max);
    let least = affine.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    farthest * f64::from(f32::EPSILON) > least / 128.0
}

/// The warning of enclosed boxes that may be inside or outside.
pub(super) fn unknown_inside(voxels: u64) -> Option<String> {
    let sentence = format!(
        "normals do not tell the side of {}; the likelier one was taken",
        Count(voxels, "enclosed voxel")
    );
    (voxels > 0).then_some(sentence)
}

impl ExportReport {
    /// Report for people.
    pub fn text(&self) -> String {
        let what = match self.form {
            ExportForm::Html => "a page with the model".to_owned(),
            ExportForm::Linked => "a page that fetches the model from its web server".to_owned(),
            ExportForm::Points => Count(self.vertices, "point").to_string(),
            ExportForm::Nrrd | ExportForm::Nifti | ExportForm::NiftiGz => {
                format!("{} inside", Count(self.inside_voxels, "voxel"))
            }
            _ => {
                let labels = Some(self.surfaces.len()).filter(|count| *count > 0);
                let labels = labels.map(|count| format!("{}, ", Count(count, "label"))).unwrap_or_default();
                format!("{labels}{} triangles, {} corners", self.triangles, self.vertices)
            }
        };
        let closed = self.closed.map_or("", |closed| if closed { ", closed" } else { ", not closed" });
        let bodies =
            self.separate_bodies.map_or_else(String::new, |count| format!(", {}", Count(count, "body")));
        let cavities = self.cavities.filter(|count| *count > 0);
        let within = cavities.map_or_else(String::new, |count| format!(" with {}", Count(count, "cavity")));
        let bytes = Bytes(self.bytes);
        let mut text = format!(
            "{}: {what}{closed}{bodies}{within}, {bytes}, {:.2} s\n",
            shown(&self.output),
            self.wall_s
        );
        if self.separate_bodies > Some(1) {
            text += &if self.was_one {
                format!(
                    "  thin bridges came apart; for one body leave out {ERROR}, or choose {TRIANGLES} instead\n"
                )
            } else if self.is_of_volume {
                format!("  for one, build the volume with {KEEP_LARGEST} 1\n")
            } else {
                String::new()
            };
        }
        if cavities.is_some() && self.is_of_volume {
            text += &format!("  for a solid without them, build the volume with {FILL_CAVITIES}\n");
        }
        if let Some(fine) = self.fine_triangles {
            let apart = self.distance_mm.map(|mm| {
                let rms = self.rms_mm.map_or_else(String::new, |mm| format!(", {} mm RMS", Rounded(mm)));
                let at = self.distance_at_mm.map_or_else(String::new, |at| {
                    let [x, y, z] = at.map(|c| Rounded(c.into()));
                    format!(" (at {x}, {y}, {z} mm)")
                });
                format!(", at most {} mm from them{at}{rms} (measured)", Rounded(mm))
            });
            let within = || self.within_mm.map(|mm| format!(", within {} mm of them", Short(mm)));
            text += &format!("  of {fine} fine triangles{}\n", apart.or_else(within).unwrap_or_default());
        }
        if let Some(apart) = self.apart_voxels {
            text += &format!("  larger leaves: up to {} voxel from the surface\n", Short(apart));
        }
        for warning in &self.warnings {
            text += &format!("  note: {warning}\n");
        }
        text
    }
}
