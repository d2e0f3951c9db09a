//! Sentences about what was guessed, left out, replaced or odd.

use std::fmt;

use super::error::Reason;
use super::foreign::shown;
use crate::facts::{Carrier, Form, Note, Packing, Refusal, StatedBy, StatedNumber};

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
                let who = match by {
                    StatedBy::Caller => "--spacing",
                    StatedBy::SideCar => "spacing of the side-car",
                };
                let (given, stated) = (mm(*given_mm), mm(*stated_mm));
                write!(f, "{who} gives {given}; the file states {stated}, which is not used")
            }
            Self::DirectionsReplaced { by, given, stated } => {
                let who = match by {
                    StatedBy::Caller => "--orientation",
                    StatedBy::SideCar => "orientation of the side-car",
                };
                write!(
                    f,
                    "{who} gives {given}; the directions that the file states, about {stated}, are not used"
                )
            }
            Self::FormsDiffer => f.write_str(
                "sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform",
            ),
            Self::SingularForm { form } => {
                let form = match form {
                    Form::Sform => "sform",
                    Form::Qform => "qform",
                };
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
                let form = match form {
                    Form::Sform => "sform",
                    Form::Qform => "qform",
                };
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
                "this is the first of {volumes} volumes that are alike; --all-volumes takes the others, too"
            ),
            Self::Chosen(choice) => choice.fmt(f),
            Self::DamagedBeside(Refusal(error)) => {
                let name = shown(error.path().file_name().unwrap_or_default());
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

impl fmt::Display for Packing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Raw => "raw",
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Bzip2 => "bzip2",
            Self::Text => "text",
            Self::Hex => "hexadecimal",
        })
    }
}

/// A spacing for people: six digits, as headers print it.
fn mm(spacing_mm: [f64; 3]) -> String {
    let [x, y, z] = spacing_mm.map(|mm| format!("{mm:.5e}").parse().unwrap_or(mm));
    format!("{x} x {y} x {z} mm")
}
