//! Rows read of chunks, which are unpacked when they are first asked for.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock};

use super::array::{Array, Place};
use super::packing::{PIECE, chunk_fault};
use crate::budget::Reservation;
use crate::facts::SourceFault;
use crate::facts::samples::ReadFault;
use crate::facts::zarr::ZarrFault;
use crate::platform::FileExt;
use crate::scratch::unnamed;
use crate::source::header::unreadable;
use crate::source::stored::Samples;
use crate::volume::{
    Endian, Preparation, Result, SourceError, VolumeInfo, VolumeSource, Workspace, check_request,
};

/// Files of plain chunks that stay open.
const OPEN: usize = 32;

/// Bytes of rows that are read together.
const SPAN: usize = 32 << 10;

/// Place of a chunk that was never written.
const NOWHERE: u32 = u32::MAX;

/// Locks of chunks that are being unpacked, and of the places that they are read from.
const LOCKS: usize = 64;

/// Rows and slices that are read of chunks at about the same time, at most: by a build, of two rows of bricks and a few
/// beyond them; by passes over whole slices, of a few. Chunks that are read once more after that are unpacked again.
const ROWS_AT_A_TIME: u64 = 70;
const SLICES_AT_A_TIME: u64 = 8;

/// Most files that are named for a volume, to notice that one of them changes.
const NAMED: u64 = 1 << 16;

/// One volume of an array.
///
/// Plain chunks are read where they lie. Packed ones are written to an anonymous scratch file when they are asked for, by
/// the thread that asks: what no one reads is not unpacked. The file has places for some rows or layers of chunks, and a
/// new chunk takes the place of the one that was unpacked longest ago: pages that the system has given once are written
/// at half the price of fresh ones. Memory: eight bytes a chunk at most, and for each reading thread what unpacks a chunk
/// (for Blosc three of its blocks, for zstd its window).
pub(super) struct ZarrVolume {
    array: Arc<Array>,
    /// Which volume of the array.
    number: u64,
    info: VolumeInfo,
    /// Memory that unpacking a chunk takes.
    unpacking_bytes: OnceLock<u64>,
    way: Way,
}

/// Files of chunks by their numbers; `None` where there is none.
type OpenFiles = Mutex<Vec<(u64, Option<Arc<File>>)>>;

enum Way {
    /// Chunks as they are, the last ones used first.
    Plain(OpenFiles),
    Packed(Option<Box<Unpacked>>),
}

/// Chunks that were unpacked.
struct Unpacked {
    scratch: File,
    /// Place of each chunk in the file, in chunks from 1 on; 0 where it is not there.
    places: Box<[AtomicU32]>,
    /// The chunk that each place was given to last, from 1 on.
    owners: Box<[AtomicU32]>,
    /// Places that were given, one after the other and then again from the first.
    given: AtomicU64,
    /// Held by the thread that unpacks a chunk.
    locks: [Mutex<()>; LOCKS],
    /// Held by those that read a place, and alone by the one that writes it.
    readers: [RwLock<()>; LOCKS],
    /// That of places and owners.
    _memory: Reservation,
}

impl ZarrVolume {
    pub(super) fn new(array: Arc<Array>, number: u64, info: VolumeInfo) -> Self {
        let is_plain = !array.packing.is_packed() && !array.packing.is_checked() && !array.is_sharded();
        let is_plain = is_plain && matches!(array.samples, Samples::Plain(_));
        let way = if is_plain { Way::Plain(Mutex::default()) } else { Way::Packed(None) };
        Self { array, number, info, unpacking_bytes: OnceLock::new(), way }
    }

    /// Memory that unpacking a chunk takes, by the first ones that are there: chunks are of one size, and packed in one
    /// way. A damaged one is met again when it is read.
    fn unpacking_bytes(&self) -> u64 {
        match self.way {
            Way::Plain(_) => 0,
            Way::Packed(_) => *self.unpacking_bytes.get_or_init(|| self.probe()),
        }
    }

    fn probe(&self) -> u64 {
        const FOUND: usize = 8;
        const LOOKED_FOR: u64 = 4096;
        let (bytes, _) = self.array.within(self.number);
        let all = self.chunk_count();
        let step = all.div_ceil(LOOKED_FOR).max(1);
        let found = (0..all).step_by(usize::try_from(step).unwrap_or(usize::MAX)).filter_map(|at| {
            let place = self.array.place(self.number, self.chunk_at(at)).ok().flatten()?;
            self.array.packing.memory_bytes(&place, bytes).ok()
        });
        found.take(FOUND).max().unwrap_or(0) + 3 * PIECE as u64
    }

    fn chunk_count(&self) -> u64 {
        self.array.chunks().iter().product()
    }

