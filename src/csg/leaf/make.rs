//! Placement of a shape as a leaf, by an affine.

use super::curved::tube_parts;
use super::{Ball, Block, Body, Curved, Half, Leaf, Round};
use crate::csg::facets;
use crate::csg::fault::{bad_size, singular, too_far};
use crate::csg::offset::MAX_TUBE;
use crate::csg::place::{point, whole};
use crate::csg::tree::Shape;
use crate::fault::Fault;
use crate::geom::{Affine, cross, dot};

/// Tolerance of squared lengths and dot products of a sphere's axes, as a part of the squared length.
const ROUND: f64 = 1e-10;
/// The largest part of a half-space's normal.
const NORMAL: f64 = (1 << 28) as f64;

/// Places a shape that is not read from a file; `to_lattice` is the affine of the tree and the grid together.
///
/// # Errors
/// Sizes that make no sense, an affine that is singular, or a place beyond the lattice.
pub(in crate::csg) fn place(shape: &Shape, to_lattice: &Affine, line: u64) -> Result<Leaf, Fault> {
    let m = to_lattice;
    let columns = [m.column(0), m.column(1), m.column(2)];
    let volume = dot(columns[0], cross(columns[1], columns[2]));
    let cell: f64 = columns.iter().map(|c| dot(*c, *c).sqrt()).product();
    let finite = m.rows.iter().flatten().all(|c| c.is_finite());
    if !finite || !cell.is_finite() || volume.abs() <= 1e-12 * cell {
        return Err(singular(line));
    }
    let size = |sizes: &[f64]| match sizes {
        sizes if sizes.iter().any(|s| !s.is_finite() || *s < 0.0) => Err(bad_size(line)),
        sizes => Ok(sizes.contains(&0.0)),
    };
    let axis = |k: usize, length: f64| point(columns[k].map(|c| c * length), line);
    match shape {
        Shape::Cuboid { low, high } => {
            if size(&[0, 1, 2].map(|k| high[k] - low[k]))? {
                return Ok(Leaf::Nothing);
            }
            if !along_axes(&columns) {
                return slanted(*low, *high, m, line);
            }
            let (a, b) = (point(m.apply(*low), line)?, point(m.apply(*high), line)?);
            let low = [0, 1, 2].map(|k| a[k].min(b[k]));
            Ok(Leaf::Block(Box::new(Block { low, high: [0, 1, 2].map(|k| a[k].max(b[k])) })))
        }
        Shape::Ellipsoid { radii } => {
            if size(radii)? {
                return Ok(Leaf::Nothing);
            }
            let middle = point(m.origin(), line)?;
            let axes = [0, 1, 2].map(|k| columns[k].map(|c| c * radii[k]));
            if let Some(radius) = round(&axes) {
                let radius = narrow(whole(radius, line)?, line)?;
                let [x, y, z] = middle;
                let middle = [narrow(x, line)?, narrow(y, line)?, narrow(z, line)?];
                return Ok(Leaf::Ball(Ball { middle, radius }));
            }
            let axes = [axis(0, radii[0])?, axis(1, radii[1])?, axis(2, radii[2])?];
            Ok(curved(middle, axes, Round::Ellipsoid))
        }
        Shape::Cylinder { z, radii } => {
            let widest = radii[0].max(radii[1]);
            size(radii)?;
            if size(&[z[1] - z[0], widest])? {
                return Ok(Leaf::Nothing);
            }
            let low = point(m.apply([0.0, 0.0, z[0]]), line)?;
            let high = point(m.apply([0.0, 0.0, z[1]]), line)?;
            let axes = [axis(0, widest)?, axis(1, widest)?, [0, 1, 2].map(|k| high[k] - low[k])];
            #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "at most 2^20")]
            let parts = radii.map(|r| (r / widest * super::curved::RATIO as f64).round_ties_even() as i64);
            Ok(curved(low, axes, Round::Cylinder(parts)))
        }
        Shape::Torus { major, minor } => {
            if size(&[*major, *minor])? {
                return Ok(Leaf::Nothing);
            }
            if *minor > MAX_TUBE * major {
                return Err(bad_size(line));
            }
            let axes = [axis(0, *major)?, axis(1, *major)?, axis(2, *major)?];
            Ok(curved(point(m.origin(), line)?, axes, Round::Torus(tube_parts(minor / major))))
        }
        Shape::HalfSpace { normal, offset } => {
            let length = dot(*normal, *normal).sqrt();
            if !length.is_normal() || !offset.is_finite() {
                return Err(bad_size(line));
            }
            let unit = normal.map(|c| c / length);
            let on_it = point(m.apply(unit.map(|c| c * offset)), line)?;
            // Normals are turned by the cofactors, which take the sign of the volume.
            let of = |k: usize| cross(columns[(k + 1) % 3], columns[(k + 2) % 3]);
            let cofactors = [of(0), of(1), of(2)];
            let placed: [f64; 3] =
                [0, 1, 2].map(|k| (0..3).map(|j| cofactors[j][k] * unit[j]).sum::<f64>() * volume.signum());
            let largest = placed.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
            if !largest.is_normal() {
                return Err(singular(line));
            }
            #[expect(clippy::cast_possible_truncation, reason = "at most 2^28")]
            let normal = placed.map(|c| (c / largest * NORMAL).round_ties_even() as i64);
            let bound = (0..3).map(|k| normal[k] * on_it[k]).sum();
            Ok(Leaf::Half(Box::new(Half { normal, bound })))
        }
        Shape::Faces(faces) => body(faces, m, line),
        Shape::Mesh { .. } | Shape::Volume { .. } => Ok(Leaf::Nothing),
    }
}

