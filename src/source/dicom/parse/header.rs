//! The elements of one image that a volume needs, parsed (PS3.3 C.7.6, C.11.1; PS3.5 section 6.2).

use super::private::Private;
use super::value::{
    Judgement, Stated, Tag, WrongNumbers, double, doubles, integer, long_of, number, numbers, raw_double,
    raw_single, single, text, time_of, word_of,
};
use crate::source::dicom::attribute::Attribute;
use crate::source::dicom::parse::syntax::TransferSyntax;
use crate::source::finding::BurnedIn;
use crate::volume::{Endian, FRACTIONAL};

/// Longest value that is looked at; every kept element is far shorter in a sound file.
pub(crate) const MAX_VALUE_BYTES: usize = 1024;

/// SOP class of label map segmentations, without the root of the standard's own.
const LABEL_MAP: &str = "5.1.4.1.1.66.7";

/// The kind of segmentations with labels.
pub(crate) const SEGMENTATION: &str = "segmentation";

/// SOP classes of ultrasound, in the same way.
const ULTRASOUND: [&str; 5] =
    ["5.1.4.1.1.3", "5.1.4.1.1.3.1", "5.1.4.1.1.6", "5.1.4.1.1.6.1", "5.1.4.1.1.6.2"];

/// Kind of pixel element, of three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelElement {
    /// (7FE0,0010) Pixel Data: integers or encapsulated frames.
    Integer,
    /// (7FE0,0008) Float Pixel Data.
    Float,
    /// (7FE0,0009) Double Float Pixel Data.
    Double,
}

/// Tags of [`ElementOffsets::frame_vectors`].
const FRAME_VECTORS: [Tag; 8] =
    [0x0054_0010, 0x0054_0020, 0x0054_0030, 0x0054_0050, 0x0054_0060, 0x0054_0070, 0x0054_0090, 0x0054_0100];

/// Location of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelData {
    /// Kind of element.
    pub element: PixelElement,
    /// Offset of the first byte of the value in the file.
    pub offset: u64,
    /// Declared length in bytes; `None` for undefined, which means encapsulated frames.
    pub declared: Option<u32>,
    /// Bytes of the value that the file really has.
    pub available: u64,
    /// True if the value representation is OW (words). Matters for 8-bit pixels in big-endian files only.
    pub words: bool,
}

/// Encoding of elements at some place of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Encoding {
    /// True if each element states its VR.
    pub explicit: bool,
    /// Byte order of tags, lengths and binary values.
    pub endian: Endian,
}

/// Offsets of the heads of longer elements; `None` where the file has no such element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ElementOffsets {
    /// (5200,9229) Shared Functional Groups Sequence.
    pub shared_groups: Option<u64>,
    /// (5200,9230) Per-Frame Functional Groups Sequence.
    pub frame_groups: Option<u64>,
    /// (0062,0002) Segment Sequence.
    pub segments: Option<u64>,
    /// (0054,0022) Detector Information Sequence, which has the geometry of nuclear medicine images.
    pub detectors: Option<u64>,
    /// (3004,000C) Grid Frame Offset Vector.
    pub grid_offsets: Option<u64>,
    /// (0054,0080) Slice Vector of nuclear medicine.
    pub slice_vector: Option<u64>,
    /// The other vectors that number the frames of nuclear medicine: energy windows, detectors, phases,
    /// rotations, R-R intervals, time slots, angular views, time slices.
    pub frame_vectors: [Option<u64>; 8],
    /// (0028,3000) Modality LUT Sequence.
    pub modality_lut: Option<u64>,
    /// (0028,1101) to (0028,1103): descriptors of the red, green and blue palette.
    pub palette_descriptors: [Option<u64>; 3],
    /// (0028,1201) to (0028,1203): data of the red, green and blue palette.
    pub palettes: [Option<u64>; 3],
    /// (0029,xx10) of the block `SIEMENS CSA HEADER`.
    pub csa: Option<u64>,
    /// (7FE0,0001) Extended Offset Table.
    pub offset_table: Option<u64>,
    /// (0065,xx51): the frames of a set that lies in one picture, as United Imaging writes them.
    pub frame_set: Option<u64>,
}

