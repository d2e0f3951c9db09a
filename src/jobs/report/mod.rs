//! `oct report`: how fast and how wrong every choice is, measured and drawn.
//!
//! On a body whose surface is known, errors are distances from that surface. On anything else the truth is not known:
//! then every choice is held against the full-quality frame of the same model, and the page says so. Errors are the
//! same on every run and machine; times and memory are this machine's.
//!
//! | file | what it holds |
//! |---|---|
//! | `rows` | what is measured: experiments, rows, costs, errors, the Pareto front |
//! | `rays` | views, the rays of a picture, and their errors against a body or a frame |
//! | `experiments` | what is tried on a body, on a volume, on a model |
//! | `pictures` | samplings and shadings, a table of each |
//! | `bound` | larger leaves within a bound |
//! | `measures` | deviations, thicknesses and pores against the truth |
//! | `overview` | the first figure: a few settings, error against time, and a verdict |
//! | `machine` | facts of the machine |
//! | `page`, `plot`, `table` | the HTML page, its drawings, and tables for other pages |
//!
//! A new choice, such as another surface, is a row of an experiment, or an experiment more.

mod bound;
mod experiments;
mod machine;
mod measures;
mod overview;
mod page;
mod pictures;
mod plot;
mod rays;
mod rows;
mod table;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

pub use machine::Machine;
pub use rows::{Costs, Drawn, Errors, Experiment, Metric, Row};

use crate::atomic::AtomicFile;
use crate::builder::Progress;
use crate::error::Error;
use crate::jobs::batch::NewFolders;
use crate::jobs::open_model::open_model;
use crate::synthetic;
use crate::text::{Count, shown};

/// Subjects and settings of a report.
#[derive(Clone, Debug)]
pub struct ReportRequest {
    /// A finished model.
    pub model: Option<PathBuf>,
    /// Synthetic volumes, as `NAME`, `NAME@N` or `NAME@N?key=value`, with or without `synthetic:` before it; `suite`
    /// stands for several bodies.
    pub synthetic: Vec<String>,
    /// Folder of the page and the tables; made if it is not there.
    pub out: PathBuf,
    /// Most worker threads that are tried.
    pub threads: usize,
    /// Pixels along a side of the pictures that errors are measured on.
    pub pixels: u32,
    /// The command as it was typed, for the page.
    pub command: String,
}

/// The measurements: errors are the same on every run, costs are those of this machine.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Report {
    /// Command line, quoted for a shell.
    pub command: String,
    /// Machine of the measurement.
    pub machine: Machine,
    /// One for each choice that trades time or memory against error.
    pub experiments: Vec<Experiment>,
    /// Seconds from start to end.
    pub wall_s: f64,
    /// The files written.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
}

/// The bodies of `suite`: the signals that surfaces and normals are judged by.
const SUITE: [&str; 7] = [
    "sphere@128",
    "torus@128",
    "box@128",
    "sphere@128?noise=0.025",
    "sphere@128?sample=binary",
    "sphere@128?spacing=1x1x6,slab=1",
    "torus@128?spacing=1x1x6,slab=1",
];

/// Size of a body, and of the head, if none is given.
const USUAL_SIDES: [u32; 2] = [128, 256];