fn narrow(of: i64, line: u64) -> Result<i32, Fault> {
    i32::try_from(of).map_err(|_| too_far(line))
}

fn curved(middle: [i64; 3], axes: [[i64; 3]; 3], round: Round) -> Leaf {
    Curved::new(middle, axes, round).map_or(Leaf::Nothing, |curved| Leaf::Curved(Box::new(curved)))
}

fn body(faces: &super::super::tree::Faces, m: &Affine, line: u64) -> Result<Leaf, Fault> {
    Ok(Leaf::Body(Box::new(Body::new(faces, m, line)?)))
}

/// A box at an angle: one corner and three edges are rounded, so that opposite faces stay parallel and plane.
fn slanted(low: [f64; 3], high: [f64; 3], m: &Affine, line: u64) -> Result<Leaf, Fault> {
    let first = point(m.apply(low), line)?;
    let mut edges = [[0; 3]; 3];
    for (k, edge) in edges.iter_mut().enumerate() {
        let mut corner = low;
        corner[k] = high[k];
        let end = point(m.apply(corner), line)?;
        *edge = [0, 1, 2].map(|j| end[j] - first[j]);
    }
    let unit = facets::cuboid([0.0; 3], [1.0; 3]);
    let placed = |p: &[f64; 3]| {
        [0, 1, 2].map(|j| first[j] + (0..3).filter(|k| p[*k] > 0.5).map(|k| edges[k][j]).sum::<i64>())
    };
    let points: Vec<[i64; 3]> = unit.points.iter().map(placed).collect();
    Ok(Leaf::Body(Box::new(Body::of_points(&points, &unit, line)?)))
}

/// True if every axis runs along one of the lattice.
pub(in crate::csg) fn along_axes(columns: &[[f64; 3]; 3]) -> bool {
    columns.iter().all(|column| column.iter().filter(|c| **c != 0.0).count() == 1)
}

/// The length of three axes that are as long as each other and at right angles.
pub(in crate::csg) fn round(axes: &[[f64; 3]; 3]) -> Option<f64> {
    let squared = dot(axes[0], axes[0]);
    let near = |a: usize, b: usize, of: f64| (dot(axes[a], axes[b]) - of).abs() <= ROUND * squared;
    let same = near(1, 1, squared) && near(2, 2, squared);
    (same && near(0, 1, 0.0) && near(1, 2, 0.0) && near(2, 0, 0.0)).then(|| squared.sqrt())
}
