//! The report of `oct info`, and the figures of a model that it shares with a build.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{
    Info, Measured, channel_bytes, content_checksum, dtype, paper_bytes, ratio, structure_bytes, to_f64,
};
use crate::format::{
    Encoding, ErrorBound, Noise, Quantity, Selection, SelectionKind, SourceMeta, SurfaceKind, VERSION_MAJOR,
};
use crate::geom::Affine;
use crate::interior::Enclosed;
use crate::load::Frame;

/// Figures that the reports of a model and of its build share.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ModelFigures {
    /// Size of the volume in voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance of neighbouring voxels along x, y, z, in mm.
    pub spacing_mm: [f64; 3],
    /// Cells along a side of the octree's cube: a power of two.
    pub grid: u64,
    /// Levels of the octree.
    pub levels: u32,
    /// Type of the source's samples: u8, i8, u16, i16, u32, i32, f32 or f64.
    pub dtype: &'static str,
    /// Values that count as inside, in physical units (HU for CT).
    pub range: RangeFigures,
    /// Boxes of the finest level: skin voxels, or cells between samples.
    pub surface: SurfaceKind,
    /// Skin voxels of the model.
    pub skin_voxels: u64,
    /// Larger leaves and their distances from the cells that they replace; only of models built with `--error`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub larger_leaves: Option<LeafFigures>,
    /// Nodes of the octree, one infobyte each.
    pub nodes: u64,
    /// Size of the file that was written or read.
    pub bytes: u64,
    /// `bytes` per skin voxel.
    pub bytes_per_skin_voxel: f64,
    /// Bytes of levels, infobytes and rank directory.
    pub structure_bytes: u64,
    /// Bytes of each section of attributes: `normal`, `normal_lod`, `value`, `value_lod`, ...
    pub channel_bytes: BTreeMap<&'static str, u64>,
}

/// Larger leaves of a model, and their distances from the cells, in voxels of the finest spacing.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LeafFigures {
    /// Number of larger leaves.
    pub leaves: u64,
    /// The bound and the measured distances.
    #[serde(flatten)]
    pub distances: ErrorBound,
}

/// Values that count as inside.
#[derive(Clone, Copy, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RangeFigures {
    /// How the range was chosen.
    pub kind: SelectionKind,
    /// Lowest value; null if there is no limit.
    pub lo: Option<f64>,
    /// Highest value; null if there is no limit.
    pub hi: Option<f64>,
}

impl From<&Selection> for RangeFigures {
    fn from(selection: &Selection) -> Self {
        let finite = |v: f64| v.is_finite().then_some(v);
        Self { kind: selection.kind, lo: finite(selection.lo), hi: finite(selection.hi) }
    }
}

impl From<&Frame> for ModelFigures {
    fn from(frame: &Frame) -> Self {
        let (m, header) = (&frame.metadata, &frame.header);
        Self {
            dims: m.dims,
            spacing_mm: m.spacing_mm,
            grid: 1 << frame.dims().depth(),
            levels: frame.dims().depth(),
            dtype: dtype(frame),
            range: (&m.selection).into(),
            surface: frame.surface(),
            skin_voxels: header.voxels,
            larger_leaves: m.error.map(|distances| LeafFigures { leaves: super::leaves(frame), distances }),
            nodes: header.nodes,
            bytes: header.file_bytes,
            bytes_per_skin_voxel: ratio(header.file_bytes, super::surface_boxes(frame)),
            structure_bytes: structure_bytes(frame),
            channel_bytes: channel_bytes(frame).into_iter().collect(),
        }
    }
}

/// Facts of a model file.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct InfoReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Figures that a build reports as well.
    #[serde(flatten)]
    pub model: ModelFigures,
    /// Version of the file format.
    pub format_version: String,
    /// How the file is encoded.
    pub encoding: Encoding,
    /// Eight hex digits; the same for the mapped and the packed file of one model.
    pub checksum: String,
    /// Name and version of the program that wrote it.
    pub program: String,
    /// Origin of the model.
    pub source: SourceMeta,
    /// Voxel index to LPS mm: three rows of four.
    pub affine: [[f64; 4]; 3],
    /// Patient directions of the axes, such as LPS.
    pub orientation: String,
    /// Slope and intercept from stored to physical values.
    pub rescale: [f64; 2],
    /// Connectivity of the skin: 26 (thin) or 6 (thick).
    pub connectivity: u8,
    /// Attributes stored for each skin voxel.
    pub channels: Vec<&'static str>,
    /// Estimator of the normals.
    pub gradient: String,
    /// Noise of the volume; only of models built with `--uncertainty`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Nodes of each level, the root first.
    pub level_nodes: Vec<u64>,
    /// Size of the source's samples, the same as `source.bytes`.
    pub raw_bytes: u64,
    /// `raw_bytes` / `bytes`.
    pub ratio_to_raw: f64,
    /// Bytes of the paper's uniform volume, 6.125 per voxel.
    pub paper_bytes: f64,
    /// `paper_bytes` / `bytes`.
    pub ratio_to_paper: f64,
    /// The same ratio for a volume that fills the grid.
    pub ratio_to_paper_grid: f64,
    /// The labels, by number; empty for a model without them.
    pub labels: Vec<LabelFigures>,
    /// The measured quantity that values are; null for a model without one.
    pub quantity: Option<Quantity>,
    /// Measures of its skin.
    #[serde(flatten)]
    pub measured: MeasuredFigures,
}

