//! Initial probabilities of an infobyte's bits, before anything is learnt: a small net over the boxes around (SPEC
//! 5.9).
//!
//! Trained by `scripts/train_prior.py`; the weights are part of the format.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "weights have 8 bits, logits 12"
)]

use std::sync::LazyLock;

use super::lanes::products_above_0;
use super::mixer::LOGIT;
use crate::cpu::Lanes;

/// Inputs in nibbles.
const NIBBLES: usize = 28;
const INPUTS: usize = 4 * NIBBLES;
const HIDDEN: usize = 32;
const WEIGHTS: usize = INPUTS * HIDDEN + 8 * HIDDEN + HIDDEN + 8 * HIDDEN + 8;

/// Sums of the hidden layer, in 1/256.
pub(super) type Sums = [i16; HIDDEN];

/// The weights in 1/16, parsed from lines of hexadecimal digits.
static WEIGHT: [i8; WEIGHTS] = {
    const fn digit(byte: u8) -> u8 {
        if byte >= b'a' { byte - b'a' + 10 } else { byte - b'0' }
    }
    let text = include_bytes!("../prior.hex");
    let mut weights = [0; WEIGHTS];
    let (mut at, mut i) = (0, 0);
    while i < WEIGHTS {
        if text[at] == b'\n' {
            at += 1;
        }
        weights[i] = (digit(text[at]) << 4 | digit(text[at + 1])) as i8;
        at += 2;
        i += 1;
    }
    weights
};

/// The net, with the first layer summed for each value of each nibble.
#[derive(Debug)]
pub(super) struct Prior {
    nibbles: Box<[[Sums; 16]; NIBBLES]>,
    /// Sums added for each of the node's own bits that is 1.
    own: [Sums; 8],
    first: Sums,
    last: [Sums; 8],
    bias: [i32; 8],
}

static PRIOR: LazyLock<Prior> = LazyLock::new(|| {
    let mut rows = WEIGHT.as_chunks::<HIDDEN>().0.iter().map(|row| row.map(i16::from));
    let mut row = || rows.next().unwrap_or_default();
    let mut nibbles = Box::new([[[0; HIDDEN]; 16]; NIBBLES]);
    for nibble in nibbles.iter_mut() {
        for bit in 0..4 {
            let weights = row();
            for (_, sums) in nibble.iter_mut().enumerate().filter(|(value, _)| value >> bit & 1 == 1) {
                sums.iter_mut().zip(weights).for_each(|(sum, w)| *sum += 16 * w);
            }
        }
    }
    let own = std::array::from_fn(|_| row().map(|w| 16 * w));
    let first = row().map(|w| 16 * w);
    let last = std::array::from_fn(|_| row());
    let bias = std::array::from_fn(|i| 256 * i32::from(WEIGHT[WEIGHTS - 8 + i]));
    Prior { nibbles, own, first, last, bias }
});

impl Prior {
    pub(super) fn get() -> &'static Self {
        &PRIOR
    }

    /// The hidden layer for the inputs, 64 and 48 of them.
    #[inline(always)]
    pub(super) fn sums(&self, inputs: [u64; 2]) -> Sums {
        let mut sums = self.first;
        let (low, high) = self.nibbles.split_at(16);
        for (word, nibbles) in inputs.into_iter().zip([low, high]) {
            for (i, nibble) in nibbles.iter().enumerate() {
                let row = &nibble[(word >> (4 * i)) as usize % 16];
                for (sum, w) in sums.iter_mut().zip(row) {
                    *sum = sum.wrapping_add(*w);
                }
            }
        }
        sums
    }

    /// The logit of a bit.
    #[inline(always)]
    pub(super) fn logit(&self, isa: impl Lanes, sums: &Sums, bit: usize) -> i32 {
        let sum = products_above_0(isa, sums, &self.last[bit % 8]);
        (sum.wrapping_add(self.bias[bit % 8]) >> 4).clamp(-LOGIT, LOGIT)
    }

    /// Adds the value of a bit.
    #[inline(always)]
    pub(super) fn note(&self, sums: &mut Sums, bit: usize, is_one: bool) {
        let all = -i16::from(is_one);
        for (sum, w) in sums.iter_mut().zip(&self.own[bit % 8]) {
            *sum = sum.wrapping_add(*w & all);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums that wrap would differ between programs that add in another order or with more bits.
    #[test]
    fn no_inputs_make_sums_that_wrap() {
        for hidden in 0..HIDDEN {
            let all = WEIGHT.iter().skip(hidden).step_by(HIDDEN).take(INPUTS + 9).map(|w| 16 * i32::from(*w));
            let (above, below) = all.partition::<Vec<_>, _>(|w| *w > 0);
            assert!(above.iter().sum::<i32>() <= 32_767 && below.iter().sum::<i32>() >= -32_768, "{hidden}");
        }
    }

    #[test]
    fn sums_are_those_of_the_weights() {
        let prior = Prior::get();
        let inputs = [0x8000_0000_0000_0421, 0x8000_0000_0001];
        let mut sums = prior.sums(inputs);
        prior.note(&mut sums, 5, true);
        prior.note(&mut sums, 6, false);
        for (hidden, sum) in sums.iter().enumerate() {
            let ones = (0..INPUTS).filter(|i| inputs[i / 64] >> (i % 64) & 1 == 1);
            let all =
                ones.chain([INPUTS + 5, INPUTS + 8]).map(|row| 16 * i32::from(WEIGHT[row * HIDDEN + hidden]));
            assert_eq!(i32::from(*sum), all.sum::<i32>());
        }
    }
}
