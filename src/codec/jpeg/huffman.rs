//! Huffman tables (T.81, C and F.2.2.3): short codes by one look-up, long ones by comparing limits.

use super::super::CodecError;
use super::bytes::Segment;
use crate::codec::damaged;

/// Codes up to this length are found with one look-up; 512 entries of two bytes.
const LOOKUP_BITS: u32 = 9;

/// One table, ready for decoding. About 1.5 KiB.
pub(super) struct Huffman {
    /// Indexed by the next [`LOOKUP_BITS`] bits: code length in the upper byte, symbol in the lower; 0 for longer codes
    /// and for invalid ones.
    lookup: [u16; 1 << LOOKUP_BITS],
    /// For each length, one more than its last code, shifted up to 16 bits.
    limit: [u32; 17],
    /// For each length, the difference between a code and the index of its symbol.
    offset: [i32; 17],
    symbols: [u8; 256],
}

impl Huffman {
    /// Reads a table as a DHT segment holds it: 16 counts, then the symbols.
    pub(super) fn read(segment: &mut Segment<'_, '_>) -> Result<Self, CodecError> {
        let mut counts = [0; 16];
        for count in &mut counts {
            *count = segment.byte()?;
        }
        let total: usize = counts.iter().map(|&c| usize::from(c)).sum();
        let mut symbols = [0; 256];
        let used = symbols.get_mut(..total).ok_or_else(|| {
            damaged(format!("a Huffman table has {total} codes, and 256 are the most there can be"))
        })?;
        for symbol in used {
            *symbol = segment.byte()?;
        }
        Self::new(&counts, symbols)
    }

    /// Assigns the codes in order of length, as T.81 C.2 does.
    pub(super) fn new(counts: &[u8; 16], symbols: [u8; 256]) -> Result<Self, CodecError> {
        let mut table = Self { lookup: [0; 1 << LOOKUP_BITS], limit: [0; 17], offset: [0; 17], symbols };
        let (mut code, mut place) = (0_u32, 0_u32);
        for (length, &count) in (1_u32..).zip(counts) {
            let first = code;
            code += u32::from(count);
            if code > 1 << length {
                return Err(damaged(format!("a Huffman table has too many codes of {length} bits")));
            }
            let slot = length as usize;
            // Both are at most 65536.
            table.offset[slot] = place.cast_signed() - first.cast_signed();
            table.limit[slot] = code << (16 - length);
            place += u32::from(count);
            if length <= LOOKUP_BITS {
                let spread = LOOKUP_BITS - length;
                let symbols = table.symbols.iter().skip((place - u32::from(count)) as usize);
                for (code, &symbol) in (first..code).zip(symbols) {
                    let range = (code << spread) as usize..((code + 1) << spread) as usize;
                    table.lookup[range].fill(u16::from_be_bytes([slot.to_le_bytes()[0], symbol]));
                }
            }
            code <<= 1;
        }
        Ok(table)
    }

    /// Length and symbol of the code that 16 bits begin with; length 0 for an invalid code.
    #[inline]
    pub(super) fn find(&self, bits: u16) -> (u32, u8) {
        let [length, symbol] = self.lookup[usize::from(bits >> (16 - LOOKUP_BITS))].to_be_bytes();
        if length != 0 { (length.into(), symbol) } else { self.find_long(bits) }
    }

    /// Like `find`, for codes longer than the look-up.
    fn find_long(&self, bits: u16) -> (u32, u8) {
        for length in LOOKUP_BITS + 1..=16 {
            let slot = length as usize;
            if u32::from(bits) < self.limit[slot] {
                let place = i32::from(bits >> (16 - length)) + self.offset[slot];
                let symbol = usize::try_from(place).ok().and_then(|place| self.symbols.get(place));
                if let Some(&symbol) = symbol {
                    return (length, symbol);
                }
            }
        }
        (0, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every 16-bit string against a search through all codes written out.
    fn check(counts: &[u8; 16]) {
        let mut symbols = [0; 256];
        for (i, symbol) in symbols.iter_mut().enumerate() {
            *symbol = u8::try_from(255 - i).unwrap();
        }
        let table = Huffman::new(counts, symbols).unwrap();
        let mut codes = Vec::new();
        let (mut code, mut place) = (0_u32, 0);
        for (length, &count) in (1_u32..).zip(counts) {
            for _ in 0..count {
                codes.push((length, code, symbols[place]));
                (code, place) = (code + 1, place + 1);
            }
            code <<= 1;
        }
        for bits in 0..=u16::MAX {
            let expected = codes.iter().find(|&&(length, code, _)| u32::from(bits) >> (16 - length) == code);
            let found = Some(table.find(bits)).filter(|&(length, _)| length > 0);
            assert_eq!(found, expected.map(|&(length, _, symbol)| (length, symbol)), "{bits:016b}");
        }
    }

    #[test]
    fn every_bit_string_finds_its_code() {
        check(&[0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125]);
        check(&[0, 0, 0, 0, 0, 0, 0, 255, 1, 0, 0, 0, 0, 0, 0, 0]);
        check(&[1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
        check(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 9]);
        check(&[0; 16]);
    }

    #[test]
    fn too_many_codes_are_refused() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert!(Huffman::new(&counts, [0; 256]).is_err());
        counts = [1; 16];
        counts[15] = 3;
        assert!(Huffman::new(&counts, [0; 256]).is_err());
    }
}
