//! The search for the nearest point: depth first, the nearest child first, what is farther than the best left out.
//!
//! The point's own cell, or else the last answer's, is asked first: its distance is a true bound. Where the ball of this
//! radius meets few cells these are asked, decoded already for a point before ([`bricks`]). Otherwise the descent begins at
//! the smallest box that holds the ball; the way to that box is kept, and repaired between neighbours.

use crate::geom::{BoxIndex, Octant, dot};
use crate::load::{Model, NodeView};

use super::bricks::{self, Bricks, Kept};
use super::{Facet, OctreeBox, Surface};

/// Most levels of boxes.
const MAX_LEVELS: usize = 17;

/// Most bricks along an axis of the cells that are asked without a descent.
const MAX_BRICKS: u32 = 3;

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
    pub(crate) place: OctreeBox,
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

    /// Nearer; of those as near the one of the lower number, then part.
    #[inline]
    fn is_before(&self, square: f64, number: BoxIndex, part: u8) -> bool {
        (self.square, self.place.number, self.part) <= (square, number, part)
    }
}

/// A search that keeps what it found last, as the start of the next one.
///
/// Memory: some boxes of each level, and 200 KiB of facets. Cost: a microsecond where the surface is nearer than a few cells; at a distance of
/// d cells it meets some 2 pi d.
#[derive(Clone, Debug)]
pub(crate) struct Search<'a> {
    pub(crate) surface: Surface<'a>,
    waiting: Vec<(f64, OctreeBox)>,
    way: NodePath<'a>,
    bricks: Bricks,
    seed: Option<OctreeBox>,
    /// The last point in a cell with a plane, and true if it lies behind that.
    behind: Option<([f64; 3], bool)>,
    best: Best,
}

/// The nearest point so far.
#[derive(Clone, Copy, Debug)]
struct Best {
    found: Option<Found>,
    /// The greatest squared distance, or the one that was found.
    limit: f64,
    /// A squared distance that is nothing but rounding.
    rounding: f64,
}

impl<'a> Search<'a> {
    pub(super) fn new(surface: Surface<'a>) -> Self {
        let finest = surface.space.finest;
        let best = Best { found: None, limit: f64::INFINITY, rounding: 1e-10 * finest * finest };
        let (way, bricks) = (NodePath::new(&surface), Bricks::default());
        Self { surface, waiting: Vec::new(), way, bricks, seed: None, behind: None, best }
    }

    /// Starts the next search at a cell in place of the last answer's.
    pub(crate) fn start_at(&mut self, seed: Option<OctreeBox>) {
        self.seed = seed;
    }

    /// The nearest point of the surface to a point of the frame, or `None` within the given distance.
    pub(crate) fn nearest(&mut self, point: [f64; 3], query: &Query<'_>) -> Option<Found> {
        (self.best.found, self.best.limit) = (None, query.within * query.within);
        if self.surface.view.is_empty() || !point.iter().all(|c| c.is_finite()) {
            return None;
        }
        let own = self.surface.cell_at(point).filter(|_| self.has_bricks() && query.among.is_none());
        let own = own.and_then(|cell| self.kept(cell, point, query));
        if let (None, Some(seed)) = (own, self.seed) {
            self.ask(seed, point, query);
        }
        let asked = own.or(self.seed.map(|seed| seed.number));
        let mut start = OctreeBox { number: BoxIndex::ROOT, low: [0; 3], level: self.surface.view.depth() };
        if self.best.found.is_some()
            && let Some(range) = self.range(point, self.best.slack().sqrt())
        {
            if query.among.is_none() && self.has_bricks() && is_small(range) {
                self.ask_range(range, asked, point, query);
                self.seed = self.best.found.map(|found| found.place);
                return self.best.found;
            }
            start = self.start(range);
        }
        self.descend(start, asked, point, query);
        if let Some(found) = &self.best.found {
            self.seed = Some(found.place);
        }
        self.best.found
    }

    /// True where all cells lie in bricks.
    #[inline]
    fn has_bricks(&self) -> bool {
        !self.surface.view.has_leaves() && self.surface.view.depth() >= bricks::LEVELS
    }

    /// Asks the cell that a point lies in, if it is there.
    fn kept(&mut self, cell: [u32; 3], point: [f64; 3], query: &Query<'_>) -> Option<BoxIndex> {
        let Self { surface, way, bricks, best, .. } = self;
        let kept = bricks.cell(surface, way, cell)?;
        best.ask(kept, point, query);
        self.behind = kept.plane().map(|facet| (point, facet.height(point) <= 0.0));
        Some(kept.number())
    }

