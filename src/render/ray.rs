//! Rays in the grid: set up once in f64, then integers.
//!
//! *Grid space* has cell (i, j, k) at `[i, i+1) x [j, j+1) x [k, k+1)`, 0..2^L along each axis; a voxel
//! index of the affine is a cell's centre, so `grid = index + 0.5`.

use thiserror::Error;

/// Fraction bits of an origin coordinate: 1/65536 of a cell.
pub const FRACTION_BITS: u32 = 16;

/// The largest component of a quantised direction is within `2^(DIRECTION_BITS-1) ..= 2^DIRECTION_BITS`.
/// Across the largest grid the direction's rounding moves a ray by at most 2^-14 cell.
pub const DIRECTION_BITS: u32 = 30;

/// Greatest octree depth.
pub(crate) const MAX_DEPTH: u32 = 16;

// A traversal only multiplies a plane-to-origin distance by a direction component: the distance is at most one cell
// more than the grid, the component at most 2^DIRECTION_BITS. Such a product must fit an i64 with its sign.
const _: () = {
    let distance = ((1_i128 << MAX_DEPTH) + 1) << FRACTION_BITS;
    assert!(distance << DIRECTION_BITS <= i64::MAX as i128);
    // Distances and components are also exact as f64, which the estimates rely on.
    assert!(distance < 1 << 53 && DIRECTION_BITS < 53);
};

/// One of a box's six faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Face {
    /// Axis perpendicular to the face: 0, 1, 2 for x, y, z.
    pub axis: u8,
    /// True for the face on the high side, with its outward normal along +axis.
    pub high: bool,
}

impl Face {
    /// The face of axis 0, 1 or 2, on its low or high side.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "an axis is 0, 1 or 2")]
    pub const fn new(axis: usize, high: bool) -> Self {
        Self { axis: axis as u8, high }
    }
}

/// Reason to refuse a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "the sentence of each variant says it")]
pub enum BadRay {
    #[error("the ray has a coordinate that is not a finite number")]
    NotFinite,
    #[error("the ray has no direction")]
    NoDirection,
    #[error("the grid is deeper than 16 levels")]
    TooDeep,
}

/// A ray in the traversal: integers, starting in or on the grid.
///
/// These integers define the ray; earlier operations in f64 are quantisation, and the traversal adds no error of its
/// own. A ray that begins outside the grid is moved to its entry point first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    depth: u32,
    origin: [i64; 3],
    direction: [i64; 3],
    entry: Option<Face>,
    t_start: f64,
    t_scale: f64,
}

