//! Fewer triangles of a whole surface in memory: to a number, or within any distance.
//!
//! Edges are collapsed by meshoptimizer (quadric error metrics, Garland and Heckbert 1997), which moves the corners that
//! stay to where its metric is least; no borders of bricks are left. The metric is no distance. That is measured afterwards:
//! from corners and middles of the triangles before to those after, and from points of these, half a voxel apart, back.
//! Where the surface came to touch itself, it is taken apart (sheets).

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use meshopt::{SimplifyOptions, SimplifyVertex};
use rayon::prelude::*;

use super::patch::lattice;
use super::sheets::Surface;
use super::tree::Tree;
use crate::export::write::{Sink, Vertex};
use crate::progress::{Progress, Stopped};

/// Limits of the metric, as parts of the distance, tried one after the other.
const TRIES: [f64; 6] = [1.0, 0.7, 0.5, 0.3, 0.15, 0.07];

/// Triangles of the smallest closed surface.
const LEAST: usize = 4;

/// Triangles that are left for each part of a surface; where there are fewer, the smallest parts are left out.
const OF_PART: usize = 2 * LEAST;

/// How often triangles are made fewer before it is said that they cannot.
const ROUNDS: u32 = 8;

/// Voxels by which corners at one place are moved apart, and units of their last bit at least.
const APART: (f64, f32) = (0.01, 4.0 * f32::EPSILON);

/// How often fine corners are kept around the places that are farthest away, and what part of the greatest distance these have.
const REFINEMENTS: u32 = 3;
const WORST: f64 = 0.75;

/// Points or triangles that a thread measures at a time.
const CHUNK: usize = 64;

/// Limits of the reduction, whichever comes first.
#[derive(Clone, Copy, Debug)]
pub(in crate::export) struct Goal {
    pub(in crate::export) triangles: Option<u64>,
    pub(in crate::export) error_mm: Option<f64>,
}

/// How far a surface is from the one before, in mm, and how many of its parts were left out.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::export) struct Apart {
    pub(in crate::export) distance_mm: f64,
    pub(in crate::export) parts_gone: u64,
}

/// A surface in memory.
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

impl Whole {
    /// Makes the triangles fewer.
    pub(in crate::export) fn reduce(
        &mut self,
        goal: Goal,
        voxel_mm: f64,
        progress: &dyn Progress,
    ) -> Result<Apart, Stopped> {
        let places = self.vertices.iter().map(|vertex| vertex.at).collect();
        let fine = Surface::new(places, std::mem::take(&mut self.faces));
        let (few, apart) = reduce(fine, goal, voxel_mm, progress)?;
        let vertex = |(old, at): (&u32, &[f32; 3])| Vertex { at: *at, ..self.vertices[*old as usize] };
        self.vertices = few.olds.iter().zip(&few.at).map(vertex).collect();
        self.faces = few.faces;
        Ok(apart)
    }

    /// Hands on corners and triangles; their numbers.
    pub(in crate::export) fn hand_on(&self, to: &mut dyn Sink) -> io::Result<(u64, u64)> {
        for vertex in &self.vertices {
            to.vertex(vertex)?;
        }
        for face in &self.faces {
            to.triangle(*face, face.map(|corner| self.vertices[corner as usize].at))?;
        }
        Ok((self.vertices.len() as u64, self.faces.len() as u64))
    }
}

