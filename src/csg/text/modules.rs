//! The meanings of modules.

use std::path::{Component, Path, PathBuf};

use super::values::{Arguments, MAX_NAME, Value};
use crate::csg::bounds::NewSize;
use crate::csg::facets;
use crate::csg::fault::{At, bad_size, not_flat, unsupported};
use crate::csg::offset::moved_to;
use crate::csg::tree::{Faces, Operation, Shape};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::mesh::cut_polygon;
use crate::text::shown;

/// Most sides of a facetted sphere or cylinder.
pub(super) const MAX_SIDES: f64 = 256.0;

/// A module with children.
#[derive(Debug)]
pub(super) enum Block<A> {
    Joined(Operation),
    Placed(A),
    /// Children grown by a distance.
    Offset(f64),
    /// Children stretched to a size.
    Resized(NewSize),
}

pub(super) enum Meaning {
    Leaf(Shape),
    Block(Block<Affine>),
    /// Flat shapes within are extruded between these heights.
    Extruded([f64; 2]),
}

/// The meaning of a module, within an extrusion or not.
///
/// # Errors
/// The module is not supported, or its arguments make no sense.
pub(super) fn meaning(of: &Arguments, extruded: Option<[f64; 2]>, folder: &Path) -> Result<Meaning, Fault> {
    if let Some((known, places)) = taken(&of.module) {
        of.only(known, places)?;
    }
    let joined = |operation| Ok(Meaning::Block(Block::Joined(operation)));
    match of.module.as_str() {
        // `render` and `color` change the appearance in OpenSCAD, not the shape.
        "color" => {
            of.color()?;
            joined(Operation::Union)
        }
        "group" | "union" | "render" => joined(Operation::Union),
        "difference" => joined(Operation::Difference),
        "intersection" => joined(Operation::Intersection),
        "complement" => joined(Operation::Complement),
        "resize" => {
            let size = of.vector("newsize", 0, 0.0)?.ok_or_else(|| of.wrong("newsize"))?;
            if size.iter().any(|side| *side < 0.0) {
                return Err(of.wrong("newsize"));
            }
            let mut auto = of.flags("auto", Some(1))?;
            auto[2] &= extruded.is_none();
            let size = if extruded.is_some() { [size[0], size[1], 0.0] } else { size };
            Ok(Meaning::Block(Block::Resized(NewSize { size, auto })))
        }
        "multmatrix" | "translate" | "rotate" | "scale" | "mirror" => {
            let mut affine = place(of)?;
            if extruded.is_some() {
                // Flat shapes stay in their plane.
                let [x, y, _] = affine.rows;
                affine.rows = [[x[0], x[1], 0.0, x[3]], [y[0], y[1], 0.0, y[3]], [0.0, 0.0, 1.0, 0.0]];
            }
            Ok(Meaning::Block(Block::Placed(affine)))
        }
        "offset3d" if extruded.is_none() => Ok(Meaning::Block(Block::Offset(of.need("r", Some(0))?))),
        "linear_extrude" => match extruded {
            None => heights(of).map(Meaning::Extruded),
            Some(_) => Err(not_flat(of.line, &of.module)),
        },
        "square" | "circle" | "polygon" => match extruded {
            Some(z) => flat(of, z).map(Meaning::Leaf),
            None => Err(bad!("{}{} is flat; put it into linear_extrude", At(of.line), shown(&of.module))),
        },
        _ => {
            let shape = solid(of, folder)?;
            if extruded.is_some() {
                return Err(not_flat(of.line, &of.module));
            }
            Ok(Meaning::Leaf(shape))
        }
    }
}

pub(in crate::csg) fn is_module(name: &str) -> bool {
    taken(name).is_some() || name == "offset3d"
}

