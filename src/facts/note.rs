//! What was guessed, left out, replaced or odd about a volume that can be used all the same.

use std::path::Path;

use thiserror::Error;

use super::DicomNote;
use super::error::Reason;
use super::found::{Choice, Refusal};
use super::left_out::NotVolume;
use super::numbered::NumberNote;
use super::stated::{Carrier, Form, Packing, StatedBy, StatedNumber};
use crate::geom::Orientation;
use crate::text::names::{ALL_VOLUMES, KEEP_NAMES, ORIENTATION, SPACING};
use crate::text::shown;

/// One thing that a user of a volume should know of it.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Note {
    #[error("{} states no spacing; 1 mm is assumed", match by {
        Carrier::Header => "the header",
        Carrier::Tiff => "this TIFF",
        Carrier::Png => "PNG",
        Carrier::Npy => "an .npy file",
        Carrier::Zarr => "a Zarr array",
    })]
    AssumedSpacing {
        /// What does not state it.
        by: Carrier,
    },
    #[error("the header states no spacing along some axis; 1 mm is assumed")]
    AssumedAxisSpacing,
    #[error("{} states no directions; its axes are taken as LPS", match by {
        Carrier::Header => "the header",
        Carrier::Tiff => "TIFF",
        Carrier::Png => "PNG",
        Carrier::Npy => "an .npy file",
        Carrier::Zarr => "a Zarr array",
    })]
    AssumedDirections {
        /// What does not state them.
        by: Carrier,
    },
    #[error("{}; its directions are taken as LPS", match space {
        None => "the header states no space".to_owned(),
        Some(space) => format!("the space `{}` is not a patient's", space.escape_debug()),
    })]
    AssumedSpace {
        /// Name of the space, where it has one.
        space: Option<String>,
    },
    #[error(
        "the header states no orientation; its axes are taken as right, anterior, superior, so left and right may be \
         swapped"
    )]
    AssumedRas,
    #[error("the header states no origin; the first voxel is used as the origin")]
    AssumedOrigin,
    #[error("the header states no unit of length; mm is assumed")]
    AssumedUnit,
    #[error("the unit `{}` is taken for mm", unit.escape_debug())]
    UnknownUnit { unit: String },
    #[error("the header states no byte order; little-endian is assumed")]
    AssumedByteOrder,
    #[error("{} (Orientation), and are placed so", match axis {
        0 => "columns are stored from right to left",
        _ => "rows are stored from the bottom up",
    })]
    StoredBackwards {
        /// 0 for columns from right to left, 1 for rows from the bottom up.
        axis: usize,
    },
    /// A spacing from outside the file replaced the one that it states.
    #[error(
        "{} gives {}; the file states {}, which is not used",
        by.named(SPACING, "spacing"), mm(*given_mm), mm(*stated_mm)
    )]
    SpacingReplaced {
        /// Who gives the new one.
        by: StatedBy,
        /// The new one, mm along x, y, z.
        given_mm: [f64; 3],
        /// The one of the file.
        stated_mm: [f64; 3],
    },
    /// Directions from outside the file replaced those that it states.
    #[error(
        "{} gives {given}; the directions that the file states, about {stated}, are not used",
        by.named(ORIENTATION, "orientation")
    )]
    DirectionsReplaced {
        /// Who gives the new ones.
        by: StatedBy,
        /// The new ones.
        given: Orientation,
        /// Letters of the file's axes, each of the direction that it runs along most.
        stated: String,
    },
    #[error(
        "sform and qform of the header place the volume differently; the sform is used, and other programs may use \
         the qform"
    )]
    FormsDiffer,
    /// An affine of a NIfTI header is singular.
    #[error("the {form} of the header is singular and is not used")]
    SingularForm { form: Form },
    #[error(transparent)]
    NotFinite(StatedNumber),
    #[error("0 is white in these pictures; the numbers are kept as they are")]
    WhiteIsZero,
    #[error("{count} pages of reduced size (thumbnails) are left out")]
    Thumbnails { count: usize },
    #[error("samples of {bits} bits are scaled to 0..255")]
    BitsScaled { bits: u8 },
    #[error("64-bit integers are read as double precision, which is exact up to 2^53")]
    LongIntegers,
    #[error("this is volume {number} of {count} in the file")]
    VolumeOf { number: u64, count: u64 },
    #[error("the file held more than the header promises; the rest is ignored")]
    LongerFile,
    #[error("{count} of the data files held more than the header promises; the rest is ignored")]
    LongerFiles { count: u64 },
    #[error(
        "the {packing} stream holds more than the {promised} bytes that the header promises; the rest is ignored"
    )]
    LongerStream { packing: Packing, promised: u64 },
    #[error(
        "the side-car has keys that are not known: {}; known are {}", unknown.join(", "), known.join(", ")
    )]
    UnknownKeys { unknown: Vec<String>, known: &'static [&'static str] },
    #[error(transparent)]
    Dicom(DicomNote),
    #[error("{0}")]
    Numbers(NumberNote),
    #[error("this is the first of {volumes} similar volumes; {ALL_VOLUMES} also takes the others")]
    FirstOfMany { volumes: usize },
    #[error("{0}")]
    Chosen(Box<Choice>),
    /// Another volume than the one that is used is damaged.
    #[error(
        "another series, which is not used, is damaged: {}: {}",
        shown(.0.0.path().and_then(Path::file_name).unwrap_or_default()), Reason(&.0.0)
    )]
    DamagedBeside(Refusal),
    #[error(
        "{voxels} voxel(s) are in several masks; they get the label of the {} of these",
        if *.first { "first" } else { "last" }
    )]
    Overlaps { voxels: u64, first: bool },
    #[error(
        "labels are named by the meanings of their codes; free-text names may identify the patient, and {KEEP_NAMES} uses those"
    )]
    TypedNames,
    #[error("{count} file(s) left out: {why} (first: {first})")]
    LeftOut { count: u64, why: NotVolume, first: String },
    #[error("{count} more file(s) left out for other reasons")]
    MoreLeftOut { count: u64 },
}

impl Note {
    /// Is it about a spacing that was assumed, along one axis at least?
    pub(crate) fn assumes_spacing(&self) -> bool {
        match self {
            Self::AssumedSpacing { .. } | Self::AssumedAxisSpacing => true,
            Self::NotFinite(number) => matches!(number, StatedNumber::Spacing { .. }),
            Self::Dicom(note) => note.assumes_spacing(),
            _ => false,
        }
    }

    /// Is it about directions that were assumed?
    pub(crate) fn assumes_directions(&self) -> bool {
        matches!(self, Self::AssumedDirections { .. } | Self::AssumedSpace { .. } | Self::AssumedRas)
    }
}

impl From<DicomNote> for Note {
    fn from(note: DicomNote) -> Self {
        Self::Dicom(note)
    }
}

/// A spacing for people: six digits, as headers print it.
fn mm(spacing_mm: [f64; 3]) -> String {
    let [x, y, z] = spacing_mm.map(|mm| format!("{mm:.5e}").parse().unwrap_or(mm));
    format!("{x} x {y} x {z} mm")
}

/// The sentences of notes in their order, each once.
pub fn sentences(notes: &[Note]) -> Vec<String> {
    let mut kept: Vec<String> = Vec::new();
    for sentence in notes.iter().map(|note| shown(&note.to_string()).to_string()) {
        if !kept.contains(&sentence) {
            kept.push(sentence);
        }
    }
    kept
}
