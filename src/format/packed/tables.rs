//! Adaptive 16-ary tables and the coder of their symbols (SPEC 5.8): rANS with two states.
//!
//! A symbol is coded with the mean of two tables of different contexts, each itself the mean of a fast and a slow
//! estimate; both tables learn it. All steps are sums, shifts and comparisons of sixteen 16-bit lanes, which a compiler
//! turns into a few vector instructions.
#![expect(clippy::cast_possible_truncation, reason = "lanes, widths and words have 16 bits")]

use super::CodingError;
use super::lanes::{LANES, Row, boxed, last_within, mean_of_four, sink};
use crate::cpu::Lanes;

/// Symbols of a table: a lane holds the cumulative frequency below its symbol, of 65536; lane 0 is 0.
const SYMBOLS: usize = LANES;
const PROBABILITY_BITS: u32 = 15;
/// The least share of a symbol in an estimate, of 65536: a quarter of it is one of 32768, so the share in the mean is
/// never zero.
const MIN: u16 = 6;
/// Lower bound of states, which are in `STATE..STATE << 16`.
const STATE: u32 = 1 << 16;
/// Items of a block of the stream: the encoder has to keep their symbols.
const BLOCK_ITEMS: u32 = 1 << 14;

/// Both estimates of one context, one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Table {
    fast: Row,
    slow: Row,
}

/// Equal shares of all symbols.
const EVEN: Row = {
    let mut row = [0; SYMBOLS];
    let mut i = 0;
    while i < SYMBOLS {
        row[i] = i as u16 * 4096;
        i += 1;
    }
    Row(row)
};

/// The effect of a symbol on the lanes: those above it rise towards 65536, those up to it sink towards 0. XORed with
/// the first row, all sink towards the second.
static WAYS: [[Row; 2]; SYMBOLS] = {
    let mut ways = [[Row([0; SYMBOLS]); 2]; SYMBOLS];
    let mut symbol = 0;
    while symbol < SYMBOLS {
        let (mut turn, mut end) = ([0; SYMBOLS], [0; SYMBOLS]);
        let mut i = 0;
        while i < SYMBOLS {
            turn[i] = if i > symbol { u16::MAX } else { 0 };
            end[i] = if i > symbol { (SYMBOLS - i) as u16 * MIN - 1 } else { i as u16 * MIN };
            i += 1;
        }
        ways[symbol] = [Row(turn), Row(end)];
        symbol += 1;
    }
    ways
};

/// `COUNT` contexts, a power of two.
#[derive(Debug)]
pub(crate) struct Tables<const COUNT: usize, const FAST: u8, const SLOW: u8> {
    tables: Box<[Table; COUNT]>,
    seen: Box<[u8; COUNT]>,
}

impl<const COUNT: usize, const FAST: u8, const SLOW: u8> Tables<COUNT, FAST, SLOW> {
    /// Tables in their initial state.
    pub(super) fn new() -> Self {
        const { assert!(COUNT.is_power_of_two()) };
        let tables = boxed(Table { fast: EVEN, slow: EVEN });
        Self { tables, seen: Box::new([0; COUNT]) }
    }

    /// Resets the learnt state.
    pub(super) fn restart(&mut self) {
        self.tables.fill(Table { fast: EVEN, slow: EVEN });
        self.seen.fill(0);
    }

    /// A young context moves in large steps: 1/2, 1/2, 1/4, 1/4, 1/8 ... of the way. For each count of symbols seen:
    /// the next count, and both shifts.
    const STEPS: [[u8; 4]; 16] = {
        assert!(FAST <= SLOW && 2 * SLOW < 16);
        let mut steps = [[0; 4]; 16];
        let mut seen = 0;
        while seen < 16 {
            let next = if seen < 2 * SLOW { seen + 1 } else { 2 * SLOW };
            let shift = next.div_ceil(2);
            steps[seen as usize] = [next, if shift < FAST { shift } else { FAST }, shift, 0];
            seen += 1;
        }
        steps
    };

