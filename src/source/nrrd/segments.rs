//! Segments of a `.seg.nrrd`: names, colours, numbers and layers, in pairs of keys and values as 3D Slicer writes them
//! (`Segment0_Name:=liver`; <https://slicer.readthedocs.io>, "Segmentations", file format).

use std::collections::BTreeMap;

use crate::fault::{Fault, bad};
use crate::source::header::{exactly, number};
use crate::text::Count;
use crate::volume::{Note, StatedLabel};

/// Most segments that are taken: as many as numbers of labels.
const MAX_SEGMENTS: usize = 1 << 16;

/// One segment, as far as the header states it.
#[derive(Debug, Default)]
struct Segment {
    name: String,
    /// The meaning of its code.
    coded: String,
    color: Option<[u8; 3]>,
    number: Option<u16>,
    layer: u64,
    /// True for each key that was stated.
    seen: [bool; KEYS.len()],
}

/// Keys of a segment that are read.
const KEYS: [&str; 5] = ["name", "color", "labelvalue", "layer", "tags"];

/// The segments of a header, by their places in it.
#[derive(Debug, Default)]
pub(super) struct Segments {
    by_place: BTreeMap<u32, Segment>,
    /// True if the header declares a segmentation.
    is_stated: bool,
    /// The first colour that is none, and the number of such.
    wrong_color: Option<String>,
    wrong_colors: usize,
}

/// A segment of several layers: its layer, its value there, and the number of its label.
pub(super) type Layered = (u64, u16, u16);

impl Segments {
    /// Takes a pair, its key in lower case; pairs about other things are passed over.
    ///
    /// # Errors
    /// The text of a number is not a number, or the key was stated before.
    pub(super) fn pair(&mut self, key: &str, value: &str) -> Result<(), Fault> {
        self.is_stated |= key.starts_with("segmentation_");
        let Some((place, what)) = key.strip_prefix("segment").and_then(|rest| rest.split_once('_')) else {
            return Ok(());
        };
        let Ok(place) = place.parse() else { return Ok(()) };
        let Some(at) = KEYS.iter().position(|key| *key == what) else { return Ok(()) };
        if self.by_place.len() >= MAX_SEGMENTS && !self.by_place.contains_key(&place) {
            return Ok(());
        }
        self.is_stated = true;
        let segment = self.by_place.entry(place).or_default();
        if std::mem::replace(&mut segment.seen[at], true) {
            return Err(bad!("its header states `{}` twice; remove the wrong line", key.escape_debug()));
        }
        match what {
            "name" => value.clone_into(&mut segment.name),
            "tags" => segment.coded = meaning(value).unwrap_or_default(),
            "color" => {
                segment.color = color(exactly(key, value)?);
                if segment.color.is_none() {
                    self.wrong_color.get_or_insert_with(|| format!("`{value}` for {key}"));
                    self.wrong_colors += 1;
                }
            }
            "layer" => segment.layer = number(key, value)?,
            _ => segment.number = Some(number(key, value)?).filter(|number| *number > 0),
        }
        Ok(())
    }

    /// True for the header of a segmentation.
    pub(super) fn is_stated(&self) -> bool {
        self.is_stated
    }

    /// A note on colours that are none.
    pub(super) fn note(&self) -> Option<Note> {
        let first = self.wrong_color.as_ref()?;
        Some(Note::new(format!(
            "the header states {} outside 0 to 1, the first {}; labels without a colour take one of the program",
            Count(self.wrong_colors, "colour"),
            first.escape_debug()
        )))
    }

    /// The segments that have a number, in its order.
    ///
    /// # Errors
    /// Two of them have one number.
    pub(super) fn labels(self) -> Result<Vec<StatedLabel>, Fault> {
        let mut labels: Vec<StatedLabel> =
            self.by_place.into_values().filter_map(|segment| Some(segment.label(segment.number?))).collect();
        crate::order::by_key(&mut labels, |label| label.number);
        match labels.windows(2).find(|pair| pair[0].number == pair[1].number) {
            Some([a, b]) => Err(shared(a, b, a.number)),
            _ => Ok(labels),
        }
    }

    /// The segments of several layers, whose values count within their layers: their labels, and where they are.
    /// Numbers are the values, unless two segments share one: then they count the segments from 1 on.
    ///
    /// # Errors
    /// Two segments of one layer have one value.
    pub(super) fn layered(self) -> Result<(Vec<StatedLabel>, Vec<Layered>), Fault> {
        let mut places: Vec<(Segment, u16)> =
            self.by_place.into_values().filter_map(|s| s.number.map(|value| (s, value))).collect();
        let mut values: Vec<u16> = places.iter().map(|(_, value)| *value).collect();
        values.sort_unstable();
        let share = values.windows(2).any(|pair| pair[0] == pair[1]);
        places.truncate(u16::MAX.into());
        let numbered =
            (1..).zip(places).map(|(count, (s, value))| (if share { count } else { value }, s, value));
        let (mut labels, mut layered) = (Vec::new(), Vec::new());
        for (number, segment, value) in numbered {
            layered.push((segment.layer, value, number));
            labels.push(segment.label(number));
        }
        layered.sort_unstable();
        if let Some([a, b]) = layered.windows(2).find(|pair| (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1))
        {
            let own = |number| labels.iter().find(|label| label.number == number);
            if let (Some(first), Some(second)) = (own(a.2), own(b.2)) {
                return Err(shared(first, second, a.1));
            }
        }
        crate::order::by_key(&mut labels, |label| label.number);
        Ok((labels, layered))
    }
}

