//! The codecs of the packed encoding (SPEC 5): bytes in memory to bytes in memory.
//!
//! | module | codec |
//! |---|---|
//! | [`tables`] | adaptive tables of sixteen symbols, and the coder that these go through |
//! | [`group`] | the subtrees that are coded together |
//! | [`nibbles`] | infobytes of a group, from the boxes around |
//! | [`directions`] | normals of a group, from the voxels around |
//! | [`distances`] | offsets of a group's cells, from the planes around |
//! | [`planes`] | everything else: differences, byte planes, zstd |
//! | [`coder`], [`structure`], [`normals`], [`offsets`] | what [`tables`], [`nibbles`], [`directions`], [`distances`] were up to version 1.1: read, not written |
//! | [`CodingError`] | what can be wrong with coded bytes |
//!
//! Encoder and decoder of each codec are one function over a [`tables::SymbolCoder`], so that they cannot
//! disagree about a context.

mod around;
mod blocks;
mod classes;
pub mod coder;
pub mod directions;
pub mod distances;
mod error;
pub mod group;
mod lanes;
pub mod nibbles;
pub mod normals;
pub mod offsets;
pub mod planes;
mod residual;
pub mod structure;
pub mod tables;

pub use error::CodingError;

/// Stored bytes are the content (SPEC 5.1).
pub const CODEC_NONE: u8 = 0;
/// Differences, byte planes, zstd (SPEC 5.5).
pub const CODEC_PLANES: u8 = 1;
/// Nothing is stored; the content follows from other sections (SPEC 5.6).
pub const CODEC_DERIVED: u8 = 2;
/// Infobytes, up to version 1.1 (SPEC 5.3).
pub const CODEC_STRUCTURE: u8 = 3;
/// Normals, up to version 1.1 (SPEC 5.4).
pub const CODEC_NORMALS: u8 = 4;
/// Offsets of cells, up to version 1.1 (SPEC 5.7).
pub const CODEC_OFFSETS: u8 = 5;
/// Infobytes (SPEC 5.9).
pub const CODEC_NIBBLES: u8 = 6;
/// Normals (SPEC 5.10).
pub const CODEC_DIRECTIONS: u8 = 7;
/// Offsets of cells (SPEC 5.11).
pub const CODEC_DISTANCES: u8 = 8;
/// Minor version of the format that has the last three.
pub const GROUPS_MINOR: u16 = 2;

/// A subtree has an edge of at most 2^6 cells: its grids stay in a cache, and a group of them in
/// memory, whatever the model. (2^7 saves under 1 % of the normals of the 512^3 phantom and costs eight times the grids.)
pub const SUBTREE_DEPTH: u32 = 6;
/// A group of subtrees is closed once it holds this many voxels: enough for the contexts to learn.
pub const GROUP_VOXELS: u64 = 1 << 18;
/// Longest stored group that is read: 64 bytes a voxel of the fullest one.
pub const GROUP_BYTES_LIMIT: u32 = 32 << 20;
