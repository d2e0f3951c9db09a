//! Trees from text: the evaluated form of OpenSCAD (`openscad -o part.csg part.scad`), and modules of our own.
//!
//! ```text
//! difference() {
//!     multmatrix([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) { sphere(r = 10); }
//!     halfspace(normal = [0, 0, -1], offset = 0);
//! }
//! ```
//!
//! The text has neither loops nor expressions, so its memory is bounded by its size. It is read once, as a stream; open
//! blocks wait on a list, so that their depth does not matter.

mod bound;
mod lexer;
mod modules;
mod parser;
mod values;

pub(super) use bound::memory_bound;
pub(super) use modules::is_module;
pub(super) use parser::parse;

use crate::fault::{Fault, conversions};

/// Reason why a text cannot be read.
#[derive(Debug)]
pub(super) enum Stop {
    Text(Fault),
    Read(std::io::Error),
    /// The tree takes more memory than it may.
    Memory {
        bytes: u64,
    },
}

conversions!(Stop {
    fault: Fault => Self::Text(fault),
    cause: std::io::Error => Self::Read(cause),
});
