//! Reads parts: opens them, and checks every byte before it is used.

use std::io;
use std::path::{Path, PathBuf};

use super::cut::PartId;
use super::fault::PartFault;
use super::head::{Head, START_BYTES, TAIL_BYTES, Tail, head_bytes};
use super::record::{ENTRY_BYTES, Entry, RecordForm};
use crate::builder::error::{BuildError, BuildFault};
use crate::platform::PositionalFile;
use crate::progress::Progress;

/// Bytes of a record read at a time.
pub(super) const STEP: usize = 256 << 10;

/// An open part of a plan.
pub(crate) struct PartFile {
    pub(super) head: Head,
    pub(super) file: PositionalFile,
    pub(super) cursor: Cursor,
    path: PathBuf,
}

impl PartFile {
    /// Opens a part by its name in the folder of its job; `None` if it does not exist.
    ///
    /// # Errors
    /// It cannot be read, or is not this part.
    pub(crate) fn open(part: &PartId, folder: &Path) -> Result<Option<Self>, BuildError> {
        let path = part.path(folder);
        match PositionalFile::open(&path) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(cause) => Err(at(&path, PartFault::Unreadable(cause))),
            Ok(file) => match frame(&file, part.number) {
                Err(fault) => Err(at(&path, fault)),
                Ok((head, cursor)) => match of_plan(&head, part) {
                    None => Ok(Some(Self { head, file, cursor, path })),
                    Some(fault) => Err(at(&path, fault)),
                },
            },
        }
    }

    /// Reads the whole part.
    ///
    /// # Errors
    /// It is damaged, or cannot be read.
    pub(crate) fn check(mut self, progress: &dyn Progress) -> Result<(), BuildError> {
        let form = RecordForm::new(&self.head.channels, depth(self.head.dims));
        let mut buffer = vec![0; STEP];
        let failed = |fault| at(&self.path, fault);
        self.cursor.advance(&self.file, &form).map_err(failed)?;
        while let Some(entry) = self.cursor.next {
            progress.check()?;
            let bytes = form.bytes(&entry.counts);
            let mut crc = 0;
            for_each_step(&self.file, entry.offset, bytes, &mut buffer, &mut |step| {
                crc = crc32c::crc32c_append(crc, step);
                Ok::<(), PartFault>(())
            })
            .map_err(failed)?;
            if crc != entry.crc {
                return Err(failed(PartFault::Damaged { number: self.head.number }));
            }
            self.cursor.advance(&self.file, &form).map_err(failed)?;
        }
        Ok(())
    }
}

/// Levels of a grid; 0 if its sides are invalid.
pub(super) fn depth([x, y, z]: [u32; 3]) -> u32 {
    crate::geom::Dims::new(x, y, z).map_or(0, crate::geom::Dims::depth)
}

pub(super) fn at(path: &Path, fault: PartFault) -> BuildError {
    BuildFault::Part { path: path.to_path_buf(), fault }.into()
}

/// Returns the fault of a part that is not the one its name states.
fn of_plan(head: &Head, part: &PartId) -> Option<PartFault> {
    let number = part.number;
    if head.digest != part.digest || head.parts != part.cuts.parts || head.dims != part.cuts.dims.to_array() {
        Some(PartFault::Foreign { number })
    } else if head.number != number {
        Some(PartFault::Doubled { number, holds: head.number })
    } else {
        None
    }
}

fn frame(file: &PositionalFile, number: u32) -> Result<(Head, Cursor), PartFault> {
    let read = |bytes: &mut [u8], offset| read_at(file, bytes, offset, number);
    let length = file.metadata().map_err(PartFault::Unreadable)?.len();
    let damaged = || PartFault::Damaged { number };
    let mut start = [0; START_BYTES];
    read(&mut start, 0)?;
    let bytes = head_bytes(&start).filter(|bytes| *bytes as u64 <= length).ok_or_else(damaged)?;
    let mut head = vec![0; bytes];
    read(&mut head, 0)?;
    let head = Head::parse(&head).ok_or_else(damaged)?;
    let mut tail = [0; TAIL_BYTES];
    let tail_at = length.checked_sub(TAIL_BYTES as u64).ok_or_else(damaged)?;
    read(&mut tail, tail_at)?;
    let tail = Tail::parse(&tail).ok_or_else(damaged)?;
    let footer = tail.groups.checked_mul(ENTRY_BYTES as u64);
    let end = footer.and_then(|bytes| bytes.checked_add(tail.footer));
    if end != Some(tail_at) || tail.footer < bytes as u64 {
        return Err(damaged());
    }
    let records = bytes as u64;
    Ok((head, Cursor { number, tail, records, read: 0, end: records, crc: 0, next: None }))
}

/// Reads exactly this many bytes; a file that ends earlier is damaged.
fn read_at(file: &PositionalFile, bytes: &mut [u8], offset: u64, number: u32) -> Result<(), PartFault> {
    file.read_exact_at(bytes, offset).map_err(|cause| match cause.kind() {
        io::ErrorKind::UnexpectedEof => PartFault::Damaged { number },
        _ => PartFault::Unreadable(cause),
    })
}

/// Calls `each` with the bytes of a record, step by step.
pub(super) fn for_each_step<E: From<PartFault>>(
    file: &PositionalFile,
    offset: u64,
    bytes: u64,
    buffer: &mut [u8],
    each: &mut dyn FnMut(&[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let mut done = 0;
    while done < bytes {
        let now = usize::try_from(bytes - done).unwrap_or(usize::MAX).min(buffer.len());
        let step = &mut buffer[..now];
        file.read_exact_at(step, offset + done).map_err(PartFault::Unreadable)?;
        each(step)?;
        done += now as u64;
    }
    Ok(())
}

/// The entries of a part's footer, one after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cursor {
    number: u32,
    tail: Tail,
    /// Offset of the first record.
    records: u64,
    /// Entries read, the end of their records, and the CRC of the entries.
    read: u64,
    end: u64,
    crc: u32,
    /// The entry read last; `None` at the end.
    pub(super) next: Option<Entry>,
}

impl Cursor {
    pub(super) fn groups(&self) -> u64 {
        self.tail.groups
    }

    /// The cursor before its first entry.
    pub(super) fn rewound(self) -> Self {
        Self { read: 0, end: self.records, crc: 0, next: None, ..self }
    }

    /// Reads the next entry; at the end the footer is checked.
    ///
    /// # Errors
    /// The footer is damaged or cannot be read.
    pub(super) fn advance(&mut self, file: &PositionalFile, form: &RecordForm) -> Result<(), PartFault> {
        let damaged = PartFault::Damaged { number: self.number };
        if self.read == self.tail.groups {
            self.next = None;
            let is_whole = self.crc == self.tail.crc && self.end == self.tail.footer;
            return if is_whole { Ok(()) } else { Err(damaged) };
        }
        let mut bytes = [0; ENTRY_BYTES];
        read_at(file, &mut bytes, self.tail.footer + self.read * ENTRY_BYTES as u64, self.number)?;
        let entry = Entry::parse(&bytes);
        let rises = self.next.is_none_or(|last| last.code < entry.code);
        if !rises || !entry.is_sound() || entry.offset != self.end {
            return Err(damaged);
        }
        self.crc = crc32c::crc32c_append(self.crc, &bytes);
        self.read += 1;
        self.end += form.bytes(&entry.counts);
        self.next = Some(entry);
        if self.end > self.tail.footer { Err(damaged) } else { Ok(()) }
    }
}