/// Names of a module's arguments, with those that OpenSCAD adds in its files, and the number that may stand without a
/// name; `None` for a module that is not read.
fn taken(module: &str) -> Option<(&'static [&'static str], usize)> {
    Some(match module {
        "group" | "union" | "difference" | "intersection" | "complement" => (&[], 0),
        "render" => (&["convexity"], 1),
        "color" => (&["c", "alpha"], 2),
        "multmatrix" => (&["m"], 1),
        "translate" | "scale" | "mirror" => (&["v"], 1),
        "rotate" => (&["a", "v"], 2),
        "resize" => (&["newsize", "auto"], 2),
        "linear_extrude" => (
            &[
                "height",
                "center",
                "twist",
                "scale",
                "slices",
                "segments",
                "v",
                "file",
                "layer",
                "origin",
                "timestamp",
            ],
            1,
        ),
        "square" | "cube" => (&["size", "center"], 2),
        "circle" | "sphere" => (&["r", "d"], 1),
        "polygon" => (&["points", "paths"], 2),
        "ellipsoid" => (&["radii"], 1),
        "cylinder" => (&["h", "r1", "r2", "center", "r", "d", "d1", "d2"], 4),
        "polyhedron" => (&["points", "faces", "triangles"], 2),
        "torus" => (&["major", "minor"], 2),
        "halfspace" => (&["normal", "offset"], 2),
        "mesh" => (&["file"], 1),
        "import" => {
            (&["file", "layer", "origin", "scale", "center", "dpi", "id", "width", "height", "timestamp"], 1)
        }
        "volume" => (&["file", "iso"], 2),
        _ => return None,
    })
}

fn solid(of: &Arguments, folder: &Path) -> Result<Shape, Fault> {
    Ok(match of.module.as_str() {
        "cube" => {
            let size = of.numbers::<3>("size", Some(0))?.unwrap_or([1.0; 3]);
            let low = if of.flag("center", Some(1))? { size.map(|s| -s / 2.0) } else { [0.0; 3] };
            Shape::Cuboid { low, high: [0, 1, 2].map(|k| low[k] + size[k]) }
        }
        "sphere" => {
            let radius = radius(of, "r", "d", Some(0))?.unwrap_or(1.0);
            match sides(of) {
                Some(sides) if radius > 0.0 => Shape::Faces(facets::sphere(radius, sides)),
                _ => Shape::Ellipsoid { radii: [radius; 3] },
            }
        }
        "ellipsoid" => {
            Shape::Ellipsoid { radii: of.numbers::<3>("radii", Some(0))?.ok_or_else(|| of.wrong("radii"))? }
        }
        "cylinder" => {
            let height = of.number("h", Some(0))?.unwrap_or(1.0);
            let both = radius(of, "r", "d", None)?;
            let low = radius(of, "r1", "d1", Some(1))?.or(both).unwrap_or(1.0);
            let high = radius(of, "r2", "d2", Some(2))?.or(both).unwrap_or(1.0);
            let start = if of.flag("center", Some(3))? { -height / 2.0 } else { 0.0 };
            upright([start, start + height], [low, high], sides(of))
        }
        "polyhedron" => polyhedron(of)?,
        "torus" => {
            let (major, minor) = (of.need("major", Some(0))?, of.need("minor", Some(1))?);
            if minor > major {
                return Err(bad_size(of.line));
            }
            Shape::Torus { major, minor }
        }
        "halfspace" => Shape::HalfSpace {
            normal: of.numbers::<3>("normal", Some(0))?.ok_or_else(|| of.wrong("normal"))?,
            offset: of.number("offset", Some(1))?.unwrap_or(0.0),
        },
        "mesh" => Shape::Mesh { path: beside(of.text("file", Some(0))?, folder)? },
        "import" => {
            let path = beside(of.text("file", Some(0))?, folder)?;
            let read = ["stl", "ply", "obj", "off"];
            if !path.extension().is_some_and(|e| read.iter().any(|known| e.eq_ignore_ascii_case(known))) {
                return Err(of.wrong("file"));
            }
            if of.flag("center", None)? {
                return Err(bad!(
                    "{}import(center = true) is not read; move the part by translate, and leave center out",
                    At(of.line)
                ));
            }
            Shape::Mesh { path }
        }
        "volume" => {
            Shape::Volume { path: beside(of.text("file", Some(0))?, folder)?, iso: of.need("iso", Some(1))? }
        }
        _ => {
            let module: String = of.module.chars().take(MAX_NAME).collect();
            return Err(unsupported(of.line, &module));
        }
    })
}

