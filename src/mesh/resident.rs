//! The triangles of some slices of a bin in memory, sorted by bricks along x and by slices.
#![expect(
    clippy::cast_possible_truncation,
    reason = "slices are within a bin, numbers of triangles below 2^32"
)]

use std::ops::Range;

use super::bins::{BEYOND, BinTriangle, Bins, BlockBuffers, Record, held, ways};
use super::lattice::{centres, first_centre, last_centre};
use crate::volume::SourceError;

/// A triangle of a brick: its record, or, where it takes two, the place of them behind [`ELSEWHERE`]; and [`Location`].
pub(super) type Item = [i32; 7];

/// Location of an item.
#[derive(Clone, Copy, Debug)]
struct Location {
    /// Slices between whose centres it lies, from the first of the run.
    first: i8,
    last: i8,
    /// The brick along x that it is within two voxels of, or one of two groups behind them; with [`AGAIN`] if it
    /// is in the brick before, too.
    group: u16,
}

impl Location {
    #[inline(always)]
    fn of(item: &Item) -> Self {
        let [first, last, low, high] = item[6].to_le_bytes();
        Self { first: first.cast_signed(), last: last.cast_signed(), group: u16::from_le_bytes([low, high]) }
    }

    #[inline]
    fn word(self) -> i32 {
        let [low, high] = self.group.to_le_bytes();
        i32::from_le_bytes([self.first.cast_unsigned(), self.last.cast_unsigned(), low, high])
    }

    #[inline(always)]
    fn is_near(self, z: i32, reach: i32) -> bool {
        i32::from(self.first) - reach <= z && i32::from(self.last) + reach >= z
    }

    /// Its slot, with this number of bricks.
    #[inline]
    fn slot(self, bricks: usize) -> usize {
        let group = usize::from(self.group & !AGAIN);
        let (first, last) = (i32::from(self.first), i32::from(self.last));
        let slot = match usize::try_from(first + BEFORE) {
            Ok(slot) if slot < TALL && last - first <= 1 && group != bricks => slot,
            _ => TALL,
        };
        group * SLOTS + slot
    }
}

const ELSEWHERE: i32 = i32::MAX;
const AGAIN: u16 = 1 << 15;
/// Slices before and after the run to which numbers of slices are clamped.
const FAR: i32 = 100;
/// Triangles of at most two slices stand by their first one, from three before the run on, and behind the others.
const BEFORE: i32 = 3;
const TALL: usize = 38;
const SLOTS: usize = TALL + 1;

/// Most places that a triangle takes.
const MAX_PLACES: usize = 4;

/// Triangles of a run of slices, as many as there is room for.
pub(super) struct Resident {
    /// Triangles of bricks from the front on, and longer triangles, in two places each, from the end on.
    items: Vec<Item>,
    count: usize,
    long: usize,
    base: i32,
    x0: i32,
    bricks: usize,
    /// Bricks whose triangles are taken; a whole tile's also serve for the crossings of rows.
    taken: Range<usize>,
    /// First item of every slot of every group, and one more.
    starts: Vec<u32>,
    next: Vec<u32>,
    /// Number of the triangles near to many bricks, from the first on, that are near to the current slice.
    wide: usize,
}

/// Number of slots for these bricks, and for triangles near to many bricks and to none.
fn slots(bricks: usize) -> usize {
    (bricks + 2) * SLOTS + 1
}

impl Resident {
    /// Memory of one with `places` places.
    pub(super) fn bytes(places: usize, bricks: usize) -> u64 {
        (places * size_of::<Item>() + 2 * slots(bricks) * size_of::<u32>()) as u64
    }

    /// Number of places in these bytes, without the lists of the bricks.
    pub(super) fn fit(bytes: u64) -> usize {
        usize::try_from(bytes / size_of::<Item>() as u64).unwrap_or(usize::MAX)
    }

    /// Places that a triangle takes that is near to bricks `from..=to`.
    #[inline(always)]
    pub(super) fn places(t: &BinTriangle<'_>, from: i32, to: i32) -> u32 {
        1 + u32::from(to - from == 1) + if matches!(t, BinTriangle::Short(_)) { 0 } else { 2 }
    }

