//! Workers on a private pool: fixed stacks, the first error wins and stops the others.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::error::BuildError;
use crate::budget::MemoryCap;
use crate::budget::costs::WORKER_STACK;
use crate::geom::Dims;
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

/// Like [`run_workers`], for a stage that fills the job's memory: where the cap is that of the whole process,
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

/// The blocks in which a volume is read once: some rows of one slice each, for whichever worker asks next.
pub(super) struct Blocks {
    dims: Dims,
    cols: u32,
    rows: u32,
    next: AtomicU64,
}

impl Blocks {
    /// Blocks of at most so many samples.
    pub(super) fn new(dims: Dims, samples: usize) -> Self {
        let most = u32::try_from(samples).unwrap_or(u32::MAX);
        let cols = dims.nx().min(most);
        Self { dims, cols, rows: dims.ny().min((most / cols).max(1)), next: AtomicU64::new(0) }
    }

    /// Columns and rows of the largest block.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.cols as usize, self.rows as usize]
    }

    /// Columns, rows and slice of the next block.
    #[expect(clippy::cast_possible_truncation, reason = "each index is below a side of the volume")]
    pub(super) fn next(&self) -> Option<(Range<u32>, Range<u32>, u32)> {
        let (cols, rows) = (self.cols, self.rows);
        let parts = |side: u32, part: u32| u64::from(side.div_ceil(part));
        let (across, down) = (parts(self.dims.nx(), cols), parts(self.dims.ny(), rows));
        let at = self.next.fetch_add(1, Ordering::Relaxed);
        let (x, y) = ((at % across) as u32, (at / across % down) as u32);
        let z = u32::try_from(at / across / down).ok().filter(|z| *z < self.dims.nz())?;
        let columns = x * cols..((x + 1) * cols).min(self.dims.nx());
        Some((columns, y * rows..((y + 1) * rows).min(self.dims.ny()), z))
    }
}
