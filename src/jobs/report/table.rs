//! `report.md`: the tables of the page as Markdown, for pages that are written by hand.

use std::fmt::Write;

use super::Report;
use super::rows::Experiment;

/// All tables, with the command and the machine before them.
pub(super) fn tables(report: &Report) -> String {
    let m = &report.machine;
    // Writing to a string cannot fail.
    let mut text = String::new();
    let _ = writeln!(
        text,
        "`{}`, infobyte {}, {} UTC, {}, {} cores. k, M and G stand for thousands, millions and thousand millions.",
        report.command, m.version, m.measured, m.processor, m.cores
    );
    for experiment in &report.experiments {
        table(experiment, &mut text);
    }
    text
}

fn table(experiment: &Experiment, text: &mut String) {
    let columns = experiment.columns();
    let _ = write!(text, "\n## {}\n\n", experiment.title);
    if let Some(advice) = &experiment.advice {
        let _ = write!(text, "{advice}\n\n");
    }
    text.push_str("| subject | choice |");
    for column in &columns {
        let _ = write!(text, " {} |", column.title());
    }
    text.push_str("\n|---|---|");
    text.push_str(&"---:|".repeat(columns.len()));
    text.push('\n');
    for row in &experiment.rows {
        let choice = cell(&row.choice);
        let choice = if row.usual { format!("**{choice}**") } else { choice };
        let _ = write!(text, "| {} | {choice} |", cell(&row.subject));
        for column in &columns {
            let _ = write!(text, " {} |", row.shown(*column));
        }
        text.push('\n');
    }
}

/// Text that cannot end a cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}
