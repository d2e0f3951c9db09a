//! Rows read from chunks, which are unpacked when they are first asked for.

use std::collections::HashMap;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock, TryLockError};

use super::array::{Array, ChunkLocation};
use super::blosc::Buffers;
use super::packing::{PIECE, long, short};
use crate::budget::Reservation;
use crate::platform::PositionalFile;
use crate::scratch::unnamed;
use crate::source::header::unreadable;
use crate::source::payload::Samples;
use crate::volume::{
    Endian, Preparation, Result, SourceError, SourceFault, VolumeInfo, VolumeSource, Workspace,
    check_request, not_unrolled,
};

/// Files of plain chunks that stay open.
const OPEN: usize = 32;

/// Bytes of rows that are read together.
const SPAN: usize = 32 << 10;

/// Locks of slabs that are being unpacked, and so the most such slabs.
const LOCKS: usize = 64;

/// Fewest bytes of a slab, where a chunk has more, and most of one that ends where blocks do.
const SLAB: u64 = 1 << 20;
const WIDE_SLAB: u64 = 4 << 20;

/// Most rows and slices that are read at about the same time: for a build two rows of bricks with a few rows beyond
/// them, in a column with a few slices beyond it; for passes over whole slices a few slices. Slabs that are read once
/// more after that are unpacked again.
const ROWS_AT_A_TIME: u64 = 70;
const COLUMN_AT_A_TIME: u64 = 264;
const SLICES_AT_A_TIME: u64 = 8;

/// Memory of a place of the scratch file: its owner, and that one's entry in a map that may be half empty and grows
/// from one half as large.
const PLACE_BYTES: u64 = 136;

/// Most files that are named for a volume, to notice that one of them changes.
const NAMED: u64 = 1 << 16;

/// One volume of an array.
///
/// Plain chunks are read where they lie. Packed ones are written to an anonymous scratch file on demand, by the thread
/// that asks: unread chunks are not unpacked. The unit is a slab: some slices of a chunk where its blocks are packed
/// one by one, else all of them. The file has places for the slabs that are read at a time, and a new slab takes the
/// place of the one that was unpacked longest ago: reused pages are written at half the price of fresh ones. Memory:
/// [`PLACE_BYTES`] a place, and for each reading thread the unpacker of a slab (for Blosc three of its blocks, for zstd
/// its window).
pub(super) struct ZarrVolume {
    array: Arc<Array>,
    /// Number of the volume in the array.
    number: u64,
    info: VolumeInfo,
    unpacking: OnceLock<Unpacking>,
    way: ChunkFiles,
}

/// Unpacking of chunks.
#[derive(Clone, Copy, Debug)]
struct Unpacking {
    /// Memory of a thread that unpacks, in bytes.
    bytes: u64,
    /// Slices of a slab, as many as a chunk's at most.
    slices: u64,
}

/// Files of chunks by their numbers; `None` where a chunk has no file.
type OpenFiles = Mutex<Vec<(u64, Option<Arc<PositionalFile>>)>>;

enum ChunkFiles {
    /// Files of plain chunks, the last ones used first.
    Plain(OpenFiles),
    Packed(Option<Box<Unpacked>>),
}

/// Slabs that were unpacked.
struct Unpacked {
    scratch: PositionalFile,
    /// Held shared by readers of a slab, and alone by a thread that gives or takes away a place.
    places: RwLock<Places>,
    /// Held by the thread that unpacks a slab.
    locks: [Mutex<()>; LOCKS],
    /// Buffers left by threads that have unpacked a slab.
    idle: Mutex<Vec<Buffers>>,
    /// Memory of the places.
    _memory: Reservation,
}

/// The places of the scratch file.
struct Places {
    /// Place of each slab that is there; `None` of one that was never stored.
    of: HashMap<u64, Option<u64>>,
    /// The slab that each place was given to last.
    owners: Box<[Owner]>,
    next: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Owner {
    None,
    /// A thread writes to the place.
    Busy,
    Slab(u64),
}

impl Places {
    /// Takes a place from the slab that has had it longest. There are more of them than slabs that are being unpacked,
    /// or as many as slabs.
    fn take(&mut self) -> usize {
        loop {
            let at = self.next;
            self.next = (at + 1) % self.owners.len();
            match std::mem::replace(&mut self.owners[at], Owner::Busy) {
                Owner::Busy => continue,
                Owner::Slab(number) => drop(self.of.remove(&number)),
                Owner::None => {}
            }
            return at;
        }
    }

