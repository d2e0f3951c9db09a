//! The rays of a tile as one beam: their common part, and their differences.
//!
//! For a pair of axes (a, b) and a point p let `e = (p_a - o_a) d_b - (p_b - o_b) d_a`: the distance of p from the ray
//! in the projection onto a and b. A square of edge 1 around p is intersected by the ray's line if and only if `|e| <=
//! (d_a + d_b) / 2`. As origin or direction is the same for all rays, e is affine in the pixel, so its extremes are at
//! the four corners.

use crate::cpu::{Lanes, SINGLES, Truths};
use crate::format::cell::Plane;
use crate::render::line::{ALONG_A, ALONG_B, SLACK, intersected, slopes};
use crate::render::occupancy::{PAIRS, at_least, extrude};
use crate::render::pairs::{Lines, SLACKS};
use crate::render::pixel_rays::Pencil;
use crate::render::single::LargerLeaf;

use super::listed::MAX_OFF;
use super::words::Affines;

/// Pixels along a side of a tile.
pub const TILE: usize = 8;

/// Rays of a tile.
pub const RAYS: usize = TILE * TILE;

/// Blocks of a tile's rays that fill the lanes of singles.
const BLOCKS: usize = RAYS / SINGLES;

/// Directions within this part of the longest component count as parallel to the axis' plane: they have the exact
/// integer 0. Those above [`SURELY_MOVES`] have other integers.
const SURELY_STILL: f64 = 1.0 / (1_u64 << 33) as f64;
pub(super) const SURELY_MOVES: f64 = 1.0 / (1_u64 << 27) as f64;

/// Pixel column of each lane, and its row, in the first two rows.
const COLUMN: [f32; SINGLES] = [0., 1., 2., 3., 4., 5., 6., 7., 0., 1., 2., 3., 4., 5., 6., 7.];
const ROW: [f32; SINGLES] = [0., 0., 0., 0., 0., 0., 0., 0., 1., 1., 1., 1., 1., 1., 1., 1.];

/// The part common to all boxes that a beam is compared with. Mirrored coordinates, in edges of the finest boxes;
/// directions are scaled to at most 1.
pub(super) struct Beam<L: Lanes> {
    pub(super) lanes: L,
    /// Mask of the mirrored axes.
    pub(super) mirror: u32,
    /// Origin and its change with x and y; direction in the same form.
    origin: [[f64; 3]; 3],
    direction: [[f64; 3]; 3],
    /// For each pair, the contribution of a moving origin to the change of e with x and y.
    shift: [[f64; 2]; 3],
    /// For each pair: cells of a plane are intersected by some ray only if `-max e <= upper` and `lower <= -min e`,
    /// with e at the plane's middle.
    upper: [L::F; 3],
    lower: [L::F; 3],
    /// Starts of the rays, if some box may lie behind one.
    starts: Option<Starts>,
    /// Error bound of e at a box near some ray.
    slack: f32,
    /// Error bound of an origin, by axis.
    start_slack: [f64; 3],
    /// Greatest |e| of a brick's middle at which a ray may intersect the brick, by pair.
    brick_half: [f32; 3],
}

/// Least and greatest origin of a beam's rays by axis, each moved outwards by [`SLACK`]. For an axis without motion
/// both are beyond all boxes, so that it decides nothing.
#[derive(Clone, Copy)]
struct Starts {
    least: [f64; 3],
    greatest: [f64; 3],
}

impl Starts {
    /// True if a box with this low corner lies beyond all origins along some axis. Then no point of it, and of no box
    /// within it, is behind a ray that passes through it.
    #[inline(always)]
    fn are_before(&self, low: [u32; 3]) -> bool {
        (0..3).any(|a| f64::from(low[a]) >= self.greatest[a])
    }
}

/// Certain results of a tile's rays for a plane in a box, as bits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sides {
    /// Rays that meet the plane within the box.
    pub(super) within: u64,
    /// Rays without a certain result.
    pub(super) unsure: u64,
}

