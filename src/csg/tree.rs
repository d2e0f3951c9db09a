//! Trees of solids: shapes, their places, and their joins.
//!
//! ```text
//! difference
//!  ├ placed(affine)
//!  │  └ sphere
//!  └ half-space
//! ```
//!
//! Nodes are made from the leaves upwards and named by [`NodeId`], so that a tree of any depth is made, walked and
//! dropped without recursion. A node may be used more than once.

use std::path::PathBuf;

use crate::geom::Affine;

/// A node of a [`Tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeId(pub(super) u32);

/// Kind of join of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// All points in one of them.
    Union,
    /// The points in all of them.
    Intersection,
    /// The first without the others.
    Difference,
    /// All points outside of them.
    Complement,
}

/// A solid in its own coordinates. Points on its surface are inside, except for [`Shape::Cuboid`] and [`Shape::Faces`],
/// which are inside as meshes are: with voxel centres moved by (-e, e^2, e^3).
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A box.
    Cuboid {
        /// Low corner.
        low: [f64; 3],
        /// High corner.
        high: [f64; 3],
    },
    /// A sphere, or an ellipsoid along the axes, around the origin.
    Ellipsoid {
        /// Half its size along each axis.
        radii: [f64; 3],
    },
    /// A cylinder or a cone around the z axis.
    Cylinder {
        /// Heights of its two ends.
        z: [f64; 2],
        /// Radii at these ends.
        radii: [f64; 2],
    },
    /// A ring around the z axis, with a round tube.
    Torus {
        /// Radius of the ring: from the origin to the middle of the tube.
        major: f64,
        /// Radius of the tube, at most 16 times the major one; a tube larger than the ring fills its hole.
        minor: f64,
    },
    /// All points p with normal . p <= offset |normal|.
    HalfSpace {
        /// Normal that points out of it.
        normal: [f64; 3],
        /// Distance of its plane from the origin along the normal.
        offset: f64,
    },
    /// A closed surface of triangles.
    Faces(Faces),
    /// A mesh in a file.
    Mesh {
        /// Path of the file.
        path: PathBuf,
    },
    /// The voxels of a volume from a value on.
    Volume {
        /// Path of the file or folder.
        path: PathBuf,
        /// Least value inside.
        iso: f64,
    },
}

/// Triangles that name their corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faces {
    /// Corners.
    pub points: Vec<[f64; 3]>,
    /// Numbers of three points each.
    pub triangles: Vec<[u32; 3]>,
    /// True if points from which a ray meets the surface an odd number of times are inside, instead of points that it
    /// winds around.
    pub odd: bool,
}

#[derive(Clone, Debug)]
pub(super) enum Node {
    /// A solid, and the line that it comes from.
    Leaf { shape: Box<Shape>, line: u32 },
    /// The children are a run of [`Tree::children`].
    Joined { operation: Operation, first: u32, count: u32 },
    /// A placed node, and the line of its placement.
    Placed { at: Box<(Affine, u32)>, node: NodeId },
    /// A node that is only moved, the usual case.
    Moved { at: Box<([f64; 3], u32)>, node: NodeId },
}

const _: () = assert!(size_of::<Node>() == 16);

/// A tree of solids, in millimetres or another unit.
///
/// ```
/// use infobyte::csg::{Operation, Shape, Tree};
///
/// let mut tree = Tree::new();
/// let ball = tree.leaf(Shape::Ellipsoid { radii: [10.0; 3] });
/// let above = tree.leaf(Shape::HalfSpace { normal: [0.0, 0.0, -1.0], offset: 0.0 });
/// let bowl = tree.join(Operation::Difference, &[ball, above]);
/// assert_eq!(tree.len(), 3);
/// # let _ = bowl;
/// ```
#[derive(Clone, Debug, Default)]
pub struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) children: Vec<NodeId>,
    /// Bytes of boxes, and of the lists of faces.
    boxed_bytes: usize,
    /// The first note on its text, and the number of others.
    note: Option<(String, u64)>,
}

