//! Tests of every operation against its definition, voxel by voxel, on random volumes and on difficult shapes.
#![expect(clippy::cast_possible_truncation, reason = "numbers made up for the tests")]

use std::path::Path;

use super::bits::BitVolume;
use super::components::{Component, ComponentConnectivity, Outcome, Task, TaskMemory, least_bytes};
use super::{close, row_words};
use crate::budget::Budget;
use crate::geom::Dims;
use crate::progress::Silent;
use crate::random::Random;

use ComponentConnectivity::{Corners26, Faces6};

/// A volume in memory, one flag a voxel.
#[derive(Clone, PartialEq, Eq)]
struct Cells {
    dims: [usize; 3],
    set: Vec<bool>,
}

impl Cells {
    fn new(dims: [usize; 3], mut set: impl FnMut([usize; 3]) -> bool) -> Self {
        let mut cells = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                cells.extend((0..dims[0]).map(|x| set([x, y, z])));
            }
        }
        Self { dims, set: cells }
    }

    fn place(&self, at: usize) -> [i64; 3] {
        let [nx, ny, _] = self.dims;
        [at % nx, at / nx % ny, at / nx / ny].map(|c| c as i64)
    }

    fn index(&self, at: [i64; 3]) -> Option<usize> {
        let inside = at.iter().zip(self.dims).all(|(c, n)| (0..n as i64).contains(c));
        let [x, y, z] = at.map(|c| c as usize);
        inside.then(|| (z * self.dims[1] + y) * self.dims[0] + x)
    }

    fn is_set(&self, at: [i64; 3]) -> bool {
        self.index(at).is_some_and(|i| self.set[i])
    }

    fn geometry(&self) -> Dims {
        let [nx, ny, nz] = self.dims.map(|n| n as u32);
        Dims::new(nx, ny, nz).unwrap()
    }

    fn store(&self, folder: &Path) -> BitVolume {
        let bits = BitVolume::create(folder, self.geometry()).unwrap();
        for (row, cells) in self.set.chunks(self.dims[0]).enumerate() {
            let mut words = vec![0_u64; bits.row_words];
            cells.iter().enumerate().for_each(|(x, set)| words[x / 64] |= u64::from(*set) << (x % 64));
            bits.write(row as u64, 0, &words).unwrap();
        }
        bits
    }

    fn load(&self, bits: &BitVolume) -> Self {
        let mut set = Vec::new();
        for row in 0..bits.rows() {
            let mut words = vec![0; bits.row_words];
            bits.read(row, 0, &mut words).unwrap();
            set.extend((0..self.dims[0]).map(|x| words[x / 64] >> (x % 64) & 1 == 1));
            let beyond = words.iter().map(|w| w.count_ones()).sum::<u32>();
            assert_eq!(beyond as usize, set[set.len() - self.dims[0]..].iter().filter(|s| **s).count());
        }
        Self { dims: self.dims, set }
    }

    /// Components of the voxels with this flag: a number for each voxel, sizes, and whether they touch the border.
    fn components(
        &self,
        flag: bool,
        connectivity: ComponentConnectivity,
    ) -> (Vec<usize>, Vec<(u64, usize, bool)>) {
        let steps: Vec<[i64; 3]> = (0..27)
            .map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
            .filter(|s| {
                let axes = s.iter().filter(|c| **c != 0).count();
                axes == 1 || (axes > 1 && connectivity == Corners26)
            })
            .collect();
        let none = usize::MAX;
        let mut labels = vec![none; self.set.len()];
        let mut found = Vec::new();
        for first in 0..self.set.len() {
            if self.set[first] != flag || labels[first] != none {
                continue;
            }
            let label = found.len();
            let (mut size, mut border) = (0, false);
            let mut stack = vec![first];
            labels[first] = label;
            while let Some(at) = stack.pop() {
                size += 1;
                let p = self.place(at);
                border |= p.iter().zip(self.dims).any(|(c, n)| *c == 0 || *c + 1 == n as i64);
                for s in &steps {
                    if let Some(next) = self.index([p[0] + s[0], p[1] + s[1], p[2] + s[2]])
                        && self.set[next] == flag
                        && labels[next] == none
                    {
                        labels[next] = label;
                        stack.push(next);
                    }
                }
            }
            found.push((size, first, border));
        }
        (labels, found)
    }
}

