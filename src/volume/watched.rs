//! A volume whose files are held against what they were when it was opened.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{Preparation, SourceError, VolumeInfo, VolumeSource, Workspace};
use crate::facts::Fault;
use crate::identity::file_identity;

/// A volume that knows what its files were, and says so when one of them is not any more.
///
/// Holds 8 bytes a file. Cost: every file is looked up once when it is made, and once when it is asked.
pub(crate) struct Watched {
    source: Box<dyn VolumeSource>,
    /// Of the files of samples, in their order; empty where only `beside` counts.
    stamps: Box<[u64]>,
    /// A file that says something of the volume: its header, or a side-car.
    beside: Option<(PathBuf, u64)>,
}

impl Watched {
    /// Watches the files of samples, and one that speaks of them.
    pub(crate) fn files(source: Box<dyn VolumeSource>, beside: Option<&Path>) -> Box<dyn VolumeSource> {
        let mut stamps = Vec::new();
        source.for_each_file(&mut |path| stamps.push(file_identity(path)));
        let beside = beside.map(|path| (path.to_path_buf(), file_identity(path)));
        Box::new(Self { source, stamps: stamps.into(), beside })
    }

    /// Watches a file that speaks of a volume, besides what the volume watches.
    pub(crate) fn beside(source: Box<dyn VolumeSource>, path: &Path) -> Box<dyn VolumeSource> {
        Box::new(Self {
            source,
            stamps: Box::default(),
            beside: Some((path.to_path_buf(), file_identity(path))),
        })
    }
}

#[deny(clippy::missing_trait_methods)]
impl VolumeSource for Watched {
    fn info(&self) -> &VolumeInfo {
        self.source.info()
    }

    fn modality(&self) -> Option<&str> {
        self.source.modality()
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.source.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.source.check_unchanged()?;
        let mut changed = None;
        let mut look = |path: &Path, then: u64| {
            if changed.is_none() && file_identity(path) != then {
                changed = Some(path.to_path_buf());
            }
        };
        if let Some((path, then)) = &self.beside {
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
        changed.map_or(Ok(()), |path| Err(SourceError::Unusable { path, fault: Fault::ChangedInUse }))
    }

    fn preparation(&self) -> Preparation {
        self.source.preparation()
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result<(), SourceError> {
        self.source.prepare(workspace)
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        self.source.read_rows(z, rows, cols, out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        self.source.read_pitched(z, rows, cols, pitch, out)
    }

    fn resident_bytes(&self) -> u64 {
        self.source.resident_bytes()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::geom::{Dims, Orientation};
    use crate::source::{RawOptions, RawVolume};
    use crate::volume::{Endian, ScalarType};

    #[test]
    fn every_way_to_change_a_file_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let fresh = || {
            for name in ["a", "b", "about"] {
                let _ = fs::remove_file(at(name));
                fs::write(at(name), [1; 4]).unwrap();
            }
            let raw = RawOptions {
                dims: Dims::new(2, 2, 2).unwrap(),
                scalar: ScalarType::U8,
                endian: Endian::Little,
                spacing_mm: [1.0; 3],
                skip: 0,
                orientation: Orientation::LPS,
            };
            let volume = RawVolume::open(&[at("a"), at("b")], &raw).unwrap();
            Watched::files(Box::new(volume), Some(&at("about")))
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
                    matches!(&error, SourceError::Unusable { path, fault: Fault::ChangedInUse } if *path == at(name)),
                    "{how}: {error:?}"
                );
            }
        }
    }
}
