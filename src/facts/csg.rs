//! What is found and refused about trees of solids, and about the text that they are read from.

use std::fmt;

use thiserror::Error;

use super::mesh::length;
use crate::text::names::{DIMS, FOLLOW_LINKS, GRID, ORIGIN, UNIT, VOXEL};
use crate::text::shown;

/// Modules of `.csg` files that are read.
const READ: &str = "cube, sphere, ellipsoid, cylinder, torus, halfspace, polyhedron, linear_extrude of polygon, square and circle, import or mesh, volume, union, difference, intersection, complement, multmatrix, offset3d, color and group";

/// What is wrong with a tree, or with its text. Lines are counted from 1; 0 is a tree that was not read from text.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CsgFault {
    #[error("{}expected {what}; give a tree as `openscad -o tree.csg part.scad` writes it", At(*.line))]
    Expected { line: u64, what: CsgToken },
    #[error("{}{} is not supported; read are {READ}", At(*.line), shown(.module))]
    Unsupported { line: u64, module: String },
    #[error("{}{argument} of {} is missing or makes no sense{}", At(*.line), shown(.module), Example(.module))]
    Argument { line: u64, module: String, argument: &'static str },
    #[error("{}{of}", At(*.line))]
    Surplus { line: u64, of: Box<SurplusArgument> },
    #[error("{}{} is flat; put it into linear_extrude", At(*.line), shown(.module))]
    Flat { line: u64, module: String },
    #[error("{}{} is not flat and cannot be extruded", At(*.line), shown(.module))]
    NotFlat { line: u64, module: String },
    #[error("{}linear_extrude with twist, scale or a slanted direction is not supported; leave them out", At(*.line))]
    Twisted { line: u64 },
    #[error("{}a size is below 0, not a number or makes no solid; correct it", At(*.line))]
    Size { line: u64 },
    #[error("{}a matrix makes its solid flat or infinite; correct it", At(*.line))]
    Singular { line: u64 },
    #[error("{}the faces of the polyhedron leave holes; close it, or write it as a mesh and import that", At(*.line))]
    Open { line: u64 },
    #[error("{}reaches more than {most_voxels} voxels from the corner of the grid; choose larger voxels, or an origin nearer to it", At(*.line))]
    TooFar { line: u64, most_voxels: u64 },
    #[error("has more than {most} leaves")]
    TooMany { most: u64 },
    #[error(
        "is not bounded, so that no grid can be put around it; give the grid in full with {VOXEL}, {ORIGIN} and {DIMS}"
    )]
    Unbounded,
    #[error("has nothing inside: what is left of its parts does not overlap")]
    Nothing,
    #[error("names `{}`, which lies outside of its folder; put the file beside it or in a folder below", shown(.name))]
    Outside { name: String },
    #[error("names `{}`, a link that leads out of its folder; put the file there, or add {FOLLOW_LINKS}", shown(.name))]
    Linked { name: String },
    #[error("{}offset3d does not take {fault}; it grows and shrinks spheres, boxes, cylinders, cones, tori and half-spaces that are not stretched, grows unions of them, and shrinks their intersections and differences", At(*.line))]
    Offset { line: u64, fault: OffsetFault },
    #[error(
        "has volumes at the positions stated by their files, on different grids; place all but one with multmatrix, or all, and choose the grid with {GRID} or {VOXEL}"
    )]
    Volumes,
    #[error(
        "has a volume at the position stated by its file, whose grid is the model's; leave out {GRID}, {VOXEL} and {UNIT}, or place it with multmatrix, and {UNIT} alone"
    )]
    GridOfVolume,
}

/// The line of a text; nothing of a tree that was not read from one.
struct At(u64);

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 > 0 { write!(f, "line {}: ", self.0) } else { Ok(()) }
    }
}

/// How a module is written, as the end of a sentence.
struct Example<'a>(&'a str);

