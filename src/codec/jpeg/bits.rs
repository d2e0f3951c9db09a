//! Entropy-coded bits: byte stuffing undone, markers kept apart, restart intervals counted.

use super::super::CodecError;
use super::bytes::{Bytes, ends_early};
use super::huffman::Huffman;
use crate::codec::damaged;

/// Bytes between the end of a scan's data and the next marker that are taken for padding. More mean that
/// decoding lost its way through the bits.
const MAX_PADDING: u32 = 64;

pub(super) struct Bits<'b, 'r> {
    bytes: &'b mut Bytes<'r>,
    /// The next bits, the first one highest; zero below the valid `count`.
    window: u64,
    count: u32,
    /// The marker that ended the data.
    marker: Option<u8>,
    /// Set once the input has ended without a marker.
    ended: bool,
}

impl<'b, 'r> Bits<'b, 'r> {
    /// Starts reading bits at the next byte of the input.
    pub(super) fn new(bytes: &'b mut Bytes<'r>) -> Self {
        Self { bytes, window: 0, count: 0, marker: None, ended: false }
    }

    /// The next 16 bits, not consumed; zeros past the end of the data.
    #[inline]
    pub(super) fn peek(&mut self) -> Result<u16, CodecError> {
        if self.count < 32 {
            self.refill()?;
        }
        let [high, low, ..] = self.window.to_be_bytes();
        Ok(u16::from_be_bytes([high, low]))
    }

    #[inline]
    pub(super) fn symbol(&mut self, table: &Huffman) -> Result<u8, CodecError> {
        let (length, symbol) = table.find(self.peek()?);
        if length == 0 {
            return Err(no_such_code());
        }
        self.consume(length)?;
        Ok(symbol)
    }

    /// The next `count` bits, at most 16, as a number.
    #[inline]
    pub(super) fn number(&mut self, count: u32) -> Result<i32, CodecError> {
        debug_assert!(count <= 16);
        if self.count < count {
            self.refill()?;
        }
        // Two shifts, because of a count of 0.
        let [.., a, b, c, d] = ((self.window >> 1) >> (63 - count)).to_be_bytes();
        self.consume(count)?;
        Ok(i32::from_be_bytes([a, b, c, d]))
    }

    /// A signed difference of `size` bits, at most 16 (T.81 F.2.2.1, EXTEND).
    #[inline]
    pub(super) fn signed(&mut self, size: u32) -> Result<i32, CodecError> {
        let value = self.number(size)?;
        // A first bit of 0 means a negative value.
        let negative = value < (1 << size) >> 1;
        Ok(if negative { value - (1 << size) + 1 } else { value })
    }

    #[inline]
    pub(super) fn bit(&mut self) -> Result<bool, CodecError> {
        Ok(self.number(1)? != 0)
    }

    /// Takes bits, fewer than 64.
    ///
    /// # Errors
    /// Fewer bits are left.
    #[inline]
    pub(super) fn consume(&mut self, count: u32) -> Result<(), CodecError> {
        self.count = self.count.checked_sub(count).ok_or_else(ends_early)?;
        self.window <<= count;
        Ok(())
    }

    /// Fills the window to at least 57 bits, or with all that come before a marker or the end.
    fn refill(&mut self) -> Result<(), CodecError> {
        // Bytes in the buffer after a marker do not belong to this scan.
        if self.marker.is_none()
            && let Some(word) = self.bytes.eight_plain()
        {
            let whole_bytes = (64 - self.count) / 8;
            if whole_bytes == 0 {
                return Ok(());
            }
            let unused = 64 - whole_bytes * 8;
            self.window |= ((word >> unused) << unused) >> self.count;
            self.count += whole_bytes * 8;
            self.bytes.take(whole_bytes as usize);
            return Ok(());
        }
        while self.count <= 56 {
            let Some(byte) = self.data_byte()? else { break };
            self.window |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
        Ok(())
    }

    /// The next byte of data; none once a marker or the end of the input is met.
    fn data_byte(&mut self) -> Result<Option<u8>, CodecError> {
        if self.marker.is_some() || self.ended {
            return Ok(None);
        }
        match self.bytes.next()? {
            Some(0xFF) => {}
            Some(byte) => return Ok(Some(byte)),
            None => {
                self.ended = true;
                return Ok(None);
            }
        }
        loop {
            match self.bytes.next()? {
                Some(0x00) => return Ok(Some(0xFF)),
                // Fill bytes before a marker.
                Some(0xFF) => {}
                Some(code) => {
                    self.marker = Some(code);
                    return Ok(None);
                }
                None => {
                    self.ended = true;
                    return Ok(None);
                }
            }
        }
    }

    /// Passes over padding to the marker behind the data; none if the input ends without one.
    ///
    /// # Errors
    /// Too many bytes are left over for padding.
    pub(super) fn finish(&mut self) -> Result<Option<u8>, CodecError> {
        let mut left_over = self.count / 8;
        (self.window, self.count) = (0, 0);
        while let Some(byte) = self.data_byte()? {
            left_over += u32::from(byte != 0);
            if left_over > MAX_PADDING {
                return Err(damaged("its data go on after the last pixel"));
            }
        }
        Ok(self.marker)
    }

    /// Passes over the restart marker of the given number, which must come next.
    fn restart(&mut self, number: u8) -> Result<(), CodecError> {
        if self.finish()? != Some(0xD0 + number) {
            return Err(damaged(format!("restart marker {number} is missing")));
        }
        self.marker = None;
        Ok(())
    }
}

/// Error for a bit string that is not a code; kept out of the hot path.
#[cold]
fn no_such_code() -> CodecError {
    damaged("it holds a code that its Huffman table does not have")
}

/// Counts the units of a scan towards its restart markers (T.81, B.2.4.4).
pub(super) struct Restarts {
    interval: u32,
    left: u32,
    number: u8,
}

impl Restarts {
    /// `interval` units lie between two markers; 0 for none.
    pub(super) fn new(interval: u32) -> Self {
        Self { interval, left: interval, number: 0 }
    }

