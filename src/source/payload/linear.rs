//! One slice after another in a stream: unrolled with fixed buffers.

use std::io::{self, Read};
use std::sync::Arc;

use super::inflate::{BZIP2_HEAD, Bzip2, Gzip, bzip2_level, bzip2_memory, section};
use super::text::{Hex, Numbers};
use super::{INPUT_BYTES, Samples, Skip, Target, Unroll, regular};
use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::source::files::{FileList, FileSet};
use crate::source::header::unusable;
use crate::volume::{Endian, Note, Result, SourceError, SourceFault, VolumeInfo};

/// Stored bytes that are turned into samples at a time; a multiple of every sample's width.
const PIECE_BYTES: usize = 32 << 10;

/// The state of an inflater without its input and output buffers: its window, twice, and tables.
const INFLATER: u64 = 64 << 10;

/// Bytes of the buffers and of the inflater's window: input, stored samples, delivered samples (twice as
/// long where halves grow), and the inflater's window with its tables.
const MEMORY_BYTES: u64 = (INPUT_BYTES + 2 * PIECE_BYTES) as u64 + INFLATER;

/// Packing of the samples in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::source) enum Encoding {
    /// Samples lie plain.
    Raw,
    /// Gzip (RFC 1952), one or several members.
    Gzip,
    /// Zlib (RFC 1950).
    Zlib,
    /// Bzip2, with blocks of up to this many times 100,000 bytes.
    Bzip2(u8),
    /// Numbers as text.
    Text,
    /// Hexadecimal digits.
    Hex,
}

impl Encoding {
    /// Bzip2 with the block size that the streams of these files state at byte `skip`; with the largest size for a file
    /// that is not a stream, which shows when it is unrolled.
    pub(in crate::source) fn bzip2(files: &FileList, skip: u64) -> Self {
        let level_of = |index: usize| {
            let mut head = [0; BZIP2_HEAD];
            let path = files.path(index);
            let file = regular(&path).ok().and_then(|_| PositionalFile::open(&path).ok())?;
            file.read_exact_at(&mut head, skip).ok()?;
            bzip2_level(&head)
        };
        Self::Bzip2((0..files.len()).filter_map(level_of).max().unwrap_or(9))
    }

    /// Name of the packing, without details for the decoder.
    pub(in crate::source) fn packing(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Bzip2(_) => "bzip2",
            Self::Text => "text",
            Self::Hex => "hexadecimal",
        }
    }

    /// The most bytes that `stored` bytes can become: a header that promises more is wrong, and no scratch file has to
    /// be filled to find out.
    pub(in crate::source) fn most(self, stored: u64, samples: Samples) -> u64 {
        let times = match self {
            Self::Raw => 1,
            // A bit of deflate makes 258 bytes / 2 bits at best.
            Self::Gzip | Self::Zlib => 1032,
            // A block of some 40 bytes makes 900,000 that run-length coding blew up by 51.
            Self::Bzip2(_) => 2_000_000,
            // A digit and a separator.
            Self::Text => samples.bytes() as u64,
            Self::Hex => 1,
        };
        stored.saturating_mul(times).saturating_add(times)
    }

    /// The plain bytes of the stream that begins at `offset` of a file.
    pub(in crate::source) fn open(
        self,
        file: &PositionalFile,
        offset: u64,
        samples: Samples,
    ) -> Box<dyn Read + '_> {
        let section = section(file, offset, u64::MAX);
        match self {
            Self::Raw => Box::new(section),
            Self::Gzip => Box::new(Gzip::new(section)),
            Self::Zlib => Box::new(flate2::bufread::ZlibDecoder::new(section)),
            Self::Bzip2(level) => Box::new(Bzip2::new(section, level)),
            Self::Text => Box::new(Numbers::new(section, samples)),
            Self::Hex => Box::new(Hex(section)),
        }
    }
}

/// Streams with one slice after another: all slices in one, or the same number in each of several.
///
/// Unrolling holds 160 KiB (for bzip2 up to 2.3 MiB more, by its blocks), for volumes of any size.
pub(in crate::source) struct Linear {
    pub(in crate::source) files: Arc<FileSet>,
    pub(in crate::source) encoding: Encoding,
    pub(in crate::source) samples: Samples,
    /// Ignored for text.
    pub(in crate::source) endian: Endian,
    /// Slices in one stream; at least 1.
    pub(in crate::source) slices_per_file: u64,
    /// Slice of the first stream that is slice 0 of the volume.
    pub(in crate::source) first_slice: u64,
    /// Bytes of a file before its stream.
    pub(in crate::source) skip: u64,
    /// Unpacked bytes before the first sample of each stream.
    pub(in crate::source) skip_unpacked: Skip,
}

impl Linear {
    fn fail(&self, file: usize, fault: Fault) -> SourceError {
        unusable(&self.files.list().path(file), fault)
    }

    /// Bytes of the stream of a file, as far as it can be read.
    fn length(&self, file: &PositionalFile, buffer: &mut [u8]) -> u64 {
        let mut stream = self.encoding.open(file, self.skip, self.samples);
        let mut length = 0;
        while let Ok(read @ 1..) = read_some(&mut *stream, buffer) {
            length += read as u64;
        }
        length
    }

