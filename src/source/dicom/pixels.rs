//! How the stored values of a native image lie in the file, or why they cannot be read
//! (PS3.3 C.7.6.3; PS3.5 section 8).

use thiserror::Error;

use super::header::{DicomHeader, PixelElement};
use super::syntax::TransferSyntax;
use crate::geom::Dims;
use crate::source::{Endian, ScalarType};

/// Why an object cannot be a slice of a volume yet; the sentence names what it is.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Obstacle {
    /// A report, a plan, a directory, ...
    #[error("{0} without pixels")]
    NoPixels(String),
    /// Everything after the meta header is compressed.
    #[error("deflated files cannot be read yet")]
    Deflated,
    /// Frames are compressed or wrapped.
    #[error("compressed pixels ({0}) cannot be read yet")]
    Encapsulated(TransferSyntax),
    /// A transfer syntax that is not known here.
    #[error("pixels in an {0} cannot be read")]
    UnknownSyntax(TransferSyntax),
    /// Several frames in one file.
    #[error("multi-frame images ({0} frames in one file) cannot be read yet")]
    MultiFrame(u32),
    /// Number of Frames is illegible or 0.
    #[error("the number of frames is not a positive number")]
    BadFrames,
    /// RGB, YBR, palette, ...
    #[error("colour images ({photometric}, {samples} samples a pixel) cannot be read yet")]
    Colour {
        /// Photometric Interpretation.
        photometric: String,
        /// Samples per Pixel.
        samples: u16,
    },
    /// Float or Double Float Pixel Data.
    #[error("floating-point pixels cannot be read yet")]
    Float,
    /// Values go through a table.
    #[error("values that go through a modality LUT cannot be read yet")]
    ModalityLut,
    /// A width other than 8, 16 or 32.
    #[error("pixels of {0} bits allocated cannot be read yet")]
    BitsAllocated(u16),
    /// Bits stored and high bit do not fit the bits allocated.
    #[error("{stored} bits stored with high bit {high} do not fit {allocated} bits allocated")]
    BadBits {
        /// Bits Allocated.
        allocated: u16,
        /// Bits Stored.
        stored: u16,
        /// High Bit.
        high: u16,
    },
    /// 8-bit pixels as big-endian words: neighbours are swapped in the file.
    #[error("8-bit pixels in big-endian words cannot be read")]
    SwappedBytes,
    /// An attribute that every image must have.
    #[error("the image does not state its {0}")]
    Missing(&'static str),
    /// The file ends, or its pixel element ends, before the last row.
    #[error("the pixels are cut short: {got} bytes of {needed}")]
    Truncated {
        /// Bytes that the size of the image needs.
        needed: u64,
        /// Bytes that are there.
        got: u64,
    },
}

/// Stored values of one native frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelLayout {
    /// Width in pixels.
    pub columns: u32,
    /// Height in pixels.
    pub rows: u32,
    scalar: ScalarType,
    endian: Endian,
    signed: bool,
    bits_stored: u32,
    /// Unused bits below the stored ones.
    shift: u32,
}

/// Stored values that mean "no pixel", and what stands for them in a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Padding {
    low: i64,
    high: i64,
    /// Stored value that is delivered instead.
    pub(super) replacement: i64,
}