/// The differences of a tile's rays.
#[repr(align(64))]
pub(super) struct Rays {
    /// Direction by axis, then half the width of a cell's projection by pair.
    direction: [[f32; RAYS]; 3],
    half: [[f32; RAYS]; 3],
    /// e of the middle of the brick last compared, by pair.
    beside: [[f32; RAYS]; 3],
}

impl Rays {
    pub(super) const fn new() -> Self {
        Self { direction: [[0.0; RAYS]; 3], half: [[0.0; RAYS]; 3], beside: [[0.0; RAYS]; 3] }
    }
}

/// Least and greatest value of an affine function of the pixel, by axis.
#[inline(always)]
fn extremes(v: &[[f64; 3]; 3]) -> [(f64, f64); 3] {
    let last = (TILE - 1) as f64;
    each3!(A => {
        let (x, y) = (v[1][A] * last, v[2][A] * last);
        (v[0][A] + x.min(0.0) + y.min(0.0), v[0][A] + x.max(0.0) + y.max(0.0))
    })
}

/// Error bound of e anywhere in the grid, and of half a brick's projection, for errors of origins and of directions of
/// at most 1; `reach` is the greatest distance of the origin of pixel (0, 0) from a point of the grid.
#[inline(always)]
fn off_lines(reach: [f64; 3], origin: &[[f64; 3]; 3], off_origin: [f64; 3], off_direction: [f64; 3]) -> f64 {
    let last = (TILE - 1) as f64;
    let far = each3!(A => {
        let moved = last * (origin[1][A].abs() + origin[2][A].abs()) + off_origin[A];
        // Both half edges of a brick.
        (reach[A] + moved).max(4.0)
    });
    PAIRS.iter().fold(0.0_f64, |m, (a, b)| {
        let directions = far[*a] * off_direction[*b] + far[*b] * off_direction[*a];
        m.max(directions + off_origin[*a] + off_origin[*b])
    })
}

/// The lanes of `block`.
#[inline(always)]
fn block(values: &[f32; RAYS], block: usize) -> &[f32; SINGLES] {
    &values.as_chunks().0[block]
}

#[inline(always)]
fn block_mut(values: &mut [f32; RAYS], block: usize) -> &mut [f32; SINGLES] {
    &mut values.as_chunks_mut().0[block]
}

impl<L: Lanes> Beam<L> {
    /// The beam of a pencil of rays in a grid of 2^depth cells; boxes have an edge of 2^unit cells.
    ///
    /// `None` when an axis changes its sign within the tile, or may do so.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn new(l: L, pencil: &Pencil, depth: u32, unit: u32, rays: &mut Rays) -> Option<Self> {
        let size = f64::from(1_u32.wrapping_shl(depth - unit));
        let per_unit = 1.0 / f64::from(1_u32.wrapping_shl(unit));
        let (mut origin, mut direction) = (pencil.origin, pencil.direction);
        let range: [(f64, f64); 3] = extremes(&direction);
        let longest = range.iter().fold(0.0_f64, |m, r| m.max(r.1).max(-r.0));
        // Every ray has a component at least this long.
        let shortest = range.iter().fold(0.0_f64, |m, r| m.max(r.0).max(-r.1));
        let (mut mirror, mut still) = (0, [false; 3]);
        for a in 0..3 {
            if range[a].1 < -SURELY_MOVES * longest {
                mirror |= 1 << a;
            } else if range[a].0 > -SURELY_STILL * shortest && range[a].1 < SURELY_STILL * shortest {
                still[a] = true;
            } else if range[a].0 > SURELY_MOVES * longest {
                // It certainly moves forwards.
            } else {
                // NaN is uncertain as well.
                return None;
            }
        }
        for a in 0..3 {
            let sign = if mirror >> a & 1 == 1 { -1.0 } else { 1.0 };
            for i in 0..3 {
                origin[i][a] *= sign * per_unit;
                direction[i][a] *= if still[a] { 0.0 } else { sign / longest };
            }
            if sign < 0.0 {
                origin[0][a] += size;
            }
        }
        let shift = PAIRS
            .map(|(a, b)| [1, 2].map(|i| origin[i][b] * direction[0][a] - origin[i][a] * direction[0][b]));
        // Rounding of e as singles grows with its change from pixel to pixel.
        let reach: [f64; 3] = std::array::from_fn(|a| origin[0][a].abs().max((size - origin[0][a]).abs()));
        let change = PAIRS.iter().zip(&shift).fold(0.0_f64, |m, ((a, b), shift)| {
            let of = |i: usize| {
                reach[*a] * direction[i][*b].abs() + reach[*b] * direction[i][*a].abs() + shift[i - 1].abs()
            };
            m.max(of(1) + of(2))
        });
        let (mut off, mut start_slack) = (0.0, [f64::from(SLACK); 3]);
        if let Some([off_origin, off_direction]) = pencil.off {
            let off_origin = off_origin.map(|off| off * per_unit);
            off = off_lines(reach, &origin, off_origin, off_direction.map(|off| off / longest));
            start_slack = off_origin.map(|off| off + f64::from(SLACK));
        }
        if off > MAX_OFF {
            return None;
        }
        let slack = SLACK + (8.0 + 14.0 * change) as f32 * (1.0 / 2_097_152.0) + off as f32;