impl Ray {
    /// Quantises the ray `origin + t * direction`, `t >= t_min`, given in grid space; `Ok(None)` when it
    /// misses the grid.
    ///
    /// Origins are rounded to 2^-16 cell, directions to 2^-29 of their largest component; multiples of these (such as
    /// small integers) stay exact. The arithmetic is symmetric: a ray mirrored or permuted about the grid's centre has
    /// mirrored or permuted integers. -0.0 is 0.
    ///
    /// Within the grid the quantised ray is never farther from the given one than `2^-16 + 2^(depth-29) + 2^-49 D`
    /// cells, across its main axis; D is the greatest of the grid's side, the origin's distance and the near limit's.
    /// So two hits differ only where a ray passes an edge that closely (`tests/it/oracle.rs`, by integers without a
    /// limit).
    ///
    /// # Errors
    /// [`BadRay`] for NaN, infinity, a null direction, or `depth` over `MAX_DEPTH`.
    #[inline]
    pub fn new(
        depth: u32,
        origin: [f64; 3],
        direction: [f64; 3],
        t_min: f64,
    ) -> Result<Option<Self>, BadRay> {
        if depth > MAX_DEPTH {
            return Err(BadRay::TooDeep);
        }
        let sum = origin.iter().chain(&direction).fold(t_min * 0.0, |sum, v| sum + v * 0.0);
        if sum != 0.0 {
            return Err(BadRay::NotFinite); // 0 times NaN or infinity is NaN
        }
        let longest = direction.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if longest == 0.0 {
            return Err(BadRay::NoDirection);
        }
        // Scaling by a power of two is exact, so simple directions keep their exact slopes.
        let exponent = exponent_of(longest);
        let d = direction.map(|v| times_power_of_two(v, -exponent));
        let half = power_of_two(depth.cast_signed() - 1);
        let from_centre = origin.map(|v| v - half);
        let t_near = if t_min > 0.0 { times_power_of_two(t_min, exponent) } else { 0.0 };
        let p: [f64; 3] = std::array::from_fn(|a| from_centre[a] + t_near * d[a]);

        let mut t_enter = 0.0_f64;
        let mut enter_axis = None;
        for a in 0..3 {
            if p[a].abs() > half {
                let ahead = if p[a] < 0.0 { d[a] > 0.0 } else { d[a] < 0.0 };
                if !ahead {
                    return Ok(None);
                }
                let t = (half.copysign(p[a]) - p[a]) / d[a];
                if enter_axis.is_none() || t > t_enter {
                    (t_enter, enter_axis) = (t, Some(a));
                }
            }
        }
        let unit = power_of_two(FRACTION_BITS.cast_signed());
        let limit = half * unit;
        let at: [f64; 3] = std::array::from_fn(|a| {
            let at = if enter_axis == Some(a) { half.copysign(p[a]) } else { p[a] + t_enter * d[a] };
            rounded(at * unit)
        });
        // `contains` also catches NaN, which overflow can make of absurdly distant origins.
        if !at.iter().all(|v| (-limit..=limit).contains(v)) {
            return Ok(None);
        }
        let came_by = |a: &usize| p[*a].abs() > half && at[*a] == limit.copysign(p[*a]);
        let entry = (0..3).find(came_by).map(|a| Face::new(a, p[a] > 0.0));
        let scale = power_of_two(DIRECTION_BITS.cast_signed() - 1);
        #[expect(clippy::cast_possible_truncation, reason = "whole numbers, at most 2^32 and 2^30")]
        let (fixed, direction) = (at.map(|v| (v + limit) as i64), d.map(|v| rounded(v * scale) as i64));
        Ok(Some(Self {
            depth,
            origin: fixed,
            direction,
            entry,
            t_start: times_power_of_two(t_near + t_enter, -exponent),
            t_scale: times_power_of_two(scale / unit, -exponent),
        }))
    }

    /// Depth of the grid that the ray was made for.
    #[inline]
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Origin in units of 2^-16 cell: 0..=2^(L+16).
    #[inline]
    pub fn origin(&self) -> [i64; 3] {
        self.origin
    }

    /// Direction, each component within +-2^30, not all 0.
    #[inline]
    pub fn direction(&self) -> [i64; 3] {
        self.direction
    }

    /// Face of the grid that the ray enters by; `None` when it starts inside.
    #[inline]
    pub fn entry(&self) -> Option<Face> {
        self.entry
    }

    /// Parameter t of the quantised origin, along the given ray.
    #[inline]
    pub fn t_start(&self) -> f64 {
        self.t_start
    }

    /// Parameter t after `distance / component` along the quantised direction: both are integers in the units of
    /// [`Ray::origin`] and [`Ray::direction`].
    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "both are below 2^53")]
    pub fn t_after(&self, distance: i64, component: i64) -> f64 {
        self.t_start + distance as f64 / component as f64 * self.t_scale
    }
}

/// Nearest integer, ties to even, for |x| < 2^51: adding 1.5 * 2^52 leaves no fraction bits. Greater values stay about
/// as great. The standard library's is a function call on old processors.
#[inline]
fn rounded(x: f64) -> f64 {
    const NO_FRACTION: f64 = 6_755_399_441_055_744.0;
    (x + NO_FRACTION) - NO_FRACTION
}

/// `e` such that `2^e <= x < 2^(e+1)`, for finite x > 0.
#[inline]
fn exponent_of(x: f64) -> i32 {
    let field = |x: f64| (x.to_bits() >> 52 & 0x7ff) as i32;
    if field(x) == 0 { field(x * power_of_two(64)) - 1023 - 64 } else { field(x) - 1023 }
}

/// `2^e` for a normal result: -1022..=1023.
#[inline]
fn power_of_two(e: i32) -> f64 {
    f64::from_bits(u64::from((e + 1023).cast_unsigned() & 0x7ff) << 52)
}

