//! The search for the nearest point: depth first, the nearest child first, what is farther than the best left out.
//!
//! The last answer's cell is asked first: its distance is a true bound. The descent begins at the smallest box that holds
//! the ball of this radius; the way to that box is kept, and repaired between neighbours.

use crate::geom::{BoxIndex, Octant, dot};
use crate::load::NodeView;

use super::{Facet, Place, Surface};

/// Most levels of boxes.
const MAX_LEVELS: usize = 17;

/// Least part of a distance that is along the normal, for the normal to say the side.
pub(super) const ALONG: f64 = 0.8;

/// Question to a search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Query<'q> {
    /// Greatest distance, in mm.
    pub(crate) within: f64,
    /// A direction of the frame (unit vector), and the least cosine of a facet's normal to it.
    pub(crate) facing: Option<([f64; 3], f64)>,
    /// A bit for each cell, set for those that count.
    pub(crate) among: Option<&'q [u64]>,
}

impl Query<'_> {
    /// However far.
    pub(crate) const ANY: Self = Self { within: f64::INFINITY, facing: None, among: None };

    /// Not farther than so many mm.
    pub(crate) fn within(mm: f64) -> Self {
        Self { within: mm, ..Self::ANY }
    }

    /// True for a normal within the angle.
    #[inline]
    pub(crate) fn accepts(&self, normal: [f64; 3]) -> bool {
        self.facing.is_none_or(|(direction, least)| dot(direction, normal) >= least - 1e-9)
    }
}

/// The nearest point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Found {
    /// Squared distance, in mm2.
    pub(crate) square: f64,
    /// The point, in the frame.
    pub(crate) point: [f64; 3],
    /// Unit vector out of the facet, in the frame.
    pub(crate) normal: [f64; 3],
    /// The cell or larger leaf.
    pub(crate) place: Place,
    /// Number of its facet.
    pub(crate) part: u8,
    /// Height of the point asked for over the facet's plane.
    pub(super) height: f64,
}

impl Found {
    /// Distance in mm, without its sign.
    pub(crate) fn distance(&self) -> f64 {
        self.square.sqrt()
    }

    /// Distance with the sign of the facet's normal, if the way to it runs along that.
    pub(crate) fn along(&self) -> Option<f64> {
        let distance = self.distance();
        (self.height.abs() > ALONG * distance).then_some(distance.copysign(self.height))
    }

    /// Keeps a facet's nearest point if it is before the best one, and within the limit, a squared distance.
    #[inline]
    pub(super) fn offer(
        best: &mut Option<Self>,
        limit: &mut f64,
        point: [f64; 3],
        facet: &Facet,
        (place, part): (Place, u8),
    ) {
        let (square, at) = facet.nearest(point);
        if square > *limit || best.is_some_and(|best| best.is_before(square, place, part)) {
            return;
        }
        *limit = square;
        let (normal, height) = (facet.normal, facet.height(point));
        *best = Some(Self { square, point: at, normal, place, part, height });
    }

    /// Nearer; of those as near the one of the lower number, then part.
    #[inline]
    fn is_before(&self, square: f64, place: Place, part: u8) -> bool {
        (self.square, self.place.number, self.part) <= (square, place.number, part)
    }
}

/// A search that keeps what it found last, as the start of the next one.
///
/// Memory: some boxes of each level. Cost: a microsecond where the surface is nearer than a few cells; at a distance of
/// d cells it meets some 2 pi d.
#[derive(Clone, Debug)]
pub(crate) struct Search<'a> {
    pub(crate) surface: Surface<'a>,
    waiting: Vec<(f64, Place)>,
    way: Way,
    seed: Option<Place>,
    best: Option<Found>,
    limit: f64,
}

impl<'a> Search<'a> {
    pub(super) fn new(surface: Surface<'a>) -> Self {
        let (way, limit) = (Way::new(&surface), f64::INFINITY);
        Self { surface, waiting: Vec::new(), way, seed: None, best: None, limit }
    }

    /// Starts the next search at a cell in place of the last answer's.
    pub(crate) fn start_at(&mut self, seed: Option<Place>) {
        self.seed = seed;
    }

    /// The nearest point of the surface to a point of the frame, or `None` within the given distance.
    pub(crate) fn nearest(&mut self, point: [f64; 3], query: &Query<'_>) -> Option<Found> {
        self.best = None;
        self.limit = query.within * query.within;
        if self.surface.view.is_empty() || !point.iter().all(|c| c.is_finite()) {
            return None;
        }
        let mut start = Place { number: BoxIndex::ROOT, low: [0; 3], level: self.surface.view.depth() };
        if let Some(seed) = self.seed {
            self.ask(seed, point, query);
            if self.best.is_some() {
                let range = self.range(point, self.slack().sqrt());
                start = range.map_or(start, |range| self.start(range));
            }
        }
        self.descend(start, point, query);
        if let Some(found) = &self.best {
            self.seed = Some(found.place);
        }
        self.best
    }

    /// The box of the tree in which a cell of the grid lies: a cell, a larger leaf, or `None` where it is empty.
    pub(super) fn at(&mut self, cell: [u32; 3]) -> Option<Place> {
        self.way.go(&self.surface, cell)
    }

