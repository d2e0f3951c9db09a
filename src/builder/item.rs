//! Conversion of a solid's description of voxels to stored items of a channel, before and after all are known.
//!
//! Values of 8 and 16 bits are stored as they are (shifted to unsigned), so the channel is lossless for
//! them. Wider types are swapped as singles and stored in 16 bits between the smallest and the largest
//! value found on the skin.

use super::range::Ordered;
use crate::format::Channel;
use crate::volume::{Rescale, ScalarType};

/// Storage form of the items of a channel, which a solid gives while it is scanned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ItemForm {
    /// Items stored unchanged.
    AsIs {
        /// Bytes of an item.
        bytes: usize,
    },
    /// Singles (little-endian), stored as 16-bit numbers of steps above the lowest.
    Scaled {
        /// Value of number 0.
        low: f64,
        /// Difference of consecutive numbers.
        step: f64,
    },
    /// Codes of `eighth` (16 bits, little-endian), stored as numbers above the lowest: 1 is the lowest, 0 means absent.
    /// Their high bytes are nearly all the same and so compress, the low ones do not.
    Octaves {
        /// Code of number 1.
        low: u16,
    },
}

/// Mantissas of powers of two at odd sixteenths: the bounds between eighths of an octave.
const EIGHTHS: [u32; 8] =
    [0x05_aac4, 0x11_c3d4, 0x1e_f533, 0x2d_583f, 0x3d_08a4, 0x4e_248d, 0x60_ccdf, 0x75_257e];

/// The nearest eighth of an octave, counted from 2^-127 on; 0 for 0 and subnormal sizes. By bits, which gives the same
/// result on every machine.
#[inline(always)]
pub(super) fn eighth(size: f32) -> u32 {
    let bits = size.to_bits();
    let mut code = bits >> 23 << 3;
    for bound in EIGHTHS {
        code += u32::from(bits & 0x7f_ffff >= bound);
    }
    if bits >> 23 == 0 { 0 } else { code }
}

/// The number of a code above the lowest; 0 for code 0.
fn above(code: u16, low: u16) -> u8 {
    code.saturating_sub(low.saturating_sub(1)).min(u8::MAX.into()).to_le_bytes()[0]
}

/// Powers of two at eighths.
const POWERS: [f64; 8] = [
    1.0,
    1.090_507_732_665_257_7,
    1.189_207_115_002_721,
    1.296_839_554_651_009_6,
    std::f64::consts::SQRT_2,
    1.542_210_825_407_940_7,
    1.681_792_830_507_429,
    1.834_008_086_409_342_4,
];

/// The size of a code of [`eighth`], the same on every machine.
pub(super) fn size_of_eighth(code: u16) -> f64 {
    let octave = u64::from(code >> 3) + 1023 - 127;
    f64::from_bits(octave << 52) * POWERS[usize::from(code & 7)]
}

/// The least code, of an extent of codes; 0 for an extent without any.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a code")]
pub(super) fn least_code((low, _): (f32, f32)) -> u16 {
    if low.is_finite() { low as u16 } else { 0 }
}

impl ItemForm {
    /// The form that spreads singles of `extent` over 16 bits.
    pub(crate) fn scaled(extent: (f32, f32)) -> Self {
        let (low, high) = (f64::from(extent.0), f64::from(extent.1));
        Self::Scaled { low, step: if high > low { (high - low) / 65535.0 } else { 1.0 } }
    }

    /// The form for codes of `eighth` from the least one of an extent on.
    pub(super) fn octaves(extent: (f32, f32)) -> Self {
        Self::Octaves { low: least_code(extent) }
    }

    /// Bytes of an item in the scratch file.
    pub(crate) fn swapped_bytes(self) -> usize {
        match self {
            Self::AsIs { bytes } => bytes,
            Self::Scaled { .. } => size_of::<f32>(),
            Self::Octaves { .. } => size_of::<u16>(),
        }
    }

    /// First bytes of an item that are not worth compressing.
    pub(crate) fn tail_bytes(self) -> usize {
        usize::from(matches!(self, Self::Octaves { .. }))
    }