/// Makes triangles fewer and moves their corners.
///
/// Memory: some 220 bytes a fine triangle.
pub(in crate::export) fn reduce(
    fine: Surface,
    goal: Goal,
    voxel_mm: f64,
    progress: &dyn Progress,
) -> Result<(Surface, Apart), Stopped> {
    let wanted = goal.triangles.map_or(0, |count| usize::try_from(count).unwrap_or(usize::MAX)).max(LEAST);
    if wanted >= fine.faces.len() {
        return Ok((fine, Apart::default()));
    }
    let (parts, count) = fine.parts();
    let mut spans: Vec<_> = (0_u32..).zip(fine.spans(&parts, count)).collect();
    spans.sort_by(|(_, (a, _)), (_, (b, _))| b.total_cmp(a));
    // Within a distance no part is left out.
    spans.truncate(if goal.error_mm.is_some() { count } else { (wanted / OF_PART).max(1) });
    let mut anchors = vec![None; count];
    let mut locks = vec![SimplifyVertex::empty(); fine.at.len()];
    for (part, (_, corners)) in spans {
        anchors[part as usize] = Some(corners);
        corners.iter().for_each(|corner| locks[*corner as usize] = SimplifyVertex::Lock);
    }
    let tree = Tree::new(fine.triangles().collect());
    let reducer = Reducer { fine, tree, parts, anchors, wanted, voxel_mm, progress };
    let found = match goal.error_mm {
        Some(mm) => reducer.within(mm, &locks)?,
        None => reducer.refined(&mut locks)?,
    };
    let Some(Fewer { mut surface, distance_mm, .. }) = found else {
        return Ok((reducer.fine, Apart::default()));
    };
    let parts_gone = reducer.is_gone(&surface).into_iter().filter(|gone| *gone).count() as u64;
    surface.olds.iter_mut().for_each(|old| *old = reducer.fine.olds[*old as usize]);
    Ok((surface, Apart { distance_mm, parts_gone }))
}

/// Hands over points of an item.
type Points<'p, T> = dyn Fn(&T, &mut dyn FnMut([f64; 3])) + Sync + 'p;

/// A surface of fewer triangles.
struct Fewer {
    surface: Surface,
    distance_mm: f64,
    /// Points near which the distance is not much smaller.
    worst: Vec<[f32; 3]>,
}

struct Reducer<'a> {
    fine: Surface,
    tree: Tree,
    /// The part of each fine corner.
    parts: Vec<u32>,
    /// Corners of each part that stay; `None` if the part is left out.
    anchors: Vec<Option<[u32; 4]>>,
    wanted: usize,
    voxel_mm: f64,
    progress: &'a dyn Progress,
}

