//! Why a build stops.

use std::fmt;

use super::foreign::shown;
use super::number::Short;
use super::system::{reading, writing};
use crate::budget::{ExactSize, SizeArgument};
use crate::builder::{BuildError, BuildNote, ScratchFault, Sought};
use crate::format::{Channel, SurfaceKind};

impl fmt::Display for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Source(inner) => inner.fmt(f),
            Self::Format(inner) => inner.fmt(f),
            Self::BudgetTooSmall { name, limit_bytes, minimum_bytes } => write!(
                f,
                "{name}: --memory {} is too small; the smallest that works is --memory {}",
                ExactSize(*limit_bytes),
                SizeArgument(*minimum_bytes)
            ),
            Self::EmptyResult { name, sought, min, max } => write!(
                f,
                "{name}: no voxel lies in {sought}; the values of this volume run from {} to {}: choose --iso or --range within them",
                Short(*min),
                Short(*max)
            ),
            Self::NothingInside { name } => write!(
                f,
                "{name}: no voxel is inside; choose a finer grid, or check that the solid lies in it"
            ),
            Self::NothingVisible { name, boxes } => write!(
                f,
                "{name}: none of the {boxes} boxes of its surface can be seen from there; give another --visible-from"
            ),
            Self::NoChannel { name, channel: Channel::Value, surface: SurfaceKind::Cells } => write!(
                f,
                "{name}: cells lie where the value is the threshold, so there is no channel 'value'; leave it out, or use --surface skin"
            ),
            Self::NoChannel {
                name,
                channel: channel @ (Channel::Color | Channel::Material),
                surface: SurfaceKind::Cells,
            } => write!(
                f,
                "{name}: cells hold the shape of a surface alone, so there is no channel '{channel}'; leave it out, or use --surface skin"
            ),
            Self::NoChannel { name, channel, .. } => {
                write!(f, "{name}: does not have the channel '{channel}'; leave it out")
            }
            Self::NormalBits { name } => write!(
                f,
                "{name}: only skin voxels of volumes have normals of 12 or 24 bits; leave out --normal-bits, or use --surface skin"
            ),
            Self::NoRoomForCells { name } => write!(
                f,
                "{name}: a side of 65536 voxels is too long for cells; use --surface skin, or a part of the volume with --roi"
            ),
            Self::NoNumbers { name } => write!(
                f,
                "{name}: holds no finite value; check that it is the right file, and of headerless voxels check --dtype"
            ),
            Self::EmptyRange { .. } => f.write_str("the range is empty: write it as LO..HI with LO <= HI"),
            Self::Scratch { path, cause } => write!(
                f,
                "scratch file in {}: {cause}; {}",
                shown(path),
                reading(cause, "free some space or choose another folder with --scratch")
            ),
            Self::Output { path, cause } => {
                write!(f, "{}: cannot be written ({cause}); {}", shown(path), writing(cause))
            }
            Self::Threads { cause, .. } => {
                write!(f, "worker threads cannot be started ({cause}); try --threads 1")
            }
        }
    }
}

impl fmt::Display for Sought {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Split => f.write_str("a range by Otsu's method, which needs two different values"),
            Self::Within(range) if range.hi.is_infinite() => {
                write!(f, "the range from {} up", Short(range.lo))
            }
            Self::Within(range) => write!(f, "the range {}..{}", Short(range.lo), Short(range.hi)),
        }
    }
}

impl fmt::Display for ScratchFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Changed => "its contents were changed by someone else",
            Self::TooManyBricks => "the model has too many bricks for this machine",
        })
    }
}

impl fmt::Display for BuildNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotNumbers => f.write_str("some samples are not numbers (NaN); these voxels are outside"),
            Self::Labels { count } => write!(
                f,
                "its values are taken for labels, {count} of them, and everything above 0 is inside; `--range 5..5` takes the label 5 alone, `--iso V` labels of V and more"
            ),
            Self::Padding { value } => write!(
                f,
                "{} lies outside the circle that its slices have room for, and hardly anywhere else: taken for padding, and left out when the threshold was looked for",
                Short(*value)
            ),
            Self::AllInside { voxels } => write!(
                f,
                "all {voxels} voxels are inside, so that the model is the box of the volume; choose another --iso or --range"
            ),
        }
    }
}
