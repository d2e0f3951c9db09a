//! Mixes the predictions of three tables and a prior for a bit, in the logistic domain (SPEC 5.6).
//!
//! After Mahoney, "Adaptive weighing of context models for lossless data compression" (2005), in integers.
#![expect(clippy::cast_possible_truncation, reason = "probabilities and their logits have 16 bits")]

use super::bits::{BitCoder, PROBABILITIES};
use super::lanes::{Inputs, boxed, find, learn, mixed, update};
use crate::cpu::{Lanes, prefetch};

/// Bits of a context's key: eight stored in its slot, and above them those that select a pair of slots.
pub(super) const KEY_BITS: u32 = 23;
/// Cache lines with eight pairs each.
const LINES: usize = 1 << (KEY_BITS - 11);
/// Sets of weights are selected by place and size, and by the counts of both first slots: 16 a place, and some unused
/// ones to make their number a power of two.
pub(super) const PLACES: usize = 24;
const SETS: usize = (PLACES * 16).next_power_of_two();
/// A slot: a probability of 16 bits, its count, and the low bits of its key.
const NEW: u32 = 1 << 31;
const MAX_SEEN: usize = 60;
/// Largest magnitude of logits, in 1/256.
pub(super) const LOGIT: i32 = 2047;
/// Weights of the prior, the tables and the bias, of 65536.
const WEIGHTS: Inputs = Inputs([39_322, 19_661, 22_938, 13_107, 0, 0, 0, 0]);
const WEIGHT_LIMIT: i32 = (1 << 19) - 1;
/// e^(-1/256), of 2^32.
const DECAY: u64 = 4_278_222_805;

/// The probability of each logit from 0, of 65536.
const HALF: [i32; LOGIT as usize + 1] = {
    let mut half = [0; LOGIT as usize + 1];
    let (mut power, mut i) = (1_u64 << 32, 0);
    while i < half.len() {
        half[i] = ((1_u64 << 48) / ((1 << 32) + power)) as i32;
        power = (power * DECAY) >> 32;
        i += 1;
    }
    half
};

const fn squash(logit: i32) -> i32 {
    let half = HALF[logit.unsigned_abs() as usize];
    if logit < 0 { 65_536 - half } else { half }
}

/// The probability that is coded for each logit, from -2048.
static ONES: [u16; 4096] = {
    let mut ones = [PROBABILITIES[0] as u16; 4096];
    let mut logit = -LOGIT;
    while logit <= LOGIT {
        let one = squash(logit) as u32;
        let [least, most] = PROBABILITIES;
        ones[(logit + 2048) as usize] = (if one < least {
            least
        } else if one > most {
            most
        } else {
            one
        }) as u16;
        logit += 1;
    }
    ones
};

/// The logit of each probability of 4096.
static LOGITS: [i16; 4096] = {
    let mut logits = [0; 4096];
    let (mut logit, mut i) = (-LOGIT, 0);
    while i < 4096 {
        while logit < LOGIT && squash(logit + 1) <= 16 * i as i32 + 8 {
            logit += 1;
        }
        logits[i] = logit as i16;
        i += 1;
    }
    logits
};

/// For a count of n: the step 65536 / (n + 3/2) of a slot, rounded down, in the low half; its next count in the next
/// byte; a class of n (0; 1 and 2; 3 to 7; more) in the highest. Counts of damaged slots are clamped.
static COUNTS: [u32; 256] = {
    let mut counts = [0; 256];
    let mut i = 0;
    while i < counts.len() {
        let n = if i < MAX_SEEN { i } else { MAX_SEEN } as u32;
        let next = if i < MAX_SEEN { n + 1 } else { n };
        let class = (n > 0) as u32 + (n > 2) as u32 + (n > 7) as u32;
        counts[i] = (131_072 / (2 * n + 3)) | (next << 16) | (class << 24);
        i += 1;
    }
    counts
};

#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Line([[u32; 2]; 8]);

type Table = Box<[Line; LINES]>;

/// State learnt from a group.
#[derive(Debug)]
pub(super) struct Mixer {
    tables: [Table; 3],
    weights: Box<[Inputs; SETS]>,
}

impl Default for Mixer {
    fn default() -> Self {
        let table = || boxed(Line([[NEW; 2]; 8]));
        Self { tables: [table(), table(), table()], weights: boxed(WEIGHTS) }
    }
}

