//! The scratch file: skin records swapped out brick by brick, compressed on the fly (the paper,
//! section 4), and the index that finds them again.
//!
//! ```text
//! 0           +-------------------------------+
//!             | index: 32 bytes a brick,      |  x fastest, then y, z; all-zero: no skin
//!             | holes where nothing is        |
//! index end   +-------------------------------+
//!             | extents of fragments, in the  |  a fragment: some slices of one brick,
//!             | order in which workers filled |  linked to the brick's previous one
//!             | them                          |
//!             +-------------------------------+
//! ```
//!
//! The file has no name from its first moment on, so it always vanishes with the process.
#![expect(clippy::cast_possible_truncation, reason = "fragments are shorter than an extent")]

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::builder::BuildFault;
use crate::platform::FileExt;

use super::error::BuildError;

pub(super) const ENTRY_BYTES: usize = 32;
/// Scratch space that a worker takes at a time.
pub(super) const EXTENT_BYTES: usize = 256 << 10;
/// Bytes of a fragment's head: previous fragment (u64), stored length without the tail, raw length, length of the tail (u32
/// each).
const FRAGMENT_HEAD: usize = 20;
/// Bit of the stored length, set for an uncompressed payload.
const STORED_RAW: u32 = 1 << 31;

/// The index entry of a brick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct BrickEntry {
    /// Offset of the brick's last fragment.
    pub(super) last_fragment: u64,
    /// Skin voxels; 0 for a brick without skin.
    pub(super) skin: u32,
    /// Non-empty boxes with an edge of 2, 4, 8 and 16 voxels.
    pub(super) boxes: [u16; 4],
    /// Cells with corners.
    pub(super) corners: u16,
    /// Larger leaves with an edge of 2, 4, 8, 16 and 32 cells.
    pub(super) leaves: [u16; 5],
}

impl BrickEntry {
    fn to_bytes(self) -> [u8; ENTRY_BYTES] {
        let mut b = [0; ENTRY_BYTES];
        b[0..8].copy_from_slice(&self.last_fragment.to_le_bytes());
        b[8..12].copy_from_slice(&self.skin.to_le_bytes());
        for (i, n) in self.boxes.into_iter().enumerate() {
            b[12 + 2 * i..14 + 2 * i].copy_from_slice(&n.to_le_bytes());
        }
        b[20..22].copy_from_slice(&self.corners.to_le_bytes());
        for (i, n) in self.leaves.into_iter().enumerate() {
            b[22 + 2 * i..24 + 2 * i].copy_from_slice(&n.to_le_bytes());
        }
        b
    }

    fn parse(b: &[u8; ENTRY_BYTES]) -> Self {
        Self {
            last_fragment: u64::from_le_bytes(std::array::from_fn(|i| b[i])),
            skin: u32::from_le_bytes(std::array::from_fn(|i| b[8 + i])),
            boxes: std::array::from_fn(|k| u16::from_le_bytes([b[12 + 2 * k], b[13 + 2 * k]])),
            corners: u16::from_le_bytes([b[20], b[21]]),
            leaves: std::array::from_fn(|k| u16::from_le_bytes([b[22 + 2 * k], b[23 + 2 * k]])),
        }
    }

    /// True for a brick without skin.
    pub(super) fn is_empty(&self) -> bool {
        self.last_fragment == 0
    }
}

/// The scratch file, shared by all workers.
#[derive(Debug)]
pub(super) struct Scratch {
    file: File,
    folder: PathBuf,
    bricks: [u64; 3],
    next: AtomicU64,
    written: AtomicU64,
}

impl Scratch {
    /// Creates the unnamed file in `folder` with room for an index of `bricks` along x, y, z.
    pub(super) fn create(folder: &Path, bricks: [u64; 3]) -> Result<Self, BuildError> {
        let file = crate::scratch::unnamed(folder)
            .map_err(|cause| BuildError::from(BuildFault::Scratch { path: folder.to_path_buf(), cause }))?;
        let index = bricks[0] * bricks[1] * bricks[2] * ENTRY_BYTES as u64;
        let scratch = Self {
            file,
            folder: folder.to_path_buf(),
            bricks,
            next: AtomicU64::new(index.next_multiple_of(4096)),
            written: AtomicU64::new(0),
        };
        scratch.file.set_len(index).map_err(|e| scratch.error(e))?;
        Ok(scratch)
    }

