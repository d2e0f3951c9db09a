//! Fewer triangles of a surface in memory, to a number or within a distance.
//!
//! Edges are collapsed by meshoptimizer (quadric error metrics, Garland and Heckbert 1997), which moves the corners that
//! stay to where its metric is least. The metric is no distance, and in single precision it says little of small distances on
//! large bodies. So to stay within a distance, patches are reduced by themselves, and less where that is too far; then other
//! patches, whose middles are the borders of the first. Where the surface came to touch itself, it is taken apart (sheets).
//! Then the distance is measured: from corners and middles of the triangles before to those after, and from points of these,
//! half a voxel apart, back.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use meshopt::{SimplifyOptions, SimplifyVertex};
use rayon::prelude::*;

use super::number;
use super::sheets::Surface;
use super::tree::Tree;
use crate::export::Exported;
use crate::export::write::{Sink, Vertex};
use crate::geom::{add_scaled, cross, dot};
use crate::progress::{Progress, Stopped};

/// Patches of so many voxels a side are reduced within a distance, first some, then others.
const PATCH: f64 = 32.0;

/// Borders of the patches in sides, and what is left to these of the distance.
const PASSES: [(f64, f64); 2] = [(0.0, 0.7), (0.5, 0.28)];

/// Limits of the metric in a patch, tried one after the other: a part of the distance, then so many powers of two of a
/// voxel. These are the same for any distance, so that a larger one finds what a smaller one did.
const TRY: f64 = 0.6;
const TRIES: u32 = 4;

/// The same for the whole surface.
const LIMITS: [f64; 6] = [1.0, 0.7, 0.5, 0.3, 0.15, 0.07];

/// Triangles of a slab in memory.
const SLAB: usize = 1 << 23;

/// Part of the distance that slabs may use, and voxels that they may use where it has no limit.
const OF_SLAB: f64 = 0.8;
const SLAB_VOXELS: f64 = 0.25;

/// Rows of points on a triangle, and points in a row, at most.
const MAX_POINTS: f64 = 256.0;

/// Triangles of the smallest closed surface.
const LEAST: usize = 4;

/// Triangles that are left for each part of a surface; where there are fewer, the smallest parts are left out.
const OF_PART: usize = 2 * LEAST;

/// How often triangles are made fewer before it is said that they cannot.
const ROUNDS: u32 = 8;

/// Voxels by which corners at one place are moved apart, and units of their last bit at least.
const APART: (f64, f32) = (0.01, 4.0 * f32::EPSILON);

/// The same as a part of the distance, at most.
const APART_OF_ERROR: f64 = 0.01;

/// How often fine corners are kept around the places that are farthest away, and what part of the greatest distance these have.
const REFINEMENTS: u32 = 8;
const WORST: f64 = 0.75;

/// Steps that a piece is thick, in the mean, whose sheets touched before these were moved apart; at most.
const THIN: f64 = 4.0;

/// Points or triangles that a thread measures at a time.
const CHUNK: usize = 64;

/// Limits of the reduction, whichever comes first.
#[derive(Clone, Copy, Debug)]
pub(in crate::export) struct Goal {
    pub(in crate::export) triangles: Option<u64>,
    pub(in crate::export) error_mm: Option<f64>,
}

/// How far a surface is from the one before, in mm, and how much of it was left out.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::export) struct Apart {
    pub(in crate::export) distance_mm: f64,
    /// Place of that distance; `None` where it was not measured.
    at: Option<[f32; 3]>,
    /// Root mean square distance from corners of the surface before; of a whole surface.
    rms_mm: Option<f64>,
    parts_gone: u64,
    pieces_gone: u64,
    /// True if the surface before encloses one body.
    was_one: bool,
}

