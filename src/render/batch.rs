//! Many rays without neighbours: a few of them in flight, in turns. Rays that form an image go in [`super::tile`]s.
//!
//! A ray alone waits for memory: for a node's rank, then for the infobytes of its children. So eight rays take turns.
//! In one round each chooses its next box and has its node fetched; in the next each finds the position of that node's
//! children, and has them fetched; then each compares the 4 x 4 x 4 boxes with its line, as [`super::single`] does.
//! Loads of eight rays are under way at once.
//!
//! Rays that start within the grid begin at the bottom: the bricks from the root to the box of the start are tested
//! from the finest on, and if the previous ray started nearby, they are known already. Finally `mirrored_ray` decides
//! in integers, so hits equal those of every other form.
//!
//! ```text
//! choose: box -> node (fetch) --> find: first child (fetch) --> look: intersected & occupied --> choose
//! ```
//!
//! Alternatives, in M rays/s of one thread on the 1024^3 phantom of `docs/MEASURED.md` (skin, AMD EPYC with AVX2; the
//! best of several runs, which differ by a third; random rays come from outside):
//!
//! | form | random, first hit | random, any | ambient occlusion, first hit | any |
//! |---|---|---|---|---|
//! | [`super::single`], one after the other | 2.0 | | 3.3 | |
//! | eight in turns | 3.4 | 3.5 | 4.3 | 4.1 |
//! | and nodes and their children fetched ahead | 3.5 | 3.7 | 4.4 | 4.2 |
//! | and no line compared where nothing is ahead (kept) | 3.0 | 3.3 | 4.3 | 4.1 |
//! | and bricks remembered by rays that may hit anything, signs without branches (kept) | | | | 5.0 |
//! | Embree's `rtcIntersect1`, `rtcOccluded1`, the mesh of the same surface | 1.5 | 1.4 | 7.7 | 7.6 |
//!
//! Bricks remembered, measured in turns with the row above: 1.1 to 1.25 times as fast where a batch has thousands of
//! rays, as fast where it has sixteen; 0.9 for first hits from outside, which go without. Sent through all three
//! rounds, as bricks that have to be fetched: 0.85.
//!
//! Within one run the row before that is 1.4 times `single` on random rays, and 1.25 times on rays of ambient
//! occlusion. Such a ray tests 3.1 bricks besides the five that it starts in (two in three of these have boxes ahead of
//! it); they are in the cache, so little is waited for. Making a ray takes 35 to 90 ns more.

use crate::cpu::{Form, Kernel, Lanes, prefetch};
use crate::geom::NodeIndex;
use crate::load::{ModelView, NodeView};

use super::image::refill;
use super::line::Line;
use super::mirrored_ray::MirroredRay;
use super::occupancy::{mirrored_any, place, spread_children};
use super::ray::{MAX_DEPTH, Ray};
use super::single::{self, BRICK_LEVELS, top_edge};
use super::surface::Surface;
use super::traverse::Hit;

/// Rays in flight.
const FLIGHT: usize = 8;

/// Traces many rays, and holds the memory for it: 18 KiB.
#[derive(Clone, Debug)]
pub struct Batch {
    form: Form,
    slots: [Slot; FLIGHT],
    known: Bricks,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new(Form::best())
    }
}

impl Batch {
    /// A batch of this form.
    pub fn new(form: Form) -> Self {
        Self { form, slots: [Slot::EMPTY; FLIGHT], known: Bricks::new() }
    }

