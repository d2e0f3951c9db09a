//! A tree made flat: complements pushed down to the leaves, joins of the same kind merged.
//!
//! ```text
//! difference(union(a, b), union(c, d))   becomes   and(or(a, b), not c, not d)
//! ```
//!
//! Only unions and intersections are left, which alternate, and every leaf knows its place. Nodes to be visited wait on
//! a list, so that the depth of a tree does not matter.

use super::offset::moved_to;
use super::tree::{Node, NodeId, Operation, Shape, Tree, push};
use crate::builder::BuildError;
use crate::csg::fault::{singular, too_many};
use crate::fault::{Fault, conversions};
use crate::geom::Affine;
use crate::volume::SourceError;

/// Most leaves of a tree; a leaf used again counts again.
pub(super) const MAX_LEAVES: usize = 1 << 20;
const MAX_JOINS: usize = 1 << 20;

/// Kind of join.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    And,
    Or,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// A leaf, or its complement.
    Leaf {
        leaf: u32,
        negated: bool,
    },
    Join(u32),
}

/// A leaf with its affine; without a shape it is empty.
pub(super) struct PlacedShape<'a, 'f> {
    pub(super) shape: Option<&'a Shape>,
    pub(super) affine: &'f Affine,
    pub(super) line: u64,
    /// True to select everything else.
    pub(super) negated: bool,
}

/// Function that makes a `T` of a leaf, and returns the memory that it holds outside itself.
pub(super) type Make<'a, 'm, T> = dyn FnMut(PlacedShape<'a, '_>) -> Result<(T, u64), Stop> + 'm;

/// Reason why a tree cannot be made flat.
pub(super) enum Stop {
    Fault(Fault),
    /// The tree takes more memory than there is: so many bytes up to here.
    Memory {
        bytes: u64,
    },
    /// A leaf could not be made.
    Build(BuildError),
}

conversions!(Stop {
    fault: Fault => Self::Fault(fault),
    error: BuildError => Self::Build(error),
    error: SourceError => Self::Build(error.into()),
});

/// A tree of joins, each before its parts, and the made leaves in the order of visiting.
pub(super) struct NormalForm<T> {
    pub(super) leaves: Vec<T>,
    /// Memory that leaves hold outside themselves.
    held: u64,
    pub(super) joins: Vec<Kind>,
    /// Pairs of a join and its part, in the order of the tree.
    pub(super) parts: Vec<(u32, Part)>,
}

struct Visit {
    node: NodeId,
    affine: u32,
    negated: bool,
    above: u32,
}

fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// The product of two affines.
fn placed(first: &Affine, own: &Affine, line: u64) -> Result<Affine, Fault> {
    let placed = first.after(own);
    let sound = placed.rows.iter().flatten().all(|c| c.is_finite());
    if sound { Ok(placed) } else { Err(singular(line)) }
}

