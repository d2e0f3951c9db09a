//! Names of a file's content: its surface, its channels and its sections.

/// The kind of the boxes of the finest level of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum SurfaceKind {
    /// Skin voxels: the boxes themselves are the surface.
    #[default]
    Skin,
    /// Cells between eight samples, with the surface within them (SPEC 4.8).
    Cells,
}

impl SurfaceKind {
    /// Difference between the number of boxes and the number of voxels along each axis of a volume.
    pub(crate) const fn grown(self) -> u32 {
        match self {
            Self::Skin => 0,
            Self::Cells => 1,
        }
    }

    /// Name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Cells => "cells",
        }
    }
}

/// One attribute of skin voxels, in the order of the sections in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// Outward direction of the surface (SPEC 4.6).
    Normal,
    /// The value of the volume at the voxel (SPEC 4.7).
    Value,
    /// Position of the surface: offset of a cell's plane, or a mark for corners instead (SPEC 4.8).
    Offset,
    /// Colour, RGB8.
    Color,
    /// Material number.
    Material,
    /// The eight samples of cells that no plane can separate (SPEC 4.8), or their labels (SPEC 4.12).
    Corners,
    /// Numbers of the labels behind and in front (SPEC 4.12), in blocks with palettes.
    Label,
    /// Logarithm of the rise of values across the surface of a cell (SPEC 4.14).
    Steepness,
}

/// Kind of a section, in the order of the sections in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SectionKind {
    /// Metadata.
    Meta,
    /// Labels with their names and colours (SPEC 4.10).
    LabelTable,
    /// The measured quantity of the values (SPEC 4.13).
    Quantity,
    /// First node of every depth.
    Levels,
    /// Infobytes.
    Nodes,
    /// Rank directory.
    Rank,
    /// Means of a channel over coarse nodes.
    Means(Channel),
    /// One item of a channel per voxel; for a sparse channel, per voxel that has one.
    Voxels(Channel),
    /// Number of cells with corners before each block.
    CornerRank,
    /// Normals of larger leaves, by node number (SPEC 4.9).
    LeafNormals,
    /// Offsets of larger leaves' planes.
    LeafOffsets,
    /// Number of larger leaves before each block of nodes.
    LeafRank,
}
