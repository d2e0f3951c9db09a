//! Frames in fragments (PS3.5 A.4). The fragments of each frame are found again at each pass instead of being listed,
//! so that memory does not grow with the number of frames.
//!
//! Evidence in the order of trust: as many fragments as frames; as many codestreams begun as frames stated; an offset
//! table whose every entry is the offset of a fragment. Wrong tables are common, and are not looked at where the
//! fragments alone decide.

use std::cell::Cell;
use std::io::{self, Read};

use crate::codec::FrameBytes;
use crate::source::dicom::parse::Result;
use crate::source::dicom::parse::element::{ITEM, Parser, damaged};
use crate::source::dicom::parse::header::{DicomHeader, PixelData};
use crate::source::dicom::parse::syntax::Codec;
use crate::source::dicom::parse::value::Tag;
use crate::source::dicom::parse::window::ReadAt;

/// Most fragments of a frame whose parts are read in parallel (RLE); correct files have one.
const MAX_LISTED: usize = 4096;

/// Head of an item.
const HEAD: u64 = 8;

/// One fragment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fragment {
    /// Offset of its bytes in the file.
    offset: u64,
    /// Length in bytes, as far as the file goes.
    length: u64,
    /// Length that its item states.
    declared: u64,
    first_bytes: [u8; 4],
}

impl Fragment {
    /// Offset of its item.
    fn item(&self) -> u64 {
        self.offset - HEAD
    }

    fn after(&self) -> u64 {
        self.offset + self.length
    }
}

/// Bytes of a file that are read together where fragments are short: two million fragments in a file of 16 MB have as
/// many heads, which take fewer calls of the system so.
const WINDOW: usize = 2048;

/// Bytes of an item's head and the first bytes of its value.
const SHOWN: usize = 12;

/// The heads of items, read one after the other.
struct Heads {
    /// Offset of the window in the file, and its filled bytes.
    from: u64,
    have: usize,
    window: [u8; WINDOW],
    /// True if the last fragment was so short that the next head lies in the window.
    short: bool,
}

impl Heads {
    fn new() -> Self {
        Self { from: 0, have: 0, window: [0; WINDOW], short: false }
    }

    /// The first bytes at `at`, and their number.
    fn head<R: ReadAt + ?Sized>(&mut self, input: &R, at: u64) -> io::Result<([u8; SHOWN], usize)> {
        let mut head = [0; SHOWN];
        let start = at.checked_sub(self.from).and_then(|start| usize::try_from(start).ok());
        let known = start.and_then(|start| self.window.get(..self.have)?.get(start..start + SHOWN));
        if let Some(known) = known {
            head.copy_from_slice(known);
            return Ok((head, SHOWN));
        }
        if !self.short {
            let have = read_full(input, &mut head, at)?;
            return Ok((head, have));
        }
        (self.from, self.have) = (at, read_full(input, &mut self.window, at)?);
        let have = self.have.min(SHOWN);
        if let (Some(to), Some(from)) = (head.get_mut(..have), self.window.get(..have)) {
            to.copy_from_slice(from);
        }
        Ok((head, have))
    }
}

/// The item at `at`, if there is one before `end`; anything else ends the fragments, so that a missing
/// delimiter does no harm.
fn fragment<R: ReadAt + ?Sized>(
    heads: &mut Heads,
    input: &R,
    at: u64,
    end: u64,
) -> io::Result<Option<Fragment>> {
    let (head, have) = heads.head(input, at)?;
    let [g0, g1, e0, e1, l0, l1, l2, l3, first_bytes @ ..] = head;
    let tag = Tag::from(u16::from_le_bytes([g0, g1])) << 16 | Tag::from(u16::from_le_bytes([e0, e1]));
    let length = u32::from_le_bytes([l0, l1, l2, l3]);
    if at >= end || have < 8 || tag != ITEM || length == u32::MAX {
        return Ok(None);
    }
    let offset = at + HEAD;
    let declared = u64::from(length);
    let length = declared.min(end.saturating_sub(offset));
    heads.short = length < WINDOW as u64 / 2;
    Ok(Some(Fragment { offset, length, declared, first_bytes }))
}

/// Most items that [`missing_end`] looks at; longer elements are left to the decoder.
const MAX_WALKED: u64 = 1 << 20;

/// A pixel element of undefined length that the file ends, or goes on, without a delimiter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MissingEnd {
    /// Number of existing fragments.
    pub(crate) fragments: u64,
    /// Bytes that the last of them lacks.
    pub(crate) lacking: u64,
}

