//! The sentences: what every fact of the library reads like, with the names of flags and commands.
//!
//! Nothing below `jobs` writes a sentence; the types there hold facts, and are displayed by this module.

mod builder;
mod clean;
mod format;
mod load;
mod render;
mod top;
