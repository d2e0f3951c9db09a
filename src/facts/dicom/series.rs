//! Why images form no volume.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use thiserror::Error;

use super::attribute::{Attribute, List};
use crate::text::names::GAPS;
use crate::text::shown;

/// An image of a series.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImageName {
    /// Its file, without the folder.
    pub file: PathBuf,
    /// Number of the frame, from 0, where files have several.
    pub frame: Option<u32>,
}

impl Display for ImageName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        shown(&self.file).fmt(f)?;
        match self.frame {
            Some(frame) => write!(f, " (frame {})", u64::from(frame) + 1),
            None => Ok(()),
        }
    }
}

/// Why images form no volume.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum SeriesFault {
    #[error("no image")]
    NoImage,
    #[error(
        "all {images} images are at one position; they form no volume: give the whole series, or build one image as a picture"
    )]
    OnePosition { images: usize },
    #[error("{repeats} of {images} images repeat the position of another (first: {} and {}), and nothing in their headers tells them apart; give the files of one volume", .first[0], .first[1])]
    Repeated { repeats: usize, images: usize, first: Box<[ImageName; 2]> },
    #[error("{0}")]
    Uneven(Box<UnevenGaps>),
    #[error("{slices} slices would have to be made out of {images}; give the files of an evenly spaced part")]
    TooFar {
        /// Slices of the volume; may be past any whole number.
        slices: f64,
        images: usize,
    },
    #[error("the image orientation is not two perpendicular unit vectors")]
    Orientation,
    #[error("the positions do not span a volume")]
    Flat,
    #[error(
        "the images state no positions and no distinct instance numbers, so their order is unknown; convert them to a raw volume in the right order"
    )]
    NoOrder,
    #[error(
        "{lacking} of {slices} slices state no rescale slope and intercept, so their values cannot be compared"
    )]
    RescaleMissing { lacking: usize, slices: usize },
    #[error("the rescale slope is 0, so every pixel would have the same value")]
    RescaleZero,
    #[error("its images have different sample types")]
    SampleTypes,
    #[error("too many padding values")]
    ManyPaddings,
    #[error("too many files")]
    ManyFiles,
    #[error("{columns}x{rows}x{slices} voxels are out of range")]
    Size { columns: u32, rows: u32, slices: usize },
    #[error("an image without layout or file")]
    Incomplete,
}

/// Distances of slices that differ too much.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct UnevenGaps {
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

impl Display for UnevenGaps {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "the slices are unevenly spaced: {} gaps along the normal, ", self.gaps)?;
        for (i, (times, mm)) in self.lengths.iter().enumerate() {
            write!(f, "{}{times} x {mm:.3}", if i > 0 { ", " } else { "" })?;
        }
        if self.other_lengths > 0 {
            write!(f, " and {} other lengths", self.other_lengths)?;
        }
        f.write_str(" mm; ")?;
        if let Some(missing) = &self.missing {
            let (slices, places) = (missing.slices, missing.places);
            write!(f, "{slices} slice(s) seem to be missing in {places} place(s), ")?;
        }
        let [a, b] = &self.first;
        write!(
            f,
            "first between {a} and {b}; add the missing slices, give the files of an evenly spaced part, or choose \
             {GAPS} fill or {GAPS} keep"
        )?;
        self.set_apart.as_ref().map_or(Ok(()), |others| others.fmt(f))
    }
}

/// Slices that seem to be missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MissingSlices {
    /// How many; may be past any whole number.
    pub slices: f64,
    /// In how many gaps.
    pub places: usize,
}

/// Images of a series that do not belong to a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SetApart {
    /// How many.
    pub images: usize,
    /// What they were told apart by.
    pub by: Vec<Attribute>,
    /// File of the first.
    pub first: PathBuf,
}

impl Display for SetApart {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.images {
            1 => f.write_str("; 1 other image of the series was")?,
            many => write!(f, "; {many} other images of the series were")?,
        }
        let (by, first) = (List(&self.by), shown(&self.first));
        write!(f, " set apart because of a different {by} (first: {first})")
    }
}
