//! Rays of a parallel projection by increments: two additions a pixel for the floor, two for the ceiling (the paper, 3.4).

use crate::load::NodeView;
use crate::render::pixel_rays::PixelRays;
use crate::render::ray::Ray;
use crate::render::tile::{TILE, Tile};
use crate::render::traverse::Trace;

use super::line::{Line, POINT_BITS, Point};
use super::walk::first_hit;

/// The discrete rays of a picture: by increments where possible, else each by itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DiscreteRays<'a> {
    sight: PixelRays<'a>,
    frame: Option<ParallelFrame>,
}

impl<'a> DiscreteRays<'a> {
    /// The rays of a picture of this size in pixels.
    pub(crate) fn new(sight: PixelRays<'a>, width: u32, height: u32) -> Self {
        Self { sight, frame: ParallelFrame::new(&sight, width, height) }
    }

    /// First hits of those pixels of a tile that are bits of `asked` and lie in the picture; `each` receives the
    /// pixel's number in the tile.
    pub(crate) fn trace_tile<V: NodeView>(
        &self,
        view: &V,
        tile: Tile,
        asked: u64,
        mut each: impl FnMut(usize, Trace),
    ) {
        let (columns, rows) = (tile.limits.0.min(TILE), tile.limits.1.min(TILE));
        for row in 0..rows {
            let y = tile.corner.1 + row;
            #[expect(clippy::cast_possible_truncation, reason = "at most the picture's sides")]
            let mut lines = self.frame.as_ref().map(|frame| frame.row(tile.corner.0 as u32, y as u32));
            for column in 0..columns {
                let line = lines.as_mut().and_then(Row::next);
                if asked >> (row * TILE + column) & 1 == 0 {
                    continue;
                }
                let (x, y) = ((tile.corner.0 + column) as f64 + 0.5, y as f64 + 0.5);
                let ray = || self.sight.ray(x, y);
                let lod = tile.lod_edge_log2;
                let trace = match line {
                    Some(line) => first_hit(view, &line, lod, ray),
                    None => self.trace(view, x, y, lod),
                };
                each(row * TILE + column, trace);
            }
        }
    }

    /// First hit of the ray through a point of the picture.
    pub(crate) fn trace<V: NodeView>(&self, view: &V, x: f64, y: f64, lod_edge_log2: u32) -> Trace {
        let Some(ray) = self.sight.ray(x, y) else { return Trace { hit: None, steps: 0 } };
        first_hit(view, &Line::new(&ray), lod_edge_log2, || Some(ray))
    }
}

/// The lines of a parallel projection.
///
/// They have one main axis and one slope, and their points are affine functions of the pixel. Each row begins with its
/// own points, so that the rounding of an increment adds up along one row only: to less than 2^-25 cell in the widest.
#[derive(Clone, Copy, Debug)]
pub struct ParallelFrame {
    /// A line with the common axis and slope.
    line: Line,
    rise: Point,
    floor: PixelAffine<2>,
    /// Starts of the rays, u, v and w, if some start within the grid.
    start: Option<PixelAffine<3>>,
}

/// Coordinates as affine functions of the pixel, in units of 2^-[`POINT_BITS`] cell: at the first pixel, their change
/// along a row, and from row to row.
#[derive(Clone, Copy, Debug)]
struct PixelAffine<const N: usize> {
    first: [f64; N],
    across: [f64; N],
    down: [f64; N],
}

impl<const N: usize> PixelAffine<N> {
    fn of(vectors: [[f64; 3]; 3], map: impl Fn([f64; 3], bool) -> [f64; N]) -> Self {
        let [first, across, down] = vectors;
        Self { first: map(first, true), across: map(across, false), down: map(down, false) }
    }

    fn at(&self, x: f64, y: f64) -> [f64; N] {
        std::array::from_fn(|k| self.first[k] + x * self.across[k] + y * self.down[k])
    }

    fn step(&self) -> [i64; N] {
        self.across.map(whole)
    }
}

/// Nearest integer.
#[expect(clippy::cast_possible_truncation, reason = "at most 2^58, as checked for the corners of a picture")]
fn whole(c: f64) -> i64 {
    c.round() as i64
}

