//! The `value` channel: what the volume holds at each skin voxel.
//!
//! Types of 8 and 16 bits are stored as they are (shifted to unsigned), so the channel is lossless for
//! them. Wider types are swapped as singles and stored in 16 bits between the smallest and the largest
//! value found on the skin.

use super::range::Ordered;
use crate::volume::{Rescale, ScalarType};

/// Bytes of a value in the scratch file.
pub(super) fn swapped_bytes(scalar: ScalarType) -> usize {
    scalar.bytes().min(4)
}

/// Bytes of a value in the `.oct`.
pub(super) fn stored_bytes(scalar: ScalarType) -> usize {
    scalar.bytes().min(2)
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

/// Swapped values to stored values, and stored values to physical ones.
#[derive(Clone, Copy, Debug)]
pub(super) struct ValueScale {
    scalar: ScalarType,
    low: f64,
    step: f64,
}

impl ValueScale {
    /// The scale for samples of `scalar` whose wide values span `extent`.
    pub(super) fn new(scalar: ScalarType, extent: (f32, f32)) -> Self {
        let (low, high) = (f64::from(extent.0), f64::from(extent.1));
        let (low, step) = match scalar {
            ScalarType::U8 | ScalarType::U16 => (0.0, 1.0),
            ScalarType::I8 => (-128.0, 1.0),
            ScalarType::I16 => (-32768.0, 1.0),
            _ if high > low => (low, (high - low) / 65535.0),
            _ => (low, 1.0),
        };
        Self { scalar, low, step }
    }

    /// `[scale, offset]` of the metadata: physical = scale x stored + offset.
    pub(super) fn to_physical(self, rescale: Rescale) -> [f64; 2] {
        [rescale.slope * self.step, rescale.apply(self.low)]
    }

    /// Stored value of one swapped value.
    #[inline]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535")]
    pub(super) fn stored(&self, swapped: &[u8]) -> u16 {
        match *swapped {
            [v] => u16::from(v),
            [lo, hi] => u16::from_le_bytes([lo, hi]),
            [a, b, c, d] => {
                let v = f64::from(f32::from_le_bytes([a, b, c, d]));
                ((v - self.low) / self.step + 0.5).floor().clamp(0.0, 65535.0) as u16
            }
            _ => 0,
        }
    }

    /// Bytes of a swapped value.
    pub(super) fn swapped_bytes(&self) -> usize {
        swapped_bytes(self.scalar)
    }

    /// Bytes of a stored value.
    pub(super) fn stored_bytes(&self) -> usize {
        stored_bytes(self.scalar)
    }
}