/// The missing end, if no Sequence Delimitation Item follows the fragments. It closes most files, so that the last
/// bytes tell; else the heads of the items are walked.
pub(crate) fn missing_end<R: ReadAt + ?Sized>(
    input: &R,
    pixels: &PixelData,
    codec: Codec,
) -> io::Result<Option<MissingEnd>> {
    const DELIMITER: [u8; 8] = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
    let end = pixels.offset.saturating_add(pixels.available);
    let ends_at = |at: u64| -> io::Result<bool> {
        let mut head = [0; DELIMITER.len()];
        // The length after the tag is 0, but nothing depends on it.
        Ok(read_full(input, &mut head, at)? >= 4 && head.starts_with(&DELIMITER[..4]))
    };
    let last = end.saturating_sub(HEAD).max(pixels.offset);
    if pixels.declared.is_some() || ends_at(last)? {
        return Ok(None);
    }
    let (mut at, mut items, mut lacking, mut table) = (pixels.offset, 0, 0, 0);
    let mut heads = Heads::new();
    while let Some(next) = fragment(&mut heads, input, at, end)? {
        if items == 0 {
            table = u64::from(!has_no_table(codec, &next));
        }
        items += 1;
        if items == MAX_WALKED {
            return Ok(None);
        }
        lacking = next.declared - next.length;
        at = next.after();
    }
    let fragments = items - table.min(items);
    Ok((!ends_at(at)?).then_some(MissingEnd { fragments, lacking }))
}

/// The first item is the offset table, which may be empty; a few programs leave it out.
fn has_no_table(codec: Codec, first: &Fragment) -> bool {
    codec.begins(first.first_bytes) && first.length > 4
}

/// Fills `buf` as far as the input goes.
pub(crate) fn read_full<R: ReadAt + ?Sized>(input: &R, buf: &mut [u8], offset: u64) -> io::Result<usize> {
    let mut have = 0;
    while have < buf.len() {
        match input.read_some_at(buf.get_mut(have..).unwrap_or(&mut []), offset.saturating_add(have as u64)) {
            Ok(0) => break,
            Ok(n) => have += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(have)
}

/// Division of fragments into frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Division {
    /// All fragments make the one frame.
    Whole,
    /// Each fragment is a frame.
    Each,
    /// A frame begins where a codestream begins.
    Marked(Codec),
    /// A table holds the offsets of frames from the first fragment.
    Table {
        /// Offset of its first entry in the file.
        at: u64,
        /// True for entries of 64 bits, false for 32.
        wide: bool,
    },
}

/// The frames of a pixel element.
pub(crate) struct Frames<'a, R: ReadAt + ?Sized> {
    input: &'a R,
    division: Division,
    frames: u32,
    /// Offset of the first fragment's item.
    first: u64,
    end: u64,
    /// Number of the next frame, and the item where it begins.
    next: u32,
    at: u64,
    heads: Heads,
}

/// The bytes of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    /// Offset of the first fragment's bytes, and their number.
    start: u64,
    head: u64,
    /// Bytes of all fragments.
    pub(crate) bytes: u64,
    fragments: u64,
    end: u64,
}

impl<'a, R: ReadAt + ?Sized> Frames<'a, R> {
    /// Divides the fragments of a pixel element into `frames` frames; one pass over their heads.
    ///
    /// # Errors
    /// The fragments cannot be divided into so many frames.
    pub(crate) fn of(
        input: &'a R,
        header: &DicomHeader,
        pixels: &PixelData,
        codec: Codec,
        frames: u32,
    ) -> Result<Self> {
        let start = pixels.offset;
        let end = start.saturating_add(pixels.available);
        let (division, heads) = (Division::Whole, Heads::new());
        let mut all = Self { input, division, frames, first: start, end, next: 0, at: start, heads };
        let Some(table) = fragment(&mut all.heads, input, start, end)? else {
            return Err(damaged(start, "the compressed pixels are not in items"));
        };
        let has_table = !has_no_table(codec, &table);
        if has_table {
            all.first = table.after();
        }
        all.at = all.first;
        if frames == 1 {
            return Ok(all);
        }
        let (mut fragments, mut begun, mut first_begins) = (0_u64, 0_u64, false);
        let mut at = all.first;
        while let Some(next) = fragment(&mut all.heads, input, at, end)? {
            let begins = codec.begins(next.first_bytes);
            first_begins |= begins && fragments == 0;
            fragments += 1;
            begun += u64::from(begins);
            at = next.after();
        }
        let wanted = u64::from(frames);
        all.division = if fragments == wanted {
            Division::Each
        } else if begun == wanted && first_begins {
            Division::Marked(codec)
        } else if has_table && all.table_fits(table.offset, table.length, false)? {
            Division::Table { at: table.offset, wide: false }
        } else if let Some(at) = all.extended_table(header)? {
            Division::Table { at, wide: true }
        } else {
            return Err(damaged(
                start,
                format!(
                    "the compressed pixels are {fragments} fragments with {begun} beginnings, which cannot be told apart into the {frames} frames stated"
                ),
            ));
        };
        Ok(all)
    }

