//! The encoding of text files: a UTF-8 byte order mark is dropped, UTF-16 is named.

use std::borrow::Cow;
use std::fmt;

/// The fault of a text in UTF-16.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Utf16;

impl fmt::Display for Utf16 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("is text in UTF-16, which is not read; save it as UTF-8")
    }
}

/// Bytes of the UTF-8 byte order mark before a text that begins with `head` (8 bytes are enough): 3 or 0.
///
/// # Errors
/// The text is UTF-16.
pub(crate) fn mark_bytes(head: &[u8]) -> Result<usize, Utf16> {
    match head {
        [0xef, 0xbb, 0xbf, ..] => Ok(3),
        _ if first_wide(head).is_some() => Err(Utf16),
        _ => Ok(0),
    }
}

/// The first bytes of a file as its format states them: without a mark, and one byte for each character of UTF-16, so
/// that the format's reader is found and can refuse it.
pub(crate) fn plain_head(head: &[u8]) -> Cow<'_, [u8]> {
    match first_wide(head) {
        Some(at) => head.iter().skip(at).step_by(2).copied().collect(),
        None => Cow::Borrowed(head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head)),
    }
}

/// The first low byte of a text in UTF-16 that begins with plain characters, with or without a mark.
fn first_wide(head: &[u8]) -> Option<usize> {
    let plain = |low: &u8, high: &u8| *high == 0 && matches!(low, b'\t'..=b'\r' | b' '..=b'~');
    match head {
        [0xff, 0xfe, low, high, ..] if plain(low, high) => Some(2),
        [0xfe, 0xff, high, low, ..] if plain(low, high) => Some(3),
        [a, b, c, d, e, f, ..] if plain(a, b) && plain(c, d) && plain(e, f) => Some(0),
        [a, b, c, d, e, f, ..] if plain(b, a) && plain(d, c) && plain(f, e) => Some(1),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_dropped_and_utf_16_is_named() {
        let wide = |text: &str, mark: &[u8], bytes: fn(u16) -> [u8; 2]| {
            [mark, &text.encode_utf16().flat_map(bytes).collect::<Vec<u8>>()].concat()
        };
        for (head, mark, plain) in [
            (b"v 1 2".to_vec(), Ok(0), "v 1 2"),
            (b"\xef\xbb\xbfv 1".to_vec(), Ok(3), "v 1"),
            (wide("NRRD", b"\xff\xfe", u16::to_le_bytes), Err(Utf16), "NRRD"),
            (wide("NRRD", b"\xfe\xff", u16::to_be_bytes), Err(Utf16), "NRRD"),
            (wide("NRRD", b"", u16::to_le_bytes), Err(Utf16), "NRRD"),
            (wide("NRRD", b"", u16::to_be_bytes), Err(Utf16), "NRRD"),
            (b"@\0\0\0@\0\0\0".to_vec(), Ok(0), "@\0\0\0@\0\0\0"),
            (Vec::new(), Ok(0), ""),
        ] {
            assert_eq!((mark_bytes(&head), &*plain_head(&head)), (mark, plain.as_bytes()));
        }
    }
}
