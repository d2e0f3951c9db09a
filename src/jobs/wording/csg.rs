//! Trees of solids: what is wrong with one or its text, and what was found.

use std::fmt;

use super::foreign::shown;
use super::mesh::length;
use crate::facts::{CsgFacts, CsgFault, CsgToken, OffsetFault, SurplusArgument};

/// What is written in `.csg` files, and read.
const READ: &str = "cube, sphere, ellipsoid, cylinder, torus, halfspace, polyhedron, linear_extrude of polygon, square and circle, import or mesh, volume, union, difference, intersection, complement, multmatrix, offset3d, color and group";

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

/// A module as it is written.
fn example(module: &str) -> Option<&'static str> {
    Some(match module {
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
        _ => return None,
    })
}

/// Where it stands; nothing of a tree that was not read from text.
struct At(u64);

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 > 0 { write!(f, "line {}: ", self.0) } else { Ok(()) }
    }
}

impl fmt::Display for OffsetFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stretched => "a solid that is stretched or sheared",
            Self::Ellipsoid => "an ellipsoid",
            Self::Faces => "a solid of facets (a polyhedron, a prism, or $fn)",
            Self::Mesh => "a mesh",
            Self::Volume => "a volume",
            Self::GrownDifference => "an intersection, difference or complement of several parts to grow it",
            Self::ShrunkUnion => "a union of several parts to shrink it",
            Self::Wide => "a rim that would become wider than 16 of its radii",
        })
    }
}

impl fmt::Display for CsgFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Expected { line, what } => write!(
                f,
                "{}expected {what}; give a tree as `openscad -o tree.csg part.scad` writes it",
                At(*line)
            ),
            Self::Unsupported { line, module } => {
                write!(f, "{}{} is not supported; read are {READ}", At(*line), shown(module))
            }
            Self::Argument { line, module, argument } => {
                write!(f, "{}{argument} of {} is missing or makes no sense", At(*line), shown(module))?;
                match example(module) {
                    Some(example) => write!(f, "; write for example {example}"),
                    None => Ok(()),
                }
            }
            Self::Surplus { line, of } => {
                let SurplusArgument { module, argument, known } = &**of;
                let module = shown(module);
                match argument {
                    Some(name) => write!(f, "{}{module} does not take {}", At(*line), shown(name))?,
                    None => write!(f, "{}{module} has more values than it takes", At(*line))?,
                }
                match known {
                    [] => f.write_str("; leave it out"),
                    _ => write!(f, "; it takes {}", known.join(", ")),
                }
            }
            Self::Flat { line, module } => {
                write!(f, "{}{} is flat; put it into linear_extrude", At(*line), shown(module))
            }
            Self::NotFlat { line, module } => {
                write!(f, "{}{} is not flat and cannot be extruded", At(*line), shown(module))
            }
            Self::Twisted { line } => write!(
                f,
                "{}linear_extrude with twist, scale or a slanted direction is not supported; leave them out",
                At(*line)
            ),
            Self::Size { line } => {
                write!(f, "{}a size is below 0, not a number or makes no solid; correct it", At(*line))
            }
            Self::Singular { line } => {
                write!(f, "{}a matrix makes its solid flat or infinite; correct it", At(*line))
            }
            Self::Open { line } => write!(
                f,
                "{}the faces of the polyhedron leave holes; close it, or write it as a mesh and import that",
                At(*line)
            ),
            Self::Facets { line, most } => {
                write!(f, "{}$fn is more than {most}; leave it out for a smooth surface", At(*line))
            }
            Self::TooFar { line, most_voxels } => write!(
                f,
                "{}reaches more than {most_voxels} voxels from the corner of the grid; choose larger voxels, or an origin nearer to it",
                At(*line)
            ),
            Self::TooMany { most } => write!(f, "has more than {most} leaves"),
            Self::Unbounded => f.write_str(
                "is not bounded, so that no grid can be put around it; give the grid in full with --voxel, --origin and --dims",
            ),
            Self::Nothing => f.write_str("has nothing inside: what is left of its parts does not overlap"),
            Self::Outside { name } => write!(
                f,
                "names `{}`, which lies outside of its folder; put the file beside it or in a folder below",
                shown(name)
            ),
            Self::Linked { name } => write!(
                f,
                "names `{}`, a link that leads out of its folder; put the file there, or add --follow-links",
                shown(name)
            ),
            Self::Offset { line, fault } => write!(
                f,
                "{}offset3d does not take {fault}; it grows and shrinks spheres, boxes, cylinders, cones, tori and half-spaces that are not stretched, grows unions of them, and shrinks their intersections and differences",
                At(*line)
            ),
            Self::Volumes => f.write_str(
                "has volumes that lie where their files say, on grids that differ; place all but one with multmatrix, or all, and choose the grid with --grid or --voxel",
            ),
            Self::GridOfVolume => f.write_str(
                "has a volume that lies where its file says, whose grid is the model's; leave out --grid, --voxel and --unit, or place it with multmatrix, and --unit alone",
            ),
        }
    }
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
