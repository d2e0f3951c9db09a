//! Reading by position, and sequential cursors over parts of a file, in small fixed memory.

use std::io;

use crate::format::FormatError;
use crate::load::LoadFault;
use crate::platform::FileExt;
use crate::platform::PositionalFile;

use super::LoadError;

/// Bytes that can be read at any position without a shared file pointer: a file, or memory in tests.
pub trait ReadAt: Sync {
    /// Length in bytes.
    fn byte_len(&self) -> io::Result<u64>;

    /// Fills `out` from `offset` on.
    ///
    /// # Errors
    /// The bytes end early or the operating system refused.
    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()>;
}

impl ReadAt for PositionalFile {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        self.read_exact_at(out, offset)
    }
}

/// A scratch file may be written elsewhere meanwhile.
impl ReadAt for std::fs::File {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        self.read_exact_at(out, offset)
    }
}

impl ReadAt for [u8] {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        let part = usize::try_from(offset)
            .ok()
            .and_then(|start| self.get(start..start.checked_add(out.len())?))
            .ok_or(io::ErrorKind::UnexpectedEof)?;
        out.copy_from_slice(part);
        Ok(())
    }
}

/// The error of a reader that does not know the file's name.
#[derive(Debug)]
pub enum Fault {
    /// A failure of the operating system.
    Io(io::Error),
    /// A fault in the bytes.
    Format(FormatError),
}

impl From<io::Error> for Fault {
    fn from(cause: io::Error) -> Self {
        Self::Io(cause)
    }
}

impl From<FormatError> for Fault {
    fn from(cause: FormatError) -> Self {
        Self::Format(cause)
    }
}

impl Fault {
    /// Adds the file's name.
    pub fn at(self, path: &std::path::Path) -> LoadError {
        let path = path.to_path_buf();
        match self {
            Self::Io(cause) => LoadError::from(LoadFault::Unreadable { path, cause }),
            Self::Format(cause) => LoadError::from(LoadFault::Format { path, cause }),
        }
    }
}

/// Sequential reader of one byte range; holds one buffer.
pub(crate) struct Cursor<'a, R: ?Sized> {
    source: &'a R,
    /// Next byte to fetch into the buffer.
    at: u64,
    end: u64,
    buffer: Vec<u8>,
    used: usize,
    capacity: usize,
}

impl<'a, R: ReadAt + ?Sized> Cursor<'a, R> {
    /// A cursor over `start..end` with a buffer of at most `capacity` bytes (allocated as needed).
    pub(crate) fn new(source: &'a R, start: u64, end: u64, capacity: usize) -> Self {
        Self { source, at: start, end, buffer: Vec::new(), used: 0, capacity: capacity.max(20) }
    }

    /// Number of bytes not yet taken.
    pub(crate) fn left(&self) -> u64 {
        self.end.saturating_sub(self.at) + (self.buffer.len() - self.used) as u64
    }

    /// The next part, at most as long as the buffer; empty at the end.
    ///
    /// # Errors
    /// Reading failed.
    pub(crate) fn next_part(&mut self) -> Result<&[u8], Fault> {
        if self.used == self.buffer.len() {
            self.refill()?;
        }
        let from = self.used;
        self.used = self.buffer.len();
        Ok(&self.buffer[from..])
    }

    /// Like [`Cursor::next_part`], of at most `most` bytes.
    ///
    /// # Errors
    /// Reading failed, or nothing is left.
    pub(crate) fn next_part_up_to(&mut self, most: usize) -> Result<&[u8], Fault> {
        if self.used == self.buffer.len() {
            self.refill()?;
        }
        let from = self.used;
        self.used = from + most.min(self.buffer.len() - from);
        if self.used == from && most > 0 {
            return Err(Fault::Io(io::ErrorKind::UnexpectedEof.into()));
        }
        Ok(&self.buffer[from..self.used])
    }

    /// The next `K` bytes, or `None` when fewer are left.
    ///
    /// # Errors
    /// Reading failed.
    #[inline]
    pub(crate) fn take<const K: usize>(&mut self) -> Result<Option<[u8; K]>, Fault> {
        if self.buffer.len() - self.used < K {
            if self.left() < K as u64 {
                return Ok(None);
            }
            self.refill()?;
        }
        let Some(bytes) = self.buffer.get(self.used..).and_then(|b| b.first_chunk::<K>()) else {
            return Ok(None);
        };
        self.used += K;
        Ok(Some(*bytes))
    }

    /// The next `len` bytes, at most 20, or `None` when fewer are left.
    ///
    /// # Errors
    /// Reading failed.
    #[inline]
    pub(crate) fn take_item(&mut self, len: usize) -> Result<Option<&[u8]>, Fault> {
        if self.buffer.len() - self.used < len {
            if self.left() < len as u64 {
                return Ok(None);
            }
            self.refill()?;
        }
        let from = self.used;
        self.used = (from + len).min(self.buffer.len());
        Ok(self.buffer.get(from..from + len))
    }

    /// The next `len` bytes, not consumed, or `None` when fewer are left or the buffer is shorter.
    ///
    /// # Errors
    /// Reading failed.
    #[inline]
    pub(crate) fn peek(&mut self, len: usize) -> Result<Option<&[u8]>, Fault> {
        if self.buffer.len() - self.used < len && self.left() >= len as u64 {
            self.refill()?;
        }
        Ok(self.buffer.get(self.used..).and_then(|bytes| bytes.get(..len)))
    }

    /// Consumes bytes shown by [`Cursor::peek`].
    #[inline]
    pub(crate) fn skip(&mut self, len: usize) {
        self.used = (self.used + len).min(self.buffer.len());
    }

    /// Moves the remaining bytes to the front and fills the rest of the buffer.
    fn refill(&mut self) -> Result<(), Fault> {
        self.buffer.drain(..self.used);
        self.used = 0;
        let kept = self.buffer.len();
        let room = (self.capacity - kept) as u64;
        let fetch = room.min(self.end.saturating_sub(self.at));
        self.buffer.resize(kept + usize::try_from(fetch).unwrap_or(0), 0);
        self.source.read_at(&mut self.buffer[kept..], self.at)?;
        self.at += fetch;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_gives_every_byte_once_whatever_its_buffer() {
        let bytes: Vec<u8> = (0..=255).collect();
        for capacity in [1, 16, 17, 64, 1000] {
            let mut cursor = Cursor::new(bytes.as_slice(), 3, 250, capacity);
            assert_eq!(cursor.peek(16).unwrap(), Some(&bytes[3..19]));
            assert!(cursor.peek(248).unwrap().is_none() && cursor.peek(1001).unwrap().is_none());
            let mut got = Vec::new();
            while let Some([a, b]) = cursor.take::<2>().unwrap() {
                got.extend([a, b]);
            }
            assert_eq!(cursor.left(), 1);
            got.extend(cursor.take::<1>().unwrap().unwrap());
            assert_eq!(got, bytes[3..250]);
            let mut items = Cursor::new(bytes.as_slice(), 3, 250, capacity);
            for item in bytes[3..249].chunks_exact(3) {
                assert_eq!(items.take_item(3).unwrap(), Some(item));
            }
            assert_eq!(items.take_item(3).unwrap(), None);
            assert!(cursor.next_part().unwrap().is_empty());
        }
    }
}