    /// Wraps a failure of the scratch file.
    pub(super) fn error(&self, cause: io::Error) -> BuildError {
        BuildError::from(BuildFault::Scratch { path: self.folder.clone(), cause })
    }

    /// The failure of a scratch file whose contents make no sense.
    pub(super) fn changed(&self) -> BuildError {
        self.error(io::Error::other("its contents were changed by someone else"))
    }

    pub(super) fn written_bytes(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// Reserves `len` bytes of the file for the caller alone.
    pub(super) fn take(&self, len: usize) -> u64 {
        self.next.fetch_add(len as u64, Ordering::Relaxed)
    }

    /// Writes at a reserved offset.
    pub(super) fn write(&self, bytes: &[u8], offset: u64) -> Result<(), BuildError> {
        self.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        self.file.write_all_at(bytes, offset).map_err(|e| self.error(e))
    }

    /// Reads bytes written before.
    pub(super) fn read(&self, bytes: &mut [u8], offset: u64) -> Result<(), BuildError> {
        self.file.read_exact_at(bytes, offset).map_err(|e| self.error(e))
    }

    fn entry_offset(&self, brick: [u64; 3]) -> u64 {
        ((brick[2] * self.bricks[1] + brick[1]) * self.bricks[0] + brick[0]) * ENTRY_BYTES as u64
    }

    /// Writes the entries of neighbouring bricks along x.
    pub(super) fn put_entries(
        &self,
        first: [u64; 3],
        entries: &[BrickEntry],
        bytes: &mut Vec<u8>,
    ) -> Result<(), BuildError> {
        if entries.iter().all(BrickEntry::is_empty) {
            return Ok(());
        }
        bytes.clear();
        entries.iter().for_each(|e| bytes.extend(e.to_bytes()));
        self.write(bytes, self.entry_offset(first))
    }

    /// Replaces the entry of a brick.
    pub(super) fn replace_entry(&self, brick: [u64; 3], entry: BrickEntry) -> Result<(), BuildError> {
        self.write(&entry.to_bytes(), self.entry_offset(brick))
    }

    /// Reads up to 4 entries of neighbouring bricks along x; those outside the volume are empty.
    pub(super) fn entries(&self, first: [u64; 3]) -> Result<[BrickEntry; 4], BuildError> {
        let mut out = [BrickEntry::default(); 4];
        if first[0] >= self.bricks[0] || first[1] >= self.bricks[1] || first[2] >= self.bricks[2] {
            return Ok(out);
        }
        let count = usize::try_from(self.bricks[0] - first[0]).map_or(4, |n| n.min(4));
        let mut bytes = [0; 4 * ENTRY_BYTES];
        self.read(&mut bytes[..count * ENTRY_BYTES], self.entry_offset(first))?;
        for (entry, raw) in out.iter_mut().zip(bytes.as_chunks::<ENTRY_BYTES>().0).take(count) {
            *entry = BrickEntry::parse(raw);
        }
        Ok(out)
    }
}

/// One worker's access to the scratch file: fragments are gathered in an extent and written at once.
///
/// Memory: [`EXTENT_BYTES`].
pub(super) struct FragmentWriter<'a> {
    scratch: &'a Scratch,
    extent: Vec<u8>,
    start: u64,
}

impl<'a> FragmentWriter<'a> {
    pub(super) fn new(scratch: &'a Scratch) -> Self {
        Self { scratch, extent: Vec::with_capacity(EXTENT_BYTES), start: scratch.take(EXTENT_BYTES) }
    }

    /// Appends a fragment and returns its offset, for the brick's next fragment or its index entry. The last `tail` bytes
    /// are as good as random, and not compressed.
    pub(super) fn append(&mut self, previous: u64, payload: &[u8], tail: usize) -> Result<u64, BuildError> {
        let most = FRAGMENT_HEAD + lz4_flex::block::get_maximum_output_size(payload.len());
        debug_assert!(most <= EXTENT_BYTES);
        if self.extent.len() + most > EXTENT_BYTES {
            self.flush()?;
            self.start = self.scratch.take(EXTENT_BYTES);
        }
        let at = self.extent.len();
        self.extent.resize(at + most, 0);
        let body = at + FRAGMENT_HEAD;
        let (packed, last) = payload.split_at(payload.len() - tail);
        let stored = match lz4_flex::block::compress_into(packed, &mut self.extent[body..]) {
            Ok(len) if len < packed.len() => len as u32,
            _ => {
                self.extent[body..body + packed.len()].copy_from_slice(packed);
                packed.len() as u32 | STORED_RAW
            }
        };
        self.extent.truncate(body + (stored & !STORED_RAW) as usize);
        self.extent.extend_from_slice(last);
        self.extent[at..at + 8].copy_from_slice(&previous.to_le_bytes());
        self.extent[at + 8..at + 12].copy_from_slice(&stored.to_le_bytes());
        self.extent[at + 12..at + 16].copy_from_slice(&(payload.len() as u32).to_le_bytes());
        self.extent[at + 16..at + 20].copy_from_slice(&(tail as u32).to_le_bytes());
        Ok(self.start + at as u64)
    }

