//! What is wrong with the description of a synthetic volume.

/// Why `synthetic:NAME@N?key=value` describes nothing.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum SyntheticFault {
    /// A body of this name is not known.
    Body {
        /// The name given.
        name: String,
        /// All that are known.
        known: Vec<&'static str>,
    },
    /// The size is missing.
    NoSize,
    /// A size that no volume has.
    Size {
        /// What is given.
        given: String,
    },
    /// A parameter that this body does not have.
    Key {
        /// The name given.
        key: String,
        /// Name of the body.
        body: &'static str,
        /// What it has.
        known: Vec<&'static str>,
    },
    /// A parameter is given twice.
    Twice {
        /// Which.
        key: String,
    },
    /// A value that the parameter cannot have.
    Value {
        /// The parameter.
        key: String,
        /// What is given.
        given: String,
        /// What it can be.
        wanted: SyntheticValue,
    },
    /// A parameter that says something about samples with grey levels only.
    NotBinary {
        /// Which.
        key: &'static str,
    },
    /// Size and type of headerless samples are stated as well.
    Described,
}

/// What the value of a parameter can be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SyntheticValue {
    /// A number from the first to the second.
    Number(f64, f64),
    /// A whole number from the first to the second.
    Whole(u64, u64),
    /// Three numbers from the first to the second.
    Three(f64, f64),
    /// One of some words.
    Word(&'static [&'static str]),
}
