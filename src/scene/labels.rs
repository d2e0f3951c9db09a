//! Visibility of a model's labels, and the part of the light that they stop.

use std::fmt;
use std::str::FromStr;

use crate::format::{Label, LabelItems};
use crate::render::walls::Hidden;
use crate::text::shown;

/// A selection of a model's labels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LabelPick {
    /// Every label.
    All,
    /// Labels with numbers in this range, both ends included.
    Numbers([u16; 2]),
    /// Labels with this name, ignoring case.
    Name(String),
}

/// Parses `all`, `5`, `7..20`, or a name.
impl FromStr for LabelPick {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let [low, high] = text.split_once("..").map_or([text; 2], |(low, high)| [low, high]);
        match (low.trim().parse(), high.trim().parse()) {
            (Ok(low), Ok(high)) if low <= high => Ok(Self::Numbers([low, high])),
            (Ok(_), Ok(_)) => Err(format!("'{text}' is not a range of labels; write the lower number first")),
            _ if text.is_empty() => Err("a label is missing; write its number, a range or its name".into()),
            _ if text == "all" => Ok(Self::All),
            _ => Ok(Self::Name(text.to_owned())),
        }
    }
}

/// Spelled as it is parsed.
impl fmt::Display for LabelPick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Numbers([low, high]) if low == high => write!(f, "{low}"),
            Self::Numbers([low, high]) => write!(f, "{low}..{high}"),
            Self::Name(name) => write!(f, "'{}'", shown(name)),
        }
    }
}

impl LabelPick {
    /// True if a label is selected.
    pub fn contains(&self, label: &Label) -> bool {
        match self {
            Self::All => true,
            Self::Numbers([low, high]) => (*low..=*high).contains(&label.number),
            Self::Name(name) => name.to_lowercase() == label.name.to_lowercase(),
        }
    }
}

/// Opacity of some labels: 0 hides them, 1 shows them as solid.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelRule {
    /// The labels.
    pub labels: LabelPick,
    /// Part of the light that is stopped, 0..=1.
    pub opacity: f64,
}

/// The part of the light that each label of a table stops by these rules, of which later ones count before earlier ones.
///
/// # Errors
/// The rule that applies to none of the labels.
pub(crate) fn parts<'r>(rules: &'r [LabelRule], table: &[Label]) -> Result<Vec<f64>, &'r LabelPick> {
    if let Some(idle) = rules.iter().find(|rule| !table.iter().any(|label| rule.labels.contains(label))) {
        return Err(&idle.labels);
    }
    let last = |label| rules.iter().rev().find(|rule| rule.labels.contains(label));
    Ok(table.iter().map(|label| last(label).map_or(1.0, |rule| rule.opacity)).collect())
}

/// How much of the light each label of a model stops.
#[derive(Clone, Debug)]
pub struct Opacity<'a> {
    labels: LabelItems<'a>,
    /// Opacity by number; 1 for all others.
    parts: Vec<(u16, f64)>,
    /// Labels invisible to sight, and labels that do not stop light.
    unseen: Hidden,
    clear: Hidden,
    /// True if every label is invisible to sight.
    is_invisible: bool,
}

impl<'a> Opacity<'a> {
    /// Opacities of the labels of `table` by rules, of which the last one counts for each label.
    ///
    /// # Errors
    /// The choice of a rule that matches no label.
    pub fn of<'r>(
        rules: &'r [LabelRule],
        labels: LabelItems<'a>,
        table: &[Label],
    ) -> Result<Self, &'r LabelPick> {
        let numbers = table.iter().map(|label| label.number);
        let mut parts: Vec<_> = numbers.zip(parts(rules, table)?).filter(|(_, part)| *part < 1.0).collect();
        crate::order::by_key(&mut parts, |part| part.0);
        let up_to = |most: f64| Hidden::of(parts.iter().filter(|part| part.1 <= most).map(|part| part.0));
        let (unseen, clear) = (up_to(0.0), up_to(1.0));
        let is_invisible = parts.iter().filter(|part| part.1 <= 0.0).count() == table.len();
        Ok(Self { labels, parts, unseen, clear, is_invisible })
    }

    /// True if some label lets a part of the light through, but not all.
    pub(super) fn is_translucent(&self) -> bool {
        self.parts.iter().any(|part| part.1 > 0.0)
    }

    /// True if some label is invisible to sight.
    pub(super) fn hides_some(&self) -> bool {
        self.parts.iter().any(|part| part.1 <= 0.0)
    }

    /// True if every label is invisible to sight.
    pub(super) fn is_invisible(&self) -> bool {
        self.is_invisible
    }

    /// True if every label is solid.
    pub(super) fn is_solid(&self) -> bool {
        self.parts.is_empty()
    }

    /// The part of the light that a label stops; 0 for background.
    pub(super) fn part(&self, label: u16) -> f64 {
        match self.parts.binary_search_by_key(&label, |part| part.0) {
            _ if label == 0 => 0.0,
            Ok(at) => self.parts[at].1,
            Err(_) => 1.0,
        }
    }

    /// The colour of a label.
    pub(super) fn color(&self, label: u16) -> Option<[u8; 3]> {
        self.labels.named(label).map(|label| label.color)
    }

    /// Labels that count as background for sight, or for light.
    pub(super) fn hidden(&self, from_sight: bool) -> &Hidden {
        if from_sight { &self.unseen } else { &self.clear }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_picked_by_number_range_and_name() {
        let label = |number, name: &str| Label { number, name: name.into(), color: [0; 3], voxels: 1 };
        let (liver, other) = (label(5, "Left kidney"), label(9, ""));
        for (text, picked) in [
            ("all", [true, true]),
            ("5", [true, false]),
            ("6..9", [false, true]),
            ("left KIDNEY", [true, false]),
            ("kidney", [false, false]),
        ] {
            let pick: LabelPick = text.parse().unwrap();
            assert_eq!([pick.contains(&liver), pick.contains(&other)], picked, "{text}");
        }
        for wrong in ["", " ", "9..3"] {
            assert!(wrong.parse::<LabelPick>().is_err(), "{wrong}");
        }
    }
}
