//! Members of a ZIP archive, found by name and read as streams (PKWARE APPNOTE 4.3).
//!
//! Numbers may have 64 bits, in small archives, too (4.3.14, 4.5.3). The list of members is gone through for every
//! name, so that nothing is held. Names, lengths and offsets come from the list at the end; of the header before a
//! member only its own length counts.

use std::io::{self, Read};

use flate2::{Crc, Decompress, FlushDecompress, Status};

use super::stop::Stop;
use super::stream::Stream;
use crate::budget::Bytes;
use crate::fault::bad;
use crate::mesh::read::stop::{bad_archive, cut_short};
use crate::platform::PositionalFile;

/// Bytes of the record at the end, without its comment, and of the longest comment.
const END: u64 = 22;
/// Bytes that are read of the record with 64-bit numbers, and of the locator of that record before the end.
const END64: usize = 56;
const LOCATOR: usize = 20;
/// Marks the part of an entry that holds 64-bit numbers, and a number that stands there.
const EXTRA64: u16 = 1;
const ELSEWHERE: u64 = u32::MAX as u64;
const COMMENT: u64 = 65_535;
/// Bytes of an entry of the list and of a member's header, before their names.
const ENTRY: usize = 46;
const HEADER: usize = 30;
/// Longest name that is compared.
const NAME: u16 = 1024;
/// Size, and multiple of its packed bytes, above both of which a member is a bomb. Lists of vertices are packed 5 to 15
/// times.
const MAX_UNASKED: u64 = 4 << 20;
const MAX_TIMES: u64 = 100;
/// Bytes read at a time.
const INPUT: usize = 32 << 10;

#[derive(Clone, Copy, Debug)]
pub(super) struct Archive {
    list: u64,
    entries: u64,
    /// Offset of the archive: other data may precede it.
    bytes: u64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    offset: u64,
    stored: u64,
    bytes: u64,
    crc: u32,
    deflated: bool,
}

impl Archive {
    pub(super) fn open(file: &PositionalFile, bytes: u64) -> Result<Self, Stop> {
        let bad = || Stop::from(bad_archive());
        let span = bytes.min(END + COMMENT);
        let mut tail = vec![0; usize::try_from(span).unwrap_or(0)];
        file.read_exact_at(&mut tail, bytes - span).map_err(Stop::reading)?;
        let at = (0..tail.len().saturating_sub(21)).rev().find(|at| tail[*at..].starts_with(b"PK\x05\x06"));
        let end = at.and_then(|at| tail.get(at..at + 22)).ok_or_else(bad)?;
        let two = |at: usize| u64::from(u16::from_le_bytes([end[at], end[at + 1]]));
        let four = |at: usize| u64::from(u32::from_le_bytes(std::array::from_fn(|i| end[at + i])));
        if two(4) != 0 && two(4) != u64::from(u16::MAX) || two(6) != 0 && two(6) != u64::from(u16::MAX) {
            return Err(bad());
        }
        let (mut entries, mut length, mut list) = (two(10), four(12), four(16));
        if entries == u64::from(u16::MAX) || length == ELSEWHERE || list == ELSEWHERE {
            let here = bytes - span + at.unwrap_or(0) as u64;
            let locator = here.checked_sub(LOCATOR as u64).ok_or_else(bad)?;
            let locator: [u8; LOCATOR] = Stream::new(file, locator).take()?;
            let [at] = eights(&locator, 8);
            if at >= bytes {
                return Err(bad());
            }
            let record: [u8; END64] = Stream::new(file, at).take()?;
            if !locator.starts_with(b"PK\x06\x07") || !record.starts_with(b"PK\x06\x06") {
                return Err(bad());
            }
            [entries, length, list] = eights(&record, 32);
        }
        if list.checked_add(length).is_none_or(|end| end > bytes) {
            return Err(bad());
        }
        Ok(Self { list, entries, bytes })
    }

    /// The member of a name, in which upper and lower case are one (ECMA-376-2, 6.2.2).
    pub(super) fn find(&self, file: &PositionalFile, wanted: &str) -> Result<Option<Member>, Stop> {
        let bad = || Stop::from(bad_archive());
        let wanted = wanted.trim_start_matches('/').as_bytes();
        let mut stream = Stream::new(file, self.list);
        for _ in 0..self.entries {
            let entry: [u8; ENTRY] = stream.take()?;
            if !entry.starts_with(b"PK\x01\x02") {
                return Err(bad());
            }
            let two = |at: usize| u16::from_le_bytes([entry[at], entry[at + 1]]);
            let four = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| entry[at + i]));
            let name_bytes = two(28);
            let mut same = usize::from(name_bytes) == wanted.len() && name_bytes <= NAME;
            for at in 0..usize::from(name_bytes) {
                let [byte] = stream.take()?;
                same = same && wanted.get(at).is_some_and(|w| w.eq_ignore_ascii_case(&byte));
            }
            if !same {
                stream.skip(u64::from(two(30)) + u64::from(two(32)));
                continue;
            }
            if two(8) & 1 != 0 {
                return Err(bad!("is encrypted; decrypt it first").into());
            }
            let deflated = match two(10) {
                0 => false,
                8 => true,
                method => {
                    return Err(bad!(
                        "is an archive packed by method {method}, which is not read; pack it by deflate"
                    )
                    .into());
                }
            };
            // The numbers come in this order, where they are stored elsewhere.
            let mut numbers = [four(24), four(20), four(42)].map(u64::from);
            if numbers.contains(&ELSEWHERE) {
                large(&mut stream, two(30), &mut numbers)?;
            }
            let [bytes, stored, header] = numbers;
            if header >= self.bytes {
                return Err(cut_short().into());
            }
            let head: [u8; HEADER] = Stream::new(file, header).take()?;
            if !head.starts_with(b"PK\x03\x04") {
                return Err(bad());
            }
            let lengths = [26, 28].map(|at| u64::from(u16::from_le_bytes([head[at], head[at + 1]])));
            let offset = header.saturating_add(HEADER as u64 + lengths.iter().sum::<u64>());
            if offset.checked_add(stored).is_none_or(|end| end > self.bytes) {
                return Err(cut_short().into());
            }
            if !deflated && stored != bytes {
                return Err(bad());
            }
            return Ok(Some(Member { offset, stored, bytes, crc: four(16), deflated }));
        }
        Ok(None)
    }
}