impl ElementOffsets {
    /// Stores the offset of an element, if it is one of these.
    pub(crate) fn keep(&mut self, tag: Tag, at: u64) {
        let slot = match tag {
            0x5200_9229 => &mut self.shared_groups,
            0x5200_9230 => &mut self.frame_groups,
            0x0062_0002 => &mut self.segments,
            0x0054_0022 => &mut self.detectors,
            0x3004_000c => &mut self.grid_offsets,
            0x0054_0080 => &mut self.slice_vector,
            _ if FRAME_VECTORS.contains(&tag) => {
                let at = FRAME_VECTORS.iter().position(|vector| *vector == tag);
                match at.and_then(|at| self.frame_vectors.get_mut(at)) {
                    Some(slot) => slot,
                    None => return,
                }
            }
            0x0028_3000 => &mut self.modality_lut,
            0x0028_1101..=0x0028_1103 | 0x0028_1201..=0x0028_1203 => {
                let list = if tag < 0x0028_1200 { &mut self.palette_descriptors } else { &mut self.palettes };
                match list.get_mut((tag & 0xf) as usize - 1) {
                    Some(slot) => slot,
                    None => return,
                }
            }
            0x7fe0_0001 => &mut self.offset_table,
            // The element may lie in any block of private elements.
            _ if tag & 0xffff_00ff == 0x0065_0051 && tag & 0xff00 != 0 => &mut self.frame_set,
            _ => return,
        };
        slot.get_or_insert(at);
    }
}

