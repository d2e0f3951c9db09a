#![doc = include_str!("SPEC.md")]
//!
//! ---
//! This module turns those bytes into values and back; it opens no file.

pub mod assemble;
pub mod cell;
mod channel;
mod error;
mod header;
mod kind;
mod metadata;
pub mod normal;
pub mod packed;
pub mod rank;
mod section;

pub(crate) use channel::number;
pub use channel::{ChannelRow, Channels, MeanBytes, MeanRule, Means, Sum};
pub use error::FormatError;
pub use header::{Encoding, HEADER_BYTES, Header, MAGIC, VERSION_MAJOR, VERSION_MINOR};
pub use kind::{Channel, SectionKind, SurfaceKind};
pub use metadata::{METADATA_LIMIT, Metadata, Selection, SelectionKind, SourceMeta};
pub use section::{
    ENTRY_BYTES, MAX_SECTIONS, SECTION_ALIGN, SectionEntry, align_up, least_minor, parse_table, table_bytes,
};
