//! What can be wrong with NRRD headers.

/// Why an NRRD header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum NrrdFault {
    /// A version that is not read.
    Version {
        /// Its first line.
        magic: String,
    },
    /// A field makes no sense.
    Field {
        /// Its name.
        field: String,
        /// Its value.
        value: String,
    },
    /// No sample type is stated.
    NoType,
    /// A sample type that is not read.
    Type {
        /// Its name.
        name: String,
    },
    /// No encoding is stated.
    NoEncoding,
    /// An encoding that is not read.
    Encoding {
        /// Its name.
        name: String,
    },
    /// A byte order that is not known.
    ByteOrder {
        /// Its name.
        name: String,
    },
    /// Not one size for each dimension.
    Sizes {
        /// How many sizes.
        sizes: usize,
        /// How many dimensions.
        dimensions: usize,
    },
    /// A field of which each axis has an entry has another number of them.
    Entries {
        /// Name of the field.
        field: &'static str,
        /// Its entries.
        entries: usize,
        /// Axes.
        axes: usize,
    },
    /// The file ends before the blank line.
    NoBlankLine {
        /// Name of the file.
        name: String,
    },
    /// Lines are to be skipped in several data files.
    LinesOfSeveral,
    /// There are fewer lines than are to be skipped.
    FewLines {
        /// How many are to be skipped.
        skip: u64,
    },
    /// All but the samples is to be skipped, of samples that are packed.
    SkipAllButSamples,
    /// The numbers of data files make no sense.
    DataFiles {
        /// As the header has them.
        value: String,
    },
    /// An axis that is no direction in space runs faster than space.
    Components {
        /// Index of the axis.
        axis: usize,
        /// How many axes there are.
        axes: usize,
        /// Its kind, empty where none is stated.
        kind: String,
    },
    /// Too few axes are in space.
    SpatialAxes {
        /// How many.
        count: usize,
    },
    /// An axis in space has no direction.
    NoDirection,
    /// Pictures in a list, each with a place of its own: a free-hand sweep, not slices.
    Sweep,
}
