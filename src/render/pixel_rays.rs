//! The rays of a picture: one, eight in a row, or as affine functions of the pixel.
//!
//! All begin as the same formula in f64 and are rounded by the same operations, so a ray made with its row has the same
//! integers as a ray made alone by [`crate::render::ray::Ray`].

use super::camera::Camera;
use super::ray::{DIRECTION_BITS, FRACTION_BITS, Ray};
use super::space::GridSpace;
use super::tile::{RAYS, TILE};
use crate::cpu::{DOUBLES, Lanes};

/// The lines of sight through a picture's pixels.
#[derive(Clone, Copy, Debug)]
pub struct PixelRays<'a> {
    space: &'a GridSpace,
    camera: &'a Camera,
    width: f64,
    height: f64,
    /// The rays as affine functions of the pixel, if they are close enough.
    pencil: Option<Pencil>,
}

/// Rays in grid space as affine functions of the pixel (x, y): not the exact rays, but within 2^-16 cell of
/// them across the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pencil {
    /// Origin of the ray of pixel (0, 0), its change from pixel to pixel in x, and in y.
    pub(super) origin: [[f64; 3]; 3],
    /// Direction, in the same form. For cameras, either this or the origin is constant.
    pub(super) direction: [[f64; 3]; 3],
    /// Largest deviation of the rays' origins, and of their directions, from these functions, if it is more.
    pub(super) off: Option<[[f64; 3]; 2]>,
}

/// Eight rays with the values of [`Ray`], in lanes; integers as doubles.
#[derive(Clone, Copy)]
pub(super) struct Row<L: Lanes> {
    /// Lanes that hold a ray; the others may still be rays, with numbers too large or small for this method.
    pub(super) valid: L::Truths,
    pub(super) origin: [L::D; 3],
    pub(super) direction: [L::D; 3],
    /// Rays that entered the grid by a face of this axis; at most one of the three.
    pub(super) entry: [L::Truths; 3],
    pub(super) t_start: L::D,
    pub(super) t_scale: L::D,
}

/// Rays with numbers that are sums of larger ones than this, in cells, are not estimated: the estimate could be off by
/// more than 2^-16 cell.
pub(super) const MAX_CELLS: f64 = (1_u64 << 30) as f64;

/// Limit for directions: sums of numbers this many times their longest component.
const MAX_CANCELLED: f64 = 1024.0;

/// Exponents of directions that rows are made for: scaling by 2^400 at once or in two steps is the same.
const MAX_EXPONENT: i64 = 400;

impl Pencil {
    /// The pencil of a picture of this size; `None` where rounding, here or in the exact rays, could move a ray by more
    /// than 2^-16 cell within the grid.
    fn new(space: &GridSpace, camera: &Camera, width: f64, height: f64) -> Option<Self> {
        let frame = camera.frame();
        let matrix = &space.world_to_grid().rows;
        let first = (1.0 / width - 1.0, 1.0 - 1.0 / height);
        let step = (2.0 / width, -2.0 / height);
        let in_grid = |v: [f64; 3]| matrix.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2]);
        let affine = |[constant, across, along]: [[f64; 3]; 3]| {
            let at = std::array::from_fn(|i| constant[i] + first.0 * across[i] + first.1 * along[i]);
            [in_grid(at), in_grid(across).map(|c| c * step.0), in_grid(along).map(|c| c * step.1)]
        };
        // The greatest sum of sizes of a coordinate's terms, anywhere in the picture.
        let summed = |vectors: [[f64; 3]; 3]| {
            let size: [f64; 3] = std::array::from_fn(|i| vectors.iter().map(|v| v[i].abs()).sum());
            matrix.map(|r| r[0].abs() * size[0] + r[1].abs() * size[1] + r[2].abs() * size[2])
        };
        let (mut origin, direction) = (affine(frame.origin), affine(frame.direction));
        let most = summed(frame.origin)
            .iter()
            .zip(matrix)
            .fold(0.0_f64, |most, (sum, r)| most.max(sum + r[3].abs()));
        let most_direction = summed(frame.direction).iter().fold(0.0_f64, |most, sum| most.max(*sum));
        // In the middle of the picture, where all of a perspective camera's rays are about equally long.
        let longest = in_grid(frame.direction[0]).iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        if !(most <= MAX_CELLS && most_direction <= MAX_CANCELLED * longest) {
            return None;
        }
        for a in 0..3 {
            origin[0][a] += matrix[a][3];
        }
        Some(Self { origin, direction, off: None })
    }
}

