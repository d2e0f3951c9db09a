//! The codecs of the packed encoding (SPEC 5): bytes in memory to bytes in memory.
//!
//! | module | codec |
//! |---|---|
//! | `group` | the subtrees that are coded together |
//! | `cubes` | infobytes of a group, from the boxes around |
//! | `mixer`, `prior`, `bits` | what tables and a small net say of a bit, and the range coder that it goes through |
//! | `tables` | adaptive tables of sixteen symbols, and the coder that these go through |
//! | `directions` | normals of a group, from the voxels around |
//! | `distances` | offsets of a group's cells, from the planes around |
//! | `planes` | everything else: differences, byte planes, zstd |
//! | `CodingError` | what can be wrong with coded bytes |
//!
//! Encoder and decoder of each codec are one function over a `tables::SymbolCoder`, so that they cannot disagree about
//! a context.
//!
//! Infobytes in cubes, with tables, a net and checks of contexts (SPEC 5.6), in bits a voxel: phantom of 1024^3 0.65,
//! of 512^3 0.83, iguana 0.92, brain 1.07. Without the net 12 % more; slots without checks 8 % more (and 3 % with one
//! slot a key); groups of 2^19 voxels 3 % less, but too large for two workers; tables of twice the size 2 % less. Cubes
//! of 256 cells save 7 % more, but their grids and tables are too large for two workers. Decoding takes 0.35
//! microseconds a node: eight chains of table, sum and bit.
//!
//! Earlier variants, with infobytes as nibbles in sixteen-ary tables, in bits a voxel: infobytes, normals, offsets.
//!
//! | | phantom, skin | phantom, cells | head, skin | head, cells | iguana, cells | brain, cells |
//! |---|---|---|---|---|---|---|
//! | voxels | 8,310,591 | 15,891,466 | 181,254 | 266,109 | 313,354 | 361,222 |
//! | bit by bit, with a range coder | 1.34, 4.62 | | 1.17, 7.89 | 0.95, 6.14, 3.48 | 1.11, 9.50, 4.43 | 0.92, 12.77, 5.08 |
//! | these in groups of 2^18 | 1.12, 4.36 | 0.80, 4.36, 3.27 | 0.91, 7.40 | 0.76, 5.87, 3.51 | 0.98, 9.31, 4.46 | 0.79, 12.77, 5.11 |
//! | in groups of 2^17 | 1.15, 4.39 | 0.82, 4.38, 3.28 | | 0.78, 5.89, 3.51 | | |
//!
//! Infobytes with shifts 4 and 7, and every step of a young table half of the previous one: 0.05 to 0.06 bits more. A
//! second table with the diagonal nodes instead of none: 0.02 less to 0.04 more. Normals with shifts 4 and 7, or 6 and
//! 8: as many, or 0.04 more. Loops left to the compiler: 1.4 times the time, since it splits rows into single lanes.
//!
//! Decoding the phantom's skin, in seconds of one thread (AMD EPYC, least of alternating runs):
//!
//! | | infobytes | normals |
//! |---|---|---|
//! | sums of neighbours in loops over lanes, tables in halves of 16 bytes | 0.35 | 1.54 |
//! | sums and stores of whole octets of lanes, tables in rows of 32 bytes, steps of tables from a list (kept) | 0.24 | 1.06 |
//! | and the grid's rows around the next node fetched ahead | 0.25 | 1.10 |
//!
//! A voxel stored lane by lane delays the next one, which loads all lanes at once: avoiding that was most of the gain.
//! The rest is a chain, neighbours to prediction to table to symbol to neighbour, of some 300 cycles a voxel.

mod bits;
mod blocks;
mod classes;
pub(crate) mod cubes;
pub(crate) mod directions;
pub(crate) mod distances;
mod error;
pub(crate) mod group;
mod lanes;
mod mixer;
pub(crate) mod planes;
mod prior;
pub(crate) mod tables;

pub(crate) use error::CodingError;

/// Codec of plain content (SPEC 5.1).
pub(crate) const CODEC_NONE: u8 = 0;
/// Codec of differences, byte planes, zstd (SPEC 5.3).
pub(crate) const CODEC_PLANES: u8 = 1;
/// Codec of sections that follow from others, without stored bytes (SPEC 5.4).
pub(crate) const CODEC_DERIVED: u8 = 2;
/// Codec of normals (SPEC 5.7).
pub(crate) const CODEC_DIRECTIONS: u8 = 7;
/// Codec of offsets of cells (SPEC 5.8).
pub(crate) const CODEC_DISTANCES: u8 = 8;
/// Codec of infobytes (SPEC 5.6).
pub(crate) const CODEC_CUBES: u8 = 9;

/// Log2 of a subtree's largest edge in cells: its grids fit a cache, and a group of subtrees fits in memory, for any
/// model. (7 saves under 1 % of the normals of the 512^3 phantom and costs eight times the grids.)
pub(crate) const SUBTREE_DEPTH: u32 = 6;
/// Log2 of the edge of a cube, a subtree of infobytes: its grids are read less often.
pub(crate) const CUBE_DEPTH: u32 = 7;
/// Longest stored group that is accepted: 64 bytes a voxel of the fullest one.
pub(crate) const GROUP_BYTES_LIMIT: u32 = 32 << 20;
