//! Names of what a file holds: its channels and its sections.

/// One attribute of skin voxels, in the order in which sections stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// Outward direction of the surface (SPEC 4.6).
    Normal,
    /// What the volume holds at the voxel (SPEC 4.7).
    Value,
    /// Distance to the true surface.
    Offset,
    /// RGB8.
    Color,
    /// Material number.
    Material,
    /// A row for the test below.
    #[cfg(test)]
    Dummy,
}

/// Kind of a section, in the order in which sections stand in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SectionKind {
    /// Metadata.
    Meta,
    /// First node of every depth.
    Levels,
    /// Infobytes.
    Nodes,
    /// Rank directory.
    Rank,
    /// Means of a channel over coarse nodes.
    Means(Channel),
    /// One item of a channel per voxel.
    Voxels(Channel),
}
