//! What can be wrong with NIfTI headers.

use std::borrow::Cow;

use thiserror::Error;

/// Why a NIfTI header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum NiftiFault {
    #[error("its samples begin at byte {offset}, within its header")]
    WithinHeader { offset: u64 },
    #[error("is the header of a pair, and no .img file lies beside it; copy both")]
    NoImage,
    #[error("ends after {bytes} bytes, within its NIfTI header; copy the file again")]
    Short { bytes: usize },
    #[error("its NIfTI header is damaged: it states another length than 348 or 540")]
    Length,
    #[error("its NIfTI header is damaged: it has {count} dimensions")]
    Dimensions { count: i64 },
    #[error(
        "is ANALYZE 7.5, or has a damaged NIfTI header: left and right cannot be distinguished, so it is not read; convert it to NIfTI"
    )]
    Analyze,
    #[error("its NIfTI header is damaged: its samples begin nowhere")]
    Nowhere,
    #[error("its NIfTI-2 header is damaged: it has no magic")]
    NoMagic,
    #[error("its NIfTI-2 header was changed by a transfer as text; copy the file as binary")]
    TextTransfer,
    #[error(
        "has {dimensions} dimensions, so a voxel has several values; extract one component into a file of its own"
    )]
    SeveralValues { dimensions: i64 },
    #[error("its samples are {}, which is not read", type_name(*.code))]
    Type { code: i16 },
}

fn type_name(code: i16) -> Cow<'static, str> {
    match code {
        1 => "single bits".into(),
        32 | 1792 | 2048 => "complex numbers".into(),
        128 | 2304 => "colours (RGB)".into(),
        1536 => "128-bit floats".into(),
        other => format!("of the unknown type {other}").into(),
    }
}
