//! The out-of-core builder: a volume in, an `.oct` out, in a fixed amount of memory.

mod error;

pub use error::BuildError;