    fn give(&mut self, at: usize, owner: Owner, place: Option<u64>) {
        self.owners[at] = owner;
        if let Owner::Slab(number) = owner {
            self.of.insert(number, place);
        }
    }
}

/// A slab: its chunk, and its slices within it.
struct Slab {
    number: u64,
    chunk: [u64; 3],
    slices: Range<u64>,
}

impl ZarrVolume {
    pub(super) fn new(array: Arc<Array>, number: u64, info: VolumeInfo) -> Self {
        let is_plain = !array.packing.is_packed() && !array.packing.is_checked() && !array.is_sharded();
        let is_plain = is_plain && matches!(array.samples, Samples::Plain(_));
        let way = if is_plain { ChunkFiles::Plain(Mutex::default()) } else { ChunkFiles::Packed(None) };
        Self { array, number, info, unpacking: OnceLock::new(), way }
    }

    /// Unpacking of chunks, found from the first ones that exist: chunks are of one size, and packed in one way. A
    /// damaged one is met again when it is read.
    fn unpacking(&self) -> Unpacking {
        *self.unpacking.get_or_init(|| self.probe())
    }

    fn probe(&self) -> Unpacking {
        const FOUND: usize = 8;
        const LOOKED_FOR: u64 = 4096;
        let (bytes, _) = self.array.within(self.number);
        let packing = self.array.packing;
        let all = self.chunk_count();
        let step = all.div_ceil(LOOKED_FOR).max(1);
        let found = (0..all).step_by(usize::try_from(step).unwrap_or(usize::MAX)).filter_map(|at| {
            let place = self.array.place(self.number, self.chunk_at(at)).ok().flatten()?;
            Some((packing.memory_bytes(&place, bytes).ok()?, packing.block_bytes(&place)))
        });
        let found: Vec<_> = found.take(FOUND).collect();
        let most = found.iter().map(|(bytes, _)| *bytes).max().unwrap_or(0);
        let block = found.first().and_then(|(_, block)| *block);
        Unpacking { bytes: most + 3 * PIECE as u64, slices: self.slab_slices(block) }
    }

    /// Slices of a slab of chunks with such blocks.
    fn slab_slices(&self, block: Option<u64>) -> u64 {
        let [cz, ..] = self.array.chunk;
        let Some(block) = block else { return cz };
        let slice = self.array.volume_bytes() / cz;
        let fewest = SLAB.div_ceil(slice).min(cz);
        // No block is unpacked twice where slabs end with blocks.
        let whole =
            (fewest..=(WIDE_SLAB / slice).min(cz)).find(|slices| (slices * slice).is_multiple_of(block));
        whole.unwrap_or(fewest)
    }

    fn chunk_count(&self) -> u64 {
        self.array.chunks().iter().product()
    }

    /// Slabs of a chunk.
    fn slabs(&self) -> u64 {
        self.array.chunk[0].div_ceil(self.unpacking().slices)
    }

    /// Places of the scratch file.
    fn place_count(&self) -> u64 {
        let [[nz, ny, nx], [_, cy, _]] = [self.array.chunks(), self.array.chunk];
        let (slices, all) = (self.unpacking().slices, nz.saturating_mul(self.slabs()));
        // A chunk may end with a shorter slab.
        let depth = self.array.chunk[0];
        let shorter = |count: u64| if depth.is_multiple_of(slices) { 0 } else { count.div_ceil(depth) };
        let layers = |count: u64| (1 + count.div_ceil(slices) + shorter(count)).min(all);
        let rows = (1 + ROWS_AT_A_TIME.div_ceil(cy)).min(ny).saturating_mul(layers(COLUMN_AT_A_TIME));
        let whole = layers(SLICES_AT_A_TIME).saturating_mul(ny);
        let most = self.chunk_count().saturating_mul(self.slabs());
        rows.max(whole).saturating_mul(nx).max(2 * LOCKS as u64).min(most)
    }

    fn places_bytes(&self) -> u64 {
        self.place_count().saturating_mul(PLACE_BYTES)
    }

