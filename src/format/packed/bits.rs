//! Bits of given probabilities in words of 32 bits: a range coder (SPEC 5.6).

use super::CodingError;

/// Least and greatest coded probability, of 65536: bits are never certain.
pub(super) const PROBABILITIES: [u32; 2] = [24, 65512];

/// Either direction of coding: an encoder writes the given bits, a decoder ignores them and returns the bits it reads.
pub(super) trait BitCoder {
    /// True for a decoder, whose results may differ from the given bits.
    const READS: bool;

    /// Codes a bit that is 1 with a probability of `one` in 65536.
    fn bit(&mut self, one: u32, bit: bool) -> bool;
}

#[derive(Debug)]
pub(super) struct BitEncoder {
    low: u64,
    range: u64,
    words: Vec<u32>,
}

impl BitEncoder {
    pub(super) fn new() -> Self {
        Self { low: 0, range: u64::MAX, words: Vec::new() }
    }

    /// Raises the low end of the range; an overflow is carried into the words.
    #[inline(always)]
    fn raise(&mut self, by: u64) {
        let (low, carries) = self.low.overflowing_add(by);
        self.low = low;
        if carries {
            for word in self.words.iter_mut().rev() {
                *word = word.wrapping_add(1);
                if *word != 0 {
                    break;
                }
            }
        }
    }

    /// The payload: the shortest sequence of words that, followed by zeros, lies in the range.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.raise(u64::from(u32::MAX));
        self.words.push((self.low >> 32) as u32);
        self.words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }
}

impl BitCoder for BitEncoder {
    const READS: bool = false;

    #[inline(always)]
    fn bit(&mut self, one: u32, bit: bool) -> bool {
        let ones = (self.range >> 16) * u64::from(one);
        if bit {
            self.range = ones;
        } else {
            self.range -= ones;
            self.raise(ones);
        }
        if self.range >> 32 == 0 {
            self.words.push((self.low >> 32) as u32);
            self.low <<= 32;
            self.range <<= 32;
        }
        bit
    }
}

#[derive(Debug)]
pub(super) struct BitDecoder<'a> {
    /// Difference between the payload and the low end of the range.
    above: u64,
    range: u64,
    words: &'a [[u8; 4]],
    /// Index of the next word; past the end, zeros are read.
    at: usize,
}

impl<'a> BitDecoder<'a> {
    /// Starts on a payload.
    ///
    /// # Errors
    /// The length is not a multiple of a word.
    pub(super) fn new(payload: &'a [u8]) -> Result<Self, CodingError> {
        let (words, rest) = payload.as_chunks::<4>();
        if words.is_empty() || !rest.is_empty() {
            return Err(CodingError::GROUP_CUT);
        }
        let mut new = Self { above: 0, range: u64::MAX, words, at: 0 };
        new.above = new.word() << 32;
        new.above |= new.word();
        Ok(new)
    }

    #[inline(always)]
    fn word(&mut self) -> u64 {
        let word = self.words.get(self.at).map_or(0, |word| u32::from_le_bytes(*word));
        self.at += 1;
        word.into()
    }

    /// Checks that at most one word of zeros was read past the end of the payload.
    ///
    /// # Errors
    /// More were read.
    #[inline(always)]
    pub(super) fn check(&self) -> Result<(), CodingError> {
        if self.at > self.words.len() + 1 { Err(CodingError::GROUP_CUT) } else { Ok(()) }
    }

    /// Checks that the payload was used up.
    ///
    /// # Errors
    /// Words are left, or the payload ended early.
    pub(super) fn finish(self) -> Result<(), CodingError> {
        self.check()?;
        if self.at <= self.words.len() { Err(CodingError::GROUP_SURPLUS) } else { Ok(()) }
    }
}

impl BitCoder for BitDecoder<'_> {
    const READS: bool = true;

    #[inline(always)]
    fn bit(&mut self, one: u32, _: bool) -> bool {
        let ones = (self.range >> 16) * u64::from(one);
        let bit = self.above < ones;
        if bit {
            self.range = ones;
        } else {
            self.above -= ones;
            self.range -= ones;
        }
        if self.range >> 32 == 0 {
            self.above = self.above << 32 | self.word();
            self.range <<= 32;
        }
        bit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits of every skew, some against the odds.
    fn code(coder: &mut impl BitCoder, count: u32) -> Vec<bool> {
        (0..count)
            .map(|i| {
                let noise = i.wrapping_mul(2_654_435_761) >> 8;
                let one = [24, 300, 32_768, 65_000, 65_512][i as usize / 64 % 5];
                coder.bit(one, if i % 997 == 0 { one < 32_768 } else { noise % 65_536 < one })
            })
            .collect()
    }

    #[test]
    fn bits_of_any_skew_come_back_and_a_cut_or_longer_payload_is_refused() {
        for count in [0, 1, 31, 5000, 200_000] {
            let mut encoder = BitEncoder::new();
            let given = code(&mut encoder, count);
            let payload = encoder.finish();
            let decode = |payload: &[u8]| {
                let mut decoder = BitDecoder::new(payload)?;
                let got = code(&mut decoder, count);
                decoder.finish().map(|()| got)
            };
            assert_eq!(decode(&payload), Ok(given));
            let longer = [&payload[..], &[0; 4]].concat();
            assert_eq!(decode(&longer), Err(CodingError::GROUP_SURPLUS));
            assert_eq!(decode(&longer[..payload.len() + 1]), Err(CodingError::GROUP_CUT));
            assert_eq!(decode(&payload[..payload.len() - 4]), Err(CodingError::GROUP_CUT));
        }
    }

    /// Ones at the top of the range carry through all previous words.
    #[test]
    fn a_carry_goes_through_full_words() {
        let mut encoder =
            BitEncoder { low: u64::MAX - 5, range: 1 << 40, words: vec![7, u32::MAX, u32::MAX] };
        encoder.bit(32_768, false);
        assert_eq!(encoder.words, [8, 0, 0]);
    }
}