    #[inline(always)]
    fn learn(&mut self, isa: impl Lanes, context: usize, symbol: usize) {
        let context = context % COUNT;
        let (table, seen) = (&mut self.tables[context], &mut self.seen[context]);
        let [turn, end] = &WAYS[symbol % SYMBOLS];
        let [next, fast, slow, _] = const { &Self::STEPS }[usize::from(*seen) % 16];
        *seen = next;
        sink(isa, &mut table.fast, turn, end, fast);
        sink(isa, &mut table.slow, turn, end, slow);
    }
}

/// Cumulative frequency below each symbol, of 65536.
#[inline(always)]
fn begins(isa: impl Lanes, a: &Table, b: &Table) -> Row {
    mean_of_four(isa, [&a.fast, &a.slow], [&b.fast, &b.slow])
}

/// Begin and width of a symbol, of 32768.
#[inline(always)]
fn share(row: &Row, symbol: usize) -> [u16; 2] {
    let begin = row.lane(symbol) >> 1;
    // The last symbol ends at 32768, which equals lane 0 in 15 bits; the width of a symbol is always less than 32768.
    let end = row.lane(symbol + 1) >> 1;
    [begin, end.wrapping_sub(begin) % (1 << PROBABILITY_BITS)]
}

/// Either direction of coding: an encoder writes the given symbols, a decoder ignores them and returns the symbols it
/// reads.
pub(crate) trait SymbolCoder {
    /// True for a decoder, whose results may differ from the given symbols.
    const READS: bool;

    type Lanes: Lanes;

    fn isa(&self) -> Self::Lanes;

    /// Codes one of sixteen symbols with these cumulative frequencies.
    fn symbol(&mut self, begins: &Row, symbol: usize) -> usize;

    /// Codes one of sixteen symbols in two contexts, which learn it.
    #[inline(always)]
    fn code<const A: usize, const B: usize, const FAST: u8, const SLOW: u8>(
        &mut self,
        first: (&mut Tables<A, FAST, SLOW>, usize),
        second: (&mut Tables<B, FAST, SLOW>, usize),
        symbol: usize,
    ) -> usize {
        let isa = self.isa();
        let row = begins(isa, &first.0.tables[first.1 % A], &second.0.tables[second.1 % B]);
        let symbol = self.symbol(&row, symbol);
        first.0.learn(isa, first.1, symbol);
        second.0.learn(isa, second.1, symbol);
        symbol
    }

    /// Codes `bits` bits, at most 15, with all values equally likely.
    fn even(&mut self, bits: u32, value: u32) -> u32;

    /// Ends an item.
    fn end_item(&mut self);

    /// Checks the coding so far.
    ///
    /// # Errors
    /// A decoder ran out of bytes, or a block did not end correctly.
    fn check(&self) -> Result<(), CodingError>;
}

/// Codes symbols with the instructions of `L`.
#[derive(Debug)]
pub(crate) struct Encoder<L> {
    isa: L,
    /// Begin and width of the symbols of a block.
    log: Vec<[u16; 2]>,
    items: u32,
    out: Vec<u8>,
}

impl<L: Lanes> Encoder<L> {
    pub(crate) fn new(isa: L) -> Self {
        Self { isa, log: Vec::new(), items: 0, out: Vec::new() }
    }

    /// Ends a block: symbols are coded from the last to the first, so that they are read from the first to the last.
    fn end_block(&mut self) {
        let begin = self.out.len();
        let mut states = [STATE; 2];
        // Words are reversed, the first at the end, until the whole block is coded.
        for (i, [start, width]) in self.log.iter().enumerate().rev() {
            let (state, width) = (&mut states[i % 2], u32::from(*width).max(1));
            if *state >> (32 - PROBABILITY_BITS) >= width {
                self.out.extend((*state as u16).to_be_bytes());
                *state >>= 16;
            }
            *state = ((*state / width) << PROBABILITY_BITS) + *state % width + u32::from(*start);
        }
        for state in states.into_iter().rev() {
            self.out.extend(state.to_be_bytes());
        }
        if let Some(block) = self.out.get_mut(begin..) {
            block.reverse();
        }
        self.log.clear();
        self.items = 0;
    }

