//! Why a format cannot hold a model, as a value; the sentence is written in `jobs`.

use std::io;

/// Why a format cannot hold a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFault {
    /// It counts triangles, corners or bytes in 32 bits.
    TooLong {
        /// How many there would be.
        needed: u64,
    },
    /// A slice of blocks of samples would have more of them than are kept in memory.
    TooBroad {
        /// Blocks of a slice.
        blocks: u64,
    },
    /// NIfTI-1 states sides in 15 bits.
    TooWide {
        /// Voxels of the longest side.
        side: u32,
    },
}

impl std::error::Error for ExportFault {}

impl From<ExportFault> for io::Error {
    fn from(fault: ExportFault) -> Self {
        Self::other(fault)
    }
}