/// `x * 2^e`, e in -1074..=1074, without an intermediate overflow; exact unless the result leaves the
/// normal range. -0.0 becomes 0.
#[inline]
fn times_power_of_two(x: f64, e: i32) -> f64 {
    x * power_of_two(e / 2) * power_of_two(e - e / 2) + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_rays_are_refused() {
        let o = [1.0, 2.0, 3.0];
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for a in 0..3 {
                let mut v = [1.0; 3];
                v[a] = bad;
                assert_eq!(Ray::new(4, v, [1.0; 3], 0.0), Err(BadRay::NotFinite));
                assert_eq!(Ray::new(4, o, v, 0.0), Err(BadRay::NotFinite));
            }
            assert_eq!(Ray::new(4, o, [1.0; 3], bad), Err(BadRay::NotFinite));
        }
        assert_eq!(Ray::new(4, o, [0.0, -0.0, 0.0], 0.0), Err(BadRay::NoDirection));
        assert_eq!(Ray::new(17, o, [1.0; 3], 0.0), Err(BadRay::TooDeep));
    }

    #[test]
    fn simple_rays_stay_exact() {
        let r = Ray::new(4, [1.5, -0.0, 16.0], [3.0, -1.0, -0.0], 0.0).unwrap().unwrap();
        assert_eq!(r.origin(), [3 << 15, 0, 16 << 16]);
        assert_eq!(r.direction(), [3 << 28, -(1 << 28), 0]);
        assert_eq!((r.entry(), r.t_start()), (None, 0.0));
        assert_eq!(r.t_after(3 << 16, 3 << 28), 1.0);
    }

    #[test]
    fn rounding_is_to_the_nearest_and_symmetric() {
        for (x, want) in [(0.0, 0.0), (0.4999, 0.0), (0.5, 0.0), (1.5, 2.0), (4e9 + 0.75, 4e9 + 1.0)] {
            assert_eq!((rounded(x), rounded(-x)), (want, -want));
        }
        assert!(rounded(f64::MAX) > 1e300 && rounded(f64::NAN).is_nan());
    }

    #[test]
    fn outside_origins_move_to_the_entry_point() {
        let r = Ray::new(3, [-8.0, 2.0, 4.0], [2.0, 0.5, 0.0], 0.0).unwrap().unwrap();
        assert_eq!(r.origin(), [0, 4 << 16, 4 << 16]);
        assert_eq!((r.entry(), r.t_start()), (Some(Face { axis: 0, high: false }), 4.0));
        // Through an edge of the grid: two axes tie, x is named.
        let r = Ray::new(3, [9.0, 9.0, 4.0], [-1.0, -1.0, 0.0], 0.0).unwrap().unwrap();
        assert_eq!(
            (r.origin(), r.entry()),
            ([8 << 16, 8 << 16, 4 << 16], Some(Face { axis: 0, high: true }))
        );
        assert_eq!(Ray::new(3, [-1.0, 2.0, 2.0], [-1.0, 0.0, 0.0], 0.0), Ok(None));
        assert_eq!(Ray::new(3, [-1.0, 9.0, 2.0], [1.0, 0.0, 0.0], 0.0), Ok(None));
        // The near limit counts along the ray, also when it passes the grid altogether.
        let r = Ray::new(3, [-8.0, 2.0, 4.0], [2.0, 0.0, 0.0], 5.0).unwrap().unwrap();
        assert_eq!((r.origin()[0], r.entry(), r.t_start()), (2 << 16, None, 5.0));
        assert_eq!(Ray::new(3, [-8.0, 2.0, 4.0], [2.0, 0.0, 0.0], 9.0), Ok(None));
    }

    #[test]
    fn extreme_magnitudes_neither_panic_nor_lose_the_direction() {
        for scale in [5e-324, 1e-310, 1e-38, 1e-12, 1e12, 1e300] {
            let r = Ray::new(2, [-1.0, 1.5, 1.5], [scale, 0.0, -0.0], 0.0).unwrap().unwrap();
            assert_eq!(r.direction()[1..], [0, 0]);
            assert!((1 << 29..=1 << 30).contains(&r.direction()[0]), "{scale}");
        }
        for far in [1e7, 1e15, 1e300, f64::MAX] {
            for d in [[1.0, 5e-324, -5e-324], [f64::MAX, -f64::MAX, 1.0], [5e-324, 0.0, 0.0]] {
                let _ = Ray::new(16, [-far, far, 0.0], d, 0.0).unwrap();
                let _ = Ray::new(0, [-far, 0.5, 0.5], d, far).unwrap();
            }
        }
        let r = Ray::new(8, [-1e7, 128.5, 128.5], [1.0, 0.0, 0.0], 0.0).unwrap().unwrap();
        assert_eq!((r.t_start(), r.origin()), (1e7, [0, 257 << 15, 257 << 15]));
    }
}
