//! The bytes of a JPEG-LS codestream: marker segments byte by byte, coded data bit by bit.

use std::io::Read;

use crate::codec::bytes::Bytes;
use crate::codec::{CodecError, damaged};

/// A codestream that is read front to back through a small buffer.
///
/// Coded data pass a window of 64 bits. After a byte 0xFF the encoder put one zero bit that is not data, so that 0xFF
/// with a byte of 0x80 and more is always a marker (T.87 section A.1); the window never reads past it.
pub(super) struct Stream<'a> {
    bytes: Bytes<'a>,
    /// Coded bits not taken yet, the next one on top; zeros below `bits`.
    window: u64,
    /// Number of data bits in the window.
    bits: u32,
    /// The code of the marker that ended the coded data.
    marker: Option<u8>,
}

impl<'a> Stream<'a> {
    pub(super) fn new(input: &'a mut dyn Read) -> Stream<'a> {
        Stream { bytes: Bytes::new(input), window: 0, bits: 0, marker: None }
    }

    pub(super) fn byte(&mut self) -> Result<u8, CodecError> {
        self.bytes.next()?.ok_or_else(ends_early)
    }

    /// Two bytes of a marker segment.
    pub(super) fn word(&mut self) -> Result<u16, CodecError> {
        Ok(u16::from_be_bytes([self.byte()?, self.byte()?]))
    }

    /// The code of the marker that follows: any number of bytes 0xFF and one that is neither 0xFF nor 0.
    pub(super) fn marker(&mut self) -> Result<u8, CodecError> {
        let first = self.byte()?;
        if first != 0xFF {
            return Err(damaged(format!("a marker was expected, not the byte {first:#04x}")));
        }
        loop {
            match self.byte()? {
                0xFF => {}
                0 => {
                    return Err(damaged("a marker was expected, not the bytes 0xff 0x00"));
                }
                code => return Ok(code),
            }
        }
    }

    /// Coded data begin at the next byte.
    pub(super) fn begin_bits(&mut self) {
        self.window = 0;
        self.bits = 0;
        self.marker = None;
    }

    /// Drops the rest of the coded data, and returns the code of the marker behind them.
    pub(super) fn end_bits(&mut self) -> Result<u8, CodecError> {
        loop {
            if let Some(code) = self.marker {
                return Ok(code);
            }
            self.window = 0;
            self.bits = 0;
            self.refill()?;
            if self.bits == 0 && self.marker.is_none() {
                return Err(ends_early());
            }
        }
    }

    /// Fills the window to more than 48 bits, unless the coded data end before.
    fn refill(&mut self) -> Result<(), CodecError> {
        while self.bits <= 48 && self.marker.is_none() {
            if self.refill_whole() {
                return Ok(());
            }
            let Some(byte) = self.bytes.next()? else { return Ok(()) };
            if byte != 0xFF {
                self.push(byte, 8);
                continue;
            }
            let Some(mut after) = self.bytes.next()? else { return Ok(()) };
            if after < 0x80 {
                self.push(byte, 8);
                self.push(after, 7);
                continue;
            }
            // Fill bytes 0xFF may stand before a marker.
            while after == 0xFF {
                after = self.byte()?;
            }
            self.marker = Some(after);
        }
        Ok(())
    }

    /// Puts `width` bits below the bits of the window, which has room for them.
    fn push(&mut self, byte: u8, width: u32) {
        self.window |= u64::from(byte) << (64 - width - self.bits);
        self.bits += width;
    }

    /// Takes as many whole bytes as fit where none of the next eight is 0xFF.
    fn refill_whole(&mut self) -> bool {
        let Some(next) = self.bytes.eight_plain() else { return false };
        let taken = (64 - self.bits) / 8;
        let kept = if taken == 8 { next } else { next & !(u64::MAX >> (8 * taken)) };
        self.window |= kept >> self.bits;
        self.bits += 8 * taken;
        self.bytes.take(taken as usize);
        true
    }

    /// The next `count` bits, at most 32.
    pub(super) fn bits(&mut self, count: u32) -> Result<u32, CodecError> {
        if count == 0 {
            return Ok(0);
        }
        if self.bits < count {
            self.refill()?;
            if self.bits < count {
                return Err(ends_early());
            }
        }
        let value = self.window >> (64 - count);
        self.window <<= count;
        self.bits -= count;
        u32::try_from(value).map_err(|_| ends_early())
    }

    #[inline]
    pub(super) fn bit(&mut self) -> Result<bool, CodecError> {
        if self.bits == 0 {
            self.refill()?;
            if self.bits == 0 {
                return Err(ends_early());
            }
        }
        let bit = self.window >> 63 == 1;
        self.window <<= 1;
        self.bits -= 1;
        Ok(bit)
    }

    /// One value of the limited-length Golomb code (T.87 section A.5.3): fewer than `escape` zeros, a one
    /// and `k` bits; or `escape` zeros, a one and the value less one in `wide` bits.
    #[inline]
    pub(super) fn golomb(&mut self, k: u32, escape: u32, wide: u32) -> Result<u64, CodecError> {
        if self.bits < 32 {
            self.refill()?;
        }
        let zeros = self.window.leading_zeros();
        if zeros < escape && zeros + 1 + k <= self.bits {
            let rest = (self.window << zeros) << 1;
            self.window = rest << k;
            self.bits -= zeros + 1 + k;
            // Shifted in two steps, because k may be 0.
            return Ok((u64::from(zeros) << k) | ((rest >> 1) >> (63 - k)));
        }
        self.golomb_slowly(k, escape, wide)
    }

    /// Like [`Stream::golomb`], for codes longer than the window has bits.
    #[cold]
    fn golomb_slowly(&mut self, k: u32, escape: u32, wide: u32) -> Result<u64, CodecError> {
        let mut zeros = 0;
        loop {
            self.refill()?;
            if self.bits == 0 {
                return Err(ends_early());
            }
            let run = self.window.leading_zeros().min(self.bits);
            zeros += run;
            if zeros > escape {
                return Err(damaged("a code word is longer than any that JPEG-LS has"));
            }
            self.bits -= run;
            self.window = self.window.checked_shl(run).unwrap_or(0);
            if self.bits > 0 {
                break;
            }
        }
        self.bits -= 1;
        self.window <<= 1;
        if zeros < escape {
            return Ok((u64::from(zeros) << k) | u64::from(self.bits(k)?));
        }
        Ok(u64::from(self.bits(wide)?) + 1)
    }
}

/// Error for input or coded data that end before the image does.
pub(super) fn ends_early() -> CodecError {
    damaged("it ends early")
}