/// Measures, and writes `report.html`, `report.csv`, `report.json` and `report.md`, and each drawing as `ID.svg`.
///
/// Cost: on the head of 256^3 voxels some 20 seconds on two cores. Memory: some models at a time in files, the rest as
/// pictures.
///
/// # Errors
/// A name that is not known, a model that cannot be opened, or a folder that cannot be written.
pub fn report(request: &ReportRequest, progress: &dyn Progress) -> Result<Report, Error> {
    let started = Instant::now();
    let failed = |cause| Error::Output { path: request.out.clone(), cause };
    let _new = NewFolders::create(&request.out).map_err(failed)?;
    let work = tempfile::tempdir_in(&request.out).map_err(failed)?;
    let bench = experiments::Bench {
        folder: work.path(),
        threads: request.threads,
        pixels: request.pixels,
        progress,
    };
    let subjects = subjects(&request.synthetic);
    // Whatever cannot be is reported before anything is measured.
    for subject in &subjects {
        synthetic::open(Path::new(subject))?;
    }
    let model = request.model.as_ref().map(|path| open_model(path).map(|model| (path, model))).transpose()?;
    let mut experiments = Vec::new();
    let of_model = model.as_ref().map_or(0, |_| experiments::OF_MODEL);
    progress.stage("measure", subjects.len() as u64 * experiments::OF_SYNTHETIC + of_model);
    for subject in &subjects {
        for found in bench.of_synthetic(subject)? {
            rows::join(&mut experiments, found);
        }
    }
    let mut voxel_mm = None;
    if let Some((path, model)) = &model {
        let name = path.file_name().map_or_else(|| "model".into(), |n| shown(n).to_string());
        for found in bench.of_model(model, &name)? {
            rows::join(&mut experiments, found);
        }
        model.check_unchanged(path)?;
        // Samples of synthetic bodies have no size of their own.
        let finest = model.metadata().spacing_mm.into_iter().fold(f64::INFINITY, f64::min);
        voxel_mm = Some(finest).filter(|_| subjects.is_empty());
    }
    if let Some(first) = overview::overview(&experiments, voxel_mm) {
        experiments.insert(0, first);
    }
    rows::mark_fronts(&mut experiments);
    let mut report = Report {
        command: request.command.clone(),
        machine: Machine::here(),
        experiments,
        wall_s: started.elapsed().as_secs_f64(),
        files: Vec::new(),
    };
    let mut files = vec![
        ("report.html".to_owned(), page::page(&report)),
        ("report.csv".to_owned(), report.csv()),
        ("report.json".to_owned(), serde_json::to_string_pretty(&report).unwrap_or_default() + "\n"),
        ("report.md".to_owned(), table::tables(&report)),
    ];
    files.extend(page::drawings(&report));
    for (name, text) in files {
        let path = request.out.join(name);
        let failed = |cause| Error::Output { path: path.clone(), cause };
        let file = AtomicFile::create(&path).map_err(failed)?;
        file.file().write_all(text.as_bytes()).map_err(failed)?;
        file.commit().map_err(failed)?;
        report.files.push(path);
    }
    Ok(report)
}

/// Descriptions with everything that may be left out.
fn subjects(names: &[String]) -> Vec<String> {
    let whole = |name: &str| {
        let name = name.strip_prefix("synthetic:").unwrap_or(name);
        let (front, keys) = name.split_at(name.find('?').unwrap_or(name.len()));
        let size = match front {
            _ if front.contains('@') => String::new(),
            "head" => format!("@{}", USUAL_SIDES[1]),
            _ => format!("@{}", USUAL_SIDES[0]),
        };
        format!("synthetic:{front}{size}{keys}")
    };
    let all =
        names.iter().flat_map(|name| if name == "suite" { SUITE.to_vec() } else { vec![name.as_str()] });
    all.map(whole).collect()
}

impl Report {
    /// One line for each row, with a head.
    pub(crate) fn csv(&self) -> String {
        let mut text = format!(
            "experiment,subject,choice,default,on_front,{},{}\n",
            Costs::NAMES.join(","),
            Metric::all().map(Metric::key).join(",")
        );
        for experiment in &self.experiments {
            for row in &experiment.rows {
                text.push_str(&row.csv(experiment.id));
            }
        }
        text
    }

    /// A few lines for people.
    pub fn text(&self) -> String {
        let rows: usize = self.experiments.iter().map(|e| e.rows.len()).sum();
        let verdict = self.experiments.first().and_then(|first| first.advice.as_deref());
        let mut text = verdict.map(|verdict| format!("{verdict}\n")).unwrap_or_default();
        let _ = writeln!(
            text,
            "{} in {}, {:.1} s",
            Count(rows, "measurement"),
            Count(self.experiments.len(), "experiment"),
            self.wall_s
        );
        for file in &self.files {
            text.push_str(&format!("  {}\n", shown(file)));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_completed() {
        let all = subjects(&[
            "torus".into(),
            "synthetic:head".into(),
            "box@64?noise=0.1".into(),
            "salt?cell=2".into(),
        ]);
        assert_eq!(
            all,
            [
                "synthetic:torus@128",
                "synthetic:head@256",
                "synthetic:box@64?noise=0.1",
                "synthetic:salt@128?cell=2"
            ]
        );
        assert_eq!(subjects(&["suite".into()]).len(), SUITE.len());
    }
}