    fn chunk_at(&self, at: u64) -> [u64; 3] {
        let [_, ny, nx] = self.array.chunks();
        [at / (ny * nx), at / nx % ny, at % nx]
    }

    fn chunk_number(&self, [z, y, x]: [u64; 3]) -> u64 {
        let [_, ny, nx] = self.array.chunks();
        (z * ny + y) * nx + x
    }

    /// The slab of a chunk in which its slice `z` lies.
    fn slab(&self, chunk: [u64; 3], z: u64) -> Slab {
        let (slices, [cz, ..]) = (self.unpacking().slices, self.array.chunk);
        let at = z / slices;
        let number = self.chunk_number(chunk) * self.slabs() + at;
        Slab { number, chunk, slices: at * slices..((at + 1) * slices).min(cz) }
    }

    /// Bytes of a slice of a chunk in the scratch file.
    fn slice_bytes(&self) -> u64 {
        let [_, cy, cx] = self.array.chunk;
        cy * cx * self.info.scalar.bytes() as u64
    }

    /// Bytes of a place.
    fn place_bytes(&self) -> u64 {
        self.unpacking().slices.saturating_mul(self.slice_bytes())
    }

    /// Writes a slab to the scratch file, unless it is there; one that another thread unpacks is waited for, or left to
    /// it.
    fn unpack(&self, unpacked: &Unpacked, slab: &Slab, waits: bool) -> io::Result<()> {
        // Neighbours along any axis seldom share a lock (Fibonacci hashing).
        let hash = slab.number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32;
        let lock = &unpacked.locks[usize::try_from(hash).unwrap_or(0) % LOCKS];
        let is_there =
            || unpacked.places.read().unwrap_or_else(PoisonError::into_inner).of.contains_key(&slab.number);
        if !waits && is_there() {
            return Ok(());
        }
        // A thread that panicked has left its place busy, and given it to no slab.
        let _only = match lock.try_lock() {
            Ok(held) => held,
            Err(TryLockError::WouldBlock) if !waits => return Ok(()),
            Err(_) => lock.lock().unwrap_or_else(PoisonError::into_inner),
        };
        if is_there() {
            return Ok(());
        }
        let places = || unpacked.places.write().unwrap_or_else(PoisonError::into_inner);
        let stored = self.array.place(self.number, slab.chunk)?;
        let at = places().take();
        let offset = at as u64 * self.place_bytes();
        let written =
            stored.as_ref().map(|stored| self.write(unpacked, (stored, &slab.slices), offset)).transpose();
        let owner = if written.is_ok() { Owner::Slab(slab.number) } else { Owner::None };
        places().give(at, owner, stored.map(|_| offset));
        written.map(drop)
    }

    /// Reads bytes of a slab from the scratch file; `false` if its chunk was never stored.
    fn read_unpacked(&self, unpacked: &Unpacked, slab: &Slab, at: u64, out: &mut [u8]) -> io::Result<bool> {
        loop {
            // No place is taken away while it is read.
            let places = unpacked.places.read().unwrap_or_else(PoisonError::into_inner);
            match places.of.get(&slab.number) {
                Some(Some(place)) => {
                    unpacked.scratch.read_exact_at(out, place + at)?;
                    return Ok(true);
                }
                Some(None) => return Ok(false),
                None => drop(places),
            }
            self.unpack(unpacked, slab, true)?;
        }
    }

    fn write(
        &self,
        unpacked: &Unpacked,
        (place, slices): (&ChunkLocation, &Range<u64>),
        at: u64,
    ) -> io::Result<()> {
        let (bytes, skip) = self.array.within(self.number);
        let slice = self.array.volume_bytes() / self.array.chunk[0];
        let wanted = skip + slices.start * slice..skip + slices.end * slice;
        let samples = self.array.samples;
        let native = cfg!(target_endian = "little") == (self.array.endian == Endian::Little);
        let is_same = matches!(samples, Samples::Plain(scalar) if native || scalar.bytes() == 1);
        let mut writer = Writer {
            scratch: &unpacked.scratch,
            at,
            turn: (!is_same).then_some((samples, self.array.endian)),
            pending: Vec::new(),
        };
        let allowed = self.unpacking().bytes;
        let idle = || unpacked.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let mut buffers = idle().pop().unwrap_or_default();
        let sink = &mut |piece: &[u8]| writer.take(piece);
        let done = self.array.packing.unpack(place, (bytes, wanted), allowed, (&mut buffers, sink));
        idle().push(buffers);
        done?;
        writer.flush()
    }

