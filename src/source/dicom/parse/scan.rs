//! Walks the elements of one file in bounded memory (PS3.5 section 7, PS3.10 section 7).
//!
//! Memory is one window of a few KiB, and in a deflated file the state of the inflater. A declared length is compared
//! with the remaining bytes before it is used, long values are stepped over, nested sequences are walked with a fixed
//! stack. A classic image needs nothing inside sequences, so only their ends are looked for; the offsets of the few
//! that matter are kept.

use std::io;

use super::Result;
use super::deflated::InflateReader;
use super::element::{Element, META, Parser, length_form};
use super::header::{DicomHeader, Encoding, PixelData, PixelElement};
use super::value::{Tag, text};
use super::window::{ReadAt, Window};
use crate::source::dicom::parse::error::{ReadFault, ScanError};
use crate::source::dicom::parse::syntax::TransferSyntax;
use crate::volume::Endian;

/// Media Storage SOP Class UID and Transfer Syntax UID in the meta header.
const META_SOP_CLASS: Tag = 0x0002_0002;
const META_SYNTAX: Tag = 0x0002_0010;

/// Modality LUT Sequence.
const MODALITY_LUT: Tag = 0x0028_3000;

/// Longest value accepted as the first one of a file without preamble and VRs.
const MAX_PLAUSIBLE_FIRST: u32 = 1024;

/// Reads the header of a DICOM file, in time linear in the number of elements before the pixels and in a few KiB of
/// memory (some 50 for a deflated file), for any bytes.
///
/// Files without preamble, and without meta header, are recognised when they begin plausibly and turn
/// out to describe an object. Elements after the pixels are not looked at.
///
/// # Errors
/// See [`ScanError`]. A pixel element longer than the file is not an error here: the header states the bytes that the
/// file has.
pub fn scan<R: ReadAt + ?Sized>(input: &R) -> Result<DicomHeader> {
    let mut parser = Parser::new(input)?;
    let has_preamble = parser.window.array::<4>(128)? == Some(*b"DICM");
    let start = if has_preamble { 132 } else { 0 };
    if !has_preamble && !begins_plausibly(&mut parser.window)? {
        return Err(ScanError::NotDicom);
    }
    let mut scanner = Scanner { parser, header: DicomHeader::new(TransferSyntax::ImplicitLe) };
    let walked = scanner.file(start, input);
    let header = scanner.header;
    // Without the preamble, only an object that says its class or its size counts as DICOM.
    let says_what = header.sop_class.starts_with("1.") || (header.rows.is_some() && header.columns.is_some());
    match walked {
        Err(ScanError::Io(ReadFault::Deflate(fault))) => {
            Err(ScanError::Damaged { offset: header.dataset, damage: fault.to_string().into() })
        }
        Err(ScanError::Io(fault)) => Err(ScanError::Io(fault)),
        _ if !has_preamble && !says_what => Err(ScanError::NotDicom),
        Err(e) => Err(e),
        Ok(()) => Ok(header),
    }
}

/// True if a dataset or a meta header could begin at byte 0.
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

struct Scanner<'a, R: ReadAt + ?Sized> {
    parser: Parser<'a, R>,
    header: DicomHeader,
}