    /// First hits of rays: those of [`super::single::trace`], for every form.
    ///
    /// The rays must have been made for the depth of this view; boxes with an edge of `2^lod_edge_log2` cells count as
    /// surface. Any view is safe, right or wrong. Rays through larger leaves go one after the other.
    pub fn nearest<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        rays: &[Ray],
        lod_edge_log2: u32,
        hits: &mut Vec<Option<Hit>>,
    ) {
        refill(hits, rays.len(), None);
        let Self { form, slots, known } = self;
        if view.has_leaves() {
            let found = rays.iter().map(|ray| single::trace(*form, view, surface, ray, lod_edge_log2).hit);
            hits.iter_mut().zip(found).for_each(|(hit, found)| *hit = found);
            return;
        }
        known.forget();
        form.run(Flight { view, surface, rays, lod_edge_log2, slots, known, answers: Nearest(hits) });
    }

    /// Tests each ray for any hit. Otherwise like [`Batch::nearest`].
    pub fn any<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        rays: &[Ray],
        lod_edge_log2: u32,
        met: &mut Vec<bool>,
    ) {
        self.known.forget();
        self.any_more(view, surface, rays, lod_edge_log2, met);
    }

    /// [`Batch::any`] for a batch that is only used with one view: bricks are remembered from call to call.
    pub(crate) fn any_more<S: Surface>(
        &mut self,
        view: &ModelView<'_>,
        surface: &S,
        rays: &[Ray],
        lod_edge_log2: u32,
        met: &mut Vec<bool>,
    ) {
        refill(met, rays.len(), false);
        let Self { form, slots, known } = self;
        if view.has_leaves() {
            let found = rays.iter().map(|ray| single::trace(*form, view, surface, ray, lod_edge_log2).hit);
            met.iter_mut().zip(found).for_each(|(met, found)| *met = found.is_some());
            return;
        }
        form.run(Flight { view, surface, rays, lod_edge_log2, slots, known, answers: Any(met) });
    }
}

/// Receiver of rays' results.
trait Answers {
    /// True if it suffices to know that a ray hits anything.
    const ANY: bool;
    /// Called when a ray meets a box of solid surface.
    fn met(&mut self, ray: usize);
    /// Called with a ray's hit.
    fn hit(&mut self, ray: usize, hit: Hit);
}

struct Nearest<'a>(&'a mut [Option<Hit>]);

impl Answers for Nearest<'_> {
    const ANY: bool = false;

    #[inline(always)]
    fn met(&mut self, _: usize) {}

    #[inline(always)]
    fn hit(&mut self, ray: usize, hit: Hit) {
        if let Some(to) = self.0.get_mut(ray) {
            *to = Some(hit);
        }
    }
}

struct Any<'a>(&'a mut [bool]);

impl Answers for Any<'_> {
    const ANY: bool = true;

    #[inline(always)]
    fn met(&mut self, ray: usize) {
        if let Some(to) = self.0.get_mut(ray) {
            *to = true;
        }
    }

    #[inline(always)]
    fn hit(&mut self, ray: usize, _: Hit) {
        self.met(ray);
    }
}

/// A batch, for any lanes.
struct Flight<'a, S, A> {
    view: &'a ModelView<'a>,
    surface: &'a S,
    rays: &'a [Ray],
    lod_edge_log2: u32,
    slots: &'a mut [Slot; FLIGHT],
    known: &'a mut Bricks,
    answers: A,
}

impl<S: Surface, A: Answers> Kernel for Flight<'_, S, A> {
    type Output = ();

    #[inline(always)]
    fn run(self, lanes: impl Lanes) {
        self.fly(lanes);
    }
}

/// A brick whose boxes are being visited.
#[derive(Clone, Copy, Debug)]
struct Level {
    /// Boxes still to visit, in the ray's mirrored order.
    pending: u64,
    /// Boxes in stored order.
    stored: u64,
    /// Number of the first box.
    first: u64,
    /// Lowest box of the finest level, in mirrored coordinates.
    low: [u32; 3],
}

impl Level {
    const EMPTY: Self = Self { pending: 0, stored: 0, first: 0, low: [0; 3] };
}

/// Number of remembered bricks.
const KNOWN: usize = 256;

/// Bricks that rays tested before, by their nodes.
#[derive(Clone, Debug)]
struct Bricks {
    /// Number of the current call: another one may use another view.
    call: u64,
    known: Box<[StoredBrick; KNOWN]>,
}

/// A brick in stored order.
#[derive(Clone, Copy, Debug)]
struct StoredBrick {
    call: u64,
    node: u64,
    stored: u64,
    /// Node whose first child is the first of the brick's boxes.
    parent: u64,
}

impl Bricks {
    fn new() -> Self {
        Self { call: 1, known: Box::new([StoredBrick { call: 0, node: 0, stored: 0, parent: 0 }; KNOWN]) }
    }

    /// Forgets the bricks, before rays that may use another view.
    fn forget(&mut self) {
        self.call = self.call.wrapping_add(1);
    }