    /// Asks the cells of a range but the one that was asked.
    fn ask_range(
        &mut self,
        range: [[u32; 3]; 2],
        asked: Option<BoxIndex>,
        point: [f64; 3],
        query: &Query<'_>,
    ) {
        let Self { surface, way, bricks, best, .. } = self;
        bricks.range(surface, way, range, |kept| {
            if asked != Some(kept.number()) {
                best.ask(kept, point, query);
            }
        });
    }

    /// The pages that are read.
    pub(super) fn pages(&mut self) -> &mut Pages<'a> {
        &mut self.way.pages
    }

    /// The box of the tree in which a cell of the grid lies: a cell, a larger leaf, or `None` where it is empty.
    pub(super) fn at(&mut self, cell: [u32; 3]) -> Option<OctreeBox> {
        self.way.go(&self.surface, cell, 0)
    }

    /// True if a point is behind the surface of the cell, or larger leaf, that it lies in; `None` where that is empty.
    pub(super) fn behind_own(&mut self, cell: [u32; 3], point: [f64; 3]) -> Option<bool> {
        if let Some((_, is_behind)) = self.behind.filter(|(last, _)| *last == point) {
            return Some(is_behind);
        }
        if self.has_bricks() {
            let Self { surface, way, bricks, .. } = self;
            let kept = bricks.cell(surface, way, cell)?;
            return Some(match kept.plane() {
                Some(facet) => facet.height(point) <= 0.0,
                None => surface.is_behind(kept.place(), point),
            });
        }
        let place = self.at(cell)?;
        Some(self.surface.is_behind(place, point))
    }

    /// First and last cell of the grid within `reach` of a point of the frame; `None` if the grid is elsewhere.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the grid")]
    fn range(&self, point: [f64; 3], reach: f64) -> Option<[[u32; 3]; 2]> {
        let Surface { space, view, .. } = self.surface;
        let reach = reach * (1.0 + 1e-9) + 1e-9 * space.finest;
        let end = f64::from(1_u32 << view.depth());
        let mut range = [[0; 3]; 2];
        for a in 0..3 {
            let [first, last] = [point[a] - reach, point[a] + reach].map(|c| c * space.per_mm[a]);
            if !(last >= 0.0 && first < end) {
                return None;
            }
            // Rounded down, as neither is below 0.
            (range[0][a], range[1][a]) = (first.max(0.0) as u32, last.min(end - 1.0) as u32);
        }
        Some(range)
    }

    /// The smallest box that holds a range of cells, as far as the tree goes.
    fn start(&mut self, [first, last]: [[u32; 3]; 2]) -> OctreeBox {
        let apart = (0..3).fold(0, |apart, a| apart | (first[a] ^ last[a]));
        self.way.go(&self.surface, first, 0);
        self.way.place(u32::BITS - apart.leading_zeros())
    }

    fn descend(&mut self, start: OctreeBox, asked: Option<BoxIndex>, point: [f64; 3], query: &Query<'_>) {
        self.waiting.clear();
        self.waiting.push((0.0, start));
        while let Some((square, place)) = self.waiting.pop() {
            if square > self.best.slack() {
                continue;
            }
            if place.level == 0 || self.surface.is_leaf(place) {
                if asked != Some(place.number) {
                    self.ask(place, point, query);
                }
                continue;
            }
            self.open(place, point);
        }
    }

    /// Puts the children of a node that are near enough on the stack, the nearest last.
    #[inline]
    fn open(&mut self, place: OctreeBox, point: [f64; 3]) {
        let node = place.number.node();
        self.way.pages.read(place.level, node.get());
        let infobyte = self.surface.view.infobyte(node);
        let first = self.surface.view.first_child(node);
        let (level, spacing) = (place.level - 1, self.surface.space.spacing);
        let (edge, most) = (f64::from(1_u32 << level), self.best.slack());
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
                let child = (square, OctreeBox { number, low, level });
                let before = self.waiting[begin..].iter().take_while(|other| other.0 >= square).count();
                self.waiting.insert(begin + before, child);
            }
            number = number.after(1);
        }
    }

    /// Asks the facets of a cell or a larger leaf.
    #[inline]
    fn ask(&mut self, place: OctreeBox, point: [f64; 3], query: &Query<'_>) {
        let surface = self.surface;
        self.way.pages.read(place.level, place.number.get());
        if let Some(among) = query.among {
            let cell = surface.cell(place.number);
            let word = usize::try_from(cell / 64).ok().and_then(|at| among.get(at));
            if word.is_none_or(|word| word >> (cell % 64) & 1 == 0) {
                return;
            }
        }
        surface.facets(place, |part, facet| {
            self.best.offer(&facet, (place.number, part), point, query, || place);
        });
    }
}

