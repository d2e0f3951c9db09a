//! Progress of a long job, and its stop.

/// Watches a job, and may stop it; called from several threads.
pub trait Progress: Sync {
    /// A stage begins that has `total` steps.
    fn stage(&self, name: &'static str, total: u64);
    /// Some steps are done.
    fn advance(&self, steps: u64);
    /// True if the job should stop. Once true, it must stay true.
    ///
    /// Builds, cleaning, exports and packing ask between steps: a slice of a column, a group of bricks, 128 KiB of a
    /// file; so the answer should cost no more than reading an atomic. The job then ends with an error of
    /// [`ExitKind::Stopped`](crate::ExitKind::Stopped), and leaves everything as it was: no temporary file, no
    /// scratch file, and an old output untouched.
    fn stopped(&self) -> bool {
        false
    }
}

/// Reports nothing, and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &'static str, _: u64) {}
    fn advance(&self, _: u64) {}
}

/// The watcher has stopped the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped by its caller; nothing was written")]
pub(crate) struct Stopped;

impl dyn Progress + '_ {
    /// An error if the job is stopped.
    pub(crate) fn check(&self) -> Result<(), Stopped> {
        if self.stopped() { Err(Stopped) } else { Ok(()) }
    }

    /// Reports some steps as done; an error if the job is stopped.
    pub(crate) fn step(&self, steps: u64) -> Result<(), Stopped> {
        self.advance(steps);
        self.check()
    }
}