    /// The boxes of a node's brick, and the node whose first child is the first of them.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a place in the cache")]
    fn get(&self, node: u64) -> Option<(u64, NodeIndex)> {
        let brick = &self.known[node as usize % KNOWN];
        (brick.node == node && brick.call == self.call).then(|| (brick.stored, NodeIndex::new(brick.parent)))
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a place in the cache")]
    fn set(&mut self, node: u64, stored: u64, parent: NodeIndex) {
        self.known[node as usize % KNOWN] =
            StoredBrick { call: self.call, node, stored, parent: parent.get() };
    }
}

/// A ray in flight.
#[derive(Clone, Copy, Debug)]
struct Slot {
    number: usize,
    exact: MirroredRay,
    line: Line,
    /// Open bricks by level; level 0 has the finest boxes.
    levels: [Level; BRICK_LEVELS],
    /// Mask of levels with boxes to visit.
    waiting: u32,
    /// The brick to test next.
    next: Next,
}

/// A brick by its node.
#[derive(Clone, Copy, Debug)]
struct Next {
    level: u32,
    low: [u32; 3],
    node: NodeIndex,
    infobyte: u8,
    /// Node whose first child is the first of the brick's boxes.
    parent: NodeIndex,
}

/// The bricks that the previous ray started in, from the top down: rays that start near each other share them.
struct Path {
    top: u32,
    /// True if the top brick is half a brick: an odd number of levels is rounded up to even.
    half_top: bool,
    last: u32,
    bottom: u32,
    start: [u32; 3],
    stored: [u64; BRICK_LEVELS],
    first: [u64; BRICK_LEVELS],
}

impl Slot {
    const EMPTY: Self = Self {
        number: 0,
        exact: MirroredRay::NONE,
        line: Line::NONE,
        levels: [Level::EMPTY; BRICK_LEVELS],
        waiting: 0,
        next: Next { level: 0, low: [0; 3], node: NodeIndex::ROOT, infobyte: 0, parent: NodeIndex::ROOT },
    };

    /// Takes a ray, and tests the bricks that it starts in.
    #[inline(always)]
    fn begin<L: Lanes>(
        &mut self,
        l: L,
        view: &ModelView<'_>,
        path: &mut Path,
        (number, ray): (usize, &Ray),
        unit: u32,
    ) {
        let exact = MirroredRay::new(ray);
        self.line = Line::new(l, ray, &exact, unit);
        (self.number, self.exact, self.waiting) = (number, exact, 0);

        let start = self.line.start.map(i32::cast_unsigned);
        let within = self.line.starts_inside && start.iter().all(|c| *c <= path.last);
        let bottom = if within {
            path.follow(l, view, each3!(A => if exact.mirror >> A & 1 == 1 { path.last.wrapping_sub(start[A]) } else { start[A] }));
            path.bottom
        } else {
            path.top
        };
        let mut level = path.top;
        loop {
            let at = level as usize % BRICK_LEVELS;
            let within_brick = 4_u32.wrapping_shl(2 * level).wrapping_sub(1);
            let low = if within { start.map(|c| c & !within_brick) } else { [0; 3] };
            let mut pending = mirrored_any(l, path.stored[at], self.flip(path, level));
            if within {
                let here = each3!(A => start[A].wrapping_shr(2 * level) & 3);
                let v = spread(here[0]) | spread(here[1]) << 1 | spread(here[2]) << 2;
                // The box that the ray starts in is on the path itself.
                pending &= AHEAD[v as usize % 64] & !u64::from(level > bottom).wrapping_shl(v);
            } else {
                pending &= self.line.ahead(low, 2 * level);
            }
            // Many rays that leave a surface have nothing ahead of them in the bricks around.
            if pending != 0 {
                pending &= self.line.intersected(l, low, 2 * level);
            }
            if pending != 0 {
                self.levels[at] = Level { pending, stored: path.stored[at], first: path.first[at], low };
                self.waiting |= 1 << at;
            }
            if level == bottom {
                break;
            }
            level = level.wrapping_sub(1);
        }
    }

    /// Exclusive-or from the mirrored to the stored order of a brick.
    #[inline(always)]
    fn flip(&self, path: &Path, level: u32) -> u32 {
        // The lowest octant of a node above the root is mirrored within itself only.
        let mirror = self.exact.mirror;
        mirror | if path.half_top && level == path.top { 0 } else { mirror << 3 }
    }

    /// Finds the position of the children of the next brick.
    #[inline(always)]
    fn find(&mut self, view: &ModelView<'_>) {
        let node = self.next.node;
        self.next.infobyte = view.infobyte(node);
        self.next.parent = view.first_child(node).node();
        view.sources(self.next.parent).iter().for_each(|bytes| prefetch(*bytes));
    }

