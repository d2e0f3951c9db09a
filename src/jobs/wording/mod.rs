//! Every sentence about an input: facts are values up to here, and become text last.
//!
//! Names of flags and commands are written here only; what reads volumes knows none of them.
//!
//! | file | sentences about |
//! |---|---|
//! | `note` | what was guessed, left out, replaced or odd |
//! | `error` | why a volume cannot be used |
//! | `found` | files that are left out, and the choice among volumes |
//! | `header` | headers of text: NRRD, MetaImage, and what they share |
//! | `binary` | binary headers: NIfTI, NumPy |
//! | `picture` | TIFF and PNG |
//! | `samples` | samples in files |
//! | `sidecar` | side-cars |
//! | `dicom` | DICOM |

mod binary;
mod codec;
mod dicom;
mod error;
mod found;
mod header;
mod note;
mod picture;
mod samples;
mod sidecar;

use crate::facts::Note;

/// The sentences of notes in their order, each once.
pub fn sentences(notes: &[Note]) -> Vec<String> {
    let mut kept: Vec<String> = Vec::new();
    for sentence in notes.iter().map(Note::to_string) {
        if !kept.contains(&sentence) {
            kept.push(sentence);
        }
    }
    kept
}
