//! `report.json` and `report.csv`: one entry for each volume, in the order of the catalogue.

use std::io::{self, Write};
use std::path::Path;

use serde_json::{Value, json};

use super::record::{Item, Journal, Status};
use super::{page, write_whole};
use crate::source::BurnedIn;
use crate::text::{self, escaped, plain};

/// How many volumes came to which end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Built in this run.
    pub converted: u64,
    /// Built before, or left alone as asked.
    pub skipped: u64,
    /// Refused or failed.
    pub failed: u64,
}

/// What a batch did.
#[derive(Clone, Debug)]
pub struct BatchReport {
    /// Ends of the volumes.
    pub counts: Counts,
    /// Files that are no volume: reason, how many, the first.
    pub left_out: Vec<(String, u64, String)>,
    /// The same one by one, as many as are named: path and reason.
    pub left_out_files: Vec<(String, String)>,
    /// Sentences about the batch as a whole.
    pub warnings: Vec<String>,
    /// The cap.
    pub memory_budget_bytes: u64,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Volumes worked on at a time.
    pub jobs: usize,
    /// Seconds in all.
    pub wall_s: f64,
    /// Are files and folders named in the contact sheet?
    pub(super) keep_names: bool,
    /// What was asked for, as far as results depend on it.
    pub options: Value,
    /// What the output folder holds after it, whenever that was made.
    pub holds: Holdings,
}

/// The models of an output folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Holdings {
    /// Models with their records.
    pub models: u64,
    /// Thumbnails of these.
    pub thumbnails: u64,
    /// Bytes of the models.
    pub bytes: u64,
}

impl Holdings {
    /// Counts the models that have a record in a folder; one that cannot be read holds nothing.
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

/// What reports say at their top.
pub const NOTICE: &str =
    "names files and folders as they are, which may tell who is shown: keep it with the images";

/// The first column says in every line what the table is.
const CSV_HEAD: &str = "names_files_and_folders,status,name,input,part,format,kind,nx,ny,nz,spacing_x_mm,spacing_y_mm,spacing_z_mm,dtype,range_low,range_high,\
skin_voxels,nodes,bytes,files,input_bytes,wall_s,memory_bytes,scratch_bytes,burned_in,reason,warnings,selection,memory_plan_bytes\n";

impl BatchReport {
    pub(super) fn write(&self, out: &Path, journal: &Journal) -> io::Result<()> {
        write_whole(&out.join("report.json"), |w| self.write_json(journal, w))?;
        write_whole(&out.join("report.csv"), |w| {
            w.write_all(CSV_HEAD.as_bytes())?;
            journal.for_each(&mut |item| w.write_all(csv_line(&item).as_bytes()))?;
            self.left_out_files
                .iter()
                .try_for_each(|(path, why)| w.write_all(left_out_line(path, why).as_bytes()))
        })?;
        write_whole(&out.join("index.html"), |w| page::write(self, out, journal, w))
    }

    /// The object of the command contract, items included, as one line of text.
    fn write_json(&self, journal: &Journal, w: &mut dyn Write) -> io::Result<()> {
        // The notice comes first, and the items last, which are never all in memory.
        write!(w, "{{\"notice\":{}", json!(format!("this report {NOTICE}")))?;
        if let Value::Object(facts) = self.json() {
            for (key, value) in facts {
                write!(w, ",{}:{}", json!(key), text::json(&value))?;
            }
        }
        w.write_all(b",\"items\":[")?;
        let mut first = true;
        journal.for_each(&mut |item| {
            w.write_all(if first { b"\n" } else { b",\n" })?;
            first = false;
            w.write_all(escaped(serde_json::to_string(&item)?).as_bytes())
        })?;
        w.write_all(b"\n]}\n")
    }

    /// Everything but the items, which are in `report.json`.
    pub fn json(&self) -> Value {
        json!({
            "converted": self.counts.converted,
            "skipped": self.counts.skipped,
            "failed": self.counts.failed,
            "left_out": self.left_out.iter().map(|(reason, count, first)| json!({
                "reason": reason, "count": count, "first": first
            })).collect::<Vec<_>>(),
            "left_out_files": self.left_out_files.iter().map(|(path, reason)| json!({
                "path": path, "reason": reason
            })).collect::<Vec<_>>(),
            "warnings": self.warnings,
            "memory_budget_bytes": self.memory_budget_bytes,
            "peak_rss_bytes": self.peak_rss_bytes,
            "jobs": self.jobs,
            "wall_s": self.wall_s,
            "holds": {
                "models": self.holds.models, "thumbnails": self.holds.thumbnails, "bytes": self.holds.bytes,
            },
            "program": concat!("infobyte ", env!("CARGO_PKG_VERSION")),
            "options": self.options,
        })
    }
}

/// A text of the table, quoted as RFC 4180 says.
fn quoted(text: &str) -> String {
    // A cell that begins like a formula would be evaluated by spreadsheets.
    let formula = text.starts_with(['=', '+', '-', '@', '\t']);
    let text = plain(text, false).replace('"', "\"\"");
    format!("\"{}{text}\"", if formula { "'" } else { "" })
}

/// The line of a file that is no volume: its path and the reason.
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
    let mut cells = vec![
        "yes".to_owned(),
        status(item.status).to_owned(),
        quoted(&item.name),
        quoted(&item.input),
        quoted(&item.part),
        quoted(&item.format),
        quoted(&item.kind),
    ];
    match &item.model {
        Some(m) => {
            cells.extend(m.dims.map(|n| n.to_string()));
            cells.extend(m.spacing_mm.map(|s| s.to_string()));
            cells.push(m.dtype.clone());
            cells.push(m.range.0.to_string());
            cells.push(m.range.1.map(|v| v.to_string()).unwrap_or_default());
            cells.extend([m.skin_voxels, m.nodes, m.bytes].map(|n| n.to_string()));
        }
        None => cells.extend(std::iter::repeat_n(String::new(), 12)),
    }
    cells.extend([item.files, item.input_bytes].map(|n| n.to_string()));
    match &item.model {
        Some(m) => {
            cells.push(format!("{:.3}", m.wall_s));
            cells.extend([m.memory_bytes, m.scratch_bytes].map(|n| n.to_string()));
        }
        None => cells.extend(std::iter::repeat_n(String::new(), 3)),
    }
    cells.push(item.burned_in.map(burned_in).unwrap_or_default().to_owned());
    cells.push(quoted(item.reason.as_deref().unwrap_or_default()));
    cells.push(quoted(&item.warnings.join("; ")));
    match &item.model {
        Some(m) => cells.extend([m.selection.clone(), m.memory_plan_bytes.to_string()]),
        None => cells.extend([String::new(), String::new()]),
    }
    cells.join(",") + "\n"
}

pub(super) fn burned_in(kind: BurnedIn) -> &'static str {
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
            // Commas within quotes do not count.
            let cells = line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
            assert_eq!(cells, CSV_HEAD.matches(',').count(), "{line}");
            assert!(line.contains("\"a \"\"quoted\"\", <odd> one\""), "{line}");
        }
    }
}
