//! Options of a build: its content and its resources.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::{BuildError, Connectivity, Gradient, LabelChoice, MAX_SMOOTH, ViewedFrom};
use crate::budget::MemoryCap;
use crate::builder::BuildFault;
use crate::fault::usage;
use crate::format::{Channel, Channels, LabelName, Selection, SurfaceKind};
use crate::text::names::{ERROR, SURFACE};
use crate::text::{Short, some_text};
use crate::volume::Overlap;

/// Rule for the inside of a volume; values are physical (after rescale).
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Threshold {
    /// `value >= iso`.
    Iso(f64),
    /// `lo <= value <= hi`.
    Range(f64, f64),
    /// Otsu's threshold of the volume's histogram.
    Otsu,
    #[serde(skip)]
    /// A selection made before, as in [`BuildReport::selection`](super::BuildReport).
    Chosen(Selection),
}

/// Largest distance of larger leaves of cells from the surface (SPEC 4.9).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// Voxels of the finest spacing, at most 1.
    Voxels(f64),
    /// Millimetres, at most a voxel.
    Mm(f64),
}

impl Tolerance {
    /// The tolerance in voxels of the finest spacing.
    pub(crate) fn voxels(self, spacing_mm: [f64; 3]) -> f64 {
        match self {
            Self::Voxels(voxels) => voxels,
            Self::Mm(mm) => mm / spacing_mm.into_iter().fold(f64::INFINITY, f64::min),
        }
    }

    /// The tolerance in mm.
    pub(crate) fn mm(self, spacing_mm: [f64; 3]) -> f64 {
        match self {
            Self::Voxels(voxels) => voxels * spacing_mm.into_iter().fold(f64::INFINITY, f64::min),
            Self::Mm(mm) => mm,
        }
    }

    fn number(self) -> f64 {
        let (Self::Voxels(number) | Self::Mm(number)) = self;
        number
    }
}

/// Parses voxels, such as `0.1`, or mm, such as `0.05mm`.
impl FromStr for Tolerance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mm = text.strip_suffix("mm").map(str::trim_end);
        match mm.unwrap_or(text).parse() {
            Ok(bound) if (0.0..f64::INFINITY).contains(&bound) => {
                Ok(if mm.is_some() { Self::Mm(bound) } else { Self::Voxels(bound) })
            }
            _ => Err(format!("'{text}' is not a bound; write voxels as 0.1, or mm as 0.05mm")),
        }
    }
}

/// Options of a build: its content and its resources.
#[derive(Clone, Debug, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BuildOptions {
    /// The inside of a volume; other solids define their own.
    pub threshold: Threshold,
    /// The labels to build from a label volume, as cells; threshold and [`BuildOptions::surface`] are ignored then.
    #[serde(deserialize_with = "some_text")]
    pub labels: Option<LabelChoice>,
    /// Names and colours of the labels, where known.
    pub label_names: Vec<LabelName>,
    /// Largest shift of walls of labels from the midpoint of the samples they separate, in voxels, 0 to [`MAX_SMOOTH`],
    /// which lets them lie anywhere between the samples.
    pub smooth: f64,
    /// Rule for voxels that several masks contain.
    pub overlap: Overlap,
    /// Skin voxels or cells, for volumes, meshes and trees. If not given, cells, but skin voxels for options that only
    /// these have: channels other than normals, a gradient, connectivity 6, and thin walls of
    /// meshes. [`Channel::Offset`] among the channels always means cells. Other solids define their own
    /// surface.
    pub surface: Option<SurfaceKind>,
    /// Neighbours that make a voxel skin; ignored for cells.
    pub connectivity: Connectivity,
    /// The channels of every skin voxel; if not given, normals, and for the skin of meshes their colours.
    pub channels: Option<Channels>,
    /// Normal estimator for skin voxels of volumes; if not given, [`Gradient::Isotropic5`].
    pub gradient: Option<Gradient>,
    /// Viewpoints of the model: surface that cannot be seen from any of them is dropped. An empty list keeps
    /// everything.
    #[serde(skip)]
    pub visible_from: Vec<ViewedFrom>,
    /// Bound within which cells are joined into larger leaves; 0 joins none.
    #[serde(deserialize_with = "some_text")]
    pub error: Option<Tolerance>,
    /// True to measure the noise of a volume, and to store the steepness of each cell (SPEC 4.14).
    pub uncertainty: bool,
    /// True to store means of coarse nodes for level of detail.
    pub lod: bool,
    /// Cap on resident memory.
    pub memory: MemoryCap,
    /// Most worker threads; fewer are used when the cap is small.
    pub threads: usize,
    /// Folder of the scratch file; next to the output if not given.
    pub scratch: Option<PathBuf>,
}

impl Default for BuildOptions {
    /// Otsu's threshold, cells with coarse means, within 64 MiB on top of what the process holds, on all cores.
    fn default() -> Self {
        Self {
            threshold: Threshold::Otsu,
            labels: None,
            label_names: Vec::new(),
            smooth: MAX_SMOOTH,
            overlap: Overlap::default(),
            surface: None,
            connectivity: Connectivity::Thin26,
            channels: None,
            gradient: None,
            visible_from: Vec::new(),
            error: None,
            uncertainty: false,
            lod: true,
            memory: MemoryCap::Share(64 << 20),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            scratch: None,
        }
    }
}

