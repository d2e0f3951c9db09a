//! Stored values in the cells of a frame, and padding values (PS3.3 C.7.6.3; PS3.5 section 8).

use crate::geom::Dims;
use crate::source::dicom::parse::header::{DicomHeader, PixelElement};
use crate::volume::{Endian, ScalarType};

/// Format of a cell (the bits allocated to one sample).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CellFormat {
    scalar: ScalarType,
    endian: Endian,
    signed: bool,
    bits: u32,
    /// Unused bits below the stored ones.
    shift: u32,
}

impl CellFormat {
    /// A cell of 8, 16 or 32 bits.
    pub(crate) fn integer(allocated: u32, bits: u32, shift: u32, signed: bool, endian: Endian) -> Self {
        let scalar = match (allocated, signed) {
            (8, false) => ScalarType::U8,
            (8, true) => ScalarType::I8,
            (16, false) => ScalarType::U16,
            (16, true) => ScalarType::I16,
            (_, false) => ScalarType::U32,
            (_, true) => ScalarType::I32,
        };
        Self { scalar, endian, signed, bits, shift }
    }

    /// IEEE single.
    pub(crate) fn float(endian: Endian) -> Self {
        Self { scalar: ScalarType::F32, endian, signed: true, bits: 32, shift: 0 }
    }

    /// IEEE double.
    pub(crate) fn double(endian: Endian) -> Self {
        Self { scalar: ScalarType::F64, endian, signed: true, bits: 64, shift: 0 }
    }

    /// Type of the cut out value: as wide as the cell.
    pub(crate) fn scalar(&self) -> ScalarType {
        self.scalar
    }

    /// Bytes of a cell.
    pub(crate) fn bytes(&self) -> usize {
        self.scalar.bytes()
    }

    /// Bits Stored.
    pub(crate) fn bits(&self) -> u32 {
        self.bits
    }

    /// Unused bits below the stored ones.
    pub(crate) fn shift(&self) -> u32 {
        self.shift
    }

    /// The value of a cut out sample at the beginning of some bytes in native order.
    pub(crate) fn value(&self, sample: &[u8]) -> i64 {
        let word = |bytes: &[u8]| bytes.first_chunk::<2>().map_or(0_u16, |b| bytemuck::cast(*b));
        let raw = match self.bytes() {
            1 => sample.first().copied().map_or(0, u32::from),
            2 => word(sample).into(),
            _ => sample.first_chunk::<4>().map_or(0, |b| bytemuck::cast(*b)),
        };
        self.number(raw)
    }

    /// True if values are two's complement.
    pub(crate) fn is_signed(&self) -> bool {
        self.signed
    }

    pub(crate) fn is_float(&self) -> bool {
        matches!(self.scalar, ScalarType::F32 | ScalarType::F64)
    }

    /// Cuts the value out of a cell of at most 32 bits.
    fn cut(&self, raw: u32) -> u32 {
        let up = 32 - self.bits;
        let top = (raw >> self.shift) << up;
        if self.signed { top.cast_signed().wrapping_shr(up).cast_unsigned() } else { top >> up }
    }

    /// True if the value fills the cell.
    fn is_whole(&self) -> bool {
        self.is_float() || (self.shift == 0 && self.bits as usize == 8 * self.bytes())
    }

    /// The value of a sample held in the low bits of `bits`.
    fn number(&self, bits: u32) -> i64 {
        let up = 32 - 8 * u32::try_from(self.bytes()).unwrap_or(4).min(4);
        if self.signed { i64::from((bits << up).cast_signed() >> up) } else { i64::from((bits << up) >> up) }
    }

    /// Smallest and largest stored value.
    fn range(&self) -> (i64, i64) {
        let span = 1_i64 << self.bits.min(32);
        if self.signed { (-span / 2, span / 2 - 1) } else { (0, span - 1) }
    }
}

/// Size of a frame, and layout of its samples in cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelLayout {
    /// Width in pixels.
    pub columns: u32,
    /// Height in pixels.
    pub rows: u32,
    /// Frames side by side in a picture: tiles of a mosaic, else 1.
    across: u32,
    scalar: ScalarType,
    stored: CellFormat,
}

/// Stored values that mean "no pixel", as a header states them; see [`PixelLayout::padding`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PaddingAttributes {
    /// The header states no padding.
    #[default]
    None,
    /// Bits of Pixel Padding Value and of Pixel Padding Range Limit.
    Integer(u16, Option<u16>),
    /// Float or Double Float Pixel Padding Value, which may be NaN, and Range Limit.
    Float(f64, Option<f64>),
}

