//! A job on a thread of its own, while the caller's thread looks at signals and calls `progress`.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use super::failure::raised;
use crate::error::Error;
use crate::progress::Progress;

/// Interval between looks at signals and calls of `progress`.
const LOOK: Duration = Duration::from_millis(50);

/// Progress of a job, and the request to stop it.
struct State {
    stage: Mutex<(&'static str, u64)>,
    done: AtomicU64,
    stopped: AtomicBool,
    /// Wakes the caller's thread: `false` when a stage begins, `true` when the job has ended.
    wake: Sender<bool>,
}

impl State {
    fn now(&self) -> (&'static str, u64, u64) {
        let (stage, total) = *self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        (stage, self.done.load(Ordering::Relaxed).min(total), total)
    }
}

impl Progress for State {
    fn stage(&self, name: &'static str, total: u64) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        self.done.store(0, Ordering::Relaxed);
        *stage = (name, total);
        let _ = self.wake.send(false);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Runs a job; an exception of `progress(stage, done, total)` or of a signal's handler stops it and is raised. Where no
/// thread can be started, the job runs on the caller's, without either.
pub(super) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    job: impl FnOnce(&dyn Progress) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let (wake, woken) = channel();
    let woken = Mutex::new(woken);
    let state =
        State { stage: Mutex::default(), done: AtomicU64::new(0), stopped: AtomicBool::new(false), wake };
    let job = Mutex::new(Some(job));
    let run = || {
        let job = job.lock().unwrap_or_else(PoisonError::into_inner).take();
        let result = job.map_or(Err(Error::Internal), |job| job(&state));
        let _ = state.wake.send(true);
        result
    };
    let (result, stopped_by) = thread::scope(|scope| {
        let Ok(worker) = thread::Builder::new().spawn_scoped(scope, run) else {
            return (Ok(py.detach(run)), None);
        };
        let mut stopped_by: Option<PyErr> = None;
        let mut told = ("", 0, 0);
        loop {
            let wait = || woken.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK);
            // A job that panicked ends without a message.
            if py.detach(wait) == Ok(true) || worker.is_finished() {
                break;
            }
            if stopped_by.is_some() {
                continue;
            }
            let now = state.now();
            let looked = py.check_signals().and_then(|()| match progress {
                Some(progress) if now != told && !now.0.is_empty() => progress.call1(now).map(drop),
                _ => Ok(()),
            });
            told = now;
            if let Err(exception) = looked {
                state.stopped.store(true, Ordering::Relaxed);
                stopped_by = Some(exception);
            }
        }
        (py.detach(|| worker.join()), stopped_by)
    });
    match (result, stopped_by) {
        (_, Some(exception)) => Err(exception),
        (Ok(result), None) => result.map_err(|error| raised(py, &error)),
        (Err(_), None) => Err(raised(py, &Error::Internal)),
    }
}
