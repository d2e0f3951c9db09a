//! One memory budget: memory is reserved before it is allocated.
//!
//! ```text
//! --memory 8MiB ─> MemoryCap ─> Budget ──reserve──> Reservation ──into_budget──> Budget of a stage, of a job
//!                               │ what the process           │                   of a batch, of workers
//!                               │ holds already              └─ gives back when dropped
//!                               └─ dry: without a limit, only measured
//! ```
//!
//! A [`MemoryCap`] is the requested bound. A [`Budget`] is the memory that may still be used under it, and
//! [`Budget::reserve`] is the only test of whether something fits. Plans are made by reserving: a stage reserves
//! the memory that it will hold, in the widest shape that is granted. The smallest cap that works is found by the same
//! calls in their smallest shape, on a budget without a limit (`Budget::dry`), whose peak of reservations gives the cap
//! (`Budget::smallest_limit`).
//!
//! | file | content |
//! |---|---|
//! | `costs` | measured figures of every job: code, stacks, allocator, spreads |
//! | `size` | sizes as people write them |

pub mod costs;
mod size;

pub use crate::platform::{current_rss_bytes, peak_rss_bytes};
pub(crate) use crate::platform::{file_rss_bytes, mapped_rss_bytes, own_rss_bytes, resident_bytes};
pub(crate) use size::SizeArgument;
pub use size::{Bytes, ExactSize, parse_size};

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Limit on the memory of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MemoryCap {
    /// Limit of the resident memory of the whole process, which does nothing but the job.
    Process(u64),
    /// Memory that the job may add to a process with other work.
    Share(u64),
}

impl MemoryCap {
    /// The limit in bytes.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Process(bytes) | Self::Share(bytes) => bytes,
        }
    }

    /// Bytes that count against the limit in addition to the job's further allocations: in a process, everything
    /// allocated now, and code. The code that is resident at the moment is no measure, as more is mapped while a job
    /// runs, and differs with every start; so its maximum is counted.
    pub(crate) fn held(self) -> u64 {
        match self {
            Self::Process(_) => own_rss_bytes() + file_rss_bytes().max(costs::CODE_BYTES),
            Self::Share(_) => 0,
        }
    }

    fn is_process(self) -> bool {
        matches!(self, Self::Process(_))
    }
}

/// A number of bytes from which memory is reserved before it is allocated.
///
/// Clones are the same budget. Reservations may be made and dropped by any thread; each costs a lock.
///
/// ```
/// use infobyte::budget::Budget;
///
/// let budget = Budget::new(8 << 20);
/// let rows = budget.reserve(3 << 20)?;
/// assert_eq!(budget.left_bytes(), 5 << 20);
/// assert_eq!(budget.reserve(6 << 20).unwrap_err().missing_bytes(), 1 << 20);
/// // A part for a worker, or for a job of a batch, is a budget of its own.
/// let part = rows.into_budget();
/// assert!(part.reserve(4 << 20).is_err());
/// drop(part);
/// assert_eq!(budget.left_bytes(), 8 << 20);
/// # Ok::<(), infobyte::budget::TooSmall>(())
/// ```
#[derive(Clone, Debug)]
pub struct Budget(Arc<Account>);

#[derive(Debug)]
struct Account {
    limit_bytes: u64,
    /// True for a cap on the whole process.
    alone: bool,
    /// Peak of the process when the budget was made; 0 for a share.
    peak_bytes: u64,
    state: Mutex<State>,
    changed: Condvar,
    /// Reservation in the enclosing budget, for a budget that is part of another one.
    _within: Option<Reservation>,
}

#[derive(Debug, Default)]
struct State {
    reserved: u64,
    /// Most bytes reserved at a time.
    most: u64,
    /// Number of the next request to wait, and of the one whose turn it is.
    next: u64,
    turn: u64,
}

impl State {
    fn add(&mut self, bytes: u64) {
        self.reserved = self.reserved.saturating_add(bytes);
        self.most = self.most.max(self.reserved);
    }
}

/// Refusal of a reservation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooSmall {
    /// Bytes requested.
    pub needed_bytes: u64,
    /// Bytes left.
    pub left_bytes: u64,
}

impl TooSmall {
    /// Bytes by which the budget is too small for this request.
    pub fn missing_bytes(&self) -> u64 {
        self.needed_bytes.saturating_sub(self.left_bytes)
    }
}

impl Budget {
    /// A budget of so many bytes, with nothing reserved.
    pub fn new(limit_bytes: u64) -> Self {
        Self::with(limit_bytes, false, None)
    }

    /// The memory left under a cap, less the bytes that are held already.
    ///
    /// Cost: in a process the kernel is asked for the resident memory (some 20 us).
    pub fn of(cap: MemoryCap) -> Self {
        let budget = Self::with(cap.bytes(), cap.is_process(), None);
        budget.take(cap.held());
        budget
    }

