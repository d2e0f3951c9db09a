//! `oct info`: facts of a file, without touching its large sections.

mod report;

pub use report::{
    InfoReport, LabelFigures, LeafFigures, MeasuredFigures, ModelFigures, NotMeasured, RangeFigures,
};

use std::fmt::Write;
use std::path::Path;

use super::measure::{LabelMeasures, Measures, label_volume_error, measure_labels, measure_until};
use super::open_model::open_model;
use crate::budget::Bytes;
use crate::error::Error;
use crate::format::{
    Channel, Encoding, Label, Metadata, Noise, Quantity, SectionKind, SelectionKind, SurfaceKind,
    VERSION_MAJOR,
};
use crate::geom::Affine;
use crate::load::{Frame, LoadError, LoadFault, Model};
use crate::platform::PositionalFile;
use crate::progress::{Progress, Silent};
use crate::text::names::{MEASURE, VERIFY};
use crate::text::{Count, Short, WithError, data, shown};
use crate::volume::ScalarType;

/// Bytes a voxel of the paper's uniform volume: 2 bytes of density and 33 bits of normal, colour and
/// optics, as its table 1 counts.
pub(crate) const PAPER_BYTES_PER_VOXEL: f64 = 6.125;

/// Facts of one file.
#[derive(Clone, Debug)]
pub struct Info {
    /// The file, as given.
    pub input: String,
    /// Header, table, metadata and levels.
    pub frame: Frame,
    /// Measures of its skin, if they were asked for.
    pub measured: Option<Measured>,
}

/// Outcome of measuring a model.
#[derive(Clone, Debug, PartialEq)]
pub enum Measured {
    /// It was measured.
    Done(Measures),
    /// Each of its labels was measured alone.
    Labels(LabelMeasures),
    /// It was not measured.
    Not(NotMeasured),
}

/// Limits of skin voxels and of rows of the grid up to which a model is measured unasked: half a second or so.
const SOON_MEASURED: [u64; 2] = [1 << 24, 1 << 26];

fn is_soon_measured(frame: &Frame) -> bool {
    let [voxels, rows] = SOON_MEASURED;
    let dims = frame.dims();
    frame.header.voxels <= voxels && u64::from(dims.ny()) * u64::from(dims.nz()) <= rows
}

/// As [`read_info`], with the measures of the skin.
///
/// Cost: one pass over the nodes and normals. Models of up to 16 million skin voxels are measured, larger and packed
/// ones only if `anyway` is set; a packed one is unpacked into an unnamed file, which takes as much disk.
///
/// # Errors
/// As [`read_info`].
pub fn read_info_measured(path: &Path, anyway: bool) -> Result<Info, Error> {
    let mut info = read_info(path)?;
    let packed = info.frame.header.encoding == Encoding::Packed;
    info.measured = Some(if packed && !anyway {
        Measured::Not(NotMeasured::Packed)
    } else if !(anyway || is_soon_measured(&info.frame)) {
        Measured::Not(NotMeasured::Large)
    } else {
        let model = open_model(path)?;
        let measured = Measured::of(&model, &Silent);
        model.check_unchanged(path)?;
        measured
    });
    Ok(info)
}

/// Reads the facts of a mapped or packed file.
///
/// Cost: one small read, whatever the size of the model (SPEC I1 to I7 are checked).
///
/// # Errors
/// The file is unreadable, foreign, newer or damaged.
pub fn read_info(path: &Path) -> Result<Info, Error> {
    let file = PositionalFile::open(path)
        .map_err(|cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause }))?;
    let frame = Frame::read(&file).map_err(|fault| fault.at(path))?;
    Ok(Info { input: data(path), frame, measured: None })
}

/// The noise, for people.
fn noise_text(noise: &Noise) -> String {
    let Noise { inside, outside, correlation: [x, y, z], .. } = *noise;
    if inside == 0.0 && outside == 0.0 {
        return "not measurable: nothing is five voxels thick, or values do not vary".into();
    }
    let [inside, outside] = [inside, outside].map(Short);
    format!("{inside} inside, {outside} outside; correlation of neighbours {x:.2}, {y:.2}, {z:.2}")
}

