//! Letters for text in pictures: outlines of the embedded font, as coverage of pixels.
//!
//! The font is a part of DejaVu Sans Condensed: Latin, Greek and Cyrillic (`letters/LICENSE`).

use ab_glyph::{Font, FontRef, Glyph, PxScaleFont, ScaleFont, point};

static FILE: &[u8] = include_bytes!("letters/letters.ttf");

/// Replacement for omitted letters.
const CUT: char = '…';

/// The font at a size.
pub(super) struct Letters(PxScaleFont<FontRef<'static>>);

impl Letters {
    /// The font at a size in pixels per em.
    pub(super) fn new(size: f64) -> Option<Self> {
        let font = FontRef::try_from_slice(FILE).ok()?;
        #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
        let scale = size as f32 * font.height_unscaled() / font.units_per_em()?;
        Some(Self(font.into_scaled(scale)))
    }

    /// Width of a text in pixels.
    pub(super) fn width(&self, text: &str) -> f64 {
        text.chars().map(|c| f64::from(self.0.h_advance(self.0.glyph_id(c)))).sum()
    }

    /// True if the font has all letters of a text.
    pub(super) fn knows(&self, text: &str) -> bool {
        text.chars().all(|c| self.0.glyph_id(c).0 != 0)
    }

    /// A text cut to a width in pixels.
    pub(super) fn cut(&self, text: &str, most: f64) -> String {
        if self.width(text) <= most {
            return text.to_owned();
        }
        let mut room = most - self.width(CUT.encode_utf8(&mut [0; 4]));
        let fits = |c: &char| {
            room -= f64::from(self.0.h_advance(self.0.glyph_id(*c)));
            room >= 0.0
        };
        let mut kept = text.chars().take_while(fits).collect::<String>().trim_end().to_owned();
        kept.push(CUT);
        kept
    }

    /// Calls `put` with the covered part of each pixel of a text that begins at x on the baseline y.
    pub(super) fn cover(&self, text: &str, [x, y]: [f64; 2], put: &mut dyn FnMut([i64; 2], f32)) {
        #[expect(clippy::cast_possible_truncation, reason = "places in a picture")]
        let (mut x, y) = (x as f32, y.round() as f32);
        for letter in text.chars() {
            let id = self.0.glyph_id(letter);
            let glyph = Glyph { id, scale: self.0.scale(), position: point(x, y) };
            x += self.0.h_advance(id);
            let Some(outline) = self.0.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            #[expect(clippy::cast_possible_truncation, reason = "whole pixels of a picture")]
            let [left, top] = [corner.x as i64, corner.y as i64];
            outline.draw(|x, y, part| put([left + i64::from(x), top + i64::from(y)], part.min(1.0)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ink is within the text's width and above its baseline except for descenders; an I has the width of its stem
    /// everywhere.
    #[test]
    fn letters_are_where_they_are_written() {
        let letters = Letters::new(40.0).unwrap();
        assert!(
            letters.knows("Left kidney, 12.5 mm³ × µ — Ärztin Ñandú łąka Ω жук (x/y) #3")
                && !letters.knows("腎")
        );
        let (mut sum, mut low, mut high) = (0.0, [i64::MAX; 2], [i64::MIN; 2]);
        letters.cover("IIII", [10.0, 50.0], &mut |at, part| {
            if part > 0.0 {
                (low, high) = ([0, 1].map(|a| low[a].min(at[a])), [0, 1].map(|a| high[a].max(at[a])));
            }
            sum += f64::from(part);
        });
        let end = 10.0 + letters.width("IIII");
        assert!(low[0] >= 10 && (high[0] as f64) < end && high[1] == 49, "{low:?} {high:?} {end}");
        // Capitals are .729 of an em high, and their stems .0884 wide.
        let inked = 4.0 * 0.729 * 40.0 * 0.0884 * 40.0;
        assert!((sum / inked - 1.0).abs() < 0.02, "{sum} {inked}");
        assert_eq!(letters.cut("Hippocampus", 1e9), "Hippocampus");
        let cut = letters.cut("Hippocampus", 120.0);
        assert!(cut.starts_with("Hip") && cut.ends_with(CUT) && letters.width(&cut) <= 120.0, "{cut}");
    }
}
