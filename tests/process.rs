//! Promises about the memory of the whole process, as the operating system counts it: what other tests hold meanwhile
//! would count, too, so these have a program of their own.

#[allow(dead_code, reason = "each program uses its own part")]
#[path = "it/common/mod.rs"]
mod common;
#[path = "process/formats_hostile.rs"]
mod formats_hostile;
#[path = "process/mutations.rs"]
mod mutations;
#[allow(unused_imports, reason = "each program uses its own part")]
#[path = "it/prelude.rs"]
mod prelude;
