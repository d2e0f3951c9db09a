//! The search for points that lie near each other: the facets around them are gathered once, and each point asks those that
//! a bound in single precision does not exclude. Answers are those of the [tree search](super::tree), to the bit.

use crate::cpu::{Kernel, Lanes, dispatch};

use super::facet::minus;
use super::{Facet, Found, Place, Query, Search, Surface};

/// Base-2 logarithm of a block's edge in cells: of 4, some twenty cells share one gathering.
const BLOCK_BITS: u32 = 2;

/// Facets are gathered within the greatest distance of the block before, and this many voxels.
const MARGIN: f64 = 0.35;

/// Greatest number of facets that a block gathers; beyond it each point goes down the tree.
const MAX_FACETS: usize = 4096;

/// Rounding of a squared bound, relative to the square of the greatest coordinate.
const ROUNDING: f32 = 1e-5;

/// Facets side by side.
const WIDTH: usize = 8;

/// Eight discs that hold a facet each: middle, unit normal, radius, relative to the middle of the points.
type Discs = [[f32; WIDTH]; 7];

/// A search for the points of one block after the other.
///
/// Memory: at most 1 MiB. Cost: half a microsecond a point where the surface is near.
#[derive(Clone, Debug)]
pub(crate) struct Blocks<'a> {
    /// The search for single points.
    pub(crate) search: Search<'a>,
    waiting: Vec<Place>,
    facets: Vec<(Facet, Place, u8)>,
    discs: Vec<Discs>,
    bounds: Vec<[f32; WIDTH]>,
    middle: [f64; 3],
    slack: f32,
    /// Greatest distance in the block before.
    reach: f64,
}

/// True for two cells of one block.
pub(crate) fn is_same_block(one: [u32; 3], other: [u32; 3]) -> bool {
    (0..3).all(|a| one[a] >> BLOCK_BITS == other[a] >> BLOCK_BITS)
}

impl<'a> Blocks<'a> {
    pub(crate) fn new(surface: Surface<'a>) -> Self {
        let search = surface.search();
        let (waiting, facets, discs, bounds) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { search, waiting, facets, discs, bounds, middle: [0.0; 3], slack: 0.0, reach: 0.0 }
    }

