//! Sets of runs that are one component: a union-find in a table that is paged to disk.

use std::cmp::Reverse;
use std::io;
use std::path::Path;

use super::paged::PagedTable;

/// Slot of a component without a run in the slice.
const NO_SLOT: u32 = u32::MAX;
/// Marks a component that touches the border of the volume, in the field of its first voxel (below 2^48).
const BORDER: u64 = 1 << 63;

/// The known part of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Component {
    pub(super) voxels: u64,
    /// Number of its first voxel, and the mark of the border.
    first: u64,
}

impl Component {
    /// A run of voxels from number `first` on.
    pub(super) fn new(voxels: u64, first: u64, touches_border: bool) -> Self {
        Self { voxels, first: first | if touches_border { BORDER } else { 0 } }
    }

    /// The two words of a list entry.
    pub(super) fn words(self) -> [u64; 2] {
        [self.voxels, self.first]
    }

    pub(super) fn of_words([voxels, first]: [u64; 2]) -> Self {
        Self { voxels, first }
    }

    /// Number of its first voxel in the order z, y, x.
    pub(super) fn first(self) -> u64 {
        self.first & !BORDER
    }

    pub(super) fn touches_border(self) -> bool {
        self.first & BORDER != 0
    }

    fn join(self, other: Self) -> Self {
        let border = (self.first | other.first) & BORDER;
        Self { voxels: self.voxels + other.voxels, first: self.first().min(other.first()) | border }
    }

    /// Rank: larger ones first, equal ones by their first voxel.
    fn rank(self) -> (u64, Reverse<u64>) {
        (self.voxels, Reverse(self.first()))
    }
}

impl PartialOrd for Component {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Component {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.rank().cmp(&other.rank())
    }
}

/// A node of the union-find of one slice, as stored in a table: voxels and first voxel of its component, and its parent
/// in the low half and its slot in the high half of the last word.
type Node = [u64; 3];

fn node(component: Component, parent: u32) -> Node {
    [component.voxels, component.first, u64::from(parent) | u64::from(NO_SLOT) << 32]
}

fn component_of(node: Node) -> Component {
    Component { voxels: node[0], first: node[1] }
}

#[expect(clippy::cast_possible_truncation, reason = "the low half")]
fn parent_of(node: Node) -> u32 {
    node[2] as u32
}

fn slot_of(node: Node) -> u32 {
    (node[2] >> 32) as u32
}

/// Union-find over the nodes of a slice; a set's root is its smallest node.
pub(super) struct UnionFind {
    nodes: PagedTable<Node>,
}

impl UnionFind {
    pub(super) const NODE_BYTES: usize = size_of::<Node>();

    pub(super) const MIN_BYTES: u64 = PagedTable::<Node>::MIN_BYTES;

    /// Empty sets; `bytes` of their table are held in memory, the rest lies in `folder`.
    pub(super) fn new(folder: &Path, bytes: u64) -> io::Result<Self> {
        Ok(Self { nodes: PagedTable::new(folder, bytes)? })
    }

    pub(super) fn len(&self) -> u64 {
        self.nodes.len()
    }

    pub(super) fn clear(&mut self) {
        self.nodes.clear();
    }

    /// The component of a root, and its slot if it has one.
    pub(super) fn get(&mut self, root: u32) -> io::Result<(Component, Option<u32>)> {
        let node = self.nodes.get(u64::from(root))?;
        Ok((component_of(node), Some(slot_of(node)).filter(|slot| *slot != NO_SLOT)))
    }

    /// The root of a node's set.
    pub(super) fn find(&mut self, mut node: u32) -> io::Result<u32> {
        loop {
            let parent = parent_of(self.nodes.get(u64::from(node))?);
            if parent == node {
                return Ok(node);
            }
            let above = parent_of(self.nodes.get(u64::from(parent))?);
            if above == parent {
                return Ok(parent);
            }
            // Paths are halved on the way.
            self.set_parent(node, above)?;
            node = above;
        }
    }

    /// Joins two different roots and returns the root of both.
    pub(super) fn join(&mut self, a: u32, b: u32) -> io::Result<u32> {
        let (root, other) = (a.min(b), a.max(b));
        self.set_parent(other, root)?;
        let component = component_of(self.nodes.get(u64::from(other))?);
        self.add(root, component)?;
        Ok(root)
    }

    fn set_parent(&mut self, node: u32, parent: u32) -> io::Result<()> {
        let word = &mut self.nodes.get_mut(u64::from(node))?[2];
        *word = *word >> 32 << 32 | u64::from(parent);
        Ok(())
    }

    /// Gives the component of a root its slot in the next slice.
    pub(super) fn set_slot(&mut self, node: u32, slot: u32) -> io::Result<()> {
        let word = &mut self.nodes.get_mut(u64::from(node))?[2];
        *word = *word & u64::from(u32::MAX) | u64::from(slot) << 32;
        Ok(())
    }

    pub(super) fn add(&mut self, root: u32, component: Component) -> io::Result<()> {
        let node = self.nodes.get_mut(u64::from(root))?;
        let sum = component_of(*node).join(component);
        (node[0], node[1]) = (sum.voxels, sum.first);
        Ok(())
    }

    pub(super) fn push(&mut self, component: Component) -> io::Result<u32> {
        let number = u32::try_from(self.nodes.len()).ok().filter(|n| *n < NO_SLOT);
        let number = number.ok_or_else(|| io::Error::other("a slice has more than 2^32 runs"))?;
        self.nodes.push(node(component, number))?;
        Ok(number)
    }
}
