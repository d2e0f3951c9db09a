//! Triangles sorted by place: swapped out into bins of 32 rows and 32 slices, on the way to columns of bricks.
//!
//! ```text
//! bins in memory: lists of triangles in one pool --full--> blocks, chained from a bin's last to its first
//! ```
//!
//! A block of triangles shorter than eight voxels holds their first vertex and the ways to the others in 16 bits:
//! 24 bytes each instead of 36. (lz4 took 33 and a second for ten million.)
//!
//! A bin holds every triangle that bears upon the voxels of 32 rows and 32 slices and on those two beyond, along
//! the whole of x. The file has no name, as that of skin records.
#![expect(clippy::cast_possible_truncation, reason = "bins lie within the grid, blocks are short")]

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::lattice::{Triangle, centres, span};
use crate::facts::SourceError;
use crate::geom::Dims;

/// Rows and slices of a bin, as a power of two: those of a brick.
const BIN_SHIFT: i32 = 5;
/// Rows and slices beyond a bin for which it holds triangles: the bits are two slices ahead, and a nearest
/// triangle is less than two voxels away.
pub(super) const BEYOND: i32 = 2;
/// Most triangles of a block.
pub(super) const BLOCK: usize = 1024;
/// Bytes of a triangle.
const TRIANGLE: usize = size_of::<Triangle>();
/// Bytes of a triangle of a block of short ones.
const SHORT: usize = 24;
/// Bytes of a block's head: where the bin's block before this one is.
const HEAD: usize = 16;
/// Bytes written at a time.
const WRITE: usize = 128 << 10;
/// Triangles of a chunk, which takes 256 bytes, and chunks of triangles that wait in memory.
const CHUNK: usize = 7;
const CHUNKS: usize = 4 << 10;
/// Bins with fewer triangles than this are swapped out only if nothing else makes room.
const WORTH: u32 = 16;
const NONE: u32 = u32::MAX;

/// Memory while triangles are binned, beside the bins themselves.
pub(super) const BINNING_BYTES: u64 =
    (CHUNKS * size_of::<Chunk>() + WRITE + BLOCK * TRIANGLE + (64 << 10)) as u64;

/// Where a block is; its bytes are 0 for none.
#[derive(Clone, Copy, Debug, Default)]
struct Link {
    offset: u64,
    bytes: u32,
    triangles: u32,
}

/// A bin in the file.
#[derive(Clone, Copy, Debug)]
struct Bin {
    last: Link,
    /// Triangles in all.
    triangles: u32,
    /// Columns between which they lie.
    columns: (i16, i16),
}

/// A list of chunks, of which only the first may have room.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    first: u32,
    count: u32,
}

#[derive(Clone, Copy, Debug)]
struct Chunk {
    triangles: [Triangle; CHUNK],
    next: u32,
}

/// Sorts triangles into bins.
pub(super) struct Binner {
    bins: Bins,
    waiting: Vec<Waiting>,
    chunks: Vec<Chunk>,
    free: u32,
    /// Chunks that are free.
    room: usize,
    buffer: Vec<u8>,
    written: u64,
    raw: Vec<Triangle>,
}

/// Bins that were written.
#[derive(Debug)]
pub(super) struct Bins {
    file: File,
    folder: PathBuf,
    /// Bins along y and z.
    grid: [i32; 2],
    columns: i32,
    bins: Vec<Bin>,
    bytes: u64,
}

impl Bins {
    /// Memory of the bins of a grid.
    pub(super) fn memory_bytes(dims: Dims) -> u64 {
        let count = dims.ny().div_ceil(32) as usize * dims.nz().div_ceil(32) as usize;
        (count * size_of::<Bin>()) as u64
    }

    fn error(&self, cause: io::Error) -> SourceError {
        SourceError::Scratch { path: self.folder.clone(), cause }
    }

    fn at(&self, row: u32, slice: u32) -> &Bin {
        let y = (row as i32 >> BIN_SHIFT).min(self.grid[0] - 1);
        let z = (slice as i32 >> BIN_SHIFT).min(self.grid[1] - 1);
        &self.bins[(z * self.grid[0] + y) as usize]
    }

    /// Triangles of the bin of a row and a slice.
    pub(super) fn triangles(&self, row: u32, slice: u32) -> u32 {
        self.at(row, slice).triangles
    }

    /// Columns between which the triangles of a bin lie; the first is larger than the last for none.
    pub(super) fn columns(&self, row: u32, slice: u32) -> (i32, i32) {
        let (low, high) = self.at(row, slice).columns;
        (low.into(), high.into())
    }

