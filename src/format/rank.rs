//! The rank directory (SPEC 4.5), by which a pointerless octree finds its children.

/// Nodes per superblock.
pub(crate) const SUPER_NODES: u64 = 8192;
/// Nodes per block.
pub(crate) const BLOCK_NODES: u64 = 32;

/// [`SUPER_NODES`] and [`BLOCK_NODES`] as indices into memory.
const SUPER: usize = 8192;
const BLOCK: usize = 32;
const _: () = assert!(SUPER as u64 == SUPER_NODES && BLOCK as u64 == BLOCK_NODES);

/// Bytes of the superblocks, then of the whole directory, for `nodes` nodes.
pub(crate) const fn directory_bytes(nodes: u64) -> (u64, u64) {
    let supers = nodes.div_ceil(SUPER_NODES) * 8;
    (supers, supers + nodes.div_ceil(BLOCK_NODES) * 2)
}

/// Builds the directory's two parts from infobytes fed in order; holds a few bytes of state.
#[derive(Debug, Default)]
pub(crate) struct RankBuilder {
    nodes: u64,
    ones: u64,
    super_ones: u64,
}

impl RankBuilder {
    /// Feeds the next infobytes, and calls `on_super` and `on_block` for every boundary passed.
    pub(crate) fn feed(
        &mut self,
        infobytes: &[u8],
        mut on_super: impl FnMut(u64),
        mut on_block: impl FnMut(u16),
    ) {
        let mut rest = infobytes;
        while !rest.is_empty() {
            if self.nodes.is_multiple_of(SUPER_NODES) {
                self.super_ones = self.ones;
                on_super(self.ones);
            }
            if self.nodes.is_multiple_of(BLOCK_NODES) {
                #[expect(clippy::cast_possible_truncation, reason = "at most 255 blocks of 256 bits")]
                on_block((self.ones - self.super_ones) as u16);
            }
            let room = BLOCK - usize::try_from(self.nodes % BLOCK_NODES).unwrap_or(0);
            let (now, later) = rest.split_at(room.min(rest.len()));
            self.ones += now.iter().map(|b| u64::from(b.count_ones())).sum::<u64>();
            self.nodes += now.len() as u64;
            rest = later;
        }
    }

    /// Set bits so far: boxes below the root.
    #[cfg(test)]
    fn ones(&self) -> u64 {
        self.ones
    }
}

/// The whole directory of infobytes that are in memory.
pub fn directory(infobytes: &[u8]) -> Vec<u8> {
    let (mut supers, mut blocks) = (Vec::new(), Vec::new());
    let mut builder = RankBuilder::default();
    builder.feed(
        infobytes,
        |ones| supers.extend(ones.to_le_bytes()),
        |ones| blocks.extend(ones.to_le_bytes()),
    );
    supers.extend(blocks);
    supers
}

/// Number of set bits in `infobytes[..node]`, by the directory. Any bytes are safe: missing ones count 0.
///
/// Always inlined, so that a caller compiled with population count gets it here as well.
#[inline(always)]
pub(crate) fn rank(infobytes: &[u8], directory: &[u8], node: u64) -> u64 {
    let Ok(at) = usize::try_from(node) else { return 0 };
    let super_at = at / SUPER * 8;
    let block_at = block_entry(infobytes.len(), at);
    let base = directory
        .get(super_at..super_at + 8)
        .map_or(0, |b| u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]));
    let block =
        directory.get(block_at..block_at + 2).map_or(0, |b| u64::from(u16::from_le_bytes([b[0], b[1]])));
    base.wrapping_add(block).wrapping_add(partial_block(infobytes, at))
}

/// Offset in a directory for `nodes` nodes of the entry of node `at`'s block.
#[inline(always)]
pub(crate) fn block_entry(nodes: usize, at: usize) -> usize {
    nodes.div_ceil(SUPER) * 8 + at / BLOCK * 2
}

/// A block of ones, then one of zeros: a block read from its middle or earlier is the mask of the bytes before a node.
const BEFORE: [u8; 2 * BLOCK] = {
    let mut masks = [0; 2 * BLOCK];
    let mut at = 0;
    while at < BLOCK {
        masks[at] = u8::MAX;
        at += 1;
    }
    masks
};

/// Number of set bits in the infobytes of `at`'s block before `at`.
#[inline(always)]
fn partial_block(infobytes: &[u8], at: usize) -> u64 {
    let start = at & !(BLOCK - 1);
    let within = at - start;
    if let Some(block) = infobytes.get(start..).and_then(|rest| rest.first_chunk::<BLOCK>()) {
        // Bits of each word before `within`: all, some or none, without a branch.
        let masks =
            BEFORE.get(BLOCK - within..).and_then(|rest| rest.first_chunk::<BLOCK>()).unwrap_or(&[0; BLOCK]);
        let mut ones = 0;
        for (word, mask) in block.as_chunks::<8>().0.iter().zip(masks.as_chunks::<8>().0) {
            ones += u64::from((u64::from_le_bytes(*word) & u64::from_le_bytes(*mask)).count_ones());
        }
        return ones;
    }
    let end = at.min(infobytes.len());
    infobytes.get(start..end).map_or(0, |b| b.iter().map(|x| u64::from(x.count_ones())).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_equals_counting_whatever_the_feed_sizes() {
        let bytes: Vec<u8> = (0..20_011_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        for feed in [1, 7, 32, 8192, 20_011] {
            let (mut supers, mut blocks) = (Vec::new(), Vec::new());
            let mut builder = RankBuilder::default();
            for part in bytes.chunks(feed) {
                builder.feed(part, |s| supers.extend(s.to_le_bytes()), |b| blocks.extend(b.to_le_bytes()));
            }
            let mut directory = supers;
            directory.extend(blocks);
            assert_eq!(directory.len() as u64, directory_bytes(bytes.len() as u64).1);
            assert_eq!(directory, super::directory(&bytes));
            let mut ones = 0;
            for (i, b) in bytes.iter().enumerate() {
                assert_eq!(rank(&bytes, &directory, i as u64), ones);
                ones += u64::from(b.count_ones());
            }
            assert_eq!(builder.ones(), ones);
        }
    }

    #[test]
    fn ranks_out_of_range_are_safe() {
        for node in [3, 40, 1 << 40, u64::MAX - 31, u64::MAX] {
            assert_eq!(rank(&[1, 2, 3], &[], node), if node == 3 { 4 } else { 0 });
        }
    }

    #[test]
    fn rank_of_a_full_superblock_fits_its_blocks() {
        let bytes = vec![0xff; 8192 * 2];
        let (mut supers, mut blocks) = (Vec::new(), Vec::new());
        RankBuilder::default().feed(&bytes, |s| supers.push(s), |b| blocks.push(b));
        assert_eq!(supers, [0, 65536]);
        assert_eq!(blocks.iter().max(), Some(&65_280));
    }
}
