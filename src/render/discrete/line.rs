//! A ray in the discrete walk: its main axis, and points on planes across that axis.

use crate::render::ray::{FRACTION_BITS, MAX_DEPTH, Ray};

/// Fraction bits of a point's coordinates. A slope is rounded by at most half a unit, so across the largest
/// grid a point is off by at most 2^-25 cell.
pub const POINT_BITS: u32 = 40;

// A coordinate lies at most a grid's side outside the grid, and the sum of two must fit.
const _: () = assert!(MAX_DEPTH + 2 + POINT_BITS < 63);

/// The axis along which a ray runs fastest (the paper, 3.2), and the way back from the walk's frame.
///
/// In the walk's frame all components of the direction are at least 0 and the main axis is the third: axes along which
/// the ray runs backwards are mirrored, and the axes are rotated cyclically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MainAxis {
    main: u8,
    mirrored: u8,
}

impl MainAxis {
    /// The main axis of a direction: the greatest absolute value, of equal ones the first of x, y, z.
    #[inline]
    pub fn of(direction: [i64; 3]) -> Self {
        let size = direction.map(i64::unsigned_abs);
        let main = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let mirrored = (0..3).fold(0, |mask, a| mask | u8::from(direction[a] < 0) << a);
        Self { main, mirrored }
    }

    /// 0, 1, 2 for x, y, z.
    #[inline]
    pub fn number(self) -> usize {
        usize::from(self.main % 3)
    }

    /// True if the ray runs backwards along this axis of the grid.
    #[inline]
    pub fn is_mirrored(self, axis: usize) -> bool {
        self.mirrored >> (axis % 3) & 1 == 1
    }

    /// Axis of the grid that is axis `of_walk` of the walk's frame: u, v, and w, the main axis.
    #[inline]
    pub fn grid_axis(self, of_walk: usize) -> usize {
        (self.number() + 1 + of_walk) % 3
    }

    /// Number of this rotation and mirroring, below 24.
    #[inline]
    pub(super) fn frame_number(self) -> usize {
        self.number() * 8 + usize::from(self.mirrored & 7)
    }

    /// Lowest cell of a box in the grid from its lowest cell in the walk's frame; `last` is the lowest cell of the last
    /// box.
    #[inline]
    pub(super) fn to_grid(self, low: [u32; 3], last: u32) -> [u32; 3] {
        let mut cell = [0; 3];
        for (of_walk, low) in low.into_iter().enumerate() {
            let axis = self.grid_axis(of_walk);
            cell[axis] = if self.is_mirrored(axis) { last.wrapping_sub(low) } else { low };
        }
        cell
    }
}

/// Coordinates u and v of a point on the line, in units of 2^-[`POINT_BITS`] cell.
pub type Point = [i64; 2];

/// The line of a ray in the walk's frame: u and v as linear functions of w.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    pub(super) axis: MainAxis,
    pub(super) depth: u32,
    /// Intersections with the planes w = 0 and w = 2^depth.
    pub(super) floor: Point,
    pub(super) ceiling: Point,
    /// First point of the ray.
    pub(super) start: Point,
    /// The storey of cells that the ray starts in.
    pub(super) first_storey: u32,
}

impl Line {
    /// The line of a ray. Cost: two divisions in 128 bits.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "a point within a grid's side of the grid")]
    pub fn new(ray: &Ray) -> Self {
        let axis = MainAxis::of(ray.direction());
        let far = i64::from(1_u32.wrapping_shl(ray.depth())) << FRACTION_BITS;
        let in_frame = |of_walk: usize| {
            let a = axis.grid_axis(of_walk);
            let (origin, direction) = (ray.origin()[a], ray.direction()[a]);
            if axis.is_mirrored(a) { (far - origin, -direction) } else { (origin, direction) }
        };
        let (w, along) = in_frame(2);
        let sides = [in_frame(0), in_frame(1)];
        let finer = POINT_BITS - FRACTION_BITS;
        let slope = sides.map(|(_, across)| {
            let steep = (i128::from(across) << POINT_BITS) + i128::from(along) / 2;
            steep.checked_div(along.into()).unwrap_or(0) as i64
        });
        // From w = 0 to the start, at that slope: so that all points lie on one line.
        let to_start = |k: usize| (i128::from(slope[k]) * i128::from(w)) >> FRACTION_BITS;
        let start = sides.map(|(origin, _)| origin << finer);
        let floor: Point = std::array::from_fn(|k| start[k] - to_start(k) as i64);
        Self {
            axis,
            depth: ray.depth(),
            floor,
            ceiling: std::array::from_fn(|k| floor[k] + (slope[k] << ray.depth())),
            start,
            first_storey: u32::try_from(w >> FRACTION_BITS).unwrap_or(0),
        }
    }