    /// Returns the finished payload and resets the encoder.
    pub(crate) fn finish(&mut self) -> Vec<u8> {
        // A payload without items still has one block.
        if self.items > 0 || self.out.is_empty() {
            self.end_block();
        }
        std::mem::take(&mut self.out)
    }
}

impl<L: Lanes> SymbolCoder for Encoder<L> {
    const READS: bool = false;
    type Lanes = L;

    #[inline(always)]
    fn isa(&self) -> L {
        self.isa
    }

    #[inline(always)]
    fn symbol(&mut self, begins: &Row, symbol: usize) -> usize {
        let symbol = symbol % SYMBOLS;
        self.log.push(share(begins, symbol));
        symbol
    }

    #[inline(always)]
    fn even(&mut self, bits: u32, value: u32) -> u32 {
        let width = 1_u32 << (PROBABILITY_BITS - bits);
        self.log.push([(value * width) as u16, width as u16]);
        value
    }

    #[inline(always)]
    fn end_item(&mut self) {
        self.items += 1;
        if self.items == BLOCK_ITEMS {
            self.end_block();
        }
    }

    #[inline(always)]
    fn check(&self) -> Result<(), CodingError> {
        Ok(())
    }
}

/// Reads symbols with the instructions of `L`.
#[derive(Debug)]
pub(crate) struct Decoder<'a, L> {
    isa: L,
    /// The state of the next symbol and of the one after it.
    states: [u32; 2],
    words: &'a [[u8; 2]],
    /// Index of the next word; past the end, zeros are read.
    at: usize,
    items: u32,
}

impl<'a, L: Lanes> Decoder<'a, L> {
    /// Starts on a payload.
    ///
    /// # Errors
    /// The length is not a multiple of a word.
    pub(crate) fn new(isa: L, payload: &'a [u8]) -> Result<Self, CodingError> {
        let (words, rest) = payload.as_chunks::<2>();
        if words.is_empty() || !rest.is_empty() {
            return Err(CodingError::GROUP_CUT);
        }
        let mut new = Self { isa, states: [STATE; 2], words, at: 0, items: 0 };
        new.begin_block();
        Ok(new)
    }

    #[inline(always)]
    fn word(&mut self) -> u32 {
        let word = self.peek();
        self.at += 1;
        word
    }

    #[inline(always)]
    fn peek(&self) -> u32 {
        self.words.get(self.at).map_or(0, |word| u32::from(u16::from_le_bytes(*word)))
    }

    fn begin_block(&mut self) {
        for i in 0..2 {
            let low = self.word();
            self.states[i] = self.word() << 16 | low;
        }
        self.items = 0;
    }

    #[cold]
    #[inline(never)]
    fn end_block(&mut self) {
        if self.states != [STATE; 2] {
            // From here on nothing is left, and the payload counts as overrun.
            (self.words, self.at) = (&[], 1);
        } else if self.at < self.words.len() {
            self.begin_block();
        }
        self.items = 0;
    }

    /// Checks that the payload was used up.
    ///
    /// # Errors
    /// Words are left, or the payload ended early.
    pub(crate) fn finish(mut self) -> Result<(), CodingError> {
        self.check()?;
        if self.at < self.words.len() {
            return Err(CodingError::GROUP_SURPLUS);
        }
        if self.items > 0 {
            self.end_block();
        }
        self.check()
    }

    /// Takes a symbol of this width from the state, and swaps the states.
    #[inline(always)]
    fn step(&mut self, start: u32, width: u32) {
        let [state, next] = self.states;
        let value = state % (1 << PROBABILITY_BITS);
        let mut state = width.wrapping_mul(state >> PROBABILITY_BITS).wrapping_add(value).wrapping_sub(start);
        // Without a branch, which would be unpredictable.
        let is_low = state < STATE;
        let word = self.peek();
        state = if is_low { state << 16 | word } else { state };
        self.at += usize::from(is_low);
        self.states = [next, state];
    }
}

