//! Planes of cells one by one: several normals are tried, and the best one is taken.
//!
//! Candidates are the smooth gradient, and the plane that fits the crossings of the cell's edges best: near the
//! gradient of the trilinear interpolation at their mean, and near the direction from the inside corners to the outside
//! ones. Where no plane separates the corners, or where the best plane would still cover an outside corner by more than
//! [`TOLERANCE`], there are two surfaces in the cell: it keeps its corners. So does a long cell in which the surface
//! strays from the plane ([`super::anisotropy`]). Where all samples around have one value inside and one outside, the
//! cell has the plane of a label ([`mask_plane`]).

use super::anisotropy::{Anisotropy, Fit};
use super::corner::{EDGES, SAME_SURFACE, TOLERANCE, TOWARDS_GUESS, encode, outward, pull, signed_depth};
use super::field::Field;
use crate::builder::labels::mask_plane;
use crate::format::cell::{CORNERS, SEPARABLE, at_corner};
use crate::format::normal;
use crate::geom::{cross, dot};

/// Mean of the crossings of a cell's edges, in voxels from its middle.
#[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
pub(super) fn mean_crossing(mask: u8, depth: &[f32; CORNERS]) -> [f32; 3] {
    let depth = std::array::from_fn(|c| signed_depth(depth[c], mask >> c & 1 == 1));
    Crossings::new(mask, &depth).mean.map(|c| 0.5 * c as f32)
}

/// The description of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CellShape {
    /// Normal code and offset.
    Plane(u16, i8),
    /// Normal code and corners.
    Corners(u16, [i8; CORNERS]),
}

pub(super) struct Cell {
    /// Mask of the inside corners.
    pub(super) mask: u8,
    pub(super) depth: [f32; CORNERS],
    /// Direction of rising depths.
    pub(super) gradient: [f32; 3],
    /// Largest distance of the smooth gradient's plane from the crossings.
    pub(super) near: f32,
    /// True if a single value is inside, as in a map of labels.
    pub(super) is_label: bool,
    pub(super) stretch: Anisotropy,
}

/// Describes a cell; `field` is called where there may be only two values around it.
pub(super) fn pick(cell: &Cell, field: impl FnOnce() -> Field) -> CellShape {
    let inside = |c: usize| cell.mask >> c & 1 == 1;
    let depth: [f32; CORNERS] = std::array::from_fn(|c| signed_depth(cell.depth[c], inside(c)));
    if !SEPARABLE[usize::from(cell.mask)] {
        return with_corners(cell);
    }
    if cell.is_label || has_two_values(cell.mask, &depth) {
        let field = field();
        if cell.is_label || field.has_two_values() {
            let plane = mask_plane(&field.inside(), cell.mask);
            return plane.map_or_else(|| with_corners(cell), |(code, offset)| CellShape::Plane(code, offset));
        }
    }
    let crossings = Crossings::new(cell.mask, &depth);
    let best = best_plane(cell, &depth, &crossings);
    let turned = if cell.stretch.is_long { None } else { towards_gradient(cell, &crossings, best) };
    let picked = turned.unwrap_or(best);
    match picked {
        CellShape::Plane(code, offset) if cell.stretch.is_long => {
            let fit = crossings.fit(cell.mask, depth, code, offset);
            if fit.strays(&cell.stretch) { with_corners(cell) } else { picked }
        }
        _ => picked,
    }
}

/// The best of the candidate planes, or the corners if no plane separates them well enough.
fn best_plane(cell: &Cell, depth: &[f32; CORNERS], crossings: &Crossings) -> CellShape {
    let smooth = outward(cell.gradient.map(f64::from)).map(|code| PlaneFit::new(code, cell.mask, crossings));
    if let Some(smooth) = smooth.filter(|tried| tried.badness <= f64::from(cell.near)) {
        return smooth.picked(cell.mask, depth, TOLERANCE);
    }
    let near = |guess: [f64; 3]| {
        let fitted = crossings.fitted_near(guess, TOWARDS_GUESS)?;
        Some(PlaneFit::new(encode(fitted)?, cell.mask, crossings))
    };
    let better = |a: Option<PlaneFit>, b: Option<PlaneFit>| match (a, b) {
        (Some(a), Some(b)) => Some(if b.badness < a.badness { b } else { a }),
        (a, b) => a.or(b),
    };
    let mut best = better(smooth, near(crossings.gradient(depth)));
    if best.is_none_or(|best| best.badness > f64::from(cell.near)) {
        best = better(best, near(crossings.across(cell.mask)));
    }
    // Cells without any direction: their corners alone describe them.
    let best = best.unwrap_or_else(|| PlaneFit::new(ANY, cell.mask, crossings));
    best.picked(cell.mask, depth, TOLERANCE)
}

