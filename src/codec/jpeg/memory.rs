//! Memory that is held, against the memory allowed.

use super::bytes::BUFFER_BYTES;
use super::markers::Tables;
use crate::codec::CodecError;

/// Checks what is about to be allocated, with tables and input buffer, against what is allowed.
pub(super) fn reserve(bytes: u64, allowed_bytes: u64) -> Result<(), CodecError> {
    let needed_bytes = bytes + Tables::MAX_BYTES + BUFFER_BYTES as u64;
    if needed_bytes <= allowed_bytes {
        Ok(())
    } else {
        Err(CodecError::Memory { needed_bytes, allowed_bytes })
    }
}