impl Reducer<'_> {
    /// Within a distance; `None` if no such surface is found.
    fn within(&self, mm: f64, locks: &[SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        for part in TRIES {
            if let Some(fewer) = self.reduced(part * mm, locks)?
                && fewer.distance_mm <= mm
            {
                return Ok(Some(fewer));
            }
        }
        Ok(None)
    }

    /// As many triangles as are wanted, with fine corners at the places that would be farthest away.
    fn refined(&self, locks: &mut [SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        let Some(mut best) = self.reduced(f64::INFINITY, locks)? else { return Ok(None) };
        for _ in 0..REFINEMENTS {
            let places = Tree::new(best.worst.iter().map(|place| [*place; 3]).collect());
            let square = self.voxel_mm * self.voxel_mm;
            locks.par_iter_mut().zip(&self.fine.at).for_each(|(lock, at)| {
                if places.square(at.map(f64::from), &mut 0, square) <= square {
                    *lock = SimplifyVertex::Lock;
                }
            });
            if let Some(next) = self.reduced(f64::INFINITY, locks)?
                && next.distance_mm < best.distance_mm
                && next.surface.faces.len() <= best.surface.faces.len().max(self.wanted)
            {
                best = next;
            }
        }
        Ok(Some(best))
    }

    fn reduced(&self, limit: f64, locks: &[SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        self.progress.check()?;
        let Some(surface) = self.collapsed(limit, locks)? else { return Ok(None) };
        let (distance_mm, worst) = self.distance(&surface)?;
        Ok(Some(Fewer { surface, distance_mm, worst }))
    }

    /// About so many triangles as are wanted, or as many as keep the metric below a limit in mm; `None` if none are left.
    fn collapsed(&self, limit: f64, locks: &[SimplifyVertex]) -> Result<Option<Surface>, Stopped> {
        let fine = &self.fine;
        let is_kept = |face: &&[u32; 3]| self.anchors[self.parts[face[0] as usize] as usize].is_some();
        let faces = fine.faces.iter().filter(is_kept).copied().collect();
        let olds = (0..).take(fine.at.len()).collect();
        let mut surface = Surface { at: fine.at.clone(), faces, olds };
        let size = fine.at.as_flattened().iter().fold(0.0_f32, |most, c| most.max(c.abs()));
        let step = (APART.0 * self.voxel_mm).max(f64::from(APART.1 * size));
        for round in 0..ROUNDS {
            let before = surface.faces.len();
            // Where so few triangles are not reached otherwise, parts may go.
            let is_last = round + 2 >= ROUNDS;
            let lock = |old: &u32| if is_last { SimplifyVertex::empty() } else { locks[*old as usize] };
            let locks: Vec<_> = surface.olds.iter().map(lock).collect();
            surface.collapse(self.wanted, limit, &locks);
            self.progress.check()?;
            surface.cancel();
            let gone =
                self.is_gone(&surface).into_iter().zip(&self.anchors).filter(|(gone, _)| *gone && !is_last);
            gone.filter_map(|(_, anchors)| *anchors).for_each(|corners| surface.add(fine, corners));
            if !surface.repair(step) {
                return Ok(None);
            }
            let count = surface.faces.len();
            if count <= self.wanted || limit.is_finite() || is_last && count == before {
                break;
            }
        }
        Ok(Some(surface))
    }

    /// Which parts of the fine surface another one lacks.
    fn is_gone(&self, surface: &Surface) -> Vec<bool> {
        let mut is_gone = vec![true; self.anchors.len()];
        for [corner, ..] in &surface.faces {
            is_gone[self.parts[surface.olds[*corner as usize] as usize] as usize] = false;
        }
        is_gone
    }

    /// The greatest distance of a surface from the fine one, or of that one from it, and points near which it is not much
    /// smaller.
    fn distance(&self, few: &Surface) -> Result<(f64, Vec<[f32; 3]>), Stopped> {
        let tree = Tree::new(few.triangles().collect());
        let most = AtomicU64::new(0);
        let mut all = self.farthest(&self.fine.at, &tree, &most, &|at, point| point(at.map(f64::from)));
        all.extend(self.farthest(&self.fine.faces, &tree, &most, &|face, point| {
            let [a, b, c] = self.fine.corners(face);
            point(std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0));
        }));
        all.extend(self.farthest(&few.faces, &self.tree, &most, &|face, point| {
            lattice(few.corners(face), 0.5 * self.voxel_mm, |p| {
                point(p);
                true
            });
        }));
        self.progress.check()?;
        let most = f64::from_bits(most.into_inner());
        all.retain(|(square, _)| *square > WORST * WORST * most);
        Ok((most.sqrt(), all.into_iter().map(|(_, at)| at).collect()))
    }

    /// The point of each chunk of items that is farthest from a surface: its squared distance, and where it is. Raises `most`,
    /// the bits of the greatest one; those that are much smaller are not exact.
    #[expect(clippy::cast_possible_truncation, reason = "back to single precision")]
    fn farthest<T: Sync>(
        &self,
        items: &[T],
        from: &Tree,
        most: &AtomicU64,
        points: &Points<'_, T>,
    ) -> Vec<(f64, [f32; 3])> {
        let chunks = items.par_chunks(CHUNK).map(|items| {
            let (mut seed, mut worst) = (0, (0.0, [0.0; 3]));
            if self.progress.stopped() {
                return worst;
            }
            let enough = WORST * WORST * f64::from_bits(most.load(Ordering::Relaxed));
            for item in items {
                points(item, &mut |p| {
                    let square = from.square(p, &mut seed, enough);
                    if square > worst.0 {
                        worst = (square, p.map(|c| c as f32));
                    }
                });
            }
            most.fetch_max(worst.0.to_bits(), Ordering::Relaxed);
            worst
        });
        chunks.collect()
    }
}

impl Surface {
    fn triangles(&self) -> impl Iterator<Item = [[f32; 3]; 3]> + '_ {
        self.faces.iter().map(|face| face.map(|corner| self.at[corner as usize]))
    }

    /// Collapses edges until so many triangles are left, or none below a limit of the metric in mm; sheets may touch then.
    fn collapse(&mut self, wanted: usize, limit: f64, locks: &[SimplifyVertex]) {
        #[expect(clippy::cast_possible_truncation, reason = "what it gives is measured")]
        let limit = limit.min(f64::from(f32::MAX)) as f32;
        let (target, options) = (3 * wanted.min(self.faces.len()), SimplifyOptions::ErrorAbsolute);
        let (indices, places) = (self.faces.as_flattened_mut(), &mut self.at[..]);
        let count = meshopt::simplify_with_update(
            indices,
            places,
            &mut [],
            &[],
            0,
            Some(locks),
            target,
            limit,
            options,
            None,
        );
        self.faces.truncate(count / 3);
    }
}

