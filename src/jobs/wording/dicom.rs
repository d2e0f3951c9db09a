//! Sentences on DICOM files and series.

use std::fmt::{self, Display, Formatter};
use std::io;

use super::foreign::shown;
use crate::facts::SystemError;
use crate::facts::dicom::{
    Attribute, Combination, CsaCount, CsaFault, Damage, DeflateFault, DicomFault, DicomNote, FilledGaps,
    ImageFault, ImageName, MosaicFault, Obstacle, ReadFault, Required, ScanError, SeriesFault, SetApart,
    SliceOrder, TransferSyntax, UnevenGaps,
};

/// Encapsulated syntaxes by the tail of their UID.
const ENCAPSULATED: [(&str, &str); 23] = [
    (".1.98", "uncompressed, encapsulated"),
    (".4.50", "JPEG baseline"),
    (".4.51", "JPEG extended 12-bit"),
    (".4.53", "JPEG spectral selection, retired"),
    (".4.55", "JPEG progressive, retired"),
    (".4.57", "JPEG lossless"),
    (".4.70", "JPEG lossless, first-order prediction"),
    (".4.80", "JPEG-LS lossless"),
    (".4.81", "JPEG-LS near-lossless"),
    (".4.90", "JPEG 2000 lossless"),
    (".4.91", "JPEG 2000"),
    (".4.92", "JPEG 2000 multi-component lossless"),
    (".4.93", "JPEG 2000 multi-component"),
    (".4.94", "JPIP referenced"),
    (".4.95", "JPIP referenced deflate"),
    (".4.100", "MPEG-2"),
    (".4.110", "JPEG XL lossless"),
    (".4.111", "JPEG XL JPEG recompression"),
    (".4.112", "JPEG XL"),
    (".4.201", "HTJ2K lossless"),
    (".4.202", "HTJ2K lossless RPCL"),
    (".4.203", "HTJ2K"),
    (".5", "RLE lossless"),
];

impl Display for TransferSyntax {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImplicitLe => f.write_str("implicit little-endian"),
            Self::ExplicitLe => f.write_str("explicit little-endian"),
            Self::ExplicitBe => f.write_str("explicit big-endian"),
            Self::Deflated => f.write_str("deflated"),
            Self::Encapsulated(uid) => {
                let known = ENCAPSULATED.iter().find(|(tail, _)| self.tail() == Some(tail));
                match known {
                    Some((_, name)) => f.write_str(name),
                    None => write!(f, "compressed, {uid}"),
                }
            }
            Self::Unknown(uid) => write!(f, "unknown syntax {uid}"),
        }
    }
}

/// What can be done about pixels that are not decoded, as the end of a sentence. The converter named for
/// JPEG XL writes uncompressed DICOM by default; DCMTK knows the syntaxes by name only, and `djxl` opens
/// no DICOM.
fn remedy(syntax: &TransferSyntax) -> &'static str {
    match syntax.tail() {
        Some(".4.110" | ".4.111" | ".4.112") => {
            "; convert the file first, for example with dcm2dcm of dcm4che"
        }
        _ => "",
    }
}

impl Display for SystemError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        io::Error::from(*self).fmt(f)
    }
}

impl Display for ReadFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::System(error) => error.fmt(f),
            Self::Deflate(fault) => fault.fmt(f),
        }
    }
}

impl Display for DeflateFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged => f.write_str("its deflate stream is damaged"),
            Self::LongHeader { bytes } => {
                write!(f, "its deflate stream is longer than {bytes} bytes before the pixels")
            }
        }
    }
}

impl Display for ScanError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(fault) => write!(f, "cannot be read ({fault})"),
            Self::NotDicom => f.write_str("is not a DICOM file"),
            Self::Damaged { offset, damage } => {
                write!(f, "is a damaged DICOM file: {damage} (at byte {offset})")
            }
        }
    }
}

/// A tag as the standard writes it.
struct Tag(u32);

impl Display for Tag {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "element ({:04X},{:04X})", self.0 >> 16, self.0 & 0xffff)
    }
}