impl<'a> PixelRays<'a> {
    /// The lines of sight of a camera through a picture of this size in pixels.
    pub fn new(space: &'a GridSpace, camera: &'a Camera, width: u32, height: u32) -> Self {
        let (width, height) = (f64::from(width), f64::from(height));
        Self { space, camera, width, height, pencil: Pencil::new(space, camera, width, height) }
    }

    /// The space of the rays.
    pub(crate) fn space(&self) -> &'a GridSpace {
        self.space
    }

    /// Line of sight in the world through a point of the picture in pixels from its top left corner:
    /// origin, and direction.
    #[inline]
    pub(crate) fn line(&self, x: f64, y: f64) -> ([f64; 3], [f64; 3]) {
        self.camera.ray((2.0 * x - self.width) / self.width, (self.height - 2.0 * y) / self.height)
    }

    /// Directions of the lines through the pixels of the tile at `corner`, axis by axis, equal to [`PixelRays::line`].
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "loops like this one are vectorised")]
    pub(super) fn directions(&self, corner: [usize; 2], out: &mut [[f64; RAYS]; 3]) {
        let frame = self.camera.frame();
        let (half_width, half_height) = self.camera.half_sides();
        let [right, up, forward] = [frame.unit_right, frame.unit_up, frame.direction[0]];
        for i in 0..RAYS {
            let x = (corner[0] + i % TILE) as f64 + 0.5;
            let y = (corner[1] + i / TILE) as f64 + 0.5;
            let across = (2.0 * x - self.width) / self.width * half_width;
            let along = (self.height - 2.0 * y) / self.height * half_height;
            for a in 0..3 {
                out[a][i] =
                    if frame.parallel { forward[a] } else { forward[a] + across * right[a] + along * up[a] };
            }
        }
    }

    /// The ray through a point of the picture; `None` when it misses the grid.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Option<Ray> {
        let (origin, direction) = self.line(x, y);
        // A camera's rays are finite and have a direction; one that overflows in the grid sees nothing.
        self.space.ray(origin, direction).ok().flatten()
    }

    /// The rays as affine functions of the pixel counted from `corner`; `None` where these are not close enough to the
    /// exact rays.
    #[inline(always)]
    pub(super) fn pencil(&self, corner: (usize, usize)) -> Option<Pencil> {
        let (x, y) = (corner.0 as f64, corner.1 as f64);
        let mut pencil = self.pencil?;
        for rays in [&mut pencil.origin, &mut pencil.direction] {
            #[expect(clippy::needless_range_loop, reason = "axes of several arrays at once")]
            for a in 0..3 {
                rays[0][a] += x * rays[1][a] + y * rays[2][a];
            }
        }
        Some(pencil)
    }

    /// The rays of eight pixels of a row from (x, y) on.
    #[inline(always)]
    pub(super) fn row<L: Lanes>(&self, l: L, (x, y): (usize, usize)) -> Row<L> {
        let column: [f64; DOUBLES] = std::array::from_fn(|i| (x + i) as f64 + 0.5);
        // As in `line`, `Camera::ray` and `GridSpace::ray`: the same operations in the same order.
        let x = (l.d(2.0) * l.d_load(&column) - l.d(self.width)) / l.d(self.width);
        let y = (self.height - 2.0 * (y as f64 + 0.5)) / self.height;
        let frame = self.camera.frame();
        let (half_width, half_height) = self.camera.half_sides();
        let (across, along) = (x * l.d(half_width), l.d(y * half_height));
        let [right, up] = [frame.unit_right, frame.unit_up];
        let [from, towards] = [frame.origin[0], frame.direction[0]];
        let matrix = &self.space.world_to_grid().rows;
        let (from, towards) = if frame.parallel {
            (
                each3!(A => l.d(from[A]) + across * l.d(right[A]) + along * l.d(up[A])),
                each3!(A => l.d(towards[A])),
            )
        } else {
            (
                each3!(A => l.d(from[A])),
                each3!(A => l.d(towards[A]) + across * l.d(right[A]) + along * l.d(up[A])),
            )
        };
        let origin = each3!(A => {
            let r = matrix[A];
            l.d(r[0]) * from[0] + l.d(r[1]) * from[1] + l.d(r[2]) * from[2] + l.d(r[3])
        });
        let direction = each3!(A => {
            let r = matrix[A];
            l.d(r[0]) * towards[0] + l.d(r[1]) * towards[1] + l.d(r[2]) * towards[2]
        });
        quantised(l, self.space.dims().depth(), origin, direction)
    }
}

