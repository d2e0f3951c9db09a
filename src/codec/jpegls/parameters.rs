//! The coding parameters of a scan: stated values, defaults, and values derived from them.

use crate::codec::{CodecError, damaged};

/// The values of a preset parameters segment (T.87 section C.2.4.1.1); 0 means the default.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Preset {
    pub(super) maximum: u32,
    pub(super) thresholds: [u32; 3],
    pub(super) reset: u32,
}

/// The parameters of decoding a scan, with the names of T.87 in brackets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Parameters {
    /// The largest sample (MAXVAL), at most 65535.
    pub(super) maximum: i32,
    /// The largest difference from the original (NEAR), 0 for lossless.
    pub(super) near: i32,
    /// Gradients at which the next class begins (T1, T2, T3).
    pub(super) thresholds: [i32; 3],
    /// Samples after which a context is halved (RESET).
    pub(super) reset: u32,
    /// Number of values of a prediction error (RANGE).
    pub(super) range: i32,
    /// Bits of a prediction error (qbpp).
    pub(super) error_bits: u32,
    /// The longest code word in bits (LIMIT).
    pub(super) limit: u32,
}

impl Parameters {
    /// Joins the stated values with the defaults (T.87 sections A.2.1, C.2.4.1.1).
    pub(super) fn new(precision: u8, near: u8, preset: &Preset) -> Result<Parameters, CodecError> {
        let wrong = |parameter, value: u32| {
            Err(damaged(format!("{parameter} {value} is not possible at {precision} bits")))
        };
        let largest = (1_u32 << precision.min(16)) - 1;
        let maximum = if preset.maximum == 0 { largest } else { preset.maximum };
        if maximum > largest {
            return wrong("the largest sample", maximum);
        }
        let near = u32::from(near);
        if near > maximum / 2 {
            return wrong("the error bound", near);
        }
        let mut thresholds = default_thresholds(maximum, near);
        let mut least = near + 1;
        for (threshold, &stated) in thresholds.iter_mut().zip(&preset.thresholds) {
            if stated != 0 {
                *threshold = stated;
            }
            if *threshold < least || *threshold > maximum {
                return wrong("the gradient threshold", *threshold);
            }
            least = *threshold;
        }
        let reset = if preset.reset == 0 { 64 } else { preset.reset };
        if reset < 3 || reset > maximum.max(255) {
            return wrong("the reset interval", reset);
        }
        let range = (maximum + 2 * near) / (2 * near + 1) + 1;
        let sample_bits = (maximum + 1).next_power_of_two().trailing_zeros().max(2);
        let signed = |value: u32| i32::try_from(value).unwrap_or(i32::MAX);
        Ok(Parameters {
            maximum: signed(maximum),
            near: signed(near),
            thresholds: thresholds.map(signed),
            reset,
            range: signed(range),
            error_bits: range.next_power_of_two().trailing_zeros(),
            limit: 2 * (sample_bits + sample_bits.max(8)),
        })
    }
}

/// The default thresholds (T.87 section C.2.4.1.1.1).
fn default_thresholds(maximum: u32, near: u32) -> [u32; 3] {
    let basic = if maximum >= 128 {
        let factor = (maximum.min(4095) + 128) / 256;
        [factor + 2 + 3 * near, 4 * factor + 3 + 5 * near, 17 * factor + 4 + 7 * near]
    } else {
        let factor = 256 / (maximum + 1);
        [(3 / factor + 3 * near).max(2), (7 / factor + 5 * near).max(3), (21 / factor + 7 * near).max(4)]
    };
    let mut least = near + 1;
    basic.map(|value| {
        // Out of bounds means the bound below, not the nearer one.
        least = if value < least || value > maximum { least } else { value };
        least
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_those_of_the_standard() {
        let of = |precision, near| Parameters::new(precision, near, &Preset::default()).unwrap();
        let eight = of(8, 0);
        assert_eq!((eight.maximum, eight.thresholds, eight.reset), (255, [3, 7, 21], 64));
        assert_eq!((eight.range, eight.error_bits, eight.limit), (256, 8, 32));
        assert_eq!(of(16, 0).thresholds, [18, 67, 276]);
        assert_eq!(of(16, 2).thresholds, [24, 77, 290]);
        assert_eq!((of(16, 0).error_bits, of(16, 0).limit), (16, 64));
        // Two bits: the least factor and the least length of code words.
        assert_eq!((of(2, 0).thresholds, of(2, 0).limit, of(2, 0).error_bits), ([2, 3, 3], 20, 2));
        let near = of(8, 3);
        assert_eq!((near.range, near.error_bits), (38, 6));
    }

    #[test]
    fn impossible_values_are_refused() {
        let with = |preset: Preset| Parameters::new(8, 0, &preset).is_err();
        assert!(with(Preset { maximum: 256, ..Preset::default() }));
        assert!(with(Preset { thresholds: [9, 8, 21], ..Preset::default() }));
        assert!(with(Preset { thresholds: [3, 7, 256], ..Preset::default() }));
        assert!(with(Preset { reset: 2, ..Preset::default() }));
        assert!(with(Preset { reset: 256, ..Preset::default() }));
        assert!(Parameters::new(8, 128, &Preset::default()).is_err());
        assert!(Parameters::new(8, 127, &Preset::default()).is_ok());
    }
}
