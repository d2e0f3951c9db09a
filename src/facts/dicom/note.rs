//! What was assumed, dropped or changed where a DICOM series became a volume.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use thiserror::Error;

use super::attribute::{Attribute, List};
use super::image::CsaFault;
use super::scan::ScanError;
use super::series::ImageName;
use crate::text::shown;

/// Something that a user should know of a volume from DICOM.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum DicomNote {
    #[error("the end of the pixel data is missing; was the file cut short?{}", match (lacking, all_frames) {
        (0, Some(frames)) => format!(" All {frames} frames were found"),
        (0, None) => String::new(),
        (bytes, _) => format!(" The last fragment lacks {bytes} bytes"),
    })]
    EndMissing {
        /// Bytes that the last fragment lacks.
        lacking: u64,
        /// Number of frames, if all of several were found.
        all_frames: Option<u32>,
    },
    #[error("the RT dose states no dose grid scaling; values are as stored, not in Gy")]
    DoseUnscaled,
    #[error(
        "frames follow each other in time (Frame Increment Pointer (0028,0009)), and are stacked as if they were slices"
    )]
    FramesInTime,
    #[error("positions of frames are taken from the grid frame offset vector")]
    GridPositions,
    #[error(
        "frames state no positions of their own; they are placed in their order by the stated spacing between slices"
    )]
    SteppedPositions,
    #[error("colour is reduced to luminance (ITU-R BT.601)")]
    Luminance,
    #[error("palette colours are reduced to luminance (ITU-R BT.601)")]
    PaletteLuminance,
    #[error("values went through the modality LUT, and its output is taken as physical")]
    ModalityLut,
    #[error("slices differ in rescale; values are converted to single precision")]
    RescalesDiffer,
    #[error("the images state no rescale; values may not be HU")]
    NoRescale,
    #[error(
        "the images state positions, but no orientation; rows are taken as running to the left, columns to the back"
    )]
    OrientationAssumed,
    #[error("the images state no pixel spacing; 1 mm is assumed")]
    PixelSpacingAssumed,
    #[error("there is only one slice{}", match thickness_mm {
        Some(mm) => format!("; its stated thickness, {mm} mm, is taken as its spacing"),
        None => ", and no thickness is stated; 1 mm is assumed".to_owned(),
    })]
    OneSlice {
        /// Its thickness, if stated, which is taken as spacing; else 1 mm.
        thickness_mm: Option<f64>,
    },
    #[error("{slices} slices for which the segmentation has no frame are empty")]
    EmptySlices { slices: usize },
    #[error("instance numbers do not follow the positions; slices are ordered by position")]
    NumbersDisagree,
    #[error("the images state no positions: {}, {step_mm} mm apart, placed at the origin", match order {
        SliceOrder::Frames => "in the order of the frames",
        SliceOrder::InstanceNumbers => "ordered by instance number",
    })]
    NoPositions {
        /// What orders the slices.
        order: SliceOrder,
        /// Distance at which they are placed.
        step_mm: f64,
    },
    #[error(
        "the slices are stacked {degrees:.2} degrees off their normal (gantry tilt); the volume is sheared to match"
    )]
    Tilt { degrees: f64 },
    #[error("some slices are up to {mm:.3} mm off the line of the others")]
    Sideways { mm: f64 },
    #[error(
        "slices are not quite evenly spaced: gaps differ by up to {:.2} % from their mean {mean_mm:.4} mm, and slices \
         lie up to {off_mm:.3} mm off the regular grid",
        100.0 * worst
    )]
    NotQuiteEven { worst: f64, mean_mm: f64, off_mm: f64 },
    #[error(
        "unevenly spaced slices are used as if they were {mean_mm:.4} mm apart; they lie up to {off_mm:.3} mm off the \
         places that the model shows them at"
    )]
    KeptUneven { mean_mm: f64, off_mm: f64 },
    #[error("{0}")]
    Filled(Box<FilledGaps>),
    #[error("the mosaic states no spacing between slices{}", match thickness_mm {
        Some(mm) => format!("; their thickness, {mm} mm, is taken"),
        None => ", and no thickness; 1 mm is assumed".to_owned(),
    })]
    MosaicSpacing {
        /// The stated thickness, which is taken; else 1 mm.
        thickness_mm: Option<f64>,
    },
    /// A mosaic does not state on which side of a slice the next one lies.
    #[error(
        "the mosaic does not state in which direction its slices follow each other{}; rows x columns is assumed",
        match header {
            Some(fault) => format!(" (its private header cannot be read: {fault})"),
            None => String::new(),
        }
    )]
    MosaicDirection {
        /// Why the private header, which has it, cannot be read.
        header: Option<CsaFault>,
    },
    #[error(
        "the mosaic states no position: its slices are taken in their order, {step_mm} mm apart, placed at the origin"
    )]
    MosaicUnplaced { step_mm: f64 },
    /// Images that are in the series twice were left out.
    #[error("{images} image(s) that are in the series twice were left out: {}", listed(*images, files))]
    Duplicates {
        /// How many.
        images: u64,
        /// Their files below the folder of the series, as many as are named.
        files: Vec<PathBuf>,
    },
    #[error("{}: {error}", shown(file))]
    Lost { file: PathBuf, error: ScanError },
    #[error("the series holds {volumes} volumes, told apart by {}", List(by))]
    Volumes { volumes: usize, by: Vec<Attribute> },
}