impl Display for Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::EndsInElement => f.write_str("the file ends inside an element"),
            Self::EndsInHead(tag) => write!(f, "the file ends inside the head of {}", Tag(tag)),
            Self::LongElement { tag, declared, left } => {
                write!(f, "{} declares {declared} bytes, but {left} are left", Tag(tag))
            }
            Self::NoLength(tag) => write!(f, "{} has no length where it needs one", Tag(tag)),
            Self::NoItem(tag) => write!(f, "{} stands where an item must", Tag(tag)),
            Self::Nesting { most } => write!(f, "sequences are nested more than {most} deep"),
            Self::Deflate(fault) => fault.fmt(f),
            Self::SliceVector { numbered, frames } => {
                write!(f, "the Slice Vector (0054,0080) numbers {numbered} of {frames} frames")
            }
            Self::GridOffset(frame) => {
                write!(f, "the grid frame offset vector has no number for frame {}", u64::from(frame) + 1)
            }
            Self::LutWithoutDescriptor => f.write_str("the modality LUT has no descriptor"),
            Self::IncompleteLut => f.write_str("the modality LUT is incomplete"),
            Self::PalettesDiffer => f.write_str("the palettes of red, green and blue differ in size"),
            Self::PaletteWithoutDescriptor => f.write_str("the palette has no descriptor"),
            Self::ShortDescriptor => f.write_str("the descriptor of a table is cut short"),
            Self::EntryBits(bits) => write!(f, "a table has entries of {bits} bits"),
            Self::ShortTable { entries, bytes } => {
                write!(f, "a table of {entries} entries has {bytes} bytes")
            }
            Self::EndsInTable => f.write_str("the file ends inside a table"),
            Self::NotInItems => f.write_str("the compressed pixels are not in items"),
            Self::Fragments { fragments, begun, frames } => write!(
                f,
                "the compressed pixels are {fragments} fragments with {begun} beginnings, which cannot be told \
                 apart into the {frames} frames stated"
            ),
            Self::NoFragment(frame) => {
                write!(f, "the compressed pixels end before frame {}", u64::from(frame) + 1)
            }
            Self::ManyFragments { most } => write!(f, "one frame is cut into more than {most} fragments"),
        }
    }
}

impl Display for ImageFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pixels(obstacle) => obstacle.fmt(f),
            Self::Mosaic(fault) => fault.fmt(f),
            Self::FramesWithoutSlices => f.write_str(
                "its frames are views, detectors, energy windows or points in time, not slices (there is no Slice \
                 Vector (0054,0080)), so they form no volume",
            ),
            Self::Frames(error) => write!(f, "its frames cannot be told apart: {error}"),
            Self::NotFinite(attribute) => write!(
                f,
                "its {attribute} is infinite or not a number, so that neither place nor values are known; correct the \
                 header"
            ),
            Self::Tiles => f.write_str(
                "its frames are tiles of a larger picture (a whole slide, or what was found on one), not slices, so \
                 they form no volume",
            ),
        }
    }
}

impl Display for Obstacle {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPixels { object } => write!(f, "{object} without pixels"),
            Self::Codec(syntax) => {
                write!(f, "compressed pixels ({syntax}) cannot be read{}", remedy(syntax))
            }
            Self::UnknownSyntax(syntax) => write!(f, "pixels in an {syntax} cannot be read"),
            Self::NoDescription { bytes } => write!(
                f,
                "there are {bytes} bytes of pixel data, but no image description: rows, columns and bits allocated \
                 are missing"
            ),
            Self::NoLength(syntax) => {
                write!(f, "the pixels have no length, though {syntax} pixels must have one")
            }
            Self::BadFrames => f.write_str("the number of frames is not a positive number"),
            Self::TooManyFrames { stated, room } => {
                write!(f, "{stated} frames are stated, and the file is too short for more than {room}")
            }
            Self::Colour { photometric, samples } => write!(
                f,
                "colour images ({photometric}, {samples} samples a pixel) of this kind cannot be read"
            ),
            Self::Palette => f.write_str("the palette is missing, or of a kind that cannot be read"),
            Self::BitsAllocated(bits) => write!(f, "pixels of {bits} bits allocated cannot be read"),
            Self::BadBits { allocated, stored, high } => {
                write!(f, "{stored} bits stored with high bit {high} do not fit {allocated} bits allocated")
            }
            Self::Combination(what) => write!(f, "{what} cannot be read"),
            Self::Missing(what) => write!(f, "the image does not state its {what}"),
            Self::Truncated { needed, got } => cut_short(f, *needed, *got),
        }
    }
}

