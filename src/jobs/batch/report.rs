//! `report.json` and `report.csv`: one entry for each volume, in the order of the catalogue.

use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;

use super::record::{Item, Journal, Status};
use super::{BatchRequest, page};
use crate::atomic::AtomicFile;
use crate::builder::{Connectivity, Threshold};
use crate::discovery::{Catalogue, LeftOut};
use crate::format::{Channel, SurfaceKind};
use crate::page::{Shown, Transport};
use crate::source::{BurnedIn, GapPolicy};
use crate::text::{self, data, plain};
use crate::volume::SourceError;

/// Numbers of volumes by outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Counts {
    /// Volumes built in this run.
    pub converted: u64,
    /// Volumes built before, or left alone as asked.
    pub skipped: u64,
    /// Volumes refused, or whose build failed.
    pub failed: u64,
}

/// Files that are not volumes, for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LeftOutCount {
    /// Reason for which they are left out.
    pub reason: String,
    /// Number of files.
    pub count: u64,
    /// Path of the first, in natural order.
    pub first: String,
}

impl From<&LeftOut> for LeftOutCount {
    fn from(files: &LeftOut) -> Self {
        Self { reason: files.why.to_string(), count: files.count, first: data(&files.first) }
    }
}

/// A file that is not a volume.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LeftOutFile {
    /// The file or folder.
    pub path: String,
    /// Reason for which it is left out, or was not entered.
    pub reason: String,
}

impl LeftOutFile {
    /// The first files that are left out, at most `most`.
    ///
    /// # Errors
    /// The list is on disk and cannot be read.
    pub(in crate::jobs) fn first(catalogue: &Catalogue, most: usize) -> Result<Vec<Self>, SourceError> {
        let mut named = Vec::new();
        catalogue.for_each_left_out::<SourceError>(&mut |why, path| {
            if named.len() < most {
                named.push(Self { path: data(path), reason: why.to_string() });
            }
            Ok(())
        })?;
        Ok(named)
    }
}

/// The report of a batch, without the volumes.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct BatchReport {
    /// Numbers of volumes by outcome.
    #[serde(flatten)]
    pub counts: Counts,
    /// Files that are not volumes, by reason.
    pub left_out: Vec<LeftOutCount>,
    /// The same files one by one; at most 10,000 of a scan and 1,000 of a batch.
    pub left_out_files: Vec<LeftOutFile>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Limit of the resident memory of the process.
    pub memory_budget_bytes: u64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Volumes worked on at a time.
    pub jobs: usize,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// True if files and folders are named in the contact sheet.
    #[serde(skip)]
    pub(super) keep_names: bool,
    /// Contents of the output folder, from this run and earlier ones.
    pub holds: Holdings,
    /// Name and version of the program that wrote it.
    pub program: &'static str,
    /// Options on which the results depend.
    pub options: BatchOptions,
}

/// Options of a batch on which its results depend.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct BatchOptions {
    /// otsu, {iso: V} or {range: [LO, HI]}.
    pub threshold: ThresholdOption,
    /// Skin voxels, or cells between samples.
    pub surface: SurfaceKind,
    /// Connectivity of the skin: 26 or 6.
    pub connectivity: u8,
    /// Attributes stored for each skin voxel.
    pub channels: Vec<&'static str>,
    /// Estimator of the normals.
    pub gradient: &'static str,
    /// Treatment of missing slices.
    pub gaps: GapPolicy,
    /// Cleaning of volumes before they are built, as options of the command line.
    pub cleaning: Vec<String>,
    /// True if mean attributes of coarse nodes are stored.
    pub lod: bool,
    /// Spacing that replaces what files state; null without.
    pub spacing_mm: Option<[f64; 3]>,
    /// Directions of the axes that replace what files state; null without.
    pub orientation: Option<String>,
    /// Modalities that are taken; empty for all.
    pub modalities: Vec<String>,
    /// Volumes that are taken; empty for all.
    pub series: Vec<String>,
    /// Longest side of the thumbnails in pixels; 0 for none.
    pub thumbnails: u32,
    /// True if images that may carry text have thumbnails, too.
    pub thumbnails_of_all: bool,
    /// Fewest slices of a volume that is taken.
    pub min_slices: u32,
}

