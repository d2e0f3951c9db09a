//! The high-throughput block decoder (ISO/IEC 15444-15, clause 7).
//!
//! A cleanup segment holds three streams: magnitudes and signs forwards from its start, adaptive run
//! lengths (MEL) forwards from where its tail begins, and variable-length codes backwards from its end.
//! Samples are decoded in quads, two by two, numbered down and then right:
//!
//! ```text
//! 0 2
//! 1 3
//! ```

use super::block::{Samples, flag};
use super::ht_tables::{FIRST_ROW, OTHER_ROWS};
use crate::codec::{CodecError, damaged};

/// Quads across a code-block, at most, and one more that stays empty.
const MAX_QUADS: usize = 512 + 1;

/// Decodes a segment: the cleanup pass, or after it the significance and refinement passes.
pub(super) fn decode_segment(
    segment: &[u8],
    done: u8,
    passes: u8,
    planes: u32,
    samples: &mut Samples<'_>,
) -> Result<(), CodecError> {
    if done == 0 {
        let plane =
            planes.checked_sub(1).ok_or_else(|| damaged("a code-block without bit planes has passes"))?;
        return cleanup(segment, plane, samples);
    }
    let plane =
        planes.checked_sub(2).ok_or_else(|| damaged("a code-block has more passes than bit planes"))?;
    significance(segment, plane, samples);
    if passes > 1 {
        refinement(segment, plane, samples);
    }
    Ok(())
}

/// Bits forwards, least significant first; a byte after 0xFF has seven. Past the end, `fill` repeats.
struct Forward<'a> {
    bytes: &'a [u8],
    fill: u8,
    bits: u64,
    count: u32,
    after_ones: bool,
}

impl<'a> Forward<'a> {
    fn new(bytes: &'a [u8], fill: u8) -> Self {
        Self { bytes, fill, bits: 0, count: 0, after_ones: false }
    }

    /// At most 32 bits.
    fn take(&mut self, count: u32) -> u32 {
        while self.count < count {
            let byte = match self.bytes.split_first() {
                Some((&byte, rest)) => {
                    self.bytes = rest;
                    byte
                }
                None => self.fill,
            };
            self.bits |= u64::from(byte) << self.count;
            self.count += if self.after_ones { 7 } else { 8 };
            self.after_ones = byte == 0xFF;
        }
        let taken = self.bits & ((1 << count) - 1);
        self.bits >>= count;
        self.count -= count;
        u32::try_from(taken).unwrap_or(u32::MAX)
    }
}

/// Bits backwards, least significant first; a byte whose lower seven bits are ones has only these seven if the byte
/// after it is more than 0x8F. Zeros past the beginning.
struct Backward<'a> {
    bytes: &'a [u8],
    bits: u64,
    count: u32,
    stuffed: bool,
}

impl<'a> Backward<'a> {
    fn fill(&mut self, count: u32) {
        while self.count < count {
            let Some((&byte, rest)) = self.bytes.split_last() else {
                self.count += 32;
                return;
            };
            self.bytes = rest;
            self.bits |= u64::from(byte) << self.count;
            // The eighth bit of such a byte is zero or overwritten by what follows: it is cleared here.
            if self.stuffed && byte & 0x7F == 0x7F {
                self.count += 7;
                self.bits &= (1 << self.count) - 1;
            } else {
                self.count += 8;
            }
            self.stuffed = byte > 0x8F;
        }
    }

    /// The next seven bits, not consumed.
    fn peek(&mut self) -> usize {
        self.fill(7);
        usize::try_from(self.bits & 0x7F).unwrap_or(0)
    }

    fn skip(&mut self, count: u32) {
        self.bits >>= count;
        self.count -= count;
    }

    fn take(&mut self, count: u32) -> u32 {
        self.fill(count);
        let taken = self.bits & ((1 << count) - 1);
        self.skip(count);
        u32::try_from(taken).unwrap_or(u32::MAX)
    }

    /// Prefix of an exponent difference (Table 3).
    fn prefix(&mut self) -> u32 {
        for value in 1..=3 {
            if self.take(1) == 1 {
                return value;
            }
        }
        5
    }

    /// The whole difference, given its prefix.
    fn suffix(&mut self, prefix: u32) -> u32 {
        prefix
            + match prefix {
                3 => self.take(1),
                5 => self.take(5),
                _ => 0,
            }
    }
}

/// Adaptive run lengths of quads without significant samples.
struct RunLengths<'a> {
    bytes: &'a [u8],
    current: u8,
    left: u32,
    state: usize,
    run: u32,
    ends: bool,
}

