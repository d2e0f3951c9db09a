//! Progress bars on a terminal; nothing when piped, quiet or JSON.

use std::io::IsTerminal;
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};
use infobyte::build::Progress;

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
            work(&mut bar.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
        }
    }
}

impl Progress for Bars {
    fn stage(&self, name: &'static str, total: u64) {
        self.with(|bar| {
            bar.finish_and_clear();
            *bar = ProgressBar::new(total);
            let style = ProgressStyle::with_template("{msg:10} [{bar:40}] {percent:>3} % {eta:>5} left");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.set_message(name);
        });
    }

    fn advance(&self, steps: u64) {
        self.with(|bar| bar.inc(steps));
    }
}