    /// Tests the next brick, and remembers it if requested.
    #[inline(always)]
    fn look<L: Lanes>(&mut self, l: L, view: &ModelView<'_>, known: Option<&mut Bricks>) {
        let Next { level, low, infobyte, parent, node } = self.next;
        let stored = spread_children(l, infobyte, view.infobytes(parent));
        if let Some(known) = known {
            known.set(node.get(), stored, parent);
        }
        self.look_at(l, view, (level, low), (stored, parent));
    }

    /// Tests a brick.
    #[inline(always)]
    fn look_at<L: Lanes>(
        &mut self,
        l: L,
        view: &ModelView<'_>,
        (level, low): (u32, [u32; 3]),
        (stored, parent): (u64, NodeIndex),
    ) {
        let mirror = self.exact.mirror;
        let pending = mirrored_any(l, stored, mirror | mirror << 3)
            & self.line.ahead(low, 2 * level)
            & self.line.intersected(l, low, 2 * level);
        // Most bricks have nothing in the way.
        if pending != 0 {
            // Boxes of the finest level are numbered when they are hit.
            let first = if level > 0 { view.first_child(parent).get() } else { parent.get() };
            let at = level as usize % BRICK_LEVELS;
            self.levels[at] = Level { pending, stored, first, low };
            self.waiting |= 1 << at;
        }
    }
}

/// Boxes of a brick that are not behind a box, by its index.
static AHEAD: [u64; 64] = {
    let mut masks = [0; 64];
    let mut pair = 0;
    while pair < 64 * 64 {
        let (from, v) = (pair / 64, pair % 64);
        let (mut axis, mut is_ahead) = (0, true);
        while axis < 3 {
            is_ahead &= along(axis, v) >= along(axis, from);
            axis += 1;
        }
        if is_ahead {
            masks[from] |= 1 << v;
        }
        pair += 1;
    }
    masks
};

/// A coordinate of a box in its brick.
const fn along(axis: usize, v: usize) -> usize {
    (v >> axis & 1) | (v >> (axis + 2) & 2)
}

/// The two bits of a coordinate, spread as in a Morton code.
#[inline(always)]
fn spread(c: u32) -> u32 {
    (c & 1) | (c & 2) << 2
}

impl Path {
    #[inline(always)]
    fn new<L: Lanes>(l: L, view: &ModelView<'_>, levels: u32) -> Self {
        let mut path = Self {
            top: top_edge(levels) / 2,
            half_top: levels % 2 == 1,
            last: 1_u32.wrapping_shl(levels).wrapping_sub(1),
            bottom: top_edge(levels) / 2,
            start: [0; 3],
            stored: [0; BRICK_LEVELS],
            first: [0; BRICK_LEVELS],
        };
        let (root, top) = (view.infobyte(NodeIndex::ROOT), path.top as usize % BRICK_LEVELS);
        let (parent, stored) = if path.half_top {
            (NodeIndex::ROOT, u64::from(root))
        } else {
            let parent = view.first_child(NodeIndex::ROOT).node();
            (parent, spread_children(l, root, view.infobytes(parent)))
        };
        path.stored[top] = stored;
        path.first[top] = if path.top > 0 { view.first_child(parent).get() } else { parent.get() };
        path
    }

