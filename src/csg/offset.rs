//! Solids grown and shrunk by a distance: all points within it of a solid, or deeper than it inside.
//!
//! ```text
//! grow(a or b)  = grow a or grow b          shrink(a and b) = shrink a and shrink b
//! grow(not a)   = not shrink a              shrink(not a)   = not grow a
//! ```
//!
//! So a tree is offset leaf by leaf, exactly, as far as these rules lead. Everything else is refused: a grown
//! intersection or difference, and a shrunk union, are not made of grown or shrunk parts.
//!
//! | leaf | grown by r | shrunk by r |
//! |---|---|---|
//! | sphere, torus, half-space | the same, larger | the same, smaller |
//! | box | three boxes, a cylinder along every edge, a sphere at every corner | a smaller box |
//! | cylinder, cone | five of them, and a torus along every rim, or a sphere at a tip | a smaller one |
//!
//! Leaves may be turned, mirrored and scaled evenly; boxes and half-spaces along their own axes by any factors,
//! cylinders and cones along theirs. Every part is placed on the lattice by itself, so that a rounded edge is off by a
//! step of 2^-12 voxel at most.

use super::bounds::corners;
use super::normal_form::MAX_LEAVES;
use super::tree::{Node, NodeId, Operation, Shape, Tree};
use crate::csg::fault::{At, bad_size, singular, too_many};
use crate::fault::{Fault, bad};
use crate::geom::Affine;

/// Relative difference below which lengths are the same, and angles right.
const SAME: f64 = 1e-10;
/// Largest ratio of a tube's radius to its ring's.
pub(super) const MAX_TUBE: f64 = 16.0;

/// A step of the work that is left.
enum Task {
    Visit { node: NodeId, affine: Affine, by: f64 },
    Join { operation: Operation, count: usize },
}

/// The pieces of a solid that was shrunk away.
const NOTHING: &[Piece] = &[];

/// A part of an offset leaf.
#[derive(Clone, Debug)]
struct Piece {
    shape: Shape,
    at: Affine,
}

impl Piece {
    fn new(shape: Shape) -> Self {
        Self { shape, at: Affine::from_spacing([1.0; 3]) }
    }

    fn moved(shape: Shape, to: [f64; 3]) -> Self {
        Self { shape, at: moved_to(to) }
    }
}

pub(super) fn moved_to(to: [f64; 3]) -> Affine {
    let mut at = Affine::from_spacing([1.0; 3]);
    (0..3).for_each(|k| at.rows[k][3] = to[k]);
    at
}

fn ball(radius: f64) -> Shape {
    Shape::Ellipsoid { radii: [radius; 3] }
}

impl Tree {
    /// A node grown by a distance, or shrunk by a negative one, in the units of its coordinates.
    ///
    /// Spheres, boxes, cylinders, cones, tori and half-spaces, turned, mirrored and scaled evenly, and their unions,
    /// intersections, differences and complements as long as the result stays exact: unions may grow, intersections and
    /// differences may shrink. A grown solid has rounded edges. A shell is the difference of a grown solid and the
    /// solid.
    ///
    /// # Errors
    /// Refused by name for anything else, and for a distance or sizes that are not numbers.
    ///
    /// # Panics
    /// The node is of another tree.
    pub fn offset(&mut self, by: f64, node: NodeId) -> Result<NodeId, Fault> {
        self.check(node);
        let made = self.offset_within(by, node, 0, u64::MAX)?;
        made.ok_or(too_many())
    }

