//! Fixed pool of small chunks in which the records of a row of bricks wait for the scratch file.
//!
//! Every brick has one chain of chunks; the pool's size bounds all of them together, so a dense volume
//! makes fragments shorter, never memory larger.
#![expect(clippy::cast_possible_truncation, reason = "a pool is far below 4 GiB")]

pub(super) const CHUNK_BYTES: usize = 256;
const NONE: u32 = u32::MAX;

/// One brick's chain of chunks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chain {
    first: u32,
    last: u32,
    pub(super) bytes: u32,
}

impl Chain {
    pub(super) const EMPTY: Self = Self { first: NONE, last: NONE, bytes: 0 };
}

pub(super) struct ChunkPool {
    bytes: Vec<u8>,
    next: Vec<u32>,
    used: usize,
}

impl ChunkPool {
    /// A pool of `capacity_bytes`, rounded down to whole chunks.
    pub(super) fn new(capacity_bytes: usize) -> Self {
        let chunks = capacity_bytes / CHUNK_BYTES;
        Self { bytes: vec![0; chunks * CHUNK_BYTES], next: vec![NONE; chunks], used: 0 }
    }

    /// True if there is room for `more` bytes in `chain`, without the free bytes of its last chunk.
    pub(super) fn has_room(&self, more: usize) -> bool {
        self.used + more.div_ceil(CHUNK_BYTES) <= self.next.len()
    }

    /// Appends bytes; the caller has checked [`ChunkPool::has_room`].
    pub(super) fn append(&mut self, chain: &mut Chain, mut data: &[u8]) {
        while !data.is_empty() {
            let within = chain.bytes as usize % CHUNK_BYTES;
            if within == 0 {
                let fresh = self.used as u32;
                self.used += 1;
                self.next[fresh as usize] = NONE;
                if chain.last == NONE {
                    chain.first = fresh;
                } else {
                    self.next[chain.last as usize] = fresh;
                }
                chain.last = fresh;
            }
            let at = chain.last as usize * CHUNK_BYTES + within;
            let now = data.len().min(CHUNK_BYTES - within);
            self.bytes[at..at + now].copy_from_slice(&data[..now]);
            chain.bytes += now as u32;
            data = &data[now..];
        }
    }

    /// Copies a chain's bytes to the end of `out`: each one from `first` on, by steps of `step`, a power of two.
    pub(super) fn copy_to(&self, chain: &Chain, [first, step]: [usize; 2], out: &mut Vec<u8>) {
        let (mut chunk, mut left) = (chain.first, chain.bytes as usize);
        while left > 0 {
            let at = chunk as usize * CHUNK_BYTES;
            let now = left.min(CHUNK_BYTES);
            let bytes = &self.bytes[at..at + now];
            match step {
                1 => out.extend_from_slice(bytes),
                _ => out.extend(bytes.iter().skip(first).step_by(step)),
            }
            left -= now;
            chunk = self.next[chunk as usize];
        }
    }

    /// Frees every chunk, which invalidates all chains.
    pub(super) fn clear(&mut self) {
        self.used = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interleaved_chains_keep_their_bytes() {
        let mut pool = ChunkPool::new(64 * CHUNK_BYTES);
        let mut chains = [Chain::EMPTY; 3];
        let mut want = [const { Vec::new() }; 3];
        for round in 0..60_u32 {
            let which = (round % 3) as usize;
            let data: Vec<u8> = (0..(round * 7 % 200)).map(|i| (i * 3 + round) as u8).collect();
            pool.append(&mut chains[which], &data);
            want[which].extend_from_slice(&data);
        }
        for (chain, want) in chains.iter().zip(&want) {
            let mut got = Vec::new();
            pool.copy_to(chain, [0, 1], &mut got);
            assert_eq!(&got, want);
        }
        assert!(!pool.has_room(64 * CHUNK_BYTES));
        pool.clear();
        assert!(pool.has_room(64 * CHUNK_BYTES));
    }
}
