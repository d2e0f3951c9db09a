//! Extents, surface area and enclosed volume of a model, from its surface and normals alone.
//!
//! | | volume | area |
//! |---|---|---|
//! | skin | voxels inside, each of them whole | a voxel for each column that the surface crosses |
//! | cells | voxels inside, and the enclosed part of each cell | the same, over the number of cells in a column |
//!
//! Corrections for bends and edges are estimated from neighbours' normals (`Bends`). Errors come from an experiment:
//! 660 balls, tori, cylinders and boxes of 32 to 128 voxels a side, anywhere and turned anyhow, and along the axes.
//! More than 19 of 20 true values lie within them. At 128 voxels a side, errors of volumes of cells are 0.02 % of a
//! ball and up to half a percent of others (0.6 % of thin boxes). Cells of a mask, whose samples have two values, have
//! their planes too far in where it bends, by the smoothing over 5 samples: 1.4 voxels over the radius of a ball, so that the
//! volume of one of 54 voxels lacks 0.6 %, more than its error.
//!
//! Memory: the skin of 32 slices, and the runs and normals of two. Cost: each node about once, and some 20 ns a run,
//! 50 ns a skin voxel and half a microsecond a cell.

mod labels;

pub use labels::LabelMeasures;
pub(super) use labels::{areas as wall_areas, label_volume_error, measure_labels};

use super::cell_volume::CellVolume;
use crate::format::{Metadata, normal};
use crate::geom::{Affine, Dims, VoxelIndex, dot};
pub use crate::interior::Enclosed;
use crate::interior::{Outward, SkinSlices, Sweep, extent};
use crate::load::{ModelView, NodeView};
use crate::progress::{Progress, Silent};
use crate::render::GridSpace;

/// Neighbours whose normals are at least 30 degrees apart (as a cosine) lie at an edge.
const EDGE: f64 = 0.866;
/// At more than 120 degrees they are the two sides of a thin wall.
const WALL: f64 = -0.5;

/// Ratio of the longest to the shortest voxel side beyond which normals say too little.
const MAX_UNEVEN: f64 = 100.0;

/// True if voxels are so long along one axis that normals say too little.
fn are_uneven(affine: &Affine) -> bool {
    let [least, most] =
        affine.spacing_mm().iter().fold([f64::INFINITY, 0.0], |[a, b], v| [v.min(a), v.max(b)]);
    most > MAX_UNEVEN * least
}

/// Measures of a model, in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// First voxel of the skin along each axis, and the one after the last.
    pub voxels: [[u32; 3]; 2],
    /// Least and greatest coordinate (LPS) of the surface: of the skin's voxels, of the part of cells that is inside or
    /// has a label. Beyond 2048 voxels a side it is taken from boxes 1/2048 of the grid wide, so it is never too tight.
    pub box_mm: [[f64; 3]; 2],
    /// Area of the skin, walls of enclosed cavities included, with its error; a sheet one voxel thick counts once.
    /// `None` without normals, and for voxels that are too uneven.
    pub area_mm2: Option<(f64, f64)>,
    /// Volume of the skin's voxels and of the deep inside, with its error. `None` where the normals do not tell the
    /// inside: there are none, walls are one voxel thick, only a part was kept, or voxels are too uneven.
    pub volume_mm3: Option<(f64, f64)>,
    /// True if voxels are more than 100 times as long along one axis as along another.
    pub is_uneven: bool,
    /// True if the model keeps only what can be seen from somewhere.
    pub is_part: bool,
    /// Voxels deep inside, in enclosed cavities, and undecided between the two.
    pub enclosed: Enclosed,
}

impl Measures {
    /// The measures with the error of larger leaves, which lie off the surface.
    #[must_use]
    pub(crate) fn with_leaves(mut self, metadata: &Metadata) -> Self {
        if let (Some(found), Some((area, _)), Some((_, error))) =
            (metadata.error, self.area_mm2, &mut self.volume_mm3)
        {
            let finest = metadata.spacing_mm.into_iter().fold(f64::INFINITY, f64::min);
            *error += found.rms * finest * area;
        }
        self
    }
}

