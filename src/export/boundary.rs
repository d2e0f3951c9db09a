//! Closedness of surfaces, counted while their triangles are written.

use std::cmp::Ordering;
use std::io;

use super::bodies::Bodies;
use super::write::{Output, PartHead, Sink, Vertex};

/// A file of triangles, and the boundary of its parts.
///
/// An edge adds a hash of its corners' numbers where it runs from the lesser one to the other, and subtracts it where it
/// runs back, so that the sum of a closed part is 0. A part that is not closed has 0 with probability 2^-64. Corners at
/// one place count as one for that: where some are, no edge opens.
pub(super) struct Bounded {
    to: Box<dyn Output>,
    sum: u64,
    /// True until a part ends that is not closed.
    is_closed: bool,
    bodies: Option<Bodies>,
}

impl Bounded {
    /// Counts bodies and cavities as well, if `bodies` are given.
    pub(super) fn new(to: Box<dyn Output>, bodies: Option<Bodies>) -> Self {
        Self { to, sum: 0, is_closed: true, bodies }
    }

    /// Begins a part.
    pub(super) fn part(&mut self, head: &PartHead) -> io::Result<()> {
        self.is_closed &= self.sum == 0;
        self.to.part(head)
    }

    /// Completes the file; true if all parts are closed: if each edge has as many triangles on one side as on the other.
    /// And the numbers of bodies and cavities, if they were counted.
    pub(super) fn finish(self) -> io::Result<(bool, Option<[u64; 2]>)> {
        self.to.finish()?;
        Ok((self.is_closed && self.sum == 0, self.bodies.map(Bodies::count)))
    }
}

impl Sink for Bounded {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.to.vertex(vertex)
    }

    fn triangle(&mut self, corners: [u32; 3], at: [[f32; 3]; 3]) -> io::Result<()> {
        let [a, b, c] = corners;
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let edge = hash(u64::from(from.min(to)) << 32 | u64::from(from.max(to)));
            self.sum = match from.cmp(&to) {
                Ordering::Less => self.sum.wrapping_add(edge),
                Ordering::Equal => self.sum,
                Ordering::Greater => self.sum.wrapping_sub(edge),
            };
        }
        self.bodies.iter_mut().for_each(|bodies| bodies.add(corners, at));
        self.to.triangle(corners, at)
    }

    fn layer(&mut self, first: u32) -> io::Result<()> {
        self.bodies.iter_mut().for_each(|bodies| bodies.layer(first));
        self.to.layer(first)
    }
}

/// A number mixed into 64 bits (Steele, Lea and Flood 2014: SplitMix).
fn hash(number: u64) -> u64 {
    let z = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Nowhere;

    impl Sink for Nowhere {
        fn vertex(&mut self, _: &Vertex) -> io::Result<()> {
            Ok(())
        }

        fn triangle(&mut self, _: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
            Ok(())
        }
    }

    impl Output for Nowhere {
        fn finish(self: Box<Self>) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_part_is_closed_where_each_edge_runs_both_ways() {
        let solid = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let is_closed = |parts: &[&[[u32; 3]]]| {
            let mut sink = Bounded::new(Box::new(Nowhere), None);
            for faces in parts {
                sink.part(&PartHead::default()).unwrap();
                faces.iter().for_each(|face| sink.triangle(*face, [[0.0; 3]; 3]).unwrap());
            }
            sink.finish().unwrap().0
        };
        let inside_out = solid.map(|[a, b, c]| [a, c, b]);
        let turned = [solid[0], solid[1], solid[2], inside_out[3]];
        assert!(is_closed(&[&solid]) && is_closed(&[&solid, &inside_out]) && is_closed(&[]));
        // Both sheets of a wall, and a triangle without area on an edge.
        assert!(is_closed(&[&[solid.as_slice(), &inside_out, &[[1, 2, 2]]].concat()]));
        for open in [&solid[1..], &turned] {
            assert!(!is_closed(&[open]) && !is_closed(&[open, &solid]) && !is_closed(&[&solid, open]));
        }
        // Parts are closed by themselves.
        assert!(!is_closed(&[&solid[..2], &solid[2..]]));
    }
}
