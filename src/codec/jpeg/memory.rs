//! Check of the memory in use against the memory allowed.

use super::bytes::BUFFER_BYTES;
use super::markers::Tables;
use crate::codec::CodecError;

/// Checks an allocation of `bytes`, with tables and input buffer, against `allowed_bytes`.
pub(super) fn reserve(bytes: u64, allowed_bytes: u64) -> Result<(), CodecError> {
    let needed_bytes = bytes + Tables::MAX_BYTES + BUFFER_BYTES as u64;
    if needed_bytes <= allowed_bytes {
        Ok(())
    } else {
        Err(CodecError::Memory { needed_bytes, allowed_bytes })
    }
}