/// Measures a model; `None` for one without a voxel, without a volume, or damaged. `is_part` is set if it keeps only
/// what can be seen from somewhere.
pub fn measure(view: &ModelView<'_>, dims: Dims, affine: &Affine, is_part: bool) -> Option<Measures> {
    measure_until(view, dims, affine, is_part, &Silent)
}

/// [`measure`]; `None` as well once `progress` stops it.
pub(super) fn measure_until(
    view: &ModelView<'_>,
    dims: Dims,
    affine: &Affine,
    is_part: bool,
    progress: &dyn Progress,
) -> Option<Measures> {
    let space = GridSpace::new(dims, affine).ok()?;
    let voxels = extent(view)?;
    let box_mm = bounds_mm(view, &space);
    let cells = view.cells().is_some();
    let weights = Weights::new(affine, &space, cells);
    let mut sweep = Sweep::new(voxels, Outward::new(cells, affine.spacing_mm()));
    let mut slices = SkinSlices::new(view, voxels);
    let (mut bends, mut facets) = (Bends::new(1, EDGE), Facets([0; _]));
    let (mut seen, mut area, mut area_within, mut of_skin) = (0, 0.0, 0.0, 0.0);
    let has_normals = cells || view.voxel_normal(VoxelIndex::new(0)).is_some();
    sweep.slice(view, &[]);
    for z in voxels[0][2]..voxels[1][2] {
        progress.check().ok()?;
        let skin = slices.slice(z)?;
        seen += skin.iter().filter(|voxel| voxel.is_surface()).count() as u64;
        bends.begin();
        for voxel in skin {
            if let (Some(leaf), false) = (voxel.leaf, voxel.is_surface()) {
                of_skin += f64::from(u8::from(leaf.offset > 0));
                continue;
            }
            let within = view.cells().map(|cells| CellVolume::of(&voxel.shape(&cells), &weights.columns));
            of_skin += within.map_or(1.0, |within| within.inside);
            area_within += within.map_or(0.0, |within| within.area);
            let code = voxel.code(view);
            if let Some(patch) = code.and_then(|code| weights.patch(code, within, [voxel.y, voxel.x])) {
                area += patch.part;
                facets.add(&patch);
                bends.now.push(patch);
            }
        }
        bends.end(&weights);
        sweep.slice(view, skin);
    }
    sweep.slice(view, &[]);
    let (enclosed, _) = sweep.finish();
    let (skin, inside, unknown) = (seen as f64, enclosed.inside as f64, enclosed.unknown as f64 / 2.0);
    let (lacking, error) =
        if cells { bends.volume(area / weights.voxel_mm3) } else { (0.0, facets.volume_error()) };
    let volume = of_skin + lacking + inside + unknown;
    // No volume where the normals leave too many voxels undecided.
    let known = has_normals && !is_part && unknown <= 0.1 * (skin + inside);
    let is_uneven = are_uneven(affine);
    let (lacking_mm2, error_mm2) = bends.area(cells.then_some(area_within), area);
    Some(Measures {
        voxels,
        box_mm,
        area_mm2: (has_normals && !is_uneven).then_some((area + lacking_mm2, error_mm2)),
        volume_mm3: (known && !is_uneven)
            .then(|| [volume, error + unknown].map(|voxels| voxels * weights.voxel_mm3).into()),
        is_uneven,
        is_part,
        enclosed,
    })
}

/// [`Measures::box_mm`].
fn bounds_mm(view: &ModelView<'_>, space: &GridSpace) -> [[f64; 3]; 2] {
    let reach = |axis: usize, sign: f64| {
        let mut direction = [0.0; 3];
        direction[axis] = sign;
        sign * space.support_of_inside(view, direction, None)
    };
    [-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign)))
}

