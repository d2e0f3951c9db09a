//! The experiments: on a body with a known surface, on any volume, on a finished model.

use std::fs;
use std::path::Path;

use super::rays::{self, Line, Met};
use super::rows::{Costs, Drawn, Errors, Experiment, Metric, Row, Times};
use crate::budget::{Bytes, MemoryCap};
use crate::builder::{BuildOptions, Gradient, Silent, Threshold, build_volume};
use crate::error::Error;
use crate::format::SurfaceKind;
use crate::jobs::info::surface_boxes;
use crate::load::{Model, NodeView};
use crate::progress::Progress;
use crate::render::GridSpace;
use crate::synthetic::{self, AnalyticVolume, SyntheticHead};
use crate::volume::VolumeSource;

/// Where and how things are tried.
pub(super) struct Bench<'a> {
    /// A folder for models.
    pub(super) folder: &'a Path,
    pub(super) threads: usize,
    pub(super) pixels: u32,
    /// Watcher of the experiments, one step each.
    pub(super) progress: &'a dyn Progress,
}

/// Steps of a synthetic volume, those that do not apply included, and of a model.
pub(super) const OF_SYNTHETIC: u64 = 8;
pub(super) const OF_MODEL: u64 = 2;

/// Caps that are tried, in MiB.
const BUDGETS_MIB: [u64; 6] = [1, 2, 4, 8, 16, 64];
/// Coarsest boxes that are shown: edges of 2^4 voxels.
const COARSEST: u32 = 4;

