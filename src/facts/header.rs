//! What can be wrong with headers of text, whatever the format.

use thiserror::Error;

use crate::budget::Bytes;
use crate::text::names::FOLLOW_LINKS;

/// What is wrong with a header of text, or with the data files that it names.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum HeaderFault {
    #[error("a line of the header has no end")]
    EndlessLine,
    #[error("its header does not end within {}; is it damaged, or full of comments?", Bytes(*.most_bytes))]
    TooLong { most_bytes: u64 },
    #[error("the line `{}` of its header is not a field", .line.escape_debug())]
    NotAField { line: String },
    #[error("its header states `{field}` twice; remove the wrong line")]
    Twice { field: &'static str },
    #[error("its data file `{}` is not in the folder of the header; put both into one folder and name it without a path", .name.escape_debug())]
    Outside { name: String },
    #[error("its data file `{}` is a link that leads out of the folder of the header; put the data there, or add {FOLLOW_LINKS}", .name.escape_debug())]
    Linked { name: String },
    #[error("it names more than {most} data files")]
    TooManyFiles { most: u64 },
    #[error("its data files from {first} to {last} in steps of {step} have no end", first = .range[0], last = .range[1], step = .range[2])]
    EndlessNumbers { range: [i64; 3] },
    #[error("it names more data files than its {slices} slices")]
    MoreFilesThanSlices { slices: u64 },
    #[error("`{}` is not a pattern with one number", .pattern.escape_debug())]
    Pattern { pattern: String },
    #[error(
        "is a list of pictures, each with a place of its own (a free-hand sweep), and these are not slices; reconstruct a volume from it first, and give that"
    )]
    Sweep,
}
