//! Progress bars on a terminal; when piped nothing, or lines of a job of minutes; nothing when quiet or JSON.

use std::fmt;
use std::io::{IsTerminal, Write};
use std::sync::{Mutex, Once, PoisonError};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use infobyte::jobs::batch::{Cause, Item, NOTICE, Status, Watcher};
use infobyte::progress::Progress;
use infobyte::text::shown;

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Time of the stages after one, relative to its own: measured on a head of 512^3 samples.
const AFTER: [(&str, f64); 3] = [("histogram", 2.0), ("scan", 0.15), ("export", 0.2)];
/// Elapsed time before an estimate is shown.
const LEAST: Duration = Duration::from_secs(1);

/// Estimate of the remaining time of a job.
#[derive(Clone, Copy)]
struct Pace {
    is_picture: bool,
    after: f64,
}

impl Pace {
    fn new(stage: &str) -> Self {
        let after = AFTER.iter().find(|(name, _)| *name == stage).map_or(0.0, |(_, after)| *after);
        Self { is_picture: stage == "render", after }
    }

    /// Seconds to the end of the job; `None` before there is a pace. `part` of the stage is done.
    fn left_s(self, part: f64, elapsed: Duration) -> Option<f64> {
        let part = part.clamp(0.0, 1.0);
        // Rows of a picture usually show a disc: the first and the last hold little work.
        let beyond = 1.0 - 2.0 * part;
        let disc = (beyond.acos() - 2.0 * beyond * (part * (1.0 - part)).sqrt()) / std::f64::consts::PI;
        let part = if self.is_picture { disc } else { part };
        let of_stage = elapsed.as_secs_f64() * (1.0 - part) / part;
        (part > 0.0 && elapsed >= LEAST).then_some(of_stage + self.after * (elapsed.as_secs_f64() + of_stage))
    }

    /// The remaining time in words; empty before there is a pace.
    fn left(self, part: f64, elapsed: Duration) -> String {
        match self.left_s(part, elapsed) {
            Some(s) if s >= 100.0 => format!("{:.0} min left", s / 60.0),
            Some(s) => format!("{s:.0} s left"),
            None => String::new(),
        }
    }
}

/// One bar, restarted for each stage.
pub(crate) struct Bars {
    bar: Option<Mutex<(ProgressBar, Pace)>>,
    /// True if each step is printed as a line of its own, as the bar does not show.
    lines: bool,
}

impl Bars {
    pub(crate) fn new(silent: bool) -> Self {
        let shown = !silent && std::io::stderr().is_terminal();
        Self { bar: shown.then(Self::hidden), lines: false }
    }

    fn hidden() -> Mutex<(ProgressBar, Pace)> {
        Mutex::new((ProgressBar::hidden(), Pace::new("")))
    }

    /// Shows the progress of some work until its end.
    pub(crate) fn during<T>(silent: bool, work: impl FnOnce(&Self) -> T) -> T {
        Self::new(silent).show(work)
    }

    /// As [`Bars::during`]; without a terminal a line for each step.
    pub(crate) fn or_lines<T>(silent: bool, work: impl FnOnce(&Self) -> T) -> T {
        let bars = Self::new(silent);
        let lines = !silent && bars.bar.is_none();
        Self { bar: bars.bar.or_else(|| lines.then(Self::hidden)), lines }.show(work)
    }

    fn show<T>(self, work: impl FnOnce(&Self) -> T) -> T {
        let done = work(&self);
        self.with(|(bar, _)| bar.finish_and_clear());
        done
    }