impl Mixer {
    /// Resets the learnt state.
    pub(super) fn restart(&mut self) {
        self.tables.iter_mut().for_each(|table| table.fill(Line([[NEW; 2]; 8])));
        self.weights.fill(WEIGHTS);
    }

    /// Prefetches the slots of these keys.
    #[inline(always)]
    pub(super) fn fetch(&self, keys: [usize; 3]) {
        for (table, key) in self.tables.iter().zip(keys) {
            prefetch(&table[(key >> 11) % LINES]);
        }
    }

    /// Codes a bit, in a context of each table, at one of [`PLACES`], with a prior's logit; tables and weights learn
    /// it.
    #[inline(always)]
    pub(super) fn code<C: BitCoder>(
        &mut self,
        isa: impl Lanes,
        coder: &mut C,
        keys: [usize; 3],
        place: usize,
        prior: i32,
        bit: bool,
    ) -> bool {
        let [a, b, c] = &mut self.tables;
        let places = [pair(a, keys[0]), pair(b, keys[1]), pair(c, keys[2])];
        let pairs = [*places[0], *places[1], *places[2]];
        let found = find(isa, pairs, keys.map(|key| key as u32 % 256), NEW);
        let [a, b, c, _] = found.slots.0;
        let logit = |slot: u32| i32::from(LOGITS[(slot >> 20) as usize]);
        let inputs = Inputs([prior, logit(a), logit(b), logit(c), 256, 0, 0, 0]);
        let counts = [a, b, c].map(|slot| COUNTS[(slot >> 8) as usize % 256]);
        let class = |slot: usize| (counts[slot] >> 24) as usize;
        let weights = &mut self.weights[(16 * place + 4 * class(0) + class(1)) % SETS];
        let mixed = (mixed(isa, weights, &inputs) >> 14).clamp(-LOGIT, LOGIT);
        let one = ONES[(mixed + 2048) as usize % 4096];
        let bit = coder.bit(one.into(), bit);
        learn(isa, weights, &inputs, (i32::from(bit) << 16) - i32::from(one), WEIGHT_LIMIT);
        for (place, pair) in places.into_iter().zip(update(isa, &found, counts, bit)) {
            *place = pair;
        }
        bit
    }
}

/// The pair of slots of a key.
#[inline(always)]
fn pair(table: &mut Table, key: usize) -> &mut [u32; 2] {
    &mut table[(key >> 11) % LINES].0[(key >> 8) % 8]
}

#[cfg(test)]
mod tests {
    use super::super::bits::{BitDecoder, BitEncoder};
    use super::*;
    use crate::cpu::Portable;

    #[test]
    fn logits_and_probabilities_are_each_others_inverse() {
        for logit in -LOGIT..=LOGIT {
            let exact = 65_536.0 / (1.0 + (f64::from(-logit) / 256.0).exp());
            assert!((f64::from(squash(logit)) - exact).abs() <= 1.1, "{logit}");
        }
        for (i, logit) in LOGITS.iter().enumerate() {
            let one = (i as f64 + 0.5) / 4096.0;
            let exact = (256.0 * (one / (1.0 - one)).ln()).clamp(-2047.0, 2047.0);
            let off = (f64::from(*logit) - exact).abs();
            // One of 65536 is many logits far from the middle.
            assert!(off <= 1.0 + 256.0 / (65_536.0 * one * (1.0 - one)), "{i}: {logit} for {exact}");
        }
    }

    #[test]
    fn what_a_slot_foresees_costs_little_and_comes_back() {
        let bits = |i: usize| (i % 7 == 3) ^ i.is_multiple_of(501);
        let run = |coder: &mut dyn FnMut(&mut Mixer, usize) -> bool| {
            let mut mixer = Mixer::default();
            mixer.restart();
            (0..20_000).map(|i| coder(&mut mixer, i)).collect::<Vec<_>>()
        };
        let keys = |i: usize| [i % 7, i % 5, 3].map(|context| context << 8);
        let mut encoder = BitEncoder::new();
        let given = run(&mut |mixer, i| mixer.code(Portable, &mut encoder, keys(i), i % 24, 0, bits(i)));
        let payload = encoder.finish();
        assert!(payload.len() * 8 < 20_000 / 10, "{} bytes", payload.len());
        let mut decoder = BitDecoder::new(&payload).unwrap();
        assert_eq!(run(&mut |mixer, i| mixer.code(Portable, &mut decoder, keys(i), i % 24, 0, false)), given);
        decoder.finish().unwrap();
    }
}
