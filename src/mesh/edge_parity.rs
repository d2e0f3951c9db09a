//! Test in constant memory whether a mesh is closed, by sums over its edges.
//!
//! Every edge has a hash of 128 bits of its two ends. One sum counts it with the sign of its direction, another is the
//! exclusive or. Where every edge is met as often in one direction as in the other, the first sum is zero; where every
//! edge is met an even number of times, the second. The converse fails with a chance of 2^-128.

use super::lattice::Triangle;

/// Sums over the edges of the triangles seen so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EdgeParity {
    signed: u128,
    parity: u128,
}

/// The result of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Closed {
    Oriented,
    Mixed,
    No,
}

/// Exclusive or of both halves of a product: one multiplication mixes all bits of both factors.
#[inline]
fn fold(a: u64, b: u64) -> u64 {
    let product = u128::from(a) * u128::from(b);
    #[expect(clippy::cast_possible_truncation, reason = "the halves are wanted")]
    let halves = (product as u64, (product >> 64) as u64);
    halves.0 ^ halves.1
}

/// A hash of a lattice point, in two independent halves.
#[inline]
pub(super) fn vertex_hash(p: &[i32; 3]) -> [u64; 2] {
    let xy = u64::from(p[0].cast_unsigned()) << 32 | u64::from(p[1].cast_unsigned());
    let z = u64::from(p[2].cast_unsigned());
    let first = fold(xy ^ 0x9e37_79b9_7f4a_7c15, z.wrapping_add(0xd6e8_feb8_6659_fd93));
    let second = fold(xy.wrapping_add(0x5851_f42d_4c95_7f2d), z ^ 0xc2b2_ae3d_27d4_eb4f);
    [fold(first ^ xy, 0xa076_1d64_78bd_642f), fold(second ^ z, 0xe703_7ed1_a0b4_28db)]
}

/// A hash of an edge whose ends are given in their order.
#[inline]
fn edge_hash(low: [u64; 2], high: [u64; 2]) -> u128 {
    let first = fold(low[0] ^ 0x8ebc_6af0_9c88_c6e3, high[0] ^ 0x5899_65cc_7537_4cc3);
    let second = fold(low[1] ^ 0x1d8e_4e27_c47d_124f, high[1] ^ 0xeb44_acca_b455_d165);
    u128::from(first) << 64 | u128::from(second)
}

impl EdgeParity {
    #[inline]
    pub(crate) fn add(&mut self, t: &Triangle) {
        let [a, b, c, d, e, f, g, h, i] = *t;
        self.add_hashed([[a, b, c], [d, e, f], [g, h, i]].map(|p| vertex_hash(&p)));
    }

    /// Adds the triangle whose vertices have these hashes.
    #[inline]
    pub(super) fn add_hashed(&mut self, hashes: [[u64; 2]; 3]) {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = (hashes[a], hashes[b]);
            if from == to {
                continue;
            }
            if from < to {
                let hash = edge_hash(from, to);
                self.signed = self.signed.wrapping_add(hash);
                self.parity ^= hash;
            } else {
                let hash = edge_hash(to, from);
                self.signed = self.signed.wrapping_sub(hash);
                self.parity ^= hash;
            }
        }
    }

    pub(crate) fn closed(&self) -> Closed {
        match (self.signed, self.parity) {
            (0, _) => Closed::Oriented,
            (_, 0) => Closed::Mixed,
            _ => Closed::No,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn closed(triangles: &[Triangle]) -> Closed {
        let mut census = EdgeParity::default();
        triangles.iter().for_each(|t| census.add(t));
        census.closed()
    }

    #[test]
    fn a_tetrahedron_is_closed_and_a_flipped_or_a_missing_face_is_seen() {
        let p = [[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]];
        let t = |a: usize, b: usize, c: usize| -> Triangle {
            let all: Vec<i32> = [p[a], p[b], p[c]].concat();
            all.try_into().unwrap()
        };
        let mut faces = vec![t(0, 2, 1), t(0, 1, 3), t(0, 3, 2), t(1, 2, 3)];
        assert_eq!(closed(&faces), Closed::Oriented);
        // A triangle without area, and one face twice in opposite directions, change nothing.
        faces.extend([t(0, 0, 1), t(1, 2, 3), t(1, 3, 2)]);
        assert_eq!(closed(&faces), Closed::Oriented);
        faces[0] = t(0, 1, 2);
        assert_eq!(closed(&faces), Closed::Mixed);
        faces.remove(0);
        assert_eq!(closed(&faces), Closed::No);
    }
}