impl RunLengths<'_> {
    fn bit(&mut self) -> u32 {
        if self.left == 0 {
            self.left = if self.current == 0xFF { 7 } else { 8 };
            self.current = match self.bytes.split_first() {
                Some((&byte, rest)) => {
                    self.bytes = rest;
                    // The last byte's lower half belongs to the length of the tail.
                    if rest.is_empty() { byte | 0x0F } else { byte }
                }
                None => 0xFF,
            };
        }
        self.left -= 1;
        u32::from(self.current) >> self.left & 1
    }

    fn event(&mut self) -> bool {
        const EXPONENTS: [u32; 13] = [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 4, 5];
        if self.run == 0 && !self.ends {
            let exponent = EXPONENTS[self.state];
            if self.bit() == 1 {
                self.run = 1 << exponent;
                self.state = (self.state + 1).min(12);
            } else {
                for _ in 0..exponent {
                    self.run = self.run << 1 | self.bit();
                }
                self.ends = true;
                self.state = self.state.saturating_sub(1);
            }
        }
        if self.run > 0 {
            self.run -= 1;
            return false;
        }
        self.ends = false;
        true
    }
}

/// State of a quad for the row of quads below.
#[derive(Clone, Copy, Default)]
struct Above {
    significant: u8,
    /// Exponents of the two lower samples.
    exponents: [u8; 2],
}

/// The content of a quad's variable-length code.
#[derive(Clone, Copy, Default)]
struct Quad {
    significant: u8,
    has_difference: bool,
    known_ones: u8,
    known: u8,
}

impl Quad {
    /// Decodes one; contexts without significant neighbours are preceded by a run-length event.
    fn decode(table: &[u16; 1024], context: u8, runs: &mut RunLengths<'_>, codes: &mut Backward<'_>) -> Self {
        if context == 0 && !runs.event() {
            return Self::default();
        }
        let entry = table[usize::from(context) << 7 | codes.peek()];
        codes.skip(u32::from(entry & 7));
        let [low, high] = entry.to_le_bytes();
        Self { significant: low >> 4, has_difference: low & 8 != 0, known_ones: high & 15, known: high >> 4 }
    }
}

/// Exponent differences of two quads (7.3.6).
fn differences(
    first_row: bool,
    quads: &[Quad; 2],
    runs: &mut RunLengths<'_>,
    codes: &mut Backward<'_>,
) -> [u32; 2] {
    match [quads[0].has_difference, quads[1].has_difference] {
        [false, false] => [0, 0],
        [true, false] => {
            let prefix = codes.prefix();
            [codes.suffix(prefix), 0]
        }
        [false, true] => {
            let prefix = codes.prefix();
            [0, codes.suffix(prefix)]
        }
        [true, true] => {
            let more = if first_row && runs.event() { 2 } else { 0 };
            let first = codes.prefix();
            if first_row && more == 0 && first > 2 {
                let second = 1 + codes.take(1);
                return [codes.suffix(first), second];
            }
            let second = codes.prefix();
            [codes.suffix(first) + more, codes.suffix(second) + more]
        }
    }
}

