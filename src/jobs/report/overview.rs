//! The first figure of a report: a few settings, the error of each against its time, and a verdict in one sentence.
//!
//! Several subjects are one: each value is the median over them, the greatest distance the greatest of all.

use std::cmp::Ordering;

use super::rows::{Costs, Drawn, Errors, Experiment, Metric, Row};
use crate::text::Short;
use crate::text::names::{COMPARE, ERROR, THICKNESS};

/// Loss of accuracy, in voxels, that a verdict accepts: less than the cells themselves are off in noise.
const HARDLY_SEEN: f64 = 0.05;
/// Columns of the first table.
const SHOWN: [Metric; 4] = [Metric::DepthRms, Metric::DepthMax, Metric::WrongPixels, Metric::NormalMean];

/// A setting of the first table: its name there, and the experiment and choice that measure it.
type Setting = (&'static str, &'static str, &'static str);

const BODY: [Setting; 5] = [
    ("surface skin", "surface", "skin"),
    ("cells (default)", "bound", "cells"),
    ("error 0.1", "bound", "0.1"),
    ("error 0.2", "bound", "0.2"),
    ("error 0.5", "bound", "0.5"),
];
const FRAME: [Setting; 5] = [
    ("cells (default)", "bound_of_frame", "cells"),
    ("error 0.05", "bound_of_frame", "0.05"),
    ("error 0.1", "bound_of_frame", "0.1"),
    ("error 0.2", "bound_of_frame", "0.2"),
    ("error 0.5", "bound_of_frame", "0.5"),
];
const MODEL: [Setting; 5] = [
    ("every voxel (default)", "detail_of_frame", "voxels"),
    ("boxes of 2", "detail_of_frame", "boxes of 2"),
    ("boxes of 4", "detail_of_frame", "boxes of 4"),
    ("boxes of 8", "detail_of_frame", "boxes of 8"),
    ("boxes of 16", "detail_of_frame", "boxes of 16"),
];

/// The first experiment of a report, or nothing if none of its settings was measured.
///
/// `voxel_mm` is the finest spacing of the only subject, if it has one.
pub(super) fn overview(experiments: &[Experiment], voxel_mm: Option<f64>) -> Option<Experiment> {
    let (reference, time, rows) = [
        ("the true surface, at the true threshold (Otsu's adds an error of its own)", 0, BODY),
        ("the finest cells, as the true surface is not known", 0, FRAME),
        ("the picture of every voxel", 1, MODEL),
    ]
    .into_iter()
    .map(|(reference, time, settings)| (reference, time, rows(experiments, settings)))
    .find(|(.., rows)| rows.len() > 1)?;
    let drawn = Drawn { cost: time, metric: Metric::DepthRms };
    Some(Experiment {
        id: "overview",
        title: "Which setting to choose",
        about: format!(
            "Distance of the hits from {reference}, against the time of {}. Up is wrong, right is slow; the filled dot is the default.",
            if time == 0 { "a build" } else { "a ray on one thread" }
        )
        .into(),
        advice: verdict(&rows, drawn, voxel_mm),
        drawn,
        rows,
        pictures: Vec::new(),
    })
}

fn rows(experiments: &[Experiment], settings: [Setting; 5]) -> Vec<Row> {
    let measured = |(name, experiment, choice): Setting| {
        let of = experiments.iter().find(|e| e.id == experiment)?;
        let all: Vec<&Row> = of.rows.iter().filter(|row| row.choice == choice).collect();
        let subject = match all[..] {
            [] => return None,
            [one] => one.subject.clone(),
            _ => format!("{} bodies: medians, max of all", all.len()),
        };
        let cost = |place: usize| median(all.iter().filter_map(|row| row.costs.values()[place]));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bytes of a file")]
        let costs = Costs {
            build_s: cost(0),
            ns_per_ray: cost(1),
            file_bytes: cost(3).map(|bytes| bytes as u64),
            spread_percent: cost(5),
            ..Costs::default()
        };
        let errors = SHOWN.into_iter().fold(Errors::default(), |errors, metric| {
            let values = all.iter().filter_map(|row| row.errors.get(metric));
            let value = if metric == Metric::DepthMax { values.reduce(f64::max) } else { median(values) };
            errors.with(metric, value)
        });
        let usual = name.ends_with("(default)");
        Some(Row { subject, choice: name.into(), usual, on_front: false, costs, errors })
    };
    settings.into_iter().filter_map(measured).collect()
}

/// The middle value; the greater one of two.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

/// The default, and the cheapest setting that is hardly less accurate, with its gain, its cost, and what refuses it.
fn verdict(rows: &[Row], drawn: Drawn, voxel_mm: Option<f64>) -> Option<String> {
    let usual = rows.iter().find(|row| row.usual)?;
    let rms = |row: &Row| row.errors.get(Metric::DepthRms);
    let time = |row: &Row| row.costs.values()[drawn.cost];
    let (now, most) = (rms(usual)?, rms(usual)? + HARDLY_SEEN);
    let off = |row: &Row| {
        let (rms, most) = (rms(row)?, row.errors.get(Metric::DepthMax)?);
        let mm = |voxels| voxel_mm.map(|mm| format!(" ({} mm)", Short(voxels * mm))).unwrap_or_default();
        let (median, of_all) = if row.subject.contains("medians") {
            (" (median of the bodies)", " in all of them")
        } else {
            ("", "")
        };
        Some(format!("{rms:.3} voxel{} RMS{median}, {most:.2}{} at most{of_all}", mm(rms), mm(most)))
    };
    let keep = if now > 0.0 {
        format!("Keep the default, which is off by {}", off(usual)?)
    } else {
        "The finest level is what the others are measured by".into()
    };
    let chosen = rows.iter().rfind(|row| !row.usual && rms(row).is_some_and(|rms| rms <= most));
    let Some(chosen) = chosen else {
        let others = rows.iter().filter(|row| !row.usual);
        let next = others.min_by(|a, b| rms(a).partial_cmp(&rms(b)).unwrap_or(Ordering::Equal))?;
        let (next, off) = (&next.choice, off(next)?);
        return Some(if now > 0.0 {
            format!(
                "{keep}; no other setting comes within {HARDLY_SEEN} voxel of that, {next} is off by {off}."
            )
        } else {
            format!(
                "These are levels of detail of one model, measured by its finest: {next} is off by {off}. Settings of builds are compared on synthetic bodies, whose surface is known."
            )
        });
    };
    let percent = |now: Option<f64>, before: Option<f64>| Some(100.0 * now? / before?);
    let bytes = percent(chosen.costs.values()[3], usual.costs.values()[3])?;
    let gain = format!(
        "{}, {bytes:.0} % of the bytes, {:.0} % of the time",
        off(chosen)?,
        percent(time(chosen), time(usual))?
    );
    Some(match chosen.choice.strip_prefix("error ") {
        Some(bound) => format!(
            "{keep}: every command takes its models. Where files are only looked at or exported, larger leaves ({ERROR} {bound}) save room: {gain}; {COMPARE} and {THICKNESS} refuse to measure them."
        ),
        None => format!("{keep}; faster is {}: {gain}.", chosen.choice),
    })
}
