//! Fewer triangles of a whole surface in memory: to a number, or within any distance.
//!
//! Edges are collapsed by meshoptimizer (quadric error metrics, Garland and Heckbert 1997), which moves the corners that
//! stay to where its metric is least; no borders of bricks are left. The metric is no distance. That is measured afterwards:
//! from corners and middles of the triangles before to those after, and from points of these, half a voxel apart, back.
//! Where the surface would touch itself, or triangles lose their area, the fine triangles around are kept.

use std::collections::HashMap;
use std::io;
use std::iter::successors;

use meshopt::{SimplifyOptions, SimplifyVertex};
use rayon::prelude::*;

use super::patch::{edges, lattice};
use super::tree::Tree;
use crate::export::write::{Sink, Vertex};
use crate::geom::{add_scaled, cross, dot};

/// Limits of the metric, as parts of the distance, tried one after the other.
const TRIES: [f64; 6] = [1.0, 0.7, 0.5, 0.3, 0.15, 0.07];

/// Triangles of the smallest closed surface.
const LEAST: usize = 4;

/// How often fine corners may be kept around what went wrong, and how far from there, in voxels.
const ROUNDS: u32 = 8;
const FAULT_REACH: f64 = 2.0;

/// How often fine corners are kept around the places that are farthest away, and what part of the greatest distance these have.
const REFINEMENTS: u32 = 3;
const WORST: f64 = 0.75;

/// Triangles that a thread measures at a time.
const CHUNK: usize = 64;

/// Limits of the reduction, whichever comes first.
#[derive(Clone, Copy, Debug)]
pub(in crate::export) struct Goal {
    pub(in crate::export) triangles: Option<u64>,
    pub(in crate::export) error_mm: Option<f64>,
}

/// A surface in memory.
///
/// Memory: some 300 bytes a triangle while it is reduced.
#[derive(Debug, Default)]
pub(in crate::export) struct Whole {
    vertices: Vec<Vertex>,
    faces: Vec<[u32; 3]>,
}

impl Sink for Whole {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.vertices.push(*vertex);
        Ok(())
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.faces.push(corners);
        Ok(())
    }
}

/// A candidate: corners, relative to the first one, and triangles.
struct Fewer {
    at: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
}

/// Makes triangles fewer and moves their corners; how far the surface is from the one before, in mm.
pub(in crate::export) fn reduce(
    places: &mut [[f32; 3]],
    triangles: &mut Vec<[u32; 3]>,
    goal: Goal,
    voxel_mm: f64,
) -> f64 {
    let wanted = goal.triangles.map_or(0, |count| usize::try_from(count).unwrap_or(usize::MAX)).max(LEAST);
    let (Some(first), true) = (places.first().copied(), wanted < triangles.len()) else {
        return 0.0;
    };
    // Near the origin, where 32 bits tell more places apart.
    let at = places.iter().map(|at| std::array::from_fn(|a| at[a] - first[a])).collect();
    let fine = Fewer { at, faces: std::mem::take(triangles) };
    let tree = Tree::new(fine.triangles());
    let reduced = |wanted: usize, limit: f64, locks: &mut Locks| {
        let fewer = fine.collapsed(wanted, limit, locks)?;
        let (distance, worst) = fewer.apart(&fine, &tree, voxel_mm);
        Some((distance, worst, fewer))
    };
    let none = || Locks { all: vec![SimplifyVertex::empty(); fine.at.len()], voxel_mm };
    let found = match goal.error_mm {
        Some(mm) => TRIES.into_iter().find_map(|part| {
            reduced(wanted, part * mm, &mut none()).filter(|(distance, ..)| *distance <= mm)
        }),
        // Where no sound surface of so many triangles is found, one of twice as many may be.
        None => successors(Some(wanted), |count| count.checked_mul(2))
            .take_while(|count| *count < fine.faces.len())
            .find_map(|count| {
                let mut locks = none();
                let mut best = reduced(count, f64::INFINITY, &mut locks)?;
                for _ in 0..REFINEMENTS {
                    locks.add(&fine, &best.1, 1.0);
                    let next = reduced(count, f64::INFINITY, &mut locks).filter(|next| next.0 < best.0);
                    best = next.unwrap_or(best);
                }
                Some(best)
            }),
    };
    let Some((distance, _, fewer)) = found else {
        *triangles = fine.faces;
        return 0.0;
    };
    for (place, at) in places.iter_mut().zip(&fewer.at) {
        *place = std::array::from_fn(|a| at[a] + first[a]);
    }
    *triangles = fewer.faces;
    distance
}

impl Whole {
    /// Makes the triangles fewer; how far the surface is from the one before, in mm.
    pub(in crate::export) fn reduce(&mut self, goal: Goal, voxel_mm: f64) -> f64 {
        let mut places: Vec<[f32; 3]> = self.vertices.iter().map(|vertex| vertex.at).collect();
        let distance = reduce(&mut places, &mut self.faces, goal, voxel_mm);
        self.vertices.iter_mut().zip(places).for_each(|(vertex, at)| vertex.at = at);
        distance
    }

    /// Hands on the corners that triangles have, and the triangles; their numbers.
    pub(in crate::export) fn hand_on(&self, to: &mut dyn Sink) -> io::Result<(u64, u64)> {
        let mut news = vec![u32::MAX; self.vertices.len()];
        let mut count = 0;
        for face in &self.faces {
            for corner in face {
                let new = &mut news[*corner as usize];
                if *new == u32::MAX {
                    *new = count;
                    count += 1;
                    to.vertex(&self.vertices[*corner as usize])?;
                }
            }
            let at = face.map(|corner| self.vertices[corner as usize].at);
            to.triangle(face.map(|corner| news[corner as usize]), at)?;
        }
        Ok((count.into(), self.faces.len() as u64))
    }
}

