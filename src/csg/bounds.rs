//! Bounds of a tree: the box in mm that a grid is put around.

use super::fault::At;
use super::normal_form::{Kind, NormalForm, Part, PlacedShape, Stop};
use super::tree::{NodeId, Shape, Tree};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::mesh::Bounds;

/// Every point.
const ALL: Bounds = Bounds { low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] };

fn both(a: &Bounds, b: &Bounds) -> Bounds {
    let at = |k: usize| (a.low[k].max(b.low[k]), a.high[k].min(b.high[k]));
    let sides = [at(0), at(1), at(2)];
    if sides.iter().any(|(low, high)| low > high) {
        return Bounds::EMPTY;
    }
    Bounds { low: sides.map(|s| s.0), high: sides.map(|s| s.1) }
}

pub(super) fn corners(low: [f64; 3], high: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
    (0..8_u32).map(move |at| [0, 1, 2].map(|k| if at >> k & 1 == 1 { high[k] } else { low[k] }))
}

fn either(a: &Bounds, b: &Bounds) -> Bounds {
    Bounds {
        low: [0, 1, 2].map(|k| a.low[k].min(b.low[k])),
        high: [0, 1, 2].map(|k| a.high[k].max(b.high[k])),
    }
}

/// Bounds of a placed leaf, or of its complement; `file` gives the bounds of a file.
pub(super) fn of_leaf(placed: &PlacedShape<'_, '_>, file: Option<Bounds>) -> Bounds {
    match (placed.shape, placed.negated) {
        (None, false) => Bounds::EMPTY,
        (None, true) => ALL,
        (Some(shape), true) => beside(shape, placed.affine),
        (Some(Shape::Mesh { .. } | Shape::Volume { .. }), false) => file.unwrap_or(ALL),
        (Some(shape), false) => of_shape(shape, placed.affine),
    }
}

/// Bounds of a flat tree of bounds.
pub(super) fn of_tree(flat: &NormalForm<Bounds>) -> Bounds {
    let (parts, starts) = flat.parts_by_join();
    // Joins stand before their parts.
    let mut joins = vec![Bounds::EMPTY; flat.joins.len()];
    for join in (0..flat.joins.len()).rev() {
        let own = &parts[starts[join] as usize..starts[join + 1] as usize];
        let of = |part: &Part| match part {
            Part::Join(below) => joins[*below as usize],
            Part::Leaf { leaf, .. } => flat.leaves[*leaf as usize],
        };
        joins[join] = match flat.joins[join] {
            Kind::And => own.iter().map(of).fold(ALL, |a, b| both(&a, &b)),
            Kind::Or => own.iter().map(of).fold(Bounds::EMPTY, |a, b| either(&a, &b)),
        };
    }
    joins[0]
}

/// New size of a stretched solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewSize {
    /// New size along each axis; 0 keeps the old one.
    pub(super) size: [f64; 3],
    /// Axes without a size of their own that are stretched by the same factor as the longest new side.
    pub(super) auto: [bool; 3],
}

impl NewSize {
    fn place(&self, bounds: &Bounds) -> Affine {
        let own: [f64; 3] = std::array::from_fn(|k| {
            let side = bounds.high[k] - bounds.low[k];
            if self.size[k] > 0.0 && side > 0.0 { self.size[k] / side } else { 1.0 }
        });
        let longest = (0..3).fold(0, |most, k| if self.size[k] > self.size[most] { k } else { most });
        let is_auto = |k: usize| self.auto[k] && self.size[k] == 0.0;
        Affine::from_spacing(std::array::from_fn(|k| if is_auto(k) { own[longest] } else { own[k] }))
    }
}

