//! Volumes from the statements of a header: each is checked against the files first.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{DirectSamples, Encoding, Linear, Samples, SliceOffsets, StoredVolume};
use crate::fault::{Fault, bad};
use crate::geom::{Affine, Dims};
use crate::source::files::{FileList, FileSet, base_name};
use crate::source::header::unusable;
use crate::volume::{
    Endian, Note, Rescale, Result, SourceDescription, SourceError, SourceFault, StatedLabel, VolumeInfo,
    VolumeSource,
};

/// Volumes that one file may hold: each takes about a KiB once it is opened.
const MAX_VOLUMES: u64 = 2048;

/// Offset of the samples in each file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::source) enum Skip {
    /// Bytes from the start.
    Bytes(u64),
    /// All bytes before the samples, which end the file.
    AllButSamples,
}

/// Layout of samples in one or several files, as a header states it.
pub(in crate::source) struct StoredLayout {
    /// The file to name where the header is wrong; its last part becomes the volume's name.
    pub(in crate::source) header: PathBuf,
    /// Name of the format.
    pub(in crate::source) format: &'static str,
    /// The files of the samples, in order.
    pub(in crate::source) files: FileList,
    /// Voxels along the three axes, the fastest first.
    pub(in crate::source) size: [u64; 3],
    /// Volumes, one after another.
    pub(in crate::source) volumes: u64,
    /// Type of the samples.
    pub(in crate::source) samples: Samples,
    /// Byte order of the samples.
    pub(in crate::source) endian: Endian,
    /// Packing of the samples.
    pub(in crate::source) encoding: Encoding,
    /// Offset of the samples.
    pub(in crate::source) skip: Skip,
    /// Unpacked bytes before the first sample of a stream.
    pub(in crate::source) skip_unpacked: Skip,
    /// Samples to physical values.
    pub(in crate::source) rescale: Rescale,
    /// Voxel index to LPS mm.
    pub(in crate::source) affine: Affine,
    /// Notes on all volumes.
    pub(in crate::source) notes: Vec<Note>,
    /// Labels that the header states; ignored for several volumes.
    pub(in crate::source) labels: Vec<StatedLabel>,
}

impl StoredLayout {
    /// The volumes; no sample is read yet.
    ///
    /// # Errors
    /// [`SourceError`] where the header contradicts itself or the files; [`SourceError`] where the system refuses.
    pub(in crate::source) fn open(mut self) -> Result<Vec<Box<dyn VolumeSource>>> {
        let wrong = |fault: Fault| Err(unusable(&self.header, fault));
        let sides = self.size.map(|n| u32::try_from(n).unwrap_or(0));
        let Some(dims) = Dims::new(sides[0], sides[1], sides[2]) else {
            return wrong(bad!(
                "its size of {}x{}x{} voxels is out of range; a side has 1 to {} of them",
                self.size[0],
                self.size[1],
                self.size[2],
                Dims::MAX_SIDE
            ));
        };
        if !(1..=MAX_VOLUMES).contains(&self.volumes) {
            return wrong(bad!(
                "holds {} volumes, and 1 to {MAX_VOLUMES} are read; split the file",
                self.volumes
            ));
        }
        if self.affine.inverse().is_none() {
            return wrong(bad!("its axes are flat, parallel or no numbers; correct spacing and directions"));
        }
        let Rescale { slope, intercept } = self.rescale;
        if !(slope.is_finite() && intercept.is_finite() && slope != 0.0) {
            return wrong(bad!("slope {slope} and intercept {intercept} give no values"));
        }
        let slices = u64::from(dims.nz()) * self.volumes;
        let count = self.files.len() as u64;
        if count == 0 || !slices.is_multiple_of(count) {
            return wrong(bad!(
                "{count} data files are named for {slices} slices, which cannot be shared out evenly"
            ));
        }
        let slices_per_file = slices / count;
        let slice_bytes = u64::from(dims.nx()) * u64::from(dims.ny()) * self.samples.bytes() as u64;
        let share = slices_per_file * slice_bytes;
        let skip = self.check_files(share)?;
        self.notes.extend(self.samples.note());
        let files = Arc::new(FileSet::new(std::mem::take(&mut self.files)));
        // Opened now, so that a missing permission shows before a long build and not in it.
        files.with(0, |_| Ok(())).map_err(|cause| {
            SourceError::from(SourceFault::Unreadable { path: files.list().path(0), cause })
        })?;
        let name = base_name(&self.header);
        let volume = |index: u64| -> Box<dyn VolumeSource> {
            let mut notes = self.notes.clone();
            if self.volumes > 1 {
                notes.push(Note::new(format!(
                    "this is volume {} of {} in the file",
                    index + 1,
                    self.volumes
                )));
            }
            let info = VolumeInfo {
                dims,
                scalar: self.samples.delivered(),
                rescale: self.rescale,
                spacing_mm: self.affine.spacing_mm(),
                affine: self.affine,
                description: SourceDescription {
                    format: self.format.into(),
                    name: name.clone(),
                    files: count,
                    bytes: dims.voxels() * self.samples.bytes() as u64,
                    labels: if self.volumes == 1 { self.labels.clone() } else { Vec::new() },
                    ..SourceDescription::default()
                },
                notes,
            };
            let first_slice = index * u64::from(dims.nz());
            let (files, samples, endian) = (Arc::clone(&files), self.samples, self.endian);
            if self.encoding == Encoding::Raw {
                let offsets = SliceOffsets::Even { slices_per_file, skip, first_slice };
                return Box::new(StoredVolume::direct(
                    info,
                    DirectSamples { files, offsets, samples, endian },
                ));
            }
            let (encoding, skip_unpacked) = (self.encoding, self.skip_unpacked);
            Box::new(StoredVolume::sequential(
                info,
                Box::new(Linear {
                    files,
                    encoding,
                    samples,
                    endian,
                    slices_per_file,
                    first_slice,
                    skip,
                    skip_unpacked,
                }),
            ))
        };
        Ok((0..self.volumes).map(volume).collect())
    }

