//! Extents, surface area and enclosed volume of a model, from its skin and normals alone.
//!
//! A model holds the skin: the inside voxels with an outside neighbour. What is neither skin nor reached from
//! without by steps through faces is enclosed: either deep inside, or a cavity. The normals of the skin around it
//! tell which, as they point out of the object.
//!
//! ```text
//!   octree --32 slices at a time--> skin of a slice, in rows --> runs between skin voxels --> components
//! ```
//!
//! Memory: the skin of 32 slices, and the runs of two. Cost: each node about once, and some 20 ns a run and a
//! skin voxel.

use crate::format::normal;
use crate::geom::{Affine, BoxIndex, Dims, Octant, VoxelIndex};
use crate::load::NodeView;
use crate::render::GridSpace;

/// Slices that are taken from the octree at a time: a power of two.
const SLAB: u32 = 32;

/// A component is deep inside, or outside, if the normals around it agree to this much: the sum of their parts
/// towards it against that of the sizes of these. Around a cavity in a wall one voxel thick they cancel.
const AGREE: f64 = 0.3;

/// The error of an area is what normals this far off would make of it, all to the same side (3 degrees).
const NORMAL_ERROR_RAD: f64 = 0.052;

/// What was measured. Lengths are in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// First voxel of the skin along each axis, and the one after the last.
    pub voxels: [[u32; 3]; 2],
    /// Least and greatest coordinate (LPS) of the skin's voxels, to within 1/2048 of the grid and never too tight.
    pub box_mm: [[f64; 3]; 2],
    /// Area of the skin, walls of enclosed cavities included, with its error; a sheet one voxel thick counts
    /// once. `None` without normals.
    pub area_mm2: Option<(f64, f64)>,
    /// Volume of the skin's voxels and of what is deep inside, with its error. `None` where the normals do not
    /// tell what is inside: there are none, or walls are one voxel thick.
    pub volume_mm3: Option<(f64, f64)>,
    /// Voxels that are deep inside, in enclosed cavities, and neither for sure.
    pub enclosed: Enclosed,
}

/// Voxels that the skin encloses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Enclosed {
    /// Inside the object.
    pub inside: u64,
    /// In cavities.
    pub cavities: u64,
    /// The normals around contradict each other, or there are none.
    pub unknown: u64,
}

/// Measures a model; `None` for one without a voxel, without a volume, or damaged.
pub fn measure<V: NodeView>(view: &V, dims: Dims, affine: &Affine) -> Option<Measures> {
    let space = GridSpace::new(dims, affine).ok()?;
    let reach = |axis: usize, sign: f64| {
        let mut direction = [0.0; 3];
        direction[axis] = sign;
        sign * space.support(view, direction)
    };
    let box_mm = [-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign)));
    let voxels = extent(view)?;
    let weights = Weights::new(affine, &space, view.cells().is_some());
    let mut sweep = Sweep::new(voxels);
    let mut slab = Slab::default();
    let mut area = Area::default();
    let mut seen = 0;
    let has_normals = view.voxel_normal(VoxelIndex::new(0)).is_some();
    sweep.slice(&[], &weights);
    for first in (voxels[0][2] / SLAB * SLAB..voxels[1][2]).step_by(SLAB as usize) {
        slab.fill(view, first)?;
        for (z, skin) in (first..).zip(&mut slab.slices) {
            if !(voxels[0][2]..voxels[1][2]).contains(&z) {
                continue;
            }
            skin.sort_unstable();
            seen += skin.len() as u64;
            if seen > view.voxel_count() {
                return None;
            }
            if has_normals {
                skin.iter().for_each(|cell| area.add(&weights, cell.code()));
            }
            sweep.slice(skin, &weights);
        }
    }
    sweep.slice(&[], &weights);
    let enclosed = sweep.finish();
    let (skin, each) = (count(seen), weights.voxel_mm3);
    let unknown = count(enclosed.unknown) / 2.0;
    // A surface of voxels lies on the outside of these, one of cells within them.
    let of_skin = if weights.cells { skin / 2.0 } else { skin };
    let volume = (of_skin + count(enclosed.inside) + unknown) * each;
    let error = (skin / 2.0 + unknown) * each;
    // Half of it unknown is not known.
    let known = has_normals && unknown <= 0.1 * (skin + count(enclosed.inside));
    Some(Measures {
        voxels,
        box_mm,
        area_mm2: has_normals.then_some((area.sum, area.error)),
        volume_mm3: known.then_some((volume, error)),
        enclosed,
    })
}