/// Attributes of the image in one DICOM file; `None` where an element is missing or illegible.
///
/// No patient data is kept: no names, no numbers of patients, no dates, no free text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DicomHeader {
    /// Encoding of elements and pixels.
    pub transfer_syntax: TransferSyntax,
    /// SOP class UID (0008,0016), or the meta header's.
    pub sop_class: String,
    /// Study Instance UID.
    pub study_uid: String,
    /// Series Instance UID.
    pub series_uid: String,
    /// Image Type, values joined by backslashes.
    pub image_type: String,
    /// Modality, for example `CT`.
    pub modality: String,
    /// Body Part Examined, for example `CHEST`.
    pub body_part: String,
    /// Photometric Interpretation, for example `MONOCHROME2`.
    pub photometric: String,
    /// Series Number.
    pub series_number: Option<i32>,
    /// SOP Instance UID: the same in copies of one image.
    pub instance_uid: String,
    /// Acquisition Number.
    pub acquisition: Option<i32>,
    /// Instance Number.
    pub instance: Option<i32>,
    /// Samples per Pixel.
    pub samples: Option<u16>,
    /// Planar Configuration.
    pub planar: Option<u16>,
    /// Rows (height).
    pub rows: Option<u16>,
    /// Columns (width).
    pub columns: Option<u16>,
    /// Bits Allocated.
    pub bits_allocated: Option<u16>,
    /// Bits Stored.
    pub bits_stored: Option<u16>,
    /// High Bit.
    pub high_bit: Option<u16>,
    /// Pixel Representation: 0 unsigned, 1 two's complement.
    pub pixel_representation: Option<u16>,
    /// Number of Frames; its text where that is not a number.
    pub frames: Option<Result<u32, String>>,
    /// Frame Increment Pointer, the first tag.
    pub frame_increment: Option<u32>,
    /// Image Position (Patient): centre of the first pixel in LPS mm.
    pub position: Option<[f64; 3]>,
    /// Image Orientation (Patient): direction along a row, then down a column.
    pub orientation: Option<[f64; 6]>,
    /// Pixel Spacing in mm: between rows, then between columns.
    pub pixel_spacing: Option<[f64; 2]>,
    /// Slice Thickness in mm; not the distance of slices.
    pub slice_thickness: Option<f64>,
    /// Spacing Between Slices in mm.
    pub spacing_between: Option<f64>,
    /// Rescale Slope.
    pub slope: Option<f64>,
    /// Rescale Intercept.
    pub intercept: Option<f64>,
    /// Dose Grid Scaling: Gy (or a part of the prescription) for each step of an RT dose's stored values.
    pub dose_scaling: Option<f64>,
    /// Pixel Padding Value, as its 16 bits in the file.
    pub padding: Option<u16>,
    /// Pixel Padding Range Limit, as its 16 bits.
    pub padding_limit: Option<u16>,
    /// Float or Double Float Pixel Padding Value, which may be NaN.
    pub float_padding: Option<f64>,
    /// Float or Double Float Pixel Padding Range Limit.
    pub float_padding_limit: Option<f64>,
    /// Echo Time in ms.
    pub echo_time: Option<f64>,
    /// Echo Number(s), the first.
    pub echo_number: Option<i32>,
    /// Repetition Time in ms.
    pub repetition_time: Option<f64>,
    /// Inversion Time in ms.
    pub inversion_time: Option<f64>,
    /// Flip Angle in degrees.
    pub flip_angle: Option<f64>,
    /// Trigger Time in ms.
    pub trigger_time: Option<f64>,
    /// Temporal Position Identifier.
    pub temporal_position: Option<i32>,
    /// Diffusion b-value in s/mm2.
    pub b_value: Option<f64>,
    /// Complex Image Component: `MAGNITUDE`, `PHASE`, ...
    pub complex_component: String,
    /// Diffusion Gradient Orientation, a unit vector in patient coordinates.
    pub gradient: Option<[f64; 3]>,
    /// Nominal Percentage of Cardiac Phase.
    pub cardiac_phase: Option<f64>,
    /// Acquisition Time, or the time of Acquisition DateTime, as the number HHMMSS.FFFFFF; only to
    /// distinguish images.
    pub acquisition_time: Option<f64>,
    /// Private elements of mosaics.
    pub private: Private,
    /// Frame Reference Time of PET in ms; only to distinguish images.
    pub frame_reference_time: Option<f64>,
    /// True if Burned In Annotation says YES.
    pub burned_in: bool,
    /// True if a Conversion Type is stated, as for secondary captures.
    pub converted: bool,
    /// True if there is a Modality LUT Sequence: values are then not linear.
    pub modality_lut: bool,
    /// The first attribute with wrong numbers, among those that place the image, scale its values or distinguish it.
    pub wrong: Option<WrongNumbers>,
    /// The first such attribute with a decimal comma.
    pub comma: Option<Attribute>,
    /// True if Segmentation Type says FRACTIONAL: values are then parts, not labels.
    pub fractional: bool,
    /// True if Dimension Organization Type says that frames are tiles.
    pub tiled: bool,
    /// Total Pixel Matrix Columns and Rows of a picture whose frames are tiles.
    pub total_matrix: [Option<u32>; 2],
    /// Encoding of elements.
    pub encoding: Encoding,
    /// Offset of the elements after the meta header. In a deflated file, offsets from here on count bytes of the
    /// inflated stream.
    pub dataset: u64,
    /// Offsets of longer elements, which are read only when needed.
    pub offsets: ElementOffsets,
    /// Pixels, if the file has any.
    pub pixels: Option<PixelData>,
}

impl DicomHeader {
    pub(crate) fn new(transfer_syntax: TransferSyntax) -> Self {
        let encoding = Encoding { explicit: true, endian: Endian::Little };
        Self { transfer_syntax, encoding, ..Self::default() }
    }

