//! Sentences for facts. Everything below states what it found, assumed or refused as values; this is where they
//! become text, and the only place that names options.

mod codec;
mod dicom;