fn cleanup(segment: &[u8], plane: u32, samples: &mut Samples<'_>) -> Result<(), CodecError> {
    let bad = || damaged("a high-throughput code-block is impossible");
    let &[.., second_last, last] = segment else { return Err(bad()) };
    let tail = usize::from(last) << 4 | usize::from(second_last & 15);
    if tail < 2 || tail > segment.len() || tail > 4079 {
        return Err(bad());
    }
    let (magnitudes, tail) = segment.split_at(segment.len() - tail);
    let mut magnitudes = Forward::new(magnitudes, 0xFF);
    // Three bits of the upper half of the last byte but one, if they are ones, mean a stuffed byte.
    let half = u64::from(second_last >> 4);
    let count = if half & 7 == 7 { 3 } else { 4 };
    let mut codes = Backward {
        bytes: &tail[..tail.len() - 2],
        bits: half & ((1 << count) - 1),
        count,
        stuffed: second_last | 15 > 0x8F,
    };
    let mut runs =
        RunLengths { bytes: &tail[..tail.len() - 1], current: 0, left: 0, state: 0, run: 0, ends: false };

    let across = samples.width.div_ceil(2);
    // Quads of the row above, with an empty one to the right; those to the left are kept apart.
    let mut above = [Above::default(); MAX_QUADS];
    for top in (0..samples.height).step_by(2) {
        let first_row = top == 0;
        let table = if first_row { &FIRST_ROW } else { &OTHER_ROWS };
        let mut above_left = Above::default();
        let mut left = 0u8;
        for pair in (0..across).step_by(2) {
            let mut quads = [Quad::default(); 2];
            let mut most = [0u8; 2];
            for index in 0..2.min(across - pair) {
                let (over, right) = (above[pair + index], above[pair + index + 1]);
                let context = if first_row {
                    left >> 1 | left & 1
                } else {
                    let [north_west, north, north_east, far] = [
                        above_left.significant >> 3,
                        over.significant >> 1,
                        over.significant >> 3,
                        right.significant >> 1,
                    ];
                    ((north_west | north) & 1)
                        | (((left >> 2) | (left >> 3)) & 1) << 1
                        | ((north_east | far) & 1) << 2
                };
                let quad = Quad::decode(table, context, &mut runs, &mut codes);
                let [e1, e2] = over.exponents;
                most[index] = above_left.exponents[1].max(e1).max(e2).max(right.exponents[0]);
                left = quad.significant;
                // From here on, only the quad to the right needs the quad above this one.
                above_left = over;
                quads[index] = quad;
            }
            let differences = differences(first_row, &quads, &mut runs, &mut codes);
            for index in 0..2.min(across - pair) {
                let quad = quads[index];
                let several = quad.significant & quad.significant.wrapping_sub(1) != 0;
                let least = if several { u32::from(most[index]).saturating_sub(1).max(1) } else { 1 };
                let bits = least + differences[index];
                if quad.significant != 0 && bits + plane > 30 {
                    return Err(bad());
                }
                let mut now = Above { significant: quad.significant, exponents: [0; 2] };
                for sample in 0..4usize {
                    if quad.significant >> sample & 1 == 0 {
                        continue;
                    }
                    let known = u32::from(quad.known >> sample & 1);
                    let value = magnitudes.take(bits - known)
                        | u32::from(quad.known_ones >> sample & 1) << (bits - known);
                    let odd = value | 1;
                    if sample & 1 == 1 {
                        now.exponents[sample >> 1] = u8::try_from(32 - odd.leading_zeros()).unwrap_or(0);
                    }
                    let (x, y) = (2 * (pair + index) + (sample >> 1), top + (sample & 1));
                    if x < samples.width && y < samples.height {
                        samples.values[y * samples.width + x] = (odd + 2) << plane;
                        samples.set_significant(samples.place(x, y), value & 1 != 0);
                    }
                }
                above[pair + index] = now;
            }
        }
    }
    Ok(())
}

/// Samples next to significant ones, in groups of four columns: their bits first, then their signs (7.4).
fn significance(segment: &[u8], plane: u32, samples: &mut Samples<'_>) {
    let mut bits = Forward::new(segment, 0);
    for stripe in (0..samples.height).step_by(4) {
        for group in (0..samples.width).step_by(4) {
            let mut found = [(0, 0); 16];
            let mut count = 0;
            for x in group..samples.width.min(group + 4) {
                for y in stripe..samples.height.min(stripe + 4) {
                    let place = samples.place(x, y);
                    let seen = samples.seen(place, y);
                    if seen & flag::SIGNIFICANT == 0 && seen & flag::AROUND != 0 && bits.take(1) == 1 {
                        samples.set_significant(place, false);
                        samples.flags[place] |= flag::VISITED;
                        found[count] = (x, y);
                        count += 1;
                    }
                }
            }
            for &(x, y) in &found[..count] {
                samples.values[y * samples.width + x] = 3 << plane;
                if bits.take(1) == 1 {
                    let place = samples.place(x, y);
                    samples.flags[place] |= flag::NEGATIVE;
                }
            }
        }
    }
}

/// One more bit of the samples of the cleanup pass, backwards from the segment's end (7.5).
fn refinement(segment: &[u8], plane: u32, samples: &mut Samples<'_>) {
    let mut bits = Backward { bytes: segment, bits: 0, count: 0, stuffed: true };
    for stripe in (0..samples.height).step_by(4) {
        for x in 0..samples.width {
            for y in stripe..samples.height.min(stripe + 4) {
                if samples.flags[samples.place(x, y)] & (flag::SIGNIFICANT | flag::VISITED)
                    != flag::SIGNIFICANT
                {
                    continue;
                }
                let value = &mut samples.values[y * samples.width + x];
                if bits.take(1) == 0 {
                    *value ^= 2 << plane;
                }
                *value |= 1 << plane;
            }
        }
    }
}
