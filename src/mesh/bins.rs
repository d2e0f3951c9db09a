//! Triangles sorted by place: swapped out into bins of 32 rows and 32 slices, on the way to columns of bricks.
//!
//! ```text
//! bins in memory: lists of triangles in one pool --full--> blocks, chained from a bin's last to its first
//! ```
//!
//! A triangle shorter than eight voxels is a record of 24 bytes, which holds its first vertex and the ways to the
//! others in 16 bits; a longer one takes two. (lz4 took a quarter less and a second for ten million.)
//!
//! A bin holds every triangle that concerns the voxels of 32 rows and 32 slices, and of two more on every side, along
//! the whole of x. The file has no name, like the one of skin records.
#![expect(clippy::cast_possible_truncation, reason = "bins lie within the grid, blocks are short")]

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::lattice::{Triangle, centres, span};
use crate::geom::Dims;
use crate::platform::FileExt;
use crate::volume::{SourceError, SourceFault};

/// Rows and slices of a bin, as a power of two: as many as a brick's.
const BIN_SHIFT: i32 = 5;
/// Rows and slices beyond a bin for which it holds triangles: the bits are two slices ahead, and a nearest
/// triangle is less than two voxels away.
pub(super) const BEYOND: i32 = 2;
/// Most records of a block.
pub(super) const BLOCK: usize = 1020;
const RECORD: usize = size_of::<Record>();
/// Bytes written at a time.
const WRITE: usize = 128 << 10;
/// Records of a chunk, which takes 248 bytes, and chunks that wait in memory.
const CHUNK: usize = 10;
const CHUNKS: usize = 4 << 10;
/// Bins with fewer records than this are swapped out only if nothing else makes room.
const WORTH: u32 = 16;
const NONE: u32 = u32::MAX;

/// Memory while triangles are binned, without the bins themselves.
pub(super) const BINNING_BYTES: u64 = (CHUNKS * size_of::<Chunk>() + WRITE + (64 << 10)) as u64;

/// A triangle shorter than eight voxels: its first vertex, and the ways to the others along x, y and z, to the
/// second in the lower half of a word. Or half of a longer one; the x of its first half is beyond any coordinate.
pub(super) type Record = [i32; 6];

/// Offset of the x of a longer triangle.
const LONG: i32 = 1 << 30;

#[inline]
fn short(t: &Triangle) -> Option<Record> {
    let ways: [i32; 6] = std::array::from_fn(|k| t[3 + k].wrapping_sub(t[k % 3]));
    let beyond = ways.iter().fold(0, |beyond, way| beyond | way.wrapping_add(1 << 15));
    let both = |k: usize| ways[k] & 0xffff | ways[k + 3] << 16;
    (beyond >> 16 == 0).then(|| [t[0], t[1], t[2], both(0), both(1), both(2)])
}

fn pair([x, rest @ .., a, b, c]: &Triangle) -> [Record; 2] {
    let [y, z, p, q, r] = *rest;
    [[x + LONG, y, z, p, q, r], [*a, *b, *c, 0, 0, 0]]
}

/// The edges to the second and to the third vertex along an axis.
#[inline]
pub(super) fn ways(record: &Record, axis: usize) -> [i32; 2] {
    let both = record[3 + axis];
    [both << 16 >> 16, both >> 16]
}

#[inline]
pub(super) fn unpacked(record: &Record) -> Triangle {
    let [x, y, z, ..] = *record;
    let ([a, d], [b, e], [c, f]) = (ways(record, 0), ways(record, 1), ways(record, 2));
    let way = |from: i32, way: i32| from.wrapping_add(way);
    [x, y, z, way(x, a), way(y, b), way(z, c), way(x, d), way(y, e), way(z, f)]
}

/// The records of a triangle.
#[cfg(test)]
pub(super) fn packed(t: &Triangle) -> Vec<Record> {
    short(t).map_or_else(|| pair(t).to_vec(), |record| vec![record])
}

/// A triangle of a block.
pub(super) enum BinTriangle<'a> {
    Short(&'a Record),
    Long(Triangle),
}

impl BinTriangle<'_> {
    #[inline]
    pub(super) fn triangle(&self) -> Triangle {
        match self {
            BinTriangle::Short(record) => unpacked(record),
            BinTriangle::Long(t) => *t,
        }
    }
}