impl Tree {
    /// A tree without nodes.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Nodes made so far.
    #[must_use]
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// True if no node was made.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    pub(super) fn note(&mut self, note: String) {
        match &mut self.note {
            Some((_, others)) => *others += 1,
            None => self.note = Some((note, 0)),
        }
    }

    /// A note on the text that it was read from.
    pub(crate) fn note_on_text(&self) -> Option<String> {
        self.note.as_ref().map(|(first, others)| match others {
            0 => first.clone(),
            _ => format!("{first}; so it is with {others} more"),
        })
    }

    /// A leaf. Senseless numbers of its shape are refused when the tree is built.
    pub fn leaf(&mut self, shape: Shape) -> NodeId {
        self.leaf_of_line(shape, 0)
    }

    /// Nodes joined; without nodes, nothing (its complement is everything).
    ///
    /// # Panics
    /// A node is of another tree.
    pub fn join(&mut self, operation: Operation, nodes: &[NodeId]) -> NodeId {
        nodes.iter().for_each(|node| self.check(*node));
        let first = number(self.children.len());
        if self.children.capacity() - self.children.len() < nodes.len() {
            self.children.reserve_exact(nodes.len() + grown(self.children.len()));
        }
        self.children.extend_from_slice(nodes);
        self.add(Node::Joined { operation, first, count: number(nodes.len()) })
    }

    /// A node at another place: its coordinates go through the affine, which may stretch, shear and mirror.
    ///
    /// # Panics
    /// The node is of another tree.
    pub fn placed(&mut self, affine: Affine, node: NodeId) -> NodeId {
        self.placed_of_line(affine, node, 0)
    }

    pub(super) fn leaf_of_line(&mut self, shape: Shape, line: u64) -> NodeId {
        self.boxed_bytes += boxed::<Shape>();
        if let Shape::Faces(faces) = &shape {
            self.boxed_bytes += LISTS + 24 * faces.points.capacity() + 12 * faces.triangles.capacity();
        }
        self.add(Node::Leaf { shape: Box::new(shape), line: short(line) })
    }

    pub(super) fn placed_of_line(&mut self, affine: Affine, node: NodeId, line: u64) -> NodeId {
        self.check(node);
        let [x, y, z] = affine.rows;
        let turns = [[x[0], x[1], x[2]], [y[0], y[1], y[2]], [z[0], z[1], z[2]]];
        if turns == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            self.boxed_bytes += boxed::<([f64; 3], u32)>();
            return self.add(Node::Moved { at: Box::new((affine.origin(), short(line))), node });
        }
        self.boxed_bytes += boxed::<(Affine, u32)>();
        self.add(Node::Placed { at: Box::new((affine, short(line))), node })
    }

    pub(super) fn check(&self, node: NodeId) {
        assert!((node.0 as usize) < self.nodes.len(), "a node of another tree");
    }

    fn add(&mut self, node: Node) -> NodeId {
        let id = NodeId(number(self.nodes.len()));
        push(&mut self.nodes, node);
        id
    }

    /// Files of the leaves that are read from files, in the order of the tree's making.
    pub fn files(&self) -> impl Iterator<Item = &Shape> {
        self.nodes.iter().filter_map(|node| match node {
            Node::Leaf { shape, .. } if matches!(**shape, Shape::Mesh { .. } | Shape::Volume { .. }) => {
                Some(&**shape)
            }
            _ => None,
        })
    }

    /// Approximate memory that it holds.
    pub(super) fn bytes(&self) -> u64 {
        let nodes = self.nodes.capacity() * size_of::<Node>() + self.boxed_bytes;
        (nodes + self.children.capacity() * size_of::<NodeId>()) as u64
    }
}

/// Heap bytes of a boxed value: the allocator puts 8 bytes before it, and rounds up.
pub(super) const fn boxed<T>() -> usize {
    (size_of::<T>() + 8).next_multiple_of(16)
}

/// Bytes of allocation for the two lists of faces.
const LISTS: usize = 32;

/// Adds to a list that grows by an eighth, not to twice its size: trees are the largest thing in memory while they are
/// read.
pub(super) fn push<T>(list: &mut Vec<T>, item: T) {
    if list.len() == list.capacity() {
        list.reserve_exact(grown(list.len()));
    }
    list.push(item);
}

/// Growth of a full list.
fn grown(len: usize) -> usize {
    (len / 8).max(64)
}

/// A line number in 32 bits.
fn short(line: u64) -> u32 {
    u32::try_from(line).unwrap_or(u32::MAX)
}

/// Nodes are counted in 32 bits: more do not fit into the memory that a text may take.
fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