impl BuildOptions {
    /// The surface that a volume, a mesh or a tree is built with.
    pub fn volume_surface(&self) -> SurfaceKind {
        let shape =
            self.channels().iter().filter(|channel| !matches!(channel, Channel::Color | Channel::Material));
        let only_skin = self.gradient.is_some()
            || self.connectivity != Connectivity::default()
            || Channels::from_iter(shape) != Channels::default();
        let usual = if only_skin { SurfaceKind::Skin } else { SurfaceKind::Cells };
        let only_cells =
            self.labels.is_some() || self.uncertainty || self.channels().contains(Channel::Offset);
        if only_cells { SurfaceKind::Cells } else { self.surface.unwrap_or(usual) }
    }

    /// The channels, or normals.
    pub(crate) fn channels(&self) -> Channels {
        self.channels.unwrap_or_default()
    }

    /// The estimator, or the default one.
    pub(crate) fn gradient(&self) -> Gradient {
        self.gradient.unwrap_or_default()
    }

    /// The name of an option without effect on the cells that are built, and the kind of model that it is for.
    pub fn ignored(&self) -> Option<(&'static str, &'static str)> {
        let skin = "skin voxels, and cells are built";
        let labelled_skin = self.labels.is_some() && self.surface == Some(SurfaceKind::Skin);
        let given = [
            ("surface", "volumes, and labels are stored as cells", labelled_skin),
            (
                "uncertainty",
                "cells, and skin voxels are asked for",
                self.uncertainty && self.surface == Some(SurfaceKind::Skin),
            ),
            ("gradient", skin, self.gradient.is_some()),
            ("connectivity", skin, self.connectivity != Connectivity::default()),
        ];
        let is_cells = self.volume_surface() == SurfaceKind::Cells;
        given.into_iter().find(|(.., given)| *given && is_cells).map(|(name, of, _)| (name, of))
    }

    /// These options for a solid with this surface: cells need normals, offsets and corners.
    pub(super) fn for_surface(&self, surface: SurfaceKind) -> Self {
        let asked = self.channels();
        let labelled = if self.labels.is_some() { asked.with(Channel::Label) } else { asked };
        let channels = match surface {
            SurfaceKind::Skin => labelled,
            SurfaceKind::Cells => {
                let cells = labelled.with(Channel::Normal).with(Channel::Offset).with(Channel::Corners);
                if self.uncertainty { cells.with(Channel::Steepness) } else { cells }
            }
        };
        Self { surface: Some(surface), channels: Some(channels), ..self.clone() }
    }

    /// Name of a requested feature that models of labels lack.
    pub(super) fn labels_refused(&self) -> Option<&'static str> {
        let refused = [
            ("skin of connectivity 6", self.connectivity != Connectivity::Thin26),
            ("channel 'value'", self.channels().contains(Channel::Value)),
            ("larger leaves", self.joins()),
            ("uncertainty", self.uncertainty),
        ];
        refused.into_iter().find(|(_, asked)| *asked).map(|(name, _)| name)
    }

    /// True if cells are joined into larger leaves.
    pub(crate) fn joins(&self) -> bool {
        self.error.is_some_and(|error| error.number() != 0.0)
    }

    /// Checks that cells can be joined within the requested bound.
    ///
    /// # Errors
    /// [`BuildError`]
    pub(super) fn check_error(
        &self,
        spacing_mm: [f64; 3],
        name: impl FnOnce() -> String,
    ) -> Result<(), BuildError> {
        let Some(error) = self.error.filter(|_| self.joins()) else { return Ok(()) };
        let voxels = error.voxels(spacing_mm);
        let mut painted = [Channel::Color, Channel::Material, Channel::Steepness].into_iter();
        let painted = painted.find(|channel| self.channels().contains(*channel));
        let fault = if let (Some(channel), Some(SurfaceKind::Cells)) = (painted, self.surface) {
            BuildFault::Said {
                name: name(),
                fault: usage!(
                    "larger leaves have no channel '{channel}'; leave it out, or leave out {ERROR}"
                ),
            }
        } else if self.surface != Some(SurfaceKind::Cells) {
            BuildFault::Said {
                name: name(),
                fault: usage!(
                    "only cells are joined into larger leaves; leave out {ERROR}, or use {SURFACE} cells"
                ),
            }
        } else if !(voxels > 0.0 && voxels <= 1.0) {
            BuildFault::Said {
                name: name(),
                fault: usage!(
                    "{ERROR} is {} voxels of the finest spacing here; give a bound above 0 and up to 1 voxel",
                    Short(voxels)
                ),
            }
        } else {
            return Ok(());
        };
        Err(fault.into())
    }

    /// The folder of scratch files for a model: as given, or the model's own.
    pub fn scratch_folder(&self, output: &Path) -> PathBuf {
        let models_own = || match output.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        self.scratch.clone().unwrap_or_else(models_own)
    }
}