    /// Triangles of the fullest bin.
    pub(super) fn fullest(&self) -> u32 {
        self.bins.iter().map(|b| b.triangles).max().unwrap_or(0)
    }

    /// Bytes written.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Calls `each` with the triangles of a bin, block by block, until it returns `false`.
    pub(super) fn for_each_block(
        &self,
        row: u32,
        slice: u32,
        buffers: &mut BlockBuffers,
        each: &mut dyn FnMut(&[Triangle]) -> bool,
    ) -> Result<(), SourceError> {
        let mut link = self.at(row, slice).last;
        while link.triangles > 0 {
            buffers.stored.resize(link.bytes as usize, 0);
            self.file.read_exact_at(&mut buffers.stored, link.offset).map_err(|e| self.error(e))?;
            let changed = || self.error(io::Error::from(io::ErrorKind::InvalidData));
            let (head, body) = buffers.stored.split_first_chunk::<HEAD>().ok_or_else(changed)?;
            let count = link.triangles as usize;
            let triangles = buffers.triangles.get_mut(..count).ok_or_else(changed)?;
            if body.len() == SHORT * count {
                for (t, record) in triangles.iter_mut().zip(body.as_chunks::<SHORT>().0) {
                    *t = unpacked(record);
                }
            } else if body.len() == TRIANGLE * count {
                bytemuck::cast_slice_mut::<Triangle, u8>(triangles).copy_from_slice(body);
            } else {
                return Err(changed());
            }
            if !each(triangles) {
                return Ok(());
            }
            link = Link {
                offset: u64::from_le_bytes(std::array::from_fn(|i| head[i])),
                bytes: u32::from_le_bytes(std::array::from_fn(|i| head[8 + i])),
                triangles: u32::from_le_bytes(std::array::from_fn(|i| head[12 + i])),
            };
        }
        Ok(())
    }
}

/// Through which blocks are read.
pub(super) struct BlockBuffers {
    stored: Vec<u8>,
    triangles: Vec<Triangle>,
}

impl BlockBuffers {
    /// Memory of one.
    pub(super) const BYTES: u64 = (2 * BLOCK * TRIANGLE + (4 << 10)) as u64;

    pub(super) fn new() -> Self {
        Self { stored: Vec::with_capacity(BLOCK * TRIANGLE + HEAD), triangles: vec![[0; 9]; BLOCK] }
    }
}

impl Binner {
    /// Bins of a grid, in a nameless file in `folder`.
    pub(super) fn new(dims: Dims, folder: &Path) -> Result<Self, SourceError> {
        let file = crate::scratch::nameless(folder)
            .map_err(|cause| SourceError::Scratch { path: folder.to_path_buf(), cause })?;
        let grid = [dims.ny().div_ceil(32) as i32, dims.nz().div_ceil(32) as i32];
        let count = (grid[0] * grid[1]) as usize;
        let empty = Bin { last: Link::default(), triangles: 0, columns: (i16::MAX, i16::MIN) };
        Ok(Self::go_on(Bins {
            file,
            folder: folder.to_path_buf(),
            grid,
            columns: dims.nx() as i32,
            bins: vec![empty; count],
            bytes: 0,
        }))
    }

    /// Bins to which more is added.
    pub(super) fn go_on(bins: Bins) -> Self {
        Self {
            waiting: vec![Waiting { first: NONE, count: 0 }; bins.bins.len()],
            chunks: Vec::with_capacity(CHUNKS),
            free: NONE,
            room: CHUNKS,
            buffer: Vec::with_capacity(WRITE),
            written: bins.bytes,
            raw: Vec::with_capacity(BLOCK),
            bins,
        }
    }

    /// Puts a triangle into every bin that it bears upon.
    pub(super) fn add(&mut self, t: &Triangle) -> Result<(), SourceError> {
        let ((j0, j1), (k0, k1)) = (centres(t, 1), centres(t, 2));
        let (x0, x1) = centres(t, 0);
        // What lies beyond the last column is met by no row before its end; but the rows may be inside until then.
        let beyond = x0 > self.bins.columns + BEYOND;
        let bin = |at: i32| at >> BIN_SHIFT;
        let [ny, nz] = self.bins.grid;
        let (y0, y1) = (bin(j0 - BEYOND).max(0), bin(j1 + BEYOND).min(ny - 1));
        let (z0, z1) = (bin(k0 - BEYOND).max(0), bin(k1 + BEYOND).min(nz - 1));
        if y0 > y1 || z0 > z1 {
            return Ok(());
        }
        // Half a column more, for a triangle that lies between two centres.
        let columns = ((x0 - 1).clamp(-9, 16_400) as i16, (x1 + 1).clamp(-9, 16_400) as i16);
        let many = (y1 - y0 + 1) * (z1 - z0 + 1) > 4;
        for z in z0..=z1 {
            for y in y0..=y1 {
                if many && !meets(t, y, z) {
                    continue;
                }
                let at = (z * ny + y) as usize;
                let reached = &mut self.bins.bins[at].columns;
                *reached = (reached.0.min(columns.0), reached.1.max(columns.1));
                if beyond {
                    continue;
                }
                if self.room == 0 {
                    self.make_room()?;
                }
                self.put(at, t);
            }
        }
        Ok(())
    }