/// The triangles of a block, with the number of the first record of each.
#[inline]
pub(super) fn numbered(block: &[Record]) -> impl Iterator<Item = (u32, BinTriangle<'_>)> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let first = at;
        let record = block.get(first)?;
        at += 1;
        let [x, y, z, p, q, r] = *record;
        if x < LONG / 2 {
            return Some((first as u32, BinTriangle::Short(record)));
        }
        let [a, b, c, ..] = *block.get(at)?;
        at += 1;
        Some((first as u32, BinTriangle::Long([x - LONG, y, z, p, q, r, a, b, c])))
    })
}

#[inline]
pub(super) fn held(block: &[Record]) -> impl Iterator<Item = BinTriangle<'_>> {
    numbered(block).map(|(_, t)| t)
}

/// A block's head, as long as a record: offset and records of the bin's block before it.
type Head = [u64; 3];

#[derive(Clone, Copy, Debug)]
struct Bin {
    /// Offset of its last block, and the block's records.
    offset: u64,
    records: u32,
    triangles: u32,
    /// Lowest and highest column of its triangles.
    columns: (i16, i16),
}

/// A list of chunks, of which only the first may have room, and the number of their records.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    first: u32,
    count: u32,
}

#[derive(Clone, Copy, Debug)]
struct Chunk {
    records: [Record; CHUNK],
    count: u32,
    next: u32,
}

/// Sorts triangles into bins.
pub(super) struct Binner {
    bins: Bins,
    waiting: Vec<Waiting>,
    chunks: Vec<Chunk>,
    free: u32,
    /// Number of free chunks.
    room: usize,
    buffer: Vec<u8>,
    written: u64,
}

