//! Attributes that images of a series are told apart by.

/// An attribute, or a few that belong together, by the standard's name.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// Image Type.
    ImageType,
    /// Rows and Columns.
    Size,
    /// Image Orientation (Patient).
    Orientation,
    /// Pixel Spacing.
    PixelSpacing,
    /// How many slices a mosaic has, and how they lie.
    MosaicSlices,
    /// How pixels are stored, or whether positions are stated.
    PixelFormat,
    /// Stack ID.
    Stack,
    /// Referenced Segment Number.
    Segment,
    /// Echo Number(s).
    EchoNumber,
    /// Echo Time.
    EchoTime,
    /// Inversion Time.
    InversionTime,
    /// Flip Angle.
    FlipAngle,
    /// Temporal Position Identifier, or Index.
    TemporalPosition,
    /// Diffusion b-value.
    BValue,
    /// Diffusion Gradient Orientation.
    GradientDirection,
    /// Trigger Time.
    TriggerTime,
    /// Nominal Percentage of Cardiac Phase.
    CardiacPhase,
    /// Acquisition Number.
    AcquisitionNumber,
    /// Acquisition Time.
    AcquisitionTime,
    /// Frame Reference Time.
    FrameReferenceTime,
    /// The vectors that number the frames of nuclear medicine.
    FrameVectors,
    /// Dimension Index Values.
    DimensionIndex,
    /// Rescale Slope and Rescale Intercept.
    Rescale,
    /// Image Position (Patient).
    Position,
    /// Slice Thickness.
    SliceThickness,
    /// Spacing Between Slices.
    SliceSpacing,
    /// Dose Grid Scaling.
    DoseScaling,
    /// No attribute: the order in which images were acquired and numbered.
    AcquisitionOrder,
}