    /// Kind of object, in words without patient data: `CT image`, `DICOMDIR`, ...
    pub(crate) fn kind(&self) -> String {
        let class = self.sop_class.strip_prefix("1.2.840.10008.").unwrap_or(&self.sop_class);
        let known = match class {
            "1.3.10" => "DICOMDIR",
            "5.1.4.1.1.1" => "CR image",
            "5.1.4.1.1.2" => "CT image",
            "5.1.4.1.1.2.1" => "enhanced CT",
            "5.1.4.1.1.4" => "MR image",
            "5.1.4.1.1.4.1" => "enhanced MR",
            "5.1.4.1.1.3.1" | "5.1.4.1.1.6.1" => "ultrasound image",
            "5.1.4.1.1.7" => "secondary capture",
            "5.1.4.1.1.7.1" | "5.1.4.1.1.7.2" | "5.1.4.1.1.7.3" | "5.1.4.1.1.7.4" => {
                "multi-frame secondary capture"
            }
            "5.1.4.1.1.13.1.1" | "5.1.4.1.1.13.1.2" | "5.1.4.1.1.13.1.3" => "X-ray 3D image",
            "5.1.4.1.1.20" => "NM image",
            "5.1.4.1.1.130" => "enhanced PET",
            "5.1.4.1.1.66.4" if self.fractional => FRACTIONAL,
            "5.1.4.1.1.66.4" | LABEL_MAP => SEGMENTATION,
            "5.1.4.1.1.30" => "parametric map",
            "5.1.4.1.1.128" => "PET image",
            "5.1.4.1.1.481.2" => "RT dose",
            "5.1.4.1.1.481.3" => "RT structure set",
            "5.1.4.1.1.481.5" => "RT plan",
            _ if class.starts_with("5.1.4.1.1.88.") => "structured report",
            _ if self.modality.is_empty() => "DICOM object",
            _ => return format!("{} object", self.modality),
        };
        known.into()
    }

    /// True if its frames are tiles of a larger picture, not slices: a whole slide, for example, or a segmentation of
    /// one.
    pub(crate) fn is_tiled(&self) -> bool {
        let sides = [self.columns, self.rows].map(|side| side.map(u32::from));
        let larger = |(total, side): (&Option<u32>, Option<u32>)| total.zip(side).is_some_and(|(a, b)| a > b);
        self.tiled
            || self.sop_class == "1.2.840.10008.5.1.4.1.1.77.1.6"
            || self.total_matrix.iter().zip(sides).any(larger)
    }

    /// True for an RT dose. Its values are scaled by Dose Grid Scaling alone (PS3.3 C.8.8.3).
    pub(crate) fn is_dose(&self) -> bool {
        self.sop_class == "1.2.840.10008.5.1.4.1.1.481.2" || self.modality == "RTDOSE"
    }

    /// True for a parametric map, whose values follow from its Real World Value Mapping.
    pub(crate) fn is_parametric_map(&self) -> bool {
        self.sop_class == "1.2.840.10008.5.1.4.1.1.30"
    }

    /// True if frames follow each other by Frame Time or Frame Time Vector.
    pub(crate) fn is_film(&self) -> bool {
        matches!(self.frame_increment, Some(0x0018_1063 | 0x0018_1065))
    }

    /// Reason why its pixels may carry text, if there is one.
    pub(crate) fn may_show_text(&self) -> Option<BurnedIn> {
        let class = self.sop_class.strip_prefix("1.2.840.10008.").unwrap_or(&self.sop_class);
        let is_screen = |part: &str| {
            ["SCREEN", "SAVE", "CAPTURE"].iter().any(|word| part.to_ascii_uppercase().contains(word))
        };
        if self.burned_in {
            Some(BurnedIn::Stated)
        } else if ULTRASOUND.contains(&class) || ["US", "IVUS"].contains(&self.modality.as_str()) {
            Some(BurnedIn::Ultrasound)
        } else if class == "5.1.4.1.1.7" || class.starts_with("5.1.4.1.1.7.") || self.converted {
            Some(BurnedIn::SecondaryCapture)
        } else if self.image_type.split('\\').any(is_screen) {
            Some(BurnedIn::ScreenCapture)
        } else {
            None
        }
    }

