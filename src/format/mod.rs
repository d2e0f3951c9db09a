#![doc = include_str!("SPEC.md")]
//!
//! ---
//! This module turns those bytes into values and back; it opens no file.

#[doc(hidden)]
pub mod cell;
mod channel;
mod error;
mod faces;
mod header;
mod kind;
mod label;
mod metadata;
pub mod normal;
#[doc(hidden)]
pub mod packed;
mod quantity;
#[doc(hidden)]
pub mod rank;
mod section;
mod walls;

pub(crate) use channel::number;
pub use channel::{ChannelRow, Channels, MeanRule, Means, Sum};
pub use error::FormatError;
pub(crate) use error::damaged;
pub use header::{Encoding, HEADER_BYTES, Header, MAGIC};
pub(crate) use header::{QUANTITY_MINOR, VERSION_MAJOR, VERSION_MINOR};
pub use kind::{Channel, SectionKind, SurfaceKind};
pub(crate) use label::{ENTRY as LABEL_ENTRY, GROUP as LABEL_GROUP, MAX_LABELS};
pub(crate) use label::{ITEM_BYTES as LABEL_BYTES, LabelForm, directory_bytes as label_directory_bytes};
pub use label::{Label, LabelItems, LabelName};
pub(crate) use label::{parse_table as parse_labels, table_to_bytes as labels_to_bytes};
pub(crate) use metadata::METADATA_LIMIT;
pub use metadata::{ErrorBound, Metadata, Noise, Selection, SelectionKind, SourceMeta};
#[cfg(test)]
pub(crate) use quantity::measured_value;
pub(crate) use quantity::stored_value;
pub use quantity::{ColorMap, Quantity, ValueColors};
pub(crate) use section::parse_table;
pub use section::{ENTRY_BYTES, MAX_SECTIONS, SectionEntry, align_up, table_bytes};
pub use walls::Walls;
pub(crate) use walls::{CornerLabels, WALL_BYTES, WallCode, WallItem, wall_offset};
