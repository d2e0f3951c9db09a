//! Bodies made of the cubes of a lattice: hard cases for an octree, for labels and for memory.

use super::body::TrueSurface;
use super::math::{Vector, hash, unit};
use crate::geom::dot;

/// Cubes of one size, each solid or empty.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub(super) pattern: Pattern,
    /// Edge of a cube in units.
    pub(super) cell: f64,
    /// Corner of cube (0, 0, 0).
    pub(super) origin: Vector,
    /// Cubes along each axis; all others are empty.
    pub(super) size: [u32; 3],
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Pattern {
    /// Menger's sponge of this many levels, 3^levels cubes a side.
    Menger { levels: u32 },
    /// Every other cube.
    Checkerboard,
    /// Plates that a bar on the last slice joins: separate parts turn out to be one very late.
    Comb,
    /// Single cubes by chance: this many of 2^32 are solid.
    Salt { chance: u64, seed: u64 },
}

impl Lattice {
    fn holds(&self, cube: [i64; 3]) -> bool {
        let within = |a: usize| u32::try_from(cube[a]).ok().filter(|c| *c < self.size[a]);
        let [Some(x), Some(y), Some(z)] = [within(0), within(1), within(2)] else { return false };
        let at = [x, y, z];
        match self.pattern {
            Pattern::Menger { levels } => {
                let mut rest = at;
                (0..levels).all(|_| {
                    let middles = rest.iter().filter(|c| **c % 3 == 1).count();
                    rest = rest.map(|c| c / 3);
                    middles < 2
                })
            }
            Pattern::Checkerboard => (x ^ y ^ z) & 1 == 0,
            Pattern::Comb if z + 1 == self.size[2] => y == self.size[1] / 2,
            Pattern::Comb => x % 2 == 0,
            Pattern::Salt { chance, seed } => hash(at, seed) >> 32 < chance,
        }
    }

    /// True for the sponge alone, which leaves air around it.
    pub(super) fn is_closed(&self) -> bool {
        matches!(self.pattern, Pattern::Menger { .. })
    }

    /// The cube that a place lies in, and the place within it along each axis.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a cube's number, or far beyond any, where it saturates"
    )]
    fn find(&self, p: Vector) -> ([i64; 3], Vector) {
        let scaled: Vector = std::array::from_fn(|a| (p[a] - self.origin[a]) / self.cell);
        let cube = scaled.map(|c| c.floor() as i64);
        (cube, std::array::from_fn(|a| (scaled[a] - scaled[a].floor()) * self.cell))
    }

    /// Searches the 26 neighbours for the nearest cube that differs from the place's own.
    pub(super) fn surface(&self, p: Vector) -> TrueSurface {
        let (cube, into) = self.find(p);
        let inside = self.holds(cube);
        let (mut best, mut way) = (self.cell * self.cell, [0.0; 3]);
        for k in 0..27_i64 {
            let step = [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
            let towards: Vector = std::array::from_fn(|a| match step[a] {
                -1 => -into[a],
                0 => 0.0,
                _ => self.cell - into[a],
            });
            let square = dot(towards, towards);
            if square < best && self.holds(std::array::from_fn(|a| cube[a] + step[a])) != inside {
                (best, way) = (square, towards);
            }
        }
        let sign = if inside { -1.0 } else { 1.0 };
        TrueSurface { distance: sign * best.sqrt(), normal: unit(way.map(|c| -sign * c)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice(pattern: Pattern, n: u32) -> Lattice {
        Lattice { pattern, cell: 2.0, origin: [1.0; 3], size: [n; 3] }
    }

    #[test]
    fn patterns_have_as_many_cubes_as_they_should() {
        let count = |lattice: &Lattice| {
            let n = i64::from(lattice.size[0]);
            (0..n * n * n).filter(|i| lattice.holds([i % n, i / n % n, i / n / n])).count()
        };
        assert_eq!(count(&lattice(Pattern::Menger { levels: 1 }, 3)), 20);
        assert_eq!(count(&lattice(Pattern::Menger { levels: 3 }, 27)), 8000);
        assert_eq!(count(&lattice(Pattern::Checkerboard, 10)), 500);
        assert_eq!(count(&lattice(Pattern::Comb, 8)), 7 * 32 + 8);
        let salt = count(&lattice(Pattern::Salt { chance: (1 << 32) / 10, seed: 3 }, 50));
        assert!((12_000..13_000).contains(&salt), "{salt}");
    }

    #[test]
    fn distances_are_to_the_nearest_face_edge_or_corner() {
        let one = Lattice { pattern: Pattern::Checkerboard, cell: 4.0, origin: [0.0; 3], size: [1; 3] };
        let near = |p: Vector| one.surface(p);
        let inside = near([1.0, 2.0, 2.0]);
        assert_eq!((inside.distance, inside.normal), (-1.0, [-1.0, 0.0, 0.0]));
        let corner = near([5.0, 6.0, 6.0]);
        assert!((corner.distance - 3.0).abs() < 1e-12);
        assert!((corner.normal[0] - 1.0 / 3.0).abs() < 1e-12 && (corner.normal[2] - 2.0 / 3.0).abs() < 1e-12);
        // The search ends one cube away.
        assert_eq!(near([20.0, 2.0, 2.0]).distance, 4.0);
    }
}
