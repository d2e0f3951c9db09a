//! Groups of subtrees, coded side by side by a few workers and handed on in their order (SPEC 5.2).

use std::collections::VecDeque;
use std::sync::mpsc;

use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::packed::CodingError;
use crate::format::packed::group::{Group, GroupCoder};
use crate::render::picture::pool as pool_of;

use super::Stop;

/// Most workers that decode: each has a group, its grids and its tables, 2.2 MiB. An encoder has one grid more, or the
/// symbols of a block, and a single worker, so that either stays within 8 MiB for a process.
const MAX_WORKERS: usize = 2;

/// Direction of the coding.
#[derive(Clone, Copy, Debug)]
pub(super) enum Direction {
    /// Payload to content.
    Decode,
    /// Content to payload.
    Encode,
}

/// A group on its way through a coder.
pub(super) struct Worker<G> {
    coder: G,
    /// The content.
    pub(super) group: Group,
    /// The coded bytes.
    pub(super) payload: Vec<u8>,
    result: Result<(), CodingError>,
}

impl<G: GroupCoder> Worker<G> {
    fn new() -> Self {
        let (coder, group) = (G::default(), Group::default());
        Self { coder, group, payload: Vec::new(), result: Ok(()) }
    }

    fn work(&mut self, direction: Direction) {
        self.result = dispatch(Work(self, direction));
    }
}

struct Work<'a, G>(&'a mut Worker<G>, Direction);

impl<G: GroupCoder> Kernel for Work<'_, G> {
    type Output = Result<(), CodingError>;

    #[inline(always)]
    fn run(self, isa: impl Lanes) -> Self::Output {
        let Worker { coder, group, payload, .. } = self.0;
        match self.1 {
            Direction::Encode => *payload = coder.encode(isa, group)?,
            Direction::Decode => coder.decode(isa, payload, group)?,
        }
        Ok(())
    }
}

/// Takes group after group through a coder. `fill` puts the next one into a worker, or reports the end; `drain` takes
/// the result. Both see the groups in their order.
///
/// A worker gets its next group as soon as the one before is drained, while others are still at work.
pub(super) fn each_group<G: GroupCoder>(
    direction: Direction,
    mut fill: impl FnMut(&mut Worker<G>) -> Result<bool, Stop>,
    mut drain: impl FnMut(&mut Worker<G>) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let most = match direction {
        Direction::Encode => 1,
        Direction::Decode => std::thread::available_parallelism().map_or(1, usize::from).min(MAX_WORKERS),
    };
    // Filled groups, and idle workers.
    let (mut waiting, mut idle) = (VecDeque::new(), vec![Worker::new()]);
    let mut next = |idle: &mut Vec<Worker<G>>| -> Result<Option<Worker<G>>, Stop> {
        let mut worker = idle.pop().unwrap_or_else(Worker::new);
        Ok(fill(&mut worker)?.then_some(worker))
    };
    while waiting.len() < most {
        let Some(worker) = next(&mut idle)? else { break };
        waiting.push_back(worker);
    }
    // This thread does the work if no more can be started.
    let pool = if waiting.len() > 1 { pool_of(most).ok() } else { None };
    let Some(pool) = pool else {
        while let Some(mut worker) = waiting.pop_front() {
            worker.work(direction);
            worker.result?;
            drain(&mut worker)?;
            idle.push(worker);
            if waiting.is_empty() {
                waiting.extend(next(&mut idle)?);
            }
        }
        return Ok(());
    };
    pool.in_place_scope(|scope| {
        let start = |mut worker: Worker<G>| {
            let (done, result) = mpsc::channel();
            scope.spawn(move |_| {
                worker.work(direction);
                // After an error there is no reader to wait for it.
                let _ = done.send(worker);
            });
            result
        };
        let mut under_way: VecDeque<_> = waiting.into_iter().map(start).collect();
        while let Some(first) = under_way.pop_front() {
            // A worker that panics takes the scope with it.
            let Ok(mut worker) = first.recv() else { break };
            worker.result?;
            drain(&mut worker)?;
            idle.push(worker);
            under_way.extend(next(&mut idle)?.map(start));
        }
        Ok(())
    })
}