    /// Offset of the Extended Offset Table's entries, if the file has one that fits.
    fn extended_table(&mut self, header: &DicomHeader) -> Result<Option<u64>> {
        let Some(at) = header.offsets.offset_table else { return Ok(None) };
        let element = Parser::new(self.input)?.element(at, header.encoding)?;
        let length = element.length.unwrap_or(0).into();
        Ok(self.table_fits(element.value_at, length, true)?.then_some(element.value_at))
    }

    /// True if the entries of the table are offsets of fragments, in increasing order.
    fn table_fits(&mut self, table: u64, length: u64, wide: bool) -> io::Result<bool> {
        let entry_bytes = if wide { 8 } else { 4 };
        if length != u64::from(self.frames) * entry_bytes {
            return Ok(false);
        }
        let mut at = self.first;
        for frame in 0..self.frames {
            let Some(wanted) = self.entry(table, wide, frame)? else { return Ok(false) };
            if frame == 0 && wanted != self.first {
                return Ok(false);
            }
            // A repeated entry would be a frame of no bytes.
            loop {
                let found = fragment(&mut self.heads, self.input, at, self.end)?;
                let Some(next) = found else { return Ok(false) };
                if next.item() > wanted {
                    return Ok(false);
                }
                at = next.after();
                if next.item() == wanted {
                    break;
                }
            }
        }
        Ok(true)
    }

    /// Offset in the file that the table gives for a frame.
    fn entry(&self, table: u64, wide: bool, frame: u32) -> io::Result<Option<u64>> {
        let mut bytes = [0; 8];
        let width = if wide { 8 } else { 4 };
        let at = table.saturating_add(u64::from(frame) * width as u64);
        let have = read_full(self.input, bytes.get_mut(..width).unwrap_or(&mut []), at)?;
        Ok((have == width).then(|| self.first.saturating_add(u64::from_le_bytes(bytes))))
    }

    /// The next frame's bytes; `None` after the last.
    pub(crate) fn next(&mut self) -> Result<Option<Span>> {
        if self.next == self.frames {
            return Ok(None);
        }
        let limit = match self.division {
            Division::Table { at, wide } if self.next + 1 < self.frames => {
                self.entry(at, wide, self.next + 1)?.unwrap_or(self.end)
            }
            _ => self.end,
        };
        let mut span: Option<Span> = None;
        while let Some(next) = fragment(&mut self.heads, self.input, self.at, self.end)? {
            let over = match (self.division, span) {
                (_, None) | (Division::Whole, _) => false,
                (Division::Each, Some(_)) => true,
                (Division::Marked(codec), Some(_)) => codec.begins(next.first_bytes),
                (Division::Table { .. }, Some(_)) => next.item() >= limit,
            };
            if over {
                break;
            }
            let span = span.get_or_insert(Span {
                start: next.offset,
                head: next.length,
                bytes: 0,
                fragments: 0,
                end: self.end,
            });
            span.bytes += next.length;
            span.fragments += 1;
            self.at = next.after();
        }
        let frame = self.next;
        self.next += 1;
        match span {
            Some(span) => Ok(Some(span)),
            None => Err(damaged(
                self.at,
                format!("the compressed pixels end before frame {}", u64::from(frame) + 1),
            )),
        }
    }
}

/// Reads a frame from front to back, over the gaps between its fragments.
pub(crate) struct FrameReader<'a, R: ReadAt + ?Sized> {
    input: &'a R,
    at: u64,
    left_here: u64,
    left: u64,
    end: u64,
    heads: Heads,
}

impl<'a, R: ReadAt + ?Sized> FrameReader<'a, R> {
    pub(crate) fn new(input: &'a R, span: &Span) -> Self {
        let heads = Heads::new();
        Self { input, at: span.start, left_here: span.head, left: span.bytes, end: span.end, heads }
    }
}

impl<R: ReadAt + ?Sized> Read for FrameReader<'_, R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        while self.left > 0 && !buf.is_empty() {
            if self.left_here == 0 {
                let found = fragment(&mut self.heads, self.input, self.at, self.end)?;
                let Some(next) = found else { return Ok(0) };
                (self.at, self.left_here) = (next.offset, next.length);
                continue;
            }
            let most = usize::try_from(self.left_here.min(self.left)).unwrap_or(usize::MAX).min(buf.len());
            let n = self.input.read_some_at(buf.get_mut(..most).unwrap_or(&mut []), self.at)?;
            self.at += n as u64;
            self.left_here = self.left_here.saturating_sub(n as u64);
            self.left = self.left.saturating_sub(n as u64);
            return Ok(n);
        }
        Ok(0)
    }
}

