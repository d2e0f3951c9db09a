//! A note on a volume that can be used all the same: a guess, a loss, a replacement or an oddity.

use std::borrow::Cow;
use std::fmt;

use crate::text::shown;

/// A note for the users of a volume, one sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    pub(crate) kind: NoteKind,
    text: Cow<'static, str>,
}

/// The subject of a note, as far as code branches on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoteKind {
    /// A spacing of 1 mm was assumed, along one axis at least.
    AssumedSpacing,
    AssumedDirections,
    /// Rows or columns are stored backwards.
    Backwards,
    Other,
}

impl Note {
    pub(crate) fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self { kind: NoteKind::Other, text: text.into() }
    }

    /// The note of an assumed spacing.
    pub(crate) fn spacing(text: impl Into<Cow<'static, str>>) -> Self {
        Self { kind: NoteKind::AssumedSpacing, text: text.into() }
    }

    /// The note of assumed directions.
    pub(crate) fn directions(text: impl Into<Cow<'static, str>>) -> Self {
        Self { kind: NoteKind::AssumedDirections, text: text.into() }
    }

    pub(crate) fn no_spacing(by: &str) -> Self {
        Self::spacing(format!("{by} states no spacing; 1 mm is assumed"))
    }

    pub(crate) fn no_directions(by: &str) -> Self {
        Self::directions(format!("{by} states no directions; its axes are taken as LPS"))
    }

    /// The note of an axis that is stored backwards: 0 for columns from right to left, 1 for rows from the bottom up.
    pub(crate) fn backwards(axis: usize) -> Self {
        let stored = match axis {
            0 => "columns are stored from right to left",
            _ => "rows are stored from the bottom up",
        };
        let text = format!("{stored} (Orientation), and are placed so").into();
        Self { kind: NoteKind::Backwards, text }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

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
