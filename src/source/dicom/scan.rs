//! Walks the elements of one file in bounded memory (PS3.5 section 7, PS3.10 section 7).
//!
//! One window of a few KiB is all that is held. A declared length is compared with the bytes that are
//! left before it is used, long values are stepped over, nested sequences are walked with a fixed
//! stack. Sequences carry nothing that a classic image needs, so only their ends are looked for.

use std::io;

use thiserror::Error;

use super::header::{DicomHeader, MAX_VALUE_BYTES, PixelData, PixelElement, Tag, text};
use super::syntax::TransferSyntax;
use super::window::{ReadAt, Window};
use crate::source::Endian;

/// Deepest nesting of undefined lengths; real files stay under ten.
const MAX_DEPTH: usize = 32;

const ITEM: Tag = 0xfffe_e000;
const ITEM_END: Tag = 0xfffe_e00d;
const SEQUENCE_END: Tag = 0xfffe_e0dd;

/// Media Storage SOP Class UID and Transfer Syntax UID in the meta header.
const META_SOP_CLASS: Tag = 0x0002_0002;
const META_SYNTAX: Tag = 0x0002_0010;

/// Longest value accepted as the first one of a file without preamble and VRs.
const MAX_PLAUSIBLE_FIRST: u32 = 1024;

/// Why a file yields no header.
#[derive(Debug, Error)]
pub enum ScanError {
    /// The system refused.
    #[error("cannot be read ({0})")]
    Io(#[from] io::Error),
    /// It does not look like DICOM at all.
    #[error("is not a DICOM file")]
    NotDicom,
    /// It begins as DICOM, but cannot be followed.
    #[error("is a damaged DICOM file: {reason} (at byte {offset})")]
    Damaged {
        /// Offset of the element that is wrong.
        offset: u64,
        /// What is wrong there.
        reason: String,
    },
}

/// Reads what matters of a DICOM file's header, in time linear in the number of elements before the
/// pixels and in a few KiB of memory, whatever the bytes are.
///
/// Files without preamble, and without meta header, are recognised when they begin plausibly and turn
/// out to describe an object. Elements after the pixels are not looked at.
///
/// # Errors
/// See [`ScanError`]. A pixel element longer than the file is no error here: the header says how much
/// of it is there.
pub fn scan<R: ReadAt + ?Sized>(input: &R) -> Result<DicomHeader, ScanError> {
    let mut window = Window::new(input)?;
    let has_preamble = window.array::<4>(128)? == Some(*b"DICM");
    let start = if has_preamble { 132 } else { 0 };
    if !has_preamble && !begins_plausibly(&mut window)? {
        return Err(ScanError::NotDicom);
    }
    let mut scanner = Scanner { window, header: DicomHeader::new(TransferSyntax::ImplicitLe) };
    let walked = scanner.file(start);
    let header = scanner.header;
    // Without the preamble's word for it, only an object that says what it is counts as DICOM.
    let says_what = header.sop_class.starts_with("1.") || (header.rows.is_some() && header.columns.is_some());
    match walked {
        Err(ScanError::Io(e)) => Err(ScanError::Io(e)),
        _ if !has_preamble && !says_what => Err(ScanError::NotDicom),
        Err(e) => Err(e),
        Ok(()) => Ok(header),
    }
}

/// Could a dataset or a meta header begin at byte 0?
fn begins_plausibly<R: ReadAt + ?Sized>(window: &mut Window<'_, R>) -> io::Result<bool> {
    let Some(head) = window.array::<8>(0)? else { return Ok(false) };
    let [g0, g1, e0, e1, v0, v1, l0, l1] = head;
    let explicit = length_form(&[v0, v1]).is_some();
    Ok(match ([g0, g1], [e0, e1]) {
        ([2 | 8, 0], [_, 0 | 1]) => {
            let length = u32::from_le_bytes([v0, v1, l0, l1]);
            explicit || (length <= MAX_PLAUSIBLE_FIRST && u64::from(length) <= window.left(8))
        }
        ([0, 8], [0 | 1, _]) => explicit,
        _ => false,
    })
}

/// Width of the length field that follows a VR in explicit encodings; `None` for no known VR.
fn length_form(vr: &[u8; 2]) -> Option<LengthForm> {
    match vr {
        b"OB" | b"OD" | b"OF" | b"OL" | b"OV" | b"OW" | b"SQ" | b"SV" | b"UC" | b"UN" | b"UR" | b"UT"
        | b"UV" => Some(LengthForm::Long),
        b"AE" | b"AS" | b"AT" | b"CS" | b"DA" | b"DS" | b"DT" | b"FD" | b"FL" | b"IS" | b"LO" | b"LT"
        | b"PN" | b"SH" | b"SL" | b"SS" | b"ST" | b"TM" | b"UI" | b"UL" | b"US" => Some(LengthForm::Short),
        _ => None,
    }
}

#[derive(Clone, Copy, PartialEq)]
enum LengthForm {
    /// 16 bits, right after the VR.
    Short,
    /// Two reserved bytes, then 32 bits.
    Long,
}

/// How elements are written at some place of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Encoding {
    explicit: bool,
    endian: Endian,
}

