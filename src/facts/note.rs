//! What was guessed, left out, replaced or odd about a volume that can be used all the same.

use super::DicomNote;
use super::found::{Choice, Refusal};
use super::left_out::NotVolume;
use super::numbered::NumberNote;
use super::stated::{Carrier, Form, Packing, StatedBy, StatedNumber};
use crate::geom::Orientation;

/// One thing that whoever uses a volume should know of it.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// No spacing is stated; 1 mm is assumed.
    AssumedSpacing {
        /// What does not state it.
        by: Carrier,
    },
    /// No spacing is stated along some axis; 1 mm is assumed there.
    AssumedAxisSpacing,
    /// No directions are stated; the axes are taken as LPS.
    AssumedDirections {
        /// What does not state them.
        by: Carrier,
    },
    /// Directions are stated in a space that is not a patient's, or in none that has a name; they are taken as LPS.
    AssumedSpace {
        /// Name of the space, where it has one.
        space: Option<String>,
    },
    /// No orientation is stated; the axes are taken as right, anterior, superior.
    AssumedRas,
    /// No origin is stated; the first voxel is taken for it.
    AssumedOrigin,
    /// No unit of length is stated; mm is assumed.
    AssumedUnit,
    /// A unit of length that is not known is taken for mm.
    UnknownUnit {
        /// As the file has it.
        unit: String,
    },
    /// No byte order is stated; little-endian is assumed.
    AssumedByteOrder,
    /// Columns or rows are stored from the other end; they are placed so.
    StoredBackwards {
        /// 0 for columns from right to left, 1 for rows from the bottom up.
        axis: usize,
    },
    /// A spacing from outside the file replaced the one that it states.
    SpacingReplaced {
        /// Who gives the new one.
        by: StatedBy,
        /// The new one, mm along x, y, z.
        given_mm: [f64; 3],
        /// The one of the file.
        stated_mm: [f64; 3],
    },
    /// Directions from outside the file replaced those that it states.
    DirectionsReplaced {
        /// Who gives the new ones.
        by: StatedBy,
        /// The new ones.
        given: Orientation,
        /// Letters of the file's axes, each of the direction that it runs along most.
        stated: String,
    },
    /// The sform and the qform of a NIfTI header place the volume differently; the sform is used.
    FormsDiffer,
    /// An affine of a NIfTI header is singular, and is not used.
    SingularForm {
        /// Which one.
        form: Form,
    },
    /// A number of the header is infinite, or not one, and is not used.
    NotFinite(StatedNumber),
    /// 0 is white; the numbers are kept.
    WhiteIsZero,
    /// Pages of reduced size are left out.
    Thumbnails {
        /// How many.
        count: usize,
    },
    /// Samples of fewer than 8 bits are scaled to 0..255.
    BitsScaled {
        /// Bits of a sample.
        bits: u8,
    },
    /// Integers of 64 bits are read as double precision.
    LongIntegers,
    /// The file holds several volumes.
    VolumeOf {
        /// Which of them this is, from 1.
        number: u64,
        /// How many there are.
        count: u64,
    },
    /// The file of samples is longer than the header says; the rest is ignored.
    LongerFile,
    /// Some of the files of samples are longer than the header says; the rest is ignored.
    LongerFiles {
        /// How many of them.
        count: u64,
    },
    /// A stream of samples is longer than the header says; the rest is ignored.
    LongerStream {
        /// How it is packed.
        packing: Packing,
        /// Unpacked bytes that the header says.
        promised: u64,
    },
    /// A side-car has keys that mean nothing.
    UnknownKeys {
        /// Some of these, escaped.
        unknown: Vec<String>,
        /// Those that would mean something.
        known: &'static [&'static str],
    },
    /// Something about a DICOM series.
    Dicom(DicomNote),
    /// Numbers in the names of slices do not follow each other.
    Numbers(NumberNote),
    /// It stands for very many volumes of its input that are alike.
    FirstOfMany {
        /// How many, with this one.
        volumes: usize,
    },
    /// Several volumes were found.
    Chosen(Box<Choice>),
    /// A volume beside the one that is used is damaged.
    DamagedBeside(Refusal),
    /// Files were left out.
    LeftOut {
        /// How many.
        count: u64,
        /// Why.
        why: NotVolume,
        /// Name of the first of them.
        first: String,
    },
    /// More files were left out, for other reasons.
    MoreLeftOut {
        /// How many.
        count: u64,
    },
}

impl Note {
    /// Does it tell of a spacing that was assumed, along one axis at least?
    pub fn assumes_spacing(&self) -> bool {
        match self {
            Self::AssumedSpacing { .. } | Self::AssumedAxisSpacing => true,
            Self::NotFinite(number) => matches!(number, StatedNumber::Spacing { .. }),
            Self::Dicom(note) => note.assumes_spacing(),
            _ => false,
        }
    }

    /// Does it tell of directions that were assumed?
    pub fn assumes_directions(&self) -> bool {
        matches!(self, Self::AssumedDirections { .. } | Self::AssumedSpace { .. } | Self::AssumedRas)
    }
}

impl From<DicomNote> for Note {
    fn from(note: DicomNote) -> Self {
        Self::Dicom(note)
    }
}