    /// True for a segmentation, whose numbers are labels in any colours.
    pub(crate) fn is_segmentation(&self) -> bool {
        [SEGMENTATION, FRACTIONAL].contains(&self.kind().as_str())
    }

    /// Takes over one element of the main dataset, if it is one that matters; `value` may be cut at
    /// [`MAX_VALUE_BYTES`]. An illegible value leaves `None`.
    pub(crate) fn keep(&mut self, tag: Tag, value: &[u8], endian: Endian) {
        match numeric(tag).map_or(Judgement::Sound, |numbers| numbers.judge(value)) {
            Judgement::Sound => {}
            Judgement::Comma(attribute) => self.comma = self.comma.or(Some(attribute)),
            Judgement::Wrong(wrong) => _ = self.wrong.get_or_insert(wrong),
        }
        if !keep_known(self, tag, value, endian) {
            self.private.keep(tag, value, endian);
        }
    }

    /// True if [`DicomHeader::keep`] looks at this tag.
    pub(crate) fn wants(tag: Tag) -> bool {
        is_known(tag) || Private::wants(tag)
    }
}

/// Turns a table of elements into `keep_known`, which takes over an element of the table, and `is_known`.
macro_rules! elements {
    (|$header:ident, $value:ident, $endian:ident| $($tag:pat => $keep:expr,)*) => {
        fn keep_known($header: &mut DicomHeader, tag: Tag, $value: &[u8], $endian: Endian) -> bool {
            match tag {
                $($tag => $keep,)*
                _ => return false,
            }
            true
        }

        fn is_known(tag: Tag) -> bool {
            matches!(tag, $($tag)|*)
        }
    };
}

elements! { |header, value, endian|
    0x0008_0008 => header.image_type = text(value),
    0x0008_0016 => header.sop_class = text(value),
    0x0008_0018 => header.instance_uid = text(value),
    0x0008_9208 => header.complex_component = text(value),
    0x0008_002a => header.acquisition_time = header.acquisition_time.or(time_of(value)),
    // Acquisition Time comes after Acquisition DateTime, and is preferred.
    0x0008_0032 => header.acquisition_time = number(value).or(header.acquisition_time),
    0x0054_1300 => header.frame_reference_time = number(value),
    0x0008_0064 => header.converted = !text(value).is_empty(),
    0x0028_0301 => header.burned_in = text(value) == "YES",
    0x0018_9089 => header.gradient = doubles(value, endian),
    0x0020_9241 => header.cardiac_phase = single(value, endian),
    0x0008_0060 => header.modality = text(value),
    0x0018_0015 => header.body_part = text(value),
    0x0018_0050 => header.slice_thickness = number(value),
    0x0018_0080 => header.repetition_time = number(value),
    0x0018_0081 => header.echo_time = number(value),
    0x0018_0082 => header.inversion_time = number(value),
    0x0018_0086 => header.echo_number = integer(value),
    0x0018_0088 => header.spacing_between = number(value),
    0x0018_1060 => header.trigger_time = number(value),
    0x0018_1314 => header.flip_angle = number(value),
    0x0018_9087 => header.b_value = double(value, endian),
    0x0020_0011 => header.series_number = integer(value),
    0x0020_0100 => header.temporal_position = integer(value),
    0x0020_000d => header.study_uid = text(value),
    0x0020_000e => header.series_uid = text(value),
    0x0020_0012 => header.acquisition = integer(value),
    0x0020_0013 => header.instance = integer(value),
    0x0020_0032 => header.position = numbers(value),
    0x0020_0037 => header.orientation = numbers(value),
    0x0028_0002 => header.samples = word_of(value, endian),
    0x0028_0004 => header.photometric = text(value),
    0x0028_0006 => header.planar = word_of(value, endian),
    0x0028_0008 => {
        let digits = text(value);
        header.frames = (!digits.is_empty()).then(|| digits.parse().map_err(|_| digits.chars().take(64).collect()));
    },
    0x0028_0009 => {
        let element = value.get(2..).and_then(|rest| word_of(rest, endian));
        header.frame_increment =
            word_of(value, endian).zip(element).map(|(group, element)| u32::from(group) << 16 | u32::from(element));
    },
    0x0028_0010 => header.rows = word_of(value, endian),
    0x0028_0011 => header.columns = word_of(value, endian),
    0x0028_0030 => header.pixel_spacing = numbers(value),
    0x0028_0100 => header.bits_allocated = word_of(value, endian),
    0x0028_0101 => header.bits_stored = word_of(value, endian),
    0x0028_0102 => header.high_bit = word_of(value, endian),
    0x0028_0103 => header.pixel_representation = word_of(value, endian),
    0x0028_0120 => header.padding = word_of(value, endian),
    0x0028_0121 => header.padding_limit = word_of(value, endian),
    0x0028_0122 => header.float_padding = raw_single(value, endian),
    0x0028_0123 => header.float_padding = raw_double(value, endian),
    0x0028_0124 => header.float_padding_limit = raw_single(value, endian),
    0x0028_0125 => header.float_padding_limit = raw_double(value, endian),
    0x0028_1052 => header.intercept = number(value),
    0x0028_1053 => header.slope = number(value),
    0x0028_3000 => header.modality_lut = true,
    0x0062_0001 => header.fractional = text(value) == "FRACTIONAL",
    0x3004_000e => header.dose_scaling = number(value),
    0x0020_9311 => header.tiled = text(value).starts_with("TILED"),
    0x0048_0006 => header.total_matrix[0] = long_of(value, endian),
    0x0048_0007 => header.total_matrix[1] = long_of(value, endian),
}

