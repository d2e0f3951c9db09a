//! Small differences between what was expected and what is: contexts, classes of magnitude (SPEC 5.4).

use super::CodingError;
use super::coder::{Bit, BitCoder};

/// Classes of spread, of neighbour count, of the other component's error.
pub(super) const SPREADS: usize = 12;
pub(super) const COUNTS: usize = 6;
pub(super) const OTHERS: usize = 4;
const CONTEXTS: usize = SPREADS * COUNTS * OTHERS;
/// Classes of magnitude: exact to 4, then two for every power of two to 256.
const CLASSES: usize = 16;

/// Contexts of one kind of difference.
#[derive(Clone, Debug)]
pub(super) struct Residual {
    zero: Vec<Bit>,
    sign: [Bit; OTHERS],
    more: Vec<[Bit; CLASSES - 1]>,
    within: [Bit; CLASSES],
}

impl Residual {
    pub(super) fn new() -> Self {
        Self {
            zero: vec![Bit::NEW; CONTEXTS],
            sign: [Bit::NEW; OTHERS],
            more: vec![[Bit::NEW; CLASSES - 1]; CONTEXTS],
            within: [Bit::NEW; CLASSES],
        }
    }

    /// Codes a difference in -254..=254.
    pub(super) fn code(
        &mut self,
        coder: &mut impl BitCoder,
        context: usize,
        value: i32,
    ) -> Result<i32, CodingError> {
        let other = context % OTHERS;
        if coder.code(&mut self.zero[context], value == 0)? {
            return Ok(0);
        }
        let negative = coder.code(&mut self.sign[other], value < 0)?;
        let rest = value.unsigned_abs().wrapping_sub(1).min(255);
        let due = class_of(rest);
        let mut class = 0;
        for more in &mut self.more[context] {
            if !coder.code(more, due > class)? {
                break;
            }
            class += 1;
        }
        // The value within its class: the highest bit in a context, the rest even.
        let bits = if class < 4 { 0 } else { class / 2 - 1 };
        let mut read = if class < 4 { class } else { 2 | (class % 2) };
        for i in (0..bits).rev() {
            let mut even = Bit::NEW;
            let bit_context = if i + 1 == bits { &mut self.within[class as usize] } else { &mut even };
            read = read << 1 | u32::from(coder.code(bit_context, rest >> i & 1 == 1)?);
        }
        Ok(signed(read + 1, negative))
    }
}

/// Class of a magnitude less one: 0, 1, 2, 3, 4-5, 6-7, 8-11, 12-15 ... 192-255.
fn class_of(rest: u32) -> u32 {
    if rest < 4 {
        return rest;
    }
    let exponent = rest.ilog2();
    2 * exponent + (rest >> (exponent - 1) & 1)
}

fn signed(magnitude: u32, negative: bool) -> i32 {
    let magnitude = magnitude.cast_signed();
    if negative { -magnitude } else { magnitude }
}

/// Class of four times the mean distance between the neighbours and the prediction.
pub(super) fn spread_class(spread: i32) -> usize {
    const UP_TO: [i32; 10] = [3, 7, 11, 15, 21, 27, 35, 47, 63, 90];
    UP_TO.iter().take_while(|limit| spread > **limit).count()
}

/// Class of the number of neighbours.
pub(super) fn count_class(count: usize) -> usize {
    match count {
        0..=2 => count,
        3..=4 => 3,
        5..=7 => 4,
        _ => 5,
    }
}
