//! Names of what a file holds: its surface, its channels and its sections.

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
    /// By how much a volume's sides grow to those of its boxes.
    pub(crate) const fn grown(self) -> u32 {
        match self {
            Self::Skin => 0,
            Self::Cells => 1,
        }
    }

    /// Its name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Skin => "skin",
            Self::Cells => "cells",
        }
    }
}

/// One attribute of skin voxels, in the order in which sections stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// Outward direction of the surface (SPEC 4.6).
    Normal,
    /// The value of the volume at the voxel (SPEC 4.7).
    Value,
    /// Where the surface lies: of cells that of the plane, or that there are corners instead (SPEC 4.8).
    Offset,
    /// RGB8.
    Color,
    /// Material number.
    Material,
    /// The eight samples of cells that no plane can separate (SPEC 4.8), or their labels (SPEC 4.12).
    Corners,
    /// Numbers of the labels behind and in front (SPEC 4.12), in blocks with palettes.
    Label,
    /// How fast values rise across the surface of a cell, as the logarithm (SPEC 4.14).
    Steepness,
}

/// Kind of a section, in the order in which sections stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SectionKind {
    /// Metadata.
    Meta,
    /// Labels with their names and colours (SPEC 4.10).
    LabelTable,
    /// The measured quantity that values are (SPEC 4.13).
    Quantity,
    /// First node of every depth.
    Levels,
    /// Infobytes.
    Nodes,
    /// Rank directory.
    Rank,
    /// Means of a channel over coarse nodes.
    Means(Channel),
    /// One item of a channel per voxel; of a sparse channel per voxel that has one.
    Voxels(Channel),
    /// How many cells before each block have corners.
    CornerRank,
    /// Normals of larger leaves, by node number (SPEC 4.9).
    LeafNormals,
    /// Offsets of their planes.
    LeafOffsets,
    /// How many nodes before each block are larger leaves.
    LeafRank,
}