/// A frame that is read at any place; its fragments are listed, 16 bytes each.
pub(crate) struct ListedFrame<'a, R: ReadAt + ?Sized> {
    input: &'a R,
    /// Offset of each fragment in the frame, and in the file.
    list: Vec<(u64, u64)>,
    bytes: u64,
    /// The fragment read last.
    last: Cell<usize>,
}

impl<'a, R: ReadAt + ?Sized> ListedFrame<'a, R> {
    /// # Errors
    /// The frame has more fragments than [`MAX_LISTED`].
    pub(crate) fn new(input: &'a R, span: &Span) -> Result<Self> {
        let count = usize::try_from(span.fragments).ok().filter(|n| *n <= MAX_LISTED).ok_or_else(|| {
            damaged(span.start, format!("one frame is cut into more than {MAX_LISTED} fragments"))
        })?;
        let mut list = Vec::with_capacity(count);
        let (mut at, mut begun, mut heads) = (span.start - HEAD, 0, Heads::new());
        while list.len() < count
            && let Some(next) = fragment(&mut heads, input, at, span.end)?
        {
            list.push((begun, next.offset));
            begun += next.length;
            at = next.after();
        }
        Ok(Self { input, list, bytes: span.bytes, last: Cell::new(0) })
    }
}

impl<R: ReadAt + ?Sized> FrameBytes for ListedFrame<'_, R> {
    fn len(&self) -> u64 {
        self.bytes
    }

    fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
        if offset >= self.bytes {
            return Ok(0);
        }
        let holds = |i: usize| {
            let begin = self.list.get(i)?.0;
            let end = self.list.get(i + 1).map_or(self.bytes, |next| next.0);
            (begin..end).contains(&offset).then_some((end, begin))
        };
        let found = Some(self.last.get()).filter(|i| holds(*i).is_some());
        // The last fragment that begins at or before the offset; empty fragments are passed over.
        let index =
            found.unwrap_or_else(|| self.list.partition_point(|(begin, _)| *begin <= offset).max(1) - 1);
        self.last.set(index);
        let (Some((end, begin)), Some((_, place))) = (holds(index), self.list.get(index)) else {
            return Ok(0);
        };
        let most = usize::try_from(end - offset).unwrap_or(usize::MAX).min(buffer.len());
        self.input.read_some_at(buffer.get_mut(..most).unwrap_or(&mut []), place + (offset - begin))
    }
}

impl<R: ReadAt + ?Sized> ReadAt for ListedFrame<'_, R> {
    fn byte_len(&self) -> io::Result<u64> {
        Ok(self.bytes)
    }

    fn read_some_at(&self, buf: &mut [u8], offset: u64) -> io::Result<usize> {
        self.read_at(buf, offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::dicom::parse::header::PixelElement;

    fn item(bytes: &[u8]) -> Vec<u8> {
        let length = u32::try_from(bytes.len()).unwrap();
        [&[0xfe, 0xff, 0x00, 0xe0], &length.to_le_bytes()[..], bytes].concat()
    }

    fn missing(file: &[u8]) -> Option<MissingEnd> {
        let pixels = PixelData {
            element: PixelElement::Integer,
            offset: 0,
            declared: None,
            available: file.len() as u64,
            words: false,
        };
        missing_end(file, &pixels, Codec::Jpeg2000).unwrap()
    }

    #[test]
    fn a_missing_end_is_told_from_one_that_something_follows() {
        let table = item(&[]);
        let stream = item(&[0xff, 0x4f, 0xff, 0x51, 0, 1]);
        let end = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
        let whole = [table, stream.clone(), stream.clone(), end.to_vec()].concat();
        assert_eq!(missing(&whole), None);
        assert_eq!(missing(&[&whole[..], b"\xfc\xff\xfc\xffOB\0\0\x04\0\0\0tail"].concat()), None);
        let two = MissingEnd { fragments: 2, lacking: 0 };
        assert_eq!(missing(&whole[..whole.len() - 8]), Some(two));
        // Half a delimiter does not count; a whole tag does.
        assert_eq!(missing(&whole[..whole.len() - 5]), Some(two));
        assert_eq!(missing(&whole[..whole.len() - 2]), None);
        assert_eq!(missing(&whole[..whole.len() - 11]), Some(MissingEnd { fragments: 2, lacking: 3 }));
        assert_eq!(missing(&whole[..whole.len() - 18]), Some(MissingEnd { fragments: 1, ..two }));
        // Without a table, every item is a fragment.
        assert_eq!(missing(&[stream.clone(), stream].concat()), Some(two));
        assert_eq!(missing(&[]), Some(MissingEnd { fragments: 0, lacking: 0 }));
    }
}
