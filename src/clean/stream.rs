//! Long lists in a unnamed scratch file: appended item by item, read back in sections from front to back.

use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::Path;

use crate::platform::FileExt;
use crate::scratch::unnamed;

/// Bytes of the buffer of a list or of a cursor.
pub(super) const BUFFER_BYTES: usize = 16 << 10;

/// A list that is appended to.
pub(super) struct Stream<T> {
    file: File,
    waiting: Vec<T>,
    written: u64,
}

impl<T: bytemuck::Pod> Stream<T> {
    const ITEMS: usize = BUFFER_BYTES / size_of::<T>();

    pub(super) fn new(folder: &Path) -> io::Result<Self> {
        Ok(Self { file: unnamed(folder)?, waiting: Vec::with_capacity(Self::ITEMS), written: 0 })
    }

    pub(super) fn len(&self) -> u64 {
        self.written + self.waiting.len() as u64
    }

    pub(super) fn push(&mut self, item: T) -> io::Result<()> {
        if self.waiting.len() == Self::ITEMS {
            self.flush()?;
        }
        self.waiting.push(item);
        Ok(())
    }

    /// Makes all items readable.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.file.write_all_at(bytemuck::cast_slice(&self.waiting), self.written * size_of::<T>() as u64)?;
        self.written += self.waiting.len() as u64;
        self.waiting.clear();
        Ok(())
    }

    /// Replaces every item of a section, which is flushed, by the result of `change`.
    pub(super) fn rewrite(
        &mut self,
        section: Range<u64>,
        change: &mut dyn FnMut(T) -> io::Result<T>,
    ) -> io::Result<()> {
        let mut at = section.start;
        let mut buffer = vec![T::zeroed(); Self::ITEMS];
        while at < section.end {
            let count = usize::try_from(section.end - at).unwrap_or(usize::MAX).min(Self::ITEMS);
            let items = &mut buffer[..count];
            let offset = at * size_of::<T>() as u64;
            self.file.read_exact_at(bytemuck::cast_slice_mut(items), offset)?;
            for item in items.iter_mut() {
                *item = change(*item)?;
            }
            self.file.write_all_at(bytemuck::cast_slice(items), offset)?;
            at += count as u64;
        }
        Ok(())
    }
}

/// Reads sections of a list from front to back.
pub(super) struct Cursor<T> {
    buffer: Vec<T>,
    at: usize,
    next: Range<u64>,
    items: PhantomData<T>,
}

impl<T: bytemuck::Pod> Cursor<T> {
    pub(super) fn new() -> Self {
        Self { buffer: Vec::with_capacity(Stream::<T>::ITEMS), at: 0, next: 0..0, items: PhantomData }
    }

    pub(super) fn start(&mut self, section: Range<u64>) {
        self.buffer.clear();
        self.at = 0;
        self.next = section;
    }

    /// The next item of the section.
    ///
    /// # Errors
    /// The section has ended, or the file cannot be read.
    #[inline]
    pub(super) fn next(&mut self, list: &Stream<T>) -> io::Result<T> {
        if self.at == self.buffer.len() {
            self.refill(list)?;
        }
        let item = self.buffer[self.at];
        self.at += 1;
        Ok(item)
    }

    fn refill(&mut self, list: &Stream<T>) -> io::Result<()> {
        let left = usize::try_from(self.next.end - self.next.start).unwrap_or(usize::MAX);
        if left == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let count = left.min(Stream::<T>::ITEMS);
        self.buffer.resize(count, T::zeroed());
        let bytes = bytemuck::cast_slice_mut(&mut self.buffer);
        list.file.read_exact_at(bytes, self.next.start * size_of::<T>() as u64)?;
        self.next.start += count as u64;
        self.at = 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_come_back_as_they_were_written_and_rewritten() {
        let folder = tempfile::tempdir().unwrap();
        let mut list = Stream::<u32>::new(folder.path()).unwrap();
        for i in 0..30_000 {
            list.push(i).unwrap();
        }
        list.flush().unwrap();
        list.rewrite(9_000..20_000, &mut |v| Ok(v + 1_000_000)).unwrap();
        let mut cursor = Cursor::new();
        for section in [29_000..30_000, 0..30_000, 5..6] {
            cursor.start(section.clone());
            for i in section {
                let moved = if (9_000..20_000).contains(&i) { 1_000_000 } else { 0 };
                assert_eq!(u64::from(cursor.next(&list).unwrap()), i + moved);
            }
            assert!(cursor.next(&list).is_err());
        }
        assert_eq!(list.len(), 30_000);
    }
}