impl PixelLayout {
    /// Layout of an image of one uncompressed grey frame, all of whose bytes are in the file.
    ///
    /// # Errors
    /// The [`Obstacle`] that is in the way.
    pub fn of(header: &DicomHeader) -> Result<Self, Obstacle> {
        let syntax = &header.transfer_syntax;
        if *syntax == TransferSyntax::Deflated {
            return Err(Obstacle::Deflated);
        }
        let Some(pixels) = header.pixels else { return Err(Obstacle::NoPixels(header.kind())) };
        if pixels.element != PixelElement::Integer {
            return Err(Obstacle::Float);
        }
        match syntax {
            TransferSyntax::Unknown(_) => return Err(Obstacle::UnknownSyntax(syntax.clone())),
            TransferSyntax::Encapsulated(_) => return Err(Obstacle::Encapsulated(syntax.clone())),
            _ if pixels.declared.is_none() => return Err(Obstacle::Encapsulated(syntax.clone())),
            _ => {}
        }
        match header.frames {
            None | Some(Ok(1)) => {}
            Some(Ok(n)) if n > 1 => return Err(Obstacle::MultiFrame(n)),
            Some(_) => return Err(Obstacle::BadFrames),
        }
        let grey = matches!(header.photometric.as_str(), "" | "MONOCHROME1" | "MONOCHROME2");
        let samples = header.samples.unwrap_or(1);
        if samples != 1 || !grey {
            return Err(Obstacle::Colour { photometric: header.photometric.clone(), samples });
        }
        if header.modality_lut {
            return Err(Obstacle::ModalityLut);
        }
        let side = |side: Option<u16>, what| side.filter(|n| *n > 0).ok_or(Obstacle::Missing(what));
        let (rows, columns) = (side(header.rows, "rows")?, side(header.columns, "columns")?);
        let allocated = header.bits_allocated.ok_or(Obstacle::Missing("bits allocated"))?;
        let signed = header.pixel_representation.unwrap_or(0) & 1 == 1;
        let scalar = match (allocated, signed) {
            (8, false) => ScalarType::U8,
            (8, true) => ScalarType::I8,
            (16, false) => ScalarType::U16,
            (16, true) => ScalarType::I16,
            (32, false) => ScalarType::U32,
            (32, true) => ScalarType::I32,
            _ => return Err(Obstacle::BitsAllocated(allocated)),
        };
        let stored = header.bits_stored.unwrap_or(allocated);
        let high = header.high_bit.unwrap_or(stored.saturating_sub(1));
        if stored == 0 || high >= allocated || stored > high + 1 {
            return Err(Obstacle::BadBits { allocated, stored, high });
        }
        let big = *syntax == TransferSyntax::ExplicitBe;
        if big && allocated == 8 && pixels.words {
            return Err(Obstacle::SwappedBytes);
        }
        let needed = u64::from(rows) * u64::from(columns) * scalar.bytes() as u64;
        if pixels.available < needed {
            return Err(Obstacle::Truncated { needed, got: pixels.available });
        }
        Ok(Self {
            columns: columns.into(),
            rows: rows.into(),
            scalar,
            endian: if big { Endian::Big } else { Endian::Little },
            signed,
            bits_stored: stored.into(),
            shift: u32::from(high + 1 - stored),
        })
    }

    /// Type of the stored values: as wide as allocated, signed as the header says.
    pub fn scalar(&self) -> ScalarType {
        self.scalar
    }

    /// Size as a volume of `slices` slices; `None` where that is out of range.
    pub(super) fn dims(&self, slices: usize) -> Option<Dims> {
        Dims::new(self.columns, self.rows, u32::try_from(slices).ok()?)
    }

    /// Turns whole samples as they are in the file into stored values in native byte order, in place:
    /// swapped, shifted down, masked to Bits Stored, sign-extended.
    pub fn decode(&self, samples: &mut [u8]) {
        self.decode_padded(samples, None);
    }

    /// As [`PixelLayout::decode`], with padding replaced.
    pub(super) fn decode_padded(&self, samples: &mut [u8], padding: Option<Padding>) {
        let width = self.scalar.bytes();
        self.endian.to_native(width, samples);
        let full = self.shift == 0 && self.bits_stored as usize == 8 * width;
        if full && padding.is_none() {
            return;
        }
        // Bits above the stored ones once held overlays, and may hold a padding value wider than
        // Bits Stored: padding is compared before and after they are cut off.
        let map = |raw: u32| {
            let up = 32 - self.bits_stored;
            let cut = (raw >> self.shift) << up;
            let value =
                if self.signed { cut.cast_signed().wrapping_shr(up).cast_unsigned() } else { cut >> up };
            match padding {
                Some(p) if p.holds(self.number(raw)) || p.holds(self.number(value)) => p.replacement_bits(),
                _ => value,
            }
        };
        match width {
            1 => each::<u8>(samples, map),
            2 => each::<u16>(samples, map),
            _ => each::<u32>(samples, map),
        }
    }

    /// The value of a sample held in the low bits of `bits`.
    fn number(&self, bits: u32) -> i64 {
        let up = 32 - 8 * u32::try_from(self.scalar.bytes()).unwrap_or(4);
        if self.signed { i64::from((bits << up).cast_signed() >> up) } else { i64::from((bits << up) >> up) }
    }

