//! What is found and refused about trees of solids, and about the text that they are read from.

/// What is wrong with a tree, or with its text. Lines are counted from 1; 0 is a tree that was not read from text.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum CsgFault {
    /// Something else stands where this belongs.
    Expected {
        /// Line.
        line: u64,
        /// What belongs there.
        what: CsgToken,
    },
    /// A module that is not read.
    Unsupported {
        /// Line.
        line: u64,
        /// Its name, as far as it is told.
        module: String,
    },
    /// An argument is missing, or of a kind that makes no sense.
    Argument {
        /// Line.
        line: u64,
        /// Module.
        module: String,
        /// Argument.
        argument: &'static str,
    },
    /// An argument that the module does not take.
    Surplus {
        /// Line.
        line: u64,
        /// Which, and of what.
        of: Box<SurplusArgument>,
    },
    /// A polygon, square or circle that is not extruded.
    Flat {
        /// Line.
        line: u64,
        /// Module.
        module: String,
    },
    /// A solid where a flat shape is to be extruded.
    NotFlat {
        /// Line.
        line: u64,
        /// Module.
        module: String,
    },
    /// An extrusion that twists or narrows.
    Twisted {
        /// Line.
        line: u64,
    },
    /// A solid without a size, or with one that is not a number.
    Size {
        /// Line.
        line: u64,
    },
    /// A matrix that makes a solid flat, or has no sound numbers.
    Singular {
        /// Line.
        line: u64,
    },
    /// The faces of a polyhedron leave holes.
    Open {
        /// Line.
        line: u64,
    },
    /// More facets than are made.
    Facets {
        /// Line.
        line: u64,
        /// The most.
        most: u64,
    },
    /// It reaches beyond the lattice.
    TooFar {
        /// Line.
        line: u64,
        /// Most voxels from the corner of the grid.
        most_voxels: u64,
    },
    /// More leaves than a tree may have.
    TooMany {
        /// The most.
        most: u64,
    },
    /// Nothing bounds it, so that no grid can be put around it.
    Unbounded,
    /// Its bounds leave nothing.
    Nothing,
    /// A file that it names lies outside of its folder.
    Outside {
        /// The name.
        name: String,
    },
    /// A file that it names is a link that leads out of its folder.
    Linked {
        /// The name.
        name: String,
    },
    /// A solid that cannot be grown or shrunk exactly.
    Offset {
        /// Line of the solid, or of `offset3d`.
        line: u64,
        /// Why.
        fault: OffsetFault,
    },
    /// Volumes on different grids.
    Volumes,
    /// A grid is asked for beside a volume, which brings its own.
    GridOfVolume,
}

/// Why a solid cannot be grown or shrunk exactly.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffsetFault {
    /// It is stretched or sheared.
    Stretched,
    /// An ellipsoid.
    Ellipsoid,
    /// Facets: a polyhedron, a prism, or a sphere or cylinder with `$fn`.
    Faces,
    /// A mesh.
    Mesh,
    /// A volume.
    Volume,
    /// An intersection, difference or complement of several parts that would be grown.
    GrownDifference,
    /// A union of several parts that would be shrunk.
    ShrunkUnion,
    /// A tube of more than 16 times its ring.
    Wide,
}

/// An argument that a module does not take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurplusArgument {
    /// Module.
    pub module: String,
    /// Its name, as far as it is told; nothing of a value without a name.
    pub argument: Option<String>,
    /// Names that the module takes.
    pub known: &'static [&'static str],
}

/// What can be missing from the text of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CsgToken {
    /// A module's name.
    Module,
    /// `(` behind a module's name.
    Open,
    /// `,` or `)` between arguments.
    Close,
    /// `;` or `{` behind a module.
    End,
    /// `}` at the end of the text.
    Brace,
    /// A value of an argument.
    Value,
    /// The end of a list of values.
    List,
    /// The end of a text in quotes.
    Quote,
    /// The end of a comment.
    Comment,
}

/// What was found about a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsgFacts {
    /// Leaves.
    pub leaves: u64,
    /// Meshes and volumes among them, which are read from files.
    pub files: u64,
    /// Steps from voxel to voxel in mm.
    pub voxel_mm: [f64; 3],
    /// Corner of the grid in mm, along the axes of the model; of a volume's grid the middle of its first voxel.
    pub origin_mm: [f64; 3],
    /// Sides on which the bounds of solids reach out of a volume's grid, where these are cut: at the low end of each
    /// axis of the grid, then at the high ends.
    pub cut: [[bool; 3]; 2],
}
