//! `report.md`: the tables of the page as Markdown, for pages that are written by hand.

use std::fmt::Write;

use super::Report;
use super::plot::short;
use super::rows::{Costs, Experiment, Metric};

/// All tables, with the command and the machine before them.
pub(super) fn tables(report: &Report) -> String {
    let m = &report.machine;
    // Writing to a string cannot fail.
    let mut text = String::new();
    let _ = writeln!(
        text,
        "`{}`, infobyte {}, {} UTC, {}, {} cores.",
        report.command, m.version, m.measured, m.processor, m.cores
    );
    for experiment in &report.experiments {
        table(experiment, &mut text);
    }
    text
}

fn table(experiment: &Experiment, text: &mut String) {
    let costs: Vec<usize> = (0..Costs::NAMES.len())
        .filter(|c| experiment.rows.iter().any(|row| row.costs.values()[*c].is_some()))
        .collect();
    let metrics: Vec<Metric> = Metric::ALL
        .into_iter()
        .filter(|m| experiment.rows.iter().any(|row| row.errors.get(*m).is_some()))
        .collect();
    let _ = write!(text, "\n## {}\n\n| subject | choice |", experiment.title);
    for title in costs.iter().map(|c| Costs::TITLES[*c]).chain(metrics.iter().map(|m| m.title())) {
        let _ = write!(text, " {title} |");
    }
    text.push_str("\n|---|---|");
    text.push_str(&"---:|".repeat(costs.len() + metrics.len()));
    text.push('\n');
    for row in &experiment.rows {
        let choice = cell(&row.choice);
        let choice = if row.usual { format!("**{choice}**") } else { choice };
        let _ = write!(text, "| {} | {choice} |", cell(&row.subject));
        let values =
            costs.iter().map(|c| row.costs.values()[*c]).chain(metrics.iter().map(|m| row.errors.get(*m)));
        for value in values {
            let _ = write!(text, " {} |", value.map(short).unwrap_or_default());
        }
        text.push('\n');
    }
}

/// Text that cannot end a cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
