//! Meshes: what is wrong with one, and what was found and chosen.

use std::fmt;

use crate::facts::{Boundary, Fill, MeshFacts, MeshFault};

impl fmt::Display for MeshFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("is no mesh of a known format; STL, PLY, OBJ and OFF are read"),
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
            Self::GridSize { side } => {
                write!(f, "its grid would be {side} voxels long; choose 1 to 16384 with --grid or --voxel")
            }
        }
    }
}

impl fmt::Display for MeshFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { triangles, flat, files, boundary, fill, asked_for, voxel_mm, origin_mm } = self;
        write!(f, "{triangles} triangles")?;
        if *files > 1 {
            write!(f, " of {files} files")?;
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
        }
        let rule = match fill {
            Fill::Winding => "inside is what the mesh winds around",
            Fill::Parity => "inside is where a ray meets the mesh an odd number of times",
        };
        write!(f, "; {rule}{}", if *asked_for { ", as asked for" } else { "" })?;
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
