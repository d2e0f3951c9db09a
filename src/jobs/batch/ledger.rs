//! One memory budget for several jobs: each waits until what it needs is free.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes shared by jobs. First come, first served: a large request is not overtaken by small ones for ever.
#[derive(Debug)]
pub(super) struct Ledger {
    total: u64,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    taken: u64,
    /// Number of the next request, and of the one whose turn it is.
    next: u64,
    turn: u64,
}

/// Bytes taken from a [`Ledger`], given back when dropped.
#[derive(Debug)]
pub(super) struct Grant<'a> {
    ledger: &'a Ledger,
    bytes: u64,
}

impl Ledger {
    pub(super) fn new(total: u64) -> Self {
        Self { total, state: Mutex::default(), changed: Condvar::new() }
    }

    /// All there is.
    pub(super) fn total(&self) -> u64 {
        self.total
    }

    /// Waits for `bytes`; `None` if there are never that many.
    pub(super) fn take(&self, bytes: u64) -> Option<Grant<'_>> {
        if bytes > self.total {
            return None;
        }
        let mut state = self.lock();
        let mine = state.next;
        state.next += 1;
        while state.turn != mine || self.total - state.taken < bytes {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.turn += 1;
        state.taken += bytes;
        drop(state);
        self.changed.notify_all();
        Some(Grant { ledger: self, bytes })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Grant<'_> {
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl Drop for Grant<'_> {
    fn drop(&mut self) {
        self.ledger.lock().taken -= self.bytes;
        self.ledger.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn grants_never_exceed_the_total_and_large_ones_get_their_turn() {
        let ledger = Ledger::new(100);
        assert!(ledger.take(101).is_none());
        let (held, most, large) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for worker in 0..4_u64 {
                let (ledger, held, most, large) = (&ledger, &held, &most, &large);
                scope.spawn(move || {
                    for round in 0..200 {
                        let want = if worker == 0 { 100 } else { 10 + (worker * 7 + round) % 30 };
                        let Some(grant) = ledger.take(want) else { panic!("{want} of 100") };
                        let now = held.fetch_add(want, Ordering::SeqCst) + want;
                        most.fetch_max(now, Ordering::SeqCst);
                        large.fetch_add(u64::from(want == 100), Ordering::SeqCst);
                        held.fetch_sub(want, Ordering::SeqCst);
                        drop(grant);
                    }
                });
            }
        });
        assert!(most.load(Ordering::SeqCst) <= 100);
        assert_eq!((held.load(Ordering::SeqCst), large.load(Ordering::SeqCst)), (0, 200));
    }
}
