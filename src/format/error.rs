//! What can be wrong with the bytes of an `.oct`.

use thiserror::Error;

/// Bytes that are not a valid `.oct`; each variant names the rule of SPEC.md that is broken.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FormatError {
    /// Another program's file, or no file of ours at all.
    #[error(
        "is not an infobyte .oct file (its first bytes are another format's); build one with `oct build`"
    )]
    BadMagic,
    /// Too short for what its header says.
    #[error("is cut short: {expected} bytes are needed and {got} are there; copy or build it again")]
    Truncated {
        /// Bytes needed.
        expected: u64,
        /// Bytes present.
        got: u64,
    },
    /// Longer than its header says.
    #[error("has {extra} bytes after its end; copy or build it again")]
    TrailingBytes {
        /// Surplus.
        extra: u64,
    },
    /// Written by a newer program.
    #[error("has format version {major}; this program reads version 1: update infobyte")]
    UnsupportedVersion {
        /// Major version found.
        major: u16,
    },
    /// A checksum does not match.
    #[error("is damaged: the checksum of {what} does not match; copy or build it again")]
    Checksum {
        /// Header, table or section.
        what: &'static str,
    },
    /// A field has an illegal value.
    #[error("is damaged: {what}; copy or build it again")]
    Invalid {
        /// The rule that is broken.
        what: String,
    },
    /// A packed file where a mapped one is needed.
    #[error("is packed; run `oct unpack` on it first")]
    Packed,
    /// A packed file where one is to be packed.
    #[error("is packed already; there is nothing to do")]
    AlreadyPacked,
    /// A mapped file where one is to be unpacked.
    #[error("is not packed; there is nothing to unpack")]
    AlreadyMapped,
}

impl FormatError {
    /// Shorthand for [`FormatError::Invalid`].
    pub(crate) fn invalid(what: impl Into<String>) -> Self {
        Self::Invalid { what: what.into() }
    }
}