    /// Like [`Budget::of`], with the memory of a job outside its workers reserved, too. (In a process of its own the
    /// code's figure includes it.)
    pub(crate) fn of_job(cap: MemoryCap) -> Self {
        let budget = Self::of(cap);
        budget.take_overhead();
        budget
    }

    /// Like `Budget::of_job` under a cap of this kind, but without a limit: it measures a job's reservations.
    pub(crate) fn dry(kind: MemoryCap) -> Self {
        let budget = Self::with(u64::MAX, kind.is_process(), None);
        budget.take(kind.held());
        budget.take_overhead();
        budget
    }

    fn with(limit_bytes: u64, alone: bool, within: Option<Reservation>) -> Self {
        Self(Arc::new(Account {
            limit_bytes,
            alone,
            peak_bytes: if alone { peak_rss_bytes() } else { 0 },
            state: Mutex::default(),
            changed: Condvar::new(),
            _within: within,
        }))
    }

    /// Adds bytes to the reservations for good, whether there is room or not.
    fn take(&self, bytes: u64) {
        self.0.lock().add(bytes);
    }

    fn take_overhead(&self) {
        self.take(if self.is_process() { 0 } else { costs::SHARE_OVERHEAD });
    }

    /// True for a cap on the whole process.
    pub(crate) fn is_process(&self) -> bool {
        self.0.alone
    }

    /// The limit in bytes.
    pub(crate) fn limit_bytes(&self) -> u64 {
        self.0.limit_bytes
    }

    /// The memory reserved now, with the bytes held when the budget was made.
    pub(crate) fn reserved_bytes(&self) -> u64 {
        self.0.lock().reserved
    }

    /// The memory that may still be reserved.
    pub fn left_bytes(&self) -> u64 {
        self.0.left(&self.0.lock())
    }

    /// True if the process has exceeded the limit before. A cap is on the peak, so that no reservation is granted any
    /// more.
    pub(crate) fn is_passed(&self) -> bool {
        self.0.peak_bytes > self.0.limit_bytes
    }

    /// Takes bytes until the reservation is dropped.
    ///
    /// # Errors
    /// Fewer are left.
    pub fn reserve(&self, bytes: u64) -> Result<Reservation, TooSmall> {
        let mut state = self.0.lock();
        let left_bytes = self.0.left(&state);
        if bytes > left_bytes {
            return Err(TooSmall { needed_bytes: bytes, left_bytes });
        }
        state.add(bytes);
        drop(state);
        Ok(Reservation { account: Arc::clone(&self.0), bytes })
    }

    /// Like [`Budget::reserve`], but waits for others to give back. First come, first served: small requests do not
    /// overtake a large one for ever.
    ///
    /// # Errors
    /// More than the whole limit is requested.
    pub(crate) fn wait_for(&self, bytes: u64) -> Result<Reservation, TooSmall> {
        let account = &*self.0;
        if bytes > account.limit_bytes {
            return Err(TooSmall { needed_bytes: bytes, left_bytes: account.limit_bytes });
        }
        let mut state = account.lock();
        let mine = state.next;
        state.next += 1;
        while state.turn != mine || account.left(&state) < bytes {
            state = account.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.turn += 1;
        state.add(bytes);
        drop(state);
        account.changed.notify_all();
        Ok(Reservation { account: Arc::clone(&self.0), bytes })
    }

    /// Reserves the memory of as many workers as fit, up to `most` and at least one; each holds `each_bytes`.
    ///
    /// # Errors
    /// There is not enough for one.
    pub(crate) fn reserve_workers(
        &self,
        each_bytes: u64,
        most: usize,
    ) -> Result<(usize, Reservation), TooSmall> {
        let fit = usize::try_from(self.left_bytes() / each_bytes.max(1)).unwrap_or(usize::MAX);
        let count = fit.clamp(1, most.max(1));
        Ok((count, self.reserve(each_bytes.saturating_mul(count as u64))?))
    }

    /// Reserves all that is left, even 0 bytes.
    pub(crate) fn reserve_rest(&self) -> Reservation {
        let mut state = self.0.lock();
        let bytes = self.0.left(&state);
        state.add(bytes);
        drop(state);
        Reservation { account: Arc::clone(&self.0), bytes }
    }

    /// The smallest limit under which all reservations so far would have been granted, in steps of
    /// [`costs::STATED_STEP`].
    ///
    /// In a process this is a limit that works in every run: the resident memory at the beginning differs between them,
    /// and a job reads it `readings` times; and opening the input has had its peak.
    pub(crate) fn smallest_limit(&self, readings: u64) -> u64 {
        self.0.stated(self.0.lock().most, readings)
    }

    /// The smallest limit, likewise, under which so many bytes would be granted beyond the present reservations.
    pub(crate) fn smallest_limit_with(&self, more_bytes: u64) -> u64 {
        self.0.stated(self.reserved_bytes().saturating_add(more_bytes), 1)
    }
}

impl Account {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn left(&self, state: &State) -> u64 {
        self.limit_bytes.saturating_sub(state.reserved)
    }