/// Bins that were written.
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
    pub(super) fn memory_bytes(dims: Dims) -> u64 {
        let count = dims.ny().div_ceil(32) as usize * dims.nz().div_ceil(32) as usize;
        (count * size_of::<Bin>()) as u64
    }

    fn error(&self, cause: io::Error) -> SourceError {
        SourceError::from(SourceFault::Scratch { path: self.folder.clone(), cause })
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

    /// Lowest and highest column of the triangles of a bin; the first is larger than the last for none.
    pub(super) fn columns(&self, row: u32, slice: u32) -> (i32, i32) {
        let (low, high) = self.at(row, slice).columns;
        (low.into(), high.into())
    }

    /// Triangles of the fullest bin.
    pub(super) fn fullest(&self) -> u32 {
        self.bins.iter().map(|b| b.triangles).max().unwrap_or(0)
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Calls `each` with the records of a bin, block by block, until it returns `false`.
    pub(super) fn for_each_block(
        &self,
        row: u32,
        slice: u32,
        buffers: &mut BlockBuffers,
        each: &mut dyn FnMut(&[Record]) -> bool,
    ) -> Result<(), SourceError> {
        let bin = self.at(row, slice);
        let (mut offset, mut records) = (bin.offset, bin.records.into());
        while records > 0 {
            let changed = || self.error(io::Error::from(io::ErrorKind::InvalidData));
            let block = buffers.records.get_mut(..records as usize + 1).ok_or_else(changed)?;
            self.file.read_exact_at(bytemuck::cast_slice_mut(block), offset).map_err(|e| self.error(e))?;
            let (head, block) = block.split_first().ok_or_else(changed)?;
            [offset, records, _] = bytemuck::cast::<Record, Head>(*head);
            if !each(block) {
                return Ok(());
            }
        }
        Ok(())
    }
}

/// Buffers through which blocks are read.
pub(super) struct BlockBuffers {
    records: Vec<Record>,
}

impl BlockBuffers {
    pub(super) const BYTES: u64 = ((BLOCK + 1) * RECORD + (4 << 10)) as u64;

    pub(super) fn new() -> Self {
        Self { records: vec![[0; 6]; BLOCK + 1] }
    }
}

impl Binner {
    /// Bins of a grid, in a scratch file in `folder`.
    pub(super) fn new(dims: Dims, folder: &Path) -> Result<Self, SourceError> {
        let file = crate::scratch::unnamed(folder)
            .map_err(|cause| SourceError::from(SourceFault::Scratch { path: folder.to_path_buf(), cause }))?;
        let grid = [dims.ny().div_ceil(32) as i32, dims.nz().div_ceil(32) as i32];
        let count = (grid[0] * grid[1]) as usize;
        let empty = Bin { offset: 0, records: 0, triangles: 0, columns: (i16::MAX, i16::MIN) };
        Ok(Self::go_on(Bins {
            file,
            folder: folder.to_path_buf(),
            grid,
            columns: dims.nx() as i32,
            bins: vec![empty; count],
            bytes: 0,
        }))
    }

    /// Reopens bins to add more triangles.
    pub(super) fn go_on(bins: Bins) -> Self {
        Self {
            waiting: vec![Waiting { first: NONE, count: 0 }; bins.bins.len()],
            chunks: Vec::with_capacity(CHUNKS),
            free: NONE,
            room: CHUNKS,
            buffer: Vec::with_capacity(WRITE),
            written: bins.bytes,
            bins,
        }
    }

    /// Puts a triangle into every bin that it concerns.
    pub(super) fn add(&mut self, t: &Triangle) -> Result<(), SourceError> {
        let ((j0, j1), (k0, k1)) = (centres(t, 1), centres(t, 2));
        let (x0, x1) = centres(t, 0);
        // No row meets a triangle beyond the last column before its end; but rows may be inside until then.
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
        let short = short(t);
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
                match short {
                    Some(record) => self.put(at, &[record]),
                    None => self.put(at, &pair(t)),
                }
            }
        }
        Ok(())
    }

    /// Adds a triangle to a bin; one of two records stays in one chunk.
    #[inline]
    fn put(&mut self, at: usize, records: &[Record]) {
        let waiting = &mut self.waiting[at];
        let count = self.chunks.get(waiting.first as usize).map_or(CHUNK, |chunk| chunk.count as usize);
        if count + records.len() > CHUNK {
            let next = std::mem::replace(&mut waiting.first, self.free);
            if self.free == NONE {
                waiting.first = self.chunks.len() as u32;
                self.chunks.push(Chunk { records: [[0; 6]; CHUNK], count: 0, next });
            } else {
                let chunk = &mut self.chunks[self.free as usize];
                self.free = std::mem::replace(&mut chunk.next, next);
                chunk.count = 0;
            }
            self.room -= 1;
        }
        let chunk = &mut self.chunks[waiting.first as usize];
        for record in records {
            chunk.records[chunk.count as usize] = *record;
            chunk.count += 1;
        }
        waiting.count += records.len() as u32;
        let bin = &mut self.bins.bins[at];
        bin.triangles = bin.triangles.saturating_add(1);
    }

    /// Swaps out bins with records worth a block; all bins, if that frees little.
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

    /// Writes a bin's records in blocks.
    fn swap_out(&mut self, at: usize) -> Result<(), SourceError> {
        let Waiting { first: mut next, count: mut left } =
            std::mem::replace(&mut self.waiting[at], Waiting { first: NONE, count: 0 });
        while left > 0 {
            // Chunks are full except for the first, and for one record where two did not fit.
            let most = left.min(BLOCK as u32);
            if self.buffer.len() + (most as usize + 1) * RECORD > WRITE {
                self.flush()?;
            }
            let start = self.buffer.len();
            let bin = &mut self.bins.bins[at];
            let head: Head = [bin.offset, bin.records.into(), 0];
            self.buffer.extend_from_slice(bytemuck::bytes_of(&head));
            let mut records = 0;
            while let Some(chunk) = self.chunks.get_mut(next as usize) {
                if records + chunk.count > most {
                    break;
                }
                records += chunk.count;
                self.buffer.extend_from_slice(bytemuck::cast_slice(&chunk.records[..chunk.count as usize]));
                let after = std::mem::replace(&mut chunk.next, self.free);
                self.free = std::mem::replace(&mut next, after);
                self.room += 1;
            }
            left -= records;
            bin.offset = self.written + start as u64;
            bin.records = records;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), SourceError> {
        self.bins.file.write_all_at(&self.buffer, self.written).map_err(|e| self.bins.error(e))?;
        self.written += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    /// Writes the records that still wait.
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

/// True if a triangle may bear upon a bin, seen along x; false only if it does not.
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
    // The triangle is off if every corner of the box lies beyond one of its edges.
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
                got.extend(held(block).map(|t| t.triangle()));
                true
            })
            .unwrap();
            assert_eq!(got.len() as u32, bins.triangles(row, slice));
            got.sort_unstable();
            // Triangles that reach the bin's rows and slices, two more included, must be there.
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
