//! Attributes that distinguish the images of a series.

use std::fmt::{self, Display, Formatter};

/// An attribute, or a few that belong together, by the standard's name.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    ImageType,
    Size,
    Orientation,
    PixelSpacing,
    MosaicSlices,
    PixelFormat,
    Stack,
    Segment,
    EchoNumber,
    EchoTime,
    InversionTime,
    FlipAngle,
    TemporalPosition,
    BValue,
    GradientDirection,
    TriggerTime,
    CardiacPhase,
    AcquisitionNumber,
    InstanceNumber,
    AcquisitionTime,
    FrameReferenceTime,
    FrameVectors,
    DimensionIndex,
    Rescale,
    Position,
    SliceThickness,
    SliceSpacing,
    DoseScaling,
    GridOffsets,
    NumberOfFrames,
    AcquisitionOrder,
}

impl Display for Attribute {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ImageType => "Image Type (0008,0008)",
            Self::Size => "Rows and Columns (0028,0010), (0028,0011)",
            Self::Orientation => "Image Orientation (0020,0037)",
            Self::PixelSpacing => "Pixel Spacing (0028,0030)",
            Self::MosaicSlices => "slices of the mosaic (0029,1010)",
            Self::PixelFormat => "format of the pixels, or whether positions are stated",
            Self::Stack => "Stack ID (0020,9056)",
            Self::Segment => "Referenced Segment Number (0062,000B)",
            Self::EchoNumber => "Echo Number (0018,0086)",
            Self::EchoTime => "Echo Time (0018,0081)",
            Self::InversionTime => "Inversion Time (0018,0082)",
            Self::FlipAngle => "Flip Angle (0018,1314)",
            Self::TemporalPosition => "Temporal Position (0020,0100)",
            Self::BValue => "Diffusion b-value (0018,9087)",
            Self::GradientDirection => "Diffusion Gradient Orientation (0018,9089)",
            Self::TriggerTime => "Trigger Time (0018,1060)",
            Self::CardiacPhase => "Cardiac Phase (0020,9241)",
            Self::AcquisitionNumber => "Acquisition Number (0020,0012)",
            Self::InstanceNumber => "Instance Number (0020,0013)",
            Self::AcquisitionTime => "Acquisition Time (0008,0032)",
            Self::FrameReferenceTime => "Frame Reference Time (0054,1300)",
            Self::FrameVectors => "the frame vectors of nuclear medicine (0054,xxxx)",
            Self::DimensionIndex => "Dimension Index Values (0020,9157)",
            Self::Rescale => "Rescale Slope and Intercept (0028,1053), (0028,1052)",
            Self::Position => "Image Position (0020,0032)",
            Self::SliceThickness => "Slice Thickness (0018,0050)",
            Self::SliceSpacing => "Spacing Between Slices (0018,0088)",
            Self::DoseScaling => "Dose Grid Scaling (3004,000E)",
            Self::GridOffsets => "Grid Frame Offset Vector (3004,000C)",
            Self::NumberOfFrames => "Number of Frames (0028,0008)",
            Self::AcquisitionOrder => "order of acquisition and instance",
        })
    }
}

/// Attributes with commas between them.
pub(crate) struct List<'a>(pub(crate) &'a [Attribute]);

impl Display for List<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (i, attribute) in self.0.iter().enumerate() {
            write!(f, "{}{attribute}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}
