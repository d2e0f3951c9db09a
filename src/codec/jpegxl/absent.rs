//! In the place of the JPEG XL decoder where the feature `jpeg-xl` is off: it refuses every stream, unread.

use super::{CodecError, FrameBytes, RowSink};

/// Nothing is decoded, so nothing is held.
pub(crate) fn memory_bytes_for(_columns: u32, _rows: u32, _components: u8) -> u64 {
    0
}

/// # Errors
/// Always: JPEG XL is not part of this build.
pub(crate) fn decode(_: &dyn FrameBytes, _memory_bytes: u64, _: &mut dyn RowSink) -> Result<(), CodecError> {
    Err(CodecError::Unsupported("JPEG XL, in a build without the feature jpeg-xl".to_owned()))
}