fn cut_short(f: &mut Formatter<'_>, needed: u64, got: u64) -> fmt::Result {
    write!(f, "the pixels are cut short: {got} bytes of {needed}")
}

impl Display for Combination {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CompressedFloats => "compressed floating-point pixels",
            Self::CompressedBits => "compressed pixels of one bit",
            Self::SignedColour => "colour with signed samples",
            Self::SubsampledComponents => "subsampled colour as components",
        })
    }
}

impl Display for Required {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rows => "rows",
            Self::Columns => "columns",
            Self::BitsAllocated => "bits allocated",
        })
    }
}

impl Display for MosaicFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if *self != Self::OtherVendor {
            f.write_str("a Siemens mosaic ")?;
        }
        match self {
            Self::OtherVendor => f.write_str(
                "a frame set of United Imaging (VFRAME) holds its slices as tiles of one picture, which is not read; \
                 export it with one file for each slice",
            ),
            Self::SeveralFrames => f.write_str("of several frames cannot be read"),
            Self::SlicesDisagree { stated: [a, b] } => {
                write!(f, "whose private elements state {a} slices, and {b} in another place")
            }
            Self::NoSliceNumber { header } => {
                f.write_str(
                    "does not state the number of its slices, which only the private header (0029,1010) has",
                )?;
                if let Some(fault) = header {
                    write!(f, " (it cannot be read: {fault})")?;
                }
                f.write_str("; give the original files, or convert them on the scanner")
            }
            Self::Tiles { slices, across, columns, rows } => write!(
                f,
                "of {slices} slices has {across} x {across} tiles, and its {columns} x {rows} pixels cannot be \
                 divided so"
            ),
            Self::OtherNormal => f.write_str(
                "states a slice normal in its private header that is not perpendicular to its rows and columns",
            ),
        }
    }
}

impl Display for CsaFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read(fault) => fault.fmt(f),
            Self::Element(error) => error.fmt(f),
            Self::EndsEarly { lacking: Some(bytes) } => write!(f, "it ends {bytes} bytes too early"),
            Self::EndsEarly { lacking: None } => f.write_str("it ends too early"),
            Self::Count { of: CsaCount::Tags, stated } => write!(f, "it states {stated} tags"),
            Self::Count { of: CsaCount::Items, stated } => write!(f, "it states {stated} items"),
            Self::LongItem => f.write_str("an item is longer than the rest of it"),
        }
    }
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
            Self::AcquisitionTime => "Acquisition Time (0008,0032)",
            Self::FrameReferenceTime => "Frame Reference Time (0054,1300)",
            Self::FrameVectors => "the frame vectors of nuclear medicine (0054,xxxx)",
            Self::DimensionIndex => "Dimension Index Values (0020,9157)",
            Self::Rescale => "Rescale Slope and Intercept (0028,1053), (0028,1052)",
            Self::Position => "Image Position (0020,0032)",
            Self::SliceThickness => "Slice Thickness (0018,0050)",
            Self::SliceSpacing => "Spacing Between Slices (0018,0088)",
            Self::DoseScaling => "Dose Grid Scaling (3004,000E)",
            Self::AcquisitionOrder => "order of acquisition and instance",
        })
    }
}

/// Attributes with commas between them.
struct List<'a>(&'a [Attribute]);