/// The fault of segments with one value in one layer.
fn shared(a: &StatedLabel, b: &StatedLabel, value: u16) -> Fault {
    bad!(
        "its header gives the value {value} to the segments `{}` and `{}` of one layer; save the segmentation again",
        a.name.escape_debug(),
        b.name.escape_debug()
    )
}

impl Segment {
    /// Its label. A name beside a code was typed in; one without comes from a table of classes, since 3D Slicer always
    /// writes a code.
    fn label(&self, number: u16) -> StatedLabel {
        let (name, typed) = match self.coded.as_str() {
            "" => (self.name.clone(), String::new()),
            coded => (coded.to_owned(), self.name.clone()),
        };
        StatedLabel { number, name, typed, color: self.color }
    }
}

/// Meaning of the code of a terminology entry, after its modifier:
/// `TerminologyEntry:context~category~type~modifier~...` in a list separated by bars, each code `scheme^value^meaning`.
fn meaning(tags: &str) -> Option<String> {
    let entry = tags.split('|').find_map(|tag| tag.trim().strip_prefix("TerminologyEntry:"))?;
    let mut codes = entry.split('~').skip(2).map(|code| code.splitn(3, '^').nth(2).unwrap_or("").trim());
    let (own, modifier) = (codes.next()?, codes.next().unwrap_or(""));
    (!own.is_empty()).then(|| format!("{modifier} {own}").trim().to_owned())
}

/// The colour of three parts from 0 to 1.
fn color(parts: [f64; 3]) -> Option<[u8; 3]> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
    let byte = |part: f64| (part * 255.0).round() as u8;
    parts.iter().all(|part| (0.0..=1.0).contains(part)).then(|| parts.map(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segments(pairs: &[(&str, &str)]) -> Segments {
        let mut segments = Segments::default();
        pairs.iter().for_each(|(key, value)| segments.pair(key, value).unwrap());
        segments
    }

    fn label(number: u16, name: &str, typed: &str, color: Option<[u8; 3]>) -> StatedLabel {
        StatedLabel { number, name: name.into(), typed: typed.into(), color }
    }

    #[test]
    fn segments_are_taken_by_their_numbers() {
        let found = segments(&[
            ("segment10_name", "left kidney"),
            ("segment10_labelvalue", "3"),
            ("segment10_color", "0.5 1 2"),
            ("segment2_labelvalue", "7"),
            ("segment2_color", "0.501961 0 1.0"),
            ("segment2_name", "liver"),
            ("segment3_name", "without a number"),
            ("segment4_labelvalue", "0"),
            ("segmentation_masterrepresentation", "Binary labelmap"),
            ("segmentx_name", "no"),
        ]);
        let note = found.note().unwrap().to_string();
        assert!(
            note.contains("states 1 colour outside") && note.contains("`0.5 1 2` for segment10_color"),
            "{note}"
        );
        let twice = [("segment2_labelvalue", "7"), ("segment5_labelvalue", "7"), ("segment5_name", "lung")];
        assert!(
            segments(&twice).labels().unwrap_err().text.contains("value 7 to the segments `` and `lung`")
        );
        assert!(
            segments(&twice).layered().unwrap_err().text.contains("value 7 to the segments `` and `lung`")
        );
        let again = segments(&twice).pair("segment5_labelvalue", "8").unwrap_err().text;
        assert!(again.contains("states `segment5_labelvalue` twice"), "{again}");
        for (key, value) in
            [("segment1_labelvalue", "1,5"), ("segment1_color", "1 0"), ("segment1_layer", "first")]
        {
            let fault = Segments::default().pair(key, value).unwrap_err();
            assert!(fault.text.contains(key) && fault.text.contains(value), "{fault}");
        }
        assert!(found.is_stated() && !segments(&[("segmentx_name", "no")]).is_stated());
        assert_eq!(
            found.labels().unwrap(),
            [label(3, "left kidney", "", None), label(7, "liver", "", Some([128, 0, 255]))]
        );
    }

    #[test]
    fn codes_come_before_names_and_layers_may_share_values() {
        let entry = |own: &str, modifier: &str| {
            format!(
                "Segmentation.Status:inprogress|TerminologyEntry:Segmentation category and type - 3D Slicer General \
                 Anatomy list~SCT^123037004^Anatomical Structure~SCT^1^{own}~{modifier}~Anatomic codes~^^~^^|x:y"
            )
        };
        let (kidney, liver) = (entry("Kidney", "SCT^24028007^Right"), entry("Liver", "^^"));
        let pairs = [
            ("segment0_labelvalue", "1"),
            ("segment0_name", "Mr Smith's kidney"),
            ("segment0_tags", kidney.as_str()),
            ("segment0_layer", "1"),
            ("segment1_labelvalue", "2"),
            ("segment1_tags", liver.as_str()),
            ("segment1_layer", "0"),
        ];
        let due = [label(1, "Right Kidney", "Mr Smith's kidney", None), label(2, "Liver", "", None)];
        assert_eq!(segments(&pairs).labels().unwrap(), due);
        assert_eq!(segments(&pairs).layered().unwrap(), (due.to_vec(), vec![(0, 2, 2), (1, 1, 1)]));
        let mut shared = pairs;
        shared[4].1 = "1";
        assert_eq!(segments(&shared).layered().unwrap(), (due.to_vec(), vec![(0, 1, 2), (1, 1, 1)]));
        for odd in ["", "TerminologyEntry:", "TerminologyEntry:a~b~c", "TerminologyEntry:a~b~c^d^ ~e^f^g"] {
            assert_eq!(meaning(odd), None, "{odd}");
        }
    }
}
