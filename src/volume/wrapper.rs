//! Volumes that wrap another one, with the methods that they pass on unchanged in one place.

use std::ops::Range;
use std::path::Path;

use super::{Note, Preparation, Result, VolumeInfo, VolumeSource, Workspace, row_by_row};

/// A volume made of another one: it states and reads the differences; all else is the inner volume's.
///
/// Each one is a [`VolumeSource`] by the implementation below. The methods have other names, so that a volume's
/// methods stay unambiguous.
pub(crate) trait Wrapper: Sized + Send + Sync {
    /// The inner volume.
    fn inner(&self) -> &dyn VolumeSource;

    /// The inner volume, to be prepared; `None` if it is borrowed, and so was prepared before.
    fn inner_mut(&mut self) -> Option<&mut dyn VolumeSource>;

    /// [`VolumeSource::info`] of the wrapper.
    fn own_info(&self) -> &VolumeInfo;

    /// The wrapper's info, to take over the notes that preparing the inner volume adds.
    fn own_info_mut(&mut self) -> &mut VolumeInfo;

    /// Bytes held per reading thread beyond the inner volume's.
    fn own_bytes(&self) -> u64 {
        0
    }

    /// [`VolumeSource::average_mask`] of the wrapper.
    fn own_average_mask(&mut self, labels: &dyn Fn(&dyn VolumeSource) -> Option<usize>) {
        let _ = labels;
    }

    /// [`VolumeSource::read_rows`] of the wrapper: the inner volume's samples, unless they are changed.
    ///
    /// # Errors
    /// The errors of [`VolumeSource::read_rows`].
    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        self.inner().read_rows(z, rows, cols, out)
    }

    /// [`VolumeSource::read_pitched`] of the wrapper: row by row, unless overridden.
    ///
    /// # Errors
    /// The errors of [`VolumeSource::read_pitched`].
    fn own_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        row_by_row(self, z, rows, cols, pitch, out)
    }
}

/// The accessors of a [`Wrapper`] that owns its volume in the field `source` and states its own `info`.
macro_rules! owns_source_and_info {
    () => {
        fn inner(&self) -> &dyn VolumeSource {
            &*self.source
        }
        fn inner_mut(&mut self) -> Option<&mut dyn VolumeSource> {
            Some(&mut *self.source)
        }
        fn own_info(&self) -> &VolumeInfo {
            &self.info
        }
        fn own_info_mut(&mut self) -> &mut VolumeInfo {
            &mut self.info
        }
    };
}
pub(crate) use owns_source_and_info;

/// Methods of [`VolumeSource`] that are passed on to the volume `$inner`.
///
/// Each implementation denies `missing_trait_methods`: a method that the trait gains is an error there until it is
/// passed on. Its default would speak for the wrapper instead of the inner volume.
macro_rules! pass_on {
    ($self:ident => $inner:expr; facts) => {
        fn modality(&$self) -> Option<&str> {
            $inner.modality()
        }
        fn for_each_file(&$self, each: &mut dyn FnMut(&Path)) {
            $inner.for_each_file(each);
        }
        fn preparation(&$self) -> Preparation {
            $inner.preparation()
        }
    };
    ($self:ident => $inner:expr; changes) => {
        fn check_unchanged(&$self) -> Result {
            $inner.check_unchanged()
        }
    };
    ($self:ident => $inner:expr; samples) => {
        fn info(&$self) -> &VolumeInfo {
            $inner.info()
        }
        fn prepare(&mut $self, workspace: &Workspace<'_>) -> Result {
            $inner.prepare(workspace)
        }
        fn average_mask(&mut $self, labels: &dyn Fn(&dyn VolumeSource) -> Option<usize>) {
            $inner.average_mask(labels);
        }
        fn read_rows(&$self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
            $inner.read_rows(z, rows, cols, out)
        }
        fn read_pitched(
            &$self,
            z: u32,
            rows: Range<u32>,
            cols: Range<u32>,
            pitch: usize,
            out: &mut [u8],
        ) -> Result {
            $inner.read_pitched(z, rows, cols, pitch, out)
        }
        fn resident_bytes(&$self) -> u64 {
            $inner.resident_bytes()
        }
    };
}
pub(super) use pass_on;

/// A borrowed volume, so that a wrapper such as [`Crop`](super::Crop) need not own it.
#[deny(clippy::missing_trait_methods)]
impl VolumeSource for &mut (dyn VolumeSource + '_) {
    pass_on!(self => (**self); facts);
    pass_on!(self => (**self); changes);
    pass_on!(self => (**self); samples);
}

#[deny(clippy::missing_trait_methods)]
impl<W: Wrapper> VolumeSource for W {
    pass_on!(self => self.inner(); facts);
    pass_on!(self => self.inner(); changes);

    fn info(&self) -> &VolumeInfo {
        self.own_info()
    }

    fn average_mask(&mut self, labels: &dyn Fn(&dyn VolumeSource) -> Option<usize>) {
        self.own_average_mask(labels);
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let Some(inner) = self.inner_mut() else { return Ok(()) };
        let before = inner.info().notes.len();
        inner.prepare(workspace)?;
        let new = inner.info().notes.get(before..).unwrap_or_default().to_vec();
        self.own_info_mut().notes.extend(new);
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        self.own_rows(z, rows, cols, out)
    }

