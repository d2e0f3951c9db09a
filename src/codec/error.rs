//! Why a frame cannot be decoded.

use std::borrow::Cow;
use std::io;

use thiserror::Error;

/// Why a frame cannot be decoded.
#[derive(Debug, Error)]
pub(crate) enum CodecError {
    #[error("the compressed image is damaged: {0}")]
    Damaged(Cow<'static, str>),
    #[error("the compressed image uses {0}, which is not supported")]
    Unsupported(Cow<'static, str>),
    #[error("decoding the image needs {needed_bytes} bytes of memory, and {allowed_bytes} are allowed")]
    Memory { needed_bytes: u64, allowed_bytes: u64 },
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Damage, as the end of a sentence.
#[cold]
pub(crate) fn damaged(what: impl Into<Cow<'static, str>>) -> CodecError {
    CodecError::Damaged(what.into())
}

/// A feature that is not decoded, as a noun.
#[cold]
pub(crate) fn unsupported(feature: impl Into<Cow<'static, str>>) -> CodecError {
    CodecError::Unsupported(feature.into())
}