/// A fitted plane, turned towards the smooth gradient where that belongs to the same surface, as batches do it.
#[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
fn towards_gradient(cell: &Cell, crossings: &Crossings, best: CellShape) -> Option<CellShape> {
    let CellShape::Plane(code, _) = best else { return None };
    let gradient = unit(cell.gradient.map(|c| -f64::from(c)))?;
    let found = normal::decode_l1(code).map(f64::from);
    let along = dot(gradient, found);
    if !(along > 0.0 && along * along >= f64::from(SAME_SURFACE) * dot(found, found)) {
        return None;
    }
    let off = |p: &[f64; 3]| 0.5 * (dot(gradient, *p) - dot(gradient, crossings.mean)).abs();
    let farthest = crossings.points().iter().map(off).fold(0.0, f64::max);
    let fitted = crossings.fitted_near(gradient, pull(farthest as f32).into())?;
    let tried = PlaneFit::new(encode(fitted)?, cell.mask, crossings);
    tried.is_narrow(TOLERANCE).then(|| tried.plane())
}

/// Largest distance of the mean plane from known crossings and from corners on the wrong side up to which no other
/// plane is tried, in voxels.
const NEAR_KNOWN: f64 = 0.05;

/// Describes a cell by its crossings: distances along edges from their first corner, NaN for edges that are not
/// crossed, and the outward unit normals there, zero where unknown.
///
/// The plane with the mean of the normals is taken where it is near the crossings. Where the cell holds an edge, the
/// nearest one is taken of that plane and the planes fitted to the crossings near the mean normal and near the
/// direction from the inside corners to the outside ones.
pub(super) fn pick_crossed(mask: u8, along: &[f32; 12], normals: &[[f32; 3]; 12]) -> CellShape {
    let mut mean = [0.0_f64; 3];
    for normal in normals {
        mean = std::array::from_fn(|k| mean[k] + f64::from(normal[k]));
    }
    let crossings = Crossings::at(mask, along);
    let depth = || depths_of(mask, along);
    if !SEPARABLE[usize::from(mask)] {
        let code = encode(mean).or_else(|| encode(crossings.across(mask))).unwrap_or(ANY);
        return CellShape::Corners(code, quantised(mask, &depth()));
    }
    let mut best = encode(mean).map(|code| PlaneFit::new(code, mask, &crossings));
    if best.is_none_or(|best| best.badness > NEAR_KNOWN) {
        for guess in [mean, crossings.across(mask)] {
            let fitted = crossings.fitted_near(guess, TOWARDS_GUESS).and_then(encode);
            let tried = fitted.map(|code| PlaneFit::new(code, mask, &crossings));
            best = match (best, tried) {
                (Some(best), Some(tried)) if tried.badness < best.badness => Some(tried),
                (best, tried) => best.or(tried),
            };
        }
    }
    let best = best.unwrap_or_else(|| PlaneFit::new(ANY, mask, &crossings));
    if best.is_narrow(TOLERANCE) { best.plane() } else { best.picked(mask, &depth(), TOLERANCE) }
}

/// Depths at corners whose trilinear interpolation crosses edges about at the given places.
fn depths_of(mask: u8, along: &[f32; 12]) -> [f32; CORNERS] {
    let (mut sum, mut count) = ([0.0_f32; CORNERS], [0.0_f32; CORNERS]);
    for ((p, q), t) in EDGES.into_iter().zip(along).filter(|(_, t)| !t.is_nan()) {
        for (corner, way) in [(p, *t), (q, 1.0 - t)] {
            sum[corner] += way;
            count[corner] += 1.0;
        }
    }
    std::array::from_fn(|c| {
        let size = if count[c] > 0.0 { sum[c] / count[c] } else { 1.0 };
        signed_depth(if mask >> c & 1 == 1 { size } else { -size }, mask >> c & 1 == 1)
    })
}