    /// Reads bytes of one chunk, from byte `at` of its slice `z` on.
    fn read_chunk(&self, (z, chunk): (u64, [u64; 3]), at: u64, out: &mut [u8]) -> io::Result<()> {
        let [cz, ..] = self.array.chunk;
        let size = self.info.scalar.bytes();
        match &self.way {
            ChunkFiles::Packed(None) => Err(not_unrolled()),
            ChunkFiles::Packed(Some(unpacked)) => {
                let slab = self.slab(chunk, z % cz);
                let at = (z % cz - slab.slices.start) * self.slice_bytes() + at;
                if !self.read_unpacked(unpacked, &slab, at, out)? {
                    self.fill(out);
                }
                Ok(())
            }
            ChunkFiles::Plain(open) => {
                let at = z % cz * self.slice_bytes() + at;
                let Some(file) = self.plain(open, chunk)? else {
                    self.fill(out);
                    return Ok(());
                };
                let (_, volume_at) = self.array.within(self.number);
                file.read_exact_at(out, volume_at + at).map_err(|cause| match cause.kind() {
                    io::ErrorKind::UnexpectedEof => short(),
                    _ => cause,
                })?;
                self.array.endian.to_native(size, out);
                Ok(())
            }
        }
    }

    /// The file of a plain chunk, of those that are open or opened.
    fn plain(&self, open: &OpenFiles, chunk: [u64; 3]) -> io::Result<Option<Arc<PositionalFile>>> {
        let number = self.chunk_number(chunk);
        let mut open = open.lock().unwrap_or_else(PoisonError::into_inner);
        let found = match open.iter().position(|(known, _)| *known == number) {
            Some(at) => open.remove(at),
            None => {
                let place = self.array.place(self.number, chunk)?;
                let (bytes, _) = self.array.within(self.number);
                match place.as_ref().map(|place| place.length) {
                    Some(length) if length < bytes => return Err(short()),
                    Some(length) if length > bytes => return Err(long(length, bytes)),
                    _ => {}
                }
                (number, place.map(|place| Arc::new(place.file)))
            }
        };
        let file = found.1.clone();
        open.truncate(OPEN - 1);
        open.insert(0, found);
        Ok(file)
    }

    /// Fills `out` with the value of unwritten samples. `out` begins and ends with whole samples.
    fn fill(&self, out: &mut [u8]) {
        let value = &self.array.fill;
        out.chunks_exact_mut(value.len()).for_each(|sample| sample.copy_from_slice(value));
    }

    fn failed(&self, chunk: [u64; 3], z: u32, cause: io::Error) -> SourceError {
        let path = self.array.path(self.number, chunk);
        match cause.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::StorageFull => {
                SourceError::from(SourceFault::ReadFailed { path, slice: z, cause })
            }
            _ => unreadable(&path, cause),
        }
    }
}

/// Writes the bytes of a chunk that belong to a slab, as samples that are delivered.
struct Writer<'a> {
    scratch: &'a PositionalFile,
    at: u64,
    /// Types of stored samples, where these differ from the delivered ones.
    turn: Option<(Samples, Endian)>,
    pending: Vec<u8>,
}

impl Writer<'_> {
    fn take(&mut self, piece: &[u8]) -> io::Result<()> {
        if self.turn.is_none() {
            return self.write(piece);
        }
        for part in piece.chunks(PIECE) {
            self.pending.extend_from_slice(part);
            if self.pending.len() >= PIECE {
                self.flush()?;
            }
        }
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.scratch.write_all_at(bytes, self.at)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Writes the whole samples among the pending bytes.
    fn flush(&mut self) -> io::Result<()> {
        let Some((samples, endian)) = self.turn else { return Ok(()) };
        let count = self.pending.len() / samples.bytes();
        let stored = count * samples.bytes();
        let mut delivered = vec![0; count * samples.delivered().bytes()];
        let tail = delivered.len() - stored;
        delivered[tail..].copy_from_slice(&self.pending[..stored]);
        samples.deliver(endian, &mut delivered);
        self.pending.drain(..stored);
        self.write(&delivered)
    }
}

