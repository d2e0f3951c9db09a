//! The walk of a tile's rays through the octree, together.

use crate::cpu::{DOUBLES, Kernel, Lanes};
use crate::load::ModelView;
use crate::render::mirrored_ray::MirroredRay;
use crate::render::occupancy::{Brick, place};
use crate::render::ray::{MAX_DEPTH, Ray};
use crate::render::single::{self, BRICK_LEVELS, LargerLeaf, OpenBrick, top_edge};
use crate::render::surface::{Estimate, Surface};

use super::beam::{Beam, RAYS, Rays, TILE};
use super::exact::{ExactRays, Passing};
use super::listed::Source;
use super::planes::Pairs;
use super::prove::entries;
use super::{Tile, TileHits};

/// Most bricks that a tile tests before its remaining rays go on alone. Tiles of pixels about as wide as a box test
/// some 30; where a pixel covers many boxes rays share little. It also bounds the time that damaged bytes can take.
const MAX_BRICKS: u32 = 1024;

/// The walk of one tile, for any lanes.
pub(super) struct Walk<'a, S, R> {
    pub(super) view: &'a ModelView<'a>,
    pub(super) surface: &'a S,
    pub(super) source: R,
    pub(super) tile: Tile,
    /// Mask of its requested rays.
    pub(super) asked: u64,
    pub(super) rays: &'a mut Rays,
    pub(super) exact: &'a mut ExactRays,
    pub(super) pairs: &'a mut Pairs,
    pub(super) hits: &'a mut TileHits,
}

impl<S: Surface, R: Source> Kernel for Walk<'_, S, R> {
    /// Rays of an array that are left to be traced in another way.
    type Output = u64;

    #[inline(always)]
    fn run(mut self, lanes: impl Lanes) -> u64 {
        self.hits.clear();
        let live = self.tile.live() & self.asked;
        if self.view.is_empty() {
            return 0;
        }
        let depth = self.source.depth().min(MAX_DEPTH);
        let unit = self.tile.lod_edge_log2.min(depth);
        // No closures: instructions in them would be calls.
        let pencil = if depth > unit { self.source.pencil(lanes, self.tile.corner) } else { None };
        let beam = match pencil {
            Some(pencil) => Beam::new(lanes, &pencil, depth, unit, self.rays),
            None => None,
        };
        let alone = match beam {
            Some(beam) => {
                self.hits.mirrored(beam.mirror, 1_u32.wrapping_shl(depth), unit);
                self.together(lanes, &beam, live, depth, unit)
            }
            None if R::LEAVES => return live,
            None => live,
        };
        self.alone(lanes, alone);
        0
    }
}

