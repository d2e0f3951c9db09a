//! A finished `.oct` mapped into memory, checked, and offered as a read-only view.
//!
//! | type | what it is |
//! |---|---|
//! | [`Frame`] | header, table, metadata and levels: what opening reads and checks |
//! | [`Model`] | a mapped-encoding file, used in place |
//! | [`ModelView`] | its structure and normals as slices: the [`NodeView`] for loops |
//! | [`CellItems`], [`CellShape`] | the surface within cells |
//! | [`StoredVoxels`] | the voxels or cells of a model, one after the other |
//! | [`Items`] | the values of one section, for every voxel or coarse node |
//! | [`verify()`] | the full check of every invariant, in small memory |
//! | [`ReadAt`], `Cursor` | reading by position, and in sequence |

mod cells;
mod error;
mod frame;
mod leaves;
mod map;
mod model;
mod stream;
mod verify;
mod view;
mod voxels;
mod walls;

pub(crate) use crate::format::cell::PlanePart;
pub(crate) use cells::{BrickCodes, LeafItems};
pub use cells::{CellItems, CellShape};
pub use error::LoadError;
pub(crate) use error::LoadFault;
pub use frame::Frame;
pub use map::Mapping;
pub(crate) use map::{FileIdentity, survive_torn_files};
pub use model::{Items, Model, ModelView};
pub(crate) use stream::Cursor;
pub use stream::{Fault, ReadAt};
pub use verify::verify;
pub(crate) use verify::{check_storage, walk, walked_channels};
pub use view::NodeView;
pub use voxels::{StoredVoxel, StoredVoxels};
