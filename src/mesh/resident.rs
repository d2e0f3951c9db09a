//! The triangles of some slices of a bin in memory, and lists of those that bear upon the slice at hand.
#![expect(
    clippy::cast_possible_truncation,
    reason = "slices are within a bin, numbers of triangles below 2^32"
)]

use super::bins::{BEYOND, Held, Record, held, unpacked, ways};
use super::lattice::{Triangle, centres, first_centre, last_centre};

/// Slices of a triangle, from the first of the run, and bricks along x that it is within a voxel of.
#[derive(Clone, Copy, Debug)]
struct Slices {
    first: i8,
    last: i8,
    /// [`WIDE`] if it is near to more than two.
    brick: u16,
    /// Is it near to the next one, too?
    next: bool,
}

/// Near to more than two bricks, and near to no brick of the tile.
const WIDE: u16 = u16::MAX;
const AWAY: u16 = u16::MAX - 1;
/// Slices before and after the run of which more need not be known.
const FAR: i32 = 100;

/// Triangles of a run of slices, at most as many as there is room for.
pub(super) struct Resident {
    most: usize,
    triangles: Vec<Triangle>,
    /// Slices between whose centres each lies, from the first of the run.
    slices: Vec<Slices>,
    base: i32,
    x0: i32,
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

    fn rise(&mut self, slice: i32, slices: &[Slices]) {
        let reach = self.reach;
        self.list.retain(|t| i32::from(slices[*t as usize].last) + reach >= slice);
        while let Some(own) = slices.get(self.next) {
            if i32::from(own.first) - reach > slice {
                break;
            }
            if i32::from(own.last) + reach >= slice {
                self.list.push(self.next as u32);
            }
            self.next += 1;
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
            base: 0,
            x0: 0,
            crossed: Live::new(0, most),
            near: Live::new(1, most),
            by_brick: Vec::with_capacity(2 * most),
            starts: vec![0; bricks + 3],
        }
    }

    /// Begins anew, for slices from `base` and columns from `x0` on.
    pub(super) fn clear(&mut self, base: i32, x0: i32) {
        self.base = base;
        self.x0 = x0;
        self.triangles.clear();
        self.slices.clear();
        self.crossed.restart();
        self.near.restart();
    }

    /// Takes those triangles that bear upon slices `first..end`; `false` where there is no room.
    pub(super) fn take(&mut self, block: &[Record], first: i32, end: i32) -> bool {
        let near = |low: i32, high: i32| low < end + BEYOND && high >= first - BEYOND;
        held(block).all(|t| match t {
            Held::Short(record) => {
                let [a, b] = ways(record, 2);
                let low = first_centre(record[2] + a.min(b).min(0));
                let high = last_centre(record[2] + a.max(b).max(0));
                !near(low, high) || self.keep(&unpacked(record), low, high)
            }
            Held::Long(t) => {
                let (low, high) = centres(&t, 2);
                !near(low, high) || self.keep(&t, low, high)
            }
        })
    }

    /// Takes a triangle between slices `low..=high`; `false` where there is no room.
    #[inline]
    fn keep(&mut self, t: &Triangle, low: i32, high: i32) -> bool {
        if self.triangles.len() == self.most {
            return false;
        }
        self.triangles.push(*t);
        let within = |at: i32| (at - self.base).clamp(-FAR, FAR) as i8;
        let (left, right) = centres(t, 0);
        let (from, to) = ((left - 1 - self.x0) >> 5, (right + 1 - self.x0) >> 5);
        let bricks = self.starts.len() as i32 - 3;
        let (from, to, away) = (from.max(0), to.min(bricks - 1), to < 0 || from >= bricks);
        let brick = match to - from {
            _ if away => AWAY,
            0 | 1 => from as u16,
            _ => WIDE,
        };
        self.slices.push(Slices { first: within(low), last: within(high), brick, next: to > from });
        true
    }

    /// Puts the triangles into the order of their first slices, in place: what bears upon a slice lies together.
    pub(super) fn settle(&mut self) {
        let mut starts = [0_u32; 2 * FAR as usize + 2];
        let place = |s: &Slices| (i32::from(s.first) + FAR) as usize;
        for s in &self.slices {
            starts[place(s) + 1] += 1;
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        // The list by bricks is made anew for every slice; until then it tells where each belongs.
        let order = &mut self.by_brick;
        order.clear();
        for s in &self.slices {
            let to = &mut starts[place(s)];
            order.push(*to);
            *to += 1;
        }
        for at in 0..order.len() {
            while order[at] as usize != at {
                let to = order[at] as usize;
                self.triangles.swap(at, to);
                self.slices.swap(at, to);
                order.swap(at, to);
            }
        }
    }

    /// Calls `each` with the triangles between whose ends the centres of a slice lie.
    #[inline]
    pub(super) fn crossed(&mut self, slice: i32, each: &mut impl FnMut(&Triangle)) {
        self.crossed.rise(slice - self.base, &self.slices);
        for t in &self.crossed.list {
            each(&self.triangles[*t as usize]);
        }
    }

    /// Calls `each` with the triangles within a voxel of a slice.
    pub(super) fn around(&mut self, slice: i32, each: &mut impl FnMut(&Triangle)) {
        self.near.rise(slice - self.base, &self.slices);
        for t in &self.near.list {
            each(&self.triangles[*t as usize]);
        }
    }

    /// Sorts the triangles within a voxel of a slice by bricks along x.
    pub(super) fn gather(&mut self, slice: i32) {
        self.near.rise(slice - self.base, &self.slices);
        let (slices, starts) = (&self.slices, &mut self.starts);
        // One place for each brick, then that of the wide ones.
        let wide = starts.len() - 3;
        let place = |t: u32| {
            let own = slices[t as usize];
            match own.brick {
                AWAY => None,
                WIDE => Some((wide, false)),
                brick => Some((usize::from(brick), own.next)),
            }
        };
        starts.fill(0);
        for t in &self.near.list {
            if let Some((at, next)) = place(*t) {
                starts[at + 2] += 1;
                starts[at + 3 - usize::from(!next)] += u32::from(next);
            }
        }
        for at in 2..starts.len() {
            starts[at] += starts[at - 1];
        }
        self.by_brick.clear();
        self.by_brick.resize(starts[starts.len() - 1] as usize, 0);
        for t in &self.near.list {
            if let Some((at, next)) = place(*t) {
                for at in at..=at + usize::from(next) {
                    self.by_brick[starts[at + 1] as usize] = *t;
                    starts[at + 1] += 1;
                }
            }
        }
    }

    /// Calls `each` with the gathered triangles that may bear upon a brick.
    #[inline]
    pub(super) fn near(&self, brick: usize, each: &mut impl FnMut(&Triangle)) {
        let wide = self.starts.len() - 3;
        let run = |at: usize| self.starts[at] as usize..self.starts[at + 1] as usize;
        for t in self.by_brick[run(brick)].iter().chain(&self.by_brick[run(wide)]) {
            each(&self.triangles[*t as usize]);
        }
    }

    /// Calls `each` with all triangles.
    pub(super) fn all(&self, each: &mut dyn FnMut(&Triangle)) {
        self.triangles.iter().for_each(each);
    }
}
