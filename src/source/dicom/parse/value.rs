//! Values of elements by their representation (PS3.5 section 6.2).

use std::fmt::{self, Display, Formatter};

use crate::source::dicom::attribute::Attribute;
use crate::text::shown;
use crate::volume::Endian;

/// A tag: group in the high 16 bits, element in the low.
pub(crate) type Tag = u32;

/// One 16-bit number (VR US or a half of AT).
pub(super) fn word_of(value: &[u8], endian: Endian) -> Option<u16> {
    let bytes = *value.first_chunk::<2>()?;
    Some(if endian == Endian::Big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
}

/// One 32-bit number (VR UL).
pub(super) fn long_of(value: &[u8], endian: Endian) -> Option<u32> {
    let bytes = *value.first_chunk::<4>()?;
    Some(if endian == Endian::Big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
}

/// Text without padding; bytes outside ASCII become `?` (no kept element may have any).
pub(crate) fn text(value: &[u8]) -> String {
    let plain: String = value
        .iter()
        .map(|b| if b.is_ascii_graphic() || *b == b' ' || *b == 0 { char::from(*b) } else { '?' })
        .collect();
    plain.trim_matches([' ', '\0']).into()
}

/// One finite decimal; the first of several.
pub(crate) fn number(value: &[u8]) -> Option<f64> {
    text(value).split('\\').next().and_then(decimal)
}

/// A finite decimal, whose comma counts as a point.
fn decimal(part: &str) -> Option<f64> {
    let read = |part: &str| part.parse().ok().filter(|v: &f64| v.is_finite());
    let part = part.trim();
    read(part).or_else(|| read(&part.replacen(',', ".", 1)))
}

/// The numbers that an attribute states.
pub(super) struct Stated {
    pub(super) attribute: Attribute,
    /// Number of values; `None` for any.
    pub(super) count: Option<usize>,
    /// True if the numbers are whole.
    pub(super) whole: bool,
}

impl Stated {
    /// Judges a value as text: a wrong one is not a missing one.
    pub(super) fn judge(&self, value: &[u8]) -> Judgement {
        let text = text(value);
        let parts: Vec<&str> = text.split('\\').map(str::trim).collect();
        if parts.iter().all(|part| part.is_empty()) {
            return Judgement::Sound;
        }
        let sound = |part: &&str| decimal(part).is_some_and(|v| !self.whole || v.fract() == 0.0);
        if self.count.is_some_and(|count| count != parts.len()) || !parts.iter().all(sound) {
            return Judgement::Wrong(self.wrong(&text));
        }
        if text.contains(',') { Judgement::Comma(self.attribute) } else { Judgement::Sound }
    }

    /// Judges binary doubles.
    pub(super) fn judge_doubles(&self, value: &[u8], endian: Endian) -> Judgement {
        let numbers: Vec<f64> = value.chunks_exact(8).filter_map(|b| raw_double(b, endian)).collect();
        if value.is_empty()
            || 8 * self.count.unwrap_or_default() == value.len() && numbers.iter().all(|v| v.is_finite())
        {
            return Judgement::Sound;
        }
        let text: Vec<String> = numbers.iter().map(f64::to_string).collect();
        Judgement::Wrong(self.wrong(&text.join("\\")))
    }

    pub(super) fn wrong(&self, text: &str) -> WrongNumbers {
        const SHOWN: usize = 64;
        WrongNumbers {
            attribute: self.attribute,
            text: text.chars().take(SHOWN).collect(),
            count: self.count,
        }
    }
}

/// Verdict on the value of an attribute that states numbers.
pub(super) enum Judgement {
    Sound,
    /// Stated with decimal commas.
    Comma(Attribute),
    Wrong(WrongNumbers),
}

/// A value of an attribute that states something else than its numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrongNumbers {
    attribute: Attribute,
    text: String,
    count: Option<usize>,
}

impl Display for WrongNumbers {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "its {} is `{}`, which is infinite or not a number", self.attribute, shown(&self.text))?;
        if let Some(count) = self.count.filter(|count| *count > 1) {
            write!(f, ", or not {count} of them")?;
        }
        f.write_str("; correct the header")
    }
}