    /// Writes the gathered fragments; must also be called once at the end.
    pub(super) fn flush(&mut self) -> Result<(), BuildError> {
        self.scratch.write(&self.extent, self.start)?;
        self.extent.clear();
        Ok(())
    }
}

/// Reads a fragment into `payload` and returns the offset of the brick's previous one (0: none).
pub(super) fn read_fragment(
    scratch: &Scratch,
    offset: u64,
    stored: &mut Vec<u8>,
    payload: &mut Vec<u8>,
) -> Result<u64, BuildError> {
    let mut head = [0; FRAGMENT_HEAD];
    scratch.read(&mut head, offset)?;
    let previous = u64::from_le_bytes(std::array::from_fn(|i| head[i]));
    let number = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (stored_len, raw_len, tail) = (number(8), number(12) as usize, number(16) as usize);
    let len = (stored_len & !STORED_RAW) as usize;
    if len > EXTENT_BYTES || raw_len > EXTENT_BYTES || tail > raw_len {
        return Err(scratch.changed());
    }
    payload.resize(raw_len, 0);
    if stored_len & STORED_RAW != 0 {
        scratch.read(payload, offset + FRAGMENT_HEAD as u64)?;
        return Ok(previous);
    }
    stored.resize(len + tail, 0);
    scratch.read(stored, offset + FRAGMENT_HEAD as u64)?;
    let (packed, last) = payload.split_at_mut(raw_len - tail);
    last.copy_from_slice(&stored[len..]);
    match lz4_flex::block::decompress_into(&stored[..len], packed) {
        Ok(n) if n == packed.len() => Ok(previous),
        _ => Err(scratch.changed()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fragments_of_any_kind_come_back_and_chain() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::create(folder.path(), [3, 2, 2]).unwrap();
        let mut writer = FragmentWriter::new(&scratch);
        let noise: Vec<u8> = (0..60_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let flat = vec![7; 90_000];
        let mut offsets = vec![0];
        for (payload, tail) in [
            (&noise[..], 0),
            (&flat, 300),
            (&[], 0),
            (&noise[..17], 17),
            (&flat[..90_000], 90_000),
            (&noise, 9),
        ] {
            offsets.push(writer.append(*offsets.last().unwrap(), payload, tail).unwrap());
        }
        writer.flush().unwrap();
        let (mut stored, mut payload) = (Vec::new(), Vec::new());
        let mut at = *offsets.last().unwrap();
        for (i, want) in [&noise[..], &flat, &noise[..17], &[], &flat, &noise].into_iter().enumerate() {
            let previous = read_fragment(&scratch, at, &mut stored, &mut payload).unwrap();
            assert_eq!(payload, want, "fragment {i}");
            at = previous;
        }
        assert_eq!(at, 0);
    }

    #[test]
    fn entries_round_trip_and_holes_are_empty() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::create(folder.path(), [3, 2, 2]).unwrap();
        let entry = BrickEntry {
            last_fragment: 1 << 40,
            skin: 32_768,
            boxes: [4096, 512, 64, 8],
            corners: 32_767,
            leaves: [4095, 511, 63, 7, 1],
        };
        scratch.put_entries([1, 1, 1], &[entry, BrickEntry::default()], &mut Vec::new()).unwrap();
        assert_eq!(scratch.entries([0, 1, 1]).unwrap()[1], entry);
        assert_eq!(scratch.entries([0, 0, 0]).unwrap(), [BrickEntry::default(); 4]);
        assert_eq!(scratch.entries([0, 2, 0]).unwrap(), [BrickEntry::default(); 4]);
    }
}
