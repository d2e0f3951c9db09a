//! Removal of a brick's cells that cannot be seen. The cells are joined first, so that planes match those of the whole
//! model, and then left out.
//!
//! A leaf stays as long as one of its cells can be seen; a cell outside leaves stays if it can be seen itself.

use std::ops::Range;

use super::{FineBrick, Joiner, LEVELS, State, WORDS};

impl Joiner {
    /// Leaves out the hidden parts of the brick that was joined last; returns the number of cells left out.
    pub(in crate::builder) fn hide(&mut self, brick: &FineBrick<'_>, seen: &[u64; WORDS]) -> u64 {
        self.shown.iter_mut().zip(seen).for_each(|(own, seen)| *own &= seen);
        for e in 1..=LEVELS {
            for at in 0..self.states[e - 1].len() {
                let stays = match self.states[e - 1][at] {
                    State::Empty => false,
                    State::Leaf(..) => self.shows_some(at, e),
                    State::Inner if e == 1 => self.shows_some(at, 1),
                    State::Inner => self.states[e - 2][8 * at..8 * at + 8].iter().any(|s| *s != State::Empty),
                };
                if !stays {
                    self.states[e - 1][at] = State::Empty;
                }
            }
        }
        let mut stay = 0;
        self.for_each_run(brick, |cells| stay += cells.len());
        for e in 1..=LEVELS {
            self.for_each_kept(e, |at, kept| {
                if let super::ModelNode::Leaf(_) = kept {
                    stay += self.cells(brick, at, e).len();
                }
            });
        }
        (brick.sides.len() - stay) as u64
    }

    /// True if some cell of box `at` with an edge of 2^e can be seen.
    fn shows_some(&self, at: usize, e: usize) -> bool {
        if e == 1 {
            return self.shown[at / 8].to_le_bytes()[at % 8] != 0;
        }
        let words = 1 << (3 * e - 6);
        self.shown[at * words..(at + 1) * words].iter().any(|word| *word != 0)
    }

    /// Calls `found` with runs of the visible cells of box `at` of 2^3, in order.
    pub(in crate::builder) fn for_each_run_of(
        &self,
        brick: &FineBrick<'_>,
        at: usize,
        mut found: impl FnMut(Range<usize>),
    ) {
        let cells = self.cells(brick, at, 1);
        let [there, shown] = [brick.words[at / 8], self.shown[at / 8]].map(|word| word.to_le_bytes()[at % 8]);
        if there == shown {
            return found(cells);
        }
        for (cell, octant) in cells.zip((0..8).filter(|octant| there >> octant & 1 == 1)) {
            if shown >> octant & 1 == 1 {
                found(cell..cell + 1);
            }
        }
    }
}
