//! What was assumed, dropped or changed where a DICOM series became a volume.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use super::attribute::{Attribute, List};
use super::image::CsaFault;
use super::scan::ScanError;
use super::series::ImageName;
use crate::text::shown;

/// Something that a user should know of a volume from DICOM.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum DicomNote {
    /// The pixel element does not end as it must.
    EndMissing {
        /// Bytes that the last fragment lacks.
        lacking: u64,
        /// Number of frames, if all of several were found.
        all_frames: Option<u32>,
    },
    DoseUnscaled,
    FramesInTime,
    GridPositions,
    SteppedPositions,
    Luminance,
    PaletteLuminance,
    ModalityLut,
    RescalesDiffer,
    NoRescale,
    OrientationAssumed,
    PixelSpacingAssumed,
    OneSlice {
        /// Its thickness, if stated, which is taken as spacing; else 1 mm.
        thickness_mm: Option<f64>,
    },
    EmptySlices {
        slices: usize,
    },
    NumbersDisagree,
    /// No positions.
    NoPositions {
        /// What orders the slices.
        order: SliceOrder,
        /// Distance at which they are placed.
        step_mm: f64,
    },
    Tilt {
        degrees: f64,
    },
    Sideways {
        mm: f64,
    },
    NotQuiteEven {
        worst: f64,
        mean_mm: f64,
        off_mm: f64,
    },
    KeptUneven {
        mean_mm: f64,
        off_mm: f64,
    },
    Filled(Box<FilledGaps>),
    MosaicSpacing {
        /// The stated thickness, which is taken; else 1 mm.
        thickness_mm: Option<f64>,
    },
    /// A mosaic does not state on which side of a slice the next one lies.
    MosaicDirection {
        /// Why the private header, which has it, cannot be read.
        header: Option<CsaFault>,
    },
    MosaicUnplaced {
        step_mm: f64,
    },
    /// Images that are in the series twice were left out.
    Duplicates {
        /// How many.
        images: u64,
        /// Their files below the folder of the series, as many as are named.
        files: Vec<PathBuf>,
    },
    Lost {
        file: PathBuf,
        error: ScanError,
    },
    Volumes {
        volumes: usize,
        by: Vec<Attribute>,
    },
}

impl Display for DicomNote {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::EndMissing { lacking, all_frames } => {
                f.write_str("the end of the pixel data is missing; was the file cut short?")?;
                match (lacking, all_frames) {
                    (0, Some(frames)) => write!(f, " All {frames} frames were found"),
                    (0, None) => Ok(()),
                    (bytes, _) => write!(f, " The last fragment lacks {bytes} bytes"),
                }
            }
            Self::DoseUnscaled => {
                f.write_str("the RT dose states no dose grid scaling; values are as stored, not in Gy")
            }
            Self::FramesInTime => f.write_str(
                "frames follow each other in time (Frame Increment Pointer (0028,0009)), and are stacked as if they \
                 were slices",
            ),
            Self::GridPositions => {
                f.write_str("positions of frames are taken from the grid frame offset vector")
            }
            Self::SteppedPositions => f.write_str(
                "frames state no positions of their own; they are placed in their order by the stated spacing \
                 between slices",
            ),
            Self::Luminance => f.write_str("colour is reduced to luminance (ITU-R BT.601)"),
            Self::PaletteLuminance => {
                f.write_str("palette colours are reduced to luminance (ITU-R BT.601)")
            }
            Self::ModalityLut => {
                f.write_str("values went through the modality LUT, and its output is taken as physical")
            }
            Self::RescalesDiffer => {
                f.write_str("slices differ in rescale; values are converted to single precision")
            }
            Self::NoRescale => f.write_str("the images state no rescale; values may not be HU"),
            Self::OrientationAssumed => f.write_str(
                "the images state positions, but no orientation; rows are taken as running to the left, columns to \
                 the back",
            ),
            Self::PixelSpacingAssumed => {
                f.write_str("the images state no pixel spacing; 1 mm is assumed")
            }
            Self::OneSlice { thickness_mm: Some(mm) } => write!(
                f,
                "there is one slice only; its stated thickness, {mm} mm, is taken as its spacing"
            ),
            Self::OneSlice { thickness_mm: None } => {
                f.write_str("there is one slice only, and no thickness is stated; 1 mm is assumed")
            }
            Self::EmptySlices { slices } => {
                write!(f, "{slices} slices for which the segmentation has no frame are empty")
            }
            Self::NumbersDisagree => f.write_str(
                "instance numbers do not follow the positions; slices are ordered by position",
            ),
            Self::NoPositions { order, step_mm } => {
                let by = match order {
                    SliceOrder::Frames => "in the order of the frames",
                    SliceOrder::InstanceNumbers => "ordered by instance number",
                };
                write!(f, "the images state no positions: {by}, {step_mm} mm apart, placed at the origin")
            }
            Self::Tilt { degrees } => write!(
                f,
                "the slices are stacked {degrees:.2} degrees off their normal (gantry tilt); the volume is sheared \
                 to match"
            ),
            Self::Sideways { mm } => {
                write!(f, "some slices lie up to {mm:.3} mm beside the line of the others")
            }
            Self::NotQuiteEven { worst, mean_mm, off_mm } => write!(
                f,
                "slices are not quite evenly spaced: gaps differ by up to {:.2} % from their mean {mean_mm:.4} mm, \
                 and slices lie up to {off_mm:.3} mm off the regular grid",
                100.0 * worst
            ),
            Self::KeptUneven { mean_mm, off_mm } => write!(
                f,
                "unevenly spaced slices are used as if they were {mean_mm:.4} mm apart; they lie up to {off_mm:.3} \
                 mm off the places that the model shows them at"
            ),
            Self::Filled(gaps) => gaps.fmt(f),
            Self::MosaicSpacing { thickness_mm: Some(mm) } => write!(
                f,
                "the mosaic states no spacing between slices; their thickness, {mm} mm, is taken"
            ),
            Self::MosaicSpacing { thickness_mm: None } => f.write_str(
                "the mosaic states no spacing between slices, and no thickness; 1 mm is assumed",
            ),
            Self::MosaicDirection { header } => {
                f.write_str("the mosaic does not state in which direction its slices follow each other")?;
                if let Some(fault) = header {
                    write!(f, " (its private header cannot be read: {fault})")?;
                }
                f.write_str("; rows x columns is assumed")
            }
            Self::MosaicUnplaced { step_mm } => write!(
                f,
                "the mosaic states no position: its slices are taken in their order, {step_mm} mm apart, placed at \
                 the origin"
            ),
            Self::Duplicates { images, files } => {
                write!(f, "{images} image(s) that are in the series twice were left out: ")?;
                // Images of one file with many frames share its name.
                let mut named: Vec<_> = Vec::new();
                for file in files {
                    if !named.contains(&file) {
                        write!(f, "{}{}", if named.is_empty() { "" } else { ", " }, shown(file))?;
                        named.push(file);
                    }
                }
                match images.saturating_sub(files.len() as u64) {
                    0 => Ok(()),
                    more => write!(f, " and {more} more"),
                }
            }
            Self::Lost { file, error } => write!(f, "{}: {error}", shown(file)),
            Self::Volumes { volumes, by } => {
                write!(f, "the series holds {volumes} volumes, told apart by {}", List(by))
            }
        }
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
