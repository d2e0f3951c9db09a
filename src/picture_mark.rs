//! The mark in every picture of a model, which distinguishes such a picture from a slice of a volume,
//! under any name and in any folder.

/// Keyword of the PNG text chunk: the standard's own for the program that made a picture.
pub(crate) const KEYWORD: &str = "Software";

/// The text: the same for every version, so that equal pictures are equal files.
pub(crate) const PROGRAM: &str = "infobyte";

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// True if a PNG with these first bytes states that this program made it.
///
/// Searches the chunks before the pixels, as far as they are within `head`.
pub(crate) fn is_own_picture(head: &[u8]) -> bool {
    let Some(mut rest) = head.strip_prefix(SIGNATURE) else { return false };
    while let Some((chunk, after)) = rest.split_first_chunk::<8>() {
        let [a, b, c, d, kind @ ..] = *chunk;
        let Ok(length) = usize::try_from(u32::from_be_bytes([a, b, c, d])) else { return false };
        let Some(data) = after.get(..length).filter(|_| &kind != b"IDAT") else { return false };
        if &kind == b"tEXt" && data.split(|byte| *byte == 0).eq([KEYWORD.as_bytes(), PROGRAM.as_bytes()]) {
            return true;
        }
        // A checksum follows the data.
        rest = after.get(length..).and_then(|rest| rest.get(4..)).unwrap_or_default();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mark_is_found_in_the_chunks_before_the_pixels() {
        let chunk = |kind: &[u8; 4], data: &[u8]| {
            let length = u32::try_from(data.len()).unwrap().to_be_bytes();
            [&length[..], kind, data, &[0; 4]].concat()
        };
        let of = |chunks: &[Vec<u8>]| [SIGNATURE, &chunks.concat()].concat();
        let (header, pixels) = (chunk(b"IHDR", &[0; 13]), chunk(b"IDAT", &[1, 2, 3]));
        let mark = chunk(b"tEXt", b"Software\0infobyte");
        assert!(is_own_picture(&of(&[header.clone(), mark.clone(), pixels.clone()])));
        let others = [b"Software\0infobytes".as_slice(), b"Software", b"Title\0infobyte", b""];
        for other in others.map(|text| chunk(b"tEXt", text)) {
            assert!(!is_own_picture(&of(&[header.clone(), other.clone(), pixels.clone()])));
            assert!(is_own_picture(&of(&[header.clone(), other, mark.clone(), pixels.clone()])));
        }
        assert!(!is_own_picture(&of(&[header.clone(), pixels.clone(), mark.clone()])));
        let whole = of(&[header, mark]);
        for end in 0..whole.len() {
            // The checksum is not needed.
            assert_eq!(is_own_picture(&whole[..end]), end + 4 >= whole.len(), "{end}");
        }
        assert!(!is_own_picture(&of(&[u32::MAX.to_be_bytes().to_vec(), b"tEXt".to_vec()])));
    }
}