    pub(super) fn new(places: usize, bricks: usize) -> Self {
        Self {
            items: vec![[0; 7]; places],
            count: 0,
            long: 0,
            base: 0,
            x0: 0,
            bricks,
            taken: 0..bricks,
            starts: vec![0; slots(bricks)],
            next: vec![0; slots(bricks)],
            wide: 0,
        }
    }

    /// Begins anew, for slices from `base` and columns from `x0` on, and for some bricks from there.
    pub(super) fn clear(&mut self, base: i32, x0: i32, taken: Range<usize>) {
        self.base = base;
        self.x0 = x0;
        self.taken = taken;
        self.count = 0;
        self.long = 0;
    }

    /// Places that can always be filled.
    pub(super) fn room(&self) -> usize {
        self.items.len().saturating_sub(MAX_PLACES)
    }

    /// Number of bricks along x.
    pub(super) fn bricks(&self) -> usize {
        self.bricks
    }

    /// Takes the triangles of a bin, given by a row and a slice, that are near to `slices` and to the bricks `taken`
    /// from column `x0` on, in place of earlier ones; `false` where they do not fit.
    pub(super) fn load(
        &mut self,
        bins: &Bins,
        (row, slice): (u32, u32),
        slices: Range<i32>,
        x0: i32,
        taken: Range<usize>,
        buffers: &mut BlockBuffers,
    ) -> Result<bool, SourceError> {
        self.clear(slices.start, x0, taken);
        let mut fits = true;
        bins.for_each_block(row, slice, buffers, &mut |block| {
            fits = self.take(block, slices.start, slices.end);
            fits
        })?;
        Ok(fits)
    }

    /// Takes the triangles that bear upon slices `first..end`; `false` where there is no room.
    fn take(&mut self, block: &[Record], first: i32, end: i32) -> bool {
        let near = |low: i32, high: i32| low < end + BEYOND && high >= first - BEYOND;
        held(block).all(|t| {
            let (low, high) = slices(&t);
            !near(low, high) || self.keep(&t, low, high)
        })
    }

    /// Takes a triangle between slices `low..=high`; `false` where there is no room.
    #[inline]
    fn keep(&mut self, t: &BinTriangle<'_>, low: i32, high: i32) -> bool {
        let (from, to) = bricks_of(t, self.x0);
        let Range { start, end } = self.taken;
        let away = to < start as i32 || from >= end as i32;
        if away && end - start < self.bricks {
            return true;
        }
        if self.count + 2 * self.long + MAX_PLACES > self.items.len() {
            return false;
        }
        let [a, b, c, d, e, f] = match t {
            BinTriangle::Short(record) => **record,
            BinTriangle::Long(t) => {
                self.long += 1;
                let at = self.items.len() - 2 * self.long;
                let [a, b, c, d, e, f, g, h, i] = *t;
                self.items[at] = [a, b, c, d, e, f, 0];
                self.items[at + 1] = [g, h, i, 0, 0, 0, 0];
                [ELSEWHERE, at as i32, 0, 0, 0, 0]
            }
        };
        let within = |at: i32| (at - self.base).clamp(-FAR, FAR) as i8;
        let (first, last) = (within(low), within(high));
        let mut put = |group: usize, again: u16| {
            let place = Location { first, last, group: group as u16 | again };
            self.items[self.count] = [a, b, c, d, e, f, place.word()];
            self.count += 1;
        };
        if away {
            put(self.bricks + 1, 0);
            return true;
        }
        let (from, to) = (from.max(start as i32) as usize, to.min(end as i32 - 1) as usize);
        match to - from {
            0 => put(from, 0),
            1 => {
                put(from, 0);
                put(to, AGAIN);
            }
            _ => put(self.bricks, 0),
        }
        true
    }

