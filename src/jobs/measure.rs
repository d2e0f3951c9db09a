//! Extents, surface area and enclosed volume of a model, from its skin and normals alone.
//!
//! Memory: the skin of 32 slices, and the runs and normals of two. Cost: each node about once, and some 20 ns a run
//! and 50 ns a skin voxel.

pub use crate::enclosed::Enclosed;
use crate::enclosed::{Outward, SkinSlices, Sweep, extent};
use crate::format::normal;
use crate::geom::{Affine, Dims, VoxelIndex};
use crate::load::{ModelView, NodeView};
use crate::render::GridSpace;

/// The error of an area is what normals this far off would make of it, all to the same side (3 degrees).
const NORMAL_ERROR_RAD: f64 = 0.052;

/// Neighbours whose normals are at least 30 degrees apart (as a cosine) lie at an edge.
const EDGE: f64 = 0.866;
/// At more than 120 degrees they are the two sides of a thin wall.
const WALL: f64 = -0.5;

/// What was measured. Lengths are in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// First voxel of the skin along each axis, and the one after the last.
    pub voxels: [[u32; 3]; 2],
    /// Least and greatest coordinate (LPS) of the skin's voxels, to within 1/2048 of the grid and never too tight.
    pub box_mm: [[f64; 3]; 2],
    /// Area of the skin, walls of enclosed cavities included, with its error; a sheet one voxel thick counts
    /// once. A voxel on a sharp edge counts for one of its faces; what the others lack is in the error. `None` without
    /// normals.
    pub area_mm2: Option<(f64, f64)>,
    /// Volume of the skin's voxels and of what is deep inside, with its error. `None` where the normals do not
    /// tell what is inside: there are none, walls are one voxel thick, or only a part was kept.
    pub volume_mm3: Option<(f64, f64)>,
    /// Does the model keep only what can be seen from somewhere?
    pub is_part: bool,
    /// Voxels that are deep inside, in enclosed cavities, and neither for sure.
    pub enclosed: Enclosed,
}

/// Measures a model; `None` for one without a voxel, without a volume, or damaged. `is_part`: does it keep only what
/// can be seen from somewhere?
pub fn measure(view: &ModelView<'_>, dims: Dims, affine: &Affine, is_part: bool) -> Option<Measures> {
    let space = GridSpace::new(dims, affine).ok()?;
    let reach = |axis: usize, sign: f64| {
        let mut direction = [0.0; 3];
        direction[axis] = sign;
        sign * space.support(view, direction)
    };
    let box_mm = [-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign)));
    let voxels = extent(view)?;
    let cells = view.cells().is_some();
    let weights = Weights::new(affine, &space, cells);
    let mut sweep = Sweep::new(voxels, Outward::new(cells, affine.spacing_mm()));
    let mut slices = SkinSlices::new(view);
    let (mut area, mut edges) = (Area::default(), Edges::default());
    let mut seen = 0;
    let has_normals = view.voxel_normal(VoxelIndex::new(0)).is_some();
    sweep.slice(view, &[]);
    for z in voxels[0][2]..voxels[1][2] {
        let skin = slices.slice(z)?;
        seen += skin.len() as u64;
        edges.begin();
        for voxel in skin {
            if let Some(code) = view.voxel_normal(voxel.voxel)
                && let Some((normal, part)) = area.add(&weights, code)
            {
                edges.now.push(Patch { y: voxel.y, x: voxel.x, normal, part });
            }
        }
        area.error += edges.lacking();
        sweep.slice(view, skin);
    }
    sweep.slice(view, &[]);
    let (enclosed, _) = sweep.finish();
    let (skin, each) = (count(seen), weights.voxel_mm3);
    let unknown = count(enclosed.unknown) / 2.0;
    // A surface of voxels lies on the outside of these, one of cells within them.
    let of_skin = if weights.cells { skin / 2.0 } else { skin };
    let volume = (of_skin + count(enclosed.inside) + unknown) * each;
    let error = (skin / 2.0 + unknown) * each;
    // Half of it unknown is not known.
    let known = has_normals && !is_part && unknown <= 0.1 * (skin + count(enclosed.inside));
    Some(Measures {
        voxels,
        box_mm,
        area_mm2: has_normals.then_some((area.sum, area.error)),
        volume_mm3: known.then_some((volume, error)),
        is_part,
        enclosed,
    })
}

#[expect(clippy::cast_precision_loss, reason = "counts are below 2^48")]
fn count(voxels: u64) -> f64 {
    voxels as f64
}

/// What a voxel, or a cell, counts for.
struct Weights {
    /// Are the boxes cells? Then normals are of index space.
    cells: bool,
    voxel_mm3: f64,
    columns: [[f64; 3]; 3],
    space: GridSpace,
}

impl Weights {
    fn new(affine: &Affine, space: &GridSpace, cells: bool) -> Self {
        Self {
            cells,
            voxel_mm3: affine.determinant().abs(),
            columns: [0, 1, 2].map(|axis| affine.column(axis)),
            space: space.clone(),
        }
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
    /// Adds a voxel; its unit normal and what it counts for.
    fn add(&mut self, weights: &Weights, code: u16) -> Option<([f64; 3], f64)> {
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
        let size = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        if along[axis] <= 0.0 || along[axis].is_nan() || !size.is_normal() {
            return None;
        }
        let across = if weights.cells { along.iter().sum() } else { along[axis] };
        let part = weights.voxel_mm3 / across;
        let cosine = (along[axis] / length).min(1.0);
        self.sum += part;
        self.error += part * NORMAL_ERROR_RAD * (1.0 - cosine * cosine).sqrt() / cosine;
        Some((n.map(|c| c / size), part))
    }
}

/// A skin voxel of a slice, for its neighbours.
struct Patch {
    y: u32,
    x: u32,
    normal: [f64; 3],
    part: f64,
}

/// What sharp edges lack, told by normals of neighbours that share a face: a voxel on an edge of 90 degrees belongs to
/// two faces and counts for one.
///
/// Neighbours whose normals are an angle t apart lack 1 - cos t of a face: all of it where the normals of an edge are
/// those of its faces, and as much in two steps of 45 degrees as a voxel lacks whose normal lies between.
#[derive(Default)]
struct Edges {
    before: Vec<Patch>,
    now: Vec<Patch>,
}

impl Edges {
    /// Begins the next slice.
    fn begin(&mut self) {
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.clear();
    }

