//! Places of a surface that stand out, joined where they touch.
//!
//! Cells that stand out fall into blocks of 2^k cells a side, k the least for which there are at most 8,192 of these; blocks
//! that touch, at corners too, are one place. Which blocks there are depends on the set of cells, not on their order.

use std::collections::BTreeMap;

/// Most blocks.
const MAX_BLOCKS: usize = 1 << 13;

/// A place: connected cells that stand out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlaceOut {
    /// Rank of its worst cell, the higher the worse.
    pub(crate) rank: f64,
    /// Number, value and position of that cell.
    pub(crate) number: u64,
    pub(crate) value: f64,
    pub(crate) at: [f64; 3],
    /// True if that cell has no counterpart: the value is the distance of the nearest surface.
    pub(crate) is_apart: bool,
    /// Half the 95 % interval of the value, if it is known.
    pub(crate) u95: Option<f64>,
    /// Cells, and their area.
    pub(crate) cells: u64,
    pub(crate) area: f64,
    /// Least and greatest coordinates of their positions.
    pub(crate) range: [[f64; 3]; 2],
}

impl PlaceOut {
    /// A single cell, ranked by the size of its value.
    pub(crate) fn of_cell(number: u64, value: f64, at: [f64; 3], area: f64) -> Self {
        let (rank, range) = (value.abs(), [at; 2]);
        Self { rank, number, value, at, is_apart: false, u95: None, cells: 1, area, range }
    }

    fn join(&mut self, other: &Self) {
        if other.rank > self.rank || other.rank == self.rank && other.number < self.number {
            (self.rank, self.number, self.value, self.at) = (other.rank, other.number, other.value, other.at);
            (self.u95, self.is_apart) = (other.u95, other.is_apart);
        }
        self.cells += other.cells;
        self.area += other.area;
        for a in 0..3 {
            self.range[0][a] = self.range[0][a].min(other.range[0][a]);
            self.range[1][a] = self.range[1][a].max(other.range[1][a]);
        }
    }
}

/// Cells that stand out, in blocks.
///
/// Memory: at most 8,192 blocks, 1.5 MiB.
#[derive(Debug, Default)]
pub(crate) struct Places {
    shift: u32,
    blocks: BTreeMap<[u32; 3], PlaceOut>,
}

impl Places {
    /// Adds a cell by its index; what it adds is that cell alone as a place.
    pub(crate) fn add(&mut self, cell: [u32; 3], found: &PlaceOut) {
        put(&mut self.blocks, cell.map(|c| c >> self.shift), found);
        while self.blocks.len() > MAX_BLOCKS {
            self.shift += 1;
            for (block, place) in std::mem::take(&mut self.blocks) {
                put(&mut self.blocks, block.map(|c| c >> 1), &place);
            }
        }
    }

    /// The places, the worst first, and of equal ones the largest.
    pub(crate) fn finish(mut self) -> Vec<PlaceOut> {
        let mut all = Vec::new();
        while let Some((block, mut place)) = self.blocks.pop_first() {
            let mut waiting = vec![block];
            while let Some(block) = waiting.pop() {
                for step in 0..27_u32 {
                    let near = [step % 3, step / 3 % 3, step / 9];
                    let near = std::array::from_fn(|a| (block[a] + near[a]).wrapping_sub(1));
                    if let Some(other) = self.blocks.remove(&near) {
                        place.join(&other);
                        waiting.push(near);
                    }
                }
            }
            all.push(place);
        }
        crate::order::by(&mut all, |a, b| {
            let by_area = || b.area.total_cmp(&a.area);
            b.rank.total_cmp(&a.rank).then_with(by_area).then(a.number.cmp(&b.number))
        });
        all
    }
}

fn put(blocks: &mut BTreeMap<[u32; 3], PlaceOut>, block: [u32; 3], found: &PlaceOut) {
    blocks.entry(block).and_modify(|place| place.join(found)).or_insert(*found);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(number: u64, value: f64) -> PlaceOut {
        PlaceOut::of_cell(number, value, [value; 3], 2.0)
    }

    #[test]
    fn cells_that_touch_are_one_place_and_the_worst_comes_first() {
        let mut places = Places::default();
        for (cell, found) in [
            ([5, 5, 5], one(0, 1.0)),
            ([9, 5, 5], one(1, -3.0)),
            ([6, 6, 6], one(2, -2.0)),
            ([4, 5, 6], one(3, 2.0)),
        ] {
            places.add(cell, &found);
        }
        let found = places.finish();
        let brief: Vec<_> = found.iter().map(|p| (p.value, p.cells, p.area)).collect();
        assert_eq!(brief, [(-3.0, 1, 2.0), (-2.0, 3, 6.0)]);
        assert_eq!(found[1].range, [[-2.0; 3], [2.0; 3]]);
    }

    #[test]
    fn many_blocks_are_coarsened_whatever_the_order() {
        let cells: Vec<u32> = (0..40_000).map(|i| i * 3 % 65_536).collect();
        let run = |cells: &mut dyn Iterator<Item = &u32>| {
            let mut places = Places::default();
            cells.for_each(|x| places.add([*x, 0, 0], &one(u64::from(*x), 1.0)));
            (places.shift, places.finish())
        };
        let [one, other] = [run(&mut cells.iter()), run(&mut cells.iter().rev())];
        assert_eq!(one, other);
        assert!(one.0 > 0 && one.1.iter().map(|p| p.cells).sum::<u64>() == 40_000);
    }
}