/// Points farther from the grid than this, in cells, and than two sides of the grid are not taken by increments: an f64
/// would round them by more than 2^-35 cell.
const FARTHEST: f64 = 65_536.0;

impl ParallelFrame {
    /// The frame of a picture; `None` in perspective, and where a ray is too far from the grid.
    pub fn new(sight: &PixelRays<'_>, width: u32, height: u32) -> Option<Self> {
        let pencil = sight.pencil((0, 0))?;
        let [towards, ..] = pencil.direction;
        if pencil.direction[1..].iter().flatten().any(|c| *c != 0.0) {
            return None;
        }
        let depth = sight.space().dims().depth();
        let side = f64::from(1_u32 << depth);
        // Through the middle of the grid, to get the axis and slope of a ray in that direction.
        let longest = towards.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        let before = std::array::from_fn(|a| side / 2.0 - 2.0 * side * towards[a] / longest);
        let line = Line::new(&Ray::new(depth, before, towards, 0.0).ok()??);
        let rise: Point = std::array::from_fn(|k| line.ceiling[k] - line.floor[k]);
        let unit = (1_u64 << POINT_BITS) as f64;
        let in_frame = |vector: [f64; 3], is_point: bool| -> [f64; 3] {
            std::array::from_fn(|of_walk| {
                let a = line.axis.grid_axis(of_walk);
                let from = if is_point { side } else { 0.0 };
                unit * if line.axis.is_mirrored(a) { from - vector[a] } else { vector[a] }
            })
        };
        // Intersection of the line through a pixel's origin with w = 0.
        #[expect(clippy::cast_precision_loss, reason = "a slope times 2^depth, of 40 bits behind the point")]
        let floor = PixelAffine::of(pencil.origin, |vector, is_point| {
            let [u, v, w] = in_frame(vector, is_point);
            [u - rise[0] as f64 / side / unit * w, v - rise[1] as f64 / side / unit * w]
        });
        let start = PixelAffine::of(pencil.origin, in_frame);
        let farthest = FARTHEST.max(2.0 * side) * unit;
        let (width, height) = (f64::from(width), f64::from(height));
        let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
        let starts = corners.map(|(x, y)| start.at(x, y));
        let starts_within = starts.iter().any(|start| start[2] > 0.0);
        let floors_far = corners.iter().any(|(x, y)| floor.at(*x, *y).iter().any(|c| c.abs() > farthest));
        let starts_near = starts.iter().flatten().all(|c| c.abs() <= farthest);
        if floors_far || starts_within && !starts_near {
            return None;
        }
        Some(Self { line, rise, floor, start: starts_within.then_some(start) })
    }

    /// The unlimited lines of the pixels of a row, from column `x` on.
    pub fn row(&self, x: u32, y: u32) -> Row {
        let (x, y) = (f64::from(x), f64::from(y));
        let floor = self.floor.at(x, y).map(whole);
        let ceiling = std::array::from_fn(|k| floor[k] + self.rise[k]);
        let [u, v, w] = self.start.map_or([i64::MIN, i64::MIN, 0], |start| start.at(x, y).map(whole));
        Row {
            line: Line { floor, ceiling, start: [u, v], ..self.line },
            step: self.floor.step(),
            w,
            start_step: self.start.map_or([0; 3], |start| start.step()),
        }
    }
}

/// The lines of a row, pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    line: Line,
    step: Point,
    /// Start of the ray along the main axis.
    w: i64,
    start_step: [i64; 3],
}

impl Iterator for Row {
    type Item = Line;

    /// Cost: four additions; three more for the start.
    #[inline]
    fn next(&mut self) -> Option<Line> {
        let first_storey = u32::try_from((self.w >> POINT_BITS).max(0)).unwrap_or(u32::MAX);
        let line = Line { first_storey, ..self.line };
        for k in 0..2 {
            self.line.floor[k] = line.floor[k].wrapping_add(self.step[k]);
            self.line.ceiling[k] = line.ceiling[k].wrapping_add(self.step[k]);
            self.line.start[k] = line.start[k].wrapping_add(self.start_step[k]);
        }
        self.w = self.w.wrapping_add(self.start_step[2]);
        Some(line)
    }
}