/// Numbers that an element states as text, if they place an image, scale its values or distinguish it.
pub(super) fn numeric(tag: Tag) -> Option<Stated> {
    let of = |attribute, count, whole| Some(Stated { attribute, count, whole });
    let decimals = |attribute, count| of(attribute, Some(count), false);
    match tag {
        0x0018_0050 => decimals(Attribute::SliceThickness, 1),
        0x0018_0081 => decimals(Attribute::EchoTime, 1),
        0x0018_0082 => decimals(Attribute::InversionTime, 1),
        0x0018_0086 => of(Attribute::EchoNumber, None, true),
        0x0018_0088 => decimals(Attribute::SliceSpacing, 1),
        0x0018_1060 => decimals(Attribute::TriggerTime, 1),
        0x0018_1314 => decimals(Attribute::FlipAngle, 1),
        0x0020_0012 => of(Attribute::AcquisitionNumber, Some(1), true),
        0x0020_0013 => of(Attribute::InstanceNumber, Some(1), true),
        0x0020_0032 => decimals(Attribute::Position, 3),
        0x0020_0037 => decimals(Attribute::Orientation, 6),
        0x0020_0100 => of(Attribute::TemporalPosition, Some(1), true),
        0x0028_0030 => decimals(Attribute::PixelSpacing, 2),
        0x0028_1052 | 0x0028_1053 => decimals(Attribute::Rescale, 1),
        0x0054_1300 => decimals(Attribute::FrameReferenceTime, 1),
        0x3004_000e => decimals(Attribute::DoseScaling, 1),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kept_tag_is_wanted() {
        let mut header = DicomHeader::new(TransferSyntax::ExplicitLe);
        let untouched = header.clone();
        for tag in (0x0002_0000..0x0030_0000)
            .chain(0x0048_0000..0x0049_0000)
            .chain(0x0062_0000..0x0063_0000)
            .chain(0x3004_0000..0x3005_0000)
            .filter(|tag| !DicomHeader::wants(*tag))
        {
            // Long enough for a binary double, and a text that is a number.
            header.keep(tag, b"1\0", Endian::Little);
            header.keep(tag, b"1.000000", Endian::Little);
        }
        assert_eq!(header, untouched);
        header.keep(0x0028_0010, &[2, 0], Endian::Big);
        assert_eq!(header.rows, Some(512));
    }
}
