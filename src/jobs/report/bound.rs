//! Errors and savings of larger leaves within a bound (`--error`).

use super::experiments::Bench;
use super::rays;
use super::rows::{Costs, Drawn, Experiment, Metric};
use crate::builder::{BuildOptions, Tolerance};
use crate::error::Error;
use crate::format::SurfaceKind;
use crate::jobs::export::{STILL, still};
use crate::progress::Silent;
use crate::synthetic::AnalyticVolume;
use crate::volume::VolumeSource;

/// Bounds that are tried, in voxels of the finest spacing; 0 joins nothing.
const BOUNDS: [f64; 5] = [0.0, 0.05, 0.1, 0.2, 0.5];
/// The bound whose picture stands beside the curves.
const SHOWN: f64 = 0.1;

impl Bench<'_> {
    /// Models of cells within bounds, against the body's true surface, or against the fine cells.
    pub(super) fn bounds(
        &self,
        subject: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
        body: Option<&AnalyticVolume>,
    ) -> Result<Experiment, Error> {
        let (mut rows, mut pictures) = (Vec::new(), Vec::new());
        let mut fine = None;
        for bound in BOUNDS {
            let error = (bound > 0.0).then_some(Tolerance::Voxels(bound));
            let options = BuildOptions { surface: Some(SurfaceKind::Cells), error, ..options.clone() };
            let built = self.build(source, &options)?;
            let (space, lines) = self.lines(&built.model)?;
            // The same rays through every model.
            let (lines, frame) = match &fine {
                Some((lines, frame)) => (lines, frame),
                None => {
                    let frame = rays::cast(&built.model, &lines, self.threads)?;
                    let (lines, frame) = fine.insert((lines, frame));
                    (&*lines, &*frame)
                }
            };
            let met = rays::cast(&built.model, lines, self.threads)?;
            let (_, times) = rays::cast_boxes(&space, &built.model, lines, 0);
            let voxel_mm = built.model.affine().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
            let errors = match body {
                Some(body) => rays::against_body(&met, lines, body, self.threads)?,
                None => rays::against_frame(&met, frame, lines, (voxel_mm, 1)),
            };
            let costs = Costs { memory_bytes: None, ..built.costs.with_rays(&times) };
            let choice = if bound == 0.0 { "cells".to_owned() } else { format!("{bound}") };
            rows.push(Self::row(subject, choice, bound == 0.0, costs, errors));
            if bound == SHOWN {
                pictures.push((subject.to_owned(), still(&built.model, STILL, &[], &Silent)?));
            }
        }
        let reference = match body {
            Some(_) => "the body's true surface",
            None => "the fine cells in the same pictures: the first row is 0 by definition",
        };
        Ok(Experiment {
            id: if body.is_some() { "bound" } else { "bound_of_frame" },
            title: "How far larger leaves may lie from the surface",
            about: format!(
                "Cells are joined into leaves within so many voxels of the surface. Distances and normals of the hits of three perspective pictures are held against {reference}. Rays go one by one on one thread. Pictures below are of the bound {SHOWN}."
            )
            .into(),
            drawn: Drawn { cost: 3, metric: Metric::DepthRms },
            rows,
            pictures,
            ..Experiment::default()
        })
    }
}