/// A surface in memory; what is behind `slab` corners and triangles has not been reduced yet.
pub(in crate::export) struct Whole<'a> {
    pub(in crate::export) vertices: Vec<Vertex>,
    pub(in crate::export) faces: Vec<[u32; 3]>,
    slab: [usize; 2],
    /// Triangles of a slab.
    most: usize,
    /// Difference between a corner's number at the mesher and its number here.
    shift: u32,
    goal: Goal,
    voxel_mm: f64,
    progress: &'a dyn Progress,
    /// Greatest distance of a slab.
    slab_mm: Option<f64>,
}

impl Sink for Whole<'_> {
    fn layer(&mut self, first: u32) -> io::Result<()> {
        if self.faces.len() - self.slab[1] < self.most {
            return Ok(());
        }
        let next = self.vertices[first.wrapping_sub(self.shift) as usize..].to_vec();
        self.slab().map_err(|Stopped| io::ErrorKind::Interrupted)?;
        self.shift = first.wrapping_sub(number(self.vertices.len()));
        self.vertices.extend(next);
        Ok(())
    }

    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.vertices.push(*vertex);
        Ok(())
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.faces.push(corners.map(|corner| corner.wrapping_sub(self.shift)));
        Ok(())
    }
}

impl<'a> Whole<'a> {
    pub(in crate::export) fn new(goal: Goal, voxel_mm: f64, progress: &'a dyn Progress) -> Self {
        let (vertices, faces) = (Vec::new(), Vec::new());
        Self { vertices, faces, slab: [0; 2], most: SLAB, shift: 0, goal, voxel_mm, progress, slab_mm: None }
    }

    /// Makes the triangles fewer; `made`: what is known of the fine ones.
    pub(in crate::export) fn reduce(&mut self, made: Exported) -> Result<Exported, Stopped> {
        if self.slab_mm.is_some() {
            self.slab()?;
        }
        let slab_mm = self.slab_mm.unwrap_or_default();
        self.slab = [0; 2];
        let goal = Goal { error_mm: self.goal.error_mm.map(|mm| mm - slab_mm), ..self.goal };
        let Apart { distance_mm, at, rms_mm, parts_gone, pieces_gone, was_one } =
            self.reduced(goal, false)?;
        // The sum over two reductions, one of slabs and one of their union, is a bound.
        let (distance_mm, within_mm) = match self.slab_mm {
            Some(slab_mm) => (None, Some(distance_mm + slab_mm)),
            None => (Some(distance_mm), self.goal.error_mm),
        };
        Ok(Exported {
            vertices: self.vertices.len() as u64,
            triangles: self.faces.len() as u64,
            fine_triangles: made.triangles,
            distance_mm,
            distance_at: at.filter(|_| distance_mm.is_some()),
            within_mm,
            rms_mm: rms_mm.filter(|_| self.slab_mm.is_none()),
            parts_gone: Some(parts_gone),
            pieces_gone,
            was_one,
            ..made
        })
    }

    /// Makes the triangles of the slab fewer; edges of one triangle stay.
    fn slab(&mut self) -> Result<(), Stopped> {
        let mm = self.goal.error_mm.map_or(f64::INFINITY, |mm| OF_SLAB * mm);
        let mm = if self.goal.triangles.is_some() { mm.min(SLAB_VOXELS * self.voxel_mm) } else { mm };
        let apart = self.reduced(Goal { triangles: None, error_mm: Some(mm) }, true)?;
        self.slab_mm = Some(self.slab_mm.unwrap_or_default().max(apart.distance_mm));
        self.slab = [self.vertices.len(), self.faces.len()];
        Ok(())
    }

    fn reduced(&mut self, goal: Goal, is_open: bool) -> Result<Apart, Stopped> {
        let [first, faces] = self.slab;
        let start = number(first);
        let mut faces = self.faces.split_off(faces);
        faces.as_flattened_mut().iter_mut().for_each(|corner| *corner -= start);
        let places = self.vertices[first..].iter().map(|vertex| vertex.at).collect();
        let (few, apart) = reduce(Surface::new(places, faces), goal, is_open, self.voxel_mm, self.progress)?;
        let vertex =
            |(old, at): (&u32, &[f32; 3])| Vertex { at: *at, ..self.vertices[first + *old as usize] };
        let vertices: Vec<_> = few.olds.iter().zip(&few.at).map(vertex).collect();
        self.vertices.truncate(first);
        self.vertices.extend(vertices);
        self.faces.extend(few.faces.iter().map(|face| face.map(|corner| start + corner)));
        Ok(apart)
    }

