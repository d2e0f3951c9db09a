//! What is found, assumed and refused about triangle meshes.

/// What is wrong with a mesh or with the grid that it is to be built on.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum MeshFault {
    /// It is of no format that is known.
    Unknown,
    /// It does not hold a triangle.
    NoTriangles,
    /// Its size and the number of triangles that it states disagree.
    CountLies {
        /// What it states.
        stated: u64,
        /// Most that its bytes can hold.
        held: u64,
    },
    /// It ends before all that it states was read.
    CutShort,
    /// A coordinate is infinite or not a number.
    NotFinite {
        /// Triangle, counted from 1.
        triangle: u64,
    },
    /// A face names a vertex that does not exist.
    BadIndex {
        /// Face, counted from 1.
        face: u64,
        /// Vertices that there are.
        vertices: u64,
    },
    /// A word stands where a number or a keyword belongs.
    BadText {
        /// Line, counted from 1.
        line: u64,
    },
    /// The header cannot be understood.
    BadHeader {
        /// Line, counted from 1.
        line: u64,
    },
    /// Vertices have no x, y and z.
    NoCoordinates,
    /// Faces stand before the vertices, or are stored in another way than as lists of vertices.
    NoFaces,
    /// All of it lies in one point.
    Point,
    /// It is so large on this grid that it leaves the lattice.
    TooLarge {
        /// Most voxels from the grid's corner.
        most_voxels: u64,
    },
    /// So many edges are open that they cannot be closed.
    TooOpen {
        /// The most that can be.
        most_edges: u64,
    },
    /// The grid would have this many voxels along a side.
    GridSize {
        /// Along the longest side.
        side: f64,
    },
}

/// How a mesh bounds its solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// Every edge is shared by faces of opposite directions.
    Oriented,
    /// Every edge is shared by an even number of faces, with directions that disagree.
    Mixed,
    /// Some edges are open: they were closed by caps over loops.
    Open {
        /// Open edges.
        edges: u64,
        /// Loops that they form.
        loops: u64,
    },
}

/// Which voxels are inside a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Those that the mesh winds around, in either direction.
    Winding,
    /// Those from which a ray meets the mesh an odd number of times.
    Parity,
}

/// What was found about a mesh, and what was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshFacts {
    /// Triangles read.
    pub triangles: u64,
    /// Triangles without area.
    pub flat: u64,
    /// Files read.
    pub files: u64,
    /// Is it closed?
    pub boundary: Boundary,
    /// What is inside.
    pub fill: Fill,
    /// Was the fill asked for?
    pub asked_for: bool,
    /// Edge of a voxel in mm.
    pub voxel_mm: f64,
    /// Corner of the grid in mm.
    pub origin_mm: [f64; 3],
}