impl<L: Lanes> SymbolCoder for Decoder<'_, L> {
    const READS: bool = true;
    type Lanes = L;

    #[inline(always)]
    fn isa(&self) -> L {
        self.isa
    }

    #[inline(always)]
    fn symbol(&mut self, begins: &Row, _: usize) -> usize {
        let value = (self.states[0] % (1 << PROBABILITY_BITS)) as u16;
        // Half of its begin is not above the value.
        let symbol = last_within(self.isa, begins, 2 * value + 1);
        let [start, width] = share(begins, symbol);
        self.step(u32::from(start), u32::from(width));
        symbol
    }

    #[inline(always)]
    fn even(&mut self, bits: u32, _: u32) -> u32 {
        let shift = PROBABILITY_BITS - bits;
        let value = (self.states[0] % (1 << PROBABILITY_BITS)) >> shift;
        self.step(value << shift, 1 << shift);
        value
    }

    #[inline(always)]
    fn end_item(&mut self) {
        self.items += 1;
        if self.items == BLOCK_ITEMS {
            self.end_block();
        }
    }

    #[inline(always)]
    fn check(&self) -> Result<(), CodingError> {
        if self.at > self.words.len() { Err(CodingError::GROUP_CUT) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::Portable;

    type Both = [Tables<4, 4, 7>; 2];

    /// Symbols of any skew, and even bits among them.
    fn code(coder: &mut impl SymbolCoder, skew: u32, count: u32) -> Vec<u32> {
        let [mut first, mut second]: Both = [Tables::new(), Tables::new()];
        (0..count)
            .map(|i| {
                let noise = i.wrapping_mul(2_654_435_761) >> 12;
                let symbol = if noise % 1000 < skew { 3 } else { noise / 1000 % 16 };
                let (a, b) = (i as usize % 4, i as usize / 4 % 4);
                let got = coder.code((&mut first, a), (&mut second, b), symbol as usize);
                let low = coder.even(i % 16, noise & ((1 << (i % 16)) - 1));
                coder.end_item();
                got as u32 | low << 4
            })
            .collect()
    }

    #[test]
    fn symbols_of_any_skew_come_back_over_many_blocks() {
        for (skew, count) in [(0, 1), (0, 50_000), (500, 16_384), (990, 32_768), (1000, 40_000)] {
            let mut encoder = Encoder::new(Portable);
            let given = code(&mut encoder, skew, count);
            let payload = encoder.finish();
            let mut decoder = Decoder::new(Portable, &payload).unwrap();
            assert_eq!(code(&mut decoder, skew, count), given);
            decoder.finish().unwrap();
            // 7.5 even bits a symbol, and the entropy of the skewed part.
            let bits = payload.len() as f64 * 8.0 / f64::from(count) - 7.5;
            assert!(count == 1 || bits < [4.15, 0.25][usize::from(skew >= 990)], "{skew}: {bits} bits");
        }
    }

    #[test]
    fn a_payload_cut_or_changed_is_an_error_or_other_symbols_and_never_a_panic() {
        let mut encoder = Encoder::new(Portable);
        let given = code(&mut encoder, 700, 600);
        let payload = encoder.finish();
        for len in 0..payload.len() {
            let all = Decoder::new(Portable, &payload[..len]).and_then(|mut decoder| {
                code(&mut decoder, 0, 600);
                decoder.finish()
            });
            assert!(all.is_err(), "{len}");
        }
        for at in 0..payload.len() {
            let mut bad = payload.clone();
            bad[at] ^= 0x41;
            let mut decoder = Decoder::new(Portable, &bad).unwrap();
            let got = code(&mut decoder, 0, 600);
            assert!(got != given || decoder.finish().is_err(), "{at}");
        }
    }
}