#[cfg(test)]
mod tests {
    use crate::export::Mesh;
    use crate::export::decimate::near::Facet;
    use crate::geom::{add_scaled, cross, dot};
    use crate::progress::Silent;
    use crate::{BuildOptions, Dims, Model, Threshold, Voxels};
    use std::collections::HashSet;

    /// Noise: sheets touch in many places, and there are hundreds of parts.
    fn noise() -> Mesh {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.oct");
        let value = |p: [u32; 3]| {
            let mixed = (p[0] ^ p[1] << 8 ^ p[2] << 16).wrapping_mul(0x9e37_79b9);
            ((mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca6b) >> 8) as f32 / (1 << 23) as f32 - 1.2
        };
        let volume = Voxels::from_fn(Dims::new(24, 24, 24).unwrap(), value);
        let options = BuildOptions { threshold: Threshold::Iso(0.0), ..BuildOptions::default() };
        crate::build(&volume, &options, &path).unwrap();
        crate::triangles(&Model::open(&path).unwrap(), &Silent).unwrap()
    }

    #[test]
    fn noise_has_no_more_triangles_than_were_asked_for_and_is_closed() {
        let fine = noise();
        assert!(fine.faces.len() > 20_000, "{}", fine.faces.len());
        let place = |mesh: &Mesh, corner: u32| mesh.vertices[corner as usize].map(f64::from);
        for wanted in [10_000, 3000, 300] {
            let mut mesh = fine.clone();
            let stated = mesh.reduce(wanted, 1.0);
            assert!(mesh.faces.len() as u64 <= wanted, "{} of {wanted}", mesh.faces.len());
            assert!(mesh.faces.len() as u64 * 4 > wanted * 3, "{} of {wanted}", mesh.faces.len());
            let places: HashSet<_> = mesh.vertices.iter().map(|at| at.map(|c| (c + 0.0).to_bits())).collect();
            assert_eq!(places.len(), mesh.vertices.len());
            assert_eq!(mesh.normals.len(), mesh.vertices.len());
            let mut edges = HashSet::new();
            for face in &mesh.faces {
                let [a, b, c] = face.map(|corner| place(&mesh, corner));
                let normal = cross(add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
                assert!(dot(normal, normal) > 0.0);
                assert!((0..3).all(|k| edges.insert([face[k], face[(k + 1) % 3]])), "an edge twice");
            }
            assert!(edges.iter().all(|[a, b]| edges.contains(&[*b, *a])), "an open edge");
            let facets: Vec<_> = mesh.faces.iter().map(|f| Facet::new(f.map(|c| place(&mesh, c)))).collect();
            let far = |at: &[f32; 3]| {
                let squares = facets.iter().map(|facet| facet.square(at.map(f64::from)));
                squares.fold(f64::INFINITY, f64::min).sqrt()
            };
            let most = fine.vertices.iter().step_by(7).map(far).fold(0.0, f64::max);
            assert!(most <= stated + 1e-6 && stated < 8.0, "{most} {stated}");
        }
    }
}
