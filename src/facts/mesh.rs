//! What is found, assumed and refused about triangle meshes.

use std::fmt;

use thiserror::Error;

use crate::budget::Bytes;
use crate::text::names::{CHANNELS, FILL, FOLLOW_LINKS, GRID, KEEP_THIN, MEMORY, SURFACE, VOXEL};
use crate::text::{Short, shown};

/// What is wrong with a mesh or with the grid that it is to be built on.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum MeshFault {
    #[error("is not a mesh of a known format; STL, PLY, OBJ, OFF, glTF and 3MF are read")]
    Unknown,
    #[error("does not hold a triangle")]
    NoTriangles,
    #[error(
        "states {stated} elements where its bytes hold {held} at most; it was cut short or damaged, copy it again"
    )]
    CountLies { stated: u64, held: u64 },
    #[error("ends before all that it states; it was cut short, copy it again")]
    CutShort,
    #[error("triangle {triangle} has a coordinate that is infinite or not a number; repair the mesh")]
    NotFinite { triangle: u64 },
    #[error("face {face} names a vertex that does not exist ({vertices} are stated); repair the mesh")]
    BadIndex { face: u64, vertices: u64 },
    #[error("line {line} cannot be understood; repair the file")]
    BadText { line: u64 },
    #[error("line {line} of its header cannot be understood")]
    BadHeader { line: u64 },
    #[error("its vertices have no x, y and z")]
    NoCoordinates,
    #[error("its faces are not lists of vertices that come after the vertices; write it as triangles")]
    NoFaces,
    #[error("lies in one point; give a mesh with an extent")]
    Point,
    #[error(
        "reaches more than {most_voxels} voxels from the corner of the grid; choose larger voxels, or an origin nearer to the mesh"
    )]
    TooLarge { most_voxels: u64 },
    #[error(
        "has more than {most_edges} open edges, too many to close; repair the mesh, or say what is inside with {FILL} winding or {FILL} parity"
    )]
    TooOpen { most_edges: u64 },
    #[error(
        "states {stated} bytes of data where there are {held}; it was cut short or damaged, copy it again"
    )]
    BufferLies { stated: u64, held: u64 },
    #[error("is glTF of version {}; write it as glTF 2.0", shown(.version))]
    GltfVersion { version: String },
    #[error("refers to {part} that does not exist or is not valid; repair the file")]
    BadReference { part: Part },
    #[error("{0}")]
    Unsupported(Feature),
    #[error("has parts that contain themselves, or nest too deep; repair the file")]
    Recursion,
    #[error("places a part by numbers that are infinite; repair the file")]
    Transform,
    #[error(
        "repeats its parts to more than {most} triangles, far more than its size justifies; write the parts out"
    )]
    TooManyTriangles { most: u64 },
    #[error("describes so many parts that {} of memory are needed for them, and only {} are available; raise {MEMORY}, or join parts", Bytes(*.needed_bytes), Bytes(*.allowed_bytes))]
    Description { needed_bytes: u64, allowed_bytes: u64 },
    #[error("is an archive that is damaged or cut short; copy it again")]
    BadArchive,
    #[error("contains a part that would unpack from {} to {}, more than any mesh would; it is refused", Bytes(*.stored), Bytes(*.stated))]
    Bomb { stated: u64, stored: u64 },
    #[error("names a file by an empty name; repair the file")]
    NoName,
    #[error("names {}, which is not below its own folder; copy it there", shown(.name))]
    Outside { name: String },
    #[error("names {}, from which a link leads out of its folder; {FOLLOW_LINKS} reads it", shown(.name))]
    Linked { name: String },
    #[error("names {}, which cannot be read: {}; put it beside the file", shown(.name), unreadable(*.why))]
    Missing { name: String, why: std::io::ErrorKind },
    #[error("names {}, which is a folder, a pipe, a socket or a device; put the file in its place", shown(.name))]
    NotRegular { name: String },
    #[error("has a texture, {}, which {fault}, or build it with {CHANNELS} normal", shown(.name))]
    Image { name: String, fault: ImageFault },
    #[error(
        "cannot be built as cells with {KEEP_THIN} or {FILL} surface, which add voxels that lie outside; leave one of them out"
    )]
    ThinCells,
    #[error("is {} mm long with its grid; voxels are 1e-15 to 1e15 mm long: scale it, or give the unit of its numbers", Short(*.mm))]
    Extent { mm: f64 },
    #[error("its grid would be {side} voxels long; choose 1 to 16384 with {GRID} or {VOXEL}")]
    GridSize { side: f64 },
}

/// What is wrong with the image of a texture.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum ImageFault {
    #[error("is not read: it is not a PNG or JPEG of 8 bits in grey or colour; convert it")]
    Unknown,
    #[error("is damaged or cut short; copy it again")]
    Damaged,
    #[error(
        "would have {width} x {height} texels, which is more than 32768 along a side or than its bytes justify; make it smaller"
    )]
    TooLarge { width: u32, height: u32 },
}