impl fmt::Display for Example<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let example = match self.0 {
            "cube" => "cube(size = [10, 20, 30], center = true);",
            "sphere" => "sphere(r = 5);",
            "ellipsoid" => "ellipsoid(radii = [5, 5, 9]);",
            "cylinder" => "cylinder(h = 10, r1 = 5, r2 = 3);",
            "torus" => "torus(major = 10, minor = 2);",
            "halfspace" => "halfspace(normal = [0, 0, 1], offset = 5);",
            "volume" => "volume(file = \"ct.nii.gz\", iso = 226);",
            "mesh" => "mesh(file = \"part.stl\");",
            "import" => "import(file = \"part.stl\"); of STL, PLY, OBJ and OFF",
            "multmatrix" => "multmatrix([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])",
            _ => return Ok(()),
        };
        write!(f, "; write for example {example}")
    }
}

/// Why a solid cannot be grown or shrunk exactly.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum OffsetFault {
    #[error("a solid that is stretched or sheared")]
    Stretched,
    #[error("an ellipsoid")]
    Ellipsoid,
    #[error("a solid of facets (a polyhedron, a prism, or $fn)")]
    Faces,
    #[error("a mesh")]
    Mesh,
    #[error("a volume")]
    Volume,
    #[error("an intersection, difference or complement of several parts to grow it")]
    GrownDifference,
    #[error("a union of several parts to shrink it")]
    ShrunkUnion,
    #[error("a rim that would become wider than 16 of its radii")]
    Wide,
}

/// An argument that a module does not take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SurplusArgument {
    /// Module.
    pub module: String,
    /// Its name; empty for a value without one.
    pub argument: Option<String>,
    /// Names that the module takes.
    pub known: &'static [&'static str],
}

impl fmt::Display for SurplusArgument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { module, argument, known } = self;
        let module = shown(module);
        match argument {
            Some(name) => write!(f, "{module} does not take {}", shown(name))?,
            None => write!(f, "{module} has more values than it takes")?,
        }
        match known {
            [] => f.write_str("; leave it out"),
            _ => write!(f, "; it takes {}", known.join(", ")),
        }
    }
}

/// What can be missing from the text of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CsgToken {
    Module,
    Open,
    Close,
    End,
    Brace,
    Value,
    List,
    Quote,
    Comment,
}

impl fmt::Display for CsgToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Module => "the name of a module",
            Self::Open => "( behind the name of a module",
            Self::Close => ", or ) behind an argument",
            Self::End => "; or { behind a module",
            Self::Brace => "} before the end of the file",
            Self::Value => "a value",
            Self::List => "the ] of a list",
            Self::Quote => "the end of a text in quotes",
            Self::Comment => "the end of a comment",
        })
    }
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

impl fmt::Display for CsgFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { leaves, files, voxel_mm, origin_mm, cut } = self;
        write!(f, "{leaves} {}", if *leaves == 1 { "leaf" } else { "leaves" })?;
        if *files > 0 {
            write!(f, ", {files} of them from files")?;
        }
        let short = |of: f64| length(of, of / 1000.0);
        let smallest = voxel_mm.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        let [x, y, z] = origin_mm.map(|at| length(at, smallest));
        match voxel_mm {
            [a, b, c] if a == b && b == c => write!(f, "; voxels of {} mm", short(*a))?,
            [a, b, c] => write!(f, "; voxels of {} x {} x {} mm", short(*a), short(*b), short(*c))?,
        }
        write!(f, " from {x}, {y}, {z}")?;
        if *cut == [[false; 3]; 2] {
            return Ok(());
        }
        f.write_str(
            "; the bounds of its solids reach out of the volume's grid, and what lies beyond is cut off (",
        )?;
        let mut before = "";
        for (cut, end) in cut.iter().zip(["low", "high"]) {
            for axis in ["x", "y", "z"].iter().zip(cut).filter_map(|(axis, cut)| cut.then_some(axis)) {
                write!(f, "{before}{end} {axis}")?;
                before = ", ";
            }
        }
        f.write_str(")")
    }
}
