//! Meshes: what is wrong with one, and what was found and chosen.

use std::fmt;

use super::Short;
use super::foreign::shown;
use crate::budget::Bytes;
use crate::facts::{Boundary, Feature, Fill, ImageFault, MeshFacts, MeshFault, MeshNote, Part};

impl fmt::Display for MeshFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => {
                f.write_str("is no mesh of a known format; STL, PLY, OBJ, OFF, glTF and 3MF are read")
            }
            Self::NoTriangles => f.write_str("does not hold a triangle"),
            Self::CountLies { stated, held } => write!(
                f,
                "states {stated} elements where its bytes hold {held} at most; it was cut short or damaged, copy it again"
            ),
            Self::CutShort => f.write_str("ends before all that it states; it was cut short, copy it again"),
            Self::NotFinite { triangle } => {
                write!(
                    f,
                    "triangle {triangle} has a coordinate that is infinite or not a number; repair the mesh"
                )
            }
            Self::BadIndex { face, vertices } => write!(
                f,
                "face {face} names a vertex that does not exist ({vertices} are stated); repair the mesh"
            ),
            Self::BadText { line } => write!(f, "line {line} cannot be understood; repair the file"),
            Self::BadHeader { line } => write!(f, "line {line} of its header cannot be understood"),
            Self::NoCoordinates => f.write_str("its vertices have no x, y and z"),
            Self::NoFaces => f.write_str(
                "its faces are not lists of vertices that come after the vertices; write it as triangles",
            ),
            Self::Point => f.write_str("lies in one point; give a mesh with an extent"),
            Self::TooLarge { most_voxels } => write!(
                f,
                "reaches more than {most_voxels} voxels from the corner of the grid; choose larger voxels, or an origin nearer to the mesh"
            ),
            Self::TooOpen { most_edges } => write!(
                f,
                "has more than {most_edges} open edges, too many to close; repair the mesh, or say what is inside with --fill winding or --fill parity"
            ),
            Self::BufferLies { stated, held } => write!(
                f,
                "states {stated} bytes of data where there are {held}; it was cut short or damaged, copy it again"
            ),
            Self::GltfVersion { version } => {
                write!(f, "is glTF of version {}; write it as glTF 2.0", shown(version))
            }
            Self::BadReference { part } => {
                write!(f, "names {part} that does not exist or cannot hold; repair the file")
            }
            Self::Unsupported(feature) => feature.fmt(f),
            Self::Recursion => {
                f.write_str("has parts that contain themselves, or nest too deep; repair the file")
            }
            Self::Transform => f.write_str("places a part by numbers that are infinite; repair the file"),
            Self::TooManyTriangles { most } => write!(
                f,
                "repeats its parts to more than {most} triangles, far more than its size justifies; write the parts out"
            ),
            Self::Description { needed_bytes, allowed_bytes } => write!(
                f,
                "describes so many parts that {} of memory are needed for them, and {} are there; raise --memory, or join parts",
                Bytes(*needed_bytes),
                Bytes(*allowed_bytes)
            ),
            Self::BadArchive => f.write_str("is an archive that is damaged or cut short; copy it again"),
            Self::Bomb { stated, stored } => write!(
                f,
                "holds a part that would grow from {} to {}, which no mesh does; it is refused",
                Bytes(*stored),
                Bytes(*stated)
            ),
            Self::Outside { name } => {
                write!(f, "names {}, which is not below its own folder; copy it there", shown(name))
            }
            Self::Linked { name } => write!(
                f,
                "names {}, from which a link leads out of its folder; --follow-links reads it",
                shown(name)
            ),
            Self::Missing { name, why } => {
                write!(f, "names {}, which cannot be read: {why}; put it beside the file", shown(name))
            }
            Self::Image { name, fault } => {
                write!(f, "has a texture, {}, which {fault}, or build it with --channels normal", shown(name))
            }
            Self::ThinCells => f.write_str(
                "cannot be built as cells with --keep-thin or --fill surface, which add voxels that lie outside; leave one of them out",
            ),
            Self::Extent { mm } => write!(
                f,
                "is {} mm long with its grid; voxels are 1e-15 to 1e15 mm long: scale it, or give the unit of its numbers",
                Short(*mm)
            ),
            Self::GridSize { side } => {
                write!(f, "its grid would be {side} voxels long; choose 1 to 16384 with --grid or --voxel")
            }
        }
    }
}

impl fmt::Display for MeshNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoColors { mesh, name } => write!(
                f,
                "{} takes colours from {}, which is not there; the model lacks them: put the file beside it and build again",
                shown(mesh),
                shown(name)
            ),
        }
    }
}

impl fmt::Display for ImageFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => {
                f.write_str("is not read: it is no PNG or JPEG of 8 bits in grey or colour; convert it")
            }
            Self::Damaged => f.write_str("is damaged or cut short; copy it again"),
            Self::TooLarge { width, height } => write!(
                f,
                "would have {width} x {height} texels, which is more than 32768 along a side or than its bytes justify; make it smaller"
            ),
        }
    }
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
            Self::Text => "a part of the archive",
        })
    }
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Draco => {
                f.write_str("is compressed with Draco, which is not read; export it without compression")
            }
            Self::Meshopt => {
                f.write_str("is compressed with meshopt, which is not read; export it without compression")
            }
            Self::Basis => f.write_str("has KTX2 textures, which are not read; write them as PNG or JPEG"),
            Self::SparseAccessor => f.write_str("has sparse accessors, which are not read; write them out"),
            Self::EmptyAccessor => {
                f.write_str("has accessors without bytes, which are not read; write them out")
            }
            Self::DataUri => f.write_str(
                "holds data that are not well-formed base64; write them to a file beside it, or as GLB",
            ),
            Self::Extension(name) => {
                write!(f, "requires the extension {}, which is not read; write it without", shown(name))
            }
            Self::BeamLattice => f.write_str("is made of beams, which are not read; write it as triangles"),
            Self::Zip64 => f.write_str("is an archive of more than 4 GiB, which is not read; write several"),
            Self::Encrypted => f.write_str("is encrypted; decrypt it first"),
            Self::Packing { method } => {
                write!(f, "is an archive packed by method {method}, which is not read; pack it by deflate")
            }
            Self::Utf16 => f.write_str("is written in UTF-16, which is not read; write it in UTF-8"),
        }
    }
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