impl VolumeSource for ZarrVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        if self.array.file_count() <= NAMED {
            self.array.each_file(&mut |chunk| each(&self.array.path(self.number, chunk)));
        }
    }

    fn preparation(&self) -> Preparation {
        match &self.way {
            ChunkFiles::Packed(None) => Preparation {
                scratch_bytes: self.place_count().saturating_mul(self.place_bytes()),
                memory_bytes: self.places_bytes(),
                on_demand: true,
            },
            _ => Preparation::default(),
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let (place_count, places_bytes) = (self.place_count(), self.places_bytes());
        if let ChunkFiles::Packed(way @ None) = &mut self.way {
            let memory = workspace.reserve(places_bytes, || self.array.path(self.number, [0; 3]))?;
            let scratch = unnamed(workspace.scratch).map_err(|cause| {
                SourceError::from(SourceFault::Scratch { path: workspace.scratch.to_path_buf(), cause })
            })?;
            let owners = (0..place_count).map(|_| Owner::None).collect();
            *way = Some(Box::new(Unpacked {
                scratch: scratch.into(),
                places: RwLock::new(Places { of: HashMap::new(), owners, next: 0 }),
                locks: std::array::from_fn(|_| Mutex::default()),
                idle: Mutex::default(),
                _memory: memory,
            }));
        }
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let pitch = (cols.len() * self.info.scalar.bytes()).max(1);
        self.read_pitched(z, rows, cols, pitch, out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        let size = self.info.scalar.bytes();
        let row_bytes = cols.len() * size;
        check_request(&self.info, z, &rows, &cols, rows.len() * row_bytes)
            .map_err(|cause| self.failed([0; 3], z, cause))?;
        if rows.is_empty() || cols.is_empty() {
            return Ok(());
        }
        let [cz, cy, cx] = self.array.chunk;
        let mut span = Vec::new();
        let along =
            |range: &Range<u32>, side| u64::from(range.start) / side..=u64::from(range.end - 1) / side;
        if let ChunkFiles::Packed(Some(unpacked)) = &self.way {
            // Threads read the same slabs at about the same time: together they unpack those of a row of chunks.
            for chunk in
                along(&rows, cy).flat_map(|y| along(&cols, cx).map(move |x| [u64::from(z) / cz, y, x]))
            {
                self.unpack(unpacked, &self.slab(chunk, u64::from(z) % cz), false)
                    .map_err(|cause| self.failed(chunk, z, cause))?;
            }
        }
        for y in along(&rows, cy) {
            for x in along(&cols, cx) {
                let chunk = [u64::from(z) / cz, y, x];
                let (in_rows, to_row) = overlap(&rows, y * cy, cy);
                let (in_cols, to_col) = overlap(&cols, x * cx, cx);
                // One read from the first sample to the last: most bytes between are read for other rows, too, and few
                // in vain.
                let (bytes, line) = (in_cols.len() * size, usize::try_from(cx).unwrap_or(usize::MAX) * size);
                let at = u64::from(in_rows.start) * line as u64 + u64::from(in_cols.start) * size as u64;
                let together = (SPAN / line).max(1);
                for first in (0..in_rows.len()).step_by(together) {
                    let count = together.min(in_rows.len() - first);
                    span.resize((count - 1) * line + bytes, 0);
                    self.read_chunk((u64::from(z), chunk), at + (first * line) as u64, &mut span)
                        .map_err(|cause| self.failed(chunk, z, cause))?;
                    for (row, from) in span.chunks(line).enumerate() {
                        let at = (to_row + first + row) * pitch + to_col * size;
                        out[at..at + bytes].copy_from_slice(&from[..bytes]);
                    }
                }
            }
        }
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        match self.way {
            ChunkFiles::Plain(_) => 0,
            ChunkFiles::Packed(_) => self.unpacking().bytes,
        }
    }
}

/// The part of a range that lies in a chunk: relative to the chunk's start, and its offset from the range's start.
fn overlap(range: &Range<u32>, start: u64, side: u64) -> (Range<u32>, usize) {
    let from = u64::from(range.start).max(start);
    let to = u64::from(range.end).min(start + side);
    let within = |at: u64| u32::try_from(at - start).unwrap_or(u32::MAX);
    (within(from)..within(to), usize::try_from(from - u64::from(range.start)).unwrap_or(0))
}