/// Number of the largest components that the tests ask for.
const LARGEST: usize = 3;

/// The least memory that a task can do with.
fn memory(dims: Dims) -> TaskMemory {
    TaskMemory::reserve(dims, LARGEST, &Budget::new(least_bytes(dims, LARGEST))).unwrap()
}

fn task<'a>(
    bits: &'a BitVolume,
    folder: &'a Path,
    connectivity: ComponentConnectivity,
    inverted: bool,
    memory: &'a TaskMemory,
) -> Task<'a> {
    Task { bits, inverted, connectivity, largest: LARGEST, folder, memory, progress: &Silent }
}

/// Labels the volume both ways and holds components, their order and every voxel's component to the definition.
fn check_labels(cells: &Cells, connectivity: ComponentConnectivity, inverted: bool) {
    let folder = tempfile::tempdir().unwrap();
    let (labels, found) = cells.components(!inverted, connectivity);
    let mut ranked: Vec<_> = found.iter().map(|(size, first, _)| (*size, *first as u64)).collect();
    ranked.sort_by_key(|(size, first)| (std::cmp::Reverse(*size), *first));
    // Bit k of a component's number decides in round k, so that two components that were mixed up would show in
    // some round; in the last all stay.
    let rounds = usize::BITS - found.len().leading_zeros();
    for round in 0..=rounds {
        let bits = cells.store(folder.path());
        let memory = memory(bits.dims());
        let labelled = task(&bits, folder.path(), connectivity, inverted, &memory).label().unwrap();
        assert_eq!(labelled.census.components, found.len() as u64);
        let largest: Vec<_> = labelled.census.largest.iter().map(|c| (c.voxels, c.first())).collect();
        assert_eq!(largest, ranked[..ranked.len().min(3)]);
        let keep = |label: usize| round == rounds || label >> round & 1 == 1;
        let outcome = labelled
            .decide(&|c: Component| {
                let label = labels[c.first() as usize];
                let (size, _, border) = found[label];
                assert_eq!((c.voxels, c.touches_border()), (size, border));
                keep(label)
            })
            .unwrap();
        let mut want = cells.clone();
        let (mut changed, mut dropped) = (0, vec![0; found.len()]);
        for (set, label) in want.set.iter_mut().zip(&labels) {
            if *label != usize::MAX && !keep(*label) {
                *set = !*set;
                changed += 1;
                dropped[*label] += 1;
            }
        }
        let largest_dropped = dropped.into_iter().max().unwrap_or(0);
        assert!(cells.load(&bits) == want, "{:?} {connectivity:?} {inverted} round {round}", cells.dims);
        let kept = (0..found.len()).filter(|label| keep(*label)).count() as u64;
        assert_eq!(outcome, Outcome { kept, largest_dropped, changed });
    }
}

#[test]
fn labels_of_500_random_volumes_are_those_of_the_definition() {
    let mut numbers = Random(1);
    for round in 0..500 {
        let dims = [(); 3].map(|()| 1 + numbers.below(24) as usize);
        let dims = if round % 50 == 0 { [1 + numbers.below(200) as usize, dims[1], dims[2]] } else { dims };
        let density = [50, 100, 200, 310, 310, 500, 700, 900][round % 8];
        let cells = Cells::new(dims, |_| numbers.below(1000) < density);
        check_labels(&cells, if round % 3 == 0 { Faces6 } else { Corners26 }, round % 5 == 4);
        check_labels(&cells, if round % 3 == 0 { Corners26 } else { Faces6 }, round % 7 == 6);
    }
}

