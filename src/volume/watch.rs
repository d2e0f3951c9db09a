//! A volume that notices changes of its files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::wrapper::pass_on;
use super::{Preparation, Result, VolumeInfo, VolumeSource, Workspace};
use crate::fault::Fault;
use crate::identity::file_identity;

/// A volume that reports if one of its files has changed since it was opened.
///
/// Holds 8 bytes a file. Cost: every file is looked up when the volume is made, and again when it is checked.
pub(crate) struct FileWatch {
    source: Box<dyn VolumeSource>,
    /// Identities of the files of samples, in order; empty where only `description` counts.
    stamps: Box<[u64]>,
    /// A file that describes the volume: its header, or a side-car.
    description: Option<(PathBuf, u64)>,
}

impl FileWatch {
    /// Watches the files of samples, and one that describes them.
    pub(crate) fn files(source: Box<dyn VolumeSource>, description: Option<&Path>) -> Box<dyn VolumeSource> {
        let mut stamps = Vec::new();
        source.for_each_file(&mut |path| stamps.push(file_identity(path)));
        let description = description.map(|path| (path.to_path_buf(), file_identity(path)));
        Box::new(Self { source, stamps: stamps.into(), description })
    }

    /// Watches a file that describes a volume, in addition to the files that the volume watches.
    pub(crate) fn description(source: Box<dyn VolumeSource>, path: &Path) -> Box<dyn VolumeSource> {
        Box::new(Self {
            source,
            stamps: Box::default(),
            description: Some((path.to_path_buf(), file_identity(path))),
        })
    }
}

#[deny(clippy::missing_trait_methods)]
impl VolumeSource for FileWatch {
    pass_on!(self => self.source; facts);
    pass_on!(self => self.source; samples);

    fn check_unchanged(&self) -> Result {
        self.source.check_unchanged()?;
        let mut changed = None;
        let mut look = |path: &Path, then: u64| {
            if changed.is_none() && file_identity(path) != then {
                changed = Some(path.to_path_buf());
            }
        };
        if let Some((path, then)) = &self.description {
            look(path, *then);
        }
        if !self.stamps.is_empty() {
            let mut stamps = self.stamps.iter();
            self.source.for_each_file(&mut |path| {
                if let Some(then) = stamps.next() {
                    look(path, *then);
                }
            });
        }
        changed.map_or(Ok(()), |path| Err(Fault::changed().at(path).into()))
    }
}

#[cfg(test)]
mod tests {
    use crate::volume::SourceFault;
    use std::fs;

    use super::*;
    use crate::source::{RawOptions, RawVolume};

    #[test]
    fn every_way_to_change_a_file_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let fresh = || {
            for name in ["a", "b", "about"] {
                let _ = fs::remove_file(at(name));
                fs::write(at(name), [1; 4]).unwrap();
            }
            let volume = RawVolume::open(&[at("a"), at("b")], &RawOptions::small()).unwrap();
            FileWatch::files(Box::new(volume), Some(&at("about")))
        };
        type Change<'a> = &'a dyn Fn(&Path);
        let ways: [(&str, Change<'_>); 6] = [
            ("overwritten", &|path| {
                // Later than any tick of the clock that the file was made in.
                let file = fs::OpenOptions::new().write(true).open(path).unwrap();
                file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(1)).unwrap();
            }),
            ("grown", &|path| fs::write(path, [1; 5]).unwrap()),
            ("cut", &|path| fs::write(path, []).unwrap()),
            ("replaced", &|path| {
                let time = fs::metadata(path).unwrap().modified().unwrap();
                fs::write(at("new"), [2; 4]).unwrap();
                fs::File::open(at("new")).unwrap().set_modified(time).unwrap();
                fs::rename(at("new"), path).unwrap();
            }),
            ("removed", &|path| fs::remove_file(path).unwrap()),
            ("linked", &|path| {
                fs::remove_file(path).unwrap();
                crate::platform::symlink("/dev/zero", path).unwrap();
            }),
        ];
        for (how, change) in ways {
            for name in ["a", "b", "about"] {
                let volume = fresh();
                assert!(volume.check_unchanged().is_ok());
                change(&at(name));
                let error = volume.check_unchanged().unwrap_err();
                assert!(
                    matches!(error.fault(), SourceFault::Said(fault) if *fault == Fault::changed().at(at(name))),
                    "{how}: {error:?}"
                );
            }
        }
    }
}
