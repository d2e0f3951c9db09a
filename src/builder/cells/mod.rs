//! A volume with a threshold as a solid of cells: boxes between eight samples, with a plane in each (SPEC 4.8).
//!
//! ```text
//!   slice z+2  --read-->  ring of 6 slices  --classify-->  bits  --OR, AND of eight-->  cells
//!   cells of z            gradient over 4^3 samples, crossings of 12 edges --> plane, or corners
//! ```
//!
//! Most cells are fitted in batches without a branch ([`fit`]): the normal is the smooth gradient, the plane goes
//! through the mean of the crossings, and is moved outwards where an inside corner would lie in front of it. For cells
//! that such a plane does not describe, as at sharp edges and in noise, two more normals are tried ([`sharp_features`]). Cells
//! far longer than wide keep their corners where planes do not follow the surface ([`anisotropy`]). Thin walls, label
//! maps, and cells at the border of the volume are fitted one by one ([`single_fit`]).
//!
//! Solids that know the crossings of their surface with edges, such as meshes and trees, describe their cells by them
//! ([`edges`]).
//!
//! Finished cells of a brick may be joined into [`larger`] leaves.
//!
//! Every operation is an IEEE operation in a fixed order, and the last decisions are in integers: models are the same
//! on every machine.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

mod anisotropy;
mod corner;
mod edges;
mod field;
mod fit;
mod items;
mod jet;
pub(super) mod larger;
mod sharp_features;
mod single_fit;
mod window;

use std::sync::{Mutex, PoisonError};

use super::item::{ItemForm, least_code, size_of_eighth};
use super::lanes::RingSample;
use super::noise::{self, NoiseCounts, Sides};
use super::ring::SampleForm;
use super::slices::{Reach, RingShape, Slices};
use super::solid::{
    BRICK, EdgeCrossing, LOOKAHEAD, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};
use super::volume::VolumeSolid;
use crate::format::cell::CORNERS;
use crate::format::{Channel, Channels, Metadata, Noise, SurfaceKind};
use crate::geom::Dims;
use crate::volume::{Scalar, ScalarType, SourceError, VolumeInfo};

use anisotropy::Anisotropy;
use corner::{EDGES, signed_depth};
pub(crate) use edges::{CellEdge, CellEdges};
use field::{EDGE, Field};
use fit::{BATCH, Batch, Outcome};
use items::CellItems;
use single_fit::Cell;

/// Least part of a normal along its own edge.
const MIN_PART: f64 = 1e-3;
/// Name recorded in the metadata.
const ESTIMATOR: &str = "cell planes";

/// A cell's neighbourhood: cell i lies between samples i - 1 and i, and reads two more on either side.
pub(super) const AROUND_CELL: Reach = Reach { low: 3, high: 2 };
const _: () = assert!(AROUND_CELL.high == LOOKAHEAD);

/// Memory of a worker without its slices: a batch, and the items of one brick in one slice.
pub(super) fn worker_bytes(channels: Channels) -> u64 {
    let counts = if channels.contains(Channel::Steepness) { NoiseCounts::BYTES } else { 0 };
    (size_of::<Batch>() + CellItems::BYTES + counts) as u64
}

/// Size of a volume's grid of cells; `None` if it is too large.
pub(crate) fn cell_dims(volume: Dims) -> Option<Dims> {
    let grown = SurfaceKind::Cells.grown();
    Dims::new(volume.nx() + grown, volume.ny() + grown, volume.nz() + grown)
}

fn cell_form(channel: Channel) -> Option<ItemForm> {
    match channel {
        Channel::Normal => Some(ItemForm::AsIs { bytes: 2 }),
        Channel::Offset => Some(ItemForm::AsIs { bytes: 1 }),
        Channel::Corners => Some(ItemForm::AsIs { bytes: CORNERS }),
        _ => None,
    }
}

/// The form of a channel of the cells of a volume.
pub(super) fn volume_cell_form(channel: Channel, found: &ScanSummary) -> Option<ItemForm> {
    match channel {
        Channel::Steepness => Some(ItemForm::octaves(found.extent)),
        _ => cell_form(channel),
    }
}

/// The cells of a volume whose samples lie in a range.
pub(super) struct CellSolid<'a> {
    volume: VolumeSolid<'a>,
    dims: Dims,
    bound: f64,
    /// Noise counts of the finished workers.
    noise: Mutex<Option<NoiseCounts>>,
}

