//! Ranges of Hounsfield units under the names of tissues.

use std::fmt;

use crate::builder::Threshold;

/// A tissue in CT, by its usual range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Bone, cancellous and compact: 226 HU and more.
    Bone,
    /// Compact bone: 662 HU and more.
    CompactBone,
    /// Enamel of teeth: 1550 HU and more.
    Teeth,
    /// Implants and fillings: 2500 HU and more.
    Metal,
    /// The outside of the body against air: -300 HU and more.
    Skin,
    /// Muscle and other soft tissue: -5 to 135 HU.
    Muscle,
    /// Fat: -205 to -51 HU.
    Fat,
    /// Air-filled lung: -950 to -500 HU.
    Lung,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 8] = [
        Self::Bone,
        Self::CompactBone,
        Self::Teeth,
        Self::Metal,
        Self::Skin,
        Self::Muscle,
        Self::Fat,
        Self::Lung,
    ];

    /// Name as written on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bone => "bone",
            Self::CompactBone => "compact-bone",
            Self::Teeth => "teeth",
            Self::Metal => "metal",
            Self::Skin => "skin",
            Self::Muscle => "muscle",
            Self::Fat => "fat",
            Self::Lung => "lung",
        }
    }

    /// The preset of a name.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == text)
    }

    /// Threshold or range in HU.
    pub fn threshold(self) -> Threshold {
        match self {
            Self::Bone => Threshold::Iso(226.0),
            Self::CompactBone => Threshold::Iso(662.0),
            Self::Teeth => Threshold::Iso(1550.0),
            Self::Metal => Threshold::Iso(2500.0),
            Self::Skin => Threshold::Iso(-300.0),
            Self::Muscle => Threshold::Range(-5.0, 135.0),
            Self::Fat => Threshold::Range(-205.0, -51.0),
            Self::Lung => Threshold::Range(-950.0, -500.0),
        }
    }

    /// A warning when the input is not, or not surely, a CT.
    pub(crate) fn doubt(self, modality: Option<&str>) -> Option<PresetDoubt> {
        (modality != Some("CT")).then(|| PresetDoubt { preset: self, modality: modality.map(str::to_owned) })
    }
}

/// A range of Hounsfield units is used on values that may not be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PresetDoubt {
    /// The preset.
    pub preset: Preset,
    /// The input's modality, which is not CT; `None` where it states none.
    pub modality: Option<String>,
}

impl fmt::Display for PresetDoubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.preset.name();
        write!(f, "the preset {name} is a range of Hounsfield units")?;
        match &self.modality {
            Some(other) => write!(f, ", and this is {other}, not CT"),
            None => f.write_str("; the input does not say that its values are"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_doubts_depend_on_the_modality() {
        for preset in Preset::ALL {
            assert_eq!(Preset::parse(preset.name()), Some(preset));
            assert_eq!(preset.doubt(Some("CT")), None);
            assert!(preset.doubt(Some("MR")).is_some_and(|d| d.modality.as_deref() == Some("MR")));
            assert!(preset.doubt(None) == Some(PresetDoubt { preset, modality: None }));
        }
        assert_eq!(Preset::parse("Bone"), None);
    }
}