    /// Changes it to the path to a box.
    #[inline(always)]
    fn follow<L: Lanes>(&mut self, l: L, view: &ModelView<'_>, start: [u32; 3]) {
        let differs = (self.start[0] ^ start[0]) | (self.start[1] ^ start[1]) | (self.start[2] ^ start[2]);
        // The lowest brick that holds both boxes.
        let both = u32::BITS.wrapping_sub(differs.leading_zeros()).wrapping_add(1) / 2;
        let mut level = both.saturating_sub(1).max(self.bottom);
        while level > 0 {
            let at = level as usize % BRICK_LEVELS;
            let here = each3!(A => start[A].wrapping_shr(2 * level) & 3);
            let v = spread(here[0]) | spread(here[1]) << 1 | spread(here[2]) << 2;
            if self.stored[at].wrapping_shr(v) & 1 == 0 {
                break;
            }
            let below = 1_u64.wrapping_shl(v).wrapping_sub(1);
            let number = self.first[at].wrapping_add(u64::from((self.stored[at] & below).count_ones()));
            let node = NodeIndex::new(number);
            let parent = view.first_child(node).node();
            level = level.wrapping_sub(1);
            let at = level as usize % BRICK_LEVELS;
            self.stored[at] = spread_children(l, view.infobyte(node), view.infobytes(parent));
            self.first[at] = if level > 0 { view.first_child(parent).get() } else { parent.get() };
        }
        (self.start, self.bottom) = (start, level);
    }
}

impl<S: Surface, A: Answers> Flight<'_, S, A> {
    #[inline(always)]
    fn fly<L: Lanes>(mut self, l: L) {
        let Some(depth) = self.rays.first().map(|ray| ray.depth().min(MAX_DEPTH)) else { return };
        if self.view.voxel_count() == 0 {
            return;
        }
        let unit = self.lod_edge_log2.min(depth);
        if depth == unit {
            for (number, ray) in self.rays.iter().enumerate() {
                self.meets((number, ray), &MirroredRay::new(ray), 0, [0; 3], unit);
            }
            return;
        }
        let mut path = Path::new(l, self.view, depth - unit);
        let (mut next, mut live) = (0, 0);
        while let (true, Some(ray)) = (live < FLIGHT, self.rays.get(next)) {
            self.slots[live].begin(l, self.view, &mut path, (next, ray), unit);
            (live, next) = (live + 1, next + 1);
        }
        while live > 0 {
            let mut k = 0;
            while k < live {
                if self.choose(l, k, &path, unit) {
                    k += 1;
                } else if let Some(ray) = self.rays.get(next) {
                    self.slots[k % FLIGHT].begin(l, self.view, &mut path, (next, ray), unit);
                    next += 1;
                } else {
                    live -= 1;
                    self.slots.swap(k % FLIGHT, live % FLIGHT);
                }
            }
            for slot in self.slots.iter_mut().take(live) {
                slot.find(self.view);
            }
            for slot in self.slots.iter_mut().take(live) {
                slot.look(l, self.view, A::ANY.then_some(&mut *self.known));
            }
        }
    }

    /// Chooses the next brick of a ray; `false` when it has hit something, or has come to its end.
    #[inline(always)]
    fn choose<L: Lanes>(&mut self, l: L, k: usize, path: &Path, unit: u32) -> bool {
        loop {
            let slot = &mut self.slots[k % FLIGHT];
            if slot.waiting == 0 {
                return false;
            }
            let at = slot.waiting.trailing_zeros();
            let flip = slot.flip(path, at);
            let level = &mut slot.levels[at as usize % BRICK_LEVELS];
            let v = level.pending.trailing_zeros();
            level.pending &= level.pending.wrapping_sub(1);
            slot.waiting &= !(u32::from(level.pending == 0) << at);
            let below = 1_u64.wrapping_shl(v ^ flip).wrapping_sub(1);
            let before = u64::from((level.stored & below).count_ones());
            let place = place(v);
            let low = each3!(A => level.low[A].wrapping_add(place[A].wrapping_shl(2 * at)));
            if at > 0 {
                let node = NodeIndex::new(level.first.wrapping_add(before));
                // No memory to wait for.
                if A::ANY
                    && let Some(brick) = self.known.get(node.get())
                {
                    slot.look_at(l, self.view, (at.wrapping_sub(1), low), brick);
                    continue;
                }
                self.view.sources(node).iter().for_each(|bytes| prefetch(*bytes));
                slot.next = Next { level: at.wrapping_sub(1), low, node, ..slot.next };
                return true;
            }
            let (number, exact, parent) = (slot.number, slot.exact, NodeIndex::new(level.first));
            let Some(ray) = self.rays.get(number) else { return false };
            if A::ANY && S::SOLID {
                if exact.enters(low.map(|c| c.wrapping_shl(unit)), unit) {
                    self.answers.met(number);
                    return false;
                }
                continue;
            }
            let item = self.view.first_child(parent).get().wrapping_add(before);
            if self.meets((number, ray), &exact, item, low, unit) {
                return false;
            }
        }
    }

    /// Tests a ray against the surface in a box of the finest level.
    #[inline(always)]
    fn meets(
        &mut self,
        (number, ray): (usize, &Ray),
        exact: &MirroredRay,
        item: u64,
        low: [u32; 3],
        unit: u32,
    ) -> bool {
        let passage = exact.passage(item, low.map(|c| c.wrapping_shl(unit)), unit);
        let hit = passage.and_then(|passage| self.surface.meet(self.view, ray, &passage));
        if let Some(hit) = hit {
            self.answers.hit(number, hit);
        }
        hit.is_some()
    }
}
