//! Layers of a `.seg.nrrd`, whose segments may overlap, as one map of labels.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::segments::Layered;

use crate::fault::bad;
use crate::geom::Dims;
use crate::volume::{
    Overlap, Preparation, Result, ScalarType, SourceError, StatedLabel, VolumeInfo, VolumeSource, Workspace,
    settle_overlaps,
};

/// Order in which the samples of a voxel's layers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// The samples of all layers follow each other at each voxel.
    Together,
    /// Each layer is a volume, one after the other.
    Apart,
}

impl Order {
    /// The axis along which they follow each other.
    pub(super) fn axis(self) -> usize {
        if self == Self::Together { 0 } else { 2 }
    }
}

/// The layers of one file, and how they are joined.
#[derive(Clone, Debug)]
pub(super) struct Layers {
    pub(super) count: u64,
    pub(super) order: Order,
    pub(super) labels: Vec<StatedLabel>,
    /// Segments, by layer and value.
    pub(super) segments: Vec<Layered>,
    pub(super) overlap: Overlap,
}

/// A map of labels made of layers.
///
/// Memory: a row of all layers for each thread. Cost: the layers are read once more than the map, to count overlaps.
pub(super) struct LayeredMap {
    source: Box<dyn VolumeSource>,
    info: VolumeInfo,
    layers: Layers,
    is_counted: bool,
}

impl LayeredMap {
    /// The map of the layers in `source`, which has all of them along x or z; `dims` is the size of one layer.
    pub(super) fn new(source: Box<dyn VolumeSource>, dims: Dims, layers: Layers) -> Self {
        let mut info = VolumeInfo { dims, scalar: ScalarType::U16, ..source.info().clone() };
        info.description.labels.clone_from(&layers.labels);
        Self { source, info, layers, is_counted: false }
    }

    fn row_bytes(&self) -> u64 {
        u64::from(self.info.dims.nx()) * self.layers.count * self.source.info().scalar.bytes() as u64
    }

    /// Calls `found` with each column of a row that is in a segment, and the number of its label.
    fn for_each_in(
        &self,
        [z, y]: [u32; 2],
        cols: &Range<u32>,
        staged: &mut Vec<u8>,
        mut found: impl FnMut(usize, u16),
    ) -> Result {
        let (dims, scalar) = (self.info.dims, self.source.info().scalar);
        let count = u32::try_from(self.layers.count).unwrap_or(u32::MAX);
        let (parts, along) = match self.layers.order {
            Order::Together => (1, count),
            Order::Apart => (count, 1),
        };
        staged.resize(cols.len() * along as usize * scalar.bytes(), 0);
        let mut known = ((0, 0.0), 0);
        for part in 0..parts {
            let all = cols.start * along..cols.end * along;
            self.source.read_rows(z + part * dims.nz(), y..y + 1, all, staged)?;
            for (at, samples) in staged.chunks_exact(along as usize * scalar.bytes()).enumerate() {
                if samples.iter().all(|byte| *byte == 0) {
                    continue;
                }
                for (layer, sample) in (part..).zip(samples.chunks_exact(scalar.bytes())) {
                    let value = scalar.value(sample);
                    if value == 0.0 {
                        continue;
                    }
                    if known.0 != (layer, value) {
                        known = ((layer, value), self.number(layer.into(), value)?);
                    }
                    found(at, known.1);
                }
            }
        }
        Ok(())
    }

    /// The label of a value in a layer.
    fn number(&self, layer: u64, value: f64) -> Result<u16> {
        let is_it = |segment: &&Layered| segment.0 == layer && f64::from(segment.1) == value;
        self.layers.segments.iter().find(is_it).map(|segment| segment.2).ok_or_else(|| {
            let fault = bad!("layer {layer} of the segmentation holds the value {value}, which no segment of its header has");
            SourceError::from(fault.at(self.path()))
        })
    }

    fn path(&self) -> PathBuf {
        PathBuf::from(&self.info.description.name)
    }
}

impl VolumeSource for LayeredMap {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.source.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result {
        self.source.check_unchanged()
    }

    fn preparation(&self) -> Preparation {
        let own = if self.is_counted { 0 } else { self.row_bytes() + u64::from(self.info.dims.nx()) };
        let inner = self.source.preparation();
        Preparation { memory_bytes: inner.memory_bytes + own, ..inner }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        if self.is_counted {
            return Ok(());
        }
        self.source.prepare(workspace)?;
        let [nx, ny, nz] = self.info.dims.to_array();
        let _memory = workspace.reserve(self.preparation().memory_bytes, || self.path())?;
        let (mut staged, mut held, mut voxels) = (Vec::new(), vec![0_u8; nx as usize], 0);
        workspace.progress.stage("layers", nz.into());
        for z in 0..nz {
            for y in 0..ny {
                held.fill(0);
                let count = |at: usize, _| held[at] = held[at].saturating_add(1);
                self.for_each_in([z, y], &(0..nx), &mut staged, count)?;
                voxels += held.iter().filter(|count| **count > 1).count() as u64;
            }
            workspace.progress.step(1)?;
        }
        self.is_counted = true;
        settle_overlaps(&mut self.info, voxels, self.layers.overlap)
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        out.fill(0);
        let mut staged = Vec::new();
        let first = self.layers.overlap == Overlap::First;
        for (y, row) in rows.zip(out.chunks_exact_mut((2 * cols.len()).max(1))) {
            let labels = row.as_chunks_mut::<2>().0;
            self.for_each_in([z, y], &cols, &mut staged, |at, number| {
                let held: u16 = bytemuck::pod_read_unaligned(&labels[at]);
                // The numbers decide, not the order of layers.
                if held == 0 || (number < held) == first {
                    labels[at].copy_from_slice(bytemuck::bytes_of(&number));
                }
            })?;
        }
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        self.row_bytes() + self.source.resident_bytes()
    }
}