impl PaddingAttributes {
    /// Padding that a header states for its kind of pixels.
    pub fn of(header: &DicomHeader) -> Self {
        let element = header.pixels.map_or(PixelElement::Integer, |p| p.element);
        match (element, header.padding, header.float_padding) {
            (PixelElement::Integer, Some(value), _) => Self::Integer(value, header.padding_limit),
            (PixelElement::Float | PixelElement::Double, _, Some(value)) => {
                Self::Float(value, header.float_padding_limit)
            }
            _ => Self::None,
        }
    }
}

/// Stored values that mean "no pixel", and their replacement in a volume; for floating-point pixels, ranks in the order
/// of all such values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Padding {
    low: i64,
    high: i64,
    /// Stored value that is delivered instead.
    pub(crate) replacement: i64,
}

impl PixelLayout {
    /// A frame of such cells, delivered as `scalar`.
    pub(crate) fn new(columns: u32, rows: u32, scalar: ScalarType, stored: CellFormat) -> Self {
        Self { columns, rows, across: 1, scalar, stored }
    }

    /// One of the tiles of a mosaic, of as many in a row as in a column.
    pub(crate) fn tile(&self, across: u32) -> Self {
        let across = across.max(1);
        Self { columns: self.columns / across, rows: self.rows / across, across, ..*self }
    }

    /// Tiles in a row of the picture.
    pub(crate) fn across(&self) -> u32 {
        self.across
    }

    /// Pixels from a row to the next in the file.
    pub(crate) fn pitch(&self) -> u32 {
        self.columns * self.across
    }

    /// Offset of a tile's first pixel from the first pixel of the picture, in bytes of cells as the file has them.
    pub(crate) fn tile_offset(&self, tile: u32) -> u64 {
        let (down, right) = (u64::from(tile / self.across), u64::from(tile % self.across));
        let pixels = down * u64::from(self.rows) * u64::from(self.pitch()) + right * u64::from(self.columns);
        pixels * self.stored.bytes() as u64
    }

    /// Type of the delivered samples: as wide as allocated and signed as the header says, unless the values
    /// go through a table or are bits.
    pub fn scalar(&self) -> ScalarType {
        self.scalar
    }

    pub(crate) fn stored(&self) -> &CellFormat {
        &self.stored
    }

    /// Size as a volume of `slices` slices; `None` where that is out of range.
    pub(crate) fn dims(&self, slices: usize) -> Option<Dims> {
        Dims::new(self.columns, self.rows, u32::try_from(slices).ok()?)
    }

    /// Turns whole cells as they are in the file into stored values in native byte order, in place:
    /// swapped, shifted down, masked to Bits Stored, sign-extended.
    pub fn decode(&self, cells: &mut [u8]) {
        self.decode_padded(cells, None);
    }

    /// Like [`PixelLayout::decode`], with padding replaced.
    pub fn decode_padded(&self, cells: &mut [u8], padding: Option<Padding>) {
        let stored = self.stored;
        let width = stored.bytes();
        stored.endian.to_native(width, cells);
        if stored.is_float() {
            if let Some(padding) = padding {
                replace_floats(stored.scalar, padding, cells);
            }
            return;
        }
        if stored.is_whole() && padding.is_none() {
            return;
        }
        // Bits above the stored ones once held overlays, and may hold a padding value wider than
        // Bits Stored: padding is compared before and after they are cut off.
        let map = |raw: u32| {
            let value = stored.cut(raw);
            match padding {
                Some(p) if p.holds(stored.number(raw)) || p.holds(stored.number(value)) => {
                    p.replacement_bits()
                }
                _ => value,
            }
        };
        match width {
            1 => each::<u8>(cells, map),
            2 => each::<u16>(cells, map),
            _ => each::<u32>(cells, map),
        }
    }

    /// Padding as stated, replaced by the stored value nearest to `background` (physical). Floating-point
    /// pixels are physical as they are.
    pub fn padding(
        &self,
        stated: PaddingAttributes,
        background: f64,
        slope: f64,
        intercept: f64,
    ) -> Option<Padding> {
        let (value, limit) = match stated {
            PaddingAttributes::Float(value, limit) if self.stored.is_float() => {
                let first = rank(value);
                // NaN cannot be the end of a range.
                let last = limit.filter(|l| !l.is_nan() && !value.is_nan()).map_or(first, rank);
                let (low, high) = (first.min(last), first.max(last));
                return Some(Padding { low, high, replacement: rank(background) });
            }
            PaddingAttributes::Integer(value, limit) if !self.stored.is_float() => (value, limit),
            _ => return None,
        };
        let word = |bits: u16| {
            if self.stored.signed { i64::from(bits.cast_signed()) } else { i64::from(bits) }
        };
        let first = word(value);
        let last = limit.map_or(first, word);
        let (low, high) = self.stored.range();
        let stored = ((background - intercept) / slope).round();
        #[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate, then clamped")]
        let replacement = (stored as i64).clamp(low, high);
        Some(Padding { low: first.min(last), high: first.max(last), replacement })
    }

