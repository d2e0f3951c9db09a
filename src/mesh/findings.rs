//! Findings about triangle meshes, and the choices made.

use std::fmt;

use crate::text::{Count, shown};

/// Kind of boundary of a mesh.
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

/// Rule for the voxels inside a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fill {
    /// Voxels that the mesh winds around, in either direction.
    Winding,
    /// Voxels from which a ray meets the mesh an odd number of times.
    Parity,
    /// Voxels that the mesh itself crosses, and no others.
    Surface,
}

/// A lack of a mesh, or a part of it that was not built, which does not prevent the build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshNote {
    pub(crate) mesh: String,
    pub(crate) lack: String,
}

impl fmt::Display for MeshNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", shown(&self.mesh), self.lack)
    }
}

/// Findings about a mesh, and the choices made.
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
    /// Kind of its boundary.
    pub boundary: Boundary,
    /// Rule for inside.
    pub fill: Fill,
    /// True if the fill was chosen by the caller.
    pub asked_for: bool,
    /// True if walls thinner than a voxel are kept.
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
        write!(f, "{}", Count(*triangles, "triangle"))?;
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
        if parts > files {
            f.write_str("; parts become one solid, without their names")?;
        }
        let [x, y, z] = origin_mm.map(|at| length(at, *voxel_mm));
        write!(f, "; voxels of {} mm from {x}, {y}, {z}", length(*voxel_mm, *voxel_mm / 1000.0))
    }
}

/// A length to a thousandth of another one.
pub(crate) fn length(length: f64, of: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few places")]
    let places = (3.0 - of.log10().floor()).clamp(0.0, 30.0) as usize;
    let text = format!("{length:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
