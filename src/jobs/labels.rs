//! Label maps among volumes: their recognition, and the options of their builds without a choice of the inside.

use std::path::Path;

use super::build::prepare;
use crate::budget::MemoryCap;
use crate::builder::{BuildNote, BuildOptions, Connectivity, LabelChoice, Threshold, choose_noted};
use crate::clean::CleanOptions;
use crate::error::Error;
use crate::format::{Channel, Selection};
use crate::progress::Progress;
use crate::volume::VolumeSource;

/// Number of labels that the header of a volume states.
pub(super) fn stated(source: &dyn VolumeSource) -> usize {
    source.info().description.labels.len()
}

/// The options of a build of all labels, without those that labels do not have.
pub(super) fn all_labels(options: &BuildOptions) -> BuildOptions {
    BuildOptions {
        labels: Some(LabelChoice::All),
        channels: Some(options.channels().iter().filter(|channel| *channel == Channel::Normal).collect()),
        connectivity: Connectivity::default(),
        error: None,
        ..options.clone()
    }
}

/// Kind of a volume's values.
pub(super) enum Values {
    /// Labels, and their number.
    Labels(usize),
    /// A mixture, with the selection of its inside.
    Mixed(Selection, Option<BuildNote>),
}

/// Reads a volume, as Otsu's method does, and tells whether its values look like labels: a few whole numbers in flat
/// regions.
///
/// Memory and cost are the same as for finding a threshold; the volume is prepared first.
///
/// # Errors
/// The volume cannot be read, its values are all alike, or the memory is too small.
pub(super) fn look(
    source: &mut dyn VolumeSource,
    clean: &CleanOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Values, Error> {
    prepare(source, clean, options, output, progress)?;
    let (memory, threads): (MemoryCap, usize) = (options.memory, options.threads);
    let (selection, note) = choose_noted(source, Threshold::Otsu, memory, threads, progress)?;
    Ok(match note {
        Some(BuildNote::Labels { count }) => Values::Labels(count),
        note => Values::Mixed(selection, note),
    })
}