    /// First and last cell of the grid within `reach` of a point of the frame; `None` if the grid is elsewhere.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the grid")]
    fn range(&self, point: [f64; 3], reach: f64) -> Option<[[u32; 3]; 2]> {
        let Surface { space, view, .. } = self.surface;
        let reach = reach * (1.0 + 1e-9) + 1e-9 * space.finest;
        let end = f64::from(1_u32 << view.depth());
        let mut range = [[0; 3]; 2];
        for a in 0..3 {
            let [first, last] = [point[a] - reach, point[a] + reach].map(|c| c / space.spacing[a]);
            if !(last >= 0.0 && first < end) {
                return None;
            }
            // Rounded down, as neither is below 0.
            (range[0][a], range[1][a]) = (first.max(0.0) as u32, last.min(end - 1.0) as u32);
        }
        Some(range)
    }

    /// The smallest box that holds a range of cells, as far as the tree goes.
    fn start(&mut self, [first, last]: [[u32; 3]; 2]) -> Place {
        let apart = (0..3).fold(0, |apart, a| apart | (first[a] ^ last[a]));
        self.way.go(&self.surface, first);
        self.way.place(u32::BITS - apart.leading_zeros())
    }

    /// The best squared distance, and a little for what is as near but for rounding.
    #[inline]
    fn slack(&self) -> f64 {
        let finest = self.surface.space.finest;
        self.limit * (1.0 + 1e-10) + 1e-10 * finest * finest
    }

    fn descend(&mut self, start: Place, point: [f64; 3], query: &Query<'_>) {
        self.waiting.clear();
        self.waiting.push((0.0, start));
        while let Some((square, place)) = self.waiting.pop() {
            if square > self.slack() {
                continue;
            }
            if place.level == 0 || self.surface.is_leaf(place) {
                if self.seed != Some(place) || self.best.is_none() {
                    self.ask(place, point, query);
                }
                continue;
            }
            self.open(place, point);
        }
    }

    /// Puts the children of a node that are near enough on the stack, the nearest last.
    #[inline]
    fn open(&mut self, place: Place, point: [f64; 3]) {
        let node = place.number.node();
        let infobyte = self.surface.view.infobyte(node);
        let first = self.surface.view.first_child(node);
        let (level, spacing) = (place.level - 1, self.surface.space.spacing);
        let (edge, most) = (f64::from(1_u32 << level), self.slack());
        // Squared distances to the low and high half along each axis.
        let halves: [[f64; 2]; 3] = std::array::from_fn(|a| {
            let low = f64::from(place.low[a]) * spacing[a];
            let middle = (f64::from(place.low[a]) + edge) * spacing[a];
            let high = (f64::from(place.low[a]) + 2.0 * edge) * spacing[a];
            let gap = |low: f64, high: f64| {
                let d = (low - point[a]).max(point[a] - high).max(0.0);
                d * d
            };
            [gap(low, middle), gap(middle, high)]
        });
        let begin = self.waiting.len();
        let (mut rest, mut number) = (infobyte, first);
        while rest != 0 {
            let octant = Octant::low_bits(rest.trailing_zeros());
            rest &= rest - 1;
            let high = octant.high();
            let [x, y, z] = [0, 1, 2].map(|a| halves[a][high[a] as usize]);
            let square = x + y + z;
            if square <= most {
                let low = std::array::from_fn(|a| place.low[a] + (high[a] << level));
                let child = (square, Place { number, low, level });
                let before = self.waiting[begin..].iter().take_while(|other| other.0 >= square).count();
                self.waiting.insert(begin + before, child);
            }
            number = number.after(1);
        }
    }

    /// Asks the facets of a cell or a larger leaf.
    #[inline]
    fn ask(&mut self, place: Place, point: [f64; 3], query: &Query<'_>) {
        let surface = self.surface;
        if let Some(among) = query.among {
            let cell = surface.cell(place.number);
            let word = usize::try_from(cell / 64).ok().and_then(|at| among.get(at));
            if word.is_none_or(|word| word >> (cell % 64) & 1 == 0) {
                return;
            }
        }
        surface.facets(place, |part, facet| {
            if facet.bound(point) > self.slack() || !query.accepts(facet.normal) {
                return;
            }
            Found::offer(&mut self.best, &mut self.limit, point, &facet, (place, part));
        });
    }
}

/// The boxes on the way from the root to a cell.
#[derive(Clone, Debug)]
struct Way {
    cell: [u32; 3],
    boxes: [BoxIndex; MAX_LEVELS],
    /// The lowest level of which the box is known.
    reached: u32,
    depth: u32,
}

impl Way {
    fn new(surface: &Surface<'_>) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a small constant")]
        let depth = surface.view.depth().min(MAX_LEVELS as u32 - 1);
        Self { cell: [0; 3], boxes: [BoxIndex::ROOT; MAX_LEVELS], reached: depth, depth }
    }

    /// Follows the way to a cell of the grid, from where it parts from the one before.
    fn go(&mut self, surface: &Surface<'_>, cell: [u32; 3]) -> Option<Place> {
        let apart = (0..3).fold(0, |apart, a| apart | (cell[a] ^ self.cell[a]));
        let mut level = (u32::BITS - apart.leading_zeros()).max(self.reached).min(self.depth);
        self.cell = cell;
        loop {
            self.reached = level;
            let place = self.place(level);
            if level == 0 || surface.is_leaf(place) {
                return Some(place);
            }
            level -= 1;
            let high = cell.map(|c| c >> level & 1);
            let octant = Octant::low_bits(high[0] | high[1] << 1 | high[2] << 2);
            *self.boxes.get_mut(level as usize)? = surface.view.child(place.number.node(), octant)?;
        }
    }

    /// The box of a level on the way, as far as it is known.
    fn place(&self, level: u32) -> Place {
        let level = level.max(self.reached);
        let number = self.boxes.get(level as usize).copied().unwrap_or(BoxIndex::ROOT);
        Place { number, low: self.cell.map(|c| c >> level << level), level }
    }
}