    /// Called before each unit; passes over a marker that is due, and returns true for one.
    #[inline]
    pub(super) fn unit(&mut self, bits: &mut Bits<'_, '_>) -> Result<bool, CodecError> {
        if self.interval == 0 {
            return Ok(false);
        }
        let due = self.left == 0;
        if due {
            bits.restart(self.number)?;
            self.number = (self.number + 1) % 8;
            self.left = self.interval;
        }
        self.left -= 1;
        Ok(due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_come_in_order_across_stuffing_and_refills() {
        let plain: Vec<u8> =
            (0..400_u32).map(|i| if i % 23 < 2 { 0xFF } else { (i * i * 37).to_le_bytes()[0] }).collect();
        let stuffed: Vec<u8> =
            plain.iter().flat_map(|&b| if b == 0xFF { vec![b, 0] } else { vec![b] }).collect();
        assert!(stuffed.len() > plain.len());
        let mut input = [&stuffed[..], &[0xFF, 0xFF, 0xD9]].concat();
        input.extend([0x55; 20]);
        let mut input = &input[..];
        let mut bytes = Bytes::new(&mut input);
        let mut bits = Bits::new(&mut bytes);
        let mut at = 0;
        for step in (0..=16).cycle() {
            if at + step > plain.len() * 8 {
                break;
            }
            let expected = (at..at + step).fold(0, |n, i| n * 2 + i32::from(plain[i / 8] >> (7 - i % 8) & 1));
            assert_eq!(bits.number(u32::try_from(step).unwrap()).unwrap(), expected, "at bit {at}");
            at += step;
        }
        assert!(bits.number(16).is_err());
        assert_eq!(bits.finish().unwrap(), Some(0xD9));
    }

    #[test]
    fn differences_are_extended_as_the_standard_says() {
        // T.81 table F.1: 3 bits 000..111 are -7..-4 and 4..7.
        let mut input = &[0b0000_0101, 0b0011_1001, 0b0111_0111][..];
        let mut bytes = Bytes::new(&mut input);
        let mut bits = Bits::new(&mut bytes);
        let values: Vec<i32> = (0..8).map(|_| bits.signed(3).unwrap()).collect();
        assert_eq!(values, [-7, -6, -5, -4, 4, 5, 6, 7]);
        assert_eq!(bits.signed(0).unwrap(), 0);
        assert!(bits.signed(1).is_err());
    }

    #[test]
    fn much_left_over_is_damage_and_padding_is_not() {
        let end = |data: &[u8]| {
            let mut input = data;
            let mut bytes = Bytes::new(&mut input);
            let mut bits = Bits::new(&mut bytes);
            bits.number(3).unwrap();
            bits.finish().map_err(|e| e.to_string())
        };
        assert_eq!(end(&[&[1; 60][..], &[0xFF, 0xD9]].concat()), Ok(Some(0xD9)));
        assert_eq!(end(&[0; 1000]), Ok(None));
        assert!(end(&[1; 100]).unwrap_err().contains("go on after"));
    }

    #[test]
    fn restart_markers_come_in_turn() {
        let mut data = Vec::new();
        for number in 0..20_u8 {
            data.extend([0x80, 0xFF, 0xD0 + number % 8]);
        }
        let mut input = &data[..];
        let mut bytes = Bytes::new(&mut input);
        let mut bits = Bits::new(&mut bytes);
        let mut restarts = Restarts::new(2);
        for unit in 0..40 {
            assert_eq!(restarts.unit(&mut bits).unwrap(), unit > 0 && unit % 2 == 0, "{unit}");
            assert_eq!(bits.bit().unwrap(), unit % 2 == 0);
        }
        let mut input = &[0x80, 0xFF, 0xD1, 0x80][..];
        let mut bytes = Bytes::new(&mut input);
        let mut bits = Bits::new(&mut bytes);
        assert!(bits.restart(0).unwrap_err().to_string().contains("restart marker 0"));
    }
}
