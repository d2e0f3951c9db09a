//! A model built in parts, on any machines, and joined into the file that one build makes, byte for byte.
//!
//! ```text
//! plan: boxes cut at multiples of 128 voxels --> part: the records of the groups of bricks in one box
//!                                             \-> ... --join, in Morton order--> .oct
//! ```
//!
//! The bytes are equal because groups of 4^3 bricks do not depend on each other: skin and normals read the volume a few
//! voxels beyond the box, and the levels above the groups are unions of bits and exact sums of integers. A part,
//! little-endian:
//!
//! | what | bytes |
//! |---|---|
//! | head | magic, length, digest of the plan, number and count of the parts, dims, surface, channels, metadata, CRC |
//! | records | one a group, by rising Morton code: summaries of its bricks, infobytes by edge, items, means |
//! | footer | [`record::ENTRY_BYTES`] a group: code, offset and CRC of its record, numbers of boxes |
//! | tail | offset of the footer, groups, CRC of the footer, `PEND` |
//!
//! A part without skin has no groups.
//!
//! | file | what it does |
//! |---|---|
//! | `cut` | boxes of parts |
//! | `record` | the layout of a record, and its entry in the footer |
//! | `head` | head and tail |
//! | `write` | the last pass over a part |
//! | `read` | parts, opened and checked |
//! | `join` | the model of all parts |
//! | `stage` | what is found of the whole volume, share by share, before the parts |
//! | `occupancy` | one bit a voxel, for cleaning in stages |
//! | `fault` | why parts are refused |

mod cut;
mod fault;
mod head;
mod join;
pub(crate) mod occupancy;
mod read;
mod record;
pub(crate) mod stage;
mod write;

pub(crate) use cut::{Cuts, PartId};
pub(crate) use fault::PartFault;
pub(crate) use join::{Joined, join};
pub(crate) use read::PartFile;
pub(super) use record::{RecordField, RecordForm};
pub(super) use write::PartWriter;