    /// Hands on corners and triangles.
    pub(in crate::export) fn hand_on(&self, to: &mut dyn Sink) -> io::Result<()> {
        for vertex in &self.vertices {
            to.vertex(vertex)?;
        }
        for face in &self.faces {
            to.triangle(*face, face.map(|corner| self.vertices[corner as usize].at))?;
        }
        Ok(())
    }
}

/// Most corners whose distances make up the root mean square.
const OF_RMS: usize = 20_000;

/// Makes triangles fewer and moves their corners. `is_open`: true for a part of a surface, whose border stays, and which is
/// not repaired.
///
/// Memory: some 260 bytes a fine triangle.
pub(in crate::export) fn reduce(
    fine: Surface,
    goal: Goal,
    is_open: bool,
    voxel_mm: f64,
    progress: &dyn Progress,
) -> Result<(Surface, Apart), Stopped> {
    let wanted = goal.triangles.map_or(0, |count| usize::try_from(count).unwrap_or(usize::MAX)).max(LEAST);
    if wanted >= fine.faces.len() {
        return Ok((fine, Apart::default()));
    }
    let (parts, count) = fine.parts();
    let mut spans: Vec<_> = (0_u32..).zip(fine.spans(&parts, count)).collect();
    crate::order::by(&mut spans, |(_, (a, _)), (_, (b, _))| b.total_cmp(a));
    // Within a distance no part is left out.
    spans.truncate(if goal.error_mm.is_some() { count } else { (wanted / OF_PART).max(1) });
    let mut anchors = vec![None; count];
    let mut locks = vec![SimplifyVertex::empty(); fine.at.len()];
    for (part, (_, corners)) in spans {
        anchors[part as usize] = Some(corners);
        corners.iter().for_each(|corner| locks[*corner as usize] = SimplifyVertex::Lock);
    }
    let tree = Tree::new(if is_open { Vec::new() } else { fine.triangles().collect() });
    let size = fine.at.as_flattened().iter().fold(0.0_f32, |most, c| most.max(c.abs()));
    let step = goal.error_mm.map_or(f64::INFINITY, |mm| APART_OF_ERROR * mm).min(APART.0 * voxel_mm);
    let step = step.max(f64::from(APART.1 * size));
    let is_one =
        !is_open && fine.volumes(&parts, count).into_iter().filter(|volume| *volume > 0.0).count() == 1;
    let reducer = Reducer { fine, tree, parts, anchors, wanted, is_open, is_one, step, voxel_mm, progress };
    let found = match goal.error_mm {
        Some(mm) => reducer.within(mm, &locks)?,
        None => reducer.refined(&mut locks)?,
    };
    let Some(Fewer { mut surface, distance_mm, worst, pieces_gone }) = found else {
        return Ok((reducer.fine, Apart::default()));
    };
    let parts_gone = reducer.is_gone(&surface).into_iter().filter(|gone| *gone).count() as u64;
    let rms_mm = reducer.rms(&surface);
    surface.olds.iter_mut().for_each(|old| *old = reducer.fine.olds[*old as usize]);
    Ok((
        surface,
        Apart { distance_mm, at: worst.first().copied(), rms_mm, parts_gone, pieces_gone, was_one: is_one },
    ))
}

/// Hands over points of an item.
type Points<'p, T> = dyn Fn(&T, &mut dyn FnMut([f64; 3])) + Sync + 'p;

/// A surface of fewer triangles.
struct Fewer {
    surface: Surface,
    distance_mm: f64,
    /// Points where the distance is greatest, then where it is not much smaller, then corners of pieces left out.
    worst: Vec<[f32; 3]>,
    pieces_gone: u64,
}