/// Weight of a voxel or a cell in the sums.
struct Weights {
    /// True for cells, whose normals are of index space.
    cells: bool,
    voxel_mm3: f64,
    columns: [[f64; 3]; 3],
    spacing_mm: [f64; 3],
    space: GridSpace,
}

impl Weights {
    fn new(affine: &Affine, space: &GridSpace, cells: bool) -> Self {
        Self {
            cells,
            voxel_mm3: affine.determinant().abs(),
            columns: [0, 1, 2].map(|axis| affine.column(axis)),
            spacing_mm: affine.spacing_mm(),
            space: space.clone(),
        }
    }

    /// The part of the surface in a box with this normal.
    ///
    /// A skin has one voxel in each column along the dominant axis of its normal. The part of the surface in that
    /// column is the voxel's volume over the normal's component along that axis. Cells are all boxes that the surface
    /// passes through: their number in a column is the sum of the normal's components over the greatest. (The surface
    /// within a cell itself may be off by as much as its plane: its sum over a binary ball lacks a seventh.)
    fn patch(&self, code: u16, within: Option<CellVolume>, [y, x]: [u32; 2]) -> Option<Patch> {
        let n = normal::decode_l1(code).map(f64::from);
        let normal =
            if self.cells { self.space.index_normal_to_world(n) } else { self.space.normal_to_world(n) };
        let along = self.columns.map(|column| dot(normal, column));
        let axis = (0..3).fold(0, |best, a| if along[a].abs() > along[best].abs() { a } else { best });
        let across = if self.cells { along.iter().map(|c| c.abs()).sum() } else { along[axis].abs() };
        let part = self.voxel_mm3 / across;
        let length = dot(along, along).sqrt();
        (length.is_normal() && part.is_finite()).then(|| Patch {
            y,
            x,
            label: 0,
            normal,
            along: along.map(|c| c / length),
            axis,
            part,
            part_of_voxels: within.map_or(part, |within| within.area) * length / self.voxel_mm3,
        })
    }
}

/// The surface in a box, for its neighbours.
struct Patch {
    y: u32,
    x: u32,
    /// Index of its label; 0 for models without labels.
    label: usize,
    /// Unit vector in world space.
    normal: [f64; 3],
    /// Unit vector in index space, and the axis of its longest component.
    along: [f64; 3],
    axis: usize,
    /// Area of the surface in the box, in mm2.
    part: f64,
    /// Area in index space; of a cell, the area of the surface within it.
    part_of_voxels: f64,
}

impl Patch {
    /// The patch of a label, in front of the wall or behind it.
    fn of_label(&self, label: usize, front: bool) -> Self {
        let turn = |v: [f64; 3]| if front { v.map(|c| -c) } else { v };
        Self { label, normal: turn(self.normal), along: turn(self.along), ..*self }
    }

    /// Mean area, in index space, of a cell with this normal.
    fn usual_part(&self) -> f64 {
        1.0 / self.along.iter().map(|c| c.abs()).sum::<f64>()
    }
}

/// Corrections for bends and edges, from neighbours in a slice and the one before.
///
/// A cell on a bend has a chord for an arc, one on an edge cuts it off; the skin lies half a voxel below the surface,
/// and a voxel on an edge counts for one of its faces. The correction of a bend is proportional to the mean curvature,
/// whose sum over the surface is the sum of the changes of normals along the axes; of an edge to 1 less the cosine
/// between its faces. The factors are the best fit to the bodies of the experiment.
struct Bends {
    before: Vec<Patch>,
    now: Vec<Patch>,
    edge: f64,
    /// Sums in mm2, of each label.
    of_area: Vec<Bend>,
    /// Sums in index space.
    of_volume: Bend,
}