impl<S: Surface, R: Source> Walk<'_, S, R> {
    /// Walks the rays `live` together; returns those that have to be traced alone.
    #[inline(always)]
    fn together<L: Lanes>(&mut self, l: L, beam: &Beam<L>, live: u64, depth: u32, unit: u32) -> u64 {
        // On x86-64 only machines before AVX2 have neither, and the walk was a twenty-fifth of the program.
        if cfg!(target_arch = "x86_64") && l.avx2().is_none() {
            return live;
        }
        let levels = depth - unit;
        let top = top_edge(levels);
        let mut edge = top;
        let brick = Brick::top(l, self.view, levels, beam.mirror);
        let mut live = live;
        let mut candidates = 0_u64;
        let low = [0; 3];
        let mut open = OpenBrick { brick, pending: 0, first: 0, low };
        let mut waiting = [open; BRICK_LEVELS];
        let mut bricks = 0_u32;
        if top == 0 {
            let near = beam.meets(self.rays, low, live);
            candidates = self.rays_of_brick(beam, &brick, low, near, &mut live, unit);
        } else {
            open.pending = brick.boxes & beam.intersected(low, edge);
            open.first = brick.first(self.view);
        }
        'walk: loop {
            while open.pending == 0 {
                edge = edge.wrapping_add(2);
                if edge > top {
                    break 'walk;
                }
                open = waiting[edge as usize / 2 % BRICK_LEVELS];
            }
            let v = open.pending.trailing_zeros();
            open.pending &= open.pending.wrapping_sub(1);
            if let Some(leaf) = open.larger_leaf(self.view, v, edge) {
                bricks = bricks.wrapping_add(1);
                live &= !self.rays_of_leaf(beam, &leaf, live, depth, unit);
                if live == 0 || bricks > MAX_BRICKS {
                    break 'walk;
                }
                continue;
            }
            let at = place(v);
            let low = each3!(A => open.low[A].wrapping_add(at[A].wrapping_shl(edge)));
            let number = open.first.wrapping_add(open.brick.before(v));
            if edge == 2 {
                bricks = bricks.wrapping_add(1);
                if bricks > MAX_BRICKS {
                    break 'walk;
                }
                let near = beam.meets(self.rays, low, live);
                if near != 0 {
                    let brick = Brick::of(l, self.view, number, beam.mirror);
                    candidates |= self.rays_of_brick(beam, &brick, low, near, &mut live, unit);
                    if live == 0 {
                        break 'walk;
                    }
                }
                continue;
            }
            waiting[edge as usize / 2 % BRICK_LEVELS] = open;
            edge = edge.wrapping_sub(2);
            let brick = Brick::of(l, self.view, number, beam.mirror);
            open = OpenBrick::new(self.view, brick, beam.intersected(low, edge), low);
        }
        let left = if bricks > MAX_BRICKS { live } else { 0 };
        left | if S::SOLID {
            self.prove(l, beam.mirror, candidates, depth, unit)
        } else {
            self.planes_met(l, beam.mirror, depth)
        }
    }

    /// Finds the box that each of the rays `near` hits first in a brick; returns the rays with a hit, which are no
    /// longer live.
    #[inline(always)]
    fn rays_of_brick<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        brick: &Brick,
        low: [u32; 3],
        near: u64,
        live: &mut u64,
        unit: u32,
    ) -> u64 {
        let may_be_behind = beam.may_be_behind(low);
        if beam.lanes.avx2().is_some()
            && !S::SOLID
            && unit == 0
            && !may_be_behind
            && let Some(items) = self.surface.planes()
        {
            if beam.lanes.vbmi2().is_some() {
                self.planes_of_brick(beam, &items, brick, low, near, live);
            } else {
                self.words_of_brick(beam, &items, brick, low, near, live);
            }
            return 0;
        }
        let mut near = near;
        let mut met = 0_u64;
        let (mut first, mut ranked) = (0, false);
        while near != 0 {
            let ray = near.trailing_zeros() as usize % RAYS;
            near &= near.wrapping_sub(1);
            self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(1);
            let boxes = brick.boxes & beam.intersected_by(self.rays, ray, low, may_be_behind);
            if boxes == 0 {
                continue;
            }
            if !ranked {
                (first, ranked) = (brick.first(self.view), true);
            }
            if S::SOLID && brick.larger == 0 {
                let v = boxes.trailing_zeros();
                let at = place(v);
                self.hits.number[ray] = first.wrapping_add(brick.before(v));
                for a in 0..3 {
                    self.hits.low[a][ray] = f64::from((low[a] | at[a]).wrapping_shl(unit));
                }
                met |= 1 << ray;
            } else {
                met |= u64::from(self.box_by_box(beam, brick, (first, low), (ray, boxes), unit)) << ray;
            }
        }
        *live &= !met;
        met
    }

    /// Tests boxes of the brick at `low`, whose first box has the number `first`, until a ray hits the content of one.
    #[inline(always)]
    pub(super) fn box_by_box<L: Lanes>(
        &mut self,
        beam: &Beam<L>,
        brick: &Brick,
        (first, low): (u64, [u32; 3]),
        (ray, boxes): (usize, u64),
        unit: u32,
    ) -> bool {
        let depth = self.source.depth().min(MAX_DEPTH);
        self.exact.prepare(beam.lanes, self.source, self.tile.corner, beam.mirror, depth, ray);
        let mut boxes = boxes;
        while boxes != 0 {
            let v = boxes.trailing_zeros();
            boxes &= boxes.wrapping_sub(1);
            if brick.larger >> v & 1 == 1 {
                let (node, parts) = brick.leaf(v);
                boxes &= !parts;
                let at = place(v & 56);
                let low = each3!(A => low[A] | at[A]);
                if self.look_at_leaf(ray, &LargerLeaf { node, low, edge: 1 }, unit, beam.mirror) {
                    return true;
                }
                continue;
            }
            let at = place(v);
            let cell = each3!(A => (low[A] | at[A]).wrapping_shl(unit));
            if self.look(ray, first.wrapping_add(brick.before(v)), cell, unit, beam.mirror) {
                return true;
            }
        }
        false
    }

    /// Tests a box that a ray may pass through: by an estimate, and exactly where that does not suffice.
    #[inline(always)]
    fn look(&mut self, ray: usize, number: u64, low: [u32; 3], unit: u32, mirror: u32) -> bool {
        // The surface only tests boxes of the finest level.
        if unit == 0
            && let Some(approach) = self.exact.approach(ray, number, low, mirror)
        {
            match self.surface.predict(self.view, &approach) {
                Estimate::Past => return false,
                Estimate::Within { distance, component } => {
                    let t = self.exact.t_after(ray, distance, component);
                    self.hits.set_mirrored(ray, number, low, None, t);
                    return true;
                }
                Estimate::Entry | Estimate::Unsure => {}
            }
        }
        self.look_again(ray, number, low, unit, mirror)
    }

    /// Tests a box by the times at which a ray passes through it.
    #[inline(never)]
    fn look_again(&mut self, ray: usize, number: u64, low: [u32; 3], unit: u32, mirror: u32) -> bool {
        let intersected = match self.exact.way(ray, number, low, unit, mirror) {
            Passing::Past => return false,
            Passing::Unsure => return self.meet(ray, number, low, unit),
            Passing::Through(intersected) => intersected,
        };
        // The surface only tests boxes of the finest level.
        let looked =
            if unit == 0 { self.surface.look(self.view, &intersected.glance) } else { Estimate::Unsure };
        match looked {
            Estimate::Past => false,
            Estimate::Unsure => self.meet(ray, number, low, unit),
            Estimate::Entry => {
                let (distance, component) = self.exact.entry(ray, intersected.axis, low);
                let t = self.exact.t_after(ray, distance, component);
                self.hits.set_mirrored(ray, number, low, Some(intersected.axis), t);
                true
            }
            Estimate::Within { distance, component } => {
                let t = self.exact.t_after(ray, distance, component);
                self.hits.set_mirrored(ray, number, low, None, t);
                true
            }
        }
    }

    /// Asks the surface about a box that a ray may pass through.
    #[cold]
    fn meet(&mut self, ray: usize, number: u64, low: [u32; 3], unit: u32) -> bool {
        let Some(exact) = self.exact(ray) else { return false };
        let hit = MirroredRay::new(&exact)
            .passage(number, low, unit)
            .and_then(|passage| self.surface.meet(self.view, &exact, &passage));
        if let Some(hit) = hit {
            self.hits.set(ray, &hit);
        }
        hit.is_some()
    }

    /// The exact ray of a pixel.
    pub(super) fn exact(&self, ray: usize) -> Option<Ray> {
        self.source.ray(self.tile.corner, ray)
    }

    /// Decides the candidates row by row; returns those that their rays do not enter.
    #[inline(always)]
    fn prove<L: Lanes>(&mut self, l: L, mirror: u32, candidates: u64, depth: u32, unit: u32) -> u64 {
        let mut failed = 0;
        for y in 0..TILE {
            let first = y * TILE;
            let row_candidates = (candidates >> first & 0xff) as u32;
            if row_candidates == 0 {
                continue;
            }
            let row = self.source.row(l, self.tile.corner, y);
            let low: [&[f64; DOUBLES]; 3] = each3!(A => &self.hits.low[A].as_chunks().0[first / TILE]);
            let entries = entries(l, &row, mirror, depth, unit, low);
            failed |= u64::from(row_candidates & !entries.proved) << first;
            self.hits.set_row(first, row_candidates & entries.proved, &entries);
        }
        failed
    }

    /// Traces rays one by one.
    #[inline(always)]
    fn alone<L: Lanes>(&mut self, l: L, rays: u64) {
        let mut rays = rays;
        while rays != 0 {
            let ray = rays.trailing_zeros() as usize % RAYS;
            rays &= rays.wrapping_sub(1);
            if let Some(exact) = self.exact(ray) {
                let trace = single::first_hit(l, self.view, self.surface, &exact, self.tile.lod_edge_log2);
                self.hits.steps[ray] = self.hits.steps[ray].wrapping_add(trace.steps);
                if let Some(hit) = trace.hit {
                    self.hits.set(ray, &hit);
                }
            }
        }
    }
}