    /// Places of the scratch file.
    fn place_count(&self) -> u64 {
        let [[nz, ny, nx], [cz, cy, _]] = [self.array.chunks(), self.array.chunk];
        let rows = (1 + ROWS_AT_A_TIME.div_ceil(cy)).min(ny).saturating_mul(nz);
        let layers = (1 + SLICES_AT_A_TIME.div_ceil(cz)).min(nz).saturating_mul(ny);
        rows.max(layers).saturating_mul(nx).max(LOCKS as u64).min(self.chunk_count())
    }

    fn places_bytes(&self) -> u64 {
        (self.chunk_count() + self.place_count()).saturating_mul(size_of::<AtomicU32>() as u64)
    }

    fn chunk_at(&self, at: u64) -> [u64; 3] {
        let [_, ny, nx] = self.array.chunks();
        [at / (ny * nx), at / nx % ny, at % nx]
    }

    fn chunk_number(&self, [z, y, x]: [u64; 3]) -> u64 {
        let [_, ny, nx] = self.array.chunks();
        (z * ny + y) * nx + x
    }

    /// Bytes of a chunk in the scratch file.
    fn delivered_bytes(&self) -> u64 {
        self.array.chunk.iter().product::<u64>() * self.info.scalar.bytes() as u64
    }

    /// Place of a chunk in the scratch file, to which it is written unless it is there; [`NOWHERE`] if it was never stored.
    fn unpack(&self, unpacked: &Unpacked, chunk: [u64; 3], known: &AtomicU32) -> io::Result<u32> {
        if let place @ 1.. = known.load(Ordering::Acquire) {
            return Ok(place);
        }
        let number = self.chunk_number(chunk);
        let lock = |n: u64| usize::try_from(n % LOCKS as u64).unwrap_or(0);
        // A thread that panicked has given its chunk no place.
        let _only = unpacked.locks[lock(number)].lock().unwrap_or_else(PoisonError::into_inner);
        if let place @ 1.. = known.load(Ordering::Acquire) {
            return Ok(place);
        }
        let place = match self.array.place(self.number, chunk)? {
            None => NOWHERE,
            Some(stored) => {
                let at = unpacked.given.fetch_add(1, Ordering::Relaxed) % unpacked.owners.len() as u64;
                let place = u32::try_from(at + 1).unwrap_or(NOWHERE);
                let _alone =
                    unpacked.readers[lock(place.into())].write().unwrap_or_else(PoisonError::into_inner);
                let owner = u32::try_from(number + 1).unwrap_or(0);
                let before = unpacked.owners[place as usize - 1].swap(owner, Ordering::AcqRel);
                if let Some(known) = before.checked_sub(1).and_then(|n| unpacked.places.get(n as usize)) {
                    // Not if it has got another place meanwhile.
                    let _ = known.compare_exchange(place, 0, Ordering::AcqRel, Ordering::Acquire);
                }
                self.write(unpacked, &stored, at * self.delivered_bytes())?;
                known.store(place, Ordering::Release);
                return Ok(place);
            }
        };
        known.store(place, Ordering::Release);
        Ok(place)
    }

    /// Reads bytes of a chunk from the scratch file; `false` if the chunk was never stored.
    fn read_unpacked(
        &self,
        unpacked: &Unpacked,
        chunk: [u64; 3],
        at: u64,
        out: &mut [u8],
    ) -> io::Result<bool> {
        let slot = usize::try_from(self.chunk_number(chunk)).unwrap_or(usize::MAX);
        let Some(known) = unpacked.places.get(slot) else { return Err(ReadFault::NotUnrolled.into()) };
        loop {
            let place = self.unpack(unpacked, chunk, known)?;
            if place == NOWHERE {
                return Ok(false);
            }
            let held =
                unpacked.readers[place as usize % LOCKS].read().unwrap_or_else(PoisonError::into_inner);
            // Another chunk may have taken the place before it was held.
            if known.load(Ordering::Acquire) == place {
                unpacked.scratch.read_exact_at(out, u64::from(place - 1) * self.delivered_bytes() + at)?;
                return Ok(true);
            }
            drop(held);
        }
    }

    fn write(&self, unpacked: &Unpacked, place: &Place, at: u64) -> io::Result<()> {
        let (bytes, skip) = self.array.within(self.number);
        let samples = self.array.samples;
        let native = cfg!(target_endian = "little") == (self.array.endian == Endian::Little);
        let is_same = matches!(samples, Samples::Plain(scalar) if native || scalar.bytes() == 1);
        let mut writer = Writer {
            scratch: &unpacked.scratch,
            skip,
            left: self.array.volume_bytes(),
            at,
            turn: (!is_same).then_some((samples, self.array.endian)),
            pending: Vec::new(),
        };
        self.array.packing.unpack(place, bytes, self.unpacking_bytes(), &mut |piece| writer.take(piece))?;
        writer.flush()?;
        if writer.left > 0 { Err(chunk_fault(ZarrFault::Short)) } else { Ok(()) }
    }

