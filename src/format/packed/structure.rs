//! Infobytes of a subtree, each bit predicted from the boxes around it (SPEC 5.3).

use super::CodingError;
use super::coder::{Bit, BitCoder};

/// Cell of a subtree, each coordinate below 64.
pub type Cell = [u8; 3];

const CONTEXT_BITS: u32 = 18;

/// One depth of a subtree as a cube of states with a border of absent boxes.
#[derive(Debug)]
struct Grid {
    /// Boxes along a side, border included.
    side: usize,
    state: Vec<u8>,
}

/// States of a box in a [`Grid`]; a node is coded once its own infobyte is.
const ABSENT: u8 = 0;
const PRESENT: u8 = 1;
const CODED: u8 = 2;

impl Grid {
    fn new(depth: usize) -> Self {
        let side = (1 << depth) + 2;
        Self { side, state: vec![ABSENT; side * side * side] }
    }

    #[inline(always)]
    fn index(&self, cell: Cell) -> usize {
        let [x, y, z] = cell.map(|c| usize::from(c) + 1);
        (z * self.side + y) * self.side + x
    }

    /// Steps to the neighbours along x, y and z.
    fn steps(&self) -> [isize; 3] {
        let side = self.side.cast_signed();
        [1, side, side * side]
    }
}

/// Codes subtrees one after the other; what it learns carries on until it is made anew.
#[derive(Debug)]
pub struct StructureCoder {
    contexts: Vec<Bit>,
    /// One grid per depth of the subtree, the cells' last.
    grids: Vec<Grid>,
}

impl StructureCoder {
    /// A coder for subtrees of `depth` levels of nodes (at most 6), with nothing learnt; 2 MiB.
    pub fn new(depth: usize) -> Self {
        Self { contexts: vec![Bit::NEW; 1 << CONTEXT_BITS], grids: (0..=depth).map(Grid::new).collect() }
    }

    /// Forgets what was learnt: the start of a group.
    pub fn restart(&mut self) {
        self.contexts.fill(Bit::NEW);
    }

    /// Codes one subtree: `levels[d]` holds the infobytes of its depth d in Morton order. A decoder
    /// replaces their contents. Returns the subtree's voxels in Morton order in `cells`.
    ///
    /// # Errors
    /// A decoder ran out of bytes; an encoder was given levels that do not belong together.
    pub fn code(
        &mut self,
        coder: &mut impl BitCoder,
        levels: &mut [Vec<u8>],
        decode: bool,
        cells: &mut Vec<Cell>,
    ) -> Result<(), CodingError> {
        let mut parents = vec![[0; 3]];
        let mut touched = Vec::new();
        if let Some(root) = self.grids.first_mut() {
            let at = root.index([0; 3]);
            root.state[at] = PRESENT;
        }
        let mut result = Ok(());
        for (depth, level) in levels.iter_mut().enumerate() {
            if decode {
                level.clear();
                level.resize(parents.len(), 0);
            }
            cells.clear();
            result = self.code_level(coder, depth, &parents, level, cells);
            touched.push(std::mem::replace(&mut parents, cells.clone()));
            if result.is_err() {
                break;
            }
        }
        if levels.is_empty() {
            *cells = parents.clone();
        }
        touched.push(parents);
        for (grid, boxes) in self.grids.iter_mut().zip(&touched) {
            for cell in boxes {
                let at = grid.index(*cell);
                grid.state[at] = ABSENT;
            }
        }
        result
    }

    fn code_level(
        &mut self,
        coder: &mut impl BitCoder,
        depth: usize,
        parents: &[Cell],
        level: &mut [u8],
        children: &mut Vec<Cell>,
    ) -> Result<(), CodingError> {
        let (above, below) = self.grids.split_at_mut(depth + 1);
        let (Some(nodes), Some(boxes)) = (above.last_mut(), below.first_mut()) else {
            return Err(CodingError::SubtreeTooDeep);
        };
        if level.len() != parents.len() {
            return Err(wrong_count(level, parents));
        }
        for (parent, mask) in parents.iter().zip(level) {
            *mask = code_node(coder, &mut self.contexts, nodes, boxes, *parent, *mask, children)?;
        }
        Ok(())
    }
}