/// A cell that keeps its corners, with the direction of its smooth gradient.
pub(super) fn with_corners(cell: &Cell) -> CellShape {
    let depth = std::array::from_fn(|c| signed_depth(cell.depth[c], cell.mask >> c & 1 == 1));
    let code = outward(cell.gradient.map(f64::from)).unwrap_or(ANY);
    CellShape::Corners(code, quantised(cell.mask, &depth))
}

/// The code of +z.
const ANY: u16 = 0;

/// True if all inside corners have one depth, and all outside corners have one depth.
pub(super) fn has_two_values(mask: u8, depth: &[f32; CORNERS]) -> bool {
    let same = |side: bool| {
        let mut of = (0..CORNERS).filter(|c| (mask >> c & 1 == 1) == side).map(|c| depth[c]);
        let first = of.next();
        of.all(|d| Some(d) == first)
    };
    same(true) && same(false)
}

/// Crossings of a cell's edges, in the cell's coordinates (-1..=1).
struct Crossings {
    /// Crossing of each edge, from its first corner; NaN for edges that are not crossed.
    along: [f64; 12],
    points: [[f64; 3]; 12],
    count: usize,
    mean: [f64; 3],
}

impl Crossings {
    fn new(mask: u8, depth: &[f32; CORNERS]) -> Self {
        Self::of(mask, |_, p, q| {
            let (a, b) = (f64::from(depth[p]), f64::from(depth[q]));
            a / (a - b)
        })
    }

    /// Crossings at known places.
    fn at(mask: u8, along: &[f32; 12]) -> Self {
        Self::of(mask, |edge, _, _| f64::from(along[edge]))
    }

    /// Crossings by a function: `cross` gives the crossing of an edge with one end inside, from its first corner.
    fn of(mask: u8, cross: impl Fn(usize, usize, usize) -> f64) -> Self {
        let mut crossings = Self { along: [f64::NAN; 12], points: [[0.0; 3]; 12], count: 0, mean: [0.0; 3] };
        for (edge, (p, q)) in EDGES.into_iter().enumerate() {
            if (mask >> p ^ mask >> q) & 1 == 0 {
                continue;
            }
            let t = cross(edge, p, q);
            crossings.along[edge] = t;
            let point = std::array::from_fn(|axis| {
                let coordinate = |c: usize| if c >> axis & 1 == 1 { 1.0 } else { -1.0 };
                coordinate(p) + t * (coordinate(q) - coordinate(p))
            });
            crossings.points[crossings.count % 12] = point;
            crossings.count += 1;
            crossings.mean = std::array::from_fn(|a| crossings.mean[a] + point[a]);
        }
        #[expect(clippy::cast_precision_loss, reason = "at most 12")]
        let count = crossings.count.max(1) as f64;
        crossings.mean = crossings.mean.map(|c| c / count);
        crossings
    }

    /// A plane through the crossings, as input of the stretch test.
    #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
    fn fit(&self, mask: u8, depth: [f32; CORNERS], code: u16, offset: i8) -> Fit {
        Fit {
            code,
            offset: f32::from(offset),
            mask: u32::from(mask),
            depth,
            crossing: self.along.map(|t| t as f32),
            mean: self.mean.map(|c| 0.5 * c as f32),
        }
    }

    fn points(&self) -> &[[f64; 3]] {
        &self.points[..self.count.min(12)]
    }