struct Reducer<'a> {
    fine: Surface,
    tree: Tree,
    /// The part of each fine corner.
    parts: Vec<u32>,
    /// Corners of each part that stay; `None` if the part is left out.
    anchors: Vec<Option<[u32; 4]>>,
    wanted: usize,
    is_open: bool,
    /// True if the fine surface encloses one body.
    is_one: bool,
    /// By how many mm corners at one place are moved apart.
    step: f64,
    voxel_mm: f64,
    progress: &'a dyn Progress,
}

impl Reducer<'_> {
    /// Within a distance, or to the wanted number if that is reached before; `None` if no such surface is found.
    fn within(&self, mm: f64, locks: &[SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        let count = |fewer: &Fewer| fewer.surface.faces.len();
        let mut found = self.patched(mm, locks)?;
        if self.wanted <= LEAST {
            return Ok(found);
        }
        let start = self.start();
        for part in LIMITS {
            let Some(fewer) = self.reduced(&start, part * mm, mm, locks)? else { continue };
            if fewer.distance_mm > mm {
                continue;
            }
            let is_fewest = found.as_ref().is_none_or(|found| count(&fewer) < count(found));
            if is_fewest || count(&fewer) <= self.wanted {
                found = Some(fewer);
            }
            break;
        }
        Ok(found)
    }

    /// Within a distance, patch by patch; `None` if no such surface is found.
    fn patched(&self, mm: f64, locks: &[SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        let mut surface = self.start();
        for (shift, part) in PASSES {
            self.patches(&mut surface, shift, part * mm, locks);
            self.progress.check()?;
        }
        surface.compact();
        if self.is_open {
            return Ok(Some(Fewer { surface, distance_mm: mm, worst: Vec::new(), pieces_gone: 0 }));
        }
        if !surface.repair(self.step) {
            return Ok(None);
        }
        let (distance_mm, worst) = self.distance(&surface, mm)?;
        let fewer = Fewer { surface, distance_mm, worst, pieces_gone: 0 };
        Ok(Some(fewer).filter(|fewer| fewer.distance_mm <= mm))
    }

    /// All parts that are not left out, with the numbers of the fine surface.
    fn start(&self) -> Surface {
        let is_kept = |face: &&[u32; 3]| self.anchors[self.parts[face[0] as usize] as usize].is_some();
        let faces = self.fine.faces.iter().filter(is_kept).copied().collect();
        Surface { at: self.fine.at.clone(), faces, olds: (0..).take(self.fine.at.len()).collect() }
    }

    /// Makes the triangles of each patch fewer, within a distance; borders of patches stay. `shift`: of their
    /// borders, in sides.
    fn patches(&self, all: &mut Surface, shift: f64, mm: f64, locks: &[SimplifyVertex]) {
        let side = PATCH * self.voxel_mm;
        let mut patches: BTreeMap<_, Vec<[u32; 3]>> = BTreeMap::new();
        for face in &all.faces {
            #[expect(clippy::cast_possible_truncation, reason = "bounded by the model")]
            let place = all.at[face[0] as usize].map(|c| (f64::from(c) / side + shift).floor() as i64);
            patches.entry(place).or_default().push(*face);
        }
        let patches: Vec<_> = patches.into_values().collect();
        let fewer: Vec<_> = patches.par_iter().map(|faces| self.patch(all, faces, mm, locks)).collect();
        all.faces.clear();
        for Surface { at, faces, olds } in fewer {
            all.faces.extend(faces.iter().map(|face| face.map(|corner| olds[corner as usize])));
            olds.iter().zip(at).for_each(|(old, at)| all.at[*old as usize] = at);
        }
    }

    /// Some triangles made fewer within a distance.
    fn patch(&self, all: &Surface, faces: &[[u32; 3]], mm: f64, locks: &[SimplifyVertex]) -> Surface {
        let mut at = HashMap::new();
        let mut fine = Surface { at: Vec::new(), faces: faces.to_vec(), olds: Vec::new() };
        for corner in fine.faces.as_flattened_mut() {
            let old = *corner;
            *corner = *at.entry(old).or_insert_with(|| {
                fine.at.push(all.at[old as usize]);
                fine.olds.push(old);
                number(fine.at.len() - 1)
            });
        }
        let locks: Vec<_> = fine.olds.iter().map(|old| locks[*old as usize]).collect();
        let tree = Tree::new(fine.triangles().collect());
        let first = TRY * mm / self.voxel_mm;
        let powers = (0..TRIES).map(|k| first.log2().ceil() - f64::from(k + 1));
        for voxels in std::iter::once(first).chain(powers.map(f64::exp2)) {
            if self.progress.stopped() {
                break;
            }
            let mut few = fine.clone();
            few.collapse(0, voxels * self.voxel_mm, &locks);
            if few.faces.len() == fine.faces.len() {
                break;
            }
            few.compact();
            if self.is_near(&fine, &tree, &few, mm) {
                return few;
            }
        }
        fine
    }

    /// True if no measured point of either surface is farther than `mm` from the other.
    fn is_near(&self, fine: &Surface, tree: &Tree, few: &Surface, mm: f64) -> bool {
        let (square, mut seed) = (mm * mm, 0);
        let mut near = |tree: &Tree, p| tree.square(p, &mut seed, square) <= square;
        let is_few_near = few.at.iter().all(|at| near(tree, at.map(f64::from)))
            && few.faces.iter().all(|face| lattice(few, face, 0.5 * self.voxel_mm, |p| near(tree, p)));
        if !is_few_near {
            return false;
        }
        let few_tree = Tree::new(few.triangles().collect());
        fine.at.iter().all(|at| near(&few_tree, at.map(f64::from)))
            && fine.faces.iter().all(|face| near(&few_tree, middle(fine.corners(face))))
    }

    /// Keeps fine corners within `mm` of some places; true if some of them were not kept before.
    fn lock(start: &Surface, locks: &mut [SimplifyVertex], worst: &[[f32; 3]], mm: f64) -> bool {
        let places = Tree::new(worst.iter().map(|place| [*place; 3]).collect());
        let square = mm * mm;
        let is_near = |at: &[f32; 3]| places.square(at.map(f64::from), &mut 0, square) <= square;
        let near: Vec<bool> = start.at.par_iter().map(is_near).collect();
        let mut is_new = false;
        for (old, _) in start.olds.iter().zip(near).filter(|(_, near)| *near) {
            let lock = &mut locks[*old as usize];
            is_new |= !lock.contains(SimplifyVertex::Lock);
            *lock = SimplifyVertex::Lock;
        }
        is_new
    }

    /// As many triangles as are wanted, with fine corners at the places that would be farthest away.
    fn refined(&self, locks: &mut [SimplifyVertex]) -> Result<Option<Fewer>, Stopped> {
        let start = self.start();
        let Some(mut best) = self.reduced(&start, f64::INFINITY, 0.0, locks)? else { return Ok(None) };
        let (mut worst, mut distance_mm) = (best.worst.clone(), best.distance_mm);
        for _ in 0..REFINEMENTS {
            // A kept corner goes with its triangles where all of its neighbours become one.
            let neighbours_mm = 2.0 * distance_mm.max(self.voxel_mm);
            if !Self::lock(&start, locks, &worst, self.voxel_mm)
                && !Self::lock(&start, locks, &worst, neighbours_mm)
            {
                break;
            }
            let Some(next) = self.reduced(&start, f64::INFINITY, 0.0, locks)? else { break };
            worst.clone_from(&next.worst);
            distance_mm = next.distance_mm;
            let is_few = next.surface.faces.len() <= best.surface.faces.len().max(self.wanted);
            if is_few && next.distance_mm < best.distance_mm {
                best = next;
            }
        }
        Ok(Some(best))
    }

    /// With the metric below a limit in mm, and a distance that need not be exact below half of `mm`.
    fn reduced(
        &self,
        start: &Surface,
        limit: f64,
        mm: f64,
        locks: &[SimplifyVertex],
    ) -> Result<Option<Fewer>, Stopped> {
        self.progress.check()?;
        let Some(mut surface) = self.collapsed(start, limit, locks)? else { return Ok(None) };
        let (mut pieces_gone, mut gone) = (0, Vec::new());
        // Within a distance all pieces stay.
        if limit.is_infinite() {
            gone = surface.drop_fragments(&self.parts, THIN * self.step);
            if self.is_one {
                let (count, places) = surface.keep_body();
                pieces_gone = count;
                gone.extend(places);
            }
        }
        let (distance_mm, mut worst) = self.distance(&surface, mm)?;
        worst.extend(gone);
        Ok(Some(Fewer { surface, distance_mm, worst, pieces_gone }))
    }

    /// About so many triangles as are wanted, or as many as keep the metric below a limit in mm; `None` if none are left.
    fn collapsed(
        &self,
        start: &Surface,
        limit: f64,
        locks: &[SimplifyVertex],
    ) -> Result<Option<Surface>, Stopped> {
        let mut surface = start.clone();
        for round in 0..ROUNDS {
            let before = surface.faces.len();
            // Where so few triangles are not reached otherwise, parts may go.
            let is_last = round + 2 >= ROUNDS;
            let lock = |old: &u32| if is_last { SimplifyVertex::empty() } else { locks[*old as usize] };
            let locks: Vec<_> = surface.olds.iter().map(lock).collect();
            surface.collapse(self.wanted, limit, &locks);
            self.progress.check()?;
            // Sheets without thickness stay unless so few triangles are not reached with them.
            if limit.is_infinite() && round >= ROUNDS / 2 {
                surface.cancel();
            }
            let gone =
                self.is_gone(&surface).into_iter().zip(&self.anchors).filter(|(gone, _)| *gone && !is_last);
            gone.filter_map(|(_, anchors)| *anchors).for_each(|corners| surface.add(&self.fine, corners));
            if !surface.repair(self.step) {
                return Ok(None);
            }
            let count = surface.faces.len();
            if count <= self.wanted || limit.is_finite() || is_last && count == before {
                break;
            }
        }
        Ok(Some(surface))
    }

    /// For each part of the fine surface, true if `surface` lacks it.
    fn is_gone(&self, surface: &Surface) -> Vec<bool> {
        let mut is_gone = vec![true; self.anchors.len()];
        for [corner, ..] in &surface.faces {
            is_gone[self.parts[surface.olds[*corner as usize] as usize] as usize] = false;
        }
        is_gone
    }

    /// The greatest distance of a surface from the fine one, or of that one from it, and places of the fine one where it is so
    /// great, and then where it is not much smaller; below half of `mm` it may be too great.
    fn distance(&self, few: &Surface, mm: f64) -> Result<(f64, Vec<[f32; 3]>), Stopped> {
        let tree = Tree::new(few.triangles().collect());
        let far = Far { most: AtomicU64::new(0), least: 0.25 * mm * mm, progress: self.progress };
        let mut all = far.places(&self.fine.at, &tree, false, &|at, point| point(at.map(f64::from)));
        all.extend(far.places(&self.fine.faces, &tree, false, &|face, point| {
            point(middle(self.fine.corners(face)));
        }));
        all.extend(far.places(&few.at, &self.tree, true, &|at, point| point(at.map(f64::from))));
        all.extend(far.places(&few.faces, &self.tree, true, &|face, point| {
            lattice(few, face, 0.5 * self.voxel_mm, |p| {
                point(p);
                true
            });
        }));
        self.progress.check()?;
        let enough = far.enough();
        all.retain(|(square, _)| *square > enough);
        all.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        let most = f64::from_bits(far.most.into_inner());
        Ok((most.sqrt(), all.into_iter().map(|(_, at)| at).collect()))
    }

    /// Root mean square distance from corners of the fine surface to another one; `None` for a part of a surface.
    fn rms(&self, few: &Surface) -> Option<f64> {
        if self.is_open {
            return None;
        }
        let tree = Tree::new(few.triangles().collect());
        let (mut seed, mut sum, mut count) = (0, 0.0, 0.0);
        for at in self.fine.at.iter().step_by(self.fine.at.len().div_ceil(OF_RMS).max(1)) {
            sum += tree.square(at.map(f64::from), &mut seed, 0.0);
            count += 1.0;
        }
        (count > 0.0).then(|| (sum / count).sqrt())
    }
}

/// A search for the points that are farthest from a surface.
struct Far<'a> {
    /// The bits of the greatest squared distance so far.
    most: AtomicU64,
    /// Squared distance below which none need be exact.
    least: f64,
    progress: &'a dyn Progress,
}

