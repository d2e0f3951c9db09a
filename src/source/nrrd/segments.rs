//! Segments of a `.seg.nrrd`: names, colours and numbers, in pairs of keys and values as 3D Slicer writes them
//! (`Segment0_Name:=liver`; <https://slicer.readthedocs.io>, "Segmentations", file format).

use std::collections::BTreeMap;

use crate::volume::StatedLabel;

/// Most segments that are taken: as many as there are numbers of labels.
const MOST: usize = 1 << 16;

/// One segment, as far as it is stated.
#[derive(Debug, Default)]
struct Segment {
    name: String,
    color: Option<[u8; 3]>,
    number: Option<u16>,
}

/// The segments of a header, by their places in it.
#[derive(Debug, Default)]
pub(super) struct Segments(BTreeMap<u32, Segment>);

impl Segments {
    /// Takes a pair, its key in lower case; pairs that say nothing of a segment are passed over.
    pub(super) fn pair(&mut self, key: &str, value: &str) {
        let Some((place, what)) = key.strip_prefix("segment").and_then(|rest| rest.split_once('_')) else {
            return;
        };
        let Ok(place) = place.parse() else { return };
        if !matches!(what, "name" | "color" | "labelvalue")
            || self.0.len() >= MOST && !self.0.contains_key(&place)
        {
            return;
        }
        let segment = self.0.entry(place).or_default();
        match what {
            "name" => value.clone_into(&mut segment.name),
            "color" => segment.color = color(value),
            _ => segment.number = value.parse().ok().filter(|number| *number > 0),
        }
    }

    /// The segments that have a number, by it; of several with one number the first.
    pub(super) fn labels(self) -> Vec<StatedLabel> {
        let label = |Segment { name, color, number }| Some(StatedLabel { number: number?, name, color });
        let mut labels: Vec<StatedLabel> = self.0.into_values().filter_map(label).collect();
        labels.sort_by_key(|label| label.number);
        labels.dedup_by_key(|label| label.number);
        labels
    }
}

/// Three parts from 0 to 1.
fn color(value: &str) -> Option<[u8; 3]> {
    let mut parts = value.split_whitespace().map(|part| {
        let part: f64 = part.parse().ok()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        (0.0..=1.0).contains(&part).then(|| (part * 255.0).round() as u8)
    });
    let color = [parts.next()??, parts.next()??, parts.next()??];
    parts.next().is_none().then_some(color)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_taken_by_their_numbers() {
        let mut segments = Segments::default();
        for (key, value) in [
            ("segment10_name", "left kidney"),
            ("segment10_labelvalue", "3"),
            ("segment10_color", "0.5 1 2"),
            ("segment2_labelvalue", "7"),
            ("segment2_color", "0.501961 0 1.0"),
            ("segment2_name", "liver"),
            ("segment3_name", "without a number"),
            ("segment4_labelvalue", "0"),
            ("segment5_labelvalue", "7"),
            ("segmentation_masterrepresentation", "Binary labelmap"),
            ("segmentx_name", "no"),
        ] {
            segments.pair(key, value);
        }
        let label = |number, name: &str, color| StatedLabel { number, name: name.into(), color };
        assert_eq!(
            segments.labels(),
            [label(3, "left kidney", None), label(7, "liver", Some([128, 0, 255]))]
        );
    }
}