/// [`Ray::new`] with a near limit of 0, eight at a time: the same operations in the same order, choices instead of
/// branches.
#[inline(always)]
pub(super) fn quantised<L: Lanes>(l: L, depth: u32, origin: [L::D; 3], direction: [L::D; 3]) -> Row<L> {
    let zero = l.d(0.0);
    let mut sum = zero;
    for v in origin.into_iter().chain(direction) {
        sum = sum + v * zero;
    }
    let mut valid = l.d_eq(sum, zero);
    let mut longest = zero;
    for v in direction {
        let size = l.d_abs(v);
        longest = l.d_choose(l.d_lt(longest, size), size, longest);
    }
    // 2^-exponent has the exponent field 2046 - field.
    let field = l.exponent_field(longest);
    valid = valid & l.i_gt(l.i(1023 + MAX_EXPONENT), field) & l.i_gt(field, l.i(1023 - MAX_EXPONENT));
    let to_unit = l.power(l.i(2046) - field);
    let d = each3!(A => direction[A] * to_unit + zero);
    let half = f64::from(1_u32.wrapping_shl(depth)) / 2.0;
    let p = each3!(A => origin[A] - l.d(half));

    let none = l.d_lt(zero, zero);
    let mut t_enter = zero;
    let mut entered = none;
    let mut enters = [none; 3];
    let mut outside = [none; 3];
    for a in 0..3 {
        outside[a] = l.d_lt(l.d(half), l.d_abs(p[a]));
        let ahead = (l.d_lt(p[a], zero) & l.d_lt(zero, d[a])) | (!l.d_lt(p[a], zero) & l.d_lt(d[a], zero));
        valid = valid & (ahead | !outside[a]);
        let t = (l.d_with_sign(l.d(half), p[a]) - p[a]) / d[a];
        let later = outside[a] & (!entered | l.d_lt(t_enter, t));
        t_enter = l.d_choose(later, t, t_enter);
        entered = entered | outside[a];
        for (b, enters) in enters.iter_mut().enumerate() {
            *enters = if a == b { later } else { *enters & !later };
        }
    }
    let unit = f64::from(1_u32 << FRACTION_BITS);
    let limit = l.d(half * unit);
    let no_fraction = l.d(6_755_399_441_055_744.0);
    let mut entry = [none; 3];
    let mut came = none;
    let mut fixed = p;
    for a in 0..3 {
        let on_face = l.d_with_sign(l.d(half), p[a]);
        let at = l.d_choose(enters[a], on_face, p[a] + t_enter * d[a]) * l.d(unit);
        let at = (at + no_fraction) - no_fraction;
        valid = valid & l.d_le(l.d_abs(at), limit);
        entry[a] = outside[a] & l.d_eq(at, l.d_with_sign(limit, p[a])) & !came;
        came = came | entry[a];
        fixed[a] = at + limit;
    }
    let scale = f64::from(1_u32 << (DIRECTION_BITS - 1));
    Row {
        valid,
        origin: fixed,
        direction: each3!(A => (d[A] * l.d(scale) + no_fraction) - no_fraction),
        entry,
        t_start: t_enter * to_unit + zero,
        t_scale: l.d(scale / unit) * to_unit + zero,
    }
}
