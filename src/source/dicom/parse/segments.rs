//! Segments of a segmentation: number, meaning and colour (PS3.3 C.8.20.4).

use super::Result;
use super::deflated::InflateReader;
use super::element::{Element, Parser};
use super::header::{DicomHeader, Encoding};
use super::value::{Tag, word_of};
use super::window::ReadAt;
use crate::source::dicom::parse::syntax::TransferSyntax;
use crate::volume::{Endian, StatedLabel};

/// Most segments that are read; each takes some 200 bytes.
const MAX_SEGMENTS: usize = 4096;
const MEANING: Tag = 0x0008_0104;
const TYPE: Tag = 0x0062_000f;
const TYPE_MODIFIER: Tag = 0x0062_0011;

/// The segments that a file describes, by their numbers; none for a file without a Segment Sequence (0062,0002).
///
/// A segment's name is the coded meaning of its type, after the meaning of the type's modifier ("Right Kidney"); its
/// label, which is free text, is kept apart.
///
/// # Errors
/// The sequence is damaged, or the file cannot be read.
pub(crate) fn segments<R: ReadAt + ?Sized>(input: &R, header: &DicomHeader) -> Result<Vec<StatedLabel>> {
    let Some(at) = header.offsets.segments else { return Ok(Vec::new()) };
    let mut found = match header.transfer_syntax == TransferSyntax::Deflated {
        true => read(&InflateReader::new(input, header.dataset)?, at, header.encoding)?,
        false => read(input, at, header.encoding)?,
    };
    crate::order::by_key(&mut found, |segment| segment.number);
    found.dedup_by_key(|segment| segment.number);
    Ok(found)
}

fn read<R: ReadAt + ?Sized>(input: &R, at: u64, encoding: Encoding) -> Result<Vec<StatedLabel>> {
    let mut parser = Parser::new(input)?;
    let mut found: Vec<StatedLabel> = Vec::new();
    let sequence = parser.element(at, encoding)?;
    parser.items(&sequence, at, encoding, &mut |parser, at, end, encoding| {
        let mut segment = StatedLabel::default();
        let after = parser.elements(at, end, encoding, &mut |parser, element, at| {
            if element.tag == TYPE {
                let (meaning, after) = meaning(parser, element, at, encoding, true)?;
                segment.name = meaning;
                return Ok(Some(after));
            }
            let value = parser.value(element)?;
            match element.tag {
                0x0062_0004 => segment.number = word_of(value, encoding.endian).unwrap_or(0),
                0x0062_0005 => segment.typed = words(value),
                0x0062_000d => segment.color = color(value, encoding.endian),
                _ => {}
            }
            Ok(None)
        })?;
        if segment.number > 0 && found.len() < MAX_SEGMENTS {
            found.push(segment);
        }
        Ok(after)
    })?;
    Ok(found)
}

/// Meanings of the codes of a sequence, one after the other, each after its modifiers where these are asked for; and
/// the offset after the sequence.
fn meaning<'a, R: ReadAt + ?Sized>(
    parser: &mut Parser<'a, R>,
    sequence: &Element,
    at: u64,
    encoding: Encoding,
    modified: bool,
) -> Result<(String, u64)> {
    let mut all: Vec<String> = Vec::new();
    let after = parser.items(sequence, at, encoding, &mut |parser, at, end, encoding| {
        let (mut own, mut modifier) = (String::new(), String::new());
        let after = parser.elements(at, end, encoding, &mut |parser, element, at| {
            match element.tag {
                MEANING => own = words(parser.value(element)?),
                TYPE_MODIFIER if modified => {
                    let (meaning, after) = meaning(parser, element, at, encoding, false)?;
                    modifier = meaning;
                    return Ok(Some(after));
                }
                _ => {}
            }
            Ok(None)
        })?;
        all.extend([modifier, own].into_iter().filter(|word| !word.is_empty()));
        Ok(after)
    })?;
    Ok((all.join(" "), after))
}

/// Text without padding and control characters.
fn words(value: &[u8]) -> String {
    let text = String::from_utf8_lossy(value);
    text.chars().filter(|c| !c.is_control()).collect::<String>().trim().to_owned()
}

/// sRGB of a Recommended Display CIELab Value: L, a and b in 16 bits each, in the profile connection space of ICC,
/// whose white is D50 (PS3.3 C.10.7.1.1, PS3.4 N.2.2.2). DCMTK and programs built on it take D65 for that white, so
/// that their saturated colours come out a little different: the red of a pure blue may be 60 of 255, not 0.
fn color(value: &[u8], endian: Endian) -> Option<[u8; 3]> {
    let part = |i: usize| value.get(2 * i..).and_then(|v| word_of(v, endian)).map(f64::from);
    let lightness = part(0)? / 65_535.0 * 100.0;
    let [a, b] = [part(1)?, part(2)?].map(|v| v / 65_535.0 * 255.0 - 128.0);
    // CIE 15: the inverse of L*, a*, b*, and the white of D50.
    let y = (lightness + 16.0) / 116.0;
    let cube =
        |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (t - 4.0 / 29.0) };
    let [x, y, z] = [0.96422 * cube(y + a / 500.0), cube(y), 0.82521 * cube(y - b / 200.0)];
    // sRGB's primaries, brought to D50 by Bradford's matrix.
    let linear = [
        3.133_856_1 * x - 1.616_866_7 * y - 0.490_614_6 * z,
        -0.978_768_4 * x + 1.916_141_5 * y + 0.033_454 * z,
        0.071_945_3 * x - 0.228_991_4 * y + 1.405_242_7 * z,
    ];
    Some(linear.map(|c| {
        let coded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let byte = (coded.clamp(0.0, 1.0) * 255.0).round() as u8;
        byte
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of L*, a*, b* relative to D50 from Lindbloom's calculator, for sRGB by Bradford.
    #[test]
    fn colours_are_those_of_the_profile_connection_space() {
        for (lab, rgb) in [
            ([0.0, 0.0, 0.0], [0, 0, 0]),
            ([100.0, 0.0, 0.0], [255, 255, 255]),
            ([53.389, 0.0, 0.0], [127, 127, 127]),
            ([54.2917, 80.8125, 69.8851], [255, 0, 0]),
            ([87.8181, -79.2873, 80.9902], [0, 255, 0]),
            ([29.5676, 68.2986, -112.0294], [0, 0, 255]),
        ] {
            let [l, a, b] = lab;
            let scaled = [l / 100.0, (a + 128.0) / 255.0, (b + 128.0) / 255.0].map(|v: f64| v * 65_535.0);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65535")]
            let bytes: Vec<u8> = scaled.iter().flat_map(|v| (v.round() as u16).to_be_bytes()).collect();
            let found = color(&bytes, Endian::Big).unwrap();
            let near = found.iter().zip(rgb).all(|(found, due)| found.abs_diff(due) <= 1);
            assert!(near, "{lab:?}: {found:?}, not {rgb:?}");
        }
        assert_eq!(color(&[0; 5], Endian::Little), None);
    }
}
