//! What can be wrong with samples in files: their number, their place, their packing.

use std::io;
use std::ops::Range;

use thiserror::Error;

/// Why rows cannot be delivered, other than by the system: it stands as the cause in
/// [`SourceFault::ReadFailed`](super::SourceFault::ReadFailed).
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    #[error("it has not been unrolled")]
    NotUnrolled,
    #[error("rows {rows:?}, columns {cols:?} into {bytes} bytes")]
    Outside { rows: Range<u32>, cols: Range<u32>, bytes: usize },
}

impl From<ReadFault> for io::Error {
    fn from(fault: ReadFault) -> Self {
        Self::new(io::ErrorKind::InvalidInput, fault)
    }
}