    /// Like [`Tree::offset`]; `None` where the tree would take more than `most_bytes`.
    pub(super) fn offset_within(
        &mut self,
        by: f64,
        node: NodeId,
        line: u64,
        most_bytes: u64,
    ) -> Result<Option<NodeId>, Fault> {
        if !by.is_finite() {
            return Err(bad_size(line));
        }
        if by == 0.0 {
            return Ok(Some(node));
        }
        let first = self.len();
        let mut tasks = vec![Task::Visit { node, affine: Affine::from_spacing([1.0; 3]), by }];
        let mut made: Vec<NodeId> = Vec::new();
        while let Some(task) = tasks.pop() {
            if self.bytes() + (tasks.len() * size_of::<Task>()) as u64 > most_bytes {
                return Ok(None);
            }
            if self.len() - first > 4 * MAX_LEAVES || tasks.len() > 4 * MAX_LEAVES {
                return Err(too_many());
            }
            let (node, affine, by) = match task {
                Task::Join { operation, count } => {
                    let parts = made.split_off(made.len().saturating_sub(count));
                    made.push(self.join(operation, &parts));
                    continue;
                }
                Task::Visit { node, affine, by } => (node, affine, by),
            };
            let below = match &self.nodes[node.0 as usize] {
                Node::Placed { at, node } => Some((affine.after(&at.0), *node)),
                Node::Moved { at, node } => Some((affine.after(&moved_to(at.0)), *node)),
                Node::Leaf { .. } | Node::Joined { .. } => None,
            };
            if let Some((affine, node)) = below {
                tasks.push(Task::Visit { node, affine, by });
                continue;
            }
            if let Node::Joined { operation, first, count } = self.nodes[node.0 as usize] {
                let children = &self.children[first as usize..][..count as usize];
                let exact = count < 2
                    || match operation {
                        Operation::Union => by > 0.0,
                        Operation::Intersection | Operation::Difference | Operation::Complement => by < 0.0,
                    };
                if !exact {
                    let fault = if by > 0.0 {
                        "an intersection, difference or complement of several parts to grow it"
                    } else {
                        "a union of several parts to shrink it"
                    };
                    return Err(no_offset(line, fault));
                }
                tasks.push(Task::Join { operation, count: children.len() });
                for (at, child) in children.iter().enumerate().rev() {
                    let turned = match operation {
                        Operation::Union | Operation::Intersection => false,
                        Operation::Difference => at > 0,
                        Operation::Complement => true,
                    };
                    tasks.push(Task::Visit { node: *child, affine, by: if turned { -by } else { by } });
                }
                continue;
            }
            let (pieces, at) = match &self.nodes[node.0 as usize] {
                Node::Leaf { shape, line: own } => {
                    let line = if *own > 0 { (*own).into() } else { line };
                    of_leaf(shape, &affine, by, line)?
                }
                _ => (NOTHING.to_vec(), affine),
            };
            let mut parts = Vec::with_capacity(pieces.len());
            for Piece { shape, at: own } in pieces {
                let leaf = self.leaf_of_line(shape, line);
                parts.push(self.placed_of_line(at.after(&own), leaf, line));
            }
            made.push(if parts.len() == 1 { parts[0] } else { self.join(Operation::Union, &parts) });
        }
        Ok(made.pop())
    }
}

fn no_offset(line: u64, solid: &str) -> Fault {
    bad!(
        "{}offset3d does not take {solid}; it grows and shrinks spheres, boxes, cylinders, cones, tori and half-spaces that are not stretched, grows unions of them, and shrinks their intersections and differences",
        At(line)
    )
}