    /// Direction against the gradient of the trilinear interpolation at the mean.
    fn gradient(&self, depth: &[f32; CORNERS]) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (c, depth) in depth.iter().enumerate() {
            let part: [f64; 3] =
                std::array::from_fn(
                    |a| {
                        if c >> a & 1 == 1 { 1.0 + self.mean[a] } else { 1.0 - self.mean[a] }
                    },
                );
            for (a, out) in out.iter_mut().enumerate() {
                let (b, d) = ((a + 1) % 3, (a + 2) % 3);
                let step = part[b] * part[d] * f64::from(*depth);
                *out += if c >> a & 1 == 1 { -step } else { step };
            }
        }
        out
    }

    /// Direction from the middle of the inside corners to the middle of the outside ones.
    fn across(&self, mask: u8) -> [f64; 3] {
        let count = f64::from(mask.count_ones());
        std::array::from_fn(|a| {
            (0..CORNERS).fold(0.0, |sum, c| {
                let at = if c >> a & 1 == 1 { 1.0 } else { -1.0 };
                let inside = mask >> c & 1 == 1;
                sum + if inside { -at / count } else { at / (8.0 - count) }
            })
        })
    }

    /// Normal of the plane that fits the crossings best near a direction: least squares over the guess of length 1 plus
    /// an orthogonal term, which `held` keeps small.
    fn fitted_near(&self, guess: [f64; 3], held: f64) -> Option<[f64; 3]> {
        let length = dot(guess, guess).sqrt();
        if !(length > 0.0 && length < f64::INFINITY) {
            return None;
        }
        let g = guess.map(|c| c / length);
        // Two orthogonal directions: from the axis along which the guess is smallest, and a third one.
        let least = (0..3).fold(0, |best, a| if g[a].abs() < g[best].abs() { a } else { best });
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let e1 = unit(cross(g, axis))?;
        let e2 = cross(g, e1);
        // Coordinates are in half voxels.
        let spread = |a: [f64; 3], b: [f64; 3]| {
            self.points().iter().fold(0.0, |sum, p| {
                let off = std::array::from_fn(|i| 0.5 * (p[i] - self.mean[i]));
                sum + dot(off, a) * dot(off, b)
            })
        };
        let (s11, s12, s22) = (spread(e1, e1) + held, spread(e1, e2), spread(e2, e2) + held);
        let (r1, r2) = (-spread(e1, g), -spread(e2, g));
        let determinant = s11 * s22 - s12 * s12;
        let (a, b) = ((r1 * s22 - r2 * s12) / determinant, (r2 * s11 - r1 * s12) / determinant);
        Some(std::array::from_fn(|i| g[i] + a * e1[i] + b * e2[i]))
    }
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(v, v).sqrt();
    (length > 0.0 && length < f64::INFINITY).then(|| v.map(|c| c / length))
}

#[derive(Clone, Copy)]
struct PlaneFit {
    code: u16,
    offset: i32,
    /// Depth of an outside corner behind the plane, times twice the normal's length; squared normal length.
    covered: i32,
    square: i32,
    /// Greatest distance of a crossing, or of a corner on the wrong side, in voxels.
    badness: f64,
}

impl PlaneFit {
    fn new(code: u16, mask: u8, crossings: &Crossings) -> Self {
        let n = normal::decode_l1(code);
        let of = |p: [f64; 3]| dot(n.map(f64::from), p);
        let mean = of(crossings.mean);
        let mut tried = Self::at(code, mask, mean);
        let off = crossings.points().iter().fold(0.0_f64, |worst, p| worst.max((of(*p) - mean).abs()));
        let wrong = (0..CORNERS).fold(0.0_f64, |worst, c| {
            let beyond = f64::from(at_corner(n, c)) - mean;
            worst.max(if mask >> c & 1 == 1 { beyond } else { -beyond })
        });
        tried.badness = off.max(wrong) / (2.0 * f64::from(tried.square).sqrt());
        tried
    }

    /// The plane through points of this value, shifted so that every inside corner lies behind it.
    #[expect(clippy::cast_possible_truncation, reason = "held to -127..=127")]
    fn at(code: u16, mask: u8, value: f64) -> Self {
        let n = normal::decode_l1(code);
        let corners = |side: bool| {
            (0..CORNERS).filter(move |c| (mask >> c & 1 == 1) == side).map(move |c| at_corner(n, c))
        };
        let highest_in = corners(true).max().unwrap_or(-normal::SCALE);
        let lowest_out = corners(false).min().unwrap_or(normal::SCALE);
        let rounded = (value + 0.5).floor().clamp(-127.0, 127.0) as i32;
        let offset = rounded.max(highest_in);
        let square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        Self { code, offset, covered: offset - lowest_out, square, badness: 0.0 }
    }

    /// True if it covers outside corners by no more than `tolerance`.
    fn is_narrow(&self, tolerance: f32) -> bool {
        let covered = f64::from(self.covered.max(0));
        let limit = 4.0 * f64::from(tolerance) * f64::from(tolerance) * f64::from(self.square);
        covered * covered <= limit
    }

    #[expect(clippy::cast_possible_truncation, reason = "-127..=127")]
    fn plane(&self) -> CellShape {
        CellShape::Plane(self.code, self.offset as i8)
    }