#[expect(clippy::cast_precision_loss, reason = "counts are below 2^48")]
fn count(voxels: u64) -> f64 {
    voxels as f64
}

/// First voxel along each axis, and the one after the last.
fn extent<V: NodeView>(view: &V) -> Option<[[u32; 3]; 2]> {
    let mut found = [[0; 3]; 2];
    for axis in 0..3 {
        found[0][axis] = reach(view, axis, false)?;
        found[1][axis] = reach(view, axis, true)? + 1;
    }
    Some(found)
}

/// The least or greatest coordinate of a voxel along an axis. Visits the nodes of the side that is looked for
/// first, and others only where these end before.
fn reach<V: NodeView>(view: &V, axis: usize, high: bool) -> Option<u32> {
    let mut best: Option<u32> = None;
    let mut waiting = vec![(BoxIndex::ROOT, 0_u32, view.depth())];
    let mut visits = 0_u64;
    while let Some((number, low, level)) = waiting.pop() {
        let edge = 1_u32 << level;
        let most = if high { low + edge - 1 } else { low };
        if best.is_some_and(|best| if high { most <= best } else { most >= best }) {
            continue;
        }
        if level == 0 {
            best = Some(low);
            continue;
        }
        visits += 1;
        if visits > view.node_count() {
            return None;
        }
        for farther in [true, false] {
            // The side that is looked for is put last, and taken first.
            for octant in Octant::ALL {
                let upper = octant.high()[axis] == 1;
                if (upper == high) != farther
                    && let Some(child) = view.child(number.node(), octant)
                {
                    waiting.push((child, low + u32::from(upper) * edge / 2, level - 1));
                }
            }
        }
    }
    best
}

/// A skin voxel of a slice: y, x and the code of its normal; ordered by rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Cell(u64);

impl Cell {
    fn new(x: u32, y: u32, code: u16) -> Self {
        Self(u64::from(y) << 32 | u64::from(x) << 16 | u64::from(code))
    }

    #[expect(clippy::cast_possible_truncation, reason = "fields of 32, 16 and 16 bits")]
    fn parts(self) -> (u32, u32, u16) {
        ((self.0 >> 16) as u32 & 0xffff, (self.0 >> 32) as u32, self.0 as u16)
    }

    fn code(self) -> u16 {
        self.parts().2
    }
}

/// The skin of some slices.
#[derive(Default)]
struct Slab {
    slices: [Vec<Cell>; SLAB as usize],
}

impl Slab {
    /// Takes the slices from `first` on out of the octree; `None` where that visits more nodes than there are.
    fn fill<V: NodeView>(&mut self, view: &V, first: u32) -> Option<()> {
        self.slices.iter_mut().for_each(Vec::clear);
        let mut left = view.node_count() + 1;
        self.descend(view, BoxIndex::ROOT, [0; 3], view.depth(), first, &mut left)
    }

