//! Sweeps compared with the rule, box by box.
#![expect(clippy::cast_possible_truncation, reason = "places of a small grid")]

use std::collections::BTreeSet;

use super::*;
use crate::progress::Silent;
use crate::random::Random;

/// A small grid of samples, with a slow search for visible boxes.
struct Slow {
    dims: [i64; 3],
    inside: Vec<bool>,
    is_cells: bool,
}

impl Slow {
    fn inside(&self, p: [i64; 3]) -> bool {
        // A grid of cells has one sample less.
        let last = |a: usize| self.dims[a] - i64::from(self.is_cells);
        let within = (0..3).all(|a| (0..last(a)).contains(&p[a]));
        within && self.inside[((p[2] * self.dims[1] + p[1]) * self.dims[0] + p[0]) as usize]
    }

    /// True if a ray from the previous box can go on through this one.
    fn is_open(&self, p: [i64; 3], step: [i64; 3]) -> bool {
        if !self.is_cells {
            return !self.inside(p);
        }
        // Samples common to both cells: cell i lies between samples i - 1 and i.
        let range = |a: usize| match step[a] {
            1 => p[a] - 1..=p[a] - 1,
            -1 => p[a]..=p[a],
            _ => p[a] - 1..=p[a],
        };
        range(2).any(|z| range(1).any(|y| range(0).any(|x| !self.inside([x, y, z]))))
    }

    /// Boxes that rays of a way enter.
    fn entered(&self, way: &SweepDirection) -> BTreeSet<[i64; 3]> {
        let signs = [0, 1, 2].map(|a| if way.back[a] { -1 } else { 1 });
        let reached = |p: [i64; 3]| (0..3).all(|a| way.reaches(a, p[a]));
        let order = |a: usize| -> Vec<i64> {
            let all = 0..self.dims[a];
            if way.back[a] { all.rev().collect() } else { all.collect() }
        };
        let mut lit = BTreeSet::new();
        let mut entered = BTreeSet::new();
        for z in order(2) {
            for y in order(1) {
                for x in order(0) {
                    let p = [x, y, z];
                    if way.within && way.eye.is_some_and(|eye| (0..3).all(|a| (p[a] - eye[a]).abs() <= 1)) {
                        lit.insert(p);
                        entered.insert(p);
                    }
                    if !reached(p) {
                        continue;
                    }
                    for bits in 1..8 {
                        let goes = [0, 1, 2].map(|a| bits >> a & 1 == 1);
                        if (0..3).any(|a| goes[a] && !way.moves[a]) {
                            continue;
                        }
                        let step = [0, 1, 2].map(|a| if goes[a] { signs[a] } else { 0 });
                        let from = [0, 1, 2].map(|a| p[a] - step[a]);
                        let beyond = (0..3).any(|a| !(0..self.dims[a]).contains(&from[a]));
                        if if beyond { !way.within && reached(from) } else { lit.contains(&from) } {
                            entered.insert(p);
                            if self.is_open(p, step) {
                                lit.insert(p);
                            }
                        }
                    }
                }
            }
        }
        entered
    }
}

#[test]
fn sweeps_see_what_the_rule_sees() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(3);
    for round in 0..60 {
        let dims = match round % 4 {
            0 => [70, 5, 6],
            1 => [64, 3, 9],
            2 => [9, 140, 4],
            _ => [130, 4, 3],
        };
        let is_cells = round % 2 == 1;
        let sparse = 1 + round % 7;
        let count = dims.iter().product::<i64>();
        let inside: Vec<bool> = (0..count).map(|_| random.below(8_u32) < sparse).collect();
        let slow = Slow { dims, inside, is_cells };
        let grid = Dims::new(dims[0] as u32, dims[1] as u32, dims[2] as u32).unwrap();
        let occupancy = BitVolume::create(folder.path(), grid).unwrap();
        for row in 0..occupancy.rows() {
            let mut words = vec![0_u64; occupancy.row_words];
            for x in 0..dims[0] {
                let p = [x, (row as i64) % dims[1], (row as i64) / dims[1]];
                words[x as usize / 64] |= u64::from(slow.inside(p)) << (x % 64);
            }
            occupancy.write(row, 0, &words).unwrap();
        }
        let place = |random: &mut Random, a: usize| random.unit() * (dims[a] as f64 + 8.0) - 4.0;
        let point = [0, 1, 2].map(|a| place(&mut random, a));
        let from = match round % 5 {
            0 => vec![ViewedFrom::Outside],
            1 => vec![ViewedFrom::Along([0.0, 1.0, -0.3])],
            2 => vec![ViewedFrom::Along([-2.0, 0.0, 0.0]), ViewedFrom::Along([0.0, 0.0, 1.0])],
            3 => vec![ViewedFrom::Point(point)],
            _ => vec![ViewedFrom::Point([3.2, 1.5, 2.5]), ViewedFrom::Along([1.0, -1.0, 1e-12])],
        };
        let search = Search::new(&from, Affine::from_spacing([1.0; 3]), is_cells, &occupancy);
        let mut expected: BTreeSet<[i64; 3]> = search.ways.iter().flat_map(|way| slow.entered(way)).collect();
        // From within the solid everything is visible.
        let from_within = search.ways.iter().any(|way| {
            let sides = if is_cells { 0..2 } else { 0..1 };
            let samples = |eye: [i64; 3]| {
                let all = sides.clone().flat_map(|z| sides.clone().map(move |y| (y, z)));
                let mut all = all.flat_map(|(y, z)| sides.clone().map(move |x| [x, y, z]));
                all.all(|d| slow.inside([0, 1, 2].map(|a| eye[a] - d[a])))
            };
            way.within && way.eye.is_some_and(samples)
        });
        if from_within {
            expected = (0..dims[2])
                .flat_map(|z| (0..dims[1]).map(move |y| [y, z]))
                .flat_map(|[y, z]| (0..dims[0]).map(move |x| [x, y, z]))
                .collect();
        }
        let [up, down] = [false, true].map(|back| {
            let seen = BitVolume::create(folder.path(), grid).unwrap();
            search.follow(back, &seen, &Silent).unwrap();
            seen
        });
        join(&up, &down).unwrap();
        for row in 0..up.rows() {
            let mut words = vec![0_u64; up.row_words];
            up.read(row, 0, &mut words).unwrap();
            for x in 0..dims[0] {
                let p = [x, (row as i64) % dims[1], (row as i64) / dims[1]];
                let seen = words[x as usize / 64] >> (x % 64) & 1 == 1;
                assert_eq!(seen, expected.contains(&p), "{round} {from:?} {p:?}");
            }
        }
    }
}

#[test]
fn ways_are_as_few_as_they_can_be() {
    let dims = Dims::new(10, 10, 10).unwrap();
    let boxes = Affine::from_spacing([1.0; 3]);
    let count = |from: &[ViewedFrom]| ways(from, &boxes, dims).len();
    assert_eq!(count(&[ViewedFrom::Outside]), 8);
    assert_eq!(count(&[ViewedFrom::Outside, ViewedFrom::Along([1.0, 2.0, -3.0])]), 8);
    assert_eq!(count(&[ViewedFrom::Along([0.0, 1.0, 0.0]), ViewedFrom::Along([0.0, 3.0, 0.0])]), 1);
    // From within in all directions; from before a face only onwards.
    assert_eq!(count(&[ViewedFrom::Point([5.0; 3])]), 8);
    assert_eq!(count(&[ViewedFrom::Point([5.0, 5.0, -100.0])]), 4);
    assert_eq!(count(&[ViewedFrom::Point([-50.0, 1e9, -100.0])]), 1);
}