impl Display for List<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (i, attribute) in self.0.iter().enumerate() {
            write!(f, "{}{attribute}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
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

impl Display for SeriesFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoImage => f.write_str("no image"),
            Self::OnePosition { images } => {
                write!(f, "all {images} images are at one position; they form no volume: give the whole series, or build one image as a picture")
            }
            Self::Repeated { repeats, images, first } => write!(
                f,
                "{repeats} of {images} images repeat the position of another (first: {} and {}), and nothing in \
                 their headers tells them apart; give the files of one volume",
                first[0], first[1]
            ),
            Self::Uneven(gaps) => gaps.fmt(f),
            Self::TooFar { slices, images } => write!(
                f,
                "{slices} slices would have to be made out of {images}; give the files of an evenly spaced part"
            ),
            Self::Orientation => {
                f.write_str("the image orientation is not two perpendicular unit vectors")
            }
            Self::Flat => f.write_str("the positions do not span a volume"),
            Self::NoOrder => f.write_str(
                "the images state no positions and no distinct instance numbers, so their order is unknown; convert \
                 them to a raw volume in the right order",
            ),
            Self::RescaleMissing { lacking, slices } => write!(
                f,
                "{lacking} of {slices} slices state no rescale slope and intercept, so their values cannot be \
                 compared"
            ),
            Self::RescaleZero => {
                f.write_str("the rescale slope is 0, so every pixel would have the same value")
            }
            Self::SampleTypes => f.write_str("its images do not have one type of samples"),
            Self::ManyPaddings => f.write_str("too many padding values"),
            Self::ManyFiles => f.write_str("too many files"),
            Self::Size { columns, rows, slices } => {
                write!(f, "{columns}x{rows}x{slices} voxels are out of range")
            }
            Self::Incomplete => f.write_str("an image without layout or file"),
        }
    }
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
             --gaps fill or --gaps keep"
        )?;
        self.set_apart.as_ref().map_or(Ok(()), |others| others.fmt(f))
    }
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

/// What to do about a file that breaks off, or is damaged, among others.
const WITHOUT_IT: &str = "; copy the file again, or move it away to build without it";

/// What to do about a file that proved damaged when it was decoded.
const LEAVE_OUT: &str = "; copy the file again, or leave it out";

impl Display for DicomFault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header(error) => error.fmt(f),
            Self::Lost(error) => write!(f, "{error}; was it changed while the folders were searched?"),
            Self::Changed => f.write_str("was changed since it was found; start again"),
            Self::Image(fault) if fault.is_cut_short() => write!(f, "{fault}{WITHOUT_IT}"),
            Self::Image(fault) => fault.fmt(f),
            Self::OneImage(fault) => write!(f, "{fault}{WITHOUT_IT}"),
            Self::EveryImage { images, first } => {
                write!(f, "none of its {images} images can be used: {first}")
            }
            Self::Series(fault) => fault.fmt(f),
            Self::Elements(error) => write!(f, "{error}{LEAVE_OUT}"),
            Self::Deflate(fault) => write!(f, "cannot be decoded: {fault}"),
            Self::PixelsCut { needed, got } => {
                cut_short(f, *needed, *got)?;
                f.write_str(LEAVE_OUT)
            }
            Self::Frame { frame: Some(frame), error } => {
                write!(f, "in frame {} {error}", u64::from(*frame) + 1)
            }
            Self::Frame { frame: None, error } => error.fmt(f),
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_named_syntax_is_encapsulated() {
        for (tail, name) in ENCAPSULATED {
            let syntax = TransferSyntax::from_uid(&format!("1.2.840.10008.1.2{tail}"));
            assert!(matches!(syntax, TransferSyntax::Encapsulated(_)), "{tail}");
            assert_eq!(syntax.to_string(), name);
        }
    }

    #[test]
    fn what_the_system_says_comes_through() {
        let missing = io::Error::from_raw_os_error(2);
        assert_eq!(SystemError::from(&missing).to_string(), missing.to_string());
        let fault: ReadFault = io::Error::from(DeflateFault::Damaged).into();
        assert_eq!(fault, ReadFault::Deflate(DeflateFault::Damaged));
    }
}
