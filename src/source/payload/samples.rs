//! Samples as stored and as delivered.

use crate::volume::{Endian, Note, ScalarType};

/// Type of a stored sample: delivered unchanged, or converted to a float.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::source) enum Samples {
    /// A sample that is delivered unchanged.
    Plain(ScalarType),
    /// Signed 64 bits, delivered as doubles: exact up to 2^53, rounded beyond.
    I64,
    /// Unsigned 64 bits, delivered like `I64`.
    U64,
    /// IEEE half, delivered as singles: always exact.
    F16,
}

impl Samples {
    /// Bytes per stored sample.
    pub(in crate::source) fn bytes(self) -> usize {
        match self {
            Self::Plain(scalar) => scalar.bytes(),
            Self::I64 | Self::U64 => 8,
            Self::F16 => 2,
        }
    }

    /// Type of the delivered samples.
    pub(in crate::source) fn delivered(self) -> ScalarType {
        match self {
            Self::Plain(scalar) => scalar,
            Self::I64 | Self::U64 => ScalarType::F64,
            Self::F16 => ScalarType::F32,
        }
    }

    /// A note where the delivered type is another.
    pub(in crate::source) fn note(self) -> Option<Note> {
        matches!(self, Self::I64 | Self::U64)
            .then_some(Note::new("64-bit integers are read as double precision, which is exact up to 2^53"))
    }

    /// Turns stored samples into delivered ones in place. The stored ones are at the end of `bytes`, which
    /// is as long as the delivered ones.
    pub(in crate::source) fn deliver(self, endian: Endian, bytes: &mut [u8]) {
        match self {
            Self::Plain(scalar) => endian.to_native(scalar.bytes(), bytes),
            Self::I64 | Self::U64 => {
                endian.to_native(8, bytes);
                for sample in bytes.as_chunks_mut::<8>().0 {
                    let value = match self {
                        Self::I64 => bytemuck::cast::<[u8; 8], i64>(*sample) as f64,
                        _ => bytemuck::cast::<[u8; 8], u64>(*sample) as f64,
                    };
                    *sample = bytemuck::cast(value);
                }
            }
            Self::F16 => {
                let count = bytes.len() / 4;
                let tail = count * 2;
                endian.to_native(2, bytes.get_mut(tail..).unwrap_or_default());
                // Front to back: sample i is read at 2 * (count + i), before 4 * i + 4 reaches beyond it.
                for i in 0..count {
                    let from = tail + 2 * i;
                    let Some(half) = bytes.get(from..from + 2) else { return };
                    let value = single(bytemuck::pod_read_unaligned(half));
                    if let Some(out) = bytes.get_mut(4 * i..4 * i + 4) {
                        out.copy_from_slice(bytemuck::bytes_of(&value));
                    }
                }
            }
        }
    }
}

/// The value of an IEEE half-precision number.
fn single(half: u16) -> f32 {
    let sign = u32::from(half >> 15) << 31;
    let exponent = u32::from(half >> 10) & 0x1f;
    let fraction = u32::from(half) & 0x3ff;
    match exponent {
        // Subnormal: a multiple of 2^-24, which a single holds exactly.
        0 => {
            let size = fraction as f32 / 16_777_216.0;
            if sign == 0 { size } else { -size }
        }
        31 => f32::from_bits(sign | 0x7f80_0000 | (fraction << 13)),
        _ => f32::from_bits(sign | ((exponent + 112) << 23) | (fraction << 13)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_become_the_singles_that_they_mean() {
        for (half, value) in [
            (0x0000_u16, 0.0_f32),
            (0x8000, -0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 6.103_515_6e-5),
            (0x0001, 5.960_464_5e-8),
            (0x83ff, -6.097_555e-5),
            (0x3555, 0.333_251_95),
            (0x7c00, f32::INFINITY),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(single(half).to_bits(), value.to_bits(), "{half:04x}");
        }
        assert!(single(0x7e00).is_nan());
        let mut bytes = vec![0; 12];
        bytes[6..].copy_from_slice(&[0x3c, 0x00, 0xc0, 0x00, 0x55, 0x35]);
        bytes[10..].copy_from_slice(&[0x35, 0x55]);
        Samples::F16.deliver(Endian::Big, &mut bytes);
        let values: Vec<f32> = bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        assert_eq!(values, [1.0, -2.0, 0.333_251_95]);
    }

    #[test]
    fn long_integers_become_doubles() {
        for (samples, value, expected) in [
            (Samples::I64, (-5_i64).cast_unsigned(), -5.0),
            (Samples::U64, 1 << 63, 9_223_372_036_854_775_808.0),
            (Samples::U64, (1 << 53) - 1, 9_007_199_254_740_991.0),
        ] {
            for endian in [Endian::Little, Endian::Big] {
                let mut bytes =
                    if endian == Endian::Little { value.to_le_bytes() } else { value.to_be_bytes() };
                samples.deliver(endian, &mut bytes);
                assert_eq!(bytemuck::cast::<[u8; 8], f64>(bytes), expected);
            }
        }
    }
}
