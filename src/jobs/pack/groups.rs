//! Groups of subtrees, coded side by side by a few workers and handed on in their order (SPEC 5.3).

use rayon::prelude::*;

use crate::cpu::{Isa, Kernel, dispatch};
use crate::format::packed::CodingError;
use crate::format::packed::group::{Group, GroupCoder};
use crate::format::packed::tables::{Decoder, Encoder};
use crate::render::picture::pool as pool_of;

use super::stop::Stop;

/// Most workers: each has a group, its grid and its tables, below 2 MiB.
const MOST_WORKERS: usize = 2;

/// What to do with a group.
#[derive(Clone, Copy, Debug)]
pub(super) enum Direction {
    /// Payload to content.
    Decode,
    /// Content to payload.
    Encode,
}

/// A group on its way through a coder.
#[derive(Debug)]
pub(super) struct Worker<G> {
    coder: G,
    encoder: Encoder,
    /// The content.
    pub(super) group: Group,
    /// The coded bytes.
    pub(super) payload: Vec<u8>,
    result: Result<(), CodingError>,
}

impl<G: GroupCoder> Worker<G> {
    fn new() -> Self {
        let (coder, group) = (G::default(), Group::default());
        Self { coder, encoder: Encoder::default(), group, payload: Vec::new(), result: Ok(()) }
    }

    fn work(&mut self, direction: Direction) {
        self.result = match direction {
            Direction::Encode => {
                let result = dispatch(Encode(self));
                self.payload = self.encoder.finish();
                result
            }
            Direction::Decode => dispatch(Decode(self)),
        };
    }
}

struct Encode<'a, G>(&'a mut Worker<G>);

impl<G: GroupCoder> Kernel for Encode<'_, G> {
    type Output = Result<(), CodingError>;

    #[inline(always)]
    fn run(self, _: impl Isa) -> Self::Output {
        self.0.coder.code(&mut self.0.encoder, &mut self.0.group)
    }
}

struct Decode<'a, G>(&'a mut Worker<G>);

impl<G: GroupCoder> Kernel for Decode<'_, G> {
    type Output = Result<(), CodingError>;

    #[inline(always)]
    fn run(self, _: impl Isa) -> Self::Output {
        let mut decoder = Decoder::new(&self.0.payload)?;
        self.0.coder.code(&mut decoder, &mut self.0.group)?;
        decoder.finish()
    }
}

/// Takes group after group through a coder. `fill` puts the next one into a worker, or says that the last has been;
/// `drain` takes what came of it. Both see the groups in their order.
pub(super) fn each_group<G: GroupCoder>(
    direction: Direction,
    mut fill: impl FnMut(&mut Worker<G>) -> Result<bool, Stop>,
    mut drain: impl FnMut(&mut Worker<G>) -> Result<(), Stop>,
) -> Result<(), Stop> {
    let most = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_WORKERS);
    let mut workers: Vec<Worker<G>> = Vec::new();
    let mut pool = None;
    loop {
        let mut filled = 0;
        while filled < most {
            if filled == workers.len() {
                workers.push(Worker::new());
            }
            if !workers.get_mut(filled).map_or(Ok(false), &mut fill)? {
                break;
            }
            filled += 1;
        }
        let filled = workers.get_mut(..filled).unwrap_or_default();
        match &mut *filled {
            [] => return Ok(()),
            [one] => one.work(direction),
            many => {
                // Where the system starts no more threads, this one does the work.
                match pool.get_or_insert_with(|| pool_of(most).ok()) {
                    Some(pool) => pool.install(|| many.par_iter_mut().for_each(|w| w.work(direction))),
                    None => many.iter_mut().for_each(|w| w.work(direction)),
                }
            }
        }
        for worker in filled {
            worker.result?;
            drain(worker)?;
        }
    }
}
