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
    /// Singles (little-endian), stored as numbers of eighths of an octave above the lowest: 1 is the lowest, 0 means
    /// absent.
    Octaves {
        /// Value of number 1.
        low: f64,
    },
}

/// Powers of two at odd sixteenths: the bounds between eighths of an octave.
const EIGHTHS: [f64; 8] = [
    1.044_273_782_427_413_8,
    1.138_788_634_756_691_6,
    1.241_857_812_073_484,
    1.354_255_546_936_892_7,
    1.476_826_145_939_499_3,
    1.610_490_331_949_254_3,
    1.756_252_160_373_299_5,
    1.915_206_561_397_147_3,
];

/// The number of a size, in eighths of an octave above the lowest.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 1..=255")]
fn octaves(size: f64, low: f64) -> u8 {
    let above = size / low;
    if !(above.is_normal() && above > 0.0) {
        return 0;
    }
    // By bits, which gives the same result on every machine.
    let octave = (above.to_bits() >> 52 & 0x7ff) as i32 - 1023;
    let mantissa = f64::from_bits(above.to_bits() & ((1 << 52) - 1) | 1023 << 52);
    let eighth = EIGHTHS.iter().filter(|bound| mantissa >= **bound).count() as i32;
    (8 * octave + eighth + 1).clamp(1, 255) as u8
}

impl ItemForm {
    /// The form that spreads singles of `extent` over 16 bits.
    pub(crate) fn scaled(extent: (f32, f32)) -> Self {
        let (low, high) = (f64::from(extent.0), f64::from(extent.1));
        Self::Scaled { low, step: if high > low { (high - low) / 65535.0 } else { 1.0 } }
    }

    /// Bytes of an item in the scratch file.
    pub(crate) fn swapped_bytes(self) -> usize {
        match self {
            Self::AsIs { bytes } => bytes,
            Self::Scaled { .. } | Self::Octaves { .. } => size_of::<f32>(),
        }
    }

    /// Bytes of an item in the model.
    pub(crate) fn stored_bytes(self) -> usize {
        match self {
            Self::AsIs { bytes } => bytes,
            Self::Scaled { .. } => size_of::<u16>(),
            Self::Octaves { .. } => 1,
        }
    }

    /// Appends the stored form of swapped items.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535")]
    pub(super) fn store(self, swapped: &[u8], out: &mut Vec<u8>) {
        match self {
            Self::AsIs { .. } => out.extend_from_slice(swapped),
            Self::Scaled { low, step } => {
                out.extend(swapped.as_chunks::<4>().0.iter().flat_map(|single| {
                    let v = f64::from(f32::from_le_bytes(*single));
                    let number = ((v - low) / step + 0.5).floor().clamp(0.0, 65535.0) as u16;
                    number.to_le_bytes()
                }));
            }
            Self::Octaves { low } => out.extend(
                swapped.as_chunks().0.iter().map(|single| octaves(f32::from_le_bytes(*single).into(), low)),
            ),
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
