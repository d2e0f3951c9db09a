//! Bytes that are appended to an unnamed file.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::unnamed;
use crate::platform::FileExt;

/// Bytes that are appended through a buffer, which holds the last ones: content shorter than the buffer never touches
/// the disk.
///
/// Memory: the buffer, which grows as it fills to its size, or to the size of the longest record.
#[derive(Debug)]
pub(crate) struct Appended {
    folder: PathBuf,
    file: Option<File>,
    /// Offset of the buffer.
    written: u64,
    buffer: Vec<u8>,
    buffer_bytes: usize,
}

impl Appended {
    /// No bytes yet; `folder` takes the file once it is needed.
    pub(crate) fn new(folder: &Path, buffer_bytes: usize) -> Self {
        Self { folder: folder.to_path_buf(), file: None, written: 0, buffer: Vec::new(), buffer_bytes }
    }

    #[cfg(test)]
    pub(super) fn with_file(file: File, buffer_bytes: usize) -> Self {
        Self { file: Some(file), ..Self::new(Path::new(""), buffer_bytes) }
    }

    /// The offset of the end.
    #[inline]
    pub(crate) fn len(&self) -> u64 {
        self.written + self.buffer.len() as u64
    }

    /// The folder of the file.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Appends a record and returns its offset.
    ///
    /// # Errors
    /// The folder is missing, or the disk is full.
    #[inline]
    pub(crate) fn push(&mut self, record: &[u8]) -> io::Result<u64> {
        self.push_at(self.len(), record)
    }

    /// Puts a record at an offset that is not before the end; bytes in between read as zeros.
    ///
    /// # Errors
    /// As [`Appended::push`].
    #[inline]
    pub(crate) fn push_at(&mut self, offset: u64, record: &[u8]) -> io::Result<u64> {
        let needed = self.buffer.len() + record.len();
        if offset != self.len() || needed > self.buffer_bytes {
            self.flush()?;
            self.written = offset;
        } else if needed > self.buffer.capacity() {
            let room = (2 * needed).min(self.buffer_bytes);
            self.buffer.reserve_exact(room - self.buffer.len());
        }
        self.buffer.extend_from_slice(record);
        Ok(offset)
    }

    /// Writes the content of the buffer to the file.
    ///
    /// # Errors
    /// As [`Appended::push`].
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        if !self.buffer.is_empty() {
            let file = match &self.file {
                Some(file) => file,
                None => self.file.insert(unnamed(&self.folder)?),
            };
            file.write_all_at(&self.buffer, self.written)?;
            self.written += self.buffer.len() as u64;
            self.buffer.clear();
        }
        Ok(())
    }

    /// Releases the unused part of the buffer.
    pub(crate) fn shrink(&mut self) {
        self.buffer.shrink_to_fit();
    }

    /// Reads bytes of one record.
    ///
    /// # Errors
    /// There are fewer, or the disk fails.
    pub(crate) fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        match (offset.checked_sub(self.written), &self.file) {
            (Some(start), _) => {
                let start = usize::try_from(start).unwrap_or(usize::MAX);
                let part = start.checked_add(out.len()).and_then(|end| self.buffer.get(start..end));
                out.copy_from_slice(part.ok_or(io::ErrorKind::UnexpectedEof)?);
                Ok(())
            }
            (None, Some(file)) => file.read_exact_at(out, offset),
            (None, None) => Err(io::ErrorKind::UnexpectedEof.into()),
        }
    }

    /// The file with all bytes.
    ///
    /// # Errors
    /// As [`Appended::push`].
    pub(crate) fn into_file(mut self) -> io::Result<File> {
        self.flush()?;
        self.file.map_or_else(|| unnamed(&self.folder), Ok)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_from_the_buffer_and_from_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut all = Appended::new(folder.path(), 100);
        let record = |i: usize| vec![u8::try_from(i % 251).unwrap(); i % 40];
        let offsets: Vec<u64> = (0..500).map(|i| all.push(&record(i)).unwrap()).collect();
        let behind = all.push_at(all.len() + 1000, &[7; 300]).unwrap();
        for (i, offset) in offsets.into_iter().enumerate() {
            let mut out = record(i + 1);
            out.resize(i % 40, 0);
            all.read_at(&mut out, offset).unwrap();
            assert_eq!(out, record(i));
        }
        let mut out = [1; 4];
        assert!(all.read_at(&mut out, behind + 297).is_err());
        all.read_at(&mut out, behind + 296).unwrap();
        assert_eq!(out, [7; 4]);
        assert_eq!(all.into_file().unwrap().metadata().unwrap().len(), behind + 300);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_missing_folder_matters_only_when_it_is_needed() {
        let mut all = Appended::new(Path::new("missing/folder"), 4096);
        assert!((0..10).all(|_| all.push(&[0; 400]).is_ok()));
        assert_eq!(all.push(&[0; 400]).unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