    fn descend<V: NodeView>(
        &mut self,
        view: &V,
        number: BoxIndex,
        low: [u32; 3],
        level: u32,
        first: u32,
        left: &mut u64,
    ) -> Option<()> {
        if level == 0 {
            let code = view.voxel_normal(number.voxel(view.node_count())).unwrap_or(0);
            let slice = self.slices.get_mut((low[2] - first) as usize)?;
            slice.push(Cell::new(low[0], low[1], code));
            return Some(());
        }
        *left = left.checked_sub(1)?;
        let infobyte = view.infobyte(number.node());
        let child = view.first_child(number.node());
        let half = 1_u32 << (level - 1);
        for octant in Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)) {
            let high = octant.high();
            let at: [u32; 3] = std::array::from_fn(|a| low[a] + high[a] * half);
            if at[2] < first + SLAB && at[2] + half > first {
                self.descend(view, child.after(octant.rank_in(infobyte)), at, level - 1, first, left)?;
            }
        }
        Some(())
    }
}

/// What a voxel, or a cell, counts for.
struct Weights {
    /// Are the boxes cells? Then normals are of index space.
    cells: bool,
    voxel_mm3: f64,
    columns: [[f64; 3]; 3],
    space: GridSpace,
    spacing_mm: [f64; 3],
}

impl Weights {
    fn new(affine: &Affine, space: &GridSpace, cells: bool) -> Self {
        Self {
            cells,
            voxel_mm3: affine.determinant().abs(),
            columns: [0, 1, 2].map(|axis| affine.column(axis)),
            space: space.clone(),
            spacing_mm: affine.spacing_mm(),
        }
    }

    /// A normal in voxels instead of millimetres, its components scaled to a sum of sizes of 1; zeros for none.
    fn in_voxels(&self, code: u16) -> [f64; 3] {
        let n = normal::decode_l1(code).map(f64::from);
        let scale = |a: usize| if self.cells { 1.0 } else { self.spacing_mm[a] };
        let n: [f64; 3] = std::array::from_fn(|a| n[a] * scale(a));
        let size = n.iter().map(|c| c.abs()).sum::<f64>();
        if size > 0.0 && size.is_finite() { n.map(|c| c / size) } else { [0.0; 3] }
    }
}

/// Area of the skin so far.
///
/// The skin of a surface has one voxel in each column along the axis that its normal is nearest to, counted in
/// voxels. The part of the surface in that column is the voxel's volume over its normal's part along that axis.
/// Of cells, which are all boxes that the surface passes through, a column has as many as the sum of the parts along
/// the axes over the greatest.
#[derive(Default)]
struct Area {
    sum: f64,
    error: f64,
}

impl Area {
    fn add(&mut self, weights: &Weights, code: u16) {
        let n = normal::decode_l1(code).map(f64::from);
        let n = if weights.cells {
            weights.space.index_normal_to_world(n)
        } else {
            weights.space.normal_to_world(n)
        };
        let along = weights.columns.map(|c| (n[0] * c[0] + n[1] * c[1] + n[2] * c[2]).abs());
        let axis = (0..3).fold(0, |best, a| if along[a] > along[best] { a } else { best });
        let c = weights.columns[axis];
        let length = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt();
        if along[axis] <= 0.0 || along[axis].is_nan() {
            return;
        }
        let across = if weights.cells { along.iter().sum() } else { along[axis] };
        let part = weights.voxel_mm3 / across;
        let cosine = (along[axis] / length).min(1.0);
        self.sum += part;
        self.error += part * NORMAL_ERROR_RAD * (1.0 - cosine * cosine).sqrt() / cosine;
    }
}

/// Voxels between two skin voxels of a row, or between one and the border: from `start` up to `end`.
#[derive(Clone, Copy, Debug)]
struct Run {
    start: u32,
    end: u32,
    component: u32,
}

/// One slice: skin and runs, row by row, in coordinates from one voxel before the first skin voxel on.
#[derive(Default)]
struct Slice {
    skin: Vec<(u32, [f32; 3])>,
    skin_rows: Vec<u32>,
    runs: Vec<Run>,
    run_rows: Vec<u32>,
}

impl Slice {
    fn skin_of(&self, row: usize) -> &[(u32, [f32; 3])] {
        within(&self.skin, &self.skin_rows, row)
    }

