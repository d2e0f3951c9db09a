//! Elements one by one, in bounded memory (PS3.5 section 7): heads, ends, and steps over sequences.

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};
use std::io;

use super::Result;
use super::header::{Encoding, MAX_VALUE_BYTES};
use super::value::Tag;
use super::window::{ReadAt, Window};
use crate::source::dicom::parse::error::ScanError;
use crate::volume::Endian;

/// Deepest nesting of undefined lengths; real files stay under ten.
const MAX_DEPTH: usize = 32;

pub(crate) const ITEM: Tag = 0xfffe_e000;
const ITEM_END: Tag = 0xfffe_e00d;
pub(crate) const SEQUENCE_END: Tag = 0xfffe_e0dd;

/// Encoding of the meta header.
pub(crate) const META: Encoding = Encoding { explicit: true, endian: Endian::Little };

/// Width of the length field that follows a VR in explicit encodings; `None` for no known VR.
pub(crate) fn length_form(vr: &[u8; 2]) -> Option<LengthForm> {
    match vr {
        b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT"
        | b"UV" => Some(LengthForm::Long),
        b"AE" | b"AS" | b"AT" | b"CS" | b"DA" | b"DS" | b"DT" | b"FD" | b"FL" | b"IS" | b"LO" | b"LT"
        | b"PN" | b"SH" | b"SL" | b"SS" | b"ST" | b"TM" | b"UI" | b"UL" | b"US" => Some(LengthForm::Short),
        _ => None,
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum LengthForm {
    /// 16 bits, right after the VR.
    Short,
    /// Two reserved bytes, then 32 bits.
    Long,
}

/// Head of an element.
#[derive(Clone, Copy)]
pub(crate) struct Element {
    pub(crate) tag: Tag,
    pub(crate) vr: [u8; 2],
    /// `None`: undefined, ended by a delimiter.
    pub(crate) length: Option<u32>,
    pub(crate) value_at: u64,
}

impl Element {
    /// Bytes of the value that are looked at.
    fn value_bytes(&self) -> usize {
        self.length.and_then(|n| usize::try_from(n).ok()).unwrap_or(0).min(MAX_VALUE_BYTES)
    }

    /// Encoding of the content of this sequence: inside a UN element implicit little-endian (PS3.5 6.2.2 note 2).
    pub(crate) fn content(&self, outer: Encoding) -> Encoding {
        if &self.vr == b"UN" { Encoding { explicit: false, endian: Endian::Little } } else { outer }
    }
}

/// One level of nesting inside undefined lengths.
#[derive(Clone, Copy)]
enum Level {
    Sequence(Encoding),
    Item(Encoding),
}

/// Reads elements through a window of a few KiB, which is all that it holds.
pub(crate) struct Parser<'a, R: ReadAt + ?Sized> {
    pub(crate) window: Window<'a, R>,
}

/// Reads one item; takes the offset of its first element, its end if known, and its encoding, and returns the offset
/// after its last element.
pub(crate) type ItemReader<'f, 'a, R> =
    dyn FnMut(&mut Parser<'a, R>, u64, Option<u64>, Encoding) -> Result<u64> + 'f;

/// Reads one element at an offset, and returns the offset after it, or `None` to skip it.
pub(crate) type ElementReader<'f, 'a, R> =
    dyn FnMut(&mut Parser<'a, R>, &Element, u64) -> Result<Option<u64>> + 'f;

/// Damage of an element or its content.
pub(crate) fn damaged(offset: u64, damage: impl Into<Cow<'static, str>>) -> ScanError {
    ScanError::Damaged { offset, damage: damage.into() }
}

/// A tag as the standard writes it.
struct TagName(Tag);

impl Display for TagName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "element ({:04X},{:04X})", self.0 >> 16, self.0 & 0xffff)
    }
}

impl<'a, R: ReadAt + ?Sized> Parser<'a, R> {
    pub(crate) fn new(input: &'a R) -> io::Result<Self> {
        Ok(Self { window: Window::new(input)? })
    }

    /// True if the input ends at or before `at`.
    pub(crate) fn is_end(&mut self, at: u64) -> io::Result<bool> {
        Ok(at >= self.window.len() || self.window.upto(at, 1)?.is_empty())
    }