impl Fewer {
    fn triangles(&self) -> impl Iterator<Item = [[f64; 3]; 3]> + '_ {
        self.faces.iter().map(|face| self.corners(face))
    }

    fn corners(&self, face: &[u32; 3]) -> [[f64; 3]; 3] {
        face.map(|corner| self.at[corner as usize].map(f64::from))
    }

    /// About so many triangles, or as many as keep the metric below a limit in mm. Where triangles without area would be left, or
    /// edges of other than two triangles, the fine corners around stay as they are; `None` if that does not help.
    fn collapsed(&self, wanted: usize, limit: f64, locks: &mut Locks) -> Option<Self> {
        #[expect(clippy::cast_possible_truncation, reason = "what it gives is measured")]
        let limit = limit.min(f64::from(f32::MAX)) as f32;
        for _ in 0..ROUNDS {
            let (mut at, mut numbers) = (self.at.clone(), self.faces.as_flattened().to_vec());
            let (target, options) = (3 * wanted, SimplifyOptions::ErrorAbsolute);
            let (indices, places) = (&mut numbers[..], &mut at[..]);
            let count = meshopt::simplify_with_update(
                indices,
                places,
                &mut [],
                &[],
                0,
                Some(&locks.all),
                target,
                limit,
                options,
                None,
            );
            numbers.truncate(count);
            let fewer = Self { at, faces: numbers.as_chunks().0.to_vec() };
            let faults = fewer.faults();
            if faults.is_empty() && !fewer.faces.is_empty() {
                return Some(fewer);
            }
            locks.add(self, &faults, FAULT_REACH);
        }
        None
    }

    /// Corners of triangles without area, and of edges that have other than two triangles where corners at one place are one.
    fn faults(&self) -> Vec<[f32; 3]> {
        let mut firsts = HashMap::new();
        // Zeros of both signs are one place.
        let place = |at: [f32; 3]| at.map(|c| (c + 0.0).to_bits());
        let merged: Vec<u32> =
            (0..).zip(&self.at).map(|(number, at)| *firsts.entry(place(*at)).or_insert(number)).collect();
        let faces: Vec<[u32; 3]> = self.faces.iter().map(|face| face.map(|c| merged[c as usize])).collect();
        let edges = edges(&faces);
        let is_twice = |pair: &[u64]| pair[0] == pair[1];
        let twice = edges.windows(2).filter(|pair| is_twice(pair)).map(|pair| pair[0]);
        let open = edges.iter().copied().filter(|edge| edges.binary_search(&edge.rotate_left(32)).is_err());
        let ends = |edge: u64| [edge >> 32, edge & u64::from(u32::MAX)];
        let of_edges = twice.chain(open).flat_map(ends).filter_map(|corner| usize::try_from(corner).ok());
        let is_flat = |face: &&[u32; 3]| {
            let [a, b, c] = self.corners(face);
            let normal = cross(add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
            dot(normal, normal) <= 0.0
        };
        let of_faces = self.faces.iter().filter(is_flat).flatten().map(|corner| *corner as usize);
        of_edges.chain(of_faces).map(|corner| self.at[corner]).collect()
    }

    /// The greatest distance from another surface, or of that one from this, and points near which it is not much smaller.
    fn apart(&self, fine: &Self, fine_tree: &Tree, voxel_mm: f64) -> (f64, Vec<[f32; 3]>) {
        let tree = Tree::new(self.triangles());
        let there = fine.farthest(&tree, &|[a, b, c], point| {
            [a, b, c, std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0)].into_iter().for_each(point);
        });
        let back = self.farthest(fine_tree, &|corners, point| {
            lattice(corners, 0.5 * voxel_mm, |p| {
                point(p);
                true
            });
        });
        let all = || there.iter().chain(&back);
        let most = all().fold(0.0, |most, (square, _)| square.max(most));
        let worst = all().filter(|(square, _)| *square > WORST * WORST * most).map(|(_, at)| *at);
        (most.sqrt(), worst.collect())
    }

    /// The point of each chunk of triangles that is farthest from a surface: its squared distance, and where it is.
    #[expect(clippy::cast_possible_truncation, reason = "back to single precision")]
    fn farthest(&self, from: &Tree, points: &Points<'_>) -> Vec<(f64, [f32; 3])> {
        let chunks = self.faces.par_chunks(CHUNK).map(|faces| {
            let (mut seed, mut worst) = (0, (0.0, [0.0; 3]));
            for face in faces {
                points(self.corners(face), &mut |p| {
                    let square = from.square(p, &mut seed);
                    if square > worst.0 {
                        worst = (square, p.map(|c| c as f32));
                    }
                });
            }
            worst
        });
        chunks.collect()
    }
}

/// Hands over points of a triangle.
type Points<'p> = dyn Fn([[f64; 3]; 3], &mut dyn FnMut([f64; 3])) + Sync + 'p;

/// Fine corners that stay where they are.
struct Locks {
    all: Vec<SimplifyVertex>,
    voxel_mm: f64,
}

impl Locks {
    /// Adds those within so many voxels of some places.
    fn add(&mut self, fine: &Fewer, places: &[[f32; 3]], voxels: f64) {
        let square = (voxels * self.voxel_mm).powi(2);
        self.all.par_iter_mut().zip(&fine.at).for_each(|(lock, at)| {
            let away = |place: &[f32; 3]| add_scaled(at.map(f64::from), -1.0, place.map(f64::from));
            if places.iter().map(away).any(|away| dot(away, away) <= square) {
                *lock = SimplifyVertex::Lock;
            }
        });
    }
}