/// Sums over pairs of neighbours.
#[derive(Clone, Copy, Default)]
struct Bend {
    /// Change of the normal along the axis, outward bends above 0, times area.
    bend: f64,
    /// Absolute change of the normal along the axis, times area.
    change: f64,
    /// Area that edges lack.
    edges: f64,
}

impl Bend {
    fn add(&mut self, (cosine, edge): (f64, f64), change: f64, [mean, least]: [f64; 2]) {
        if cosine >= edge {
            self.bend += change * mean;
            self.change += change.abs() * mean;
        } else if cosine >= WALL {
            self.edges += (1.0 - cosine) * least;
        }
    }
}

impl Bends {
    /// For so many labels, or 1 for a model without labels. Normals whose cosine is below `edge` lie at an edge.
    fn new(labels: usize, edge: f64) -> Self {
        let of_area = vec![Bend::default(); labels];
        Self { before: Vec::new(), now: Vec::new(), edge, of_area, of_volume: Bend::default() }
    }

    /// Begins the next slice.
    fn begin(&mut self) {
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.clear();
    }

    /// Adds the pairs within this slice and with the one before. Both are ordered by rows.
    fn end(&mut self, weights: &Weights) {
        let Self { before, now, edge, of_area, of_volume } = self;
        let mut add = |low: &Patch, high: &Patch, axis: usize| {
            let Some(of_area) = of_area.get_mut(low.label) else { return };
            let cosine = dot(low.normal, high.normal);
            let column = weights.columns[axis];
            let part = |n: [f64; 3]| dot(n, column) / weights.spacing_mm[axis];
            // The voxel on an edge is the one that faces along the axis; it lacks a face like its neighbour's.
            let faces_along = |patch: &Patch| patch.along[axis].abs();
            let lacking = if weights.cells {
                low.part.min(high.part)
            } else if faces_along(low) < faces_along(high) {
                low.part
            } else {
                high.part
            };
            let parts = [(low.part + high.part) / 2.0, lacking];
            of_area.add((cosine, *edge), part(high.normal) - part(low.normal), parts);
            let usual = (low.usual_part() + high.usual_part()) / 2.0;
            let parts = [usual, low.part_of_voxels.min(high.part_of_voxels)];
            of_volume.add((cosine, *edge), high.along[axis] - low.along[axis], parts);
        };
        let (mut above, mut behind) = (0, 0);
        for (i, patch) in now.iter().enumerate() {
            let Patch { y, x, label, .. } = *patch;
            // A cell between labels has a patch for each label.
            let reached = |all: &'_ [Patch], at: &mut usize, y: u32, x: u32| {
                while all.get(*at).is_some_and(|p| (p.y, p.x) < (y, x)) {
                    *at += 1;
                }
                let rest = all.iter().enumerate().skip(*at);
                let mut here = rest.take_while(|(_, p)| (p.y, p.x) == (y, x));
                here.find(|(_, p)| p.label == label).map(|(at, _)| at)
            };
            let mut close = now[..i].iter().rev().take_while(|p| p.y == y && p.x + 1 >= x);
            if let Some(left) = close.find(|p| p.x < x && p.label == label) {
                add(left, patch, 0);
            }
            if let Some(at) = y.checked_sub(1).and_then(|y| reached(now, &mut above, y, x)) {
                add(&now[at], patch, 1);
            }
            if let Some(at) = reached(before, &mut behind, y, x) {
                add(&before[at], patch, 2);
            }
        }
    }

    /// The volume that cells lack, and its error; `faces` is the number of faces of voxels. Normals that turn to and
    /// fro show a rough surface.
    fn volume(&self, faces: f64) -> (f64, f64) {
        let Bend { bend, change, edges } = self.of_volume;
        let rough = change - bend.abs();
        (0.116 * bend + 0.188 * edges, 0.03 * change + rough + 0.28 * edges + 0.001 * faces)
    }

    /// The area that a model without labels lacks, and its error. For cells the error includes the difference to the
    /// surface `within` them: the count is off where a bend faces along an axis, the surface within where planes are.
    fn area(&self, within: Option<f64>, area: f64) -> (f64, f64) {
        let Some(Bend { bend, change, edges }) = self.of_area.first() else { return (0.0, area) };
        match within {
            Some(within) => {
                let apart = (area - within).abs();
                (0.343 * edges, 0.02 * change + 0.9 * edges + 0.005 * area + apart)
            }
            None => (0.6 * bend + 0.924 * edges, 0.1 * change + 0.85 * edges + 0.004 * area),
        }
    }
}