    fn runs_of(&self, row: usize) -> &[Run] {
        within(&self.runs, &self.run_rows, row)
    }
}

fn within<'a, T>(all: &'a [T], rows: &[u32], row: usize) -> &'a [T] {
    match (rows.get(row), rows.get(row + 1)) {
        (Some(from), Some(to)) => all.get(*from as usize..*to as usize).unwrap_or_default(),
        _ => &[],
    }
}

/// Connected voxels that are not skin.
#[derive(Clone, Copy, Debug, Default)]
struct Component {
    /// The component that it was joined with, or itself.
    parent: u32,
    outer: bool,
    voxels: u64,
    /// Sum of the parts of the normals around it towards it, and of the sizes of these.
    toward: f64,
    size: f64,
}

/// Follows the components from slice to slice; of those that end, only the numbers of voxels stay.
struct Sweep {
    low: [u32; 2],
    width: u32,
    height: usize,
    before: Slice,
    components: Vec<Component>,
    found: Enclosed,
    begun: bool,
}

impl Sweep {
    fn new([low, end]: [[u32; 3]; 2]) -> Self {
        Self {
            low: [low[0], low[1]],
            width: end[0] - low[0] + 2,
            height: (end[1] - low[1] + 2) as usize,
            before: Slice::default(),
            components: Vec::new(),
            found: Enclosed::default(),
            begun: false,
        }
    }

    /// Takes the next slice, its skin in rows.
    fn slice(&mut self, skin: &[Cell], weights: &Weights) {
        let mut slice = Slice::default();
        let mut cells = skin.iter().copied().peekable();
        for row in 0..self.height {
            slice.skin_rows.push(index(slice.skin.len()));
            slice.run_rows.push(index(slice.runs.len()));
            let first = slice.runs.len();
            let mut start = 0;
            while let Some((x, y, code)) = cells.peek().map(|cell| cell.parts()) {
                if (y - self.low[1] + 1) as usize != row {
                    break;
                }
                cells.next();
                let x = x - self.low[0] + 1;
                if x > start {
                    slice.runs.push(Run { start, end: x, component: 0 });
                }
                start = x + 1;
                #[expect(clippy::cast_possible_truncation, reason = "parts of a direction")]
                slice.skin.push((x, weights.in_voxels(code).map(|c| c as f32)));
            }
            if start < self.width {
                slice.runs.push(Run { start, end: self.width, component: 0 });
            }
            self.connect(&mut slice, row, first);
        }
        slice.skin_rows.push(index(slice.skin.len()));
        slice.run_rows.push(index(slice.runs.len()));
        self.vote(&slice);
        self.settle(&mut slice);
        self.before = slice;
        self.begun = true;
    }

    /// Gives the runs of a row, from run `first` on, their components: those that they touch.
    fn connect(&mut self, slice: &mut Slice, row: usize, first: usize) {
        let (known, new) = slice.runs.split_at_mut(first);
        let above = match row {
            0 => &[][..],
            _ => known.get(slice.run_rows[row - 1] as usize..).unwrap_or_default(),
        };
        let behind = self.before.runs_of(row);
        let (mut a, mut b) = (0, 0);
        for run in new {
            let mut component = None;
            for (others, at) in [(above, &mut a), (behind, &mut b)] {
                while others.get(*at).is_some_and(|other| other.end <= run.start) {
                    *at += 1;
                }
                for other in others[*at..].iter().take_while(|other| other.start < run.end) {
                    component = Some(match component {
                        None => root(&mut self.components, other.component),
                        Some(known) => join(&mut self.components, known, other.component),
                    });
                }
            }
            let component = component.unwrap_or_else(|| {
                let new = index(self.components.len());
                let outer = !self.begun;
                self.components.push(Component { parent: new, outer, ..Component::default() });
                new
            });
            run.component = component;
            if let Some(found) = self.components.get_mut(component as usize) {
                found.voxels += u64::from(run.end - run.start);
            }
        }
    }