impl<T> NormalForm<T> {
    /// The flat tree below a node, within `most_bytes`. The first join is its root. `make` turns every leaf into a `T`,
    /// and returns the memory that it holds outside itself.
    ///
    /// # Errors
    /// Too many leaves, affines that are not numbers, too little memory, or the errors of `make`.
    pub(super) fn new<'a>(
        (tree, root): (&'a Tree, NodeId),
        first: Affine,
        most_bytes: u64,
        make: &mut Make<'a, '_, T>,
    ) -> Result<Self, Stop> {
        let mut flat = Self { leaves: Vec::new(), held: 0, joins: vec![Kind::Or], parts: Vec::new() };
        // Depth first: affines behind the current one are not needed any more.
        let mut affines = vec![first];
        let mut open = vec![Visit { node: root, affine: 0, negated: false, above: 0 }];
        let too_many = too_many();
        while let Some(Visit { node, affine, negated, above }) = open.pop() {
            if flat.leaves.len().max(flat.joins.len()) >= MAX_LEAVES || open.len() > 4 * MAX_JOINS {
                return Err(too_many.into());
            }
            let open_bytes = open.capacity() * size_of::<Visit>() + affines.capacity() * size_of::<Affine>();
            flat.hold(open_bytes as u64, most_bytes)?;
            affines.truncate(affine as usize + 1);
            let above_it = &affines[affine as usize];
            let mut leaf = |flat: &mut Self, shape, line, negated| {
                let (made, held) = make(PlacedShape { shape, affine: above_it, line, negated })?;
                flat.held += held;
                flat.leaf(made, negated, above);
                Ok::<_, Stop>(())
            };
            match &tree.nodes[node.0 as usize] {
                Node::Leaf { shape, line } => leaf(&mut flat, Some(&**shape), (*line).into(), negated)?,
                Node::Placed { at, node } => {
                    let own = placed(above_it, &at.0, at.1.into())?;
                    open.push(Visit { node: *node, affine: number(affines.len()), negated, above });
                    push(&mut affines, own);
                }
                Node::Moved { at, node } => {
                    let own = placed(above_it, &moved_to(at.0), at.1.into())?;
                    open.push(Visit { node: *node, affine: number(affines.len()), negated, above });
                    push(&mut affines, own);
                }
                Node::Joined { operation, first, count } => {
                    let children = &tree.children[*first as usize..][..*count as usize];
                    let negated = negated != (*operation == Operation::Complement);
                    if children.is_empty() {
                        leaf(&mut flat, None, 0, negated)?;
                        continue;
                    }
                    let all = matches!(operation, Operation::Intersection | Operation::Difference);
                    let kind = if all != negated { Kind::And } else { Kind::Or };
                    let above = flat.join(kind, above, children.len());
                    let is_difference = *operation == Operation::Difference;
                    for (at, child) in children.iter().enumerate().rev() {
                        let negated = negated != (is_difference && at > 0);
                        push(&mut open, Visit { node: *child, affine, negated, above });
                    }
                }
            }
        }
        flat.hold(0, most_bytes)?;
        Ok(flat)
    }

    /// Checks that there is memory for the tree and `more_bytes`.
    fn hold(&self, more_bytes: u64, most_bytes: u64) -> Result<(), Stop> {
        let bytes = self.bytes() + more_bytes;
        if bytes > most_bytes { Err(Stop::Memory { bytes }) } else { Ok(()) }
    }

    fn leaf(&mut self, made: T, negated: bool, above: u32) {
        let leaf = number(self.leaves.len());
        push(&mut self.leaves, made);
        push(&mut self.parts, (above, Part::Leaf { leaf, negated }));
    }

    /// The join to which parts are added: the one above if it is of the same kind.
    fn join(&mut self, kind: Kind, above: u32, parts: usize) -> u32 {
        if self.joins[above as usize] == kind || parts == 1 {
            return above;
        }
        let join = number(self.joins.len());
        push(&mut self.joins, kind);
        push(&mut self.parts, (above, Part::Join(join)));
        join
    }

    /// The parts of every join, one after the other, and where each begins.
    pub(super) fn parts_by_join(&self) -> (Vec<Part>, Vec<u32>) {
        let mut starts = vec![0_u32; self.joins.len() + 1];
        for (join, _) in &self.parts {
            starts[*join as usize + 1] += 1;
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        let mut next = starts.clone();
        let mut parts = vec![Part::Join(0); self.parts.len()];
        for (join, part) in &self.parts {
            let at = &mut next[*join as usize];
            parts[*at as usize] = *part;
            *at += 1;
        }
        (parts, starts)
    }

    /// Memory that it holds, and that a program made of it takes.
    fn bytes(&self) -> u64 {
        // Lists grow by an eighth.
        let lists = self.leaves.len() * (size_of::<T>() + 2 * size_of::<u32>()) * 9 / 8
            + self.joins.capacity() * 24
            + self.parts.capacity() * 2 * size_of::<(u32, Part)>();
        self.held + lists as u64
    }
}
