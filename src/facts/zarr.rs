//! What can be wrong with Zarr arrays.

use std::fmt;

use thiserror::Error;

use crate::text::names::INDEX;

/// Why a Zarr array, or one of its chunks, is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum ZarrFault {
    #[error("is not the metadata of a Zarr array or of an image in OME-Zarr: {}", .cause.escape_debug())]
    Json { cause: String },
    #[error("has {bytes} bytes of metadata; up to {most} are read")]
    Long { bytes: u64, most: u64 },
    #[error("does not state `{field}`, or not as Zarr does; is it damaged?")]
    Missing { field: &'static str },
    #[error("holds {}, which is not read; pass the array to `infobyte.build` in Python, which reads any chunks", .what.escape_debug())]
    Unread { what: String },
    #[error("has a side of 0 voxels, or of more than {most}")]
    Size { most: u32 },
    #[error("is a chunk that is cut short; copy it again")]
    Short,
    #[error("is a chunk that is damaged ({what}); copy it again")]
    Damaged { what: &'static str },
    #[error(
        "is a chunk whose blocks need {needed_bytes} bytes to be unpacked, more than the first chunk ({allowed_bytes})"
    )]
    Uneven { needed_bytes: u64, allowed_bytes: u64 },
}

/// Why no volume was chosen by its places on the axes before z: those there are, each with its length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct IndexFault {
    pub(crate) axes: Vec<(String, u64)>,
}

impl fmt::Display for IndexFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.axes.is_empty() {
            return write!(f, "has no axes before z, y and x, on which {INDEX} could choose; leave it out");
        }
        write!(
            f,
            "{INDEX} has to say one place, from 0 on, on each axis before z, y and x that is longer than 1:"
        )?;
        for (at, (name, length)) in self.axes.iter().enumerate() {
            write!(f, "{} {} (of {length})", if at > 0 { "," } else { "" }, name.escape_debug())?;
        }
        Ok(())
    }
}
