//! What can be wrong with headers before raw samples: MRC, VGStudio, VTK, Amira.

use thiserror::Error;

/// Why such a file is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum HeadedFault {
    #[error("its header does not state {field}, or not as it should; is it damaged?")]
    Missing { field: &'static str },
    #[error("holds {}, which is not read; {cure}", .what.escape_debug())]
    Unread { what: String, cure: &'static str },
}