impl Far<'_> {
    /// A squared distance below which none need be exact.
    fn enough(&self) -> f64 {
        self.least.max(WORST * WORST * f64::from_bits(self.most.load(Ordering::Relaxed)))
    }

    /// The point of each chunk of items that is farthest from a surface: its squared distance, and where it is, or `there`,
    /// about where the surface is nearest to it.
    #[expect(clippy::cast_possible_truncation, reason = "back to single precision")]
    fn places<T: Sync>(
        &self,
        items: &[T],
        from: &Tree,
        there: bool,
        points: &Points<'_, T>,
    ) -> Vec<(f64, [f32; 3])> {
        let chunks = items.par_chunks(CHUNK).map(|items| {
            let (mut seed, mut worst) = (0, (0.0, [0.0; 3]));
            if self.progress.stopped() {
                return worst;
            }
            let enough = self.enough();
            for item in items {
                points(item, &mut |p| {
                    let square = from.square(p, &mut seed, enough);
                    if square > worst.0 {
                        worst = (square, if there { from.middle(seed) } else { p.map(|c| c as f32) });
                    }
                });
            }
            self.most.fetch_max(worst.0.to_bits(), Ordering::Relaxed);
            worst
        });
        chunks.collect()
    }
}

fn middle([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0)
}

/// True if `holds` for the points of a triangle apart from its corners, in rows `step` mm apart or less, and as far from each
/// other. Points of an edge are those of the triangle that has it from the lesser corner to the other.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
fn lattice(surface: &Surface, face: &[u32; 3], step: f64, mut holds: impl FnMut([f64; 3]) -> bool) -> bool {
    let corners = surface.corners(face);
    let ways = [0, 1, 2].map(|k| add_scaled(corners[(k + 1) % 3], -1.0, corners[k]));
    let lengths = ways.map(|way| dot(way, way).sqrt());
    let longest = (0..3).max_by(|i, j| lengths[*i].total_cmp(&lengths[*j])).unwrap_or(0);
    let [along, aside] = [ways[longest], ways[(longest + 2) % 3].map(|c| -c)];
    // A flat triangle gives NaN here, which counts as one row.
    let parts = |length: f64| (length / step).ceil().clamp(1.0, MAX_POINTS).max(1.0) as u32;
    let mut within = |start: [f64; 3], way: [f64; 3], length: f64| {
        let count = parts(length);
        (1..count).all(|point| holds(add_scaled(start, f64::from(point) / f64::from(count), way)))
    };
    let rows = parts(dot(cross(along, aside), cross(along, aside)).sqrt() / lengths[longest]);
    (0..3).all(|k| face[k] > face[(k + 1) % 3] || within(corners[k], ways[k], lengths[k]))
        && (1..rows).all(|row| {
            let up = f64::from(row) / f64::from(rows);
            let start = add_scaled(corners[longest], up, aside);
            within(start, along.map(|c| (1.0 - up) * c), (1.0 - up) * lengths[longest])
        })
}