/// Number of boxes of the surface in each direction.
///
/// The middle of a voxel says whether it is inside, so a flat face seems to lie up to half a voxel off its place, all of
/// it to the same side; faces of different directions are off by themselves.
struct Facets([u64; 6 * Facets::ACROSS * Facets::ACROSS]);

impl Facets {
    /// Number of directions along each side of a face of the direction cube: faces along the axes are in the middle of
    /// one.
    const ACROSS: usize = 9;

    fn add(&mut self, patch: &Patch) {
        let (along, axis) = (patch.along, patch.axis);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 9")]
        let across = |k: usize| {
            let part = along[(axis + k) % 3] / along[axis].abs();
            (((part + 1.0) / 2.0 * Self::ACROSS as f64) as usize).min(Self::ACROSS - 1)
        };
        let side = 2 * axis + usize::from(along[axis] < 0.0);
        if let Some(boxes) = self.0.get_mut((side * Self::ACROSS + across(1)) * Self::ACROSS + across(2)) {
            *boxes += 1;
        }
    }

    /// Error of a volume counted in voxels: 2.5 times the standard deviation.
    fn volume_error(&self) -> f64 {
        2.5 * (self.0.iter().map(|boxes| (*boxes as f64).powi(2)).sum::<f64>() / 12.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::morton;
    use crate::memory_tree::MemoryTree;

    /// The skin of a set of voxels, with the normals of a field if there is one.
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

    /// The measures of a cube of this side in voxels, of equal spacing along all axes.
    fn measured(tree: &MemoryTree, side: u32, spacing_mm: f64) -> Measures {
        let affine = Affine::from_spacing([spacing_mm; 3]);
        measure(&tree.view(), Dims::new(side, side, side).unwrap(), &affine, false).unwrap()
    }

    fn radius(p: [f64; 3], middle: f64) -> f64 {
        p.iter().map(|c| (c - middle) * (c - middle)).sum::<f64>().sqrt()
    }

    #[test]
    fn a_ball_has_its_volume_and_area() {
        let (r, c) = (30.0, 35.0);
        let (tree, voxels) = skin(72, |p| radius(p.map(f64::from), c) <= r, Some(&|p| p.map(|v| v - c)));
        let found = measured(&tree, 72, 0.5);
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

    /// A voxel on an edge counts for one face of two: the missing one is added.
    #[test]
    fn the_true_area_of_a_box_lies_within_the_error() {
        let inside = |p: [i32; 3]| p.iter().all(|c| (4..44).contains(c));
        // Normals as of a mesh, from the nearest face; and as of a gradient, between the faces.
        let nearest = |p: [f64; 3]| {
            let v = p.map(|c| c - 23.5);
            let axis = (0..3).fold(0, |a, b| if v[b].abs() > v[a].abs() { b } else { a });
            [0, 1, 2].map(|a| if a == axis { v[a] } else { 0.0 })
        };
        let between = |p: [f64; 3]| {
            let v = p.map(|c| c - 23.5);
            v.map(|c| if c.abs() > 19.0 { c } else { 0.0 })
        };
        for outward in [&nearest as &dyn Fn([f64; 3]) -> [f64; 3], &between] {
            let (tree, _) = skin(48, inside, Some(outward));
            let (area, error) = measured(&tree, 48, 0.5).area_mm2.unwrap();
            let off = 6.0 * 20.0 * 20.0 - area;
            assert!(off.abs() <= error && error < 0.12 * area, "{area} {error}");
        }
    }

    #[test]
    fn cavities_are_told_from_what_is_inside_by_the_normals() {
        let (c, wall) = (24.0, |d: f64| (14.0..=21.0).contains(&d));
        let outward = |p: [f64; 3]| {
            let side = if radius(p, c) > 17.5 { 1.0 } else { -1.0 };
            p.map(|v| (v - c) * side)
        };
        let shape = |p: [i32; 3]| wall(radius(p.map(f64::from), c));
        let (tree, voxels) = skin(48, shape, Some(&outward));
        let found = measured(&tree, 48, 1.0);
        assert_eq!(found.enclosed.inside + tree.voxel_count(), voxels);
        let cavity =
            (0..48_i32.pow(3)).filter(|i| radius([i % 48, i / 48 % 48, i / 2304].map(f64::from), c) < 14.0);
        assert_eq!(found.enclosed.cavities, cavity.count() as u64);
        // Without normals there is neither area nor volume.
        let (bare, _) = skin(48, shape, None);
        let unknown = measured(&bare, 48, 1.0);
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
        let shape = |p: [i32; 3]| (20.0..21.0).contains(&radius(p.map(f64::from), c));
        let (tree, _) = skin(48, shape, Some(&outward));
        let found = measured(&tree, 48, 1.0);
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
        let found = measure(&tree.view(), Dims::new(48, 48, 48).unwrap(), &affine, false).unwrap();
        let (volume, _) = found.volume_mm3.unwrap();
        assert!((volume - voxels as f64 * 0.5).abs() < 1e-9 && voxels == 40 * 40 * 8, "{volume}");
        let slant = (0.5_f64 * 0.5 + 1.0).sqrt();
        let faces = 2.0 * (1600.0 * 0.25 + 320.0 * 1.0 + 320.0 * slant);
        let (area, error) = found.area_mm2.unwrap();
        assert!((area - faces).abs() < error && error < 0.15 * faces, "{area} {error} {faces}");
    }

    /// Rows and slices without skin must cost nothing, or a file of 100 bytes takes a minute.
    #[test]
    fn two_voxels_at_the_far_corners_of_the_largest_grid_are_soon_measured() {
        let dims = Dims::new(65536, 65536, 65536).unwrap();
        let far = MemoryTree::new(dims, &[0, morton::encode(65535, 65535, 65535)]).unwrap();
        let found = measured(&far, 65536, 1.0);
        assert_eq!(found.voxels, [[0; 3], [65536; 3]]);
        assert_eq!(found.enclosed, Enclosed::default());
    }

    /// Such normals only hold the direction of the longest axis.
    #[test]
    fn of_voxels_that_are_far_too_long_nothing_is_known() {
        let (r, c) = (14.0, 20.0);
        let (tree, _) = skin(40, |p| radius(p.map(f64::from), c) <= r, Some(&|p| p.map(|v| v - c)));
        let dims = Dims::new(40, 40, 40).unwrap();
        for (spacing, known) in [([1e-3, 1.0, 1e3], false), ([1.0, 1.0, 5.0], true)] {
            let found = measure(&tree.view(), dims, &Affine::from_spacing(spacing), false).unwrap();
            let (area, volume) = (found.area_mm2, found.volume_mm3);
            assert_eq!((found.is_uneven, area.is_some(), volume.is_some()), (!known, known, known));
        }
    }

    #[test]
    fn an_empty_model_has_no_measures() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let one = MemoryTree::new(dims, &[morton::encode(3, 4, 5)]).unwrap();
        let found = measured(&one, 8, 1.0);
        assert_eq!(found.voxels, [[3, 4, 5], [4, 5, 6]]);
        assert_eq!(found.enclosed, Enclosed::default());
    }
}