    /// Smallest and largest stored value.
    fn range(&self) -> (i64, i64) {
        let span = 1_i64 << self.bits_stored;
        if self.signed { (-span / 2, span / 2 - 1) } else { (0, span - 1) }
    }

    /// Padding given by the bits of its value and range limit, replaced by the stored value nearest to
    /// `background` (physical).
    pub(super) fn padding(
        &self,
        (value, limit): (Option<u16>, Option<u16>),
        background: f64,
        slope: f64,
        intercept: f64,
    ) -> Option<Padding> {
        let word = |bits: u16| {
            if self.signed { i64::from(bits.cast_signed()) } else { i64::from(bits) }
        };
        let first = word(value?);
        let last = limit.map_or(first, word);
        let (low, high) = self.range();
        let stored = ((background - intercept) / slope).round();
        #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate, then clamped")]
        let replacement = (stored as i64).clamp(low, high);
        Some(Padding { low: first.min(last), high: first.max(last), replacement })
    }

    /// Turns stored values in native order, lying in the tail of `out`, into physical `f32`s that
    /// fill `out`. A 32-bit sample is overwritten only after it was read; narrower ones lie far enough
    /// behind: value i ends at byte 4 (i + 1), sample i + 1 begins at (4 - w) n + w (i + 1).
    pub(super) fn widen(&self, out: &mut [u8], slope: f64, intercept: f64) {
        let width = self.scalar.bytes();
        let n = out.len() / 4;
        let tail = out.len() - n * width;
        for i in 0..n {
            let mut word = [0; 4];
            if let Some(sample) = out.get(tail + i * width..tail + (i + 1) * width) {
                // Low bytes first on a little-endian machine, last on a big-endian one.
                let at = if Endian::Little.is_native() { 0 } else { 4 - width };
                word[at..at + width].copy_from_slice(sample);
            }
            let stored = self.number(bytemuck::cast(word));
            #[expect(
                clippy::cast_precision_loss,
                clippy::cast_possible_truncation,
                reason = "32-bit integers are exact in f64; the result is single precision by contract"
            )]
            let physical = (slope * stored as f64 + intercept) as f32;
            if let Some(slot) = out.get_mut(4 * i..4 * i + 4) {
                slot.copy_from_slice(bytemuck::bytes_of(&physical));
            }
        }
    }
}

impl Padding {
    fn holds(self, value: i64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// Does replacing change anything?
    pub(super) fn matters(self) -> bool {
        (self.low, self.high) != (self.replacement, self.replacement)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the replacement lies within 32 stored bits; two's complement is wanted"
    )]
    fn replacement_bits(self) -> u32 {
        self.replacement as u32
    }
}

/// An unsigned word of a file.
trait Word: bytemuck::Pod {
    fn widen(self) -> u32;
    fn narrow(bits: u32) -> Self;
}

macro_rules! word {
    ($($t:ty),*) => {$(
        impl Word for $t {
            fn widen(self) -> u32 {
                self.into()
            }
            #[allow(clippy::cast_possible_truncation, reason = "the low bits are the sample")]
            fn narrow(bits: u32) -> Self {
                bits as Self
            }
        }
    )*};
}
word!(u8, u16, u32);