    fn put(&mut self, at: usize, t: &Triangle) {
        let waiting = &mut self.waiting[at];
        let within = waiting.count as usize % CHUNK;
        if within == 0 {
            let next = std::mem::replace(&mut waiting.first, self.free);
            if self.free == NONE {
                waiting.first = self.chunks.len() as u32;
                self.chunks.push(Chunk { triangles: [[0; 9]; CHUNK], next });
            } else {
                let chunk = &mut self.chunks[self.free as usize];
                self.free = std::mem::replace(&mut chunk.next, next);
            }
            self.room -= 1;
        }
        self.chunks[waiting.first as usize].triangles[within] = *t;
        waiting.count += 1;
        let bin = &mut self.bins.bins[at];
        bin.triangles = bin.triangles.saturating_add(1);
    }

    /// Swaps out what is worth a block; everything, if that frees little.
    fn make_room(&mut self) -> Result<(), SourceError> {
        for least in [WORTH, 1] {
            for at in 0..self.waiting.len() {
                if self.waiting[at].count >= least {
                    self.swap_out(at)?;
                }
            }
            if self.room >= CHUNKS / 2 {
                break;
            }
        }
        Ok(())
    }

    fn swap_out(&mut self, at: usize) -> Result<(), SourceError> {
        let Waiting { first: mut next, count } = self.waiting[at];
        self.waiting[at] = Waiting { first: NONE, count: 0 };
        // The first chunk holds what is left over, the others are full.
        let mut held = (count as usize + CHUNK - 1) % CHUNK + 1;
        self.raw.clear();
        while next != NONE {
            if self.raw.len() + CHUNK > BLOCK {
                self.write_block(at)?;
                self.raw.clear();
            }
            let chunk = &mut self.chunks[next as usize];
            self.raw.extend_from_slice(&chunk.triangles[..held]);
            held = CHUNK;
            let after = std::mem::replace(&mut chunk.next, self.free);
            self.free = std::mem::replace(&mut next, after);
            self.room += 1;
        }
        self.write_block(at)
    }

    fn write_block(&mut self, at: usize) -> Result<(), SourceError> {
        if self.buffer.len() + HEAD + self.raw.len() * TRIANGLE > WRITE {
            self.flush()?;
        }
        let start = self.buffer.len();
        let bin = &mut self.bins.bins[at];
        self.buffer.extend(bin.last.offset.to_le_bytes());
        self.buffer.extend(bin.last.bytes.to_le_bytes());
        self.buffer.extend(bin.last.triangles.to_le_bytes());
        if self.raw.iter().all(is_short) {
            self.raw.iter().for_each(|t| self.buffer.extend(packed(t)));
        } else {
            self.buffer.extend_from_slice(bytemuck::cast_slice(&self.raw));
        }
        bin.last = Link {
            offset: self.written + start as u64,
            bytes: (self.buffer.len() - start) as u32,
            triangles: self.raw.len() as u32,
        };
        Ok(())
    }

    fn flush(&mut self) -> Result<(), SourceError> {
        self.bins.file.write_all_at(&self.buffer, self.written).map_err(|e| self.bins.error(e))?;
        self.written += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    /// Writes what still waits.
    pub(super) fn finish(mut self) -> Result<Bins, SourceError> {
        for at in 0..self.waiting.len() {
            if self.waiting[at].count > 0 {
                self.swap_out(at)?;
            }
        }
        self.flush()?;
        self.bins.bytes = self.written;
        Ok(self.bins)
    }
}

/// Are the ways from its first vertex to the others short enough for 16 bits?
fn is_short(t: &Triangle) -> bool {
    (3..9).all(|k| i16::try_from(i64::from(t[k]) - i64::from(t[k % 3])).is_ok())
}

fn packed(t: &Triangle) -> [u8; SHORT] {
    let mut record = [0; SHORT];
    let (first, ways) = record.split_at_mut(12);
    for (out, c) in first.as_chunks_mut::<4>().0.iter_mut().zip(t) {
        *out = c.to_le_bytes();
    }
    for (k, out) in ways.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        *out = ((t[3 + k] - t[k % 3]) as i16).to_le_bytes();
    }
    record
}