    /// The plane, or the corners if it covers an outside corner too far.
    fn picked(&self, mask: u8, depth: &[f32; CORNERS], tolerance: f32) -> CellShape {
        if self.is_narrow(tolerance) {
            return self.plane();
        }
        CellShape::Corners(self.code, quantised(mask, depth))
    }
}

/// Depths at the corners in eight bits, the largest 127; never 0, which keeps their sides.
#[expect(clippy::cast_possible_truncation, reason = "1..=127")]
fn quantised(mask: u8, depth: &[f32; CORNERS]) -> [i8; CORNERS] {
    let most = depth.iter().fold(0.0_f64, |m, d| m.max(f64::from(d.abs())));
    std::array::from_fn(|c| {
        let size = (f64::from(depth[c].abs()) / most * 127.0 + 0.5).floor().clamp(1.0, 127.0) as i8;
        if mask >> c & 1 == 1 { size } else { -size }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::cell::Plane;

    /// Depths of a plane through a point, in the cell's coordinates.
    fn sampled(n: [f64; 3], at: [f64; 3]) -> (u8, [f32; CORNERS]) {
        #[expect(clippy::cast_possible_truncation, reason = "a test")]
        let depth: [f32; CORNERS] = std::array::from_fn(|c| {
            let u: [f64; 3] = std::array::from_fn(|a| if c >> a & 1 == 1 { 1.0 } else { -1.0 });
            -(0..3).map(|a| n[a] * (u[a] - at[a])).sum::<f64>() as f32
        });
        let mask = (0..CORNERS).filter(|c| depth[*c] >= 0.0).fold(0, |m, c| m | 1 << c);
        (mask, depth)
    }

    #[test]
    fn planes_are_found_again_and_every_inside_corner_lies_behind() {
        let mut checked = 0;
        for i in 0..2000_u32 {
            let of = |k: u32| f64::from((i * 7919 + k * 104_729) % 2003) / 1001.5 - 1.0;
            let (n, at) = ([of(1), of(2), of(3)], [of(4), of(5), of(6)]);
            let (mask, depth) = sampled(n, at);
            if mask == 0 || mask == 255 {
                continue;
            }
            let cell = Cell {
                mask,
                depth,
                gradient: [0.0; 3],
                near: 0.15,
                is_label: false,
                stretch: Anisotropy::new([1.0; 3], 0.0),
            };
            let CellShape::Plane(code, offset) = pick(&cell, || Field::EMPTY) else { panic!("{n:?} {at:?}") };
            let plane = Plane::new(code, offset);
            assert_eq!(plane.inside() & mask, mask);
            let got = unit(plane.normal.map(f64::from)).unwrap();
            assert!(dot(got, unit(n).unwrap()) > 0.999, "{n:?} {got:?}");
            checked += 1;
        }
        assert!(checked > 1500);
    }

    #[test]
    fn all_patterns_of_signs_keep_their_inside_corners_behind_a_plane_or_as_corners() {
        let (mut planes, mut with_corners) = (0, 0);
        for mask in 1..=254_u8 {
            for round in 0..40_u32 {
                let depth = std::array::from_fn(|c| {
                    let size = f32::from(
                        1 + u8::try_from((round * 37 + u32::try_from(c).unwrap() * 59) % 97).unwrap(),
                    );
                    if mask >> c & 1 == 1 { size } else { -size }
                });
                let gradient = [f32::from(u8::try_from(round).unwrap()) - 20.0, 3.0, -7.0];
                let cell = Cell {
                    mask,
                    depth,
                    gradient,
                    near: 0.15,
                    is_label: false,
                    stretch: Anisotropy::new([1.0; 3], 0.0),
                };
                match pick(&cell, || Field::EMPTY) {
                    CellShape::Plane(code, offset) => {
                        assert_eq!(Plane::new(code, offset).inside() & mask, mask, "{mask:08b}");
                        planes += 1;
                    }
                    CellShape::Corners(_, corners) => {
                        for (c, corner) in corners.iter().enumerate() {
                            assert!(
                                *corner != 0 && *corner != i8::MIN && (*corner > 0) == (mask >> c & 1 == 1)
                            );
                        }
                        with_corners += 1;
                    }
                }
            }
        }
        assert!(planes > 0 && with_corners > 0);
    }
}