/// The matrix of a module that places its children.
fn place(of: &Arguments) -> Result<Affine, Fault> {
    let one = Affine::from_spacing([1.0; 3]);
    let need = |name, missing| of.vector(name, 0, missing)?.ok_or_else(|| of.wrong(name));
    match of.module.as_str() {
        "translate" => match of.value("v", Some(0)) {
            Some(Value::Number(_)) => Err(of.wrong("v")),
            _ => Ok(moved_to(need("v", 0.0)?)),
        },
        "scale" => Ok(Affine::from_spacing(need("v", 1.0)?)),
        "rotate" => match of.value("a", Some(0)) {
            // Turns about x, then y, then z.
            Some(Value::List(_)) => {
                let [x, y, z] = need("a", 0.0)?;
                let turned = [(z, 2), (y, 1), (x, 0)].map(|(angle, axis)| turn(angle, unit(axis)));
                Ok(turned.iter().fold(one, |all, next| all.after(next)))
            }
            _ => {
                let axis = of.vector("v", 1, 0.0)?.unwrap_or(unit(2));
                Ok(turn(of.need("a", Some(0))?, axis))
            }
        },
        "mirror" => {
            let normal = need("v", 0.0)?;
            let square: f64 = normal.iter().map(|c| c * c).sum();
            let mut affine = one;
            for (at, row) in affine.rows.iter_mut().enumerate().filter(|_| square > 0.0) {
                (0..3).for_each(|k| row[k] -= 2.0 * normal[at] * normal[k] / square);
            }
            Ok(affine)
        }
        _ => of.matrix(),
    }
}

fn unit(axis: usize) -> [f64; 3] {
    std::array::from_fn(|k| if k == axis { 1.0 } else { 0.0 })
}

/// A turn by an angle in degrees about an axis (Rodrigues); the identity for no axis.
fn turn(degrees: f64, axis: [f64; 3]) -> Affine {
    let length = axis.iter().map(|c| c * c).sum::<f64>().sqrt();
    let mut affine = Affine::from_spacing([1.0; 3]);
    if length == 0.0 {
        return affine;
    }
    let [x, y, z] = axis.map(|c| c / length);
    // Right angles are whole numbers.
    let (sin, cos) = match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        angle => angle.to_radians().sin_cos(),
    };
    let cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    for (at, row) in affine.rows.iter_mut().enumerate() {
        for k in 0..3 {
            let same = if at == k { cos } else { 0.0 };
            row[k] = same + (1.0 - cos) * [x, y, z][at] * [x, y, z][k] + sin * cross[at][k];
        }
    }
    affine
}

/// The note of a diameter and a radius of one shape. OpenSCAD uses the diameter.
pub(super) fn doubled(of: &Arguments) -> Option<String> {
    let pairs = match of.module.as_str() {
        "circle" | "sphere" => &[("d", "r", Some(0))][..],
        "cylinder" => &[("d", "r", None), ("d1", "r1", Some(1)), ("d2", "r2", Some(2))],
        _ => return None,
    };
    let is_given = |name, place| of.value(name, place).is_some();
    let (d, r, _) = pairs.iter().find(|(d, r, place)| is_given(*d, None) && is_given(*r, *place))?;
    Some(format!("{}{} has both {d} and {r}; {d} is used, as in OpenSCAD", At(of.line), of.module))
}

/// The note of children of a solid.
pub(super) fn childless(of: &Arguments) -> String {
    format!("{}{} has children, which are left out, as in OpenSCAD", At(of.line), of.module)
}

/// A radius, or half of a diameter.
fn radius(
    of: &Arguments,
    radius: &'static str,
    diameter: &'static str,
    place: Option<usize>,
) -> Result<Option<f64>, Fault> {
    let half = of.number(diameter, None)?.map(|d| d / 2.0);
    Ok(half.or(of.number(radius, place)?))
}

/// Sides of a round shape; `None` for a truly round one, or for so many sides that it is within 0.008 % of its radius.
fn sides(of: &Arguments) -> Option<usize> {
    let count = of.facets.filter(|count| *count > 0.0 && *count <= MAX_SIDES)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "3 to 256")]
    Some(count.max(3.0) as usize)
}

/// A cylinder, cone or prism around the z axis.
fn upright(z: [f64; 2], radii: [f64; 2], sides: Option<usize>) -> Shape {
    let is_solid = z[1] > z[0] && radii.iter().all(|r| *r >= 0.0) && radii != [0.0; 2];
    match sides {
        Some(sides) if is_solid => Shape::Faces(facets::cylinder(z, radii, sides)),
        _ => Shape::Cylinder { z, radii },
    }
}