    /// Bytes of an item in the model.
    pub(crate) fn stored_bytes(self) -> usize {
        match self {
            Self::AsIs { bytes } => bytes,
            Self::Scaled { .. } => size_of::<u16>(),
            Self::Octaves { .. } => 1,
        }
    }

    /// Appends the stored form of swapped items; their first bytes that were not compressed come apart.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535")]
    pub(super) fn store(self, [tail, swapped]: [&[u8]; 2], out: &mut Vec<u8>) {
        match self {
            Self::AsIs { .. } => out.extend_from_slice(swapped),
            Self::Scaled { low, step } => {
                out.extend(swapped.as_chunks::<4>().0.iter().flat_map(|single| {
                    let v = f64::from(f32::from_le_bytes(*single));
                    let number = ((v - low) / step + 0.5).floor().clamp(0.0, 65535.0) as u16;
                    number.to_le_bytes()
                }));
            }
            Self::Octaves { low } => {
                out.extend(tail.iter().zip(swapped).map(|(l, h)| above(u16::from_le_bytes([*l, *h]), low)));
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ChannelForm {
    pub(super) channel: Channel,
    pub(super) form: ItemForm,
}

/// Bytes of a volume's value while it is scanned.
pub(super) fn value_bytes(scalar: ScalarType) -> usize {
    scalar.bytes().min(4)
}

/// Storage form of a volume's values.
pub(super) fn value_form(scalar: ScalarType, extent: (f32, f32)) -> ItemForm {
    match scalar.bytes() {
        1 | 2 => ItemForm::AsIs { bytes: scalar.bytes() },
        _ => ItemForm::scaled(extent),
    }
}

/// `[scale, offset]` of the metadata: physical = scale x stored + offset.
pub(super) fn value_scale(scalar: ScalarType, extent: (f32, f32), rescale: Rescale) -> [f64; 2] {
    let (low, step) = match (scalar, value_form(scalar, extent)) {
        (_, ItemForm::Scaled { low, step }) => (low, step),
        (ScalarType::I8, _) => (-128.0, 1.0),
        (ScalarType::I16, _) => (-32768.0, 1.0),
        _ => (0.0, 1.0),
    };
    [rescale.slope * step, rescale.apply(low)]
}

/// Appends the swapped form of a sample and widens `extent` by it.
#[inline]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "integers within their type")]
pub(super) fn push_swapped<T: Ordered>(sample: T, out: &mut Vec<u8>, extent: &mut (f32, f32)) {
    let v = sample.to_f64();
    match T::TYPE {
        ScalarType::U8 => out.push(v as u8),
        ScalarType::I8 => out.push((v + 128.0) as u8),
        ScalarType::U16 => out.extend((v as u16).to_le_bytes()),
        ScalarType::I16 => out.extend(((v + 32768.0) as u16).to_le_bytes()),
        _ => {
            let v = (v as f32).clamp(f32::MIN, f32::MAX);
            *extent = (extent.0.min(v), extent.1.max(v));
            out.extend(v.to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::solid::ScanSummary;

    #[test]
    fn codes_are_the_nearest_eighths_of_octaves() {
        for k in 1..4000_i16 {
            // Sizes over thirteen octaves, none on a bound.
            let size = (f32::from(k) * 0.003_3 - 6.5).exp2();
            let due = (8.0 * (f64::from(size).log2() + 127.0)).round();
            assert_eq!(f64::from(eighth(size)), due, "{size}");
            let of_code = size_of_eighth(u16::try_from(eighth(size)).unwrap());
            assert!((of_code / f64::from(size)).log2().abs() <= 0.062_6, "{size}");
        }
        assert_eq!([eighth(0.0), eighth(1e-39), eighth(1.0), eighth(f32::MAX)], [0, 0, 1016, 2040]);
        let form = ItemForm::octaves((1016.0, f32::NEG_INFINITY));
        let mut stored = Vec::new();
        form.store([&[0, 0xf8, 0xf9, 0xf6, 0xf8], &[0, 3, 3, 4, 7]], &mut stored);
        assert_eq!(stored, [0, 1, 2, 255, 255]);
        ItemForm::octaves(ScanSummary::default().extent).store([&[0], &[0]], &mut stored);
        assert_eq!(stored[5..], [0]);
    }
}