fn each<W: Word>(samples: &mut [u8], map: impl Fn(u32) -> u32) {
    for chunk in samples.chunks_exact_mut(size_of::<W>()) {
        let word: W = bytemuck::pod_read_unaligned(chunk);
        chunk.copy_from_slice(bytemuck::bytes_of(&W::narrow(map(word.widen()))));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::dicom::header::PixelData;

    fn header(allocated: u16, stored: u16, high: u16, signed: bool) -> DicomHeader {
        let mut header = DicomHeader::new(TransferSyntax::ExplicitLe);
        (header.rows, header.columns) = (Some(1), Some(4));
        (header.bits_allocated, header.bits_stored, header.high_bit) =
            (Some(allocated), Some(stored), Some(high));
        header.pixel_representation = Some(signed.into());
        header.pixels = Some(PixelData {
            element: PixelElement::Integer,
            offset: 0,
            declared: Some(64),
            available: 64,
            words: true,
        });
        header
    }

    fn decode16(header: &DicomHeader, background: Option<f64>, raw: &[u16]) -> Vec<u16> {
        let layout = PixelLayout::of(header).unwrap();
        let padding =
            background.and_then(|b| layout.padding((header.padding, header.padding_limit), b, 1.0, 0.0));
        let mut bytes: Vec<u8> = raw.iter().flat_map(|v| v.to_le_bytes()).collect();
        layout.decode_padded(&mut bytes, padding);
        bytes.chunks_exact(2).map(bytemuck::pod_read_unaligned).collect()
    }

    #[test]
    fn stored_bits_are_masked_shifted_and_sign_extended() {
        assert_eq!(decode16(&header(16, 12, 11, false), None, &[0xf123, 0x0fff]), [0x0123, 0x0fff]);
        assert_eq!(decode16(&header(16, 12, 11, true), None, &[0x0800, 0x07ff, 0xf001]), [0xf800, 0x07ff, 1]);
        assert_eq!(decode16(&header(16, 12, 15, true), None, &[0x8000, 0x7ff7]), [0xf800, 0x07ff]);
        assert_eq!(decode16(&header(16, 16, 15, false), None, &[0xffff, 0x8000]), [0xffff, 0x8000]);
    }

    #[test]
    fn padding_becomes_the_background_within_the_stored_range() {
        let mut image = header(16, 12, 11, false);
        image.padding = Some(0xf830);
        // -2000 in a 12-bit image: seen before the mask; -1000 does not fit, 0 is nearest.
        assert_eq!(decode16(&image, Some(-1000.0), &[0xf830, 0x0001, 0x0830]), [0, 1, 0x830]);
        let mut image = header(16, 16, 15, true);
        (image.padding, image.padding_limit) =
            (Some((-1500_i16).cast_unsigned()), Some((-1400_i16).cast_unsigned()));
        let raw = [-1500_i16, -1450, -1399, 5].map(i16::cast_unsigned);
        let expected = [-1000_i16, -1000, -1399, 5].map(i16::cast_unsigned);
        assert_eq!(decode16(&image, Some(-1000.0), &raw), expected);
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "small numbers")]
    #[test]
    fn widening_in_place_reads_every_sample_before_it_is_overwritten() {
        for (allocated, signed) in [(8, false), (8, true), (16, false), (16, true), (32, false), (32, true)] {
            let layout = PixelLayout::of(&header(allocated, allocated, allocated - 1, signed)).unwrap();
            for n in [1_usize, 2, 3, 17] {
                let width = layout.scalar().bytes();
                let mut out = vec![0_u8; 4 * n];
                let mut expected = Vec::new();
                for i in 0..n {
                    let bits = u32::try_from(i * 37 + 200).unwrap();
                    let at = 4 * n - n * width + i * width;
                    out[at..at + width].copy_from_slice(&bits.to_le_bytes()[..width]);
                    expected.push((0.5 * layout.number(bits) as f64 - 3.0) as f32);
                }
                Endian::Little.to_native(width, &mut out[4 * n - n * width..]);
                layout.widen(&mut out, 0.5, -3.0);
                let got: Vec<f32> = out.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
                assert_eq!(got, expected, "{allocated} {signed} {n}");
            }
        }
    }

    #[test]
    fn impossible_bits_and_missing_sizes_are_named() {
        let of = |h: &DicomHeader| PixelLayout::of(h).unwrap_err();
        assert_eq!(of(&header(1, 1, 0, false)), Obstacle::BitsAllocated(1));
        for (stored, high) in [(0, 0), (17, 16), (12, 16), (12, 5), (u16::MAX, u16::MAX)] {
            let expected = Obstacle::BadBits { allocated: 16, stored, high };
            assert_eq!(of(&header(16, stored, high, false)), expected);
        }
        let mut image = header(16, 16, 15, false);
        image.columns = Some(33);
        assert_eq!(of(&image), Obstacle::Truncated { needed: 66, got: 64 });
        image.columns = Some(0);
        assert_eq!(of(&image), Obstacle::Missing("columns"));
    }
}
