//! Adaptive binary range coder (SPEC 5.2): carry-free, 32 bits, two-speed probabilities.

use super::CodingError;

/// Probability of a 1 in one context, as the mean of a fast and a slow estimate in 1/65536.
#[derive(Clone, Copy, Debug)]
pub struct Bit {
    fast: u16,
    slow: u16,
    seen: u16,
}

/// Shift of the fast and of the slow estimate, once a context has been seen often enough.
const FAST: u16 = 4;
const SLOW: u16 = 7;
/// Probabilities are held to `LEAST..=65535 - LEAST`.
const LEAST: u32 = 32;

impl Bit {
    /// A context not seen yet.
    pub const NEW: Self = Self { fast: 1 << 15, slow: 1 << 15, seen: 0 };
    #[inline(always)]
    fn probability(self) -> u32 {
        ((u32::from(self.fast) + u32::from(self.slow)) / 2).clamp(LEAST, 65535 - LEAST)
    }

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        // A young context moves in large steps: 1/2, 1/4, 1/8 ... of the way.
        self.seen = (self.seen + 1).min(SLOW);
        let (f, s) = (self.seen.min(FAST), self.seen);
        if bit {
            self.fast += (65535 - self.fast) >> f;
            self.slow += (65535 - self.slow) >> s;
        } else {
            self.fast -= self.fast >> f;
            self.slow -= self.slow >> s;
        }
    }
}

/// Either direction of coding: an encoder writes the bit it is given, a decoder ignores it and
/// returns the one it reads.
pub trait BitCoder {
    /// Codes one bit in a context.
    ///
    /// # Errors
    /// A decoder ran out of bytes.
    fn code(&mut self, context: &mut Bit, bit: bool) -> Result<bool, CodingError>;
}

/// Writes bits, for tests: no file is written so any more.
#[cfg(test)]
#[derive(Debug)]
pub struct Encoder {
    low: u32,
    high: u32,
    out: Vec<u8>,
}

#[cfg(test)]
impl Default for Encoder {
    fn default() -> Self {
        Self { low: 0, high: u32::MAX, out: Vec::new() }
    }
}

#[cfg(test)]
impl Encoder {
    /// The finished payload.
    pub fn finish(mut self) -> Vec<u8> {
        self.out.extend(self.low.to_be_bytes());
        self.out
    }
}

/// Last value of the lower part, that of a 1 bit.
#[inline(always)]
fn split(low: u32, high: u32, p: u32) -> u32 {
    let range = high - low;
    low + (range >> 16) * p + (((range & 0xffff) * p) >> 16)
}

#[cfg(test)]
impl BitCoder for Encoder {
    #[inline(always)]
    fn code(&mut self, context: &mut Bit, bit: bool) -> Result<bool, CodingError> {
        let mid = split(self.low, self.high, context.probability());
        if bit {
            self.high = mid;
        } else {
            self.low = mid + 1;
        }
        context.learn(bit);
        while (self.low ^ self.high) >> 24 == 0 {
            self.out.push((self.high >> 24) as u8);
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
        }
        Ok(bit)
    }
}

/// Reads bits.
#[derive(Debug)]
pub struct Decoder<'a> {
    low: u32,
    high: u32,
    value: u32,
    rest: &'a [u8],
}

impl<'a> Decoder<'a> {
    /// Starts on a payload.
    ///
    /// # Errors
    /// Fewer than four bytes.
    pub fn new(payload: &'a [u8]) -> Result<Self, CodingError> {
        let (first, rest) = payload.split_first_chunk::<4>().ok_or(CodingError::GroupCut)?;
        Ok(Self { low: 0, high: u32::MAX, value: u32::from_be_bytes(*first), rest })
    }

    /// Checks that the payload was used up.
    ///
    /// # Errors
    /// Bytes are left.
    pub fn finish(self) -> Result<(), CodingError> {
        if self.rest.is_empty() && self.value == self.low {
            return Ok(());
        }
        Err(CodingError::GroupSurplus)
    }
}

impl BitCoder for Decoder<'_> {
    #[inline(always)]
    fn code(&mut self, context: &mut Bit, _: bool) -> Result<bool, CodingError> {
        let mid = split(self.low, self.high, context.probability());
        let bit = self.value <= mid;
        if bit {
            self.high = mid;
        } else {
            self.low = mid + 1;
        }
        context.learn(bit);
        while (self.low ^ self.high) >> 24 == 0 {
            let (next, rest) = self.rest.split_first().ok_or(CodingError::GroupCut)?;
            self.rest = rest;
            self.low <<= 8;
            self.high = self.high << 8 | 0xff;
            self.value = self.value << 8 | u32::from(*next);
        }
        Ok(bit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_any_skew_come_back_and_skew_is_worth_bytes() {
        for one_in in [1_u32, 2, 3, 50, 5000] {
            let bits: Vec<bool> = (0..20_000_u32)
                .map(|i| (i.wrapping_mul(2_654_435_761) >> 13).is_multiple_of(one_in))
                .collect();
            let mut contexts = [Bit::NEW; 2];
            let mut encoder = Encoder::default();
            for (i, b) in bits.iter().enumerate() {
                encoder.code(&mut contexts[i % 2], *b).unwrap();
            }
            let payload = encoder.finish();
            let mut contexts = [Bit::NEW; 2];
            let mut decoder = Decoder::new(&payload).unwrap();
            for (i, b) in bits.iter().enumerate() {
                assert_eq!(decoder.code(&mut contexts[i % 2], false).unwrap(), *b);
            }
            decoder.finish().unwrap();
            if one_in != 2 && one_in != 3 {
                assert!(payload.len() < 500, "{one_in}: {}", payload.len());
            }
        }
    }

    #[test]
    fn a_payload_cut_anywhere_is_an_error_and_never_a_panic() {
        let mut encoder = Encoder::default();
        let mut context = Bit::NEW;
        for i in 0..1000 {
            encoder.code(&mut context, i % 7 < 3).unwrap();
        }
        let payload = encoder.finish();
        for len in 0..payload.len() {
            let mut context = Bit::NEW;
            let all = Decoder::new(&payload[..len]).and_then(|mut d| {
                (0..1000).try_for_each(|_| d.code(&mut context, false).map(|_| ()))?;
                d.finish()
            });
            assert!(all.is_err(), "{len}");
        }
    }
}