/// How values inside are chosen.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ThresholdOption {
    /// By Otsu's method.
    Otsu,
    /// Lowest value inside.
    Iso(f64),
    /// Lowest and highest value inside.
    Range(f64, f64),
}

impl From<Threshold> for ThresholdOption {
    fn from(threshold: Threshold) -> Self {
        match threshold {
            Threshold::Otsu => Self::Otsu,
            Threshold::Iso(lo) => Self::Iso(lo),
            Threshold::Range(lo, hi) => Self::Range(lo, hi),
            Threshold::Chosen(selection) => Self::Range(selection.lo, selection.hi),
        }
    }
}

impl From<&BatchRequest> for BatchOptions {
    fn from(request: &BatchRequest) -> Self {
        let (b, placement) = (&request.build, &request.how.placement);
        Self {
            threshold: b.threshold.into(),
            surface: b.volume_surface(),
            connectivity: if b.connectivity == Connectivity::Thick6 { 6 } else { 26 },
            channels: b.channels().iter().map(Channel::name).collect(),
            gradient: b.gradient().name(),
            gaps: request.how.gaps,
            cleaning: request.clean.operations(),
            lod: b.lod,
            spacing_mm: placement.spacing_mm,
            orientation: placement.orientation.map(|o| o.to_string()),
            modalities: request.modalities.clone(),
            series: request.series.clone(),
            thumbnails: request.thumbnails,
            thumbnails_of_all: request.thumbnails_of_all,
            min_slices: request.min_slices,
        }
    }
}

/// The models of an output folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Holdings {
    /// Models with their records.
    pub models: u64,
    /// Thumbnails of these models.
    pub thumbnails: u64,
    /// Size of the models.
    pub bytes: u64,
}

impl Holdings {
    /// Counts the models that have a record in a folder; 0 for a folder that cannot be read.
    pub(super) fn of(folder: &Path) -> Self {
        let mut holds = Self::default();
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            let is_model = path.extension().is_some_and(|e| e == "oct");
            if is_model && path.with_extension("oct.json").is_file() {
                holds.models += 1;
                holds.bytes += entry.metadata().map_or(0, |meta| meta.len());
                holds.thumbnails += u64::from(path.with_extension("png").is_file());
            }
        }
        holds
    }
}

/// Notice at the top of reports.
pub const NOTICE: &str =
    "names files and folders as they are, which may tell who is shown: keep it with the images";

/// The first column repeats the notice in every line.
const CSV_HEAD: &str = "names_files_and_folders,status,name,input,part,format,kind,nx,ny,nz,spacing_x_mm,spacing_y_mm,spacing_z_mm,dtype,range_low,range_high,\
skin_voxels,nodes,bytes,files,input_bytes,wall_s,memory_bytes,scratch_bytes,burned_in,reason,warnings,selection,memory_plan_bytes,label_count\n";

impl BatchReport {
    pub(super) fn write(&self, out: &Path, journal: &Journal) -> io::Result<()> {
        write_whole(&out.join("report.json"), |w| self.write_json(journal, w))?;
        write_whole(&out.join("report.csv"), |w| {
            w.write_all(CSV_HEAD.as_bytes())?;
            journal.for_each(&mut |item| w.write_all(csv_line(&item).as_bytes()))?;
            self.left_out_files
                .iter()
                .try_for_each(|file| w.write_all(left_out_line(&file.path, &file.reason).as_bytes()))
        })?;
        write_whole(&out.join(page::HOME), |w| page::write_home(journal, w))?;
        if self.holds.models == 0 {
            // It may be missing, or show models that are gone.
            let _none = std::fs::remove_file(out.join(page::VIEWER));
        } else {
            let shown = Shown::<&[u8]>::Linked(None);
            write_whole(&out.join(page::VIEWER), |w| {
                crate::page::write(&shown, "Model", &[], Transport::Linked, w)
            })?;
        }
        write_whole(&out.join("index.html"), |w| page::write(self, out, journal, w))
    }