impl Surface {
    fn triangles(&self) -> impl Iterator<Item = [[f32; 3]; 3]> + '_ {
        self.faces.iter().map(|face| face.map(|corner| self.at[corner as usize]))
    }

    /// Collapses edges until so many triangles are left, or none below a limit of the metric in mm; sheets may touch then.
    fn collapse(&mut self, wanted: usize, limit: f64, locks: &[SimplifyVertex]) {
        #[expect(clippy::cast_possible_truncation, reason = "what it gives is measured")]
        let limit = limit.min(f64::from(f32::MAX)) as f32;
        let (target, options) =
            (3 * wanted.min(self.faces.len()), SimplifyOptions::ErrorAbsolute | SimplifyOptions::LockBorder);
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
    use super::*;
    use crate::export::Mesh;
    use crate::export::decimate::tree::Facet;
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
    fn slabs_are_reduced_by_themselves_and_then_together() {
        let fine = noise();
        let mut faces = fine.faces.clone();
        faces.sort_by_key(|face| face.iter().max().copied());
        let mut firsts: Vec<u32> = faces.iter().filter_map(|face| face.iter().min().copied()).collect();
        for at in (1..firsts.len()).rev() {
            firsts[at - 1] = firsts[at - 1].min(firsts[at]);
        }
        let goal = Goal { triangles: None, error_mm: Some(0.3) };
        let counts = [5000, usize::MAX].map(|most| {
            let mut whole = Whole { most, ..Whole::new(goal, 1.0, &Silent) };
            let mut vertices = fine.vertices.iter().map(|at| Vertex { at: *at, ..Vertex::default() });
            let mut count = 0;
            for (face, first) in faces.iter().zip(&firsts) {
                whole.layer(*first).unwrap();
                for vertex in vertices.by_ref().take((face.iter().max().unwrap() + 1 - count) as usize) {
                    whole.vertex(&vertex).unwrap();
                    count += 1;
                }
                whole.triangle(*face, [[0.0; 3]; 3]).unwrap();
            }
            let made = whole.reduce(Exported::default()).unwrap();
            assert_eq!((made.distance_mm.is_none(), made.parts_gone), (most < usize::MAX, Some(0)));
            assert!(made.distance_mm.or(made.within_mm) <= Some(0.3), "{made:?}");
            assert!(is_closed(&whole.faces));
            whole.faces.len()
        });
        assert!(counts.iter().all(|count| *count < fine.faces.len()), "{counts:?}");
    }

    #[test]
    fn one_body_stays_one_where_its_bridges_come_apart() {
        let Mesh { vertices, faces, .. } = noise();
        let mut fine = Surface::new(vertices, faces);
        let bodies = |surface: &Surface| {
            let (parts, count) = surface.parts();
            surface.volumes(&parts, count).into_iter().filter(|volume| *volume > 0.0).count()
        };
        let (gone, places) = fine.keep_body();
        assert!(gone > 100 && places.len() > 500 && bodies(&fine) == 1 && fine.faces.len() > 10_000);
        for wanted in [3000, 300] {
            let goal = Goal { triangles: Some(wanted), error_mm: None };
            let (few, apart) = reduce(fine.clone(), goal, false, 1.0, &Silent).unwrap();
            assert!(few.faces.len() as u64 <= wanted && few.faces.len() >= 4 && is_closed(&few.faces));
            assert!(bodies(&few) == 1 && apart.pieces_gone > 0 && apart.was_one, "{wanted}: {apart:?}");
        }
    }

    fn is_closed(faces: &[[u32; 3]]) -> bool {
        let edges: HashSet<_> =
            faces.iter().flat_map(|face| [0, 1, 2].map(|k| [face[k], face[(k + 1) % 3]])).collect();
        edges.len() == 3 * faces.len() && edges.iter().all(|[a, b]| edges.contains(&[*b, *a]))
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
            assert!(is_closed(&mesh.faces));
            for face in &mesh.faces {
                let [a, b, c] = face.map(|corner| place(&mesh, corner));
                let normal = cross(add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
                assert!(dot(normal, normal) > 0.0);
            }
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
