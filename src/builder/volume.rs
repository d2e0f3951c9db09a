//! A volume with a threshold as a solid: a ring of slices, the range test, normals by the gradient.
//!
//! ```text
//!   slice z+2  --read-->  ring of 5 slices  --classify-->  bits
//!   slice z               gradient on z-2 ..= z+2 at skin voxels, values of z
//! ```
//!
//! A column reads 2 rows and 2 columns beyond its tile on every side. [`RingShape::bytes`] states the memory, for any
//! volume.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

use std::path::Path;

use super::choose::{Chooser, Chosen};
use super::error::{BuildError, Criterion};
use super::estimator::Gradient;
use super::gradient::{Codes, Gradients, NormalRule, REACH, SLICE_VOXELS, SliceWindow, gradient_of_depths};
use super::item::{ItemForm, value_bytes, value_form, value_scale};
use super::lanes::RingSample;
use super::options::BuildOptions;
use super::report::BuildNote;
use super::ring::{FileRange, SampleForm};
use super::skin::Exposed;
use super::slices::{Reach, RingShape, Slices};
use super::solid::{
    BRICK, LOOKAHEAD, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox,
};
use crate::format::{Channel, Metadata, Selection, SourceMeta};
use crate::geom::Dims;
use crate::volume::{Scalar, ScalarType, SourceError, VolumeInfo, VolumeSource};

const BRICK_ROWS: usize = BRICK as usize;
const RING: usize = 2 * REACH as usize + 1;
const _: () = assert!(REACH == LOOKAHEAD, "the ring holds what was asked for since slice z - 2");
/// A skin voxel's neighbourhood.
pub(super) const AROUND: Reach = Reach { low: REACH, high: REACH };

/// The form of a channel's items; `None` for channels that a volume lacks.
pub(super) fn volume_form(scalar: ScalarType, channel: Channel, found: &ScanSummary) -> Option<ItemForm> {
    match channel {
        Channel::Normal => Some(ItemForm::AsIs { bytes: 2 }),
        Channel::Value => Some(value_form(scalar, found.extent)),
        _ => None,
    }
}

/// The voxels of a volume whose samples lie in a range.
pub(super) struct VolumeSolid<'a> {
    pub(super) source: &'a dyn VolumeSource,
    /// The range, and the form of its samples in the ring.
    pub(super) range: Box<dyn FileRange>,
    pub(super) form: SampleForm,
    pub(super) selection: Selection,
    pub(super) gradient: Gradient,
    pub(super) rule: NormalRule,
    /// Reports the existing values if none lies in the range.
    pub(super) chooser: Chooser<'a>,
    /// Oddity of the choice.
    pub(super) note: Option<BuildNote>,
}

impl<'a> VolumeSolid<'a> {
    /// The solid of a chosen selection.
    pub(super) fn new(chosen: Chosen, options: &BuildOptions, chooser: Chooser<'a>) -> Self {
        let source = chooser.source;
        let Chosen { selection, range, note } = chosen;
        let (form, gradient) = (range.form(), options.gradient());
        let rule = NormalRule::new(source.info().spacing_mm, gradient);
        Self { source, range, form, selection, gradient, rule, chooser, note }
    }

    /// Lower bound of the range in samples of the file; `None` for a range with two ends.
    pub(super) fn bound(&self) -> Option<f64> {
        let rescale = self.source.info().rescale;
        let bound = (self.selection.lo - rescale.intercept) / rescale.slope;
        (self.selection.hi == f64::INFINITY && bound.is_finite()).then_some(bound)
    }
}

/// Metadata of a model of a volume, without a channel of values.
pub(super) fn metadata_of(info: &VolumeInfo, selection: Selection, gradient: String) -> Metadata {
    let VolumeInfo { dims, scalar, rescale, spacing_mm, affine, description, .. } = info;
    let (format, kind) = (description.format.clone(), description.to_string());
    Metadata {
        source: SourceMeta { format, kind, files: description.files, bytes: description.bytes },
        scalar: scalar.code(),
        spacing_mm: *spacing_mm,
        affine: affine.rows,
        rescale: [rescale.slope, rescale.intercept],
        selection,
        gradient,
        ..Metadata::of_grid(*dims, "")
    }
}

impl Solid for VolumeSolid<'_> {
    fn dims(&self) -> Dims {
        self.source.info().dims
    }

    fn metadata(&self, found: &ScanSummary) -> Metadata {
        let info = self.source.info();
        let value_scale = value_scale(info.scalar, found.extent, info.rescale);
        Metadata { value_scale, ..metadata_of(info, self.selection, self.gradient.name().into()) }
    }

    fn name(&self) -> String {
        self.source.info().description.name.clone()
    }

    fn form(&self, channel: Channel, found: &ScanSummary) -> Option<ItemForm> {
        volume_form(self.source.info().scalar, channel, found)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        RingShape::of(self.source.info(), &self.form, AROUND).bytes(tile)
            + NormalRule::more_bytes(self.gradient)
    }

    fn input_bytes(&self) -> u64 {
        self.source.resident_bytes()
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        by_ring!(self.form.scalar, R => Box::new(VolumeWorker::<R>::new(self, tile)))
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.source.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.source.check_unchanged()
    }

    fn note(&self) -> Option<BuildNote> {
        self.note
    }

    fn nothing_inside(&self) -> BuildError {
        self.chooser.empty(Criterion::Within(self.selection))
    }
}

