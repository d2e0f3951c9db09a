//! Why images form no volume.

use std::path::PathBuf;

use thiserror::Error;

use super::attribute::Attribute;

/// An image of a series.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImageName {
    /// Its file, without the folder.
    pub file: PathBuf,
    /// Number of the frame, from 0, where files have several.
    pub frame: Option<u32>,
}

/// Why images form no volume.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SeriesFault {
    /// No image at all.
    NoImage,
    /// All images lie at one position.
    OnePosition {
        /// How many.
        images: usize,
    },
    /// Some positions occur more than once: perhaps several volumes in one series.
    Repeated {
        /// Images that lie where another does.
        repeats: usize,
        /// All images.
        images: usize,
        /// The first two at one position.
        first: Box<[ImageName; 2]>,
    },
    /// Slices seem to be missing.
    Uneven(Box<UnevenGaps>),
    /// Far more slices would have to be made than there are images.
    TooFar {
        /// Slices of the volume; may be past any whole number.
        slices: f64,
        /// Images.
        images: usize,
    },
    /// Directions of rows and columns are not two perpendicular unit vectors.
    Orientation,
    /// Positions lie in one plane with the directions of rows and columns.
    Flat,
    /// Neither positions nor distinct instance numbers.
    NoOrder,
    /// Some slices state no rescale slope and intercept, others do.
    RescaleMissing {
        /// Slices that do not.
        lacking: usize,
        /// All slices.
        slices: usize,
    },
    /// The rescale slope is 0.
    RescaleZero,
    /// Samples of several types.
    SampleTypes,
    /// More padding values than can be numbered.
    ManyPaddings,
    /// More files than can be numbered.
    ManyFiles,
    /// The size of the volume is out of range.
    Size {
        /// Width.
        columns: u32,
        /// Height.
        rows: u32,
        /// Slices.
        slices: usize,
    },
    /// A slice without a layout or a file of its own.
    Incomplete,
}

/// Distances of slices that differ too much.
#[derive(Clone, Debug, PartialEq)]
pub struct UnevenGaps {
    /// How many gaps there are.
    pub gaps: usize,
    /// Their lengths in mm along the normal, the most frequent first, each with how often it occurs.
    pub lengths: Vec<(usize, f64)>,
    /// How many more lengths occur.
    pub other_lengths: usize,
    /// The images on both sides of the first gap that is not as long as usual.
    pub first: [ImageName; 2],
    /// What seems to be missing, if all gaps are multiples of the usual one.
    pub missing: Option<MissingSlices>,
    /// Images of the series that went elsewhere, as the missing ones may be among them.
    pub set_apart: Option<SetApart>,
}

/// Slices that seem to be missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissingSlices {
    /// How many; may be past any whole number.
    pub slices: f64,
    /// In how many gaps.
    pub places: usize,
}

/// Images of a series that are no part of a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetApart {
    /// How many.
    pub images: usize,
    /// What they were told apart by.
    pub by: Vec<Attribute>,
    /// File of the first.
    pub first: PathBuf,
}
