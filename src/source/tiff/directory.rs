//! Directories of a TIFF file, classic and BigTIFF, read by position; no list is longer than its file.

use std::io;

use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::volume::Endian;

/// Most entries of one directory; real ones have some 20.
const MAX_ENTRIES: u64 = 512;

/// The error of damaged data.
pub(super) fn damaged(fault: Fault) -> io::Error {
    fault.in_stream()
}

/// An open file and its byte order and form.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tiff<'a> {
    pub(super) file: &'a PositionalFile,
    pub(super) length: u64,
    pub(super) endian: Endian,
    big: bool,
}

/// One entry of a directory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    tag: u16,
    kind: u16,
    pub(super) count: u64,
    /// The values themselves where they fit, else their offset.
    value: [u8; 8],
}

/// A directory: one picture.
pub(super) struct Directory {
    entries: Vec<Entry>,
    /// Offset of the next directory; 0 behind the last.
    pub(super) next: u64,
}

impl Directory {
    pub(super) fn get(&self, tag: u16) -> Option<&Entry> {
        self.entries.iter().find(|e| e.tag == tag)
    }
}

impl<'a> Tiff<'a> {
    /// Reads the head; gives back the offset of the first directory, too.
    pub(super) fn open(file: &'a PositionalFile) -> io::Result<(Self, u64)> {
        let length = file.metadata()?.len();
        let mut head = [0; 16];
        file.read_exact_at(head.get_mut(..8).unwrap_or_default(), 0)?;
        let endian = match head.first_chunk::<2>() {
            Some(b"II") => Endian::Little,
            Some(b"MM") => Endian::Big,
            _ => return Err(damaged(bad!("it is not a TIFF"))),
        };
        let mut tiff = Self { file, length, endian, big: false };
        let first = match tiff.number(head.get(2..4).unwrap_or_default()) {
            42 => tiff.number(head.get(4..8).unwrap_or_default()),
            43 => {
                file.read_exact_at(&mut head, 0)?;
                if tiff.number(head.get(4..6).unwrap_or_default()) != 8 {
                    return Err(damaged(bad!("its BigTIFF head is damaged")));
                }
                tiff.big = true;
                tiff.number(head.get(8..16).unwrap_or_default())
            }
            version => return Err(damaged(bad!("it is TIFF of the unknown version {version}"))),
        };
        Ok((tiff, first))
    }

    /// An unsigned number of up to 8 bytes in the file's order.
    fn number(&self, bytes: &[u8]) -> u64 {
        let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        match self.endian {
            Endian::Big => bytes.iter().fold(0, add),
            Endian::Little => bytes.iter().rev().fold(0, add),
        }
    }

    /// The directory at `offset`.
    pub(super) fn directory(&self, offset: u64) -> io::Result<Directory> {
        let (count_bytes, entry_bytes, offset_bytes) = if self.big { (8, 20, 8) } else { (2, 12, 4) };
        let mut word = [0; 8];
        let count = word.get_mut(..count_bytes).unwrap_or_default();
        self.file.read_exact_at(count, offset)?;
        let count = self.number(count);
        if count > MAX_ENTRIES {
            return Err(damaged(bad!("a directory of {count} entries is not valid")));
        }
        let bytes = usize::try_from(count).unwrap_or(0) * entry_bytes + offset_bytes;
        let mut buffer = vec![0; bytes];
        self.file.read_exact_at(&mut buffer, offset.saturating_add(count_bytes as u64))?;
        let (list, next) = buffer.split_at(bytes - offset_bytes);
        let entries = list
            .chunks_exact(entry_bytes)
            .map(|entry| {
                let value_at = entry_bytes - offset_bytes;
                let mut value = [0; 8];
                let stored = entry.get(value_at..).unwrap_or_default();
                value.iter_mut().zip(stored).for_each(|(to, from)| *to = *from);
                let number = |at: usize, end: usize| self.number(entry.get(at..end).unwrap_or_default());
                let short = |n: u64| u16::try_from(n).unwrap_or(0);
                Entry {
                    tag: short(number(0, 2)),
                    kind: short(number(2, 4)),
                    count: number(4, value_at),
                    value,
                }
            })
            .collect();
        Ok(Directory { entries, next: self.number(next) })
    }

