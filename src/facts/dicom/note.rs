//! What was assumed, dropped or changed where a DICOM series became a volume.

use std::path::PathBuf;

use super::attribute::Attribute;
use super::image::CsaFault;
use super::scan::ScanError;
use super::series::ImageName;

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
    /// An RT dose without Dose Grid Scaling.
    DoseUnscaled,
    /// Frames of a film, stacked as if they were slices.
    FramesInTime,
    /// Positions come from the Grid Frame Offset Vector.
    GridPositions,
    /// Positions come from the order of frames and the stated spacing.
    SteppedPositions,
    /// Colour became luminance.
    Luminance,
    /// The colours of a palette became luminance.
    PaletteLuminance,
    /// Values went through the Modality LUT.
    ModalityLut,
    /// Slices differ in rescale, so values are single precision.
    RescalesDiffer,
    /// A CT without rescale.
    NoRescale,
    /// Positions, but no orientation.
    OrientationAssumed,
    /// No Pixel Spacing: 1 mm.
    PixelSpacingAssumed,
    /// A single slice.
    OneSlice {
        /// Its thickness, if stated, which is taken as spacing; else 1 mm.
        thickness_mm: Option<f64>,
    },
    /// Slices that a segmentation leaves out.
    EmptySlices {
        /// How many.
        slices: usize,
    },
    /// Instance numbers do not follow positions.
    NumbersDisagree,
    /// No positions.
    NoPositions {
        /// What orders the slices.
        order: SliceOrder,
        /// Distance at which they are placed.
        step_mm: f64,
    },
    /// Slices are not stacked along their normal.
    Tilt {
        /// Angle between the stack and the normal.
        degrees: f64,
    },
    /// Slices lie beside the line of the others.
    Sideways {
        /// The farthest.
        mm: f64,
    },
    /// Gaps that differ a little.
    NotQuiteEven {
        /// Largest difference from the mean, as a part of it.
        worst: f64,
        /// The mean.
        mean_mm: f64,
        /// How far slices lie from where the volume shows them, at most.
        off_mm: f64,
    },
    /// Gaps that differ, which was accepted.
    KeptUneven {
        /// Their mean.
        mean_mm: f64,
        /// How far slices lie from where the volume shows them, at most.
        off_mm: f64,
    },
    /// Missing slices were made.
    Filled(Box<FilledGaps>),
    /// A mosaic without spacing between slices.
    MosaicSpacing {
        /// The stated thickness, which is taken; else 1 mm.
        thickness_mm: Option<f64>,
    },
    /// A mosaic does not state on which side of a slice the next one lies.
    MosaicDirection {
        /// Why the private header, which has it, cannot be read.
        header: Option<CsaFault>,
    },
    /// A mosaic without position.
    MosaicUnplaced {
        /// Distance of its slices.
        step_mm: f64,
    },
    /// Images that are in the series twice were left out.
    Duplicates {
        /// How many.
        images: u64,
        /// Their files below the folder of the series, as many as are named.
        files: Vec<PathBuf>,
    },
    /// A file that was an image when it was found, and is not any more.
    Lost {
        /// The file, without the folder.
        file: PathBuf,
        /// Why.
        error: ScanError,
    },
    /// The series holds several volumes.
    Volumes {
        /// How many.
        volumes: usize,
        /// What tells them apart.
        by: Vec<Attribute>,
    },
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

/// A gap that was filled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hole {
    /// Slices that were made.
    pub made: u64,
    /// The images on both sides.
    pub between: [ImageName; 2],
}