/// The reference of rays.
enum Reference<'a> {
    Body(&'a AnalyticVolume),
    Frame(&'a [Option<Met>]),
}

/// A model in its file, and how it was built.
pub(super) struct Built {
    pub(super) model: Model,
    pub(super) costs: Costs,
}

impl Bench<'_> {
    /// All experiments that make sense on a synthetic volume.
    pub(super) fn of_synthetic(&self, input: &str) -> Result<Vec<Experiment>, Error> {
        let subject = input.strip_prefix("synthetic:").unwrap_or(input);
        let source = synthetic::open(Path::new(input))?;
        // The head is in Hounsfield units; bodies are densities.
        let body = synthetic::analytic(input).ok();
        let smooth = body.as_ref().filter(|body| body.body().is_smooth());
        let iso = if body.is_some() { 0.5 } else { SyntheticHead::BONE_ISO_HU };
        let options = BuildOptions {
            threshold: Threshold::Iso(iso),
            surface: Some(SurfaceKind::Skin),
            threads: self.threads,
            memory: MemoryCap::Share(256 << 20),
            scratch: Some(self.folder.to_path_buf()),
            ..BuildOptions::default()
        };
        let usual = self.build(&*source, &options)?;
        let mut found = Vec::new();
        if let Some(body) = smooth {
            found.extend(self.done(self.surfaces(subject, &*source, &options, body))?);
            found.push(self.done(self.gradients(subject, &*source, &options, body))?);
            found.push(self.done(self.detail(subject, &usual.model, &Reference::Body(body)))?);
        } else {
            let frame = self.frame(&usual.model)?;
            found.push(self.done(self.detail(subject, &usual.model, &Reference::Frame(&frame)))?);
            self.progress.advance(2);
        }
        found.push(self.done(self.bounds(subject, &*source, &options, smooth))?);
        match smooth.filter(|b| b.body().is_closed()) {
            Some(body) => found.push(self.done(self.measures(subject, &options, body))?),
            None => self.progress.advance(1),
        }
        found.push(self.done(self.frames(subject, &usual.model))?);
        found.push(self.done(self.budgets(subject, &*source, &options, &usual))?);
        found.push(self.done(self.thread_counts(subject, &*source, &options, &usual))?);
        Ok(found)
    }

    /// A result whose experiment is a step of progress.
    fn done<T>(&self, found: Result<T, Error>) -> Result<T, Error> {
        let found = found?;
        self.progress.step(1).map_err(|_| Error::Stopped)?;
        Ok(found)
    }

    /// The experiments on a finished model, which need no true surface.
    pub(super) fn of_model(
        &self,
        model: &Model<impl AsRef<[u8]> + Sync>,
        subject: &str,
    ) -> Result<Vec<Experiment>, Error> {
        let frame = self.frame(model)?;
        Ok(vec![
            self.done(self.detail(subject, model, &Reference::Frame(&frame)))?,
            self.done(self.frames(subject, model))?,
        ])
    }

    /// Builds a model several times and opens it.
    pub(super) fn build(&self, source: &dyn VolumeSource, options: &BuildOptions) -> Result<Built, Error> {
        let path = self.folder.join("model.oct");
        let (times, last) = Times::measured(|| build_volume(source, options, &path, &Silent))?;
        // The name is free again: the open file is what is looked at.
        let model = Model::open(&path)?;
        let _ = fs::remove_file(&path);
        let costs = Costs {
            build_s: Some(times.median()),
            memory_bytes: Some(last.plan_bytes),
            file_bytes: Some(last.file_bytes),
            boxes: Some(surface_boxes(model.frame())),
            spread_percent: Some(times.spread_percent()),
            ..Costs::default()
        };
        Ok(Built { model, costs })
    }

    pub(super) fn lines(&self, model: &Model<impl AsRef<[u8]>>) -> Result<(GridSpace, Vec<Line>), Error> {
        let space = GridSpace::new(model.dims(), &model.affine())?;
        let lines = rays::lines(&space, model, self.pixels)?;
        Ok((space, lines))
    }

    /// The full-quality frame.
    fn frame(&self, model: &Model<impl AsRef<[u8]> + Sync>) -> Result<Vec<Option<Met>>, Error> {
        let (_, lines) = self.lines(model)?;
        rays::cast(model, &lines, self.threads)
    }

    pub(super) fn row(
        subject: &str,
        choice: impl Into<String>,
        usual: bool,
        costs: Costs,
        errors: Errors,
    ) -> Row {
        Row { subject: subject.into(), choice: choice.into(), usual, on_front: false, costs, errors }
    }

    /// Every kind of surface.
    fn surfaces(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        body: &AnalyticVolume,
    ) -> Result<[Experiment; 2], Error> {
        let (mut rows, mut shadings) = (Vec::new(), Vec::new());
        for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
            let built = self.build(source, &BuildOptions { surface: Some(surface), ..options.clone() })?;
            let (space, lines) = self.lines(&built.model)?;
            let met = rays::cast(&built.model, &lines, self.threads)?;
            let (_, times) = rays::cast_boxes(&space, &built.model, &lines, 0);
            let costs = built.costs.with_rays(&times);
            let errors = rays::against_body(&met, &lines, body, self.threads)?;
            // The command builds cells.
            let usual = surface == SurfaceKind::Cells;
            rows.push(Self::row(subject, surface.name(), usual, costs, errors));
            shadings.extend(self.shadings(subject, &built.model, body)?);
        }
        let surfaces = Experiment {
            id: "surface",
            title: "Where a hit lies",
            about: "Distance of every hit pixel from the body's true surface, normals read back from the file at the hit, and pixels that hit where the true body does not or the other way round; three perspective pictures. Skin are voxels with their faces, cells lie between the samples and hold a plane each.".into(),
            drawn: Drawn { cost: 3, metric: Metric::DepthRms },
            rows,
            ..Experiment::default()
        };
        let shadings = Experiment {
            id: "shading",
            title: "Which normals a picture shows",
            about: "Angle between the normal that a pixel is shaded by and the body's true one: as stored for the box that was hit, or blended with those of the boxes around the hit. The time is that of one ray on one thread, blending included.".into(),
            drawn: Drawn { cost: 1, metric: Metric::NormalMean },
            rows: shadings,
            ..Experiment::default()
        };
        Ok([surfaces, shadings])
    }

    fn gradients(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        body: &AnalyticVolume,
    ) -> Result<Experiment, Error> {
        let mut rows = Vec::new();
        for gradient in Gradient::ALL {
            let built = self.build(source, &BuildOptions { gradient: Some(gradient), ..options.clone() })?;
            let (_, lines) = self.lines(&built.model)?;
            let met = rays::cast(&built.model, &lines, self.threads)?;
            // Where hits lie does not depend on it.
            let errors = rays::against_body(&met, &lines, body, self.threads)?.only_normals();
            rows.push(Self::row(
                subject,
                gradient.name(),
                gradient == Gradient::default(),
                built.costs,
                errors,
            ));
        }
        Ok(Experiment {
            id: "gradient",
            title: "How normals are estimated",
            about: "Angle between the normal at the hit, read back from the file, and the body's true normal at the nearest point of its surface.".into(),
            drawn: Drawn { cost: 0, metric: Metric::NormalMean },
            rows,
            ..Experiment::default()
        })
    }

    fn detail(
        &self,
        subject: &str,
        model: &Model<impl AsRef<[u8]>>,
        reference: &Reference<'_>,
    ) -> Result<Experiment, Error> {
        let (space, lines) = self.lines(model)?;
        let voxel_mm = model.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let mut rows = Vec::new();
        for k in 0..=COARSEST.min(model.view().depth()) {
            let (met, times) = rays::cast_boxes(&space, model, &lines, k);
            let errors = match reference {
                Reference::Body(body) => rays::against_body(&met, &lines, body, self.threads)?,
                Reference::Frame(frame) => rays::against_frame(&met, frame, &lines, (voxel_mm, 1 << k)),
            };
            let costs =
                Costs { file_bytes: Some(model.header().file_bytes), ..Costs::default() }.with_rays(&times);
            let edge = 1_u32 << k;
            let choice = if k == 0 { "voxels".to_owned() } else { format!("boxes of {edge}") };
            rows.push(Self::row(subject, choice, k == 0, costs, errors));
        }
        let (id, about) = match reference {
            Reference::Body(_) => (
                "detail",
                "Rays that stop at boxes of several voxels, against the body's true surface; one ray after the other, on one thread. Boxes of 2 voxels have no normals of their own.",
            ),
            Reference::Frame(_) => (
                "detail_of_frame",
                "Rays that stop at boxes of several voxels, against the full-quality frame of the same model: the true surface is not known here, so the first row is 0 by definition. One ray after the other, on one thread.",
            ),
        };
        Ok(Experiment {
            id,
            title: "Level of detail",
            about: about.into(),
            drawn: Drawn { cost: 1, metric: Metric::DepthRms },
            rows,
            ..Experiment::default()
        })
    }

    /// Costs of a build, and the bytes in which its model differs from the usual one, missing ones included.
    fn rebuild(
        &self,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        usual: &Built,
    ) -> Result<(Costs, Errors), Error> {
        let built = self.build(source, options)?;
        let (a, b) = (built.model.bytes(), usual.model.bytes());
        let other = a.iter().zip(b).filter(|(a, b)| a != b).count() + a.len().abs_diff(b.len());
        let errors = Errors::default().with(Metric::DifferentBytes, other as f64);
        Ok((Costs { file_bytes: None, boxes: None, ..built.costs }, errors))
    }

    fn budgets(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        usual: &Built,
    ) -> Result<Experiment, Error> {
        let mut rows = Vec::new();
        for mib in BUDGETS_MIB {
            let memory = MemoryCap::Share(mib << 20);
            let options = BuildOptions { memory, ..options.clone() };
            let (costs, errors) = match self.rebuild(source, &options, usual) {
                Err(Error::Build(error)) if error.minimum_bytes().is_some() => continue,
                rebuilt => rebuilt?,
            };
            rows.push(Self::row(subject, Bytes(mib << 20).to_string(), mib == 64, costs, errors));
        }
        Ok(Experiment {
            id: "budget",
            title: "How little memory a build takes",
            about: "Time of a build within a cap on its own memory; the model is the same, byte for byte. Caps that are too small are left out.".into(),
            drawn: Drawn { cost: 0, metric: Metric::DifferentBytes },
            rows,
            ..Experiment::default()
        })
    }

    fn thread_counts(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        usual: &Built,
    ) -> Result<Experiment, Error> {
        let counts = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < self.threads);
        let mut rows = Vec::new();
        for threads in counts.chain([self.threads]) {
            let options = BuildOptions { threads, ..options.clone() };
            let (costs, errors) = self.rebuild(source, &options, usual)?;
            rows.push(Self::row(subject, threads.to_string(), threads == self.threads, costs, errors));
        }
        Ok(Experiment {
            id: "threads",
            title: "What more threads bring",
            about: "Time of a build by the number of its threads; the model is the same, byte for byte."
                .into(),
            drawn: Drawn { cost: 0, metric: Metric::DifferentBytes },
            rows,
            ..Experiment::default()
        })
    }
}