    fn with(&self, work: impl FnOnce(&mut (ProgressBar, Pace))) {
        if let Some(bar) = &self.bar {
            work(&mut bar.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }
}

impl Progress for Bars {
    fn stage(&self, name: &'static str, total: u64) {
        self.with(|(bar, pace)| {
            bar.finish_and_clear();
            (*bar, *pace) = (ProgressBar::new(total), Pace::new(name));
            let pace = *pace;
            // A bar that cannot be written is drawn again.
            let left = move |state: &ProgressState, out: &mut dyn fmt::Write| {
                let _drawn = out.write_str(&pace.left(state.fraction().into(), state.elapsed()));
            };
            let paced = style("{msg:10} [{bar:40}] {percent:>3} % {left}").with_key("left", left);
            bar.set_style(paced);
            bar.set_message(name);
            if self.lines {
                // On a closed stream the line is lost.
                drop(writeln!(std::io::stderr(), "{name}: {total} steps"));
            }
        });
    }

    fn advance(&self, steps: u64) {
        self.with(|(bar, pace)| {
            bar.inc(steps);
            if self.lines {
                let (done, all) = (bar.position(), bar.length().unwrap_or_default());
                let left = if done < all {
                    pace.left(done as f64 / all as f64, bar.elapsed())
                } else {
                    String::new()
                };
                let comma = if left.is_empty() { "" } else { ", " };
                drop(writeln!(std::io::stderr(), "  {done} of {all}{comma}{left}"));
            }
        });
    }
}

/// A bar for the whole batch and one for each job; without a terminal, a line for each volume.
pub(crate) struct BatchBars {
    bars: Option<MultiProgress>,
    whole: ProgressBar,
    jobs: Vec<JobBar>,
    lines: bool,
    /// The notice that lines name files is printed once, before the first of them.
    notice: Once,
    boxes: &'static str,
}

/// Bar of one job, through its stages.
struct JobBar {
    bar: ProgressBar,
    name: Mutex<String>,
}

impl Progress for JobBar {
    fn stage(&self, stage: &'static str, total: u64) {
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(format!("{} {stage}", self.name.lock().unwrap_or_else(PoisonError::into_inner)));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }
}

impl BatchBars {
    /// Bars of jobs; `boxes` names the finest boxes of their models.
    pub(crate) fn new(jobs: usize, silent: bool, boxes: &'static str) -> Self {
        let bars = (!silent && std::io::stderr().is_terminal()).then(MultiProgress::new);
        let placed = |bar: ProgressBar| match &bars {
            Some(all) => all.add(bar),
            None => ProgressBar::hidden(),
        };
        let whole =
            placed(ProgressBar::new(0).with_style(style("{pos}/{len} done [{bar:40}] {eta:>5} left")));
        let job = |_| JobBar {
            bar: placed(ProgressBar::new(0).with_style(style("  [{bar:20}] {percent:>3} % {msg}"))),
            name: Mutex::default(),
        };
        Self {
            jobs: (0..jobs.max(1)).map(job).collect(),
            whole,
            bars,
            lines: !silent,
            notice: Once::new(),
            boxes,
        }
    }

    /// One line above the bars, whatever a file's name contains.
    fn print(&self, line: &str) {
        let line = shown(line).to_string();
        match &self.bars {
            // On a closed terminal the line is lost.
            Some(bars) => drop(bars.println(line)),
            None => drop(writeln!(std::io::stderr(), "{line}")),
        }
    }

    /// Removes the bars from the terminal.
    pub(crate) fn finish(&self) {
        self.jobs.iter().for_each(|job| job.bar.finish_and_clear());
        self.whole.finish_and_clear();
    }
}

impl Watcher for BatchBars {
    fn found(&self, items: u64) {
        self.whole.set_length(items);
    }

    fn begin(&self, slot: usize, name: &str) -> &dyn Progress {
        let job = &self.jobs[slot.min(self.jobs.len() - 1)];
        name.clone_into(&mut job.name.lock().unwrap_or_else(PoisonError::into_inner));
        job
    }

    fn end(&self, slot: usize, item: &Item) {
        self.jobs[slot.min(self.jobs.len() - 1)].bar.reset();
        if !self.lines {
            return;
        }
        let line = match (item.status, &item.model, &item.reason) {
            (Status::Failed, _, Some(reason)) if item.cause == Some(Cause::Defect) => {
                format!("failed   {}: {reason}", item.input)
            }
            // Sentences begin with a path.
            (Status::Failed, _, Some(reason)) => format!("failed   {reason}"),
            (Status::Skipped, None, Some(reason)) => format!("skipped  {}: {reason}", item.input),
            (Status::Skipped, ..) => format!("skipped  {} -> {} (done before)", item.input, item.name),
            (_, Some(m), _) => {
                let [x, y, z] = m.dims;
                format!(
                    "done     {} -> {} {x}x{y}x{z}, {} {}, {:.2} s",
                    item.input, m.file, m.skin_voxels, self.boxes, m.wall_s
                )
            }
            _ => return,
        };
        self.notice.call_once(|| self.print(&format!("what follows {NOTICE}")));
        self.print(&line);
    }

    fn advance(&self) {
        self.whole.inc(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_has_the_stages_that_follow_and_rows_of_a_picture_weigh_as_those_of_a_disc() {
        let left = |stage: &str, part: f64, s: u64| Pace::new(stage).left_s(part, Duration::from_secs(s));
        assert_eq!(left("sight", 0.25, 2), Some(6.0));
        // Remainder of a scan of 8 seconds, and the stages after it.
        assert!((left("scan", 0.25, 2).unwrap() - 7.2).abs() < 1e-9);
        // A quarter of a disc's rows holds a fifth of its area.
        assert!((left("render", 0.5, 2).unwrap() - 2.0).abs() < 1e-9);
        assert!((left("render", 0.25, 2).unwrap() - 2.0 * 0.804_5 / 0.195_5).abs() < 0.01);
        assert_eq!(
            (left("render", 1.0, 2), left("render", 0.0, 2), left("scan", 0.5, 0)),
            (Some(0.0), None, None)
        );
    }
}