    /// The line's main axis.
    pub fn main_axis(&self) -> MainAxis {
        self.axis
    }

    /// Points of floor, middle and ceiling of the boxes from `w` to `w + edge` along the main axis, in cells of the
    /// walk's frame (the paper, equation 1). The walk itself finds them by halving, with the same result.
    pub fn points(&self, w: u32, edge: u32) -> [Point; 3] {
        let at = |w: u64, k: usize| {
            let rise = i128::from(self.ceiling[k] - self.floor[k]) * i128::from(w);
            self.floor[k] + i64::try_from(rise >> self.depth).unwrap_or(i64::MAX)
        };
        let (w, edge) = (u64::from(w), u64::from(edge));
        [w, w + edge / 2, w + edge].map(|w| [at(w, 0), at(w, 1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_axis_is_the_greatest_absolute_value_and_ties_go_to_the_first() {
        // All 26 directions of signs and zeros.
        for x in -1..=1_i64 {
            for y in -1..=1_i64 {
                for z in -1..=1_i64 {
                    let d = [x, y, z];
                    let Some(first) = d.iter().position(|c| *c != 0) else { continue };
                    let axis = MainAxis::of(d);
                    assert_eq!(axis.number(), first, "{d:?}");
                    for a in 0..3 {
                        assert_eq!(axis.is_mirrored(a), d[a] < 0, "{d:?}");
                    }
                }
            }
        }
        assert_eq!(MainAxis::of([1, -3, 2]).number(), 1);
        assert_eq!(MainAxis::of([1, -3, -4]).number(), 2);
    }

    #[test]
    fn points_lie_on_the_ray() {
        let mut random = crate::render::selfcheck::Random::new(14);
        for depth in [1, 3, 10, 16] {
            for _ in 0..20_000 {
                let side = f64::from(1_u32 << depth);
                let mut number = || (random.bits() >> 11) as f64 / (1_u64 << 53) as f64;
                let origin: [f64; 3] = std::array::from_fn(|_| (number() * 3.0 - 1.0) * side);
                let direction: [f64; 3] = std::array::from_fn(|_| number() - 0.5);
                let Some(ray) = Ray::new(depth, origin, direction, 0.0).unwrap() else { continue };
                let line = Line::new(&ray);
                let (o, d) = (ray.origin().map(|c| c as f64 / 65536.0), ray.direction().map(|c| c as f64));
                let w = line.main_axis().number();
                let edge = 2_u32;
                for at in [0, (1 << depth) - edge] {
                    for (point, w_at) in line.points(at, edge).into_iter().zip([at, at + 1, at + 2]) {
                        let plane =
                            if line.axis.is_mirrored(w) { side - f64::from(w_at) } else { f64::from(w_at) };
                        for (k, c) in point.into_iter().enumerate() {
                            let a = line.axis.grid_axis(k);
                            let want = o[a] + (plane - o[w]) * d[a] / d[w];
                            let want = if line.axis.is_mirrored(a) { side - want } else { want };
                            let got = c as f64 / (1_u64 << POINT_BITS) as f64;
                            assert!((got - want).abs() < 1.0 / (1 << 22) as f64, "{got} is not {want}");
                        }
                    }
                }
                // Slopes are at most 1, so neighbouring points lie in the same or in neighbouring cells.
                for k in 0..2 {
                    let rise = line.ceiling[k] - line.floor[k];
                    assert!((0..=1_i64 << (POINT_BITS + depth)).contains(&rise));
                }
            }
        }
    }
}