/// A box of the finest level, for people.
pub(crate) fn noun(surface: SurfaceKind) -> &'static str {
    match surface {
        SurfaceKind::Skin => "skin voxel",
        SurfaceKind::Cells => "cell",
    }
}

/// Bytes stored for one kind of section.
fn stored(frame: &Frame, kind: SectionKind) -> u64 {
    frame.section(kind).map_or(0, |e| e.stored_bytes)
}

/// Bytes stored for levels, infobytes and rank directory.
pub(crate) fn structure_bytes(frame: &Frame) -> u64 {
    [SectionKind::Levels, SectionKind::Nodes, SectionKind::Rank].map(|k| stored(frame, k)).iter().sum()
}

/// Name and stored bytes of every channel section, coarse means apart.
pub(crate) fn channel_bytes(frame: &Frame) -> Vec<(&'static str, u64)> {
    frame
        .sections
        .iter()
        .filter_map(|e| {
            e.kind.filter(|k| k.channel().is_some() || k.is_of_leaves()).map(|k| (k.name(), e.stored_bytes))
        })
        .collect()
}

/// CRC over the kinds and content CRCs of all sections but the rank directory: the same for the
/// mapped and the packed file of one model.
pub(crate) fn content_checksum(frame: &Frame) -> u32 {
    frame
        .sections
        .iter()
        .filter(|e| e.kind != Some(SectionKind::Rank))
        .flat_map(|e| [e.tag, e.content_crc.to_le_bytes()])
        .fold(0, |crc, word| crc32c::crc32c_append(crc, &word))
}

/// Type of the source's samples.
pub(super) fn dtype(frame: &Frame) -> &'static str {
    ScalarType::ALL.get(usize::from(frame.metadata.scalar)).map_or("unknown", |s| s.name())
}

pub(super) fn ratio(a: u64, b: u64) -> f64 {
    a as f64 / b.max(1) as f64
}

/// Bytes of the paper's uniform volume, of the dims and of the whole grid.
fn paper_bytes(frame: &Frame) -> (f64, f64) {
    let grid = (1_u64 << frame.dims().depth()) as f64;
    (frame.dims().voxels() as f64 * PAPER_BYTES_PER_VOXEL, grid.powi(3) * PAPER_BYTES_PER_VOXEL)
}

pub(crate) fn kind_name(kind: SelectionKind) -> &'static str {
    match kind {
        SelectionKind::Iso => "iso",
        SelectionKind::Range => "range",
        SelectionKind::Otsu => "otsu",
    }
}

