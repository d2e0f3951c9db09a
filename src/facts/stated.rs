//! Who states what, in which form: small facts that notes and faults share.

/// What carries samples, and states or does not state where they lie.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// A header of a format that could state it.
    Header,
    /// A TIFF file; some state their spacing.
    Tiff,
    /// PNG pictures.
    Png,
    /// A NumPy array.
    Npy,
}

/// Who states what the file does not, or otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatedBy {
    /// Whoever opens the volume.
    Caller,
    /// A side-car beside the file.
    SideCar,
}

/// One of the two affines of a NIfTI header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The one of three rows.
    Sform,
    /// The one of a quaternion.
    Qform,
}

/// What a header states as a number that is infinite, or not one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatedNumber {
    /// The spacing along an axis; 1 mm is assumed there.
    Spacing {
        /// The axis, from 0.
        axis: usize,
        /// As it is stated.
        stated: f64,
    },
    /// The slope of the values; they are taken as they are stored.
    Slope {
        /// As it is stated.
        stated: f64,
    },
    /// One of the affines; it is not used.
    Form(Form),
}

/// How samples are packed in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// As they are.
    Raw,
    /// Gzip.
    Gzip,
    /// Zlib.
    Zlib,
    /// Bzip2.
    Bzip2,
    /// Numbers as text.
    Text,
    /// Hexadecimal digits.
    Hex,
}
