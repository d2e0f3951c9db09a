//! Separate bodies of a closed surface and the cavities in them, counted while its triangles are written.
#![expect(clippy::cast_possible_truncation, reason = "corners are numbered in 32 bits")]

use crate::geom::{add_scaled, cross, dot};

/// Sets of corners that triangles join: bodies, which enclose a solid, and cavities.
///
/// Memory: 12 bytes for each corner that later triangles may have. Cost: some nanoseconds a triangle.
#[derive(Default)]
pub(super) struct Bodies {
    /// Number of the first corner in `above`.
    first: u32,
    /// Another corner of the same set, from the first corner on; a set's least corner has itself.
    above: Vec<u32>,
    /// Volumes of the sets, at their least corners.
    volume: Vec<f64>,
    /// A place near all corners, for the sake of rounding.
    origin: Option<[f64; 3]>,
    /// Bodies and cavities whose triangles have all passed.
    complete: [u64; 2],
}

impl Bodies {
    /// A triangle, by the numbers of its corners and their places.
    pub(super) fn add(&mut self, corners: [u32; 3], at: [[f32; 3]; 3]) {
        let at = at.map(|place| place.map(f64::from));
        let origin = *self.origin.get_or_insert(at[0]);
        let [a, b, c] = at.map(|place| add_scaled(place, -1.0, origin));
        let end = corners.iter().max().map_or(0, |last| last - self.first + 1);
        self.above.extend(self.above.len() as u32..end);
        self.volume.resize(self.above.len(), 0.0);
        let [one, two, three] = corners.map(|corner| self.root(corner - self.first));
        let least = one.min(two).min(three);
        for root in [one, two, three] {
            self.above[root as usize] = least;
            if root != least {
                self.volume[least as usize] += std::mem::take(&mut self.volume[root as usize]);
            }
        }
        self.volume[least as usize] += dot(a, cross(b, c));
    }

    /// No later triangle has a corner before `first`.
    pub(super) fn layer(&mut self, first: u32) {
        if first == self.first {
            return;
        }
        let gone = ((first - self.first) as usize).min(self.above.len());
        let roots: Vec<u32> = (0..self.above.len() as u32).map(|corner| self.root(corner)).collect();
        // The least corner that stays of each set.
        let mut names = vec![None; self.above.len()];
        let volume = std::mem::take(&mut self.volume);
        self.above.clear();
        for (name, root) in (0..).zip(&roots[gone..]) {
            let root = *root as usize;
            let is_first = names[root].is_none();
            self.above.push(*names[root].get_or_insert(name));
            self.volume.push(if is_first { volume[root] } else { 0.0 });
        }
        let is_complete = |root: &usize| roots[*root] as usize == *root && names[*root].is_none();
        for root in (0..gone).filter(is_complete) {
            self.complete[0] += u64::from(volume[root] > 0.0);
            self.complete[1] += u64::from(volume[root] < 0.0);
        }
        self.first = first;
    }

    /// The numbers of bodies and of cavities, after the last triangle.
    pub(super) fn count(mut self) -> [u64; 2] {
        self.layer(u32::MAX);
        self.complete
    }

    fn root(&mut self, corner: u32) -> u32 {
        root(&mut self.above, corner)
    }
}

/// The name of a number's set, which is a number that has itself in `above`; others have one of their set. Halves the path
/// to it.
pub(super) fn root(above: &mut [u32], mut number: u32) -> u32 {
    while above[number as usize] != number {
        let next = above[above[number as usize] as usize];
        above[number as usize] = next;
        number = next;
    }
    number
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_and_cavities_are_counted_by_common_corners_whatever_the_layers() {
        let solid = [[0_u32, 2, 1], [0, 1, 3], [2, 0, 3], [1, 2, 3]];
        let at = |corner: u32| match corner % 4 {
            0 => [0.0; 3],
            1 => [1.0, 0.0, 0.0],
            2 => [0.0, 1.0, 0.0],
            _ => [0.0, 0.0, 1.0],
        };
        let count = |faces: &[([u32; 3], u32)]| {
            let mut bodies = Bodies::default();
            for (face, first) in faces {
                bodies.layer(*first);
                bodies.add(*face, face.map(at));
            }
            bodies.count()
        };
        let from = |start: u32, first: u32| solid.map(|face| (face.map(|corner| start + corner), first));
        let cavity = from(12, 4).map(|([a, b, c], first)| ([a, c, b], first));
        for firsts in [[0; 4], [0, 0, 0, 1]] {
            let first: Vec<_> = solid.into_iter().zip(firsts).collect();
            assert_eq!(count(&[&first[..], &from(4, 4)].concat()), [2, 0]);
            assert_eq!(count(&[&first[..], &cavity, &from(16, 16)].concat()), [2, 1]);
        }
        let hinged = from(4, 0).map(|(face, first)| (face.map(|c| if c == 4 { 0 } else { c }), first));
        assert_eq!(count(&[from(0, 0), hinged].concat()), [1, 0]);
        assert_eq!(count(&[]), [0; 2]);
    }
}
