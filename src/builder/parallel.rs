//! Workers on a private pool: fixed stacks, first error wins, nobody goes on after it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::error::BuildError;
use crate::budget::MemoryCap;
use crate::budget::costs::WORKER_STACK;
use crate::platform::give_back;

/// Work of one worker; its argument tells whether another one has failed.
pub(super) type Work<'a> = dyn Fn(&dyn Fn() -> bool) -> Result<(), BuildError> + Sync + 'a;

/// Runs `work` once on each of `threads` workers and waits for all. `work` asks its argument between
/// steps whether another worker has failed.
pub(super) fn run_workers(threads: usize, work: &Work<'_>) -> Result<(), BuildError> {
    run(threads, &|| (), work)
}

/// As [`run_workers`], for a stage that fills the job's memory: where the cap is that of the whole process,
/// what opening and planning left resident is given back when the workers stand ready.
pub(super) fn run_stage(threads: usize, cap: MemoryCap, work: &Work<'_>) -> Result<(), BuildError> {
    let ready: &dyn Fn() = match cap {
        MemoryCap::Process(_) => &give_back,
        MemoryCap::Share(_) => &|| (),
    };
    run(threads, ready, work)
}

fn run(threads: usize, ready: &dyn Fn(), work: &Work<'_>) -> Result<(), BuildError> {
    let failed = AtomicBool::new(false);
    let first = Mutex::new(None);
    let guarded = || {
        if let Err(e) = work(&|| failed.load(Ordering::Relaxed)) {
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
    first.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).map_or(Ok(()), Err)
}