impl Info {
    /// A table for people: kind, size and measures of the model; with `all`, also the make-up of the file.
    pub fn text(&self, all: bool) -> String {
        let frame = &self.frame;
        let m = &frame.metadata;
        let mut rows: Vec<(String, String)> = Vec::new();
        let mut row = |name: &str, text: String| rows.push((name.to_owned(), text));
        row("file", format!("{}, {}", shown(&self.input), Bytes(frame.header.file_bytes)));
        row("model", what_it_is(frame));
        let format = if has_values(m) { format!("{} ", shown(&m.source.format)) } else { String::new() };
        let files = match m.source.files {
            0 => String::new(),
            files => format!("{}, ", Count(files, "file")),
        };
        let scalar = if has_values(m) { dtype(frame) } else { "without values" };
        row("source", format!("{format}{} ({files}{scalar})", shown(&m.source.kind)));
        row("inside", inside(m));
        let [nx, ny, nz] = m.dims;
        let letters = Affine { rows: m.affine }.orientation_letters();
        let [x, y, z] = m.spacing_mm.map(Short);
        row("voxels", format!("{nx} x {ny} x {nz}, spacing {x} x {y} x {z} mm, axes {letters}"));
        for (name, text) in self.measured.iter().flat_map(Measured::rows) {
            row(name, text);
        }
        if let Some(error) = &m.error {
            let finest = m.spacing_mm.into_iter().fold(f64::INFINITY, f64::min);
            let figures = [error.bound, error.rms, error.p99, error.most];
            let [bound, rms, p99, most] = figures.map(|voxels| Short(voxels * finest));
            row(
                "error",
                format!(
                    "within {bound} mm of the cells at their edges: RMS {rms}, 99 % {p99}; at most {most}"
                ),
            );
        }
        if frame.channels().any(|(channel, _)| channel == Channel::Color) {
            row("colors", format!("one for each {}", one_of(frame)));
        }
        if let Some(quantity) = &frame.quantity {
            row("values", quantity_text(quantity));
        }
        if let Some(noise) = &m.noise {
            row("noise", noise_text(noise));
        }
        let labels = label_figures(frame, self.measured.as_ref());
        if !labels.is_empty() {
            rows.push(("labels".to_owned(), label_heads(&labels, all)));
        }
        rows.extend(labels.iter().map(label_row));
        if all {
            rows.extend(file_rows(frame));
        }
        let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        rows.iter().fold(String::new(), |mut text, (name, value)| {
            let _ = writeln!(text, "{name:width$}  {value}");
            text
        })
    }
}

/// Kind of the stored surface, for people.
fn what_it_is(frame: &Frame) -> String {
    let count = frame.header.voxels;
    let mut text = match frame.surface() {
        SurfaceKind::Skin => {
            format!("{}, {}-connected", Count(count, "skin voxel"), frame.metadata.connectivity)
        }
        SurfaceKind::Cells => format!("{} between samples", Count(count, "cell")),
    };
    if frame.header.leaves {
        let _ = write!(text, ", {}", Count(leaves(frame), "larger leaf"));
    }
    if !frame.labels.is_empty() {
        let _ = write!(text, ", {}", Count(frame.labels.len(), "label"));
    }
    text
}

/// Heads of the rows of labels; with `all`, also the meaning of their errors.
fn label_heads(labels: &[LabelFigures], all: bool) -> String {
    let name = if labels.iter().any(|label| !label.name.is_empty()) { "name, " } else { "" };
    let heads = format!("{name}colour, voxels, volume");
    if labels.iter().all(|label| label.area_mm2.is_none()) {
        return heads;
    }
    let of_volumes =
        "; for volumes it is the surface times a quarter of a voxel, which also bounds exported meshes";
    let more = if all { of_volumes } else { "" };
    format!("{heads}, surface; ± is the error in 19 of 20 cases{more}")
}

/// A label, for people.
fn label_row(label: &LabelFigures) -> (String, String) {
    let name = if label.name.is_empty() { String::new() } else { format!("{}, ", shown(&label.name)) };
    let area = label
        .area_mm2
        .zip(label.area_error_mm2)
        .map_or_else(String::new, |(value, error)| format!(", {} mm²", WithError { value, error }));
    let volume = WithError { value: label.volume_mm3, error: label.volume_error_mm3.unwrap_or(0.0) };
    let text = format!("{name}{}, {}, {volume} mm³{area}", label.color, Count(label.voxels, "voxel"));
    (format!("label {}", label.number), text)
}

