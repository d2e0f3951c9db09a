//! What was guessed, left out, replaced or odd about a volume that can be used all the same.

use std::fmt;
use std::path::Path;

use super::DicomNote;
use super::error::Reason;
use super::found::{Choice, Refusal};
use super::left_out::NotVolume;
use super::numbered::NumberNote;
use super::stated::{Carrier, Form, Packing, StatedBy, StatedNumber};
use crate::geom::Orientation;
use crate::text::names::{ALL_VOLUMES, ORIENTATION, SPACING};
use crate::text::shown;

/// One thing that whoever uses a volume should know of it.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum Note {
    /// No spacing is stated; 1 mm is assumed.
    AssumedSpacing {
        /// What does not state it.
        by: Carrier,
    },
    AssumedAxisSpacing,
    /// No directions are stated; the axes are taken as LPS.
    AssumedDirections {
        /// What does not state them.
        by: Carrier,
    },
    AssumedSpace {
        /// Name of the space, where it has one.
        space: Option<String>,
    },
    AssumedRas,
    AssumedOrigin,
    AssumedUnit,
    UnknownUnit {
        unit: String,
    },
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
    FormsDiffer,
    /// An affine of a NIfTI header is singular, and is not used.
    SingularForm {
        /// Which one.
        form: Form,
    },
    /// A number of the header is infinite, or not one, and is not used.
    NotFinite(StatedNumber),
    WhiteIsZero,
    Thumbnails {
        count: usize,
    },
    BitsScaled {
        bits: u8,
    },
    LongIntegers,
    VolumeOf {
        number: u64,
        count: u64,
    },
    LongerFile,
    LongerFiles {
        count: u64,
    },
    LongerStream {
        packing: Packing,
        promised: u64,
    },
    UnknownKeys {
        unknown: Vec<String>,
        known: &'static [&'static str],
    },
    Dicom(DicomNote),
    Numbers(NumberNote),
    FirstOfMany {
        volumes: usize,
    },
    Chosen(Box<Choice>),
    /// A volume beside the one that is used is damaged.
    DamagedBeside(Refusal),
    LeftOut {
        count: u64,
        why: NotVolume,
        first: String,
    },
    MoreLeftOut {
        count: u64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AssumedSpacing { by } => {
                let what = match by {
                    Carrier::Header => "the header",
                    Carrier::Tiff => "this TIFF",
                    Carrier::Png => "PNG",
                    Carrier::Npy => "an .npy file",
                };
                write!(f, "{what} states no spacing; 1 mm is assumed")
            }
            Self::AssumedAxisSpacing => {
                f.write_str("the header states no spacing along some axis; 1 mm is assumed")
            }
            Self::AssumedDirections { by } => {
                let what = match by {
                    Carrier::Header => "the header",
                    Carrier::Tiff => "TIFF",
                    Carrier::Png => "PNG",
                    Carrier::Npy => "an .npy file",
                };
                write!(f, "{what} states no directions; its axes are taken as LPS")
            }
            Self::AssumedSpace { space: None } => {
                f.write_str("the header states no space; its directions are taken as LPS")
            }
            Self::AssumedSpace { space: Some(space) } => {
                let space = space.escape_debug();
                write!(f, "the space `{space}` is no patient's; its directions are taken as LPS")
            }
            Self::AssumedRas => f.write_str(
                "the header states no orientation; its axes are taken as right, anterior, superior, so left and right may be swapped",
            ),
            Self::AssumedOrigin => {
                f.write_str("the header states no origin; the first voxel is taken for it")
            }
            Self::AssumedUnit => f.write_str("the header states no unit of length; mm is assumed"),
            Self::UnknownUnit { unit } => write!(f, "the unit `{}` is taken for mm", unit.escape_debug()),
            Self::AssumedByteOrder => {
                f.write_str("the header states no byte order; little-endian is assumed")
            }
            Self::StoredBackwards { axis } => {
                let what = match axis {
                    0 => "columns are stored from right to left",
                    _ => "rows are stored from the bottom up",
                };
                write!(f, "{what} (Orientation), and are placed so")
            }
            Self::SpacingReplaced { by, given_mm, stated_mm } => {
                let who = by.named(SPACING, "spacing");
                let (given, stated) = (mm(*given_mm), mm(*stated_mm));
                write!(f, "{who} gives {given}; the file states {stated}, which is not used")
            }
            Self::DirectionsReplaced { by, given, stated } => {
                let who = by.named(ORIENTATION, "orientation");
                write!(
                    f,
                    "{who} gives {given}; the directions that the file states, about {stated}, are not used"
                )
            }
            Self::FormsDiffer => f.write_str(
                "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform",
            ),
            Self::SingularForm { form } => {
                write!(f, "the {form} of the header is singular and is not used")
            }
            Self::NotFinite(StatedNumber::Spacing { axis, stated }) => write!(
                f,
                "the header states a spacing of {stated} along axis {}; 1 mm is assumed there",
                axis + 1
            ),
            Self::NotFinite(StatedNumber::Slope { stated }) => write!(
                f,
                "the header states a slope of {stated}, which is taken for none: values are as they are stored"
            ),
            Self::NotFinite(StatedNumber::Form(form)) => {
                write!(f, "the {form} of the header has numbers that are not finite, and is not used")
            }
            Self::WhiteIsZero => {
                f.write_str("0 is white in these pictures; the numbers are kept as they are")
            }
            Self::Thumbnails { count } => {
                write!(f, "{count} pages of reduced size (thumbnails) are left out")
            }
            Self::BitsScaled { bits } => write!(f, "samples of {bits} bits are scaled to 0..255"),
            Self::LongIntegers => {
                f.write_str("64-bit integers are read as double precision, which is exact up to 2^53")
            }
            Self::VolumeOf { number, count } => write!(f, "this is volume {number} of {count} in the file"),
            Self::LongerFile => {
                f.write_str("the file held more than the header promises; the rest is ignored")
            }
            Self::LongerFiles { count } => {
                write!(f, "{count} of the data files held more than the header promises; the rest is ignored")
            }
            Self::LongerStream { packing, promised } => write!(
                f,
                "the {packing} stream holds more than the {promised} bytes that the header promises; the rest is ignored"
            ),
            Self::UnknownKeys { unknown, known } => write!(
                f,
                "the side-car has keys that are not known: {}; known are {}",
                unknown.join(", "),
                known.join(", ")
            ),
            Self::Dicom(note) => note.fmt(f),
            Self::Numbers(note) => note.fmt(f),
            Self::FirstOfMany { volumes } => write!(
                f,
                "this is the first of {volumes} volumes that are alike; {ALL_VOLUMES} takes the others, too"
            ),
            Self::Chosen(choice) => choice.fmt(f),
            Self::DamagedBeside(Refusal(error)) => {
                let name = shown(error.path().and_then(Path::file_name).unwrap_or_default());
                write!(f, "another series, which is not used, is damaged: {name}: {}", Reason(error))
            }
            Self::LeftOut { count, why, first } => {
                write!(f, "{count} file(s) left out: {why} (first: {first})")
            }
            Self::MoreLeftOut { count } => {
                write!(f, "{count} more file(s) left out for other reasons")
            }
        }
    }
}

impl Note {
    /// Does it tell of a spacing that was assumed, along one axis at least?
    pub(crate) fn assumes_spacing(&self) -> bool {
        match self {
            Self::AssumedSpacing { .. } | Self::AssumedAxisSpacing => true,
            Self::NotFinite(number) => matches!(number, StatedNumber::Spacing { .. }),
            Self::Dicom(note) => note.assumes_spacing(),
            _ => false,
        }
    }

    /// Does it tell of directions that were assumed?
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