    /// Unrolls `count` slices of file `index` from slice `within` on, as slices from `z` on.
    fn unroll_file(
        &self,
        file: &PositionalFile,
        index: usize,
        [z, within, count]: [u64; 3],
        slice_bytes: u64,
        target: &Target<'_>,
        buffer: &mut [u8],
    ) -> Result<Option<Note>> {
        let packing = self.encoding.packing();
        let share = self.slices_per_file.saturating_mul(slice_bytes);
        let skipped = match self.skip_unpacked {
            Skip::Bytes(bytes) => bytes,
            // A damaged stream shows when it is read again.
            Skip::AllButSamples => self.length(file, buffer).saturating_sub(share),
        };
        let mut stream = self.encoding.open(file, self.skip, self.samples);
        let before = within.saturating_mul(slice_bytes).saturating_add(skipped);
        let promised = share.saturating_add(skipped);
        let short = |got: u64| {
            bad!(
                "the header promises {promised} bytes, the {packing} stream ends after {got}; the file was cut short, copy it again"
            )
        };
        let failed = |cause: io::Error, got: u64| {
            // Decoders report damage in errors of their own; only the system's have a number.
            let fault = match (cause.kind(), cause.raw_os_error()) {
                (io::ErrorKind::UnexpectedEof, _) => short(got),
                (_, Some(code)) => bad!("cannot be read ({})", io::Error::from_raw_os_error(code)),
                _ => bad!("the {packing} stream is damaged ({cause}); copy the file again"),
            };
            self.fail(index, fault)
        };
        let endian = if self.encoding == Encoding::Text { Endian::Little } else { self.endian };
        let (stored, delivered) = (self.samples.bytes(), self.samples.delivered().bytes());
        // Samples that have to grow wait in the tail of the buffer.
        let tail = buffer.len() - buffer.len() / delivered * stored;
        let mut got = 0;
        while got < before {
            let want = usize::try_from(before - got).unwrap_or(usize::MAX).min(buffer.len());
            let part = buffer.get_mut(..want).unwrap_or_default();
            let read = read_some(&mut *stream, part).map_err(|cause| failed(cause, got))?;
            got += read as u64;
            if read == 0 {
                return Err(self.fail(index, short(got)));
            }
        }
        let end = before.saturating_add(count.saturating_mul(slice_bytes));
        let mut offset = z.saturating_mul(slice_bytes / stored as u64).saturating_mul(delivered as u64);
        while got < end {
            let most = buffer.len() - tail;
            let want = usize::try_from(end - got).unwrap_or(usize::MAX).min(most);
            // The stored samples end where the buffer, as long as the delivered ones, ends.
            let length = want / stored * delivered;
            let at = length - want;
            let mut filled = 0;
            while filled < want {
                let part = buffer.get_mut(at + filled..length).unwrap_or_default();
                let so_far = got + filled as u64;
                let read = read_some(&mut *stream, part).map_err(|cause| failed(cause, so_far))?;
                if read == 0 {
                    return Err(self.fail(index, short(so_far)));
                }
                filled += read;
            }
            let piece = buffer.get_mut(..length).unwrap_or_default();
            self.samples.deliver(endian, piece);
            target.write(piece, offset)?;
            offset += length as u64;
            got += want as u64;
        }
        if within + count < self.slices_per_file {
            return Ok(None);
        }
        // Also makes the decoder check the checksum at the stream's end.
        let more = read_some(&mut *stream, buffer.get_mut(..1).unwrap_or_default())
            .map_err(|cause| failed(cause, got))?;
        Ok((more > 0).then_some(Note::new(format!("the {packing} stream holds more than the {promised} bytes that the header promises; the rest is ignored"))))
    }
}

/// Some bytes; an interrupted call is made again.
fn read_some(stream: &mut dyn Read, buf: &mut [u8]) -> io::Result<usize> {
    loop {
        match stream.read(buf) {
            Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

impl Unroll for Linear {
    fn memory_bytes(&self) -> u64 {
        match self.encoding {
            Encoding::Bzip2(level) => MEMORY_BYTES + bzip2_memory(level),
            _ => MEMORY_BYTES,
        }
    }

    fn files(&self) -> &FileList {
        self.files.list()
    }

    fn unroll(&self, info: &VolumeInfo, target: &Target<'_>) -> Result<Vec<Note>> {
        let dims = info.dims;
        let slice_bytes = u64::from(dims.nx()) * u64::from(dims.ny()) * self.samples.bytes() as u64;
        let mut buffer = vec![0; PIECE_BYTES / self.samples.bytes() * self.samples.delivered().bytes()];
        let mut notes: Vec<Note> = Vec::new();
        let nz = u64::from(dims.nz());
        let mut z = 0;
        while z < nz {
            let slice = self.first_slice.saturating_add(z);
            let (index, within) = (slice / self.slices_per_file, slice % self.slices_per_file);
            let index = usize::try_from(index).unwrap_or(usize::MAX);
            let count = (self.slices_per_file - within).min(nz - z);
            let mut result = Ok(None);
            self.files
                .with(index, |file| {
                    result =
                        self.unroll_file(file, index, [z, within, count], slice_bytes, target, &mut buffer);
                    Ok(())
                })
                .map_err(|cause| {
                    SourceError::from(SourceFault::Unreadable { path: self.files.list().path(index), cause })
                })?;
            notes.extend(result?.filter(|note| notes.last() != Some(note)));
            z += count;
        }
        Ok(notes)
    }
}