    fn read_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.own_pitched(z, rows, cols, pitch, out)
    }

    fn resident_bytes(&self) -> u64 {
        self.inner().resident_bytes() + self.own_bytes()
    }
}

/// A volume with other facts than its own: more notes, another spacing or other directions.
pub(crate) struct InfoOverride {
    source: Box<dyn VolumeSource>,
    info: VolumeInfo,
}

impl InfoOverride {
    /// The same samples, with the facts in `info`.
    pub(crate) fn boxed(source: Box<dyn VolumeSource>, info: VolumeInfo) -> Box<dyn VolumeSource> {
        Box::new(Self { source, info })
    }

    /// The same volume with one more note.
    pub(crate) fn with_note(source: Box<dyn VolumeSource>, note: Note) -> Box<dyn VolumeSource> {
        let mut info = source.info().clone();
        info.notes.push(note);
        Self::boxed(source, info)
    }
}

impl Wrapper for InfoOverride {
    owns_source_and_info!();

    fn own_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        self.source.read_pitched(z, rows, cols, pitch, out)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Crop, Downsample, GapFill};
    use super::*;
    use crate::budget::Budget;
    use crate::fault::Fault;
    use crate::progress::Silent;
    use crate::source::{RawOptions, RawVolume};
    use crate::volume::SourceFault;

    const NEEDS: Preparation = Preparation { scratch_bytes: 5, memory_bytes: 6, on_demand: true };

    /// A volume whose every method differs from the default.
    struct Scan(VolumeInfo);

    impl VolumeSource for Scan {
        fn info(&self) -> &VolumeInfo {
            &self.0
        }
        fn modality(&self) -> Option<&str> {
            Some("CT")
        }
        fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
            each(Path::new("a"));
        }
        fn check_unchanged(&self) -> Result {
            Err(Fault::changed().at("a").into())
        }
        fn preparation(&self) -> Preparation {
            NEEDS
        }
        fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
            let _memory = workspace.reserve(NEEDS.memory_bytes, || "a".into())?;
            self.0.notes.push(Note::new("0 is white in these pictures; the numbers are kept as they are"));
            Ok(())
        }
        fn read_rows(&self, z: u32, _: Range<u32>, _: Range<u32>, _: &mut [u8]) -> Result {
            Err(SourceFault::ReadFailed {
                path: "a".into(),
                slice: z,
                cause: std::io::ErrorKind::Other.into(),
            }
            .into())
        }
        fn resident_bytes(&self) -> u64 {
            7
        }
    }

    #[test]
    fn what_stands_before_a_volume_passes_on_all_that_it_leaves_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, [1; 8]).unwrap();
        let info = RawVolume::open(&[path], &RawOptions::small()).unwrap().info().clone();
        let scan = || Box::new(Scan(info.clone())) as Box<dyn VolumeSource>;
        let whole = [0..2, 0..2, 0..2];
        let between = vec![(0, 0.0), (0, 0.5), (1, 0.0)];
        let all: [(Box<dyn VolumeSource>, u64); 4] = [
            (
                GapFill::between(
                    scan(),
                    between,
                    Note::new("0 is white in these pictures; the numbers are kept as they are"),
                ),
                64 << 10,
            ),
            (InfoOverride::boxed(scan(), info.clone()), 0),
            (Box::new(Crop::new(scan(), whole).unwrap()), 0),
            (Box::new(Downsample::new(scan(), 2).unwrap()), 64 << 10),
        ];
        for (mut outer, own_bytes) in all {
            assert_eq!(outer.modality(), Some("CT"));
            assert_eq!(outer.preparation(), NEEDS);
            assert_eq!(outer.resident_bytes(), 7 + own_bytes);
            let mut files = Vec::new();
            outer.for_each_file(&mut |path| files.push(path.to_path_buf()));
            assert_eq!(files, [Path::new("a")]);
            assert!(outer.check_unchanged().is_err());
            let workspace =
                |bytes| Workspace { scratch: folder.path(), memory: Budget::new(bytes), progress: &Silent };
            let refused = outer.prepare(&workspace(1)).unwrap_err();
            assert!(matches!(refused.fault(), SourceFault::Memory { allowed_bytes: 1, .. }), "{refused}");
            outer.prepare(&workspace(6)).unwrap();
            let notes = &outer.info().notes;
            assert!(
                notes.ends_with(&[Note::new(
                    "0 is white in these pictures; the numbers are kept as they are"
                )]),
                "{notes:?}"
            );
            let mut out = [0; 4];
            for read in
                [outer.read_rows(0, 0..1, 0..1, &mut out), outer.read_pitched(0, 0..1, 0..1, 4, &mut out)]
            {
                let refused = read.unwrap_err();
                assert!(matches!(refused.fault(), SourceFault::ReadFailed { slice: 0, .. }), "{refused}");
            }
        }
    }
}