impl<R: ReadAt + ?Sized> Scanner<'_, R> {
    fn file(&mut self, start: u64, input: &R) -> Result {
        let (at, syntax) = self.meta(start)?;
        self.header.dataset = at;
        if syntax == Some(TransferSyntax::Deflated) {
            self.header.transfer_syntax = TransferSyntax::Deflated;
            let inflated = InflateReader::new(input, at)?;
            // The header goes into the scanner of the stream, and comes back in every case.
            let header = std::mem::replace(&mut self.header, DicomHeader::new(TransferSyntax::Deflated));
            let mut inner = Scanner { parser: Parser::new(&inflated)?, header };
            let walked = inner.inflated(at);
            self.header = inner.header;
            return walked;
        }
        let encoding = self.detect(at, syntax.as_ref())?;
        self.header.transfer_syntax = syntax.unwrap_or(match encoding {
            Encoding { endian: Endian::Big, .. } => TransferSyntax::ExplicitBe,
            Encoding { explicit: true, .. } => TransferSyntax::ExplicitLe,
            Encoding { .. } => TransferSyntax::ImplicitLe,
        });
        self.dataset(at, encoding)
    }

    fn inflated(&mut self, at: u64) -> Result {
        let encoding = self.detect(at, Some(&TransferSyntax::Deflated))?;
        self.dataset(at, encoding)
    }

    /// Group 0002, always explicit little-endian; returns where the dataset begins. The group's own
    /// length is not trusted: the group ends where another begins.
    fn meta(&mut self, mut at: u64) -> Result<(u64, Option<TransferSyntax>)> {
        let mut syntax = None;
        while self.parser.window.array::<2>(at)? == Some([2, 0]) {
            let element = self.parser.element(at, META)?;
            let end = self.parser.end(&element, at)?;
            if matches!(element.tag, META_SYNTAX | META_SOP_CLASS) {
                let value = text(self.parser.value(&element)?);
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

    /// Encoding of the dataset at `at`: as declared, unless its first element says otherwise (many files declare
    /// implicit or explicit VR wrongly, and the VR letters give them away).
    fn detect(&mut self, at: u64, declared: Option<&TransferSyntax>) -> io::Result<Encoding> {
        let Some([g0, g1, _, _, v0, v1]) = self.parser.window.array::<6>(at)? else { return Ok(META) };
        let looks_big = u16::from_be_bytes([g0, g1]) < u16::from_le_bytes([g0, g1]);
        let big = looks_big && matches!(declared, None | Some(TransferSyntax::ExplicitBe));
        let endian = if big { Endian::Big } else { Endian::Little };
        Ok(Encoding { explicit: big || length_form(&[v0, v1]).is_some(), endian })
    }

    /// True if a Modality LUT Sequence has a table, or a part of one. A damaged sequence counts as one, and is reported
    /// when it is used.
    fn holds_lut(&mut self, sequence: &Element, at: u64, encoding: Encoding) -> bool {
        const DESCRIPTOR: Tag = 0x0028_3002;
        const DATA: Tag = 0x0028_3006;
        let mut holds = false;
        let walked = self.parser.items(sequence, at, encoding, &mut |parser, at, end, encoding| {
            parser.elements(at, end, encoding, &mut |_, element, _| {
                holds |= matches!(element.tag, DESCRIPTOR | DATA) && element.length != Some(0);
                Ok(None)
            })
        });
        holds || walked.is_err()
    }

    /// The main dataset, up to the pixels or the end of the file.
    fn dataset(&mut self, mut at: u64, encoding: Encoding) -> Result {
        self.header.encoding = encoding;
        while !self.parser.is_end(at)? {
            let element = self.parser.element(at, encoding)?;
            let pixels = match element.tag {
                0x7fe0_0010 => Some(PixelElement::Integer),
                0x7fe0_0008 => Some(PixelElement::Float),
                0x7fe0_0009 => Some(PixelElement::Double),
                _ => None,
            };
            if let Some(kind) = pixels {
                let left = self.parser.window.left(element.value_at);
                self.header.pixels = Some(PixelData {
                    element: kind,
                    offset: element.value_at,
                    declared: element.length,
                    available: element.length.map_or(left, |n| left.min(n.into())),
                    words: !encoding.explicit || &element.vr == b"OW",
                });
                return Ok(());
            }
            if element.tag == MODALITY_LUT && !self.holds_lut(&element, at, encoding) {
                // The sequence holds no table: other readers pass it over, too.
                at = self.parser.skip(&element, at, encoding)?;
                continue;
            }
            self.header.offsets.keep(element.tag, at);
            if self.header.private.is_csa(element.tag) {
                self.header.offsets.csa.get_or_insert(at);
            }
            let wanted = DicomHeader::wants(element.tag);
            if element.length.is_some() {
                let end = self.parser.end(&element, at)?;
                if wanted {
                    // Split borrow: the value lives in the window, apart from the header.
                    let value = self.parser.value(&element)?;
                    self.header.keep(element.tag, value, encoding.endian);
                }
                at = end;
            } else {
                if wanted {
                    self.header.keep(element.tag, &[], encoding.endian);
                }
                at = self.parser.skip(&element, at, encoding)?;
            }
        }
        Ok(())
    }
}
