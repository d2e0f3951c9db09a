//! A small window over a file of any size.

use std::io;

use crate::platform::PositionalFile;

/// Bytes held at a time: most headers up to the first long value fit one read.
pub(crate) const WINDOW_BYTES: usize = 8 << 10;

/// Something with a length that can be read at any offset: a file, or bytes in memory for tests.
pub trait ReadAt {
    /// Length in bytes.
    ///
    /// # Errors
    /// The system does not state it.
    fn byte_len(&self) -> io::Result<u64>;

    /// Reads at `offset` into `buf` and returns how many bytes came; 0 means the end.
    ///
    /// # Errors
    /// The system refuses.
    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize>;
}

impl ReadAt for PositionalFile {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize> {
        self.read_at(buf, offset)
    }
}

/// A file that the caller does not read by its cursor meanwhile.
impl ReadAt for std::fs::File {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize> {
        crate::platform::FileExt::read_at(self, buf, offset)
    }
}

impl ReadAt for [u8] {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize> {
        let rest = usize::try_from(offset).ok().and_then(|at| self.get(at..)).unwrap_or(&[]);
        let n = rest.len().min(buf.len());
        buf[..n].copy_from_slice(&rest[..n]);
        Ok(n)
    }
}

/// The window; owns [`WINDOW_BYTES`] and never more.
pub(crate) struct Window<'a, R: ReadAt + ?Sized> {
    input: &'a R,
    len: u64,
    buf: Box<[u8]>,
    start: u64,
    have: usize,
}

impl<'a, R: ReadAt + ?Sized> Window<'a, R> {
    pub(crate) fn new(input: &'a R) -> io::Result<Self> {
        let len = input.byte_len()?;
        Ok(Self { input, len, buf: vec![0; WINDOW_BYTES].into_boxed_slice(), start: 0, have: 0 })
    }

    /// Length of the whole input.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Bytes from `at` to the end of the input.
    pub(crate) fn left(&self, at: u64) -> u64 {
        self.len.saturating_sub(at)
    }

    /// At most `n` bytes at `at` (fewer only at the end of the input); `n` is cut to the window.
    pub(crate) fn upto(&mut self, at: u64, n: usize) -> io::Result<&[u8]> {
        let wanted = n.min(WINDOW_BYTES).min(usize::try_from(self.left(at)).unwrap_or(usize::MAX));
        let inside = at.checked_sub(self.start).and_then(|skip| usize::try_from(skip).ok());
        if let Some(skip) = inside.filter(|skip| skip.checked_add(wanted).is_some_and(|end| end <= self.have))
        {
            return Ok(&self.buf[skip..skip + wanted]);
        }
        // Bytes of the window are kept, so that the input is only ever read forwards.
        let kept = match inside {
            Some(skip) if skip < self.have => {
                self.buf.copy_within(skip..self.have, 0);
                self.have - skip
            }
            _ => 0,
        };
        self.start = at;
        self.have = kept;
        while self.have < wanted {
            match self.input.read_some_at(&mut self.buf[self.have..], at + self.have as u64) {
                Ok(0) => break,
                Ok(n) => self.have += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(&self.buf[..self.have.min(wanted)])
    }

    /// Exactly `N` bytes at `at`, or `None` where the input ends before.
    pub(crate) fn array<const N: usize>(&mut self, at: u64) -> io::Result<Option<[u8; N]>> {
        Ok(self.upto(at, N)?.first_chunk().copied())
    }
}
