//! Progress bars on a terminal; nothing when piped, quiet or JSON.

use std::io::{IsTerminal, Write};
use std::sync::{Mutex, Once, PoisonError};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use infobyte::jobs::batch::{Cause, Item, NOTICE, Status, Watcher};
use infobyte::progress::Progress;
use infobyte::text::shown;

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// One bar, restarted for each stage.
pub(crate) struct Bars {
    bar: Option<Mutex<ProgressBar>>,
}

impl Bars {
    pub(crate) fn new(silent: bool) -> Self {
        let shown = !silent && std::io::stderr().is_terminal();
        Self { bar: shown.then(|| Mutex::new(ProgressBar::hidden())) }
    }

    /// Removes the bar from the terminal.
    pub(crate) fn finish(&self) {
        self.with(|bar| bar.finish_and_clear());
    }

    fn with(&self, work: impl FnOnce(&mut ProgressBar)) {
        if let Some(bar) = &self.bar {
            work(&mut bar.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }
}

impl Progress for Bars {
    fn stage(&self, name: &'static str, total: u64) {
        self.with(|bar| {
            bar.finish_and_clear();
            *bar = ProgressBar::new(total);
            bar.set_style(style("{msg:10} [{bar:40}] {percent:>3} % {eta:>5} left"));
            bar.set_message(name);
        });
    }

    fn advance(&self, steps: u64) {
        self.with(|bar| bar.inc(steps));
    }
}

/// A bar for the whole batch and one for each job; without a terminal, a line for each volume.
pub(crate) struct BatchBars {
    bars: Option<MultiProgress>,
    whole: ProgressBar,
    jobs: Vec<JobBar>,
    lines: bool,
    /// Lines name files, which is said once, before the first of them.
    notice: Once,
    boxes: &'static str,
}

/// The stages of one job after the other.
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
    /// Bars of jobs; `boxes` is what their models have on the finest level.
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
            // A closed terminal reads nothing.
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
