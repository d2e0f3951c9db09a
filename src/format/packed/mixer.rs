//! Bits mixed of what three tables and a prior say, in the logistic domain (SPEC 5.6).
//!
//! After Mahoney, "Adaptive weighing of context models for lossless data compression" (2005), in whole numbers.
#![expect(clippy::cast_possible_truncation, reason = "probabilities and their logits have 16 bits")]

use super::bits::{BitCoder, PROBABILITIES};
use super::lanes::boxed;
use crate::cpu::prefetch;

/// Bits of a context's key: eight that its slot keeps, and above them those that choose a pair of slots.
pub(super) const KEY_BITS: u32 = 23;
/// Lines of a cache with eight pairs each.
const LINES: usize = 1 << (KEY_BITS - 11);
/// Sets of weights are chosen by so many places and sizes, and by how often both first slots were seen.
pub(super) const PLACES: usize = 24;
const SETS: usize = PLACES * 16;
/// A slot: a probability of 16 bits, how often it was seen, and the low bits of its key.
const NEW: u32 = 1 << 31;
const MAX_SEEN: u32 = 60;
/// Logits are in 1/256, at most so large.
pub(super) const LOGIT: i32 = 2047;
/// Weights of the prior, the tables and the bias, of 65536.
const WEIGHTS: [i32; 5] = [39_322, 19_661, 22_938, 13_107, 0];
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

/// 65536 / (n + 3/2), rounded down.
static STEPS: [i32; MAX_SEEN as usize + 1] = {
    let mut steps = [0; MAX_SEEN as usize + 1];
    let mut n = 0;
    while n < steps.len() {
        steps[n] = 131_072 / (2 * n as i32 + 3);
        n += 1;
    }
    steps
};

/// Classes of counts: 0; 1 and 2; 3 to 7; more.
static SEEN: [u8; MAX_SEEN as usize + 1] = {
    let mut seen = [3; MAX_SEEN as usize + 1];
    [seen[0], seen[1], seen[2]] = [0, 1, 1];
    let mut n = 3;
    while n < 8 {
        seen[n] = 2;
        n += 1;
    }
    seen
};

#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Line([[u32; 2]; 8]);

type Table = Box<[Line; LINES]>;

/// What a group has taught.
#[derive(Debug)]
pub(super) struct Mixer {
    tables: [Table; 3],
    weights: Box<[[i32; 5]; SETS]>,
}

impl Default for Mixer {
    fn default() -> Self {
        let table = || boxed(Line([[NEW; 2]; 8]));
        Self { tables: [table(), table(), table()], weights: Box::new([WEIGHTS; SETS]) }
    }
}

/// How often a slot was seen.
#[inline(always)]
fn count(slot: u32) -> usize {
    ((slot >> 8) % 256).min(MAX_SEEN) as usize
}

/// The slot of a key, and where it goes: that of its pair which has it, else the one that was seen less, made new.
/// Without branches: they could not be predicted.
#[inline(always)]
fn slot(table: &mut Table, key: usize) -> (u32, &mut u32) {
    let low = key as u32 % 256;
    let pair = &mut table[(key >> 11) % LINES].0[(key >> 8) % 8];
    let [is_first, is_second] = pair.map(|slot| slot % 256 == low);
    let has_less = pair[1] << 16 >> 24 < pair[0] << 16 >> 24;
    let place = &mut pair[usize::from(!is_first & (is_second | has_less))];
    let is_new = u32::from(is_first | is_second).wrapping_sub(1);
    (*place ^ (*place ^ (NEW | low)) & is_new, place)
}

impl Mixer {
    /// Forgets what was learnt.
    pub(super) fn restart(&mut self) {
        self.tables.iter_mut().for_each(|table| table.fill(Line([[NEW; 2]; 8])));
        self.weights.fill(WEIGHTS);
    }

    /// Says that slots of these keys will be asked for.
    #[inline(always)]
    pub(super) fn fetch(&self, keys: [usize; 3]) {
        for (table, key) in self.tables.iter().zip(keys) {
            prefetch(&table[(key >> 11) % LINES]);
        }
    }

    /// Codes a bit, in a context of each table, at one of [`PLACES`], after a prior's logit; all learn it.
    #[inline(always)]
    pub(super) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        keys: [usize; 3],
        place: usize,
        prior: i32,
        bit: bool,
    ) -> bool {
        let [a, b, c] = &mut self.tables;
        let slots = [slot(a, keys[0]), slot(b, keys[1]), slot(c, keys[2])];
        let logit = |slot: usize| i32::from(LOGITS[(slots[slot].0 >> 20) as usize]);
        let inputs = [prior, logit(0), logit(1), logit(2), 256];
        let seen = |slot: usize| usize::from(SEEN[count(slots[slot].0)]);
        let weights = &mut self.weights[(16 * place + 4 * seen(0) + seen(1)) % SETS];
        let products = weights.iter().zip(inputs).map(|(w, input)| w.wrapping_mul(input) >> 2);
        let mixed = (products.fold(0, i32::wrapping_add) >> 14).clamp(-LOGIT, LOGIT);
        let one = ONES[(mixed + 2048) as usize % 4096];
        let bit = coder.bit(one.into(), bit);
        let error = (i32::from(bit) << 16) - i32::from(one);
        for (weight, input) in weights.iter_mut().zip(inputs) {
            let step = input.wrapping_mul(error).wrapping_add(1 << 13) >> 14;
            *weight = weight.wrapping_add(step).clamp(-WEIGHT_LIMIT, WEIGHT_LIMIT);
        }
        for (slot, place) in slots {
            let (one, seen) = ((slot >> 16).cast_signed(), count(slot));
            // No product passes 32 bits: a slot that is new has its probability in the middle.
            let target = if bit { 65_535 } else { 0 };
            let one = one.wrapping_add((target - one).wrapping_mul(STEPS[seen]) >> 16);
            *place = one.cast_unsigned() << 16 | (seen as u32 + 1).min(MAX_SEEN) << 8 | (slot % 256);
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::super::bits::{BitDecoder, BitEncoder};
    use super::*;

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
        let given = run(&mut |mixer, i| mixer.code(&mut encoder, keys(i), i % 24, 0, bits(i)));
        let payload = encoder.finish();
        assert!(payload.len() * 8 < 20_000 / 10, "{} bytes", payload.len());
        let mut decoder = BitDecoder::new(&payload).unwrap();
        assert_eq!(run(&mut |mixer, i| mixer.code(&mut decoder, keys(i), i % 24, 0, false)), given);
        decoder.finish().unwrap();
    }
}
