//! What lies below some folders: every volume, with the reason where one cannot be used.
//!
//! Surveying reads headers only. A [`Catalogue`] holds little per item; an item is opened when it is its
//! turn, so that a disk full of studies needs no more memory than its largest series.

use std::path::{Path, PathBuf};

use super::{RawOptions, SourceError, VolumeSource};

/// How volumes are read, where they leave a choice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// What headerless files hold; they are no volumes without it.
    pub raw: Option<RawOptions>,
    /// What to do where slices of a series are missing.
    pub gaps: GapPolicy,
    /// A folder (canonical) that is not searched: that of the results.
    pub skip: Option<PathBuf>,
}

/// What to do where slices of a series are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapPolicy {
    /// Refuse the series, and say where.
    #[default]
    Error,
    /// Keep the true geometry: a missing slice is interpolated between its neighbours.
    Fill,
    /// Use the slices as if they were evenly spaced; the geometry is wrong by what the warning says.
    Keep,
}

/// One volume that was found, or why it cannot be used.
pub struct Finding {
    /// The file, or the folder of the files, as it was reached from what was searched.
    pub path: PathBuf,
    /// Suggested name of a model, without patient data and without an extension; the same for the same
    /// input wherever it lies. Not yet unique.
    pub stem: String,
    /// Kind of source: `dicom`, `nrrd`, `raw`, ...
    pub format: &'static str,
    /// What the input files are, to see whether they changed.
    pub files: InputFiles,
    /// Which part of its input it is, for example `echo 2`, where that holds several volumes.
    pub part: Option<String>,
    /// Words that must not be reported: parts of the patient's name and identifier.
    pub secrets: Vec<String>,
    /// The volume, not prepared yet.
    pub volume: Result<Box<dyn VolumeSource>, SourceError>,
}

/// The files behind a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputFiles {
    /// How many.
    pub count: u64,
    /// Their bytes together.
    pub bytes: u64,
    /// Depends on every name (relative to its folder), size and time of change.
    pub fingerprint: u64,
}

/// Files that are no volume and no part of one: one line for each kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// What they are, for example `DICOMDIR` or `not a volume`.
    pub reason: String,
    /// How many.
    pub count: u64,
    /// The first of them.
    pub first: PathBuf,
}

/// Everything that was found below some inputs.
#[derive(Debug, Default)]
pub struct Catalogue {
    items: Vec<PathBuf>,
    left_out: Vec<LeftOut>,
    options: OpenOptions,
}

impl Catalogue {
    /// Searches the inputs: files are taken as they are, folders are searched with everything below them.
    /// The result does not depend on the order in which a folder lists its files.
    ///
    /// # Errors
    /// An input cannot be read at all, or `scratch` cannot hold what does not fit into memory.
    pub fn survey(inputs: &[PathBuf], options: &OpenOptions, scratch: &Path) -> Result<Self, SourceError> {
        let _ = scratch;
        let mut found = Self { options: options.clone(), ..Self::default() };
        for input in inputs {
            std::fs::metadata(input)
                .map_err(|cause| SourceError::Unreadable { path: input.clone(), cause })?;
            found.items.push(input.clone());
        }
        Ok(found)
    }

    /// Number of items; each may hold several volumes.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// Was nothing found?
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The volumes of item `index`, refused ones included; none for an index out of range.
    pub fn open(&self, index: usize) -> Vec<Finding> {
        let Some(path) = self.items.get(index) else { return Vec::new() };
        vec![Finding {
            path: path.clone(),
            stem: super::raw::base_name(path),
            format: "dicom",
            files: InputFiles::default(),
            part: None,
            secrets: Vec::new(),
            volume: super::open(std::slice::from_ref(path), &self.options),
        }]
    }

    /// What is no volume, summed up.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }
}
