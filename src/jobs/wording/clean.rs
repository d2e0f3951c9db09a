//! Why cleaning stops, and what it doubts.

use std::fmt;

use crate::clean::{CleanError, MOST_LARGEST, PresetDoubt, TooManyRuns};

impl fmt::Display for CleanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Build(inner) => inner.fmt(f),
            Self::Options { .. } => {
                write!(f, "gaps can be closed by 1 or 2 voxels, and 1 to {MOST_LARGEST} components kept")
            }
            Self::NoSample { .. } => f.write_str("the range holds no sample of this volume's type"),
            Self::NothingKept { name, largest } => write!(
                f,
                "{name}: no component is left; the largest has {largest} voxels: choose --drop-below below that"
            ),
        }
    }
}

impl fmt::Display for TooManyRuns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a slice has more than 2^32 runs")
    }
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