const META: Encoding = Encoding { explicit: true, endian: Endian::Little };

#[derive(Clone, Copy)]
struct Element {
    tag: Tag,
    vr: [u8; 2],
    /// `None`: undefined, ended by a delimiter.
    length: Option<u32>,
    value_at: u64,
}

/// What encloses the walk inside undefined lengths.
#[derive(Clone, Copy)]
enum Level {
    Sequence(Encoding),
    Item(Encoding),
}

struct Scanner<'a, R: ReadAt + ?Sized> {
    window: Window<'a, R>,
    header: DicomHeader,
}

fn damaged(offset: u64, reason: impl Into<String>) -> ScanError {
    ScanError::Damaged { offset, reason: reason.into() }
}

fn name(tag: Tag) -> String {
    format!("element ({:04X},{:04X})", tag >> 16, tag & 0xffff)
}

impl<R: ReadAt + ?Sized> Scanner<'_, R> {
    fn file(&mut self, start: u64) -> Result<(), ScanError> {
        let (at, syntax) = self.meta(start)?;
        let encoding = self.detect(at, syntax.as_ref())?;
        self.header.transfer_syntax = syntax.unwrap_or(match encoding {
            Encoding { endian: Endian::Big, .. } => TransferSyntax::ExplicitBe,
            Encoding { explicit: true, .. } => TransferSyntax::ExplicitLe,
            Encoding { .. } => TransferSyntax::ImplicitLe,
        });
        if self.header.transfer_syntax == TransferSyntax::Deflated {
            return Ok(());
        }
        self.dataset(at, encoding)
    }

    /// Group 0002, always explicit little-endian; returns where the dataset begins. The group's own
    /// length is not trusted: the group ends where another begins.
    fn meta(&mut self, mut at: u64) -> Result<(u64, Option<TransferSyntax>), ScanError> {
        let mut syntax = None;
        while self.window.array::<2>(at)? == Some([2, 0]) {
            let element = self.element(at, META)?;
            let end = self.end(&element, at)?;
            if matches!(element.tag, META_SYNTAX | META_SOP_CLASS) {
                let value = text(self.value(&element)?);
                if element.tag == META_SOP_CLASS {
                    self.header.sop_class = value;
                } else if !value.is_empty() {
                    syntax = Some(TransferSyntax::from_uid(&value));
                }
            }
            at = end;
        }
        Ok((at, syntax))
    }

    /// How the dataset at `at` is written: as declared, unless its first element says otherwise
    /// (files that lie about implicit and explicit are common, and the VR letters give them away).
    fn detect(&mut self, at: u64, declared: Option<&TransferSyntax>) -> io::Result<Encoding> {
        let Some([g0, g1, _, _, v0, v1]) = self.window.array::<6>(at)? else { return Ok(META) };
        let looks_big = u16::from_be_bytes([g0, g1]) < u16::from_le_bytes([g0, g1]);
        let big = looks_big && matches!(declared, None | Some(TransferSyntax::ExplicitBe));
        let endian = if big { Endian::Big } else { Endian::Little };
        Ok(Encoding { explicit: big || length_form(&[v0, v1]).is_some(), endian })
    }

    /// The main dataset, up to the pixels or the end of the file.
    fn dataset(&mut self, mut at: u64, encoding: Encoding) -> Result<(), ScanError> {
        while at < self.window.len() {
            let element = self.element(at, encoding)?;
            let pixels = match element.tag {
                0x7fe0_0010 => Some(PixelElement::Integer),
                0x7fe0_0008 => Some(PixelElement::Float),
                0x7fe0_0009 => Some(PixelElement::Double),
                _ => None,
            };
            if let Some(kind) = pixels {
                let left = self.window.left(element.value_at);
                self.header.pixels = Some(PixelData {
                    element: kind,
                    offset: element.value_at,
                    declared: element.length,
                    available: element.length.map_or(left, |n| left.min(n.into())),
                    words: !encoding.explicit || &element.vr == b"OW",
                });
                return Ok(());
            }
            let wanted = DicomHeader::wants(element.tag);
            at = if element.length.is_some() {
                let end = self.end(&element, at)?;
                if wanted {
                    // Split borrow: the value lives in the window, the header beside it.
                    let value = self.window.upto(element.value_at, value_bytes(&element))?;
                    self.header.keep(element.tag, value, encoding.endian);
                }
                end
            } else {
                if wanted {
                    self.header.keep(element.tag, &[], encoding.endian);
                }
                self.undefined(&element, encoding)?
            };
        }
        Ok(())
    }

    /// The element header at `at`.
    fn element(&mut self, at: u64, encoding: Encoding) -> Result<Element, ScanError> {
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
        // Items and delimiters never have a VR.
        let delimiter = tag >> 16 == 0xfffe;
        let letters = vr.iter().all(u8::is_ascii_uppercase);
        // A VR that is letters but not known has the long form (PS3.5 6.2). One that is no letters at
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
            return Err(damaged(at, format!("the file ends inside the head of {}", name(tag))));
        };
        Ok(Element { tag, vr, length: defined(u32_of(long)), value_at: at + 12 })
    }

    /// Offset after a value of defined length, checked against the file.
    fn end(&self, element: &Element, at: u64) -> Result<u64, ScanError> {
        let left = self.window.left(element.value_at);
        match element.length {
            Some(n) if u64::from(n) <= left => Ok(element.value_at + u64::from(n)),
            Some(n) => {
                Err(damaged(at, format!("{} declares {n} bytes, but {left} are left", name(element.tag))))
            }
            None => Err(damaged(at, format!("{} has no length where it needs one", name(element.tag)))),
        }
    }

    fn value(&mut self, element: &Element) -> io::Result<&[u8]> {
        self.window.upto(element.value_at, value_bytes(element))
    }

    /// Steps over the content of an element of undefined length; returns the offset after it.
    fn undefined(&mut self, element: &Element, encoding: Encoding) -> Result<u64, ScanError> {
        let inside = |vr: &[u8; 2], outer: Encoding| {
            // Content of an UN element is implicit little-endian (PS3.5 6.2.2 note 2).
            let explicit = outer.explicit && vr != b"UN";
            Level::Sequence(Encoding { explicit, ..outer })
        };
        let mut stack = [inside(&element.vr, encoding); MAX_DEPTH];
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
                (Level::Item(encoding), _, None) => Some(inside(&inner.vr, encoding)),
                (Level::Sequence(_), tag, _) => {
                    return Err(damaged(at, format!("{} stands where an item must", name(tag))));
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

fn value_bytes(element: &Element) -> usize {
    element.length.and_then(|n| usize::try_from(n).ok()).unwrap_or(0).min(MAX_VALUE_BYTES)
}
