//! A tree made flat: complements pushed down to the leaves, joins of the same kind merged.
//!
//! ```text
//! difference(union(a, b), union(c, d))   becomes   and(or(a, b), not c, not d)
//! ```
//!
//! Only unions and intersections are left, which alternate, and every leaf knows where it lies. Done with a list of
//! what is still to be visited, so that the depth of a tree does not matter.

use super::tree::{Node, NodeId, Operation, Shape, Tree, push};
use crate::facts::CsgFault;
use crate::geom::Affine;

/// Most leaves of a tree, those counted again that are used again.
pub(super) const MOST_LEAVES: usize = 1 << 20;
/// Most joins.
const MOST_JOINS: usize = 1 << 20;

/// How the parts of a join are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    And,
    Or,
}

/// A part of a join.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// A leaf, or all but it.
    Leaf {
        leaf: u32,
        negated: bool,
    },
    Join(u32),
}

/// A leaf of the flat tree; without a shape it is empty.
#[derive(Clone, Debug)]
pub(super) struct FlatLeaf<'a> {
    pub(super) shape: Option<&'a Shape>,
    pub(super) affine: u32,
    pub(super) line: u64,
}

/// A tree of joins, each before its parts.
#[derive(Debug)]
pub(super) struct Flat<'a> {
    pub(super) leaves: Vec<FlatLeaf<'a>>,
    pub(super) affines: Vec<(Affine, u64)>,
    pub(super) joins: Vec<Kind>,
    /// Join and part, in the order of the tree.
    pub(super) parts: Vec<(u32, Part)>,
}

struct Visit {
    node: NodeId,
    affine: u32,
    negated: bool,
    /// The join above.
    above: u32,
}

fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

impl<'a> Flat<'a> {
    /// The flat tree below a node. The first join is its root.
    ///
    /// # Errors
    /// Too many leaves, or affines that are not numbers.
    pub(super) fn new(tree: &'a Tree, root: NodeId, first: Affine) -> Result<Self, CsgFault> {
        let mut flat =
            Self { leaves: Vec::new(), affines: vec![(first, 0)], joins: vec![Kind::Or], parts: Vec::new() };
        let mut open = vec![Visit { node: root, affine: 0, negated: false, above: 0 }];
        let too_many = CsgFault::TooMany { most: MOST_LEAVES as u64 };
        while let Some(Visit { node, affine, negated, above }) = open.pop() {
            if flat.leaves.len().max(flat.joins.len()) >= MOST_LEAVES || open.len() > 4 * MOST_JOINS {
                return Err(too_many);
            }
            match &tree.nodes[node.0 as usize] {
                Node::Leaf { shape, line } => flat.leaf(Some(shape), affine, *line, negated, above),
                Node::Placed { affine: own, node, line } => {
                    let affine = flat.placed(affine, own, *line)?;
                    open.push(Visit { node: *node, affine, negated, above });
                }
                Node::Moved { by, node, line } => {
                    let mut own = Affine::from_spacing([1.0; 3]);
                    (0..3).for_each(|k| own.rows[k][3] = by[k]);
                    let affine = flat.placed(affine, &own, *line)?;
                    open.push(Visit { node: *node, affine, negated, above });
                }
                Node::Joined { operation, first, count } => {
                    let children = &tree.children[*first as usize..][..*count as usize];
                    let negated = negated != (*operation == Operation::Complement);
                    if children.is_empty() {
                        flat.leaf(None, affine, 0, negated, above);
                        continue;
                    }
                    let all = matches!(operation, Operation::Intersection | Operation::Difference);
                    let kind = if all != negated { Kind::And } else { Kind::Or };
                    let above = flat.join(kind, above, children.len());
                    let is_difference = *operation == Operation::Difference;
                    for (at, child) in children.iter().enumerate().rev() {
                        let negated = negated != (is_difference && at > 0);
                        open.push(Visit { node: *child, affine, negated, above });
                    }
                }
            }
        }
        Ok(flat)
    }

    /// The number of an affine behind another one.
    fn placed(&mut self, first: u32, own: &Affine, line: u64) -> Result<u32, CsgFault> {
        let placed = self.affines[first as usize].0.after(own);
        if !placed.rows.iter().flatten().all(|c| c.is_finite()) {
            return Err(CsgFault::Singular { line });
        }
        push(&mut self.affines, (placed, line));
        Ok(number(self.affines.len() - 1))
    }

    fn leaf(&mut self, shape: Option<&'a Shape>, affine: u32, line: u64, negated: bool, above: u32) {
        let leaf = number(self.leaves.len());
        push(&mut self.leaves, FlatLeaf { shape, affine, line });
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

    /// Memory that it holds.
    pub(super) fn bytes(&self) -> u64 {
        (self.leaves.capacity() * size_of::<FlatLeaf<'_>>()
            + self.affines.capacity() * size_of::<(Affine, u64)>()
            + self.joins.capacity() * 24
            + self.parts.capacity() * 2 * size_of::<(u32, Part)>()) as u64
    }
}
