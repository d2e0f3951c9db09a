//! What can be wrong with Zarr arrays.

use thiserror::Error;

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
    #[error("has a side of no voxels, or one of more than {most}")]
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