impl<'a> CellSolid<'a> {
    /// Cells of `volume`; `dims` come from [`cell_dims`], `bound` is the bound of larger leaves in voxels of the finest
    /// spacing, 0 without them.
    pub(super) fn new(volume: VolumeSolid<'a>, dims: Dims, bound: f64) -> Self {
        Self { volume, dims, bound, noise: Mutex::new(None) }
    }
}

impl Solid for CellSolid<'_> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn inner(&self) -> Option<&dyn Solid> {
        Some(&self.volume)
    }

    fn surface(&self) -> SurfaceKind {
        SurfaceKind::Cells
    }

    fn lookbehind(&self) -> u32 {
        AROUND_CELL.low
    }

    fn metadata(&self, found: &ScanSummary) -> Metadata {
        let noise = self.noise(found);
        Metadata { gradient: ESTIMATOR.into(), noise, ..self.volume.metadata(found) }
    }

    fn form(&self, channel: Channel, found: &ScanSummary) -> Option<ItemForm> {
        volume_cell_form(channel, found)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        RingShape::of(self.volume.source.info(), &self.volume.form, AROUND_CELL).bytes(tile)
            + worker_bytes(tile.channels)
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        let VolumeSolid { source, range, form, .. } = &self.volume;
        let is_uncertain = tile.channels.contains(Channel::Steepness);
        by_ring!(form.scalar, R => Box::new(CellWorker {
            slices: Slices::<R>::new(*source, &**range, AROUND_CELL, tile),
            level: form.level(self.volume.bound()),
            is_label: form.is_label(),
            stretch: Anisotropy::new(source.info().spacing_mm, self.bound),
            batch: Batch::new(),
            items: CellItems::new(),
            spacing_mm: source.info().spacing_mm.map(|mm| mm as f32),
            noise: is_uncertain.then(|| Counting { counts: NoiseCounts::new(), all: &self.noise }),
            extent: ScanSummary::default().extent,
        }))
    }
}

/// One thread's ring of slices, and the cells described last.
struct CellWorker<'a, R> {
    slices: Slices<'a, R>,
    /// Value of ring samples at the surface.
    level: f32,
    /// True if a single value is inside, as in a map of labels.
    is_label: bool,
    stretch: Anisotropy,
    batch: Box<Batch>,
    items: CellItems,
    spacing_mm: [f32; 3],
    /// Noise counts; `None` unless the uncertainty is requested.
    noise: Option<Counting<'a>>,
    /// Least code of steepness; the other one is not used.
    extent: (f32, f32),
}

/// Noise counts of a worker, added to the total when it is done.
struct Counting<'a> {
    counts: NoiseCounts,
    all: &'a Mutex<Option<NoiseCounts>>,
}

impl Drop for Counting<'_> {
    fn drop(&mut self) {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        match all.as_mut() {
            Some(all) => all.join(&self.counts),
            None => *all = Some(self.counts.clone()),
        }
    }
}

impl CellSolid<'_> {
    /// Noise of the volume; `None` unless it was requested.
    fn noise(&self, found: &ScanSummary) -> Option<Noise> {
        let VolumeInfo { scalar, rescale, .. } = self.volume.source.info();
        let step = if matches!(scalar, ScalarType::F32 | ScalarType::F64) { 0.0 } else { 1.0 };
        let counted = self.noise.lock().unwrap_or_else(PoisonError::into_inner);
        let Noise { inside, outside, correlation, .. } = counted.as_ref()?.noise(step).unwrap_or_default();
        let known = |v: f64| Some(v * rescale.slope.abs()).filter(|v| v.is_finite()).unwrap_or(0.0);
        let steepness = Some(least_code(found.extent)).filter(|code| *code > 0).map_or(0.0, size_of_eighth);
        let [inside, outside, steepness] = [inside, outside, steepness].map(known);
        Some(Noise { inside, outside, correlation, steepness })
    }
}