/// One thread's ring of slices, with its results at the skin.
struct VolumeWorker<'a, R> {
    slices: Slices<'a, R>,
    rule: &'a NormalRule,
    normals: bool,
    values: bool,
    gradients: Box<Gradients>,
    codes: Box<Codes>,
    /// Number of voxels described last.
    count: usize,
    swapped_values: Vec<u8>,
    extent: (f32, f32),
}

impl<'a, R: RingSample + Scalar> VolumeWorker<'a, R> {
    fn new(solid: &'a VolumeSolid<'_>, tile: &Tile) -> Self {
        let values = tile.channels.contains(Channel::Value);
        let value_bytes = value_bytes(solid.source.info().scalar);
        Self {
            slices: Slices::new(solid.source, &*solid.range, AROUND, tile),
            rule: &solid.rule,
            normals: tile.channels.contains(Channel::Normal),
            values,
            gradients: Gradients::new(&solid.rule),
            codes: Codes::new(),
            count: 0,
            swapped_values: Vec::with_capacity(if values { SLICE_VOXELS * value_bytes } else { 0 }),
            extent: ScanSummary::default().extent,
        }
    }

    /// Fills `codes` with the normals of skin voxels.
    fn find_normals(&mut self, skin: &SkinSlice<'_>) {
        let f = &self.slices.frame;
        let [x0, _, z] = skin.corner();
        let interior = self.interior(z, x0, skin.rows());
        let row0 = (f.column.y.start - f.rows.start) as usize;
        let planes: [&[R]; RING] =
            std::array::from_fn(|k| self.slices.plane(z + k as u32 + RING as u32 - REACH));
        let origin = row0 * f.stride + (x0 - f.cols.start) as usize;
        let window = SliceWindow { planes, stride: f.stride, origin, skin: skin.rows(), interior: &interior };
        let estimate = self.rule.estimate(&window, &mut self.gradients);
        let faces: [Exposed; BRICK_ROWS] = std::array::from_fn(|y| skin.exposed(y));
        let (dims, form) = (self.slices.dims, self.slices.form);
        let unit = form.unit;
        NormalRule::codes(&estimate, &window, &faces, &mut self.gradients, &mut self.codes, |y, x| {
            let (cx, cy) = (i64::from(x0 + x), i64::from(f.column.y.start) + y as i64);
            let depths = std::array::from_fn(|k| {
                std::array::from_fn(|j| {
                    std::array::from_fn(|i| {
                        let (px, py) = (cx + i as i64 - 2, cy + j as i64 - 2);
                        let pz = i64::from(z) + k as i64 - 2;
                        let (qx, qy) =
                            (px.clamp(0, i64::from(dims[0]) - 1), py.clamp(0, i64::from(dims[1]) - 1));
                        let qz = pz.clamp(0, i64::from(dims[2]) - 1);
                        let at = (qy as usize - f.rows.start as usize) * f.stride
                            + (qx as usize - f.cols.start as usize);
                        let depth = form.depth(window.planes[(qz - i64::from(z) + 2) as usize][at]);
                        // Beyond the border a sample is as deep outside as the nearest one in the volume is inside.
                        if (px, py, pz) == (qx, qy, qz) { depth } else { -depth.abs() - unit }
                    })
                })
            });
            gradient_of_depths(&estimate, &depths)
        });
    }

    /// Mask of the skin voxels whose 5x5x5 neighbourhood lies in the volume.
    fn interior(&self, z: u32, x0: u32, skin: &[u32; BRICK_ROWS]) -> [u32; BRICK_ROWS] {
        let inside = |p: u32, n: u32| p >= REACH && p + REACH < n;
        if !inside(z, self.slices.dims[2]) {
            return [0; BRICK_ROWS];
        }
        let mut columns = u32::MAX;
        if x0 < REACH || x0 + BRICK + REACH > self.slices.dims[0] {
            columns = (0..BRICK).filter(|x| inside(x0 + x, self.slices.dims[0])).fold(0, |m, x| m | 1 << x);
        }
        std::array::from_fn(|y| {
            let here = self.slices.frame.column.y.start + y as u32;
            if inside(here, self.slices.dims[1]) { skin[y] & columns } else { 0 }
        })
    }

    /// Fills `swapped_values` with the values of skin voxels.
    fn gather_values(&mut self, skin: &SkinSlice<'_>) {
        let [x0, _, z] = skin.corner();
        // Taken out while the samples are borrowed.
        let (mut values, mut extent) = (std::mem::take(&mut self.swapped_values), self.extent);
        values.clear();
        let f = &self.slices.frame;
        let first = [x0 - f.cols.start, f.column.y.start - f.rows.start].map(|c| c as usize);
        self.slices.push_values(z, first, skin.rows(), &mut values, &mut extent);
        (self.swapped_values, self.extent) = (values, extent);
    }
}

impl<R: RingSample + Scalar> SolidWorker for VolumeWorker<'_, R> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.slices.start(column);
        Ok(())
    }

    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        self.slices.load(wanted)
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        self.count = skin.len();
        if self.normals {
            self.find_normals(skin);
        }
        if self.values {
            self.gather_values(skin);
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Normal => self.codes.codes(self.count),
            Channel::Value => &self.swapped_values,
            _ => &[],
        }
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