/// The make-up of a file: format, tree, sections and ratios.
fn file_rows(frame: &Frame) -> Vec<(String, String)> {
    let (m, header, depth) = (&frame.metadata, &frame.header, frame.dims().depth());
    let encoding = header.encoding.name();
    let mut rows = vec![
        ("format".to_owned(), format!("{VERSION_MAJOR}.{}, {encoding}", header.minor)),
        (
            "grid".to_owned(),
            format!("{} cells a side, {depth} levels, {} nodes", 1_u64 << depth, header.nodes),
        ),
    ];
    let mut row = |name: &str, text: String| rows.push((name.to_owned(), text));
    let one = one_of(frame);
    let each =
        |b: u64| format!("{:>12}  {:>7.4} B/{one}", Bytes(b).to_string(), ratio(b, surface_boxes(frame)));
    row("structure", each(structure_bytes(frame)));
    for (name, b) in channel_bytes(frame) {
        row(name, each(b));
    }
    let bytes = header.file_bytes;
    row("whole file", each(bytes));
    if m.source.bytes > 0 {
        row("against raw", format!("1 : {:.1}  ({})", ratio(m.source.bytes, bytes), Bytes(m.source.bytes)));
    }
    let (paper_dims, paper_grid) = paper_bytes(frame);
    let [dims, grid] = [paper_dims, paper_grid].map(|paper| paper / to_f64(bytes));
    row(
        "against paper",
        format!(
            "1 : {dims:.1}  (a volume of {PAPER_BYTES_PER_VOXEL} B a voxel; 1 : {grid:.1} if it filled the grid of cells)"
        ),
    );
    row("checksum", format!("{:08x}", content_checksum(frame)));
    row("written by", shown(&m.program).to_string());
    rows
}

impl Measured {
    /// Measures a model, or each of its labels; of no use once `progress` stops it.
    pub(crate) fn of<D: AsRef<[u8]> + Sync>(model: &Model<D>, progress: &dyn Progress) -> Self {
        let (view, table) = (model.view(), &model.frame().labels);
        if !table.is_empty() {
            let found = measure_labels(&view, table, model.dims(), &model.affine(), progress);
            return found.map_or(Self::Not(NotMeasured::Impossible), Self::Labels);
        }
        let is_part = model.metadata().seen_from().is_some();
        let found = measure_until(&view, model.dims(), &model.affine(), is_part, progress);
        found.map_or(Self::Not(NotMeasured::Impossible), |found| {
            Self::Done(found.with_leaves(model.metadata()))
        })
    }

    /// Lines of the table.
    fn rows(&self) -> Vec<(&'static str, String)> {
        let measures = match self {
            Self::Done(measures) => measures,
            Self::Labels(found) => {
                return vec![("size", size_text(found.box_mm)), ("extent", extent_text(found.box_mm))];
            }
            Self::Not(why) => {
                let text = match why {
                    NotMeasured::Packed => {
                        format!("none of a packed model; {MEASURE} unpacks it for a moment")
                    }
                    NotMeasured::Large => format!("take a while here; {MEASURE} takes them"),
                    NotMeasured::Labels | NotMeasured::Impossible => {
                        format!("the model has no volume, or is damaged; see `{VERIFY}`")
                    }
                };
                return vec![("measures", text)];
            }
        };
        let known = |value: Option<(f64, f64)>, unit: &str, why_not: &str| match value {
            Some((value, error)) => format!("{} {unit}", WithError { value, error }),
            None => why_not.to_owned(),
        };
        let enclosed = measures.enclosed;
        let uneven = "not known: voxels are more than 100 times as long along one axis as along another";
        let no_area = if measures.is_uneven { uneven } else { "not known without normals" };
        let no_volume = if measures.area_mm2.is_none() {
            no_area
        } else if measures.is_part {
            "not known: the model keeps only what can be seen from outside or the views that were given"
        } else {
            "not known: walls of one voxel do not say what is inside"
        };
        let mut volume = known(measures.volume_mm3, "mm³", no_volume);
        if measures.volume_mm3.is_some() {
            let _ = match enclosed.cavities {
                0 => write!(volume, ", no cavities wider than a voxel"),
                cavities => {
                    write!(volume, ", without {cavities} voxels of air in cavities or behind narrow openings")
                }
            };
        }
        vec![
            ("size", size_text(measures.box_mm)),
            ("extent", extent_text(measures.box_mm)),
            ("surface area", known(measures.area_mm2, "mm²", no_area)),
            ("volume", volume),
        ]
    }
}

