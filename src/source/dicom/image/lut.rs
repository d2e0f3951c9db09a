//! Lookup tables for stored values: the Modality LUT and palettes (PS3.3 C.11.1.1.1, C.7.6.3.1.5 and C.7.6.3.1.6). At
//! most 65536 entries, so 128 KiB.

use crate::source::dicom::parse::Result;
use crate::source::dicom::parse::element::{Element, Parser, damaged};
use crate::source::dicom::parse::header::{DicomHeader, Encoding};
use crate::source::dicom::parse::window::ReadAt;
use crate::volume::Endian;

/// Bytes read at a time from a table.
const PIECE: usize = 1024;

/// A table; values outside take the entry at the near end.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Lut {
    /// Stored value of the first entry.
    first: i64,
    /// Values of the table; at least one.
    entries: Vec<u16>,
}

/// LUT Descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Descriptor {
    entries: usize,
    first: i64,
    bits: u16,
}

/// Luminance of a colour, ITU-R BT.601 in thousandths: the Y of YBR_FULL (PS3.3 C.7.6.3.1.2).
pub(crate) fn luminance([red, green, blue]: [u32; 3]) -> u32 {
    let sum = 299 * u64::from(red) + 587 * u64::from(green) + 114 * u64::from(blue);
    u32::try_from((sum + 500) / 1000).unwrap_or(u32::MAX)
}

impl Lut {
    /// The Modality LUT of a file.
    ///
    /// # Errors
    /// The table is damaged or incomplete.
    pub(crate) fn modality<R: ReadAt + ?Sized>(
        input: &R,
        header: &DicomHeader,
        signed: bool,
    ) -> Result<Self> {
        let at = header.offsets.modality_lut.unwrap_or(0);
        let mut parser = Parser::new(input)?;
        let sequence = parser.element(at, header.encoding)?;
        let (mut descriptor, mut entries) = (None, None);
        parser.items(&sequence, at, header.encoding, &mut |parser, at, end, encoding| {
            parser.elements(at, end, encoding, &mut |parser, element, at| {
                match element.tag {
                    0x0028_3002 if descriptor.is_none() => {
                        descriptor = Some(Descriptor::read(parser, element, encoding, signed)?);
                    }
                    0x0028_3006 if entries.is_none() => {
                        let Some(descriptor) = descriptor else {
                            return Err(damaged(at, "the modality LUT has no descriptor"));
                        };
                        let mut table = Vec::with_capacity(descriptor.entries);
                        descriptor.visit(parser, element, encoding, &mut |entry| table.push(entry))?;
                        entries = Some(table);
                    }
                    _ => {}
                }
                Ok(None)
            })
        })?;
        match (descriptor, entries) {
            (Some(descriptor), Some(entries)) => Ok(Self { first: descriptor.first, entries }),
            _ => Err(damaged(at, "the modality LUT is incomplete")),
        }
    }

    /// Luminance of the palette of a file.
    ///
    /// # Errors
    /// The palette is damaged or incomplete.
    pub(crate) fn palette<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader, signed: bool) -> Result<Self> {
        let encoding = header.encoding;
        let mut parser = Parser::new(input)?;
        let mut shared = None;
        for at in header.offsets.palette_descriptors {
            let at = at.unwrap_or(0);
            let element = parser.element(at, encoding)?;
            let descriptor = Descriptor::read(&mut parser, &element, encoding, signed)?;
            if *shared.get_or_insert(descriptor) != descriptor {
                return Err(damaged(at, "the palettes of red, green and blue differ in size"));
            }
        }
        let Some(descriptor) = shared else { return Err(damaged(0, "the palette has no descriptor")) };
        // Colour by colour, in the order of the file, so that a deflated file is inflated once.
        let mut sums = vec![0_u32; descriptor.entries];
        for (at, weight) in header.offsets.palettes.into_iter().zip([299_u32, 587, 114]) {
            let element = parser.element(at.unwrap_or(0), encoding)?;
            let mut each = sums.iter_mut();
            descriptor.visit(&mut parser, &element, encoding, &mut |entry| {
                if let Some(sum) = each.next() {
                    *sum += weight * u32::from(entry);
                }
            })?;
        }
        let entries = sums.into_iter().map(|sum| u16::try_from((sum + 500) / 1000).unwrap_or(u16::MAX));
        Ok(Self { first: descriptor.first, entries: entries.collect() })
    }

    /// The entry of a stored value.
    pub(crate) fn of(&self, value: i64) -> u16 {
        let last = self.entries.len().saturating_sub(1);
        let index = usize::try_from(value.saturating_sub(self.first)).unwrap_or(0).min(last);
        self.entries.get(index).copied().unwrap_or(0)
    }
}

impl Descriptor {
    fn read<R: ReadAt + ?Sized>(
        parser: &mut Parser<'_, R>,
        element: &Element,
        encoding: Encoding,
        signed: bool,
    ) -> Result<Self> {
        let at = element.value_at;
        let value = parser.value(element)?;
        let word = |i: usize| {
            let bytes = value.get(2 * i..2 * i + 2).and_then(|b| b.first_chunk::<2>()).copied()?;
            Some(if encoding.endian == Endian::Big {
                u16::from_be_bytes(bytes)
            } else {
                u16::from_le_bytes(bytes)
            })
        };
        let (Some(entries), Some(first), Some(bits)) = (word(0), word(1), word(2)) else {
            return Err(damaged(at, "the descriptor of a table is cut short"));
        };
        if !(1..=16).contains(&bits) {
            return Err(damaged(at, format!("a table has entries of {bits} bits")));
        }
        let first = if signed { i64::from(first.cast_signed()) } else { i64::from(first) };
        // 65536 does not fit the field and is written 0.
        let entries = if entries == 0 { 1 << 16 } else { usize::from(entries) };
        Ok(Self { entries, first, bits })
    }

    /// Visits the entries of a table. Entries of 8 bits may be packed, two to a word.
    fn visit<R: ReadAt + ?Sized>(
        &self,
        parser: &mut Parser<'_, R>,
        data: &Element,
        encoding: Encoding,
        each: &mut dyn FnMut(u16),
    ) -> Result {
        let at = data.value_at;
        let length = data.length.and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
        let packed = length < 2 * self.entries;
        if packed && (self.bits > 8 || length < self.entries) {
            return Err(damaged(at, format!("a table of {} entries has {length} bytes", self.entries)));
        }
        let big = encoding.endian == Endian::Big;
        // An even number of bytes in any case: packed entries of a big-endian word stand swapped.
        let needed = if packed { self.entries.next_multiple_of(2).min(length) } else { 2 * self.entries };
        let mut left = self.entries;
        let mut read = 0;
        while read < needed && left > 0 {
            let piece = parser.window.upto(at + read as u64, PIECE.min(needed - read))?;
            if piece.is_empty() {
                return Err(damaged(at, "the file ends inside a table"));
            }
            // Pieces are even but for the last byte of an odd table.
            let whole = if piece.len() > 1 { piece.len() & !1 } else { 1 };
            for pair in piece.get(..whole).unwrap_or(&[]).chunks(2) {
                let (low, high) = match pair {
                    [a, b] if big => (*b, *a),
                    [a, b] => (*a, *b),
                    [a] => (*a, 0),
                    _ => continue,
                };
                if packed {
                    [low, high].into_iter().take(left.min(pair.len())).for_each(|byte| each(byte.into()));
                    left = left.saturating_sub(2);
                } else {
                    each(u16::from_le_bytes([low, high]));
                    left = left.saturating_sub(1);
                }
            }
            read += whole;
        }
        Ok(())
    }
}