#[test]
fn hard_shapes_are_labelled_as_defined() {
    type Shape = (&'static str, fn([usize; 3]) -> bool);
    let shapes: [Shape; 8] = [
        ("checkerboard", |[x, y, z]| (x + y + z) % 2 == 0),
        // Teeth that only the last slice joins, and combs of combs.
        ("comb along z", |[x, y, z]| z == 20 || (x % 2 == 0 && y % 2 == 0)),
        ("comb along y", |[x, y, z]| z % 2 == 0 && (y == 20 || x % 2 == 0)),
        ("combs that merge in pairs, late", |[x, y, z]| {
            y % 2 == 0 && (x % 2 == 0 || (z >= 16 && x % 4 == 1) || (z >= 18 && x % 8 == 3) || z == 20)
        }),
        ("spiral in a slice", |[x, y, z]| {
            let (a, b) = (x.min(20 - x), y.min(20 - y));
            let ring = a.min(b);
            z == 3 && (ring % 2 == 0) != (x == ring && y == ring + 1 && ring > 0)
        }),
        ("helix", |[x, y, z]| {
            let turn = [(5, 5), (10, 5), (15, 5), (15, 10), (15, 15), (10, 15), (5, 15), (5, 10)];
            let (a, b) = (turn[z % 8], turn[(z + 1) % 8]);
            (x.min(20), y) == a
                || ((x, y) == b)
                || (x >= a.0.min(b.0) && x <= a.0.max(b.0) && y >= a.1.min(b.1) && y <= a.1.max(b.1))
        }),
        ("diagonals", |[x, y, z]| y == z && (x == y || x + y == 20)),
        ("shells within shells", |[x, y, z]| {
            let inner = [x, y, z].map(|c| c.min(20 - c));
            inner[0].min(inner[1]).min(inner[2]) % 2 == 1
        }),
    ];
    for (name, shape) in shapes {
        println!("{name}");
        for inverted in [false, true] {
            for connectivity in [Faces6, Corners26] {
                check_labels(&Cells::new([21, 21, 21], shape), connectivity, inverted);
                check_labels(
                    &Cells::new([21, 21, 21], |[x, y, z]| shape([z, y, 20 - x])),
                    connectivity,
                    inverted,
                );
            }
        }
    }
    // A slice of noise whose tables are far longer than the smallest cache.
    let mut numbers = Random(9);
    let noise = Cells::new([300, 300, 4], |_| numbers.below(1000) < 310);
    check_labels(&noise, Faces6, false);
    check_labels(&Cells::new([300, 300, 3], |[x, y, z]| (x + y + z) % 2 == 0), Faces6, false);
}

/// The closing by its definition, in air without bounds.
fn closed(cells: &Cells, radius: i64) -> Cells {
    let reach = -radius..=radius;
    let mut ball = Vec::new();
    for dz in reach.clone() {
        for dy in reach.clone() {
            // Within radius + 1/2.
            ball.extend(
                reach
                    .clone()
                    .map(|dx| [dx, dy, dz])
                    .filter(|d| 4 * d.iter().map(|c| c * c).sum::<i64>() <= (2 * radius + 1).pow(2)),
            );
        }
    }
    let around = |p: [i64; 3], d: &[i64; 3]| [p[0] + d[0], p[1] + d[1], p[2] + d[2]];
    let wide = cells.dims.map(|n| n + 2 * radius as usize);
    let dilated = Cells::new(wide, |p| {
        let p = p.map(|c| c as i64 - radius);
        ball.iter().any(|d| cells.is_set(around(p, d)))
    });
    Cells::new(cells.dims, |p| {
        let p = p.map(|c| c as i64 + radius);
        ball.iter().all(|d| dilated.is_set(around(p, d)))
    })
}

#[test]
fn closing_is_dilation_and_erosion_in_air_without_bounds() {
    let mut numbers = Random(3);
    let folder = tempfile::tempdir().unwrap();
    for round in 0..120 {
        let mut dims = [(); 3].map(|()| 1 + numbers.below(14) as usize);
        if round % 6 == 0 {
            dims[0] = 60 + numbers.below(80) as usize;
        }
        let density = [10, 50, 150, 310, 600][round % 5];
        let cells = Cells::new(dims, |_| numbers.below(1000) < density);
        for radius in [1, 2] {
            let want = closed(&cells, i64::from(radius));
            let added = want.set.iter().zip(&cells.set).filter(|(a, b)| a != b).count() as u64;
            assert!(want.set.iter().zip(&cells.set).all(|(after, before)| *after || !before));
            let from = cells.store(folder.path());
            // Strips of one row, of some, and of all.
            for rows in [1, 3, 100] {
                let to = BitVolume::create(folder.path(), cells.geometry()).unwrap();
                let room = close::bytes(row_words(cells.geometry()), radius, rows);
                let (rows, _memory) = close::reserve_strips(&from, radius, &Budget::new(room)).unwrap();
                assert_eq!(close::close(&from, &to, radius, rows, &Silent).unwrap(), added);
                assert!(cells.load(&to) == want, "{dims:?} {radius} {rows}");
            }
        }
    }
}