/// A measured quantity, for people.
fn quantity_text(quantity: &Quantity) -> String {
    let [name, unit, sign] =
        [&quantity.name, &quantity.unit, &quantity.sign].map(|text| shown(text).to_string());
    let [lo, hi] = quantity.range.map(Short);
    let mut text = format!("{name}, colours from {lo} to {hi} {unit}");
    if !sign.is_empty() {
        let _ = write!(text, " ({sign})");
    }
    if let Some([lo, hi]) = quantity.tolerance.map(|tolerance| tolerance.map(Short)) {
        let _ = write!(text, ", tolerance {lo} to {hi} {unit}");
    }
    text
}

/// Edges of a box, for people.
fn size_text([low, high]: [[f64; 3]; 2]) -> String {
    let [x, y, z] = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    format!("{x:.1} x {y:.1} x {z:.1} mm")
}

/// Lowest and highest coordinates, for people.
fn extent_text([low, high]: [[f64; 3]; 2]) -> String {
    let side =
        |(axis, (low, high)): (&str, (f64, f64))| format!("{axis} {:.2} .. {:.2}", plain(low), plain(high));
    let sides: Vec<String> = ["x", "y", "z"].into_iter().zip(low.into_iter().zip(high)).map(side).collect();
    format!("{} mm (LPS)", sides.join(", "))
}

fn to_f64(bytes: u64) -> f64 {
    bytes.max(1) as f64
}

/// The number to two places, without the sign of a negative zero.
fn plain(mm: f64) -> f64 {
    if mm.abs() < 0.005 { 0.0 } else { mm }
}

/// Boxes of the surface: skin voxels, or cells and larger leaves.
pub(crate) fn surface_boxes(frame: &Frame) -> u64 {
    frame.header.voxels + leaves(frame)
}

/// Name of one such box.
pub(super) fn one_of(frame: &Frame) -> &'static str {
    match frame.surface() {
        _ if frame.header.leaves => "cell or leaf",
        SurfaceKind::Cells => "cell",
        SurfaceKind::Skin => "skin voxel",
    }
}

/// The labels of a model, with the volume of their voxels, and their areas if these were measured.
pub(super) fn label_figures(frame: &Frame, measured: Option<&Measured>) -> Vec<LabelFigures> {
    let volume_mm3 = Affine { rows: frame.metadata.affine }.determinant().abs();
    let area = |at: usize| match measured {
        Some(Measured::Labels(found)) => found.areas_mm2.get(at).copied().flatten().unzip(),
        _ => (None, None),
    };
    let figures = |(at, label): (usize, &Label)| LabelFigures {
        number: label.number,
        name: label.name.clone(),
        color: label.color.iter().fold("#".to_owned(), |text, c| format!("{text}{c:02x}")),
        voxels: label.voxels,
        volume_mm3: to_f64(label.voxels) * volume_mm3,
        volume_error_mm3: area(at).0.map(|area| label_volume_error(area, volume_mm3)),
        area_mm2: area(at).0,
        area_error_mm2: area(at).1,
    };
    frame.labels.iter().enumerate().map(figures).collect()
}

/// Number of larger leaves of a model.
pub(super) fn leaves(frame: &Frame) -> u64 {
    frame.section(SectionKind::LeafNormals).map_or(0, |e| e.items)
}

/// True for a model of sampled values; solids have none.
pub(super) fn has_values(m: &Metadata) -> bool {
    !matches!(m.source.format.as_str(), "mesh" | "csg")
}

/// The selection of the inside, in words.
fn inside(m: &Metadata) -> String {
    let s = &m.selection;
    if !has_values(m) {
        format!("a {}", m.source.kind)
    } else if s.hi.is_finite() {
        format!("{} .. {} ({})", Short(s.lo), Short(s.hi), kind_name(s.kind))
    } else {
        let otsu = ", not always half-way between two materials: sizes depend on it";
        let doubt = if s.kind == SelectionKind::Otsu { otsu } else { "" };
        format!(">= {} ({}{doubt})", Short(s.lo), kind_name(s.kind))
    }
}
