//! Values of elements by their representation (PS3.5 section 6.2).

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
    text(value).split('\\').next().and_then(|part| part.trim().parse().ok()).filter(|v: &f64| v.is_finite())
}

/// Is one of several decimals infinite, or NaN? That is not a missing value, but a wrong one.
pub(super) fn is_not_finite(value: &[u8]) -> bool {
    text(value).split('\\').any(|part| part.trim().parse::<f64>().is_ok_and(|v| !v.is_finite()))
}

/// Is one of several binary doubles infinite, or NaN?
pub(super) fn are_not_finite(value: &[u8], endian: Endian) -> bool {
    value.chunks_exact(8).any(|bytes| raw_double(bytes, endian).is_some_and(|v| !v.is_finite()))
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
    text(value).split('\\').next().and_then(|part| part.trim().parse().ok())
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
    let mut parts = text.split('\\').map(|part| part.trim().parse::<f64>().ok().filter(|v| v.is_finite()));
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
        for wrong in [&b"nan"[..], b"1\\inf\\3", b"1\\-Infinity ", b"1e999", b"NaN\0"] {
            assert!(is_not_finite(wrong) && numbers::<3>(wrong).is_none(), "{wrong:?}");
        }
        assert!(!is_not_finite(b"1\\\\3") && !is_not_finite(b"") && !is_not_finite(b"none"));
        assert_eq!(number(b" -1024\0"), Some(-1024.0));
        assert_eq!(text(b"MONOCHROME2 \0"), "MONOCHROME2");
    }
}