/// One label of a model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct LabelFigures {
    /// Its number in the volume.
    pub number: u16,
    /// Its name; empty if it has none.
    pub name: String,
    /// Its colour (sRGB), as #rrggbb.
    pub color: String,
    /// Voxels of the volume with this label, those inside included.
    pub voxels: u64,
    /// Volume of these voxels in mm3.
    pub volume_mm3: f64,
    /// Error of `volume_mm3`, `area_mm2` times a quarter of a voxel: in 19 of 20 cases the true volume, and the volume of
    /// an exported mesh, lie within it; null where the area is.
    pub volume_error_mm3: Option<f64>,
    /// Area of its surface, walls to other labels and of cavities included; null unless it was measured, and
    /// where voxels are more than 100 times as long along one axis as along another.
    pub area_mm2: Option<f64>,
    /// The true area lies within it in 19 of 20 cases, where noise is at most 2 % of the step at the surface.
    pub area_error_mm2: Option<f64>,
}

/// Reason for missing measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum NotMeasured {
    /// It is packed, and has to be unpacked first.
    Packed,
    /// It takes long.
    Large,
    /// It has labels, whose measures are in `labels`.
    Labels,
    /// It has no volume, or is damaged.
    Impossible,
}

/// Measures of the skin; null where unknown.
#[derive(Clone, Copy, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MeasuredFigures {
    /// Reason for null in the keys below; `--measure` measures packed and large models; null if measured.
    pub not_measured: Option<NotMeasured>,
    /// First voxel of the skin along x, y, z, and the one after the last.
    pub bounding_box_voxels: Option<[[u32; 3]; 2]>,
    /// Lowest and highest coordinates (LPS) of the surface, in mm: of the skin's voxels, of the part of cells that is inside
    /// or has a label; at most 1/2048 of the grid too wide, never too tight.
    pub bounding_box_mm: Option<[[f64; 3]; 2]>,
    /// Area of the skin, walls of cavities included; a sheet one voxel thick counts once; null without normals,
    /// and where voxels are more than 100 times as long along one axis as along another.
    pub surface_area_mm2: Option<f64>,
    /// The true area lies within it in 19 of 20 cases, where noise is at most 2 % of the step at the surface.
    pub surface_area_error_mm2: Option<f64>,
    /// Volume of the skin's voxels and of the inside; null where the inside is not known.
    pub volume_mm3: Option<f64>,
    /// The true volume lies within it in 19 of 20 cases; half of the voxels that may be inside or outside are part of it.
    pub volume_error_mm3: Option<f64>,
    /// Voxels enclosed by the skin.
    pub enclosed_voxels: Option<Enclosed>,
}

impl From<&Measured> for MeasuredFigures {
    fn from(measured: &Measured) -> Self {
        let not = |why| Self { not_measured: Some(why), ..Self::default() };
        let m = match measured {
            Measured::Done(measures) => measures,
            Measured::Not(why) => return not(*why),
            Measured::Labels(found) => {
                return Self {
                    bounding_box_voxels: Some(found.voxels),
                    bounding_box_mm: Some(found.box_mm),
                    ..not(NotMeasured::Labels)
                };
            }
        };
        let (area, volume) = (m.area_mm2.unzip(), m.volume_mm3.unzip());
        Self {
            not_measured: None,
            bounding_box_voxels: Some(m.voxels),
            bounding_box_mm: Some(m.box_mm),
            surface_area_mm2: area.0,
            surface_area_error_mm2: area.1,
            volume_mm3: volume.0,
            volume_error_mm3: volume.1,
            enclosed_voxels: Some(m.enclosed),
        }
    }
}

impl Info {
    /// The report for `--json`; the keys of measures are null without them.
    pub fn json(&self) -> InfoReport {
        let frame = &self.frame;
        let m = &frame.metadata;
        let bytes = frame.header.file_bytes;
        let (paper_dims, paper_grid) = paper_bytes(frame);
        InfoReport {
            input: self.input.clone(),
            model: frame.into(),
            format_version: format!("{VERSION_MAJOR}.{}", frame.header.minor),
            encoding: frame.header.encoding,
            checksum: format!("{:08x}", content_checksum(frame)),
            program: m.program.clone(),
            source: m.source.clone(),
            affine: m.affine,
            orientation: Affine { rows: m.affine }.orientation_letters(),
            rescale: m.rescale,
            connectivity: m.connectivity,
            channels: frame.channels().map(|(channel, _)| channel.name()).collect(),
            gradient: m.gradient.clone(),
            noise: m.noise,
            level_nodes: frame.levels.windows(2).map(|w| w[1].saturating_sub(w[0])).collect(),
            raw_bytes: m.source.bytes,
            ratio_to_raw: ratio(m.source.bytes, bytes),
            paper_bytes: paper_dims,
            ratio_to_paper: paper_dims / to_f64(bytes),
            ratio_to_paper_grid: paper_grid / to_f64(bytes),
            quantity: frame.quantity.clone(),
            labels: super::label_figures(frame, self.measured.as_ref()),
            measured: self.measured.as_ref().map(MeasuredFigures::from).unwrap_or_default(),
        }
    }
}