    /// What the edges of this slice lack, and those to the one before. Both are ordered by rows.
    fn lacking(&self) -> f64 {
        let lacks = |a: &Patch, b: &Patch| {
            let cosine: f64 = a.normal.iter().zip(&b.normal).map(|(a, b)| a * b).sum();
            if (WALL..EDGE).contains(&cosine) { (1.0 - cosine) * a.part.min(b.part) } else { 0.0 }
        };
        let mut sum = 0.0;
        let (mut above, mut behind) = (0, 0);
        let reached = |all: &[Patch], at: &mut usize, y: u32, x: u32| {
            while all.get(*at).is_some_and(|p| (p.y, p.x) < (y, x)) {
                *at += 1;
            }
            all.get(*at).is_some_and(|p| (p.y, p.x) == (y, x))
        };
        for (i, patch) in self.now.iter().enumerate() {
            let Patch { y, x, .. } = *patch;
            if let Some(left) = i.checked_sub(1).map(|i| &self.now[i])
                && left.y == y
                && left.x + 1 == x
            {
                sum += lacks(left, patch);
            }
            if y > 0 && reached(&self.now, &mut above, y - 1, x) {
                sum += lacks(&self.now[above], patch);
            }
            if reached(&self.before, &mut behind, y, x) {
                sum += lacks(&self.before[behind], patch);
            }
        }
        sum
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
        let found = measure(&tree.view(), Dims::new(72, 72, 72).unwrap(), &affine, false).unwrap();
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

    /// A voxel on an edge counts for one face of two: the error says so.
    #[test]
    fn the_true_area_of_a_box_lies_within_the_error() {
        let inside = |p: [i32; 3]| p.iter().all(|c| (4..44).contains(c));
        // As of a mesh: the face that is nearest; and as of a gradient: between the faces.
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
            let dims = Dims::new(48, 48, 48).unwrap();
            let found = measure(&tree.view(), dims, &Affine::from_spacing([0.5; 3]), false).unwrap();
            let (area, error) = found.area_mm2.unwrap();
            let lacks = 6.0 * 20.0 * 20.0 - area;
            assert!(lacks > 0.0 && lacks <= 1.02 * error && error < 2.0 * lacks, "{area} {error}");
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
        let dims = Dims::new(48, 48, 48).unwrap();
        let (tree, voxels) = skin(48, shape, Some(&outward));
        let found = measure(&tree.view(), dims, &Affine::from_spacing([1.0; 3]), false).unwrap();
        assert_eq!(found.enclosed.inside + tree.voxel_count(), voxels);
        let cavity =
            (0..48_i32.pow(3)).filter(|i| radius([i % 48, i / 48 % 48, i / 2304].map(f64::from), c) < 14.0);
        assert_eq!(found.enclosed.cavities, cavity.count() as u64);
        // Without normals nobody knows.
        let (bare, _) = skin(48, shape, None);
        let unknown = measure(&bare.view(), dims, &Affine::from_spacing([1.0; 3]), false).unwrap();
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
        let found =
            measure(&tree.view(), Dims::new(48, 48, 48).unwrap(), &Affine::from_spacing([1.0; 3]), false)
                .unwrap();
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
        assert!((volume - count(voxels) * 0.5).abs() < 1e-9 && voxels == 40 * 40 * 8, "{volume}");
        // Voxels on an edge count once: 1600 of the flat faces, 40 x 6 of the upright and 38 x 6 of the slanting ones.
        let slant = (0.5_f64 * 0.5 + 1.0).sqrt();
        let faces = 2.0 * (1600.0 * 0.25 + 240.0 * 1.0 + 228.0 * slant);
        let (area, _) = found.area_mm2.unwrap();
        assert!((area - faces).abs() < 1e-3 * faces, "{area} {faces}");
    }

    /// Nothing lies between: rows and slices without skin must cost nothing, or a file of 100 bytes takes a minute.
    #[test]
    fn two_voxels_at_the_far_corners_of_the_largest_grid_are_soon_measured() {
        let dims = Dims::new(65536, 65536, 65536).unwrap();
        let far = MemoryTree::new(dims, &[0, morton::encode(65535, 65535, 65535)]).unwrap();
        let found = measure(&far.view(), dims, &Affine::from_spacing([1.0; 3]), false).unwrap();
        assert_eq!(found.voxels, [[0; 3], [65536; 3]]);
        assert_eq!(found.enclosed, Enclosed::default());
    }

    #[test]
    fn an_empty_model_has_no_measures() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let one = MemoryTree::new(dims, &[morton::encode(3, 4, 5)]).unwrap();
        let found = measure(&one.view(), dims, &Affine::from_spacing([1.0; 3]), false).unwrap();
        assert_eq!(found.voxels, [[3, 4, 5], [4, 5, 6]]);
        assert_eq!(found.enclosed, Enclosed::default());
    }
}