    /// A limit as it is stated: with a margin for the spread between runs, in round steps.
    fn stated(&self, bytes: u64, readings: u64) -> u64 {
        let spread = if self.alone { costs::HELD_SPREAD * readings } else { 0 };
        let passed = if self.peak_bytes > 0 { self.peak_bytes + costs::OPENING_SPREAD } else { 0 };
        bytes.saturating_add(spread).max(passed).next_multiple_of(costs::STATED_STEP)
    }
}

/// Reserved bytes of a [`Budget`], given back when dropped.
#[derive(Debug)]
#[must_use = "the bytes are given back when it is dropped"]
pub struct Reservation {
    account: Arc<Account>,
    bytes: u64,
}

impl Reservation {
    /// Number of bytes reserved.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Turns the reservation into a budget of its own; the bytes are given back when its last clone and its last
    /// reservation are dropped.
    pub fn into_budget(self) -> Budget {
        Budget::with(self.bytes, false, Some(self))
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        let mut state = self.account.lock();
        state.reserved = state.reserved.saturating_sub(self.bytes);
        drop(state);
        self.account.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn what_is_reserved_is_given_back_and_never_more_than_the_limit() {
        let budget = Budget::new(100);
        let first = budget.reserve(60).unwrap();
        let refused = budget.reserve(50).unwrap_err();
        assert_eq!(refused, TooSmall { needed_bytes: 50, left_bytes: 40 });
        assert_eq!(refused.missing_bytes(), 10);
        assert_eq!((budget.reserved_bytes(), budget.left_bytes(), first.bytes()), (60, 40, 60));
        let part = first.into_budget();
        let within = part.reserve(60).unwrap();
        assert!(part.clone().reserve(1).is_err());
        drop(part);
        // The part lives as long as something is reserved from it.
        assert_eq!(budget.left_bytes(), 40);
        drop(within);
        assert_eq!(budget.left_bytes(), 100);
        assert!(budget.reserve(100).is_ok());
    }

    #[test]
    fn the_smallest_limit_is_the_most_that_a_dry_run_reserves() {
        let kind = MemoryCap::Share(0);
        let job = |budget: &Budget| -> Result<(), TooSmall> {
            let _kept = budget.reserve(100_000)?;
            drop(budget.reserve(300_000)?);
            budget.reserve(200_000).map(drop)
        };
        let dry = Budget::dry(kind);
        job(&dry).unwrap();
        let smallest = dry.smallest_limit(1);
        assert_eq!(smallest, (costs::SHARE_OVERHEAD + 400_000).next_multiple_of(costs::STATED_STEP));
        assert!(job(&Budget::of_job(MemoryCap::Share(smallest))).is_ok());
        assert!(job(&Budget::of_job(MemoryCap::Share(smallest - costs::STATED_STEP))).is_err());
    }

    #[test]
    fn a_process_counts_what_it_holds() {
        let budget = Budget::of(MemoryCap::Process(1 << 40));
        assert!(budget.reserved_bytes() >= costs::CODE_BYTES);
        assert!(!budget.is_passed() && budget.is_process());
        let small = Budget::of_job(MemoryCap::Process(1 << 10));
        assert_eq!(small.left_bytes(), 0);
        assert_eq!(small.is_passed(), peak_rss_bytes() > 0);
        let dry = Budget::dry(MemoryCap::Process(0));
        assert!(dry.smallest_limit(2) >= costs::CODE_BYTES + 2 * costs::HELD_SPREAD);
    }

    #[test]
    fn workers_are_as_many_as_fit() {
        let budget = Budget::new(100);
        let (count, held) = budget.reserve_workers(30, 8).unwrap();
        assert_eq!((count, held.bytes()), (3, 90));
        assert!(budget.reserve_workers(30, 8).is_err());
        drop(held);
        assert_eq!(budget.reserve_workers(30, 2).unwrap().0, 2);
        assert_eq!(budget.reserve_workers(0, 2).unwrap().0, 2);
    }

    #[test]
    fn jobs_that_wait_never_exceed_the_limit_and_large_ones_get_their_turn() {
        let budget = Budget::new(100);
        assert!(budget.wait_for(101).is_err());
        let (held, most, large) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for worker in 0..4_u64 {
                let (budget, held, most, large) = (budget.clone(), &held, &most, &large);
                scope.spawn(move || {
                    for round in 0..200 {
                        let want = if worker == 0 { 100 } else { 10 + (worker * 7 + round) % 30 };
                        let granted = budget.wait_for(want).unwrap();
                        let now = held.fetch_add(want, Ordering::SeqCst) + want;
                        most.fetch_max(now, Ordering::SeqCst);
                        large.fetch_add(u64::from(want == 100), Ordering::SeqCst);
                        held.fetch_sub(want, Ordering::SeqCst);
                        drop(granted);
                    }
                });
            }
        });
        assert!(most.load(Ordering::SeqCst) <= 100);
        assert_eq!((held.load(Ordering::SeqCst), large.load(Ordering::SeqCst)), (0, 200));
    }
}
