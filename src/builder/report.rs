//! Results and costs of a build.

use std::fmt;

use crate::format::Selection;
use crate::text::Short;
use crate::text::names::{ISO, LABELS, RANGE};

/// Results and costs of a build.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// Selection of the inside, with the threshold that was found.
    pub selection: Selection,
    /// Number of skin voxels.
    pub skin_voxels: u64,
    /// Boxes of the surface left out because they cannot be seen; `None` if not requested.
    pub hidden: Option<u64>,
    /// Surface boxes that the model represents, including those that larger leaves have replaced.
    pub shown: u64,
    /// Number of infobytes.
    pub nodes: u64,
    /// Length of the file.
    pub file_bytes: u64,
    /// Bytes of every section, by name.
    pub section_bytes: Vec<(&'static str, u64)>,
    /// Memory bound of the plan.
    pub plan_bytes: u64,
    /// Bytes written to the scratch file.
    pub scratch_bytes: u64,
    /// Number of workers.
    pub threads: usize,
    /// Columns (x) of a tile.
    pub tile: u32,
    /// Seconds: choosing the threshold, scanning the volume, merging, sealing, syncing and renaming.
    pub seconds: StageSeconds,
    /// Oddities of the volume and its threshold.
    pub notes: Vec<BuildNote>,
}

impl BuildReport {
    /// Estimated bytes saved by leaving boxes out, at the average size of those that are kept.
    pub fn bytes_saved_about(&self) -> u64 {
        let all = u128::from(self.file_bytes) * u128::from(self.hidden.unwrap_or(0));
        u64::try_from(all / u128::from(self.shown.max(1))).unwrap_or(u64::MAX)
    }
}

/// A note for the user who chose the threshold.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BuildNote {
    /// The values are labels; all of them are inside.
    Labels {
        /// Number of labels, 0 excluded.
        count: usize,
    },
    /// The values are few greys, which may also be labels.
    Greys {
        /// Number of greys.
        count: usize,
    },
    /// A value that pads the unscanned region was left out when a threshold was looked for.
    Padding {
        /// The padding value.
        value: f64,
    },
    /// Requested labels have no voxel.
    LabelsAbsent {
        /// The first missing label.
        first: u16,
        /// Number of further missing labels.
        others: usize,
    },
    /// Named labels have no voxel.
    NamesAbsent {
        /// The first missing label.
        first: u16,
        /// Number of further missing labels.
        others: usize,
    },
    /// The labels of the table of names do not occur.
    LabelsUnnamed {
        /// Number of labels in the table.
        named: usize,
    },
    /// Some samples are NaN, and so outside.
    NotNumbers,
    /// Some samples are infinite and within the range, and so inside.
    Infinite,
    /// Every voxel is inside: the model is the box of the volume.
    AllInside {
        /// Number of voxels.
        voxels: u64,
    },
}

impl fmt::Display for BuildNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Labels { count } => write!(
                f,
                "its values are taken for labels, {count} of them, and everything above 0 is inside; {LABELS} all gives each a surface of its own, {RANGE} takes a label alone; for greys choose a threshold with {ISO}"
            ),
            Self::Greys { count } => write!(
                f,
                "its {count} values may be greys or labels, and are taken for greys; if they are labels, {LABELS} all gives each a surface of its own, and {ISO} takes those from a number on"
            ),
            Self::LabelsAbsent { first, others: 0 } => write!(f, "no voxel has the label {first}"),
            Self::LabelsAbsent { first, others } => {
                write!(f, "no voxel has the label {first}, nor {others} more of those asked for")
            }
            Self::NamesAbsent { first, others } => {
                write!(f, "no voxel has the label {first}, which has a name")?;
                if *others > 0 { write!(f, ", nor {others} more that have one") } else { Ok(()) }
            }
            Self::LabelsUnnamed { named } => {
                write!(f, "no voxel has any of the {named} labels of the table, so that none has a name")
            }
            Self::Padding { value } => write!(
                f,
                "{} is far from all other values, and outside what was scanned: taken for padding, and left out when the threshold was looked for",
                Short(*value)
            ),
            Self::NotNumbers => f.write_str("some samples are not numbers (NaN); these voxels are outside"),
            Self::Infinite => f.write_str("some samples are infinite; these voxels are inside"),
            Self::AllInside { voxels } => write!(
                f,
                "all {voxels} voxels are inside, so that the model is the box of the volume; choose another {ISO} or {RANGE}"
            ),
        }
    }
}

/// Wall time of the stages.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageSeconds {
    /// Histogram passes of Otsu's method.
    pub histogram: f64,
    /// Search for visible boxes.
    pub sight: f64,
    /// Part of the scan that one worker waited for the source, on average.
    pub read: f64,
    /// Reading, range test, skin, gradients, swapping out.
    pub scan: f64,
    /// Census and merge.
    pub merge: f64,
    /// Rank directory and checksums.
    pub seal: f64,
    /// Sync and rename.
    pub commit: f64,
}
