//! Samplings of a frame and shadings of pictures. One choice more is one entry of a table.

use std::convert::Infallible;

use super::experiments::Bench;
use super::rays::{self, Met};
use super::rows::{Costs, Drawn, Errors, Experiment, Metric, Row, Times};
use crate::error::Error;
use crate::format::normal;
use crate::jobs::render::{RenderRequest, render_view};
use crate::load::{Model, NodeView};
use crate::render::normals::blend;
use crate::render::{GridSpace, Image, Projection, picture};
use crate::synthetic::AnalyticVolume;

/// A way to make a frame.
struct Frame {
    choice: &'static str,
    usual: bool,
    /// By what the sides of the pictures are divided; the plain frame of the same size is the reference.
    smaller: u32,
    how: fn(RenderRequest) -> RenderRequest,
}

/// All of them; the first of each size is the plain one.
const FRAMES: [Frame; 4] = [
    Frame { choice: "every pixel", usual: true, smaller: 1, how: |plain| plain },
    Frame {
        choice: "discrete rays",
        usual: false,
        smaller: 1,
        how: |plain| RenderRequest { traversal: picture::Traversal::Discrete, ..plain },
    },
    Frame { choice: "small, every pixel", usual: false, smaller: 5, how: |plain| plain },
    Frame {
        choice: "small, boxes of about a pixel",
        usual: false,
        smaller: 5,
        how: |plain| RenderRequest { lod: true, ..plain },
    },
];

impl Bench<'_> {
    /// Every way to make a frame.
    pub(super) fn frames(&self, subject: &str, model: &Model<impl AsRef<[u8]>>) -> Result<Experiment, Error> {
        let space = GridSpace::new(model.dims(), &model.affine())?;
        let points = rays::points(&space, model);
        let mut plain: Option<(u32, Vec<Image>)> = None;
        let mut rows = Vec::new();
        for Frame { choice, usual, smaller, how } in FRAMES {
            // Discrete rays meet voxels, not the surfaces within cells.
            let discrete = how(RenderRequest::default()).traversal == picture::Traversal::Discrete;
            if discrete && model.view().cells().is_some() {
                continue;
            }
            let side = (self.pixels / smaller).max(1);
            let (times, images) = Times::of(|| {
                let (mut seconds, mut images) = (0.0, Vec::new());
                for point in points {
                    let request = how(RenderRequest {
                        size: Some([side; 2]),
                        point: Some(point),
                        projection: Some(Projection::Perspective),
                        fov_deg: Some(rays::FOV_DEG),
                        threads: 1,
                        ..RenderRequest::default()
                    });
                    let (image, report) =
                        render_view(&model.view(), model.dims(), &model.affine(), &request)?;
                    seconds += report.trace_s + report.shade_s;
                    images.push(image);
                }
                Ok::<_, Error>((seconds, images))
            })?;
            if plain.as_ref().is_none_or(|(of, _)| *of != side) {
                plain = Some((side, images.clone()));
            }
            let reference = plain.as_ref().map_or(&[][..], |(_, images)| images);
            let errors = Errors::default().with(Metric::Picture, difference(&images, reference));
            let pixels = f64::from(side) * f64::from(side) * points.len() as f64;
            let costs = Costs::default().with_rays(&times.scaled(1e9 / pixels));
            rows.push(Self::row(subject, choice, usual, costs, errors));
        }
        Ok(Experiment {
            id: "frame",
            title: "Whole pictures",
            about: "Three shaded perspective pictures on one thread, time for each pixel, against the frame of the same size with a ray through the middle of every pixel that stops at voxels: the discrete rays of the paper, coarse boxes. The difference is in grey levels of 0 to 255.".into(),
            drawn: Drawn { cost: 1, metric: Metric::Picture },
            rows,
            ..Experiment::default()
        })
    }

    /// Normals as they are stored, and blended with those around.
    pub(super) fn shadings(
        &self,
        subject: &str,
        model: &Model<impl AsRef<[u8]> + Sync>,
        body: &AnalyticVolume,
    ) -> Result<Vec<Row>, Error> {
        let (space, lines) = self.lines(model)?;
        let view = model.view();
        let stored = rays::cast(model, &lines, self.threads)?;
        let (_, times) = rays::cast_boxes(&space, model, &lines, 0);
        let surface = view.cells().map_or("skin", |_| "cells");
        let Ok((blending, blended)) = Times::measured(|| {
            let blended = stored
                .iter()
                .map(|met| {
                    let met = (*met)?;
                    let code = blend::find(&view, met.voxel).and_then(|voxel| view.voxel_normal(voxel))?;
                    let own = normal::decode_l1(code).map(f64::from);
                    let n = blend::blended(&view, space.to_grid(met.point), own);
                    let world = match view.cells() {
                        Some(_) => space.index_normal_to_world(n),
                        None => space.normal_to_world(n),
                    };
                    Some(Met { normal: Some(world), ..met })
                })
                .collect::<Vec<_>>();
            Ok::<_, Infallible>(blended)
        });
        let blending = blending.scaled(1e9 / lines.len().max(1) as f64);
        let stored_costs = Costs::default().with_rays(&times);
        let blended_costs = Costs {
            ns_per_ray: Some(times.median() + blending.median()),
            ..stored_costs.with_rays(&blending)
        };
        let mut rows = Vec::new();
        for (choice, usual, met, costs) in
            [("stored", true, &stored, stored_costs), ("blended", false, &blended, blended_costs)]
        {
            let errors = rays::against_body(met, &lines, body, self.threads)?.only_normals();
            rows.push(Self::row(subject, format!("{surface}, {choice}"), usual, costs, errors));
        }
        Ok(rows)
    }
}

/// Root of the mean square difference of two sets of pictures over black, in grey levels.
fn difference(a: &[Image], b: &[Image]) -> f64 {
    let over_black = |pixel: &[u8; 4]| {
        let alpha = f64::from(pixel[3]) / 255.0;
        [0, 1, 2].map(|c| f64::from(pixel[c]) * alpha)
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        for (a, b) in a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0) {
            let (a, b) = (over_black(a), over_black(b));
            sum += (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c])).sum::<f64>();
            count += 3.0;
        }
    }
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}