    /// The value of a delivered sample of at most 32 bits, held in the low bits of `bits`.
    fn number(&self, bits: u32) -> f64 {
        match self.scalar {
            ScalarType::F32 | ScalarType::F64 => f32::from_bits(bits).into(),
            ScalarType::U8 => f64::from(bits & 0xff),
            ScalarType::U16 => f64::from(bits & 0xffff),
            ScalarType::U32 => f64::from(bits),
            ScalarType::I8 => f64::from((bits << 24).cast_signed() >> 24),
            ScalarType::I16 => f64::from((bits << 16).cast_signed() >> 16),
            ScalarType::I32 => f64::from(bits.cast_signed()),
        }
    }

    /// Turns stored values in native order, lying in the tail of `out`, into physical `f32`s that
    /// fill `out`. A 32-bit sample is overwritten only after it was read; narrower ones lie far enough
    /// behind: value i ends at byte 4 (i + 1), sample i + 1 begins at (4 - w) n + w (i + 1).
    pub fn widen(&self, out: &mut [u8], slope: f64, intercept: f64) {
        let width = self.scalar.bytes();
        let n = out.len() / 4;
        // Doubles have no rescale, so they are never widened.
        let Some(tail) = out.len().checked_sub(n * width) else { return };
        for i in 0..n {
            let mut word = [0; 4];
            if let Some(sample) = out.get(tail + i * width..tail + (i + 1) * width) {
                // Low bytes first on a little-endian machine, last on a big-endian one.
                let at = if Endian::Little.is_native() { 0 } else { 4 - width };
                word[at..at + width].copy_from_slice(sample);
            }
            #[expect(clippy::cast_possible_truncation, reason = "the result is single precision by contract")]
            let physical = (slope * self.number(bytemuck::cast(word)) + intercept) as f32;
            if let Some(slot) = out.get_mut(4 * i..4 * i + 4) {
                slot.copy_from_slice(bytemuck::bytes_of(&physical));
            }
        }
    }
}

impl Padding {
    pub(crate) fn holds(self, value: i64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// True if replacing changes any sample.
    pub(crate) fn matters(self) -> bool {
        (self.low, self.high) != (self.replacement, self.replacement)
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the replacement lies within 32 stored bits; two's complement is wanted"
    )]
    fn replacement_bits(self) -> u32 {
        self.replacement as u32
    }
}

/// A whole number in the order of floating-point values: both zeros are one, and any NaN is above all.
fn rank(value: f64) -> i64 {
    if value.is_nan() {
        return i64::MAX;
    }
    let bits = (value + 0.0).to_bits().cast_signed();
    if bits < 0 { i64::MIN - bits } else { bits }
}

/// The value of a rank.
fn unrank(rank: i64) -> f64 {
    f64::from_bits(if rank < 0 { i64::MIN - rank } else { rank }.cast_unsigned())
}