    /// The element head at `at`.
    pub(crate) fn element(&mut self, at: u64, encoding: Encoding) -> Result<Element> {
        let Some(head) = self.window.array::<8>(at)? else {
            return Err(damaged(at, "the file ends inside an element"));
        };
        let big = encoding.endian == Endian::Big;
        let u16_of = |b: [u8; 2]| if big { u16::from_be_bytes(b) } else { u16::from_le_bytes(b) };
        let u32_of = |b: [u8; 4]| if big { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) };
        let [g0, g1, e0, e1, v0, v1, l0, l1] = head;
        let tag = Tag::from(u16_of([g0, g1])) << 16 | Tag::from(u16_of([e0, e1]));
        let defined = |n: u32| (n != u32::MAX).then_some(n);
        let vr = [v0, v1];
        // Items and delimiters have no VR.
        let delimiter = tag >> 16 == 0xfffe;
        let letters = vr.iter().all(u8::is_ascii_uppercase);
        // A VR that is letters but not known has the long form (PS3.5 6.2). One without letters at
        // all is an element written without VR, which some programs slip in.
        let form = length_form(&vr).or(letters.then_some(LengthForm::Long));
        let Some(form) = form.filter(|_| encoding.explicit && !delimiter) else {
            let length = defined(u32_of([v0, v1, l0, l1]));
            return Ok(Element { tag, vr: [0; 2], length, value_at: at + 8 });
        };
        if form == LengthForm::Short {
            let length = Some(u32::from(u16_of([l0, l1])));
            return Ok(Element { tag, vr, length, value_at: at + 8 });
        }
        let Some(long) = self.window.array::<4>(at + 8)? else {
            return Err(damaged(at, format!("the file ends inside the head of {}", TagName(tag))));
        };
        Ok(Element { tag, vr, length: defined(u32_of(long)), value_at: at + 12 })
    }

    /// Offset after a value of defined length, checked against the file.
    pub(crate) fn end(&self, element: &Element, at: u64) -> Result<u64> {
        let left = self.window.left(element.value_at);
        match element.length {
            Some(n) if u64::from(n) <= left => Ok(element.value_at + u64::from(n)),
            Some(declared) => Err(damaged(
                at,
                format!("{} declares {declared} bytes, but {left} are left", TagName(element.tag)),
            )),
            None => Err(damaged(at, format!("{} has no length where it needs one", TagName(element.tag)))),
        }
    }

    /// The value, cut at [`MAX_VALUE_BYTES`]; empty for an undefined length.
    pub(crate) fn value(&mut self, element: &Element) -> io::Result<&[u8]> {
        self.window.upto(element.value_at, element.value_bytes())
    }

    /// Offset after an element of any length.
    pub(crate) fn skip(&mut self, element: &Element, at: u64, encoding: Encoding) -> Result<u64> {
        match element.length {
            Some(_) => self.end(element, at),
            None => self.undefined(element, encoding),
        }
    }

    /// Visits the items of a sequence, one after another, and returns the offset after it.
    pub(crate) fn items(
        &mut self,
        sequence: &Element,
        at: u64,
        outer: Encoding,
        item: &mut ItemReader<'_, 'a, R>,
    ) -> Result<u64> {
        let encoding = sequence.content(outer);
        let end = if sequence.length.is_some() { Some(self.end(sequence, at)?) } else { None };
        let mut at = sequence.value_at;
        loop {
            if let Some(end) = end
                && at >= end
            {
                return Ok(end);
            }
            let inner = self.element(at, encoding)?;
            match inner.tag {
                ITEM => {
                    let known = if inner.length.is_some() { Some(self.end(&inner, at)?) } else { None };
                    let after = item(self, inner.value_at, known, encoding)?;
                    at = known.unwrap_or(after);
                }
                // A delimiter also ends a sequence that gave its length, which some programs write.
                SEQUENCE_END => return Ok(end.unwrap_or(inner.value_at)),
                tag => return Err(damaged(at, format!("{} stands where an item must", TagName(tag)))),
            }
        }
    }

    /// Visits the elements of an item that begins at `at`, and returns the offset after the item.
    pub(crate) fn elements(
        &mut self,
        mut at: u64,
        end: Option<u64>,
        encoding: Encoding,
        element: &mut ElementReader<'_, 'a, R>,
    ) -> Result<u64> {
        loop {
            if let Some(end) = end
                && at >= end
            {
                return Ok(end);
            }
            let inner = self.element(at, encoding)?;
            match inner.tag {
                ITEM_END => return Ok(end.unwrap_or(inner.value_at)),
                // An item that lacks its own end: the sequence sees its delimiter again.
                SEQUENCE_END => return Ok(end.unwrap_or(at)),
                _ => {}
            }
            at = match element(self, &inner, at)? {
                Some(after) => after,
                None => self.skip(&inner, at, encoding)?,
            };
        }
    }

    /// Steps over the content of an element of undefined length; returns the offset after it.
    fn undefined(&mut self, element: &Element, encoding: Encoding) -> Result<u64> {
        let inside = |inner: &Element, outer: Encoding| Level::Sequence(inner.content(outer));
        let mut stack = [inside(element, encoding); MAX_DEPTH];
        let mut depth = 1_usize;
        let mut at = element.value_at;
        while let Some(level) = depth.checked_sub(1).and_then(|top| stack.get(top)).copied() {
            let (Level::Sequence(encoding) | Level::Item(encoding)) = level;
            let inner = self.element(at, encoding)?;
            let next = match (level, inner.tag, inner.length) {
                (Level::Sequence(_), SEQUENCE_END, _) | (Level::Item(_), ITEM_END, _) => {
                    depth -= 1;
                    None
                }
                // An item that lacks its own end.
                (Level::Item(_), SEQUENCE_END, _) => {
                    depth -= 2;
                    None
                }
                (Level::Sequence(_), ITEM, Some(_)) | (Level::Item(_), _, Some(_)) => {
                    at = self.end(&inner, at)?;
                    continue;
                }
                (Level::Sequence(encoding), ITEM, None) => Some(Level::Item(encoding)),
                (Level::Item(encoding), _, None) => Some(inside(&inner, encoding)),
                (Level::Sequence(_), tag, _) => {
                    return Err(damaged(at, format!("{} stands where an item must", TagName(tag))));
                }
            };
            at = inner.value_at;
            if let Some(next) = next {
                let Some(slot) = stack.get_mut(depth) else {
                    return Err(damaged(at, format!("sequences are nested more than {MAX_DEPTH} deep")));
                };
                *slot = next;
                depth += 1;
            }
        }
        Ok(at)
    }
}