impl Tree {
    /// The affine that stretches a node to a size; `None` where finding it takes more than `most_bytes`.
    ///
    /// # Errors
    /// The size of the node does not follow from its parts: it is an intersection, cut at an end, or read from files.
    pub(super) fn resized(
        &self,
        node: NodeId,
        size: &NewSize,
        line: u64,
        most_bytes: u64,
    ) -> Result<Option<Affine>, Fault> {
        let unknown = || {
            bad!(
                "{}resize is read of solids whose size is that of their parts, not of intersections, of what is cut at an end, nor of files; use scale, or make a mesh of it with openscad -o part.stl part.scad",
                At(line)
            )
        };
        let (mut whole, mut cut) = (Bounds::EMPTY, Bounds::EMPTY);
        let flat = NormalForm::new((self, node), Affine::from_spacing([1.0; 3]), most_bytes, &mut |placed| {
            let own = placed.shape.map_or(Bounds::EMPTY, |shape| of_shape(shape, placed.affine));
            let out = if placed.negated { &mut cut } else { &mut whole };
            *out = either(out, &own);
            Ok(((), 0))
        });
        let flat = match flat {
            Ok(flat) => flat,
            Err(Stop::Fault(fault)) => return Err(fault),
            Err(Stop::Memory { .. }) => return Ok(None),
            Err(Stop::Build(_)) => return Err(unknown()),
        };
        let (parts, starts) = flat.parts_by_join();
        // Joins stand before their parts.
        let mut solid = vec![false; flat.joins.len()];
        let mut crossed = false;
        for join in (0..flat.joins.len()).rev() {
            let own = &parts[starts[join] as usize..starts[join + 1] as usize];
            let is_solid = |part: &&Part| match part {
                Part::Join(below) => solid[*below as usize],
                Part::Leaf { negated, .. } => !negated,
            };
            let count = own.iter().filter(is_solid).count();
            crossed |= flat.joins[join] == Kind::And && count > 1
                || flat.joins[join] == Kind::Or && count > 0 && count < own.len();
            solid[join] = count > 0;
        }
        let within =
            |k: usize| cut.low[k] > cut.high[k] || cut.low[k] > whole.low[k] && cut.high[k] < whole.high[k];
        let sound = whole.low.iter().chain(&whole.high).all(|c| c.is_finite());
        if crossed || !sound || !(0..3).all(within) { Err(unknown()) } else { Ok(Some(size.place(&whole))) }
    }
}

/// Bounds of a half-space; only one across an axis has any.
fn half(normal: [f64; 3], offset: f64, affine: &Affine, side: f64) -> Bounds {
    let mut bounds = ALL;
    let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
    let is_straight = |m: &[f64; 3]| m.iter().filter(|c| **c != 0.0).count() == 1;
    let columns = [affine.column(0), affine.column(1), affine.column(2)];
    if !is_straight(&normal) || !columns.iter().all(is_straight) {
        return bounds;
    }
    let unit = normal.map(|c| c / length);
    let (at, way) = (affine.apply(unit.map(|c| c * offset)), affine.apply_vector(unit));
    for axis in 0..3 {
        if side * way[axis] > 0.0 {
            bounds.high[axis] = at[axis];
        } else if side * way[axis] < 0.0 {
            bounds.low[axis] = at[axis];
        }
    }
    bounds
}

/// Bounds of the complement of a shape.
fn beside(shape: &Shape, affine: &Affine) -> Bounds {
    match shape {
        Shape::HalfSpace { normal, offset } => half(*normal, *offset, affine, -1.0),
        _ => ALL,
    }
}

fn of_shape(shape: &Shape, affine: &Affine) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    // Round shapes: the middle, and the reach of the axes along each direction.
    let mut round = |middle: [f64; 3], axes: [f64; 3], together: usize| {
        let middle = affine.apply(middle);
        let reach = |k: usize| {
            let along = |j: usize| affine.rows[k][j] * axes[j];
            let disc = (0..together).map(|j| along(j).powi(2)).sum::<f64>().sqrt();
            disc + (together..3).map(|j| along(j).abs()).sum::<f64>()
        };
        let reach = [reach(0), reach(1), reach(2)];
        for side in [-1.0, 1.0] {
            bounds.add([0, 1, 2].map(|k| middle[k] + side * reach[k]));
        }
    };
    match shape {
        Shape::Ellipsoid { radii } => round([0.0; 3], *radii, 3),
        Shape::Cylinder { z, radii } => {
            for (z, radius) in z.iter().zip(radii) {
                round([0.0, 0.0, *z], [*radius, *radius, 0.0], 2);
            }
        }
        Shape::Torus { major, minor } => {
            let along = |k: usize| affine.rows[k][2].abs();
            let reach: [f64; 3] = std::array::from_fn(|k| {
                let ring = (affine.rows[k][0].powi(2) + affine.rows[k][1].powi(2)).sqrt();
                let tube = (ring.powi(2) + along(k).powi(2)).sqrt();
                ring * major + tube * minor
            });
            let middle = affine.origin();
            for side in [-1.0, 1.0] {
                bounds.add([0, 1, 2].map(|k| middle[k] + side * reach[k]));
            }
        }
        Shape::Cuboid { low, high } => {
            corners(*low, *high).for_each(|corner| bounds.add(affine.apply(corner)));
        }
        Shape::HalfSpace { normal, offset } => return half(*normal, *offset, affine, 1.0),
        Shape::Faces(faces) => faces.points.iter().for_each(|p| bounds.add(affine.apply(*p))),
        Shape::Mesh { .. } | Shape::Volume { .. } => return ALL,
    }
    bounds
}