/// Replaces padding among singles or doubles in native byte order.
fn replace_floats(scalar: ScalarType, padding: Padding, samples: &mut [u8]) {
    let background = unrank(padding.replacement);
    if scalar == ScalarType::F64 {
        for sample in samples.as_chunks_mut::<8>().0 {
            if padding.holds(rank(bytemuck::cast(*sample))) {
                *sample = bytemuck::cast(background);
            }
        }
        return;
    }
    #[expect(clippy::cast_possible_truncation, reason = "0 and -1000 are singles")]
    let background = background as f32;
    for sample in samples.as_chunks_mut::<4>().0 {
        if padding.holds(rank(bytemuck::cast::<_, f32>(*sample).into())) {
            *sample = bytemuck::cast(background);
        }
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
    use crate::source::dicom::image::describe::Image;
    use crate::source::dicom::image::describe::Obstacle;
    use crate::source::dicom::parse::header::PixelData;
    use crate::source::dicom::parse::syntax::TransferSyntax;

    fn header(allocated: u16, stored: u16, high: u16, signed: bool) -> DicomHeader {
        let mut header = DicomHeader::new(TransferSyntax::ExplicitLe);
        (header.rows, header.columns) = (Some(1), Some(4));
        (header.bits_allocated, header.bits_stored, header.high_bit) =
            (Some(allocated), Some(stored), Some(high));
        header.pixel_representation = Some(signed.into());
        header.pixels = Some(PixelData {
            element: PixelElement::Integer,
            offset: 0,
            declared: Some(u32::from(allocated) / 2),
            available: u64::from(allocated) / 2,
            words: true,
        });
        header
    }

    fn decode16(header: &DicomHeader, background: Option<f64>, raw: &[u16]) -> Vec<u16> {
        let layout = Image::of(header).unwrap().layout;
        let padding = background.and_then(|b| layout.padding(PaddingAttributes::of(header), b, 1.0, 0.0));
        let mut bytes: Vec<u8> = raw.iter().flat_map(|v| v.to_le_bytes()).collect();
        layout.decode_padded(&mut bytes, padding);
        bytes.chunks_exact(2).map(bytemuck::pod_read_unaligned::<u16>).collect()
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

    #[test]
    fn ranks_are_in_the_order_of_values() {
        let inf = f64::INFINITY;
        let values = [-inf, f64::MIN, -1000.0, -1e-300, 0.0, 5e-324, 2.5, f64::MAX, inf];
        assert!(values.is_sorted_by(|a, b| rank(*a) < rank(*b)));
        assert!(values.iter().all(|v| unrank(rank(*v)) == *v));
        assert_eq!(rank(-0.0), rank(0.0));
        assert!(rank(f64::NAN) > rank(inf) && rank(-f64::NAN) == rank(f64::NAN));
    }

    #[test]
    fn floating_point_padding_may_be_a_value_a_range_or_nan() {
        let mut image = header(32, 32, 31, false);
        image.pixels = image.pixels.map(|p| PixelData { element: PixelElement::Float, ..p });
        let layout = Image::of(&image).unwrap().layout;
        let decoded = |stated: PaddingAttributes, samples: [f32; 5]| -> Vec<f32> {
            let mut cells: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
            layout.decode_padded(&mut cells, layout.padding(stated, -1000.0, 1.0, 0.0));
            cells.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
        };
        let samples = [-3.4e38, -2000.5, -1999.0, 0.0, 7.5];
        assert_eq!(decoded(PaddingAttributes::None, samples), samples);
        let lowest = f64::from(samples[0]);
        assert_eq!(
            decoded(PaddingAttributes::Float(lowest, None), samples),
            [-1000.0, -2000.5, -1999.0, 0.0, 7.5]
        );
        let range = PaddingAttributes::Float(-2000.0, Some(lowest));
        assert_eq!(decoded(range, samples), [-1000.0, -1000.0, -1999.0, 0.0, 7.5]);
        let holes = [f32::NAN, -f32::NAN, f32::INFINITY, 0.0, 7.5];
        for limit in [None, Some(f64::NAN), Some(0.0)] {
            let replaced = decoded(PaddingAttributes::Float(f64::NAN, limit), holes);
            assert_eq!(replaced, [-1000.0, -1000.0, f32::INFINITY, 0.0, 7.5]);
        }
        // Integer padding does not apply to floating-point pixels.
        assert_eq!(decoded(PaddingAttributes::Integer(0, None), samples), samples);
    }

    #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
    #[test]
    fn widening_in_place_reads_every_sample_before_it_is_overwritten() {
        for (allocated, signed) in [(8, false), (8, true), (16, false), (16, true), (32, false), (32, true)] {
            let layout = Image::of(&header(allocated, allocated, allocated - 1, signed)).unwrap().layout;
            for n in [1_usize, 2, 3, 17] {
                let width = layout.scalar().bytes();
                let mut out = vec![0_u8; 4 * n];
                let mut expected = Vec::new();
                for i in 0..n {
                    let bits = u32::try_from(i * 37 + 200).unwrap();
                    let at = 4 * n - n * width + i * width;
                    out[at..at + width].copy_from_slice(&bits.to_le_bytes()[..width]);
                    expected.push((0.5 * layout.number(bits) - 3.0) as f32);
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
        let of = |h: &DicomHeader| Image::of(h).unwrap_err();
        for allocated in [0, 2, 12, 24, 64, u16::MAX] {
            assert_eq!(
                of(&header(allocated, 1, 0, false)),
                Obstacle::new(format!("pixels of {allocated} bits allocated cannot be read"))
            );
        }
        for (stored, high) in [(0, 0), (17, 16), (12, 16), (12, 5), (u16::MAX, u16::MAX)] {
            let expected = Obstacle::new(format!(
                "{stored} bits stored with high bit {high} do not fit 16 bits allocated"
            ));
            assert_eq!(of(&header(16, stored, high, false)), expected);
        }
        let mut image = header(16, 16, 15, false);
        image.columns = Some(33);
        let obstacle = of(&image);
        assert!(obstacle.cut_short && obstacle.to_string().ends_with("8 bytes of 66"), "{obstacle}");
        image.columns = Some(0);
        assert_eq!(of(&image), Obstacle::new("the image does not state its columns"));
    }
}
