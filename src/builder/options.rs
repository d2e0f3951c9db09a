//! Options of a build: its content and its means.

use std::path::{Path, PathBuf};

use super::{BuildError, Connectivity, Gradient, ViewedFrom};
use crate::budget::MemoryCap;
use crate::builder::BuildFault;
use crate::format::normal::NormalBits;
use crate::format::{Channel, Channels, Selection, SurfaceKind};

/// How to choose what is inside; values are physical (after rescale).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Threshold {
    /// `value >= iso`.
    Iso(f64),
    /// `lo <= value <= hi`.
    Range(f64, f64),
    /// Otsu's threshold of the volume's histogram.
    Otsu,
    /// A selection from [`choose_selection`](super::choose_selection).
    Chosen(Selection),
}

/// Options of a build: its content and its means.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// The inside of a volume; other solids define their own.
    pub threshold: Threshold,
    /// Skin voxels or cells, of volumes, meshes and trees; [`Channel::Offset`] among the channels means cells, too.
    /// Other solids know for themselves.
    pub surface: SurfaceKind,
    /// Which neighbours make a voxel skin; cells do not ask.
    pub connectivity: Connectivity,
    /// The channels of every skin voxel.
    pub channels: Channels,
    /// How normals are estimated, of volumes.
    pub gradient: Gradient,
    /// In how many bits they are stored, of skin voxels of volumes.
    pub normal_bits: NormalBits,
    /// From where the model will be looked at: what cannot be seen from there is not kept. Everything is, if nothing
    /// is said.
    pub visible_from: Vec<ViewedFrom>,
    /// Store means of coarse nodes for level of detail?
    pub lod: bool,
    /// Cap on resident memory.
    pub memory: MemoryCap,
    /// Most worker threads; fewer are used when the cap is small.
    pub threads: usize,
    /// Folder of the scratch file; next to the output if not given.
    pub scratch: Option<PathBuf>,
}

impl Default for BuildOptions {
    /// Otsu's threshold, the thin skin with normals and coarse means, within 64 MiB on top of what the process
    /// holds, on all cores.
    fn default() -> Self {
        Self {
            threshold: Threshold::Otsu,
            surface: SurfaceKind::Skin,
            connectivity: Connectivity::Thin26,
            channels: Channels::default(),
            gradient: Gradient::default(),
            normal_bits: NormalBits::default(),
            visible_from: Vec::new(),
            lod: true,
            memory: MemoryCap::Share(64 << 20),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            scratch: None,
        }
    }
}

impl BuildOptions {
    /// The surface that a volume, a mesh or a tree is built with.
    pub(crate) fn volume_surface(&self) -> SurfaceKind {
        if self.channels.contains(Channel::Offset) { SurfaceKind::Cells } else { self.surface }
    }

    /// The same for a solid with this surface: cells need normals, offsets and corners.
    pub(super) fn for_surface(&self, surface: SurfaceKind) -> Self {
        let channels = match surface {
            SurfaceKind::Skin if self.has_fine_normals() => self.channels.with(Channel::Fine),
            SurfaceKind::Skin => self.channels,
            SurfaceKind::Cells => {
                self.channels.with(Channel::Normal).with(Channel::Offset).with(Channel::Corners)
            }
        };
        Self { surface, channels, ..self.clone() }
    }

    /// Are there normals, and in 24 bits?
    fn has_fine_normals(&self) -> bool {
        self.channels.contains(Channel::Normal) && self.normal_bits == NormalBits::TwentyFour
    }

    /// Are normals of this surface stored in as many bits?
    ///
    /// # Errors
    /// [`BuildError`]
    pub(super) fn check_bits(
        &self,
        of_volume: bool,
        name: impl FnOnce() -> String,
    ) -> Result<(), BuildError> {
        if self.normal_bits == NormalBits::Sixteen || (of_volume && self.surface == SurfaceKind::Skin) {
            return Ok(());
        }
        Err(BuildFault::NormalBits { name: name() }.into())
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