/// The pieces of an offset leaf, in coordinates that the affine places without stretching.
fn of_leaf(shape: &Shape, affine: &Affine, by: f64, line: u64) -> Result<(Vec<Piece>, Affine), Fault> {
    let refused = |fault| Err(no_offset(line, fault));
    let sound = |sizes: &[f64]| {
        if sizes.iter().all(|s| s.is_finite() && *s >= 0.0) { Ok(()) } else { Err(bad_size(line)) }
    };
    if let Shape::HalfSpace { normal, offset } = shape {
        let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        let Some(inverse) = affine.inverse() else { return Err(singular(line)) };
        if !length.is_normal() || !offset.is_finite() {
            return Err(bad_size(line));
        }
        // Change of offset . normal with a step of 1 where the half-space lies.
        let slope = |k: usize| (0..3).map(|j| inverse.rows[j][k] * normal[j] / length).sum::<f64>();
        let slope = [slope(0), slope(1), slope(2)].iter().map(|c| c * c).sum::<f64>().sqrt();
        let moved = Shape::HalfSpace { normal: *normal, offset: offset + by * slope };
        return Ok((vec![Piece::new(moved)], *affine));
    }
    let Some((scale, rigid)) = split(affine) else { return refused("a solid that is stretched or sheared") };
    let same = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
    let evenly = same(scale[0], scale[1]) && same(scale[1], scale[2]);
    let pieces = match shape {
        Shape::Ellipsoid { radii } => {
            sound(radii)?;
            let radii: [f64; 3] = std::array::from_fn(|k| radii[k] * scale[k]);
            if !(same(radii[0], radii[1]) && same(radii[1], radii[2])) {
                return refused("an ellipsoid");
            }
            let radius = radii[0] + by;
            if radii[0] > 0.0 && radius > 0.0 { vec![Piece::new(ball(radius))] } else { Vec::new() }
        }
        Shape::Cuboid { low, high } => {
            let low: [f64; 3] = std::array::from_fn(|k| low[k] * scale[k]);
            let high: [f64; 3] = std::array::from_fn(|k| high[k] * scale[k]);
            sound(&[0, 1, 2].map(|k| high[k] - low[k]))?;
            if (0..3).any(|k| low[k] == high[k]) { Vec::new() } else { cuboid(low, high, by) }
        }
        Shape::Torus { .. } if !evenly => return refused("a solid that is stretched or sheared"),
        Shape::Torus { major, minor } => {
            let (major, minor) = (major * scale[0], minor * scale[0]);
            sound(&[major, minor])?;
            match minor + by {
                _ if major == 0.0 || minor == 0.0 => Vec::new(),
                tube if tube <= 0.0 => Vec::new(),
                tube if tube > MAX_TUBE * major => {
                    return refused("a rim that would become wider than 16 of its radii");
                }
                tube => vec![Piece::new(Shape::Torus { major, minor: tube })],
            }
        }
        Shape::Cylinder { .. } if !same(scale[0], scale[1]) => {
            return refused("a solid that is stretched or sheared");
        }
        Shape::Cylinder { z, radii } => {
            let (z, radii) = (z.map(|z| z * scale[2]), radii.map(|r| r * scale[0]));
            sound(&[z[1] - z[0], radii[0], radii[1]])?;
            if z[0] == z[1] || radii == [0.0; 2] {
                Vec::new()
            } else if by < 0.0 {
                shrunk_cone(z, radii, -by)
            } else if radii.iter().any(|r| *r > 0.0 && by > MAX_TUBE * r) {
                return refused("a rim that would become wider than 16 of its radii");
            } else {
                grown_cone(z, radii, by)
            }
        }
        Shape::Faces(_) => return refused("a solid of facets (a polyhedron, a prism, or $fn)"),
        Shape::Mesh { .. } => return refused("a mesh"),
        Shape::Volume { .. } => return refused("a volume"),
        Shape::HalfSpace { .. } => Vec::new(),
    };
    Ok((pieces, rigid))
}

/// An affine as lengths along its axes, and the rest, which neither stretches nor shears; `None` if its axes do not
/// stand at right angles.
fn split(affine: &Affine) -> Option<([f64; 3], Affine)> {
    let columns = [0, 1, 2].map(|k| affine.column(k));
    let dot = |a: usize, b: usize| (0..3).map(|k| columns[a][k] * columns[b][k]).sum::<f64>();
    let lengths = [0, 1, 2].map(|k| dot(k, k).sqrt());
    let square = |a: usize, b: usize| dot(a, b).abs() <= SAME * lengths[a] * lengths[b];
    let sound = lengths.iter().all(|length| length.is_normal());
    let mut rigid = *affine;
    for row in &mut rigid.rows {
        row.iter_mut().zip(lengths).for_each(|(c, length)| *c /= length);
    }
    (sound && square(0, 1) && square(1, 2) && square(2, 0)).then_some((lengths, rigid))
}

