//! The codecs of the packed encoding (SPEC 5): bytes in memory to bytes in memory.
//!
//! | module | codec |
//! |---|---|
//! | [`coder`] | the adaptive binary range coder |
//! | [`structure`] | infobytes of a subtree, from the boxes around |
//! | [`normals`] | normals of a subtree, from the voxels around |
//! | [`offsets`] | offsets of a subtree's cells, from the planes around |
//! | [`planes`] | everything else: differences, byte planes, zstd |
//! | [`CodingError`] | what can be wrong with coded bytes |
//!
//! Encoder and decoder of each codec are one function over a [`coder::BitCoder`], so that they cannot
//! disagree about a context.

mod around;
pub mod coder;
mod error;
pub mod normals;
pub mod offsets;
pub mod planes;
mod residual;
pub mod structure;

pub use error::CodingError;

/// Stored bytes are the content (SPEC 5.1).
pub const CODEC_NONE: u8 = 0;
/// Differences, byte planes, zstd (SPEC 5.5).
pub const CODEC_PLANES: u8 = 1;
/// Nothing is stored; the content follows from other sections (SPEC 5.6).
pub const CODEC_DERIVED: u8 = 2;
/// Infobytes (SPEC 5.3).
pub const CODEC_STRUCTURE: u8 = 3;
/// Normals (SPEC 5.4).
pub const CODEC_NORMALS: u8 = 4;
/// Offsets of cells (SPEC 5.7).
pub const CODEC_OFFSETS: u8 = 5;

/// A subtree has an edge of at most 2^6 cells: its grids stay in a cache, and a group of them in
/// memory, whatever the model. (2^7 saves under 1 % of the normals of the 512^3 phantom and costs eight times the grids.)
pub const SUBTREE_DEPTH: u32 = 6;
/// A group of subtrees is closed once it holds this many voxels: enough for the contexts to learn.
pub const GROUP_VOXELS: u64 = 1 << 18;
/// Longest stored group that is read: 64 bytes a voxel of the fullest one.
pub const GROUP_BYTES_LIMIT: u32 = 32 << 20;