    #[inline(always)]
    fn held<'a>(&'a self, item: &'a Item) -> BinTriangle<'a> {
        let [x, at, ..] = *item;
        match item.first_chunk::<6>() {
            Some(record) if x != ELSEWHERE => BinTriangle::Short(record),
            _ => {
                let [a, b, c, d, e, f, _] = self.items[at as usize];
                let [g, h, i, ..] = self.items[at as usize + 1];
                BinTriangle::Long([a, b, c, d, e, f, g, h, i])
            }
        }
    }

    /// The record of an item with a short triangle.
    #[inline]
    pub(super) fn record(&self, number: u32) -> &Record {
        let [record @ .., _] = &self.items[number as usize];
        record
    }

    pub(super) fn settle(&mut self) {
        let Self { items, starts, next, bricks, count, .. } = self;
        self.wide = 0;
        starts.fill(0);
        for item in &items[..*count] {
            starts[Location::of(item).slot(*bricks) + 1] += 1;
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        next.copy_from_slice(starts);
        for slot in 0..starts.len() - 1 {
            while next[slot] < starts[slot + 1] {
                let at = next[slot] as usize;
                let own = Location::of(&items[at]).slot(*bricks);
                if own != slot {
                    items.swap(at, next[own] as usize);
                }
                next[own] += 1;
            }
        }
    }

    /// Numbers of the items of slots `from..=to` of a group.
    #[inline(always)]
    fn run(&self, group: usize, from: i32, to: i32) -> Range<u32> {
        let slot = |at: i32| (at + BEFORE).clamp(0, TALL as i32) as usize;
        self.starts[group * SLOTS + slot(from)]..self.starts[group * SLOTS + slot(to + 1)]
    }

    #[inline(always)]
    fn tall(&self, group: usize) -> Range<u32> {
        let slot = group * SLOTS + TALL;
        self.starts[slot]..self.starts[slot + 1]
    }

    #[inline(always)]
    fn items(&self, numbers: Range<u32>) -> &[Item] {
        &self.items[numbers.start as usize..numbers.end as usize]
    }

    /// Calls `each` with the triangles between whose ends the centres of a slice lie.
    #[inline]
    pub(super) fn crossed(&self, slice: i32, each: &mut impl FnMut(&BinTriangle<'_>)) {
        self.around(slice, 0, each);
    }

    /// Calls `each` with the triangles within `reach` slices of one, also those near to no brick that is taken.
    #[inline]
    pub(super) fn around(&self, slice: i32, reach: i32, each: &mut impl FnMut(&BinTriangle<'_>)) {
        let z = slice - self.base;
        for group in 0..self.bricks + 2 {
            // A triangle that spans two slices' centres begins one slice before its end.
            let (run, tall) = (self.run(group, z - reach - 1, z + reach), self.tall(group));
            for item in self.items(run).iter().chain(self.items(tall)) {
                let place = Location::of(item);
                if place.is_near(z, reach) && place.group & AGAIN == 0 {
                    each(&self.held(item));
                }
            }
        }
    }

    /// Prepares [`Resident::near`] for a slice.
    pub(super) fn gather(&mut self, slice: i32, reach: i32) {
        let z = slice - self.base;
        let slot = self.bricks * SLOTS + TALL;
        let wide = &mut self.items[self.starts[slot] as usize..self.starts[slot + 1] as usize];
        self.wide = 0;
        for at in 0..wide.len() {
            if Location::of(&wide[at]).is_near(z, reach) {
                wide.swap(at, self.wide);
                self.wide += 1;
            }
        }
    }

    /// Calls `each` with the number and the triangle of every item that may be within `reach` voxels, at most
    /// two, of a brick's voxels of the slice that was gathered.
    #[inline(always)]
    pub(super) fn near(
        &self,
        slice: i32,
        brick: usize,
        reach: i32,
        each: &mut impl FnMut(u32, &BinTriangle<'_>),
    ) {
        let z = slice - self.base;
        let wide = self.tall(self.bricks);
        let wide = wide.start..wide.start + self.wide as u32;
        // A triangle that spans the centres of two slices begins one before its end, one between two centres behind it.
        // The call of `each` is written once, so that it is inlined into this loop with its instructions.
        for numbers in [self.run(brick, z - reach - 1, z + reach), self.tall(brick), wide] {
            for (number, item) in numbers.clone().zip(self.items(numbers)) {
                if Location::of(item).is_near(z, reach) {
                    each(number, &self.held(item));
                }
            }
        }
    }
}

/// Slices (rows, columns) whose centres lie between the ends of a triangle: empty if the second is less.
#[inline(always)]
fn ends(t: &BinTriangle<'_>, axis: usize) -> (i32, i32) {
    match t {
        BinTriangle::Short(record) => {
            let [a, b] = ways(record, axis);
            let from = |way: i32| record[axis].wrapping_add(way);
            (first_centre(from(a.min(b).min(0))), last_centre(from(a.max(b).max(0))))
        }
        BinTriangle::Long(t) => centres(t, axis),
    }
}

/// Slices between whose centres a triangle lies.
#[inline(always)]
pub(super) fn slices(t: &BinTriangle<'_>) -> (i32, i32) {
    ends(t, 2)
}

/// Bricks along x, counted from a column, that a triangle is within two voxels of.
#[inline(always)]
pub(super) fn bricks_of(t: &BinTriangle<'_>, x0: i32) -> (i32, i32) {
    let (left, right) = ends(t, 0);
    ((left - 2 - x0) >> 5, (right + 2 - x0) >> 5)
}

#[cfg(test)]
mod tests {
    use super::super::bins::packed;
    use super::super::lattice::Triangle;
    use super::*;

    #[test]
    fn every_brick_and_slice_gets_what_is_near_and_only_once() {
        let mut state = 4_u32;
        let mut next = |n: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((i64::from(state >> 8) * i64::from(n)) >> 24) as i32
        };
        let all: Vec<Triangle> = (0..3000)
            .map(|i| {
                let size = [1, 3, 9, 90][i % 4] * 4096;
                let corner: [i32; 3] =
                    std::array::from_fn(|axis| next([140, 36, 44][axis] * 4096) - 4 * 4096);
                std::array::from_fn(|k| corner[k % 3] + next(size))
            })
            .collect();
        let block: Vec<Record> = all.iter().flat_map(packed).collect();
        let mut resident = Resident::new(12_000, 4);
        for (first, end, taken) in [(0, 32, 0..4), (9, 14, 0..4), (20, 21, 1..3)] {
            resident.clear(first, 0, taken.clone());
            assert!(resident.take(&block, first, end));
            resident.settle();
            let is_near = |t: &Triangle, axis: usize, low: i32, high: i32| {
                let (first, last) = centres(t, axis);
                first <= high && last >= low
            };
            for slice in first..end {
                for reach in [1, 2] {
                    resident.gather(slice, reach);
                    for brick in taken.clone() {
                        let mut got = Vec::new();
                        resident.near(slice, brick, reach, &mut |_, t| got.push(t.triangle()));
                        let x = 32 * brick as i32;
                        let wanted = all.iter().filter(|t| {
                            is_near(t, 0, x - 2, x + 33) && is_near(t, 2, slice - reach, slice + reach)
                        });
                        assert!(wanted.clone().count() > 5 && wanted.clone().all(|t| got.contains(t)));
                        let count = got.len();
                        got.sort_unstable();
                        got.dedup();
                        assert_eq!(got.len(), count, "once each");
                    }
                }
                if taken.len() == 4 {
                    let mut got = Vec::new();
                    resident.crossed(slice, &mut |t| got.push(t.triangle()));
                    let mut wanted: Vec<Triangle> =
                        all.iter().filter(|t| is_near(t, 2, slice, slice)).copied().collect();
                    got.sort_unstable();
                    wanted.sort_unstable();
                    assert_eq!(got, wanted);
                }
            }
        }
        // Lack of room is reported.
        let mut small = Resident::new(100, 4);
        small.clear(0, 0, 0..4);
        assert!(!small.take(&block, 0, 32));
    }
}
