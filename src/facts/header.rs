//! What can be wrong with headers of text, whatever the format.

/// What is wrong with a header of text, or with the data files that it names.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum HeaderFault {
    /// A line does not end.
    EndlessLine,
    /// The header does not end within what is read of it.
    TooLong {
        /// The most bytes that a header has.
        most_bytes: u64,
    },
    /// A line is no field.
    NotAField {
        /// The line.
        line: String,
    },
    /// A data file is not in the folder of the header.
    Outside {
        /// Its name.
        name: String,
    },
    /// A symbolic link leads from a data file out of the folder of the header.
    Linked {
        /// Its name.
        name: String,
    },
    /// Too many data files are named.
    TooManyFiles {
        /// The most that are read.
        most: u64,
    },
    /// The numbers of data files do not end.
    EndlessNumbers {
        /// First number, last number and step.
        range: [i64; 3],
    },
    /// More data files are named than there are slices.
    MoreFilesThanSlices {
        /// Slices.
        slices: u64,
    },
    /// A pattern of file names has not one number.
    Pattern {
        /// The pattern.
        pattern: String,
    },
}