/// What a mesh names.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Chunk,
    Buffer,
    View,
    Accessor,
    Mesh,
    Node,
    Scene,
    Material,
    Texture,
    Image,
    Object,
    Skin,
    Text,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Chunk => "a chunk",
            Self::Buffer => "a buffer",
            Self::View => "a view of a buffer",
            Self::Accessor => "an accessor",
            Self::Mesh => "a mesh",
            Self::Node => "a node",
            Self::Scene => "a scene",
            Self::Material => "a material",
            Self::Texture => "a texture",
            Self::Image => "an image",
            Self::Object => "an object",
            Self::Skin => "a skin or a joint",
            Self::Text => "a part of the archive",
        })
    }
}

/// What is not supported.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum Feature {
    #[error("is compressed with Draco, which is not read; export it without compression")]
    Draco,
    #[error("is compressed with meshopt, which is not read; export it without compression")]
    Meshopt,
    #[error("has KTX2 textures, which are not read; write them as PNG or JPEG")]
    Basis,
    #[error("has sparse accessors, which are not read; write them out")]
    SparseAccessor,
    #[error("has accessors without bytes, which are not read; write them out")]
    EmptyAccessor,
    #[error("holds data that are not well-formed base64; write them to a file beside it, or as GLB")]
    DataUri,
    #[error("requires the extension {}, which is not read; write it without", shown(.0))]
    Extension(String),
    #[error("is made of beams, which are not read; write it as triangles")]
    BeamLattice,
    #[error("is encrypted; decrypt it first")]
    Encrypted,
    #[error("is an archive packed by method {method}, which is not read; pack it by deflate")]
    Packing { method: u16 },
    #[error("is written in UTF-16, which is not read; write it in UTF-8")]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fill {
    /// Those that the mesh winds around, in either direction.
    Winding,
    /// Those from which a ray meets the mesh an odd number of times.
    Parity,
    /// Those that the mesh itself crosses, and no others.
    Surface,
}

/// What a mesh lacks, or what of it was not built, where it can be built all the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshNote {
    pub(crate) mesh: String,
    pub(crate) lack: MeshLack,
}

impl fmt::Display for MeshNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", shown(&self.mesh), self.lack)
    }
}

/// What is missing.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(crate) enum MeshLack {
    #[error(
        "takes colours from {}, which is not there; the model lacks them: put the file beside it and build again",
        shown(.name)
    )]
    Colors { name: String },
    #[error("has colours; add {SURFACE} skin to keep them")]
    ColorsOfCells,
    #[error("names places in a texture (vt) that it does not hold; the model lacks the texture")]
    Places,
    #[error("names normals (vn) that it does not hold; those of its triangles are used")]
    Normals,
    #[error(
        "takes colours from the texture {}, which is not read from PLY; the model lacks them: write it as OBJ or glTF",
        shown(.name)
    )]
    Texture { name: String },
    #[error("has colours in several layers or mixtures, which are not read; those triangles have no colour")]
    Layers,
    #[error("gives the exact shape as slices, which are not read; the coarser mesh with them was built")]
    Slices,
    #[error("begins with {texts} texts; the first was built")]
    Starts { texts: u64 },
    #[error("has morph targets with weights, which are not applied; the shape without them was built")]
    Morphs,
    #[error("has {parts} parts, of which {thin} {} thinner than a voxel and not in the model; {FILL} surface or smaller voxels keep {}", if *.thin == 1 { "is" } else { "are" }, if *.thin == 1 { "it" } else { "them" })]
    Thin { thin: u64, parts: u64 },
    #[error(
        "extends {voxels} voxels beyond the model: that part is thinner than a voxel; {FILL} surface or smaller voxels keep it"
    )]
    Short { voxels: u64 },
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

impl fmt::Display for MeshFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { triangles, flat, files, parts, boundary, fill, asked_for, keep_thin, voxel_mm, origin_mm } =
            self;
        write!(f, "{triangles} triangles")?;
        if *files > 1 {
            write!(f, " of {files} files")?;
        }
        if parts > files {
            write!(f, " in {parts} parts")?;
        }
        if *flat > 0 {
            write!(f, " ({flat} without area)")?;
        }
        match boundary {
            Boundary::Oriented => f.write_str(", closed, directions agree")?,
            Boundary::Mixed => f.write_str(", closed, directions of neighbours disagree")?,
            Boundary::Open { edges, loops } => {
                write!(f, ", open: {edges} edges in {loops} loops were closed by caps")?;
            }
            Boundary::Sheet => f.write_str(", open")?,
        }
        let rule = match fill {
            Fill::Winding => "inside is what the mesh winds around",
            Fill::Parity => "inside is where a ray meets the mesh an odd number of times",
            Fill::Surface => "inside are the voxels that the mesh itself crosses",
        };
        write!(f, "; {rule}{}", if *asked_for { ", as asked for" } else { "" })?;
        if *keep_thin {
            f.write_str("; walls thinner than a voxel are kept")?;
        }
        let [x, y, z] = origin_mm.map(|at| length(at, *voxel_mm));
        write!(f, "; voxels of {} mm from {x}, {y}, {z}", length(*voxel_mm, *voxel_mm / 1000.0))
    }
}

/// A length to a thousandth of another one.
pub(super) fn length(length: f64, of: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few places")]
    let places = (3.0 - of.log10().floor()).clamp(0.0, 30.0) as usize;
    let text = format!("{length:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Why a named file cannot be read.
fn unreadable(why: std::io::ErrorKind) -> String {
    match why {
        std::io::ErrorKind::InvalidInput => "it is not a regular file".to_owned(),
        why => why.to_string(),
    }
}