    /// The object of the command contract, items included, as one line of text.
    fn write_json(&self, journal: &Journal, w: &mut dyn Write) -> io::Result<()> {
        // The notice comes first, and last the items, which are never all in memory.
        let facts = text::json(self);
        let facts = facts.strip_prefix('{').and_then(|facts| facts.strip_suffix('}')).unwrap_or_default();
        let notice = text::json(&format!("this report {NOTICE}"));
        write!(w, "{{\"notice\":{notice},{facts},\"items\":[")?;
        let mut first = true;
        journal.for_each(&mut |item| {
            w.write_all(if first { b"\n" } else { b",\n" })?;
            first = false;
            w.write_all(text::json(&item).as_bytes())
        })?;
        w.write_all(b"\n]}\n")
    }
}

/// Writes an atomic text file of the output folder through a buffer.
fn write_whole(path: &Path, write: impl FnOnce(&mut dyn io::Write) -> io::Result<()>) -> io::Result<()> {
    let file = AtomicFile::create(path)?;
    let mut buffered = io::BufWriter::with_capacity(16 << 10, file.file());
    write(&mut buffered)?;
    io::Write::flush(&mut buffered)?;
    drop(buffered);
    file.commit()
}

/// A text of the table, quoted by RFC 4180.
fn quoted(text: &str) -> String {
    // A cell that begins like a formula would be evaluated by spreadsheets.
    let formula = text.starts_with(['=', '+', '-', '@', '\t']);
    let text = plain(text, false).replace('"', "\"\"");
    format!("\"{}{text}\"", if formula { "'" } else { "" })
}

/// The line of a file that is not a volume: its path and the reason.
fn left_out_line(path: &str, why: &str) -> String {
    let columns = CSV_HEAD.trim_end().split(',');
    let cells = columns.map(|column| match column {
        "names_files_and_folders" => "yes".to_owned(),
        "status" => "left_out".to_owned(),
        "input" => quoted(path),
        "reason" => quoted(why),
        _ => String::new(),
    });
    cells.collect::<Vec<_>>().join(",") + "\n"
}

/// One line of the table of a volume.
fn csv_line(item: &Item) -> String {
    // Groups of cells; without a model its groups are empty.
    let [size, costs, selection] = match &item.model {
        Some(m) => {
            let ([nx, ny, nz], [x, y, z], (low, high)) = (m.dims, m.spacing_mm, m.range);
            let high = high.map(|v| v.to_string()).unwrap_or_default();
            let counts = format!("{},{},{}", m.skin_voxels, m.nodes, m.bytes);
            [
                format!("{nx},{ny},{nz},{x},{y},{z},{},{low},{high},{counts}", m.dtype),
                format!("{:.3},{},{}", m.wall_s, m.memory_bytes, m.scratch_bytes),
                format!("{},{},{}", m.selection, m.memory_plan_bytes, m.label_count),
            ]
        }
        None => [12, 3, 3].map(|cells: usize| ",".repeat(cells - 1)),
    };
    let texts = [&item.name, &item.input, &item.part, &item.format, &item.kind].map(|text| quoted(text));
    format!(
        "yes,{},{},{size},{},{},{costs},{},{},{},{selection}\n",
        status(item.status),
        texts.join(","),
        item.files,
        item.input_bytes,
        item.burned_in.map(burned_in).unwrap_or_default(),
        quoted(item.reason.as_deref().unwrap_or_default()),
        quoted(&item.warnings.join("; "))
    )
}

fn burned_in(kind: BurnedIn) -> &'static str {
    match kind {
        BurnedIn::Stated => "stated",
        BurnedIn::Ultrasound => "ultrasound",
        BurnedIn::SecondaryCapture => "secondary_capture",
        BurnedIn::ScreenCapture => "screen_capture",
    }
}

pub(super) fn status(status: Status) -> &'static str {
    match status {
        Status::Converted => "converted",
        Status::Skipped => "skipped",
        Status::Failed => "failed",
        Status::Kept => "kept",
    }
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::item;
    use super::*;

    #[test]
    fn lines_have_as_many_cells_as_the_head_and_quote_texts() {
        let mut failed = item("b");
        (failed.model, failed.status, failed.reason) = (None, Status::Failed, Some("no".into()));
        for item in [item("a"), failed] {
            let line = csv_line(&item);
            // Commas within quotes are not separators.
            let cells = line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
            assert_eq!(cells, CSV_HEAD.matches(',').count(), "{line}");
            assert!(line.contains("\"a \"\"quoted\"\", <odd> one\""), "{line}");
        }
    }
}