fn cuboid(low: [f64; 3], high: [f64; 3], by: f64) -> Vec<Piece> {
    if by < 0.0 {
        let (low, high) = (low.map(|c| c - by), high.map(|c| c + by));
        let is_left = (0..3).all(|k| low[k] < high[k]);
        return if is_left { vec![Piece::new(Shape::Cuboid { low, high })] } else { Vec::new() };
    }
    let mut pieces = Vec::with_capacity(23);
    for axis in 0..3 {
        let (mut longer_low, mut longer_high) = (low, high);
        longer_low[axis] -= by;
        longer_high[axis] += by;
        pieces.push(Piece::new(Shape::Cuboid { low: longer_low, high: longer_high }));
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        for edge in 0..4_u32 {
            // The cylinder's axes become p, q and the box's axis.
            let mut at = Affine { rows: [[0.0; 4]; 3] };
            (at.rows[p][0], at.rows[q][1], at.rows[axis][2]) = (1.0, 1.0, 1.0);
            at.rows[p][3] = if edge & 1 == 1 { high[p] } else { low[p] };
            at.rows[q][3] = if edge & 2 == 2 { high[q] } else { low[q] };
            let shape = Shape::Cylinder { z: [low[axis], high[axis]], radii: [by; 2] };
            pieces.push(Piece { shape, at });
        }
    }
    pieces.extend(corners(low, high).map(|corner| Piece::moved(ball(by), corner)));
    pieces
}

/// A cylinder or cone whose points lie at least by that distance within the original.
fn shrunk_cone(z: [f64; 2], radii: [f64; 2], by: f64) -> Vec<Piece> {
    let slope = (radii[1] - radii[0]) / (z[1] - z[0]);
    let inwards = by * (1.0 + slope * slope).sqrt();
    let radius = |at: f64| radii[0] + (at - z[0]) * slope - inwards;
    let mut ends = [z[0] + by, z[1] - by];
    let mut rims = ends.map(radius);
    if ends[0] >= ends[1] || rims.iter().all(|r| *r <= 0.0) {
        return Vec::new();
    }
    for (end, rim) in ends.iter_mut().zip(&mut rims) {
        if *rim < 0.0 {
            // The cone ends in a tip before its rim.
            *end = z[0] + (inwards - radii[0]) / slope;
            *rim = 0.0;
        }
    }
    if ends[0] < ends[1] { vec![Piece::new(Shape::Cylinder { z: ends, radii: rims })] } else { Vec::new() }
}

/// The sum of a cylinder or cone and a ball: itself with its two ends and its side moved outwards, a cone that joins
/// the moved side to the nearer rim, and tubes along the rims.
fn grown_cone(z: [f64; 2], radii: [f64; 2], by: f64) -> Vec<Piece> {
    let slope = (radii[1] - radii[0]) / (z[1] - z[0]);
    let steep = (1.0 + slope * slope).sqrt();
    // Out of the side: away from the axis, and along it.
    let (out, up) = (by / steep, -by * slope / steep);
    let side = radii.map(|r| r + out);
    let mut cones = vec![(z, radii), ([z[0] + up, z[1] + up], side)];
    if up > 0.0 {
        cones.push(([z[0], z[0] + up], [radii[0], side[0]]));
    } else if up < 0.0 {
        cones.push(([z[1] + up, z[1]], [side[1], radii[1]]));
    }
    if radii[0] > 0.0 {
        cones.push(([z[0] - by, z[0]], [radii[0]; 2]));
    }
    if radii[1] > 0.0 {
        cones.push(([z[1], z[1] + by], [radii[1]; 2]));
    }
    let cone = |(z, radii)| Piece::new(Shape::Cylinder { z, radii });
    let mut pieces: Vec<Piece> = cones.into_iter().map(cone).collect();
    for (z, major) in z.into_iter().zip(radii) {
        let shape = if major > 0.0 { Shape::Torus { major, minor: by } } else { ball(by) };
        pieces.push(Piece::moved(shape, [0.0, 0.0, z]));
    }
    pieces
}