    /// Compares the size of every file with its share; returns the offset at which the samples begin.
    fn check_files(&mut self, share: u64) -> Result<u64> {
        let mut common = None;
        let mut longer = 0_u64;
        for index in 0..self.files.len() {
            let path = self.files.path(index);
            let length = regular(&path)?;
            let wrong = |fault: Fault| Err(unusable(&path, fault));
            let skip = match self.skip {
                Skip::Bytes(skip) => skip,
                Skip::AllButSamples => length.saturating_sub(share),
            };
            if *common.get_or_insert(skip) != skip {
                return wrong(bad!("its samples begin elsewhere than those of the first file"));
            }
            let there = length.saturating_sub(skip);
            if self.encoding == Encoding::Raw {
                if there < share {
                    return wrong(bad!(
                        "the header promises {share} bytes of samples, the file has {there}; it was cut short or its header is wrong"
                    ));
                }
                longer += u64::from(there > share);
                continue;
            }
            let before = if let Skip::Bytes(before) = self.skip_unpacked { before } else { 0 };
            let promised = share.saturating_add(before);
            if self.encoding.most(there, self.samples) < promised {
                let packing = self.encoding.packing();
                return wrong(bad!(
                    "the header promises {promised} bytes of samples, more than {there} bytes of {packing} can hold; it was cut short or its header is wrong"
                ));
            }
        }
        if longer > 0 {
            let several = self.files.len() > 1;
            self.notes.push(if several {
                Note::new(format!(
                    "{longer} of the data files held more than the header promises; the rest is ignored"
                ))
            } else {
                Note::new("the file held more than the header promises; the rest is ignored")
            });
        }
        Ok(common.unwrap_or(0))
    }
}

/// Length of a regular file: no device, pipe or folder is opened because a header names it.
pub(in crate::source) fn regular(path: &Path) -> Result<u64> {
    let meta = fs::metadata(path)
        .map_err(|cause| SourceError::from(SourceFault::Unreadable { path: path.to_path_buf(), cause }))?;
    if !meta.is_file() {
        return Err(unusable(path, bad!("is not a regular file, so it cannot hold samples")));
    }
    Ok(meta.len())
}