    /// Reads bytes of one chunk, from byte `at` of its slice `z` on.
    fn read_chunk(&self, (z, chunk): (u64, [u64; 3]), at: u64, out: &mut [u8]) -> io::Result<()> {
        let [cz, cy, cx] = self.array.chunk;
        let size = self.info.scalar.bytes();
        let at = z % cz * cy * cx * size as u64 + at;
        match &self.way {
            Way::Packed(None) => Err(ReadFault::NotUnrolled.into()),
            Way::Packed(Some(unpacked)) => {
                if !self.read_unpacked(unpacked, chunk, at, out)? {
                    self.fill(out);
                }
                Ok(())
            }
            Way::Plain(open) => {
                let Some(file) = self.plain(open, chunk)? else {
                    self.fill(out);
                    return Ok(());
                };
                let (_, volume_at) = self.array.within(self.number);
                file.read_exact_at(out, volume_at + at).map_err(|cause| match cause.kind() {
                    io::ErrorKind::UnexpectedEof => chunk_fault(ZarrFault::Short),
                    _ => cause,
                })?;
                self.array.endian.to_native(size, out);
                Ok(())
            }
        }
    }

    /// The file of a plain chunk, of those that are open or opened.
    fn plain(&self, open: &OpenFiles, chunk: [u64; 3]) -> io::Result<Option<Arc<File>>> {
        let number = self.chunk_number(chunk);
        let mut open = open.lock().unwrap_or_else(PoisonError::into_inner);
        let found = match open.iter().position(|(known, _)| *known == number) {
            Some(at) => open.remove(at),
            None => {
                let place = self.array.place(self.number, chunk)?;
                let (bytes, _) = self.array.within(self.number);
                if place.as_ref().is_some_and(|place| place.length != bytes) {
                    return Err(chunk_fault(ZarrFault::Short));
                }
                (number, place.map(|place| Arc::new(place.file)))
            }
        };
        let file = found.1.clone();
        open.truncate(OPEN - 1);
        open.insert(0, found);
        Ok(file)
    }

    /// The value of what was never written. `out` begins and ends with whole samples.
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

/// Writes the bytes of a chunk that belong to a volume, as samples that are delivered.
struct Writer<'a> {
    scratch: &'a File,
    /// Bytes of other volumes before those of this one.
    skip: u64,
    left: u64,
    at: u64,
    /// How stored samples become delivered ones, where they differ.
    turn: Option<(Samples, Endian)>,
    pending: Vec<u8>,
}

impl Writer<'_> {
    fn take(&mut self, piece: &[u8]) -> io::Result<()> {
        let skipped = usize::try_from(self.skip).unwrap_or(usize::MAX).min(piece.len());
        self.skip -= skipped as u64;
        let piece = &piece[skipped..];
        let piece = &piece[..usize::try_from(self.left).unwrap_or(usize::MAX).min(piece.len())];
        self.left -= piece.len() as u64;
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

    /// Writes the whole samples of what waits.
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
            Way::Packed(None) => Preparation {
                scratch_bytes: self.place_count().saturating_mul(self.delivered_bytes()),
                memory_bytes: self.places_bytes(),
                on_demand: true,
            },
            _ => Preparation::default(),
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let (chunks, place_count, places_bytes) =
            (self.chunk_count(), self.place_count(), self.places_bytes());
        if let Way::Packed(way @ None) = &mut self.way {
            let memory = workspace.reserve(places_bytes, || self.array.path(self.number, [0; 3]))?;
            let numbers = |count: u64| (0..count).map(|_| AtomicU32::new(0)).collect();
            let (places, owners) = (numbers(chunks), numbers(place_count));
            let scratch = unnamed(workspace.scratch).map_err(|cause| {
                SourceError::from(SourceFault::Scratch { path: workspace.scratch.to_path_buf(), cause })
            })?;
            *way = Some(Box::new(Unpacked {
                scratch,
                places,
                owners,
                given: AtomicU64::new(0),
                locks: std::array::from_fn(|_| Mutex::default()),
                readers: std::array::from_fn(|_| RwLock::default()),
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
        for y in u64::from(rows.start) / cy..=u64::from(rows.end - 1) / cy {
            for x in u64::from(cols.start) / cx..=u64::from(cols.end - 1) / cx {
                let chunk = [u64::from(z) / cz, y, x];
                let (in_rows, to_row) = overlap(&rows, y * cy, cy);
                let (in_cols, to_col) = overlap(&cols, x * cx, cx);
                // One read from the first sample to the last: most are read for others, too, and few for nothing.
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
        self.unpacking_bytes()
    }
}

/// The part of a range that lies in a chunk: from the chunk's start on, and from that of the range on.
fn overlap(range: &Range<u32>, start: u64, side: u64) -> (Range<u32>, usize) {
    let from = u64::from(range.start).max(start);
    let to = u64::from(range.end).min(start + side);
    let within = |at: u64| u32::try_from(at - start).unwrap_or(u32::MAX);
    (within(from)..within(to), usize::try_from(from - u64::from(range.start)).unwrap_or(0))
}
