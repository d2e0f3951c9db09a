//! Whose images lie in a folder: words that are masked in the names of the other files there.
//!
//! A segmentation that somebody saved beside a series often bears the name of the patient, and says nothing
//! of its own. The words wait in the log of the survey, chained per folder; 16 bytes per folder are in memory.

use std::collections::{HashMap, HashSet};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use super::log::{Log, NONE, Record};
use super::patients::PatientWords;
use super::safe_name;
use crate::source::StableHash;
use crate::source::dicom::{Secrets, words};
use crate::volume::SourceError;

/// What stands for a masked word in the name of a model.
const MASK: &str = "x";

/// Folders with DICOM images, and what these tell of patients.
#[derive(Debug, Default)]
pub(super) struct Beside {
    /// Last record of each folder.
    folders: HashMap<u64, u64>,
    /// What was noted last: the images of a folder mostly show one patient.
    latest: Option<(u64, Secrets)>,
}

impl Beside {
    /// A folder in short. Two of one key share their words: too much is masked then, never too little.
    pub(super) fn key(folder: &Path) -> u64 {
        StableHash::new().part(folder.as_os_str().as_bytes()).finish()
    }

    /// Notes whom an image in a folder shows; of many patients the first words.
    ///
    /// # Errors
    /// [`SourceError::Scratch`] when the disk is full.
    pub(super) fn note(&mut self, folder: &Path, secrets: Secrets, log: &mut Log) -> Result<(), SourceError> {
        let latest = Some((Self::key(folder), secrets));
        if self.latest == latest {
            return Ok(());
        }
        self.latest = latest;
        let Some((folder, secrets)) = &self.latest else { return Ok(()) };
        let mut last = self.folders.get(folder).copied().unwrap_or(NONE);
        let mut all = chained(log, last)?;
        let known = all.len();
        words(secrets, &mut all);
        for word in all.iter().skip(known) {
            last = log.push(&Record { before: last, size: 0, changed: 0, input: 0, path: word.into() })?;
        }
        if last != NONE {
            self.folders.insert(*folder, last);
        }
        Ok(())
    }

    /// Forgets all folders but those of the given keys.
    pub(super) fn keep(&mut self, asked: &HashSet<u64>) {
        self.folders.retain(|folder, _| asked.contains(folder));
        self.folders.shrink_to_fit();
        self.latest = None;
    }

    /// The words noted for a folder.
    ///
    /// # Errors
    /// [`SourceError::Scratch`] when the disk fails.
    pub(super) fn words(&self, folder: &Path, log: &Log) -> Result<Vec<String>, SourceError> {
        chained(log, self.folders.get(&Self::key(folder)).copied().unwrap_or(NONE))
    }
}

fn chained(log: &Log, last: u64) -> Result<Vec<String>, SourceError> {
    log.chain(last).map(|record| Ok(record?.path.to_string_lossy().into_owned())).collect()
}

/// A name in which `x` stands for every word, in whatever case it is written, and for what
/// [`safe_name`] makes of it; and for the words of all `patients`.
pub(super) fn masked(name: &str, words: &[String], patients: &PatientWords) -> String {
    let own: Vec<String> = words.iter().flat_map(|w| [w.clone(), safe_name(w)]).collect();
    patients.masked(name, &own, MASK, &|_, _| false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_masked_in_any_case_and_as_safe_names_have_them() {
        let words = ["Ann".to_owned(), "Anna".into(), "Müller".into(), "山田".into()];
        let none = PatientWords::default();
        for (name, expected) in [
            ("ANNA_seg", "x_seg"),
            ("head-müller-anna.2", "head-x-x.2"),
            ("M_ller", "x"),
            ("mull", "mull"),
            ("山田1", "x1"),
            ("", ""),
        ] {
            assert_eq!(masked(name, &words, &none), expected);
        }
        assert_eq!(masked("Anna", &[], &none), "Anna");
    }
}