/// Little-endian numbers of 64 bits, from a place on.
fn eights<const N: usize>(bytes: &[u8], from: usize) -> [u64; N] {
    let rest = bytes.get(from..).unwrap_or_default();
    std::array::from_fn(|k| {
        rest.get(8 * k..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u64::from_le_bytes(*bytes))
    })
}

/// Finds the numbers of an entry that stand elsewhere in its extra part, which begins here.
fn large(stream: &mut Stream<'_>, extra_bytes: u16, numbers: &mut [u64; 3]) -> Result<(), Stop> {
    let mut left = extra_bytes;
    while left >= 4 {
        let [a, b, c, d]: [u8; 4] = stream.take()?;
        let (kind, mut bytes) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        left = left.checked_sub(4).and_then(|left| left.checked_sub(bytes)).ok_or_else(bad_archive)?;
        if kind != EXTRA64 {
            stream.skip(bytes.into());
            continue;
        }
        for number in numbers.iter_mut().filter(|number| **number == ELSEWHERE) {
            bytes = bytes.checked_sub(8).ok_or_else(bad_archive)?;
            *number = u64::from_le_bytes(stream.take()?);
        }
        return Ok(());
    }
    Err(bad_archive().into())
}

impl Member {
    /// The number of bytes that it inflates to.
    ///
    /// # Errors
    /// The archive states far more than the member's own bytes.
    pub(super) fn checked_bytes(&self) -> Result<u64, Stop> {
        let most = MAX_UNASKED.max(self.stored.saturating_mul(MAX_TIMES));
        if self.bytes > most {
            return Err(bad!(
                "contains a part that would unpack from {} to {}, more than any mesh would; it is refused",
                Bytes(self.stored),
                Bytes(self.bytes)
            )
            .into());
        }
        Ok(self.bytes)
    }

    /// Its content as a stream.
    ///
    /// # Errors
    /// Its size is far more than its own bytes, as for [`Member::checked_bytes`].
    pub(super) fn open<'a>(&self, file: &'a PositionalFile) -> Result<Content<'a>, Stop> {
        self.checked_bytes()?;
        Ok(Content {
            file,
            next: self.offset,
            stored: self.stored,
            left: self.bytes,
            crc: self.crc,
            sum: Crc::new(),
            inflate: self.deflated.then(|| Decompress::new(false)),
            input: Vec::new(),
            used: 0,
        })
    }
}

/// The content of a member: no byte more than the archive states, and its checksum is looked at.
pub(super) struct Content<'a> {
    file: &'a PositionalFile,
    next: u64,
    /// Stored bytes that were not read.
    stored: u64,
    /// Bytes that are still to come.
    left: u64,
    crc: u32,
    sum: Crc,
    inflate: Option<Decompress>,
    input: Vec<u8>,
    used: usize,
}

/// The error of content that does not fit its statements.
fn damaged() -> io::Error {
    io::ErrorKind::InvalidData.into()
}

impl Content<'_> {
    fn fill(&mut self) -> io::Result<()> {
        if self.used < self.input.len() || self.stored == 0 {
            return Ok(());
        }
        let most = usize::try_from(self.stored).unwrap_or(INPUT).min(INPUT);
        self.input.resize(most, 0);
        let got = self.file.read_at(&mut self.input, self.next)?;
        if got == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.input.truncate(got);
        self.used = 0;
        self.next += got as u64;
        self.stored -= got as u64;
        Ok(())
    }
}

impl Read for Content<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let room = usize::try_from(self.left).unwrap_or(usize::MAX).min(out.len());
        let Some(out) = out.get_mut(..room).filter(|out| !out.is_empty()) else { return Ok(0) };
        let got = loop {
            self.fill()?;
            let input = self.input.get(self.used..).unwrap_or_default();
            let Some(inflate) = &mut self.inflate else {
                let got = input.len().min(out.len());
                out[..got].copy_from_slice(&input[..got]);
                self.used += got;
                break got;
            };
            let (taken, given) = (inflate.total_in(), inflate.total_out());
            let status = inflate.decompress(input, out, FlushDecompress::None).map_err(|_| damaged())?;
            let taken = usize::try_from(inflate.total_in() - taken).map_err(|_| damaged())?;
            let got = usize::try_from(inflate.total_out() - given).map_err(|_| damaged())?;
            self.used += taken;
            if got > 0 {
                break got;
            }
            // Neither more input nor more output: it is damaged, or cut.
            if status == Status::StreamEnd || (taken == 0 && self.stored == 0) {
                return Err(damaged());
            }
        };
        if got == 0 {
            return Err(damaged());
        }
        self.sum.update(&out[..got]);
        self.left -= got as u64;
        if self.left == 0 && self.sum.sum() != self.crc {
            return Err(damaged());
        }
        Ok(got)
    }
}

/// The fault of a failure to read a member.
pub(super) fn reading(cause: io::Error) -> Stop {
    match cause.kind() {
        io::ErrorKind::InvalidData => bad_archive().into(),
        _ => Stop::reading(cause),
    }
}
