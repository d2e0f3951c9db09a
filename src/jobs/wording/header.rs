//! Sentences about headers of text: NRRD, MetaImage, and what they share.

use std::fmt;

use crate::budget::Bytes;
use crate::facts::header::HeaderFault;
use crate::facts::metaimage::MetaImageFault;
use crate::facts::nrrd::NrrdFault;

/// What is said of pictures that are not slices.
const SWEEP: &str = "is a list of pictures, each with a place of its own (a free-hand sweep), and these are no slices; reconstruct a volume from it first, and give that";

impl fmt::Display for HeaderFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EndlessLine => f.write_str("a line of the header has no end"),
            Self::TooLong { most_bytes } => write!(
                f,
                "its header does not end within {}; is it damaged, or full of comments?",
                Bytes(*most_bytes)
            ),
            Self::NotAField { line } => {
                write!(f, "the line `{}` of its header is no field", line.escape_debug())
            }
            Self::Outside { name } => write!(
                f,
                "its data file `{}` is not in the folder of the header; put both into one folder and name it without a path",
                name.escape_debug()
            ),
            Self::Linked { name } => write!(
                f,
                "its data file `{}` is a link that leads out of the folder of the header; put the data there, or add --follow-links",
                name.escape_debug()
            ),
            Self::TooManyFiles { most } => write!(f, "it names more than {most} data files"),
            Self::EndlessNumbers { range: [first, last, step] } => {
                write!(f, "its data files from {first} to {last} in steps of {step} have no end")
            }
            Self::MoreFilesThanSlices { slices } => {
                write!(f, "it names more data files than its {slices} slices")
            }
            Self::Pattern { pattern } => {
                write!(f, "`{}` is no pattern with one number", pattern.escape_debug())
            }
        }
    }
}

impl fmt::Display for NrrdFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Version { magic } => {
                write!(f, "`{}` is no version of NRRD that is read (1 to 5)", magic.escape_debug())
            }
            Self::Field { field, value } => {
                write!(f, "its field `{field}: {}` makes no sense", value.escape_debug())
            }
            Self::NoType => f.write_str("its header states no sample type"),
            Self::Type { name } => write!(f, "its sample type `{}` is not read", name.escape_debug()),
            Self::NoEncoding => f.write_str("its header states no encoding"),
            Self::Encoding { name } => write!(f, "its encoding `{}` is not read", name.escape_debug()),
            Self::ByteOrder { name } => {
                write!(f, "its byte order `{}` is unknown", name.escape_debug())
            }
            Self::Sizes { sizes, dimensions } => {
                write!(f, "its header states {sizes} sizes for {dimensions} dimensions")
            }
            Self::Entries { field, entries, axes } => {
                write!(f, "its header has {entries} {field} for {axes} axes")
            }
            Self::NoBlankLine { name } => {
                write!(f, "{name} ends within its header, before the blank line")
            }
            Self::LinesOfSeveral => {
                f.write_str("lines are to be skipped in several data files, which is not read")
            }
            Self::FewLines { skip } => write!(f, "there are fewer than the {skip} lines to skip"),
            Self::SkipAllButSamples => f.write_str("a byte skip of -1 is for raw samples only"),
            Self::DataFiles { value } => {
                write!(f, "its data files `{}` make no sense", value.escape_debug())
            }
            Self::Components { axis, axes, kind } => {
                write!(f, "axis {axis} of its {axes} is ")?;
                match kind.as_str() {
                    "" => f.write_str("no direction in space")?,
                    kind => write!(f, "`{kind}`")?,
                }
                f.write_str(
                    " and runs faster than space, so a voxel has several values; extract one component into a file of its own",
                )
            }
            Self::SpatialAxes { count } => {
                write!(f, "it has {count} axes in space, and a volume needs two or three")
            }
            Self::NoDirection => f.write_str("an axis has no direction"),
            Self::Sweep => f.write_str(SWEEP),
        }
    }
}

impl fmt::Display for MetaImageFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Field { line } => write!(f, "its field `{}` makes no sense", line.escape_debug()),
            Self::NoDataFile => {
                f.write_str("its header ends without ElementDataFile, which names the samples")
            }
            Self::Dimensions { count, sizes } => write!(
                f,
                "its header states NDims = {count} and {sizes} sizes; volumes of 2 to 4 dimensions are read"
            ),
            Self::Channels { count } => {
                write!(f, "has {count} channels a voxel; extract one into a file of its own")
            }
            Self::Type { name } => write!(f, "its ElementType `{}` is not read", name.escape_debug()),
            Self::FewNumbers => {
                f.write_str("its spacing, offset or matrix has fewer numbers than the volume has dimensions")
            }
            Self::Sweep => f.write_str(SWEEP),
            Self::CompressedText => f.write_str("compressed text is not read"),
            Self::SkipAllButSamples => f.write_str("HeaderSize = -1 is for uncompressed samples only"),
        }
    }
}
