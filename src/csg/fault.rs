//! Sentences about trees of solids, for faults that are found in several places.
//!
//! Lines are counted from 1; 0 stands for a tree that was not read from text.

use std::fmt;

use super::normal_form::MAX_LEAVES;
use crate::fault::{Fault, FaultKind, bad};
use crate::mesh::MAX_VOXELS;
use crate::text::names::{GRID, UNIT, VOXEL};
use crate::text::shown;

/// Modules of `.csg` files that are read.
const READ: &str = "cube, sphere, ellipsoid, cylinder, torus, halfspace, polyhedron, linear_extrude of polygon, square and circle, import or mesh, volume, union, difference, intersection, complement, translate, rotate, scale, mirror, resize, multmatrix, offset3d, color and group";
/// Conversion of a program of OpenSCAD into a tree.
const WAY_OUT: &str = "write programs out as trees with openscad -o part.csg part.scad";

/// The line of a text, as the start of a message; empty for a tree that was not read from one.
pub(super) struct At(pub(super) u64);

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 > 0 { write!(f, "line {}: ", self.0) } else { Ok(()) }
    }
}

/// Syntax of a module, as the end of a sentence.
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
            "translate" => "translate(v = [5, 0, 0])",
            "rotate" => "rotate(a = [0, 0, 45]) or rotate(a = 45, v = [0, 0, 1])",
            "scale" => "scale(v = [1, 1, 2])",
            "mirror" => "mirror(v = [1, 0, 0])",
            "resize" => "resize(newsize = [10, 0, 0], auto = true)",
            "multmatrix" => "multmatrix([[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])",
            _ => return Ok(()),
        };
        write!(f, "; write for example {example}")
    }
}

/// Text other than the expected one.
pub(super) fn expected(line: u64, what: &str) -> Fault {
    bad!("{}expected {what}; {WAY_OUT}", At(line))
}

pub(super) fn unsupported(line: u64, module: &str) -> Fault {
    let (at, name) = (At(line), shown(module));
    match module {
        "hull" | "minkowski" | "rotate_extrude" | "projection" | "offset" | "text" | "surface" | "fill"
        | "roof" => bad!(
            "{at}{name} is not supported; make a mesh of it with openscad -o part.stl part.scad; {WAY_OUT}"
        ),
        "module" | "function" | "include" | "use" | "for" | "intersection_for" | "if" | "else" | "let"
        | "each" | "echo" | "assert" | "assign" | "children" => {
            bad!("{at}{name} belongs to a program, and trees are read; {WAY_OUT}")
        }
        _ => bad!("{at}{name} is not supported; read are {READ}; {WAY_OUT}"),
    }
}

/// A variable, other than the fineness of round solids.
pub(super) fn variable(line: u64, name: &str) -> Fault {
    bad!("{}{} is a variable, which are not read; {WAY_OUT}", At(line), shown(name))
}

pub(super) fn bad_argument(line: u64, module: &str, argument: &str) -> Fault {
    bad!("{}{argument} of {} is missing or makes no sense{}", At(line), shown(module), Example(module))
}

pub(super) fn singular(line: u64) -> Fault {
    bad!("{}a matrix makes its solid flat or infinite; correct it", At(line))
}

pub(super) fn bad_size(line: u64) -> Fault {
    bad!("{}a size is below 0, not a number or makes no solid; correct it", At(line))
}

pub(super) fn too_far(line: u64) -> Fault {
    bad!(
        "{}reaches more than {MAX_VOXELS} voxels from the corner of the grid; choose larger voxels, or an origin nearer to it",
        At(line)
    )
}

pub(super) fn too_many() -> Fault {
    bad!("has more than {MAX_LEAVES} leaves")
}

pub(super) fn not_flat(line: u64, module: &str) -> Fault {
    bad!("{}{} is not flat and cannot be extruded", At(line), shown(module))
}

/// The fault of a grid chosen for a tree whose volume has one.
pub(super) fn grid_of_volume() -> Fault {
    Fault::new(
        FaultKind::OwnGrid,
        format!(
            "has a volume at the position stated by its file, whose grid is the model's; leave out {GRID}, {VOXEL} and {UNIT}, or place it with multmatrix, and {UNIT} alone"
        ),
    )
}

pub(super) fn nothing() -> Fault {
    bad!("has nothing inside: what is left of its parts does not overlap")
}