/// The time of day of a date and time (VR DT), as the number HHMMSS.FFFFFF.
pub(crate) fn time_of(value: &[u8]) -> Option<f64> {
    const DATE: usize = 8;
    let text = text(value);
    let end = text.find(['+', '-']).unwrap_or(text.len());
    text.get(DATE..end)?.parse().ok().filter(|v: &f64| v.is_finite())
}

/// One integer; the first of several.
pub(crate) fn integer(value: &[u8]) -> Option<i32> {
    let whole = |v: &f64| v.fract() == 0.0 && (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(v);
    #[expect(clippy::cast_possible_truncation, reason = "whole and in range")]
    number(value).filter(whole).map(|v| v as i32)
}

/// One finite binary double (VR FD).
pub(crate) fn double(value: &[u8], endian: Endian) -> Option<f64> {
    raw_double(value, endian).filter(|v| v.is_finite())
}

/// One binary double, finite or not.
pub(super) fn raw_double(value: &[u8], endian: Endian) -> Option<f64> {
    let bytes = *value.first_chunk::<8>()?;
    Some(if endian == Endian::Big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
}

/// Three finite binary doubles.
pub(super) fn doubles(value: &[u8], endian: Endian) -> Option<[f64; 3]> {
    let at = |i: usize| double(value.get(8 * i..)?, endian);
    Some([at(0)?, at(1)?, at(2)?])
}

/// One finite binary single (VR FL).
pub(super) fn single(value: &[u8], endian: Endian) -> Option<f64> {
    raw_single(value, endian).filter(|v| v.is_finite())
}

/// One binary single, finite or not.
pub(super) fn raw_single(value: &[u8], endian: Endian) -> Option<f64> {
    let bytes = *value.first_chunk::<4>()?;
    Some(if endian == Endian::Big { f32::from_be_bytes(bytes) } else { f32::from_le_bytes(bytes) }.into())
}

/// Exactly `N` finite decimals separated by backslashes.
pub(crate) fn numbers<const N: usize>(value: &[u8]) -> Option<[f64; N]> {
    let text = text(value);
    let mut parts = text.split('\\').map(decimal);
    let mut out = [0.0; N];
    for slot in &mut out {
        *slot = parts.next()??;
    }
    parts.next().is_none().then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_parse_or_are_missing() {
        assert_eq!(numbers::<3>(b"1\\-2.5e1\\ 3 "), Some([1.0, -25.0, 3.0]));
        for bad in [&b"1\\2"[..], b"1\\2\\3\\4", b"1\\\\3", b"1\\nan\\3", b"1\\inf\\3", b"", b"\xff\\1\\2"] {
            assert_eq!(numbers::<3>(bad), None, "{bad:?}");
        }
        let spacing = Stated { attribute: Attribute::PixelSpacing, count: Some(2), whole: false };
        for wrong in [
            &b"nan"[..],
            b"1\\inf",
            b"1\\-Infinity ",
            b"1e999\\1",
            b"NaN\0",
            b"1\\\\",
            b"none",
            b"1\\2\\3",
            b"1",
            b"1.5,2\\1",
            b"1,5,2\\1",
        ] {
            let judgement = spacing.judge(wrong);
            assert!(matches!(judgement, Judgement::Wrong(_)) && numbers::<2>(wrong).is_none(), "{wrong:?}");
        }
        assert!(
            [&b"1\\2"[..], b"", b"\\", b" \0"].iter().all(|v| matches!(spacing.judge(v), Judgement::Sound))
        );
        assert!(matches!(spacing.judge(b"0,5\\1"), Judgement::Comma(_)));
        assert_eq!(numbers::<2>(b"-0,5\\,25"), Some([-0.5, 0.25]));
        let instance = Stated { attribute: Attribute::InstanceNumber, count: Some(1), whole: true };
        assert!(
            matches!(instance.judge(b"1.5"), Judgement::Wrong(_))
                && matches!(instance.judge(b"12.0"), Judgement::Sound)
        );
        assert_eq!(
            (integer(b"12.0 "), integer(b"-7"), integer(b"1.5"), integer(b"9e9")),
            (Some(12), Some(-7), None, None)
        );
        assert_eq!(number(b" -1024\0"), Some(-1024.0));
        assert_eq!(text(b"MONOCHROME2 \0"), "MONOCHROME2");
    }
}
