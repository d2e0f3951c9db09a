//! Every sentence about an input: facts are values up to here, and become text last.
//!
//! Names of flags and commands are written here only; what reads volumes knows none of them.

mod codec;
mod dicom;
mod note;

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