        let (along_a, along_b) = (l.f_load(&ALONG_A), l.f_load(&ALONG_B));
        let range: [(f64, f64); 3] = extremes(&direction);
        let middle = range.map(|(low, high)| ((low + high) / 2.0) as f32);
        let radius = range.map(|(low, high)| ((high - low) / 2.0) as f32);
        let greatest = range.map(|(_, high)| high as f32);
        let bounds = each3!(PAIR => {
            const A: usize = PAIRS[PAIR].0;
            const B: usize = PAIRS[PAIR].1;
            let slope = along_a * l.f(middle[B]) - along_b * l.f(middle[A]);
            let spread = l.f_abs(along_a) * l.f(radius[B]) + l.f_abs(along_b) * l.f(radius[A]);
            let most = spread + l.f(0.5 * (greatest[A] + greatest[B]) + slack);
            (slope + most, slope - most)
        });
        for (a, out) in rays.direction.iter_mut().enumerate() {
            let [constant, x, y] = [0, 1, 2].map(|i| direction[i][a] as f32);
            let mut row = l.f(constant) + l.f_load(&COLUMN) * l.f(x) + l.f_load(&ROW) * l.f(y);
            for i in 0..BLOCKS {
                l.f_store(row, block_mut(out, i));
                row = row + l.f(2.0 * y);
            }
        }
        for ((a, b), out) in PAIRS.into_iter().zip(&mut rays.half) {
            for i in 0..BLOCKS {
                let (da, db) =
                    (l.f_load(block(&rays.direction[a], i)), l.f_load(block(&rays.direction[b], i)));
                l.f_store((da + db) * l.f(0.5) + l.f(slack), block_mut(out, i));
            }
        }
        let origins: [(f64, f64); 3] = extremes(&origin);
        // A ray that comes from outside the grid along some axis has nothing behind it in the grid.
        let starts_inside = (0..3).all(|a| still[a] || origins[a].1 > 0.0);
        Some(Self {
            lanes: l,
            mirror,
            origin,
            direction,
            shift,
            upper: each3!(PAIR => bounds[PAIR].0),
            lower: each3!(PAIR => bounds[PAIR].1),
            starts: starts_inside.then(|| Starts {
                least: each3!(A => if still[A] { f64::MIN } else { origins[A].0 - start_slack[A] }),
                greatest: each3!(A => if still[A] { f64::MAX } else { origins[A].1 + start_slack[A] }),
            }),
            slack,
            start_slack,
            brick_half: PAIRS.map(|(a, b)| 2.0 * (greatest[a] + greatest[b]) + slack),
        })
    }

    /// e at the point, its change with x, and with y, for each pair.
    #[inline(always)]
    fn beside(&self, point: [f64; 3]) -> [[f64; 3]; 3] {
        let p = each3!(A => point[A] - self.origin[0][A]);
        let d = &self.direction;
        each3!(PAIR => {
            const A: usize = PAIRS[PAIR].0;
            const B: usize = PAIRS[PAIR].1;
            [
                p[A] * d[0][B] - p[B] * d[0][A],
                p[A] * d[1][B] - p[B] * d[1][A] + self.shift[PAIR][0],
                p[A] * d[2][B] - p[B] * d[2][A] + self.shift[PAIR][1],
            ]
        })
    }

    /// Mask of the 4 x 4 x 4 boxes with an edge of `2^edge` from `low` on that some ray may intersect.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn intersected(&self, low: [u32; 3], edge: u32) -> u64 {
        let l = self.lanes;
        let half = f64::from(2_u32.wrapping_shl(edge));
        let per_edge = 2.0 / half;
        let last = (TILE - 1) as f64;
        let e = self.beside(each3!(A => f64::from(low[A]) + half));
        let mut boxes = u64::MAX;
        for (pair, [at, x, y]) in e.into_iter().enumerate() {
            let (x, y) = (x * last, y * last);
            let most = at + x.max(0.0) + y.max(0.0);
            let least = at + x.min(0.0) + y.min(0.0);
            let above = l.f_le(l.f((-most * per_edge) as f32), self.upper[pair]);
            let below = l.f_le(self.lower[pair], l.f((-least * per_edge) as f32));
            boxes &= extrude(l, pair, (above & below).bits());
        }
        if let Some(starts) = self.starts {
            for (a, (least, low)) in starts.least.into_iter().zip(low).enumerate() {
                let passed = (least - f64::from(low)) * per_edge;
                boxes &= at_least(a, passed.clamp(0.0, 4.0) as u32);
            }
        }
        boxes
    }

    /// Mask of the rays `live` that may intersect the brick of finest boxes at `low`; [`Beam::intersected_by`] then
    /// refers to this brick.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn meets(&self, rays: &mut Rays, low: [u32; 3], live: u64) -> u64 {
        let l = self.lanes;
        let e = self.beside(each3!(A => f64::from(low[A]) + 2.0));
        let (column, row) = (l.f_load(&COLUMN), l.f_load(&ROW));
        let everywhere = l.f_le(l.f(0.0), l.f(0.0));
        let mut near = [everywhere; BLOCKS];
        for (pair, [at, x, y]) in e.into_iter().enumerate() {
            let half = l.f(self.brick_half[pair]);
            let mut beside = l.f(at as f32) + column * l.f(x as f32) + row * l.f(y as f32);
            let step = l.f(2.0 * y as f32);
            for (i, near) in near.iter_mut().enumerate() {
                l.f_store(beside, block_mut(&mut rays.beside[pair], i));
                *near = *near & l.f_le(l.f_abs(beside), half);
                beside = beside + step;
            }
        }
        let mut bits = 0;
        for (i, near) in near.into_iter().enumerate() {
            bits |= u64::from(near.bits()) << (SINGLES * i);
        }
        bits & live
    }

    /// True if a box of the brick at `low` may lie behind a ray.
    #[inline(always)]
    pub(super) fn may_be_behind(&self, low: [u32; 3]) -> bool {
        self.starts.is_some_and(|starts| !starts.are_before(low))
    }

    /// Boxes of the brick last given to [`Beam::meets`], at `low`, that `ray` may intersect; `may_be_behind` is the
    /// brick's [`Beam::may_be_behind`].
    #[inline(always)]
    pub(super) fn intersected_by(&self, rays: &Rays, ray: usize, low: [u32; 3], may_be_behind: bool) -> u64 {
        let l = self.lanes;
        let ray = ray % RAYS;
        let slopes = slopes(l, each3!(A => l.f(rays.direction[A][ray])));
        let mut boxes = u64::MAX;
        for (pair, slope) in slopes.into_iter().enumerate() {
            boxes &= intersected(l, pair, rays.beside[pair][ray], slope, rays.half[pair][ray]);
        }
        if may_be_behind && let Some(starts) = self.starts {
            boxes &= self.ahead_of(starts.least, ray, low);
        }
        boxes
    }

    /// The rays' lines about the brick last given to [`Beam::meets`].
    #[inline(always)]
    pub(super) fn lines<'r>(&self, rays: &'r Rays) -> Lines<'r> {
        Lines { direction: &rays.direction, beside: &rays.beside, slack: SLACKS * self.slack }
    }

    /// The rays' lines about the brick at `low`, as functions of the pixel.
    #[inline(always)]
    pub(super) fn affines(&self, low: [u32; 3]) -> Affines {
        let e = self.beside(each3!(A => f64::from(low[A]) + 2.0));
        Affines::new(&self.direction, &e, self.slack)
    }

    /// Certain results of the rays `live` for the plane of a larger leaf that is nowhere behind a ray, as in
    /// [`crate::render::pairs`]; in edges of the leaf, in which estimates are at most as far off as in edges of the
    /// finest boxes.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "estimates within SLACK")]
    pub(super) fn sides(&self, rays: &Rays, leaf: &LargerLeaf, plane: &Plane, live: u64) -> Sides {
        let l = self.lanes;
        let edge = f64::from(1_u32.wrapping_shl(leaf.edge));
        let e = self.beside(each3!(A => f64::from(leaf.low[A]) + 0.5 * edge));
        let n = each3!(A => {
            let n = plane.normal[A] as f32;
            l.f(if self.mirror >> A & 1 == 1 { -n } else { n })
        });
        let (zero, k) = (l.f(0.0), l.f(plane.offset as f32 * 0.5));
        let (slack, per_edge) = (l.f(SLACKS * self.slack), 1.0 / edge);
        let step = e.map(|[_, _, y]| l.f((2.0 * y * per_edge) as f32));
        let mut e = each3!(PAIR => {
            let [at, x, y] = e[PAIR].map(|e| (e * per_edge) as f32);
            l.f(at) + l.f_load(&COLUMN) * l.f(x) + l.f_load(&ROW) * l.f(y)
        });
        let mut sides = Sides { within: 0, unsure: 0 };
        for i in 0..BLOCKS {
            let d = each3!(A => l.f_load(block(&rays.direction[A], i)));
            let half = each3!(PAIR => l.f_load(block(&rays.half[PAIR], i)));
            let near = each3!(PAIR => l.f_le(l.f_abs(e[PAIR]), half[PAIR]));
            let at_x = n[1] * e[0] + n[2] * e[1] - d[0] * k;
            let at_y = n[2] * e[2] - n[0] * e[0] - d[1] * k;
            let at_z = zero - n[0] * e[1] - n[1] * e[2] - d[2] * k;
            let s = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
            let half = l.f_abs(s) * l.f(0.5);
            let (beyond, inner) = (half + slack, half - slack);
            let past = l.f_le(beyond, at_x) | l.f_le(beyond, at_y) | l.f_le(beyond, at_z);
            let within = l.f_le(l.f_abs(at_x), inner)
                & l.f_le(l.f_abs(at_y), inner)
                & l.f_le(l.f_abs(at_z), inner)
                & l.f_le(s, zero);
            let met = near[0] & near[1] & near[2] & !past;
            sides.within |= u64::from((met & within).bits()) << (SINGLES * i);
            sides.unsure |= u64::from((met & !within).bits()) << (SINGLES * i);
            e = each3!(PAIR => e[PAIR] + step[PAIR]);
        }
        Sides { within: sides.within & live, unsure: sides.unsure & live }
    }

    /// Boxes of the brick at `low` that do not lie behind the origin of `ray`.
    #[cold]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    fn ahead_of(&self, start: [f64; 3], ray: usize, low: [u32; 3]) -> u64 {
        let (x, y) = ((ray % TILE) as f64, (ray / TILE) as f64);
        (0..3).filter(|a| start[*a] > f64::MIN).fold(u64::MAX, |boxes, a| {
            let o = self.origin[0][a] + x * self.origin[1][a] + y * self.origin[2][a];
            let passed = (o - self.start_slack[a] - f64::from(low[a])).clamp(0.0, 4.0) as u32;
            boxes & at_least(a, passed)
        })
    }
}
