//! Samples written as text: numbers, or hexadecimal digits.

use std::io::{self, BufRead, Read};

use super::Samples;

use crate::fault::{Fault, bad};
use crate::volume::ScalarType;

/// Most characters of one number.
const LONGEST: usize = 64;

fn wrong(fault: Fault) -> io::Error {
    fault.in_stream()
}

/// Numbers between white space or commas as the little-endian bytes of their type.
pub(super) struct Numbers<R> {
    inner: R,
    samples: Samples,
    sample: [u8; 8],
    /// Bytes of `sample` that were not handed out yet are the ones from here on.
    given: usize,
    /// Marks since the last number: 1 for commas, 2 for blanks, 4 for ends of lines.
    gap: u8,
    /// True once a comma alone, and once blanks alone, stood between numbers of a line.
    parted: [bool; 2],
}

impl<R: BufRead> Numbers<R> {
    pub(super) fn new(inner: R, samples: Samples) -> Self {
        Self { inner, samples, sample: [0; 8], given: samples.bytes(), gap: 4, parted: [false; 2] }
    }

    /// The next number; empty at the end.
    fn token(&mut self) -> io::Result<([u8; LONGEST], usize)> {
        let (mut token, mut length) = ([0; LONGEST], 0);
        loop {
            let input = self.inner.fill_buf()?;
            if input.is_empty() {
                return Ok((token, length));
            }
            let mut used = 0;
            for byte in input {
                used += 1;
                let mark = match byte {
                    b',' => 1,
                    b'\n' => 4,
                    _ => 2 * u8::from(byte.is_ascii_whitespace()),
                };
                self.gap |= mark;
                if mark > 0 && length > 0 {
                    self.inner.consume(used);
                    return Ok((token, length));
                }
                if mark == 0 {
                    self.parted = [self.parted[0] || self.gap == 1, self.parted[1] || self.gap == 2];
                    if self.parted == [true; 2] {
                        let fault = bad!(
                            "both commas and blanks alone are between numbers; write decimals with a point"
                        );
                        return Err(wrong(fault));
                    }
                    self.gap = 0;
                    *token.get_mut(length).ok_or_else(|| wrong(bad!("a number is too long")))? = *byte;
                    length += 1;
                }
            }
            self.inner.consume(used);
        }
    }

    /// Reads the next sample; false at the end.
    fn next(&mut self) -> io::Result<bool> {
        let (token, length) = self.token()?;
        let text = std::str::from_utf8(token.get(..length).unwrap_or_default()).unwrap_or("?");
        if text.is_empty() {
            return Ok(false);
        }
        self.sample = encode(self.samples, text)
            .ok_or_else(|| wrong(bad!("`{}` is not a number of its type", text.escape_default())))?;
        self.given = 0;
        Ok(true)
    }
}

impl<R: BufRead> Read for Numbers<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let mut written = 0;
        let width = self.samples.bytes();
        while written < buf.len() {
            if self.given >= width && !self.next()? {
                break;
            }
            let part = self.sample.get(self.given..width).unwrap_or_default();
            let count = part.len().min(buf.len() - written);
            if let (Some(out), Some(part)) = (buf.get_mut(written..written + count), part.get(..count)) {
                out.copy_from_slice(part);
            }
            self.given += count;
            written += count;
        }
        Ok(written)
    }
}

/// Little-endian bytes of a number in the first bytes; `None` if it does not fit.
fn encode(samples: Samples, text: &str) -> Option<[u8; 8]> {
    let mut bytes = [0; 8];
    let mut put = |value: &[u8]| bytes.iter_mut().zip(value).for_each(|(to, from)| *to = *from);
    let text = text.strip_prefix('+').unwrap_or(text);
    match samples {
        Samples::Plain(ScalarType::F64) => put(&text.parse::<f64>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::F32) => put(&text.parse::<f32>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::U8) => put(&text.parse::<u8>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::I8) => put(&text.parse::<i8>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::U16) => put(&text.parse::<u16>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::I16) => put(&text.parse::<i16>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::U32) => put(&text.parse::<u32>().ok()?.to_le_bytes()),
        Samples::Plain(ScalarType::I32) => put(&text.parse::<i32>().ok()?.to_le_bytes()),
        Samples::I64 => put(&text.parse::<i64>().ok()?.to_le_bytes()),
        Samples::U64 => put(&text.parse::<u64>().ok()?.to_le_bytes()),
        // No text format has halves.
        Samples::F16 => return None,
    }
    Some(bytes)
}

/// Hexadecimal digits, two for a byte, white space between them ignored.
pub(super) struct Hex<R>(pub(super) R);

impl<R: BufRead> Read for Hex<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        for (written, out) in buf.iter_mut().enumerate() {
            let Some(high) = digit(&mut self.0)? else { return Ok(written) };
            let low = digit(&mut self.0)?.ok_or_else(|| wrong(bad!("half a byte at the end")))?;
            *out = high << 4 | low;
        }
        Ok(buf.len())
    }
}

fn digit(inner: &mut impl BufRead) -> io::Result<Option<u8>> {
    loop {
        let Some(byte) = inner.fill_buf()?.first().copied() else { return Ok(None) };
        inner.consume(1);
        if !byte.is_ascii_whitespace() {
            let value = char::from(byte).to_digit(16).and_then(|d| u8::try_from(d).ok());
            return value.map(Some).ok_or_else(|| wrong(bad!("a character is not a hexadecimal digit")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_as_bytes_of_their_type() {
        let read = |text: &str, samples| {
            let mut out = Vec::new();
            Numbers::new(text.as_bytes(), samples).read_to_end(&mut out).map(|_| out)
        };
        let i16s = Samples::Plain(ScalarType::I16);
        assert_eq!(read(" 1, -2\n\t+258 ", i16s).unwrap(), [1, 0, 0xfe, 0xff, 2, 1]);
        assert_eq!(read("1.5e0", Samples::Plain(ScalarType::F32)).unwrap(), 1.5_f32.to_le_bytes());
        assert!(read("", i16s).unwrap().is_empty());
        assert_eq!(read("1,2\n3 , 4", i16s).unwrap(), [1, 0, 2, 0, 3, 0, 4, 0]);
        for decimals in ["1,5 2,5", "1 2,5\n", "1,5\n2\t3"] {
            let fault = read(decimals, i16s).unwrap_err().to_string();
            assert!(fault.contains("write decimals with a point"), "{decimals}: {fault}");
        }
        for wrong in ["40000", "1.5", "x", &"1".repeat(65), "\u{e4}"] {
            assert_eq!(read(wrong, i16s).unwrap_err().kind(), io::ErrorKind::InvalidData, "{wrong}");
        }
    }

    #[test]
    fn hexadecimal_digits_come_in_pairs() {
        let read = |text: &str| {
            let mut out = Vec::new();
            Hex(text.as_bytes()).read_to_end(&mut out).map(|_| out)
        };
        assert_eq!(read("0aF f\n10").unwrap(), [0x0a, 0xff, 0x10]);
        assert!(read("0g").is_err() && read("0a1").is_err());
    }
}