impl<R: RingSample + Scalar> CellWorker<'_, R> {
    /// Like [`CellWorker::field_of`], for a cell with these inside corners.
    fn field(&self, cell: [u32; 3], mask: u8) -> Field {
        let mut field = self.field_of(cell);
        field.set_corners(mask);
        field
    }

    /// Depths of the samples around a cell; beyond the volume a sample is as deep outside as the nearest one is inside.
    fn field_of(&self, cell: [u32; 3]) -> Field {
        let (f, form, dims) = (&self.slices.frame, self.slices.form, self.slices.dims);
        // Samples to read along an axis, and true for those that exist.
        let along = |a: usize, start: u32| -> [(usize, bool); EDGE] {
            std::array::from_fn(|i| {
                let place = i64::from(cell[a]) + i as i64 - i64::from(AROUND_CELL.low);
                let read = place.clamp(0, i64::from(dims[a]) - 1);
                ((read - i64::from(start)) as usize, place == read)
            })
        };
        let (xs, ys, zs) = (along(0, f.cols.start), along(1, f.rows.start), along(2, 0));
        let mut field = Field::EMPTY;
        for (k, (z, is_slice)) in zs.into_iter().enumerate() {
            let plane = self.slices.plane(z as u32);
            for (j, (y, is_row)) in ys.into_iter().enumerate() {
                let row = &plane[y * f.stride..];
                for (i, (x, is_sample)) in xs.into_iter().enumerate() {
                    let depth = SampleForm::depth_from(row[x], self.level);
                    if is_slice & is_row & is_sample {
                        field.set([i, j, k], depth, form.is_inside(row[x]));
                    } else {
                        field.set_beyond([i, j, k], -depth.abs() - form.unit);
                    }
                }
            }
        }
        field.mend();
        field
    }

    /// Counts noise at samples away from the surface, around the third slice before `z`, which was loaded last.
    fn count_noise(&mut self, z: u32) {
        let Some(Counting { counts, .. }) = &mut self.noise else { return };
        let slices = &self.slices;
        let (f, dims) = (&slices.frame, slices.dims);
        let Some(middle) = z.checked_sub(noise::AROUND).filter(|middle| f.column.z.contains(middle)) else {
            return;
        };
        let step = noise::steps(dims);
        if middle % step[2] != step[2] / 2 || middle < 3 || z >= dims[2] {
            return;
        }
        for y in f.column.y.clone().step_by(BRICK as usize) {
            for x in f.column.x.clone().step_by(BRICK as usize) {
                count_in_brick(slices, [x, y, middle], counts);
            }
        }
    }

    /// Fits the cells of the batch and appends their items.
    fn flush(&mut self) {
        self.batch.fit(self.is_label, &self.stretch);
        if self.noise.is_some() {
            self.batch.find_steepness(self.spacing_mm);
        }
        for at in 0..self.batch.len() {
            let outcome = self.batch.outcome(at);
            if outcome == Outcome::Plane {
                let (code, offset) = self.batch.plane(at);
                self.items.push_plane(code, offset);
                continue;
            }
            if outcome == Outcome::OneByOne {
                self.batch.steepness()[at] = 0;
            }
            let (place, mask) = (self.batch.cell(at), self.batch.mask(at));
            let (is_label, stretch) = (self.is_label, self.stretch);
            let cell = match self.batch.inner(at) {
                Some((depth, gradient, near)) => Cell { mask, depth, gradient, near, is_label, stretch },
                None => {
                    let field = self.field(place, mask);
                    let depth = field.corners();
                    let jet = field.jet();
                    let gradient = jet.at(single_fit::mean_crossing(mask, &depth));
                    Cell { mask, depth, gradient, near: jet.near_crossings(gradient), is_label, stretch }
                }
            };
            self.items.push(if outcome == Outcome::Corners {
                single_fit::with_corners(&cell)
            } else {
                single_fit::pick(&cell, || self.field(place, mask))
            });
        }
        if self.noise.is_some() {
            let codes = self.batch.steepness();
            // The least code but 0, which becomes the greatest number.
            let least = codes.iter().fold(u16::MAX, |least, code| least.min(code.wrapping_sub(1)));
            if least < u16::MAX {
                self.extent.0 = self.extent.0.min(f32::from(least + 1));
            }
            self.items.extend_steepness(codes);
        }
        self.batch.clear();
    }
}

/// Counts noise in a brick of a slice; its first sample is given.
fn count_in_brick<R: RingSample + Scalar>(
    slices: &Slices<'_, R>,
    [x, y, z]: [u32; 3],
    counts: &mut NoiseCounts,
) {
    let (f, dims) = (&slices.frame, slices.dims);
    let step = noise::steps(dims);
    let [xs, ys] = [(x, 0), (y, 1)].map(|(origin, a)| noise::needed(origin, step[a], dims[a]));
    if xs.is_empty() || ys.is_empty() {
        return;
    }
    let row = |y: u32, z: u32| {
        let first = (y - f.rows.start) as usize * f.stride + (xs.start - f.cols.start) as usize;
        &slices.plane(z)[first..][..xs.len()]
    };
    let (mut sides, zero) = (Sides::new(), slices.form.zero_single());
    for (at, y) in ys.clone().enumerate() {
        sides.set_row(at, [0, 1, 2, 3, 4, 5].map(|k| row(y, z + k - 3)), zero);
    }
    for axis in 0..3 {
        for y in noise::places(y, step[1], dims[1], axis == 1) {
            let even = sides.even((y - ys.start) as usize, axis);
            for x in noise::places(x, step[0], dims[0], axis == 0) {
                let at = (x - xs.start) as usize;
                let Some(inside) = even(at) else { continue };
                let depth = |along: u32| {
                    let sample = match axis {
                        0 => row(y, z)[at + along as usize],
                        1 => row(y + along, z)[at],
                        // The pair lies on either side of the ring's middle.
                        _ => row(y, z - 2 + along)[at],
                    };
                    SampleForm::depth_from(sample, 0.0)
                };
                let [first, next, second] = [0, 1, noise::APART[axis]].map(depth);
                counts.add(inside, axis, false, next - first);
                counts.add(inside, axis, true, second - first);
            }
        }
    }
}

