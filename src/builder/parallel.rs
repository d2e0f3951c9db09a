//! Workers on a private pool: fixed stacks, first error wins, nobody goes on after it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::BuildError;
use crate::budget::MemoryCap;
use crate::budget::costs::WORKER_STACK;
use crate::platform::give_back;
use crate::progress::Progress;

/// Work of one worker; its argument says whether another one has failed, or the job is stopped.
pub(super) type Work<'a> = dyn Fn(&dyn Fn() -> bool) -> Result<(), BuildError> + Sync + 'a;

/// Runs `work` once on each of `threads` workers and waits for all. `work` asks its argument between
/// steps whether to go on.
pub(super) fn run_workers(
    threads: usize,
    progress: &dyn Progress,
    work: &Work<'_>,
) -> Result<(), BuildError> {
    run(threads, progress, &|| (), work)
}

/// As [`run_workers`], for a stage that fills the job's memory: where the cap is that of the whole process,
/// what opening and planning left resident is given back when the workers stand ready.
pub(super) fn run_stage(
    threads: usize,
    cap: MemoryCap,
    progress: &dyn Progress,
    work: &Work<'_>,
) -> Result<(), BuildError> {
    let ready: &dyn Fn() = match cap {
        MemoryCap::Process(_) => &give_back,
        MemoryCap::Share(_) => &|| (),
    };
    run(threads, progress, ready, work)
}

fn run(threads: usize, progress: &dyn Progress, ready: &dyn Fn(), work: &Work<'_>) -> Result<(), BuildError> {
    let (failed, stopped) = (AtomicBool::new(false), AtomicBool::new(false));
    let first = Mutex::new(None);
    let guarded = || {
        let stop = || {
            if progress.stopped() {
                stopped.store(true, Ordering::Relaxed);
            }
            failed.load(Ordering::Relaxed) || stopped.load(Ordering::Relaxed)
        };
        if let Err(e) = work(&stop) {
            failed.store(true, Ordering::Relaxed);
            first.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(e);
        }
    };
    if threads <= 1 {
        ready();
        guarded();
    } else {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .stack_size(WORKER_STACK)
            .build()
            .map_err(|e| BuildError::Threads { threads, cause: std::io::Error::other(e) })?;
        ready();
        pool.broadcast(|_| guarded());
    }
    first.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).map_or(Ok(()), Err)?;
    // Not asked again: workers that were stopped have left something undone.
    if stopped.into_inner() { Err(BuildError::Stopped) } else { Ok(()) }
}
