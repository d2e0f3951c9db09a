//! A box cut out of a volume.

use std::ops::Range;
use std::path::PathBuf;

use super::wrapper::owns_source_and_info;
use super::{Result, Treatment, VolumeInfo, VolumeSource, Wrapper};
use crate::fault::usage;
use crate::geom::Dims;
use crate::text::names::ROI;

/// Some columns, rows and slices of another volume. The affine's origin moves along, so every voxel keeps its place in
/// the world. No memory is held; no pass is added.
pub struct Crop<'a> {
    source: Box<dyn VolumeSource + 'a>,
    info: VolumeInfo,
    roi: [Range<u32>; 3],
}

impl<'a> Crop<'a> {
    /// The voxels with indices in `roi` (along x, y, z; the ends are not included).
    ///
    /// # Errors
    /// [`SourceError`](super::SourceError) when the box is empty or not within the volume.
    pub fn new(source: Box<dyn VolumeSource + 'a>, roi: [Range<u32>; 3]) -> Result<Self> {
        let mut info = source.info().clone();
        let size = roi.clone().map(|r| r.end.saturating_sub(r.start));
        let fits = roi.iter().zip(info.dims.to_array()).all(|(r, n)| r.end <= n);
        let Some(dims) = Dims::new(size[0], size[1], size[2]).filter(|_| fits) else {
            let path = PathBuf::from(&info.description.name);
            return Err(usage!("{ROI} {:?},{:?},{:?} is empty or not within the volume of {} voxels; write X0..X1,Y0..Y1,Z0..Z1 with each end at most the side", roi[0], roi[1], roi[2], info.dims).at(path).into());
        };
        let corner = roi.clone().map(|r| f64::from(r.start));
        let origin = info.affine.apply(corner);
        for (row, at) in info.affine.rows.iter_mut().zip(origin) {
            row[3] = at;
        }
        info.dims = dims;
        info.description.treatments.push(Treatment::Crop(roi.clone()));
        Ok(Self { source, info, roi })
    }
}

/// The part of a range that begins at `start`.
fn moved(range: &Range<u32>, start: u32) -> Range<u32> {
    range.start.saturating_add(start)..range.end.saturating_add(start)
}

impl Wrapper for Crop<'_> {
    owns_source_and_info!();

    fn own_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let [x, y, slices] = &self.roi;
        let z = z.saturating_add(slices.start);
        self.source.read_rows(z, moved(&rows, y.start), moved(&cols, x.start), out)
    }

    fn own_pitched(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        pitch: usize,
        out: &mut [u8],
    ) -> Result {
        let [x, y, slices] = &self.roi;
        let z = z.saturating_add(slices.start);
        self.source.read_pitched(z, moved(&rows, y.start), moved(&cols, x.start), pitch, out)
    }
}
