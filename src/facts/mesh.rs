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
    /// It states more bytes of data than there are.
    BufferLies {
        /// Bytes that it states.
        stated: u64,
        /// Bytes that there are.
        held: u64,
    },
    /// It is of another version of glTF than 2.
    GltfVersion {
        /// What it states.
        version: String,
    },
    /// It names something by a number or a name that does not exist.
    BadReference {
        /// What it names.
        part: Part,
    },
    /// It cannot be read without something that is not supported.
    Unsupported(Feature),
    /// Its parts contain themselves, or nest too deep.
    Recursion,
    /// A part is placed by numbers that are infinite.
    Transform,
    /// It has more triangles than its size justifies, as it repeats its parts.
    TooManyTriangles {
        /// The most.
        most: u64,
    },
    /// What it says of its parts takes more memory than there is.
    Description {
        /// Bytes that it takes.
        needed_bytes: u64,
        /// Bytes that there are.
        allowed_bytes: u64,
    },
    /// The archive cannot be read.
    BadArchive,
    /// A part of the archive would grow to far more than its bytes.
    Bomb {
        /// Bytes that it states.
        stated: u64,
        /// Bytes that it takes in the archive.
        stored: u64,
    },
    /// It names a file outside its folder.
    Outside {
        /// The name.
        name: String,
    },
    /// A link leads from a file that it names out of its folder.
    Linked {
        /// The name.
        name: String,
    },
    /// A file that it names cannot be read.
    Missing {
        /// The name.
        name: String,
        /// What the system said.
        why: std::io::ErrorKind,
    },
    /// An image that it names, or holds, cannot be read.
    Image {
        /// What it is called.
        name: String,
        /// What is wrong with it.
        fault: ImageFault,
    },
    /// Cells are asked for, together with voxels that its centre lines cross.
    ThinCells,
    /// It is so small, or so large, that no picture can be taken of it.
    Extent {
        /// The longest side of its grid in mm.
        mm: f64,
    },
    /// The grid would have this many voxels along a side.
    GridSize {
        /// Along the longest side.
        side: f64,
    },
}

/// What is wrong with the image of a texture.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFault {
    /// It is neither PNG nor JPEG, or of a kind of these that is not read.
    Unknown,
    /// It is damaged or cut short.
    Damaged,
    /// It has more texels than its size justifies, or than are read.
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// What a mesh names.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// A chunk of a binary file.
    Chunk,
    /// A buffer.
    Buffer,
    /// A view of a buffer.
    View,
    /// An accessor.
    Accessor,
    /// A mesh.
    Mesh,
    /// A node.
    Node,
    /// A scene.
    Scene,
    /// A material, or a value of one.
    Material,
    /// A texture.
    Texture,
    /// An image.
    Image,
    /// An object.
    Object,
    /// A text of the archive.
    Text,
}

/// What is not supported.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Draco compression.
    Draco,
    /// Meshopt compression.
    Meshopt,
    /// KTX2 textures with Basis Universal.
    Basis,
    /// Accessors of which some items stand elsewhere.
    SparseAccessor,
    /// Accessors without bytes.
    EmptyAccessor,
    /// Data in a text in another way than base64.
    DataUri,
    /// Another extension that the file requires.
    Extension(String),
    /// Beams in place of triangles.
    BeamLattice,
    /// Archives of more than 4 GiB or 65,534 members.
    Zip64,
    /// Encrypted archives.
    Encrypted,
    /// Archives packed otherwise than by deflate.
    Packing {
        /// The method's number.
        method: u16,
    },
    /// Texts in 16 bits a character.
    Utf16,
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
    /// Some edges are open, and were left so.
    Sheet,
}

/// Which voxels are inside a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Those that the mesh winds around, in either direction.
    Winding,
    /// Those from which a ray meets the mesh an odd number of times.
    Parity,
    /// Those that the mesh itself crosses, and no others.
    Surface,
}

/// What a mesh lacks that can be built all the same.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MeshNote {
    /// A file with its colours is not there, or not below its folder.
    NoColors {
        /// Name of the mesh.
        mesh: String,
        /// The file that it names.
        name: String,
    },
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
    /// Parts in all of them, at least one each.
    pub parts: u64,
    /// Is it closed?
    pub boundary: Boundary,
    /// What is inside.
    pub fill: Fill,
    /// Was the fill asked for?
    pub asked_for: bool,
    /// Are walls thinner than a voxel kept?
    pub keep_thin: bool,
    /// Edge of a voxel in mm.
    pub voxel_mm: f64,
    /// Corner of the grid in mm.
    pub origin_mm: [f64; 3],
}
