//! The triangles of some slices of a bin in memory, and lists of those that bear upon the slice at hand.
#![expect(
    clippy::cast_possible_truncation,
    reason = "slices are within a bin, numbers of triangles below 2^32"
)]

use super::bins::BEYOND;
use super::lattice::{Triangle, centres};

/// Slices of a triangle.
#[derive(Clone, Copy, Debug)]
struct Slices {
    first: i16,
    last: i16,
}

/// Triangles of a run of slices, at most as many as there is room for.
pub(super) struct Resident {
    most: usize,
    triangles: Vec<Triangle>,
    /// Slices between whose centres each lies, from the first of the run.
    slices: Vec<Slices>,
    /// Triangles by their first slice.
    order: Vec<u32>,
    base: i32,
    /// Of the slice whose rows were crossed last.
    crossed: Live,
    /// Of the slice that was described last, and the same by bricks along x.
    near: Live,
    by_brick: Vec<u32>,
    starts: Vec<u32>,
}

/// Triangles that bear upon a slice, which only rises.
struct Live {
    /// Slices beyond the triangle's own.
    reach: i32,
    next: usize,
    list: Vec<u32>,
}

impl Live {
    fn new(reach: i32, most: usize) -> Self {
        Self { reach, next: 0, list: Vec::with_capacity(most) }
    }

    fn restart(&mut self) {
        self.next = 0;
        self.list.clear();
    }

    fn rise(&mut self, slice: i32, order: &[u32], slices: &[Slices]) {
        let reach = self.reach;
        self.list.retain(|t| i32::from(slices[*t as usize].last) + reach >= slice);
        while let Some(t) = order.get(self.next) {
            let own = slices[*t as usize];
            if i32::from(own.first) - reach > slice {
                break;
            }
            self.next += 1;
            if i32::from(own.last) + reach >= slice {
                self.list.push(*t);
            }
        }
    }
}

impl Resident {
    /// Memory of one with room for so many triangles.
    pub(super) fn bytes(most: usize, bricks: usize) -> u64 {
        let each = size_of::<Triangle>() + size_of::<Slices>() + 4 * size_of::<u32>();
        (most * each + (bricks + 3) * size_of::<u32>()) as u64
    }

    pub(super) fn new(most: usize, bricks: usize) -> Self {
        Self {
            most,
            triangles: Vec::with_capacity(most),
            slices: Vec::with_capacity(most),
            order: Vec::with_capacity(most),
            base: 0,
            crossed: Live::new(0, most),
            near: Live::new(1, most),
            by_brick: Vec::with_capacity(most),
            starts: vec![0; bricks + 3],
        }
    }

    /// Begins anew.
    pub(super) fn clear(&mut self, base: i32) {
        self.base = base;
        self.triangles.clear();
        self.slices.clear();
        self.order.clear();
        self.crossed.restart();
        self.near.restart();
    }

    /// Takes those triangles that bear upon slices `first..end`; `false` where there is no room.
    pub(super) fn take(&mut self, block: &[Triangle], first: i32, end: i32) -> bool {
        for t in block {
            let (low, high) = centres(t, 2);
            if low > end - 1 + BEYOND || high < first - BEYOND {
                continue;
            }
            if self.triangles.len() == self.most {
                return false;
            }
            self.triangles.push(*t);
            let within = |at: i32| (at - self.base).clamp(-100, 100) as i16;
            self.slices.push(Slices { first: within(low), last: within(high) });
        }
        true
    }

    /// Puts the triangles into order.
    pub(super) fn settle(&mut self) {
        self.order.extend(0..self.triangles.len() as u32);
        let slices = &self.slices;
        self.order.sort_unstable_by_key(|t| slices[*t as usize].first);
    }

    /// Calls `each` with the triangles between whose ends the centres of a slice lie.
    pub(super) fn crossed(&mut self, slice: i32, each: &mut dyn FnMut(&Triangle)) {
        self.crossed.rise(slice - self.base, &self.order, &self.slices);
        for t in &self.crossed.list {
            each(&self.triangles[*t as usize]);
        }
    }

    /// Sorts the triangles within a voxel of a slice by bricks along x, from column `x0` on.
    pub(super) fn gather(&mut self, slice: i32, x0: i32) {
        self.near.rise(slice - self.base, &self.order, &self.slices);
        let (triangles, starts) = (&self.triangles, &mut self.starts);
        // Of each brick in which triangles begin that end there or in the next; then those that are wider.
        let bricks = starts.len() as i32 - 3;
        let place = |t: u32| {
            let (low, high) = centres(&triangles[t as usize], 0);
            let (first, last) = ((low - 1 - x0) >> 5, (high + 1 - x0) >> 5);
            if last < 0 || first >= bricks {
                None
            } else if last.min(bricks - 1) - first.max(0) > 1 {
                Some(bricks as usize)
            } else {
                Some(first.max(0) as usize)
            }
        };
        starts.fill(0);
        for t in &self.near.list {
            if let Some(at) = place(*t) {
                starts[at + 2] += 1;
            }
        }
        for at in 2..starts.len() {
            starts[at] += starts[at - 1];
        }
        self.by_brick.clear();
        self.by_brick.resize(self.near.list.len(), 0);
        for t in &self.near.list {
            if let Some(at) = place(*t) {
                self.by_brick[starts[at + 1] as usize] = *t;
                starts[at + 1] += 1;
            }
        }
    }

    /// Calls `each` with the gathered triangles that may bear upon a brick.
    pub(super) fn near(&self, brick: usize, each: &mut dyn FnMut(&Triangle)) {
        let wide = self.starts.len() - 3;
        let run = |from: usize, to: usize| self.starts[from] as usize..self.starts[to] as usize;
        let own = run(brick.saturating_sub(1), brick + 1);
        for t in self.by_brick[own].iter().chain(&self.by_brick[run(wide, wide + 1)]) {
            each(&self.triangles[*t as usize]);
        }
    }

    /// Calls `each` with all triangles.
    pub(super) fn all(&self, each: &mut dyn FnMut(&Triangle)) {
        self.triangles.iter().for_each(each);
    }
}