/// Files of some images, each once (images of one file with many frames share its name), and how many more there are.
fn listed(images: u64, files: &[PathBuf]) -> String {
    let mut named: Vec<String> = Vec::new();
    for file in files.iter().map(|file| shown(file).to_string()) {
        if !named.contains(&file) {
            named.push(file);
        }
    }
    match images.saturating_sub(files.len() as u64) {
        0 => named.join(", "),
        more => format!("{} and {more} more", named.join(", ")),
    }
}

impl DicomNote {
    /// Was the spacing of an axis assumed to be 1 mm, so that a spacing from elsewhere contradicts nothing?
    pub(crate) fn assumes_spacing(&self) -> bool {
        matches!(
            self,
            Self::PixelSpacingAssumed
                | Self::OneSlice { thickness_mm: None }
                | Self::MosaicSpacing { thickness_mm: None }
        )
    }
}

/// What orders slices without positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SliceOrder {
    /// The order of frames in their file.
    Frames,
    /// Instance Number.
    InstanceNumbers,
}

/// How gaps between slices were filled.
#[derive(Clone, Debug, PartialEq)]
pub struct FilledGaps {
    /// Slices that were made.
    pub made: u64,
    /// All slices.
    pub slices: usize,
    /// The first gaps that were filled.
    pub holes: Vec<Hole>,
    /// How many more were.
    pub more_holes: usize,
    /// Distance of slices.
    pub step_mm: f64,
    /// Images that lie off the grid.
    pub unused: usize,
    /// How far those on the grid lie off it at most, where that is worth a word.
    pub off_mm: Option<f64>,
}

impl Display for FilledGaps {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "gaps between slices were filled: {} of {} were made by interpolation between neighbours (",
            self.made, self.slices
        )?;
        for (i, hole) in self.holes.iter().enumerate() {
            let [a, b] = &hole.between;
            write!(f, "{}{} between {a} and {b}", if i > 0 { ", " } else { "" }, hole.made)?;
        }
        if self.more_holes > 0 {
            write!(f, ", and in {} more places", self.more_holes)?;
        }
        write!(f, "), on a regular grid of {:.4} mm from the first to the last", self.step_mm)?;
        if self.unused > 0 {
            write!(f, "; {} that lie off the grid only lend their values to those", self.unused)?;
        }
        self.off_mm.map_or(Ok(()), |mm| write!(f, "; the others lie up to {mm:.3} mm off it"))
    }
}

/// A gap that was filled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hole {
    /// Slices that were made.
    pub made: u64,
    /// The images on both sides.
    pub between: [ImageName; 2],
}