fn polyhedron(of: &Arguments) -> Result<Shape, Fault> {
    let points = of.list("points", Some(0))?.and_then(|list| list.rows_of::<3>());
    let points = points.ok_or_else(|| of.wrong("points"))?;
    let named = if of.value("faces", None).is_some() { "faces" } else { "triangles" };
    let list = of.list(named, Some(1))?.ok_or_else(|| of.wrong("faces"))?;
    let mut faces = Faces { points, ..Faces::default() };
    faces.triangles.reserve_exact(list.rows().map(|face| face.len().saturating_sub(2)).sum());
    let made = list.each_indices(&mut |face| {
        let corners = face.iter().map(|at| faces.points.get(*at as usize).copied());
        let corners = corners.collect::<Option<Vec<_>>>()?;
        match cut_polygon(&corners) {
            Some(cut) => faces.triangles.extend(cut.iter().map(|t| t.map(|at| face[at as usize]))),
            None => facets::fan(&mut faces.triangles, face),
        }
        Some(())
    });
    made.ok_or_else(|| of.wrong("faces"))?;
    Ok(Shape::Faces(faces))
}

/// Memory of a shape made of lists of points, without the lists, and of its making.
pub(super) fn made_bytes(of: &Arguments) -> u64 {
    let rows = |name, place| match of.list(name, place) {
        Ok(Some(list)) => (list.numbers.len() as u64, list.ends.len() as u64),
        _ => (0, 0),
    };
    let (points, _) = rows("points", Some(0));
    match of.module.as_str() {
        "polyhedron" => {
            let (corners, faces) =
                ["faces", "triangles"].map(|name| rows(name, Some(1))).into_iter().max().unwrap_or_default();
            points * 8 + corners.saturating_sub(2 * faces) * 12
        }
        // Two rings of points, walls and caps; and the outlines.
        "polygon" => points * (8 + 24 + 24 + 8 + 16),
        _ => 0,
    }
}

fn heights(of: &Arguments) -> Result<[f64; 2], Fault> {
    let straight = of.number("twist", None)?.unwrap_or(0.0) == 0.0
        && of.numbers::<2>("scale", None)?.is_none_or(|scale| scale == [1.0; 2]);
    let direction = of.numbers::<3>("v", None)?;
    let upwards = direction.is_none_or(|v| v[0] == 0.0 && v[1] == 0.0 && v[2] > 0.0);
    if !straight || !upwards {
        return Err(bad!(
            "{}linear_extrude with twist, scale or a slanted direction is not supported; leave them out",
            At(of.line)
        ));
    }
    // Without a height the direction's length is taken.
    let height = of.number("height", Some(0))?.unwrap_or(direction.map_or(100.0, |v| v[2]));
    let start = if of.flag("center", None)? { -height / 2.0 } else { 0.0 };
    Ok([start, start + height])
}

/// A flat shape between two heights.
fn flat(of: &Arguments, z: [f64; 2]) -> Result<Shape, Fault> {
    Ok(match of.module.as_str() {
        "square" => {
            let size = of.numbers::<2>("size", Some(0))?.unwrap_or([1.0; 2]);
            let low = if of.flag("center", Some(1))? { size.map(|s| -s / 2.0) } else { [0.0; 2] };
            let high = [low[0] + size[0], low[1] + size[1], z[1]];
            Shape::Cuboid { low: [low[0], low[1], z[0]], high }
        }
        "circle" => {
            let radius = radius(of, "r", "d", Some(0))?.unwrap_or(1.0);
            upright(z, [radius; 2], sides(of))
        }
        _ => {
            let points = of.list("points", Some(0))?.and_then(|list| list.rows_of::<2>());
            let points = points.ok_or_else(|| of.wrong("points"))?;
            let paths = match of.list("paths", Some(1))? {
                None => vec![points],
                Some(paths) => {
                    let paths = paths.indices().ok_or_else(|| of.wrong("paths"))?;
                    let point = |at: &u32| points.get(*at as usize).copied();
                    let path = |path: &Vec<u32>| path.iter().map(point).collect::<Option<Vec<_>>>();
                    paths.iter().map(path).collect::<Option<_>>().ok_or_else(|| of.wrong("paths"))?
                }
            };
            if z[0] < z[1] {
                Shape::Faces(facets::prism(&paths, z))
            } else {
                // An empty solid, or one that is refused where it is placed.
                Shape::Cuboid { low: [0.0; 3], high: [1.0, 1.0, z[1] - z[0]] }
            }
        }
    })
}

/// A file in the folder of the text, or below it: a text of foreign origin must not make the program read any file it
/// names.
fn beside(name: &str, folder: &Path) -> Result<PathBuf, Fault> {
    let path = Path::new(name.trim());
    let inside = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !inside || path.as_os_str().is_empty() || name.contains('\0') {
        let name: String = name.chars().take(200).collect();
        return Err(bad!(
            "names `{}`, which lies outside of its folder; put the file beside it or in a folder below",
            shown(&name)
        ));
    }
    Ok(folder.join(path))
}