#[inline]
fn unpacked(record: &[u8; SHORT]) -> Triangle {
    let four = |k: usize| i32::from_le_bytes(std::array::from_fn(|i| record[4 * k + i]));
    let two = |k: usize| i32::from(i16::from_le_bytes([record[12 + 2 * k], record[13 + 2 * k]]));
    let first = [four(0), four(1), four(2)];
    std::array::from_fn(|k| if k < 3 { first[k] } else { first[k % 3] + two(k - 3) })
}

/// May a triangle bear upon a bin, seen along x? Always right where it says no.
fn meets(t: &Triangle, y: i32, z: i32) -> bool {
    // The bin with two voxels and a half around, in lattice steps.
    let around = i64::from(BEYOND) * 4096 + 2048;
    let reach = |b: i32| {
        let low = (i64::from(b) << BIN_SHIFT) * 4096;
        (low - around, low + (4096 << BIN_SHIFT) + around)
    };
    let ((ylow, yhigh), (zlow, zhigh)) = (reach(y), reach(z));
    let p = |k: usize| (i64::from(t[3 * k + 1]), i64::from(t[3 * k + 2]));
    let corners = [p(0), p(1), p(2)];
    let area = cross(corners[0], corners[1], corners[2]);
    if area == 0 {
        return span(t, 1).1 as i64 >= ylow && i64::from(span(t, 1).0) <= yhigh;
    }
    // Beyond one of its edges on every corner of the box?
    (0..3).all(|k| {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        [(ylow, zlow), (yhigh, zlow), (ylow, zhigh), (yhigh, zhigh)]
            .into_iter()
            .any(|c| if area > 0 { cross(a, b, c) >= 0 } else { cross(a, b, c) <= 0 })
    })
}

fn cross(a: (i64, i64), b: (i64, i64), c: (i64, i64)) -> i64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bin_gives_back_what_bears_upon_it_however_often_it_was_swapped_out() {
        let folder = tempfile::tempdir().unwrap();
        let dims = Dims::new(200, 200, 200).unwrap();
        let mut binner = Binner::new(dims, folder.path()).unwrap();
        let mut state = 1_u32;
        let mut next = |n: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((i64::from(state >> 8) * i64::from(n)) >> 24) as i32
        };
        let mut all = Vec::new();
        for i in 0..60_000 {
            let size = if i % 100 == 0 { 200 } else { 3 };
            let corner: [i32; 3] = std::array::from_fn(|_| next(210 * 4096) - 5 * 4096);
            let t: Triangle = std::array::from_fn(|k| corner[k % 3] + next(size * 4096));
            binner.add(&t).unwrap();
            all.push(t);
        }
        let bins = binner.finish().unwrap();
        let mut buffers = BlockBuffers::new();
        for (row, slice) in [(0, 0), (33, 70), (199, 199), (100, 5)] {
            let mut got = Vec::new();
            bins.for_each_block(row, slice, &mut buffers, &mut |block| {
                got.extend_from_slice(block);
                true
            })
            .unwrap();
            assert_eq!(got.len() as u32, bins.triangles(row, slice));
            got.sort_unstable();
            // Those that reach the bin's rows and slices, two more included, must be there.
            let touches = |t: &&Triangle| {
                [(1, row), (2, slice)].into_iter().all(|(axis, at)| {
                    let (low, high) = centres(t, axis);
                    let from = at as i32 / 32 * 32;
                    high + 2 >= from && low - 2 <= from + 31
                })
            };
            let mut wanted: Vec<&Triangle> =
                all.iter().filter(touches).filter(|t| span(t, 0).0 <= 202 * 4096 + 2048).collect();
            wanted.sort_unstable();
            let surplus = got.iter().filter(|t| wanted.binary_search(t).is_err()).collect::<Vec<_>>();
            assert!(
                got.len() > 100 && surplus.is_empty(),
                "{row} {slice}: {} of {}, {surplus:?}",
                got.len(),
                wanted.len()
            );
            let missing = wanted.iter().filter(|t| got.binary_search(t).is_err());
            // Only large ones may have been found not to meet the bin.
            for t in missing {
                assert!(!meets(t, row as i32 / 32, slice as i32 / 32), "{t:?}");
            }
        }
    }
}