    /// Adds the parts of normals towards the runs beside them.
    fn vote(&mut self, slice: &Slice) {
        for row in 0..self.height {
            let (skin, runs) = (slice.skin_of(row), slice.runs_of(row));
            let mut at = 0;
            for (x, n) in skin {
                while runs.get(at).is_some_and(|run| run.end < *x) {
                    at += 1;
                }
                if let Some(run) = runs.get(at).filter(|run| run.end == *x) {
                    tell(&mut self.components, run.component, -n[0]);
                    at += 1;
                }
                if let Some(run) = runs.get(at).filter(|run| run.start == x + 1) {
                    tell(&mut self.components, run.component, n[0]);
                }
            }
            if row > 0 {
                tell_all(&mut self.components, skin, slice.runs_of(row - 1), |n| -n[1]);
                tell_all(&mut self.components, slice.skin_of(row - 1), runs, |n| n[1]);
            }
            tell_all(&mut self.components, skin, self.before.runs_of(row), |n| -n[2]);
            tell_all(&mut self.components, self.before.skin_of(row), runs, |n| n[2]);
        }
    }

    /// Numbers the components of the slice anew and counts those that do not reach it.
    fn settle(&mut self, slice: &mut Slice) {
        let mut names = vec![u32::MAX; self.components.len()];
        let mut kept: Vec<Component> = Vec::new();
        for run in &mut slice.runs {
            let root = root(&mut self.components, run.component) as usize;
            if names[root] == u32::MAX {
                names[root] = index(kept.len());
                kept.push(Component { parent: index(kept.len()), ..self.components[root] });
            }
            run.component = names[root];
        }
        for (at, component) in self.components.iter().enumerate() {
            if names[at] == u32::MAX && component.parent as usize == at {
                self.found.add(component);
            }
        }
        self.components = kept;
    }

    fn finish(mut self) -> Enclosed {
        for (at, component) in self.components.iter().enumerate() {
            if component.parent as usize == at {
                self.found.add(component);
            }
        }
        self.found
    }
}

impl Enclosed {
    fn add(&mut self, component: &Component) {
        if component.outer {
            return;
        }
        if component.toward > AGREE * component.size {
            self.cavities += component.voxels;
        } else if component.toward < -AGREE * component.size {
            self.inside += component.voxels;
        } else {
            self.unknown += component.voxels;
        }
    }
}

