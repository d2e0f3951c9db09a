//! A volume whose axes come in the other order: the slowest is x. Unrolled once, block by block.

use std::ops::Range;
use std::path::Path;

use crate::geom::Dims;
use crate::volume::{
    Preparation, Result, SourceError, SourceFault, Spool, VolumeInfo, VolumeSource, Workspace, check_request,
    not_unrolled,
};

/// Bytes of a block that is turned at a time.
const BLOCK_BYTES: usize = 1 << 20;

/// `inner` with its axes reversed: voxel (x, y, z) is its (z, y, x), and spacing and directions change along.
///
/// Holds a block of 1 MiB while it unrolls itself, and one row of a volume whose rows are longer than that.
pub(super) struct AxisReversal {
    info: VolumeInfo,
    inner: Box<dyn VolumeSource>,
    spool: Option<Spool>,
}

impl AxisReversal {
    /// Reverses the axes of a volume that is read by position and has no directions yet.
    pub(super) fn new(inner: Box<dyn VolumeSource>) -> Self {
        let mut info = inner.info().clone();
        let [a, b, c] = info.dims.to_array();
        // The sides are in range in any order.
        info.dims = Dims::new(c, b, a).unwrap_or(info.dims);
        Self { info, inner, spool: None }
    }

    /// Columns and rows of the inner volume that are turned at a time.
    fn block(&self) -> (u32, u32) {
        let [columns, rows, slices] = self.inner.info().dims.to_array();
        let column = slices as usize * self.info.scalar.bytes();
        let fit = |each: usize, most: u32| {
            u32::try_from(BLOCK_BYTES / each.max(1)).unwrap_or(u32::MAX).clamp(1, most)
        };
        let width = fit(column, columns);
        (width, fit(column * width as usize, rows))
    }
}

impl VolumeSource for AxisReversal {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.inner.for_each_file(each);
    }

    fn preparation(&self) -> Preparation {
        if self.spool.is_some() {
            return Preparation::default();
        }
        let bytes = self.info.scalar.bytes() as u64;
        let (width, height) = self.block();
        let slice = u64::from(width) * u64::from(height) * bytes;
        Preparation {
            scratch_bytes: self.info.dims.voxels() * bytes,
            memory_bytes: slice * (u64::from(self.info.dims.nx()) + 1),
            on_demand: false,
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        if self.spool.is_some() {
            return Ok(());
        }
        let name = || self.info.description.name.clone().into();
        let _memory = workspace.reserve(self.preparation().memory_bytes, name)?;
        let spool = Spool::create(workspace.scratch, self.info.dims, self.info.scalar)?;
        workspace.progress.stage("unroll", spool.bytes());
        let [columns, rows, slices] = self.inner.info().dims.to_array();
        let bytes = self.info.scalar.bytes();
        let (width, height) = self.block();
        let (mut slice, mut turned) = (Vec::new(), Vec::new());
        for top in (0..rows).step_by(height as usize) {
            for left in (0..columns).step_by(width as usize) {
                let lines = top..(top + height).min(rows);
                let cols = left..(left + width).min(columns);
                let row = slices as usize * bytes;
                slice.resize(lines.len() * cols.len() * bytes, 0);
                turned.resize(lines.len() * cols.len() * row, 0);
                for z in 0..slices {
                    self.inner.read_rows(z, lines.clone(), cols.clone(), &mut slice)?;
                    for (i, sample) in slice.chunks_exact(bytes).enumerate() {
                        let (line, col) = (i / cols.len(), i % cols.len());
                        let at = (col * lines.len() + line) * row + z as usize * bytes;
                        if let Some(place) = turned.get_mut(at..at + bytes) {
                            place.copy_from_slice(sample);
                        }
                    }
                }
                for (z, part) in cols.zip(turned.chunks_exact(lines.len() * row)) {
                    spool.write(part, spool.offset(top, z))?;
                    workspace.progress.step(part.len() as u64)?;
                }
            }
        }
        self.spool = Some(spool);
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let failed = |cause| {
            SourceError::from(SourceFault::ReadFailed {
                path: self.info.description.name.clone().into(),
                slice: z,
                cause,
            })
        };
        check_request(&self.info, z, &rows, &cols, out.len()).map_err(failed)?;
        let spool = self.spool.as_ref().ok_or_else(|| failed(not_unrolled()))?;
        spool.read_rows(z, &rows, &cols, out).map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Budget;
    use crate::progress::Silent;
    use crate::source::{OpenOptions, npy};

    #[test]
    fn a_fortran_array_is_the_same_array_as_in_c_order() {
        let folder = tempfile::tempdir().unwrap();
        let memory = Budget::new(8 << 20);
        let workspace = Workspace { scratch: folder.path(), memory, progress: &Silent };
        for [nz, ny, nx] in [[5_usize, 4, 3], [1, 7, 2], [2, 1, 9], [40, 300, 100]] {
            let value =
                |z: usize, y: usize, x: usize| u16::try_from((z * 311 + y * 17 + x) % 65_521).unwrap();
            let mut files = Vec::new();
            for fortran in ["False", "True"] {
                let header =
                    format!("{{'descr': '<u2', 'fortran_order': {fortran}, 'shape': ({nz}, {ny}, {nx}), }}");
                let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
                bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
                bytes.extend(header.as_bytes());
                if fortran == "True" {
                    let all =
                        (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| (z, y, x))));
                    all.for_each(|(z, y, x)| bytes.extend(value(z, y, x).to_le_bytes()));
                } else {
                    let all =
                        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x))));
                    all.for_each(|(z, y, x)| bytes.extend(value(z, y, x).to_le_bytes()));
                }
                let path = folder.path().join(format!("{fortran}.npy"));
                std::fs::write(&path, bytes).unwrap();
                let mut source = npy::open(&path, &OpenOptions::default()).unwrap().remove(0);
                let most = (1 << 21) + 4096;
                assert!(source.preparation().memory_bytes <= most, "{}", source.preparation().memory_bytes);
                if fortran == "True" {
                    let little = Workspace { memory: Budget::new(16), ..workspace.clone() };
                    assert!(matches!(
                        source.prepare(&little).unwrap_err().fault(),
                        SourceFault::Memory { .. }
                    ));
                }
                source.prepare(&workspace).unwrap();
                files.push(source);
            }
            let [c, fortran] = files.as_slice() else { panic!("two files") };
            assert_eq!(c.info().dims.to_array().map(|n| n as usize), [nx, ny, nz]);
            assert_eq!(c.info().dims, fortran.info().dims);
            for z in 0..c.info().dims.nz() {
                let mut read = [vec![0; ny * nx * 2], vec![0; ny * nx * 2]];
                for (source, out) in files.iter().zip(&mut read) {
                    let (rows, cols) = (0..c.info().dims.ny(), 0..c.info().dims.nx());
                    source.read_rows(z, rows, cols, out).unwrap();
                }
                assert!(read[0] == read[1], "{nz} {ny} {nx}: slice {z}");
            }
        }
    }
}
