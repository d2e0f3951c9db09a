//! Colours as people write them.

use super::shown;

/// Names of CSS and their colours, two words each (CSS Color Module Level 4, section 6.1).
const NAMED: &str = include_str!("css_colors.txt");

/// sRGB of `#rrggbb`, or of a name of CSS such as `steelblue`, in any case.
///
/// # Errors
/// Any other text, as a sentence.
pub fn color(text: &str) -> Result<[u8; 3], String> {
    let named = || {
        let words: Vec<&str> = NAMED.split_whitespace().collect();
        words.chunks_exact(2).find(|pair| pair[0].eq_ignore_ascii_case(text)).map(|pair| pair[1])
    };
    let digits = text.strip_prefix('#').or_else(named);
    let digits = digits.filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
    let code = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok());
    let [_, r, g, b] = code
        .ok_or_else(|| {
            format!("'{}' is not a colour; write #rrggbb, such as '#f0f0f0', or a name of CSS", shown(text))
        })?
        .to_be_bytes();
    Ok([r, g, b])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_css_and_six_digits_are_colours() {
        assert_eq!(NAMED.split_whitespace().count(), 2 * 148);
        for (text, due) in [
            ("#F0e1d2", Some([0xf0, 0xe1, 0xd2])),
            ("aliceblue", Some([240, 248, 255])),
            ("SteelBlue", Some([70, 130, 180])),
            ("yellowgreen", Some([154, 205, 50])),
            ("f0f8ff", None),
            ("#fff", None),
            ("#+12345", None),
            ("bluish", None),
            ("", None),
        ] {
            assert_eq!(color(text).ok(), due, "{text}");
        }
    }
}