    /// Hands over the number and the nearest point of each point of the frame, not farther than `within` mm.
    pub(crate) fn nearest(
        &mut self,
        points: &[[f64; 3]],
        within: f64,
        mut each: impl FnMut(&mut Search<'a>, usize, Option<Found>),
    ) {
        let margin = MARGIN * self.search.surface.space.finest;
        let mut reach = (self.reach + margin).min(within);
        let mut is_gathered = self.gather(points, reach);
        self.reach = 0.0;
        for (number, point) in points.iter().enumerate() {
            let mut found = if is_gathered { self.ask(*point, within) } else { None };
            if reach < within && found.is_none_or(|found| found.distance() > reach) || !is_gathered {
                found = self.search.nearest(*point, &Query::within(within));
                if let Some(found) = found.filter(|_| is_gathered) {
                    reach = (found.distance() + margin).min(within);
                    is_gathered = self.gather(&points[number..], reach);
                }
            }
            if let Some(found) = &found {
                self.reach = self.reach.max(found.distance());
                self.search.start_at(Some(found.place));
            }
            each(&mut self.search, number, found);
        }
    }

    /// Gathers the facets within `reach` of the box around some points; false if there are too many.
    fn gather(&mut self, points: &[[f64; 3]], reach: f64) -> bool {
        let Search { surface, .. } = self.search;
        self.facets.clear();
        let ends = [f64::min, f64::max].map(|end: fn(f64, f64) -> f64| {
            points.iter().copied().reduce(|one, other| std::array::from_fn(|a| end(one[a], other[a])))
        });
        let [Some(low), Some(high)] = ends else { return true };
        self.middle = std::array::from_fn(|a| (low[a] + high[a]) / 2.0);
        let Some(range) = self.search.range(low, high, reach) else {
            self.discs.clear();
            return true;
        };
        let Self { waiting, facets, .. } = self;
        waiting.clear();
        waiting.push(self.search.start(range));
        while let Some(place) = waiting.pop() {
            if place.level > 0 && !surface.is_leaf(place) {
                surface.children(place, range, |child| waiting.push(child));
                continue;
            }
            surface.facets(place, |part, facet| facets.push((facet, place, part)));
            if facets.len() > MAX_FACETS {
                return false;
            }
        }
        self.bound();
        true
    }

    /// The discs of the gathered facets.
    #[expect(clippy::cast_possible_truncation, reason = "bounds in single precision")]
    fn bound(&mut self) {
        self.discs.clear();
        let mut most = 0.0_f32;
        for facets in self.facets.chunks(WIDTH) {
            let mut discs: Discs = [[0.0; WIDTH]; 7];
            discs[0] = [f32::INFINITY; WIDTH];
            for (lane, (facet, ..)) in facets.iter().enumerate() {
                let (foot, radius) = facet.disc();
                let foot = minus(foot, self.middle).map(|c| c as f32);
                for a in 0..3 {
                    (discs[a][lane], discs[3 + a][lane]) = (foot[a], facet.normal[a] as f32);
                    most = most.max(foot[a].abs());
                }
                discs[6][lane] = radius as f32;
                most = most.max(radius as f32);
            }
            self.discs.push(discs);
        }
        self.bounds.resize(self.discs.len(), [0.0; WIDTH]);
        self.slack = most;
    }

    /// The nearest of the gathered facets to a point.
    #[expect(clippy::cast_possible_truncation, reason = "bounds in single precision")]
    fn ask(&mut self, point: [f64; 3], within: f64) -> Option<Found> {
        let at = minus(point, self.middle).map(|c| c as f32);
        let reach = at.into_iter().fold(self.slack, |most, c| most.max(c.abs()));
        let slack = f64::from(ROUNDING * reach * reach);
        let first = dispatch(Bounds { discs: &self.discs, point: at, bounds: &mut self.bounds })?;
        let (mut best, mut limit) = (None, within * within);
        let mut offer = |number: usize| {
            if let Some((facet, place, part)) = self.facets.get(number) {
                Found::offer(&mut best, &mut limit, point, facet, (*place, *part));
            }
            limit + slack
        };
        let mut most = (offer(first) as f32).next_up();
        for (eight, bounds) in self.bounds.iter().enumerate() {
            for (lane, bound) in bounds.iter().enumerate() {
                if *bound <= most && eight * WIDTH + lane != first {
                    most = (offer(eight * WIDTH + lane) as f32).next_up();
                }
            }
        }
        best
    }
}

/// Lower bounds of the squared distances of a point from discs; the number of the least.
struct Bounds<'k> {
    discs: &'k [Discs],
    point: [f32; 3],
    bounds: &'k mut [[f32; WIDTH]],
}

impl Kernel for Bounds<'_> {
    type Output = Option<usize>;

    #[inline(always)]
    #[expect(clippy::explicit_counter_loop, reason = "an adapter less in the loop")]
    fn run(self, _: impl Lanes) -> Option<usize> {
        let (mut least, mut at) = ([f32::INFINITY; WIDTH], [0_u32; WIDTH]);
        let [px, py, pz] = self.point;
        let mut eight = 0;
        // Plain arithmetic: closures over lanes are calls in builds without link-time optimisation.
        for (disc, bounds) in self.discs.iter().zip(self.bounds) {
            for lane in 0..WIDTH {
                let (nx, ny, nz) = (disc[3][lane], disc[4][lane], disc[5][lane]);
                let (x, y, z) = (px - disc[0][lane], py - disc[1][lane], pz - disc[2][lane]);
                let height = x * nx + y * ny + z * nz;
                let (x, y, z) = (x - height * nx, y - height * ny, z - height * nz);
                let beyond = (x * x + y * y + z * z).sqrt() - disc[6][lane];
                let beyond = if beyond > 0.0 { beyond } else { 0.0 };
                let bound = height * height + beyond * beyond;
                bounds[lane] = bound;
                let is_less = bound < least[lane];
                least[lane] = if is_less { bound } else { least[lane] };
                at[lane] = if is_less { eight } else { at[lane] };
            }
            eight += 1;
        }
        let lane = (0..WIDTH).min_by(|a, b| least[*a].total_cmp(&least[*b]))?;
        (!self.discs.is_empty()).then_some(at[lane] as usize * WIDTH + lane)
    }
}
