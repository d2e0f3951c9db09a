//! Trees from text: the evaluated form of OpenSCAD (`openscad -o part.csg part.scad`), and modules of our own.
//!
//! ```text
//! difference() {
//!     multmatrix([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) { sphere(r = 10); }
//!     halfspace(normal = [0, 0, -1], offset = 0);
//! }
//! ```
//!
//! The text has neither loops nor expressions, so what it takes is bounded by its size. It is read once, as a stream;
//! blocks that are open wait on a list, so that their depth does not matter.

mod lexer;
mod modules;
mod parser;
mod stop;
mod values;

pub(super) use modules::is_module;
pub(super) use parser::parse;
pub(super) use stop::Stop;
