//! `oct demo`: build under a cap, verify and render a synthetic head, without any data.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;

use super::build::{BuildFigures, BuildJob, BuildSummary, GridOptions};
use super::picture::{Outputs, refuse_clash, render_file, thumbnail_file};
use super::render::RenderRequest;
use super::verify::verify_file;
use crate::atomic::AtomicFile;
use crate::budget::{Bytes, peak_rss_bytes};
use crate::builder::{BuildOptions, Progress};
use crate::clean::CleanOptions;
use crate::error::Error;
use crate::fault::usage;
use crate::source::Subject;
use crate::synthetic::SyntheticHead;
use crate::text::{Count, data, shown};
use crate::volume::{Endian, VolumeSource};

/// Files that the demonstration writes: the model, and beside it a picture and a thumbnail.
#[derive(Clone, Debug)]
pub struct DemoFiles {
    /// The model.
    pub model: PathBuf,
    /// A picture of 1024 x 1024.
    pub picture: PathBuf,
    /// A thumbnail of 256 x 256.
    pub thumbnail: PathBuf,
}

impl DemoFiles {
    /// `head.oct` gives `head.png` and `head-thumb.png`.
    pub fn beside(model: &Path, picture: Option<&Path>) -> Self {
        let stem = model.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self {
            model: model.to_path_buf(),
            picture: picture.map_or_else(|| model.with_extension("png"), Path::to_path_buf),
            thumbnail: model.with_file_name(format!("{stem}-thumb.png")),
        }
    }
}

/// Reports of the steps of a demonstration.
#[derive(Clone, Debug)]
pub struct DemoSummary {
    files: DemoFiles,
    built: BuildSummary,
    build_peak_bytes: u64,
    verify_s: f64,
    render_s: f64,
    thumbnail_s: f64,
}

/// The report of a demonstration for `--json`.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DemoFigures {
    /// The build.
    #[serde(flatten)]
    pub build: BuildFigures,
    /// The picture written.
    pub picture: String,
    /// The thumbnail written.
    pub thumbnail: String,
    /// Seconds of checking every invariant.
    pub verify_s: f64,
    /// Seconds of making the picture.
    pub render_s: f64,
    /// Seconds of making the thumbnail.
    pub thumbnail_s: f64,
    /// Always true: every invariant holds.
    pub verified: bool,
}

/// Builds, verifies and renders a synthetic head of `side` voxels along each axis.
///
/// # Errors
/// As the single steps; `side` out of range is wrong usage.
pub fn demo(
    side: u32,
    options: &BuildOptions,
    files: &DemoFiles,
    threads: usize,
    progress: &dyn Progress,
) -> Result<DemoSummary, Error> {
    let head = head_of(side)?;
    refuse_clash(&files.model, &[&files.picture, &files.thumbnail])?;
    let name = format!("synthetic head {side}");
    let (clean, grid) = (CleanOptions::default(), GridOptions::default());
    let job = BuildJob { clean: &clean, grid: &grid, options, output: &files.model, progress };
    let built = job.build(Subject::Volume(Box::new(head)), name, Instant::now())?;
    // Taken here: the steps that follow map the whole file.
    let build_peak_bytes = peak_rss_bytes();
    let timed = |step: &mut dyn FnMut() -> Result<(), Error>| -> Result<f64, Error> {
        let started = Instant::now();
        step()?;
        Ok(started.elapsed().as_secs_f64())
    };
    progress.stage("verify", 1);
    let verify_s = timed(&mut || verify_file(&files.model).map(|_| ()))?;
    let request = RenderRequest { threads, ..RenderRequest::default() };
    progress.stage("render", 1);
    let render_s = timed(&mut || {
        render_file(&files.model, &Outputs::of(&files.picture), &request, progress).map(|_| ())
    })?;
    let thumbnail_s =
        timed(&mut || thumbnail_file(&files.model, &files.thumbnail, 256, threads).map(|_| ()))?;
    Ok(DemoSummary { files: files.clone(), built, build_peak_bytes, verify_s, render_s, thumbnail_s })
}

/// Writes the synthetic head as a raw volume: 16-bit signed, little-endian, x fastest.
///
/// # Errors
/// The size is out of range, or the file cannot be written; nothing is left behind then.
pub fn write_raw(side: u32, path: &Path) -> Result<(), Error> {
    let head = head_of(side)?;
    let failed = |cause| Error::Output { path: path.to_path_buf(), cause };
    let file = AtomicFile::create(path).map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 18, file.file());
    let mut row = vec![0; side as usize * 2];
    for (z, y) in (0..side).flat_map(|z| (0..side).map(move |y| (z, y))) {
        head.read_rows(z, y..y + 1, 0..side, &mut row)?;
        // Samples are in the machine's order; the conversion to little-endian is the same as from it.
        Endian::Little.to_native(2, &mut row);
        out.write_all(&row).map_err(failed)?;
    }
    out.flush().map_err(failed)?;
    drop(out);
    file.commit().map_err(failed)
}

impl DemoSummary {
    /// The report for `--json`.
    pub fn json(&self) -> DemoFigures {
        DemoFigures {
            build: BuildFigures { peak_rss_bytes: self.build_peak_bytes, ..self.built.json() },
            picture: data(&self.files.picture),
            thumbnail: data(&self.files.thumbnail),
            verify_s: self.verify_s,
            render_s: self.render_s,
            thumbnail_s: self.thumbnail_s,
            verified: true,
        }
    }

    /// A short table.
    pub fn text(&self) -> String {
        let r = &self.built.report;
        let raw = self.built.info.frame.metadata.source.bytes;
        let ratio = |a: u64, b: u64| a as f64 / b.max(1) as f64;
        let rows = [
            (
                "volume",
                format!("{} synthetic CT head, {} as a stream", self.built.info.frame.dims(), Bytes(raw)),
            ),
            ("model", format!("{} ({})", shown(&self.files.model), Bytes(r.file_bytes))),
            ("cells", format!("{} in {} nodes", r.skin_voxels, r.nodes)),
            ("bytes per cell", format!("{:.3}", ratio(r.file_bytes, r.skin_voxels))),
            ("smaller than the volume", format!("{:.0} times", ratio(raw, r.file_bytes))),
            (
                "peak resident memory",
                format!("{} of {} allowed", Bytes(self.build_peak_bytes), Bytes(self.built.memory_bytes)),
            ),
            (
                "build",
                format!(
                    "{:.2} s, making the volume included, {}",
                    self.built.wall_s,
                    Count(r.threads, "thread")
                ),
            ),
            ("verify", format!("{:.2} s, every invariant holds", self.verify_s)),
            ("picture", format!("{} in {:.3} s", shown(&self.files.picture), self.render_s)),
            ("thumbnail", format!("{} in {:.3} s", shown(&self.files.thumbnail), self.thumbnail_s)),
        ];
        rows.iter().map(|(name, text)| format!("{name:<24}{text}\n")).collect()
    }
}

fn head_of(side: u32) -> Result<SyntheticHead, Error> {
    let refused = || usage!("a head of {side} voxels a side cannot be made; choose 1 to 65536");
    Ok(SyntheticHead::new(side).ok_or_else(refused)?)
}