/// Numbers of runs and components of one slice; a slice has at most 2^32 voxels, and runs lie between others.
fn index(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

fn root(components: &mut [Component], mut at: u32) -> u32 {
    while let Some(parent) = components.get(at as usize).map(|c| c.parent).filter(|parent| *parent != at) {
        // Halving the path keeps it short.
        let above = components.get(parent as usize).map_or(parent, |c| c.parent);
        if let Some(component) = components.get_mut(at as usize) {
            component.parent = above;
        }
        at = parent;
    }
    at
}

/// Joins two components; the lower number stays.
fn join(components: &mut [Component], a: u32, b: u32) -> u32 {
    let (a, b) = (root(components, a), root(components, b));
    let (to, from) = (a.min(b), a.max(b));
    if to != from
        && let Some(part) = components.get(from as usize).copied()
        && let Some(whole) = components.get_mut(to as usize)
    {
        whole.outer |= part.outer;
        whole.voxels += part.voxels;
        whole.toward += part.toward;
        whole.size += part.size;
        components[from as usize].parent = to;
    }
    to
}

fn tell(components: &mut [Component], component: u32, toward: f32) {
    let at = root(components, component);
    if let Some(component) = components.get_mut(at as usize) {
        component.toward += f64::from(toward);
        component.size += f64::from(toward.abs());
    }
}

/// Tells the runs beside a row of skin what its normals say.
fn tell_all(
    components: &mut [Component],
    skin: &[(u32, [f32; 3])],
    runs: &[Run],
    part: impl Fn(&[f32; 3]) -> f32,
) {
    let mut at = 0;
    for (x, n) in skin {
        while runs.get(at).is_some_and(|run| run.end <= *x) {
            at += 1;
        }
        if let Some(run) = runs.get(at).filter(|run| run.start <= *x) {
            tell(components, run.component, part(n));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::morton;
    use crate::load::MemoryTree;

    /// The skin of a set of voxels, with the normals of a field where there is one.
    fn skin(
        side: u32,
        inside: impl Fn([i32; 3]) -> bool,
        outward: Option<&dyn Fn([f64; 3]) -> [f64; 3]>,
    ) -> (MemoryTree, u64) {
        let mut codes = Vec::new();
        let mut voxels = 0;
        let end = side.cast_signed();
        for z in 0..end {
            for y in 0..end {
                for x in 0..end {
                    if !inside([x, y, z]) {
                        continue;
                    }
                    voxels += 1;
                    let beside = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
                    if beside.iter().any(|d| !inside([x + d[0], y + d[1], z + d[2]])) {
                        codes.push(morton::encode(x.cast_unsigned(), y.cast_unsigned(), z.cast_unsigned()));
                    }
                }
            }
        }
        codes.sort_unstable();
        let tree = MemoryTree::new(Dims::new(side, side, side).unwrap(), &codes).unwrap();
        #[expect(clippy::cast_possible_truncation, reason = "directions")]
        let tree = match outward {
            None => tree,
            Some(outward) => {
                let code =
                    |m: &u64| normal::encode(outward(morton::decode(*m).map(f64::from)).map(|c| c as f32));
                tree.with_normals(codes.iter().map(code).collect()).unwrap()
            }
        };
        (tree, voxels)
    }

    fn radius(p: [f64; 3], middle: f64) -> f64 {
        p.iter().map(|c| (c - middle) * (c - middle)).sum::<f64>().sqrt()
    }

    #[test]
    fn a_ball_has_its_volume_and_area() {
        let (r, c) = (30.0, 35.0);
        let (tree, voxels) = skin(72, |p| radius(p.map(f64::from), c) <= r, Some(&|p| p.map(|v| v - c)));
        let affine = Affine::from_spacing([0.5; 3]);
        let found = measure(&tree, Dims::new(72, 72, 72).unwrap(), &affine).unwrap();
        assert_eq!(found.enclosed.inside + tree.voxel_count(), voxels);
        assert_eq!((found.enclosed.cavities, found.enclosed.unknown), (0, 0));
        let (volume, error) = found.volume_mm3.unwrap();
        let true_volume = 4.0 / 3.0 * std::f64::consts::PI * 15.0_f64.powi(3);
        assert!((volume - true_volume).abs() < 0.01 * true_volume && error < 0.06 * true_volume, "{volume}");
        let (area, error) = found.area_mm2.unwrap();
        let true_area = 4.0 * std::f64::consts::PI * 15.0 * 15.0;
        assert!((area - true_area).abs() < error && error < 0.05 * true_area, "{area} {true_area} {error}");
        assert_eq!(found.voxels, [[5; 3], [66; 3]]);
        assert!(found.box_mm[0].iter().all(|v| (v - 2.25).abs() < 0.1), "{:?}", found.box_mm);
        assert!(found.box_mm[1].iter().all(|v| (v - 32.75).abs() < 0.1), "{:?}", found.box_mm);
    }

    #[test]
    fn cavities_are_told_from_what_is_inside_by_the_normals() {
        let (c, wall) = (24.0, |d: f64| (14.0..=21.0).contains(&d));
        let outward = |p: [f64; 3]| {
            let side = if radius(p, c) > 17.5 { 1.0 } else { -1.0 };
            p.map(|v| (v - c) * side)
        };
        let shape = |p: [i32; 3]| wall(radius(p.map(f64::from), c));
        let dims = Dims::new(48, 48, 48).unwrap();
        let (tree, voxels) = skin(48, shape, Some(&outward));
        let found = measure(&tree, dims, &Affine::from_spacing([1.0; 3])).unwrap();
        assert_eq!(found.enclosed.inside + tree.voxel_count(), voxels);
        let cavity =
            (0..48_i32.pow(3)).filter(|i| radius([i % 48, i / 48 % 48, i / 2304].map(f64::from), c) < 14.0);
        assert_eq!(found.enclosed.cavities, cavity.count() as u64);
        // Without normals nobody knows.
        let (bare, _) = skin(48, shape, None);
        let unknown = measure(&bare, dims, &Affine::from_spacing([1.0; 3])).unwrap();
        assert_eq!((unknown.volume_mm3, unknown.area_mm2), (None, None));
        assert_eq!(unknown.enclosed.unknown, found.enclosed.inside + found.enclosed.cavities);
    }

    #[test]
    fn walls_of_one_voxel_do_not_say_what_is_inside() {
        let c = 24.0;
        // The normals of such a wall are to one side as often as to the other.
        let outward = |p: [f64; 3]| {
            let side = if (p[0] + p[1] + p[2]) % 2.0 == 0.0 { 1.0 } else { -1.0 };
            p.map(|v| (v - c) * side)
        };
        let shape = |p: [i32; 3]| (20.0..20.9).contains(&radius(p.map(f64::from), c));
        let (tree, _) = skin(48, shape, Some(&outward));
        let found = measure(&tree, Dims::new(48, 48, 48).unwrap(), &Affine::from_spacing([1.0; 3])).unwrap();
        assert!(found.volume_mm3.is_none() && found.area_mm2.is_some(), "{found:?}");
    }

    #[test]
    fn sheared_and_uneven_grids_have_the_same_area() {
        // A plate of 40 x 40 x 8 voxels under a gantry tilt: its faces are known.
        let affine = Affine { rows: [[0.5, 0.0, 0.0, 9.0], [0.0, 0.5, 1.0, -3.0], [0.0, 0.0, 2.0, 7.0]] };
        let inside = |p: [i32; 3]| p.iter().zip([40, 40, 8]).all(|(c, n)| (4..4 + n).contains(c));
        let outward = |p: [f64; 3]| {
            let from: [f64; 3] = std::array::from_fn(|a| p[a] - 4.0 - [39.0, 39.0, 7.0][a] / 2.0);
            let near: [f64; 3] = std::array::from_fn(|a| from[a].abs() - [39.0, 39.0, 7.0][a] / 2.0);
            let axis = (0..3).fold(2, |best, a| if near[a] > near[best] { a } else { best });
            std::array::from_fn(|a| if a == axis { from[a].signum() } else { 0.0 })
        };
        let (tree, voxels) = skin(48, inside, Some(&outward));
        let found = measure(&tree, Dims::new(48, 48, 48).unwrap(), &affine).unwrap();
        let (volume, _) = found.volume_mm3.unwrap();
        assert!((volume - count(voxels) * 0.5).abs() < 1e-9 && voxels == 40 * 40 * 8, "{volume}");
        // Two faces of 20 x 20 mm, two of 20 mm by the slant of 8 slices, two upright ones; edges count once.
        let slant = 5.0_f64.sqrt();
        let faces = 2.0 * (20.0 * 20.0 + 20.0 * 8.0 * slant + 20.0 * 16.0);
        let (area, _) = found.area_mm2.unwrap();
        assert!((area - faces).abs() < 0.12 * faces, "{area} {faces}");
    }

    #[test]
    fn an_empty_model_has_no_measures() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let one = MemoryTree::new(dims, &[morton::encode(3, 4, 5)]).unwrap();
        let found = measure(&one, dims, &Affine::from_spacing([1.0; 3])).unwrap();
        assert_eq!(found.voxels, [[3, 4, 5], [4, 5, 6]]);
        assert_eq!(found.enclosed, Enclosed::default());
    }
}
