//! Workers on a private pool: fixed stacks, the first error wins and stops the others.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::error::BuildError;
use crate::budget::MemoryCap;
use crate::budget::costs::WORKER_STACK;
use crate::builder::BuildFault;
use crate::geom::Dims;
use crate::platform::give_back;
use crate::progress::Progress;

/// Work of one worker; its argument returns true once another one has failed, or the job is stopped.
pub(super) type Work<'a> = dyn Fn(&dyn Fn() -> bool) -> Result<(), BuildError> + Sync + 'a;

/// Runs `work` once on each of `threads` workers and waits for all. `work` calls its argument between steps to learn of
/// a stop.
pub(super) fn run_workers(
    threads: usize,
    progress: &dyn Progress,
    work: &Work<'_>,
) -> Result<(), BuildError> {
    run(threads, progress, &|| (), work)
}

/// Like [`run_workers`], for a stage that fills the job's memory: if the cap is on the whole process, memory left
/// resident by opening and planning is released when the workers are ready.
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
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).stack_size(WORKER_STACK).build().map_err(
                |e| BuildError::from(BuildFault::Threads { threads, cause: std::io::Error::other(e) }),
            )?;
        ready();
        pool.broadcast(|_| guarded());
    }
    first.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).map_or(Ok(()), Err)?;
    // The recorded value counts: stopped workers have left something undone.
    if stopped.into_inner() { Err(BuildFault::Stopped.into()) } else { Ok(()) }
}

/// Share `number` of `of` shares of the blocks of a volume.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Share {
    pub(crate) number: u32,
    pub(crate) of: u32,
}

impl Share {
    pub(super) const ALL: Self = Self { number: 0, of: 1 };
}

/// The blocks in which a volume, or a share of it, is read once: some rows of one slice each, handed to the next idle
/// worker. A share has the same blocks as the whole.
pub(super) struct Blocks {
    dims: Dims,
    cols: u32,
    rows: u32,
    next: AtomicU64,
    end: u64,
}

impl Blocks {
    /// Blocks of at most `samples` samples.
    pub(super) fn new(dims: Dims, samples: usize) -> Self {
        let most = u32::try_from(samples).unwrap_or(u32::MAX);
        let cols = dims.nx().min(most);
        let blocks =
            Self { dims, cols, rows: dims.ny().min((most / cols).max(1)), next: AtomicU64::new(0), end: 0 };
        let [across, down] = blocks.across_and_down();
        Self { end: across * down * u64::from(dims.nz()), ..blocks }
    }

    /// A share of the blocks.
    pub(super) fn of(self, Share { number, of }: Share) -> Self {
        let bound = |number: u32| {
            self.end / u64::from(of) * u64::from(number)
                + self.end % u64::from(of) * u64::from(number) / u64::from(of)
        };
        Self { next: AtomicU64::new(bound(number)), end: bound(number + 1), ..self }
    }

    /// The blocks of some slices.
    pub(super) fn of_slices(self, slices: Range<u32>) -> Self {
        let [across, down] = self.across_and_down();
        let first = |z: u32| across * down * u64::from(z);
        Self { next: AtomicU64::new(first(slices.start)), end: first(slices.end), ..self }
    }

    /// Columns and rows of the largest block.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.cols as usize, self.rows as usize]
    }

    /// Blocks across and down a slice.
    fn across_and_down(&self) -> [u64; 2] {
        [(self.dims.nx(), self.cols), (self.dims.ny(), self.rows)]
            .map(|(side, part)| side.div_ceil(part).into())
    }

    /// Columns, rows and slice of the next block.
    #[expect(clippy::cast_possible_truncation, reason = "each index is below a side of the volume")]
    pub(super) fn next(&self) -> Option<(Range<u32>, Range<u32>, u32)> {
        let (cols, rows) = (self.cols, self.rows);
        let [across, down] = self.across_and_down();
        let at = Some(self.next.fetch_add(1, Ordering::Relaxed)).filter(|at| *at < self.end)?;
        let (x, y, z) = ((at % across) as u32, (at / across % down) as u32, (at / across / down) as u32);
        let columns = x * cols..((x + 1) * cols).min(self.dims.nx());
        Some((columns, y * rows..((y + 1) * rows).min(self.dims.ny()), z))
    }
}