    /// Bytes of an element, and where the list lies: `None` inside the entry.
    fn place(&self, entry: &Entry) -> io::Result<(u64, Option<u64>)> {
        let size = match entry.kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            code => return Err(damaged(bad!("a field of the unknown type {code}"))),
        };
        let inside = if self.big { 8 } else { 4 };
        if entry.count.saturating_mul(size) <= inside {
            return Ok((size, None));
        }
        let offset = self.number(entry.value.get(..if self.big { 8 } else { 4 }).unwrap_or_default());
        Ok((size, Some(offset)))
    }

    /// Bytes of element `index`.
    fn bytes(&self, entry: &Entry, index: u64) -> io::Result<([u8; 8], usize)> {
        if index >= entry.count {
            return Err(damaged(bad!("a field has {} values where more are needed", entry.count)));
        }
        let (size, place) = self.place(entry)?;
        let width = usize::try_from(size).unwrap_or(8);
        let mut out = [0; 8];
        let target = out.get_mut(..width).unwrap_or_default();
        match place {
            Some(offset) => self.file.read_exact_at(target, offset.saturating_add(index * size))?,
            None => {
                let at = usize::try_from(index * size).unwrap_or(0);
                let found = entry.value.get(at..at + width).unwrap_or_default();
                target.iter_mut().zip(found).for_each(|(to, from)| *to = *from);
            }
        }
        Ok((out, width))
    }

    /// Element `index` of a list of whole numbers.
    pub(super) fn element(&self, entry: &Entry, index: u64) -> io::Result<u64> {
        let (bytes, width) = self.bytes(entry, index)?;
        Ok(self.number(bytes.get(..width).unwrap_or_default()))
    }

    /// The one number of a field, or `default` where the field is missing.
    pub(super) fn value(&self, directory: &Directory, tag: u16, default: u64) -> io::Result<u64> {
        directory.get(tag).map_or(Ok(default), |entry| self.element(entry, 0))
    }

    /// A ratio, infinite where a number is divided by 0; `None` where the field is missing or senseless.
    pub(super) fn ratio(&self, directory: &Directory, tag: u16) -> io::Result<Option<f64>> {
        let Some(entry) = directory.get(tag) else { return Ok(None) };
        let (bytes, width) = self.bytes(entry, 0)?;
        let (over, under) = bytes.split_at(4);
        let part = |bytes: &[u8]| u32::try_from(self.number(bytes)).map_or(0.0, f64::from);
        let bits = self.number(&bytes[..width]);
        let ratio = match entry.kind {
            // Some writers store whole numbers, without a divisor.
            3 | 4 => part(&bytes[..width]),
            5 => part(over) / part(under),
            11 => u32::try_from(bits).map_or(0.0, |bits| f32::from_bits(bits).into()),
            12 => f64::from_bits(bits),
            kind => return Err(damaged(bad!("its resolution is of the type {kind}, which is not a ratio"))),
        };
        Ok((ratio > 0.0).then_some(ratio))
    }

    /// Text of a field, its first `most` bytes.
    pub(super) fn text(&self, directory: &Directory, tag: u16, most: u64) -> io::Result<String> {
        let Some(entry) = directory.get(tag).filter(|e| matches!(e.kind, 1 | 2 | 7)) else {
            return Ok(String::new());
        };
        let length = entry.count.min(most);
        let (_, place) = self.place(entry)?;
        let mut bytes = vec![0; usize::try_from(length.min(self.length)).unwrap_or(0)];
        match place {
            Some(offset) => self.file.read_exact_at(&mut bytes, offset)?,
            None => bytes.iter_mut().zip(entry.value).for_each(|(to, from)| *to = from),
        }
        let text: Vec<u8> = bytes.into_iter().take_while(|b| *b != 0).collect();
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}