impl Best {
    /// The best squared distance, and a little for what is as near but for rounding.
    #[inline]
    fn slack(&self) -> f64 {
        self.limit * (1.0 + 1e-10) + self.rounding
    }

    #[inline]
    fn ask(&mut self, kept: Kept<'_>, point: [f64; 3], query: &Query<'_>) {
        for (part, facet) in kept.facets() {
            self.offer(facet, (kept.number(), *part), point, query, || kept.place());
        }
    }

    /// Keeps a facet's nearest point if it is before the best one, within the limit, and counts.
    #[inline]
    fn offer(
        &mut self,
        facet: &Facet,
        (number, part): (BoxIndex, u8),
        point: [f64; 3],
        query: &Query<'_>,
        place: impl FnOnce() -> OctreeBox,
    ) {
        let from = facet.relative(point);
        if !facet.may_reach(from, self.slack()) || !query.accepts(facet.normal) {
            return;
        }
        let (square, at) = facet.nearest(from);
        if square > self.limit || self.found.is_some_and(|best| best.is_before(square, number, part)) {
            return;
        }
        let (normal, height, place) = (facet.normal, from.height, place());
        self.limit = square;
        self.found = Some(Found { square, point: at, normal, place, part, height });
    }
}

/// True for cells in few bricks.
#[inline]
fn is_small([first, last]: [[u32; 3]; 2]) -> bool {
    (0..3).all(|a| (last[a] >> bricks::LEVELS) - (first[a] >> bricks::LEVELS) < MAX_BRICKS)
}

/// Pages of a model that were read last, level by level. Where many others follow, pages are given back.
#[derive(Clone, Debug)]
pub(super) struct Pages<'a> {
    models: &'a [&'a Model],
    last: [u64; MAX_LEVELS],
    /// How often a page was not the one read before.
    changed: u32,
}

/// Base-2 logarithm of the boxes on a page: the system maps 64 KiB at once.
const PER_PAGE: u32 = 15;

/// Pages elsewhere between two looks at the resident memory: 512 KiB.
const PAGES: u32 = 8;

impl Pages<'_> {
    /// Counts the reading of a box of a level, by its number.
    #[inline]
    pub(super) fn read(&mut self, level: u32, number: u64) {
        let page = number >> PER_PAGE;
        if let Some(last) = self.last.get_mut(level as usize)
            && std::mem::replace(last, page) != page
        {
            self.count();
        }
    }

    #[cold]
    fn count(&mut self) {
        self.changed += 1;
        if self.changed >= PAGES {
            self.changed = 0;
            Model::give_back_many(self.models);
        }
    }
}

/// The boxes on the way from the root to a cell.
#[derive(Clone, Debug)]
pub(super) struct NodePath<'a> {
    pub(super) pages: Pages<'a>,
    cell: [u32; 3],
    boxes: [BoxIndex; MAX_LEVELS],
    /// The lowest level of which the box is known.
    reached: u32,
    depth: u32,
}

impl<'a> NodePath<'a> {
    fn new(surface: &Surface<'a>) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a small constant")]
        let depth = surface.view.depth().min(MAX_LEVELS as u32 - 1);
        Self {
            pages: Pages { models: surface.models, last: [0; MAX_LEVELS], changed: 0 },
            cell: [0; 3],
            boxes: [BoxIndex::ROOT; MAX_LEVELS],
            reached: depth,
            depth,
        }
    }

    /// Follows the way to a cell of the grid, from where it parts from the one before, to the box of a level.
    pub(super) fn go(&mut self, surface: &Surface<'_>, cell: [u32; 3], end: u32) -> Option<OctreeBox> {
        let apart = (0..3).fold(0, |apart, a| apart | (cell[a] ^ self.cell[a]));
        let mut level = (u32::BITS - apart.leading_zeros()).max(self.reached).min(self.depth);
        self.cell = cell;
        loop {
            self.reached = level;
            let place = self.place(level);
            if level <= end || surface.is_leaf(place) {
                return Some(if level < end { self.place(end) } else { place });
            }
            level -= 1;
            let high = cell.map(|c| c >> level & 1);
            let octant = Octant::low_bits(high[0] | high[1] << 1 | high[2] << 2);
            let node = place.number.node();
            self.pages.read(level + 1, node.get());
            *self.boxes.get_mut(level as usize)? = surface.view.child(node, octant)?;
        }
    }

    /// The box of a level on the way, as far as it is known.
    fn place(&self, level: u32) -> OctreeBox {
        let level = level.max(self.reached);
        let number = self.boxes.get(level as usize).copied().unwrap_or(BoxIndex::ROOT);
        OctreeBox { number, low: self.cell.map(|c| c >> level << level), level }
    }
}