/// A depth of a subtree that does not belong to the boxes above; both have at most 8^6 items.
fn wrong_count(level: &[u8], parents: &[Cell]) -> CodingError {
    let count = |len: usize| u32::try_from(len).unwrap_or(u32::MAX);
    CodingError::SubtreeNodes { found: count(level.len()), due: count(parents.len()) }
}

/// Codes one infobyte and notes its children.
fn code_node(
    coder: &mut impl BitCoder,
    contexts: &mut [Bit],
    nodes: &mut Grid,
    boxes: &mut Grid,
    parent: Cell,
    mask: u8,
    children: &mut Vec<Cell>,
) -> Result<u8, CodingError> {
    let at = nodes.index(parent);
    let (node_step, box_step) = (nodes.steps(), boxes.steps());
    // States of the neighbouring nodes, by offset; the centre is never asked for.
    let near = |d: [isize; 3]| {
        let offset: isize = (0..3).map(|a| d[a] * node_step[a]).sum();
        nodes.state.get(at.wrapping_add_signed(offset)).copied().unwrap_or(ABSENT)
    };
    let mut prefix = 1_u32;
    for octant in 0..8_u8 {
        let high = [0, 1, 2].map(|a| octant >> a & 1);
        let out = high.map(|h| 2 * h.cast_signed() as isize - 1);
        let child = [0, 1, 2].map(|a| 2 * parent[a] + high[a]);
        let child_at = boxes.index(child);
        // SPEC 5.3: 0 no box there, 1 a box, 2 not known yet but its node exists.
        let seen = |d: [isize; 3]| match near(d) {
            ABSENT => 0,
            CODED => {
                let offset: isize = (0..3).map(|a| d[a] * box_step[a]).sum();
                let state = boxes.state.get(child_at.wrapping_add_signed(offset)).copied();
                u32::from(state.unwrap_or(ABSENT) != ABSENT)
            }
            _ => 2,
        };
        let faces = (seen([out[0], 0, 0]) * 3 + seen([0, out[1], 0])) * 3 + seen([0, 0, out[2]]);
        let edges =
            (seen([out[0], out[1], 0]) * 3 + seen([out[0], 0, out[2]])) * 3 + seen([0, out[1], out[2]]);
        let behind = |d| u32::from(near(d) != ABSENT);
        let behind = (behind([-out[0], 0, 0]) * 2 + behind([0, -out[1], 0])) * 2 + behind([0, 0, -out[2]]);
        let key = ((faces * 27 + edges) * 8 + behind) * 256 + prefix;
        let slot = (key.wrapping_mul(0x9E37_79B1) >> (32 - CONTEXT_BITS)) as usize;
        // A node has a child: seven absences leave no choice for the eighth.
        let bit = match contexts.get_mut(slot) {
            Some(context) if octant < 7 || prefix != 128 => coder.code(context, mask >> octant & 1 == 1)?,
            _ => true,
        };
        if bit {
            boxes.state[child_at] = PRESENT;
            children.push(child);
        }
        prefix = prefix << 1 | u32::from(bit);
    }
    nodes.state[at] = CODED;
    // The prefix holds octant 0 in its highest bit.
    #[expect(clippy::cast_possible_truncation, reason = "the low eight bits are wanted")]
    Ok((prefix as u8).reverse_bits())
}

/// Voxels of a subtree in Morton order from its infobytes by depth.
///
/// # Errors
/// Depths that do not belong together.
pub fn cells_of(levels: &[Vec<u8>], cells: &mut Vec<Cell>) -> Result<(), CodingError> {
    let mut parents = vec![[0_u8; 3]];
    for level in levels {
        if level.len() != parents.len() {
            return Err(wrong_count(level, &parents));
        }
        let mut next = Vec::new();
        for (parent, mask) in parents.iter().zip(level) {
            for octant in (0..8_u8).filter(|o| mask >> o & 1 == 1) {
                // At most six levels, so coordinates stay below 64.
                next.push([0, 1, 2].map(|a: usize| (2 * (parent[a] & 31)) + (octant >> a & 1)));
            }
        }
        parents = next;
    }
    *cells = parents;
    Ok(())
}
