//! What is wrong with the description of a synthetic volume.

use std::fmt;

use thiserror::Error;

use crate::text::names::{DIMS, DTYPE, SKIP};

/// Why `synthetic:NAME@N?key=value` describes nothing.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum SyntheticFault {
    #[error("there is no synthetic body '{name}'; choose {}, for example synthetic:sphere@256", .known.join(", "))]
    Body { name: String, known: Vec<&'static str> },
    #[error("a synthetic volume needs its size in voxels: write synthetic:NAME@N or synthetic:NAME@NXxNYxNZ")]
    NoSize,
    #[error(
        "'{given}' is not the size of a volume; write N or NXxNYxNZ with sides of 1 to 65536 (the head: 1 to 65536, all alike)"
    )]
    Size { given: String },
    #[error(fmt = unknown_key)]
    Key { key: String, body: &'static str, known: Vec<&'static str> },
    #[error("the parameter '{key}' is given twice")]
    Twice { key: String },
    #[error("'{given}' is not a value of the parameter '{key}'; give {wanted}")]
    Value { key: String, given: String, wanted: SyntheticValue },
    #[error("'{key}' is about grey levels, which sample=binary does not have; leave one of the two out")]
    NotBinary { key: &'static str },
    #[error("says itself how large it is; {DIMS}, {DTYPE} and {SKIP} are for raw volumes")]
    Described,
}

fn unknown_key(key: &str, body: &str, known: &[&str], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    match known {
        [] => write!(f, "the {body} has no parameters, so '{key}' has no meaning there"),
        _ => write!(f, "the {body} has no parameter '{key}'; it has {}", known.join(", ")),
    }
}

/// What the value of a parameter can be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SyntheticValue {
    Number(f64, f64),
    Whole(u64, u64),
    Three(f64, f64),
    Word(&'static [&'static str]),
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
