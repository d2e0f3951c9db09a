//! Sentences about synthetic volumes.

use std::fmt;

use crate::facts::{SyntheticFault, SyntheticValue};

impl fmt::Display for SyntheticFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Body { name, known } => write!(
                f,
                "there is no synthetic body '{name}'; choose {}, for example synthetic:sphere@256",
                known.join(", ")
            ),
            Self::NoSize => f.write_str(
                "a synthetic volume needs its size in voxels: write synthetic:NAME@N or synthetic:NAME@NXxNYxNZ",
            ),
            Self::Size { given } => write!(
                f,
                "'{given}' is not the size of a volume; write N or NXxNYxNZ with sides of 1 to 65536 (the head: 1 to 65536, all alike)"
            ),
            Self::Key { key, body, known } if known.is_empty() => {
                write!(f, "the {body} has no parameters, so '{key}' has no meaning there")
            }
            Self::Key { key, body, known } => {
                write!(f, "the {body} has no parameter '{key}'; it has {}", known.join(", "))
            }
            Self::Twice { key } => write!(f, "the parameter '{key}' is given twice"),
            Self::Value { key, given, wanted } => {
                write!(f, "'{given}' is no value of the parameter '{key}'; give {wanted}")
            }
            Self::NotBinary { key } => write!(
                f,
                "'{key}' is about grey levels, which sample=binary does not have; leave one of the two out"
            ),
            Self::Described => {
                f.write_str("says itself how large it is; --dims, --dtype and --skip are for raw volumes")
            }
        }
    }
}

impl fmt::Display for SyntheticValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(low, high) => write!(f, "a number from {low} to {high}"),
            Self::Whole(low, high) => write!(f, "a whole number from {low} to {high}"),
            Self::Three(low, high) => write!(f, "three numbers from {low} to {high}, as in 1x1x6"),
            Self::Word(words) => write!(f, "one of {}", words.join(", ")),
        }
    }
}
