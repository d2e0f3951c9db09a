//! The sentences: what every fact of the library reads like, with the names of flags and commands.
//!
//! Nothing below `jobs` writes a sentence: the types there hold facts, and become text last, here.
//!
//! | file | sentences about |
//! |---|---|
//! | `note` | what was guessed, left out, replaced or odd in an input |
//! | `error` | why a volume cannot be used |
//! | `found` | files that are left out, and the choice among volumes |
//! | `header` | headers of text: NRRD, MetaImage, and what they share |
//! | `binary` | binary headers: NIfTI, NumPy |
//! | `picture` | TIFF and PNG |
//! | `samples` | samples in files |
//! | `numbered` | slices numbered by the names of their files |
//! | `foreign` | (no sentences) the one way in which foreign text is printed |
//! | `sidecar` | side-cars |
//! | `synthetic` | synthetic volumes |
//! | `dicom` | DICOM |
//! | `mesh` | meshes: what is wrong, what was found and chosen |
//! | `csg` | the same of trees of solids |
//! | `builder`, `clean` | why a build stops, before and after cleaning |
//! | `format`, `load` | what is wrong with an `.oct`, and why it cannot be opened |
//! | `render` | why a picture cannot be made |
//! | `scene` | what is wrong with the text of a scene |
//! | `hint` | what may be wanted besides |
//! | `number` | numbers with the digits that mean something |
//! | `system` | what to do about what the operating system refuses |
//! | `top` | what stops a job, and the system's refusals |

mod binary;
mod builder;
mod clean;
mod codec;
mod csg;
mod dicom;
mod error;
pub mod foreign;
mod format;
mod found;
mod header;
mod hint;
mod load;
mod mesh;
mod note;
mod number;
mod numbered;
mod picture;
mod render;
mod samples;
mod scene;
mod sidecar;
mod synthetic;
mod system;
mod top;

use crate::facts::Note;
use foreign::shown;

pub(super) use hint::Hint;
pub use number::{Short, WithError};

/// The sentences of notes in their order, each once.
pub fn sentences(notes: &[Note]) -> Vec<String> {
    let mut kept: Vec<String> = Vec::new();
    for sentence in notes.iter().map(|note| shown(&note.to_string()).to_string()) {
        if !kept.contains(&sentence) {
            kept.push(sentence);
        }
    }
    kept
}