impl<R: RingSample + Scalar> SolidWorker for CellWorker<'_, R> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.slices.start(column);
        Ok(())
    }

    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        self.slices.load(wanted)?;
        self.count_noise(wanted.z());
        Ok(())
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.items.clear();
        let [x0, y0, z] = skin.corner();
        let dims = self.slices.dims;
        // Cells whose 4^3 samples are all in the volume.
        let interior = |p: u32, n: u32| p >= 2 && p + 2 <= n;
        let columns = (0..BRICK).filter(|i| interior(x0 + i, dims[0])).fold(0_u32, |m, i| m | 1 << i);
        for (j, row) in (0..).zip(skin.rows()) {
            if *row == 0 {
                continue;
            }
            let y = y0 + j;
            let samples = skin.corner_samples(j as usize);
            let inner = if interior(y, dims[1]) && interior(z, dims[2]) { row & columns } else { 0 };
            if self.batch.len() + row.count_ones() as usize > BATCH {
                self.flush();
            }
            let first = self.batch.push_row([x0, y, z], *row, samples, inner);
            if inner != 0 {
                let f = &self.slices.frame;
                // The sample two before the first cell's own, along x and y.
                let start = (y - f.rows.start) as usize * f.stride + x0 as usize;
                let window = window::RowWindow {
                    planes: std::array::from_fn(|k| self.slices.plane(z + k as u32 - 2)),
                    stride: f.stride,
                    origin: start.wrapping_sub(f.cols.start as usize),
                    cells: *row,
                    inner,
                    level: self.level,
                };
                window::gather(&window, &mut self.batch, first);
            }
        }
        self.flush();
        Ok(())
    }

    /// Offers crossings by linear interpolation along edges, midway in a mask; their normals are the smooth gradient
    /// there, turned to the side that the crossing faces.
    fn crossings(
        &mut self,
        skin: &SkinSlice<'_>,
        found: &mut dyn FnMut(&EdgeCrossing),
    ) -> Result<(), SourceError> {
        for cell in skin.voxels() {
            let field = self.field_of(cell);
            let depth = field.corners();
            let is_mask = self.is_label || field.has_two_values();
            let jet = field.jet();
            for (p, q) in EDGES {
                let (inside, beyond) = (field.is_corner_inside(p), field.is_corner_inside(q));
                if inside == beyond {
                    continue;
                }
                let (d, e) = (signed_depth(depth[p], inside), signed_depth(depth[q], beyond));
                let along = if is_mask { 0.5 } else { f64::from(d) / (f64::from(d) - f64::from(e)) };
                let axis = (p ^ q).trailing_zeros() as usize;
                let corner = |c: usize, k: usize| (c >> k & 1) as f32 - 0.5;
                let at = [0, 1, 2].map(|k| corner(p, k) + if k == axis { along as f32 } else { 0.0 });
                let mut normal = jet.at(at).map(|c| -f64::from(c));
                let sign = if inside { 1.0 } else { -1.0 };
                let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
                if !length.is_normal() {
                    normal = [0.0; 3];
                }
                if normal[axis] * sign <= 0.0 {
                    normal[axis] = sign * if length.is_normal() { MIN_PART * length } else { 1.0 };
                }
                let low = [0, 1, 2].map(|k| cell[k] as i32 - 1 + (p >> k & 1) as i32);
                found(&EdgeCrossing { low, axis, along, normal });
            }
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        self.items.of(channel)
    }

    fn found(&self) -> ScanSummary {
        ScanSummary {
            extent: self.extent,
            reading: self.slices.reading,
            not_numbers: self.slices.odd.not_numbers,
            infinite: self.slices.odd.infinite,
        }
    }
}
