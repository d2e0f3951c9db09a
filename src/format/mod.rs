#![doc = include_str!("SPEC.md")]
//!
//! ---
//! This module turns those bytes into values and back; it opens no file.

#[doc(hidden)]
pub mod assemble;
#[doc(hidden)]
pub mod cell;
mod channel;
mod error;
mod header;
mod kind;
mod metadata;
pub mod normal;
#[doc(hidden)]
pub mod packed;
#[doc(hidden)]
pub mod rank;
mod section;

pub(crate) use channel::number;
pub use channel::{ChannelRow, Channels, MeanRule, Means, Sum};
pub use error::FormatError;
pub use header::{Encoding, HEADER_BYTES, Header, MAGIC};
pub(crate) use header::{VERSION_MAJOR, VERSION_MINOR};
pub use kind::{Channel, SectionKind, SurfaceKind};
pub(crate) use metadata::METADATA_LIMIT;
pub use metadata::{ErrorBound, Metadata, Selection, SelectionKind, SourceMeta};
pub use section::{ENTRY_BYTES, MAX_SECTIONS, SectionEntry, align_up, table_bytes};
pub(crate) use section::{least_minor, parse_table};
