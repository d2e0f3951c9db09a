//! Between the world (LPS millimetres) and the grid: rays in, normals and extents out.

use std::cell::Cell;

use crate::cpu::{Form, Kernel, Lanes};
use crate::fault::{Fault, unfit};
use crate::format::Walls;
use crate::format::cell::{CORNERS, Plane};
use crate::geom::{Affine, BoxIndex, Dims, NodeIndex, Octant, dot};
use crate::load::{CellShape, ModelView, NodeView};

use super::RenderError;
use super::ray::{BadRay, Ray};
use super::tile::RAYS;
use super::walls::Hidden;

/// Deepest level below the root for the search of extents.
const FINEST_DEPTH: u32 = 11;

/// Cells between two calls of `look` in a search for visible labels: they lie close together, so a few pages of each
/// section hold them.
const CELLS_A_LOOK: u32 = 64;

/// The lowest cell along each axis, and the end.
pub(crate) type Bounds = [[u32; 3]; 2];

/// Greatest value within a cell, by its number and its lowest corner.
type Reach<'r> = dyn Fn(&GridDirection<'_>, u64, [u32; 3]) -> f64 + 'r;

/// A model's place in the world.
#[derive(Clone, Debug)]
pub struct GridSpace {
    dims: Dims,
    grid_to_world: Affine,
    world_to_grid: Affine,
    /// Rows of `B^-T` (SPEC 4.6): box-frame normals to world.
    normal_rows: [[f64; 3]; 3],
    spacing_mm: [f64; 3],
    /// Distances of neighbouring voxels in the box frame: the model's own, wherever it is placed.
    frame_mm: [f64; 3],
}

fn flat() -> Fault {
    unfit!(
        "the model's axes are (nearly) parallel, so it has no volume to look at; check its spacing and orientation"
    )
}

impl GridSpace {
    /// Places a volume by its affine (voxel index to LPS mm).
    ///
    /// # Errors
    /// [`RenderError`] when the axes are parallel, nearly so, or not finite.
    pub fn new(dims: Dims, affine: &Affine) -> Result<Self, RenderError> {
        Self::of(dims, affine, affine.spacing_mm())
    }

    /// Places a volume by its affine, then by a map of its millimetres. Its normals are the volume's own, so where it
    /// is stretched they turn as its surface does.
    ///
    /// # Errors
    /// The errors of [`GridSpace::new`].
    pub(crate) fn placed(dims: Dims, affine: &Affine, placement: &Affine) -> Result<Self, RenderError> {
        Self::of(dims, &placement.after(affine), affine.spacing_mm())
    }

    fn of(dims: Dims, affine: &Affine, frame_mm: [f64; 3]) -> Result<Self, RenderError> {
        let spacing_mm = affine.spacing_mm();
        let mut world_to_grid = affine.inverse().ok_or_else(flat)?;
        // A voxel's centre is an integer index and the middle of its grid cell.
        for row in &mut world_to_grid.rows {
            row[3] += 0.5;
        }
        let mut grid_to_world = *affine;
        let corner = affine.apply([-0.5; 3]);
        for (row, corner) in grid_to_world.rows.iter_mut().zip(corner) {
            row[3] = corner;
        }
        let normal_rows = affine.normal_rows(frame_mm).ok_or_else(flat)?;
        Ok(Self { dims, grid_to_world, world_to_grid, normal_rows, spacing_mm, frame_mm })
    }

    /// Size of the volume.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// World (LPS mm) to grid.
    pub(crate) fn world_to_grid(&self) -> &Affine {
        &self.world_to_grid
    }

    /// Longest edge of a voxel in mm.
    pub(crate) fn largest_spacing_mm(&self) -> f64 {
        self.spacing_mm.iter().fold(0.0, |m: f64, s| m.max(*s))
    }

    /// Distance of neighbouring voxels along each axis in mm.
    pub(crate) fn spacing_mm(&self) -> [f64; 3] {
        self.spacing_mm
    }

    /// The quantised form of a world ray; its parameter t is the world ray's.
    ///
    /// # Errors
    /// [`BadRay`] for a ray that is not finite or has no direction.
    #[inline]
    pub fn ray(&self, origin: [f64; 3], direction: [f64; 3]) -> Result<Option<Ray>, BadRay> {
        let (o, d) = (self.world_to_grid.apply(origin), self.world_to_grid.apply_vector(direction));
        Ray::new(self.dims.depth(), o, d, 0.0)
    }

    /// Unit world normal of a box-frame vector that is not null.
    #[inline]
    pub(crate) fn normal_to_world(&self, n: [f64; 3]) -> [f64; 3] {
        let world = self.normal_rows.map(|r| r[0] * n[0] + r[1] * n[1] + r[2] * n[2]);
        let length = dot(world, world).sqrt();
        if length > 0.0 { world.map(|c| c / length) } else { world }
    }

    /// Unit world normal of a vector of index space that is not null: a gradient along the index axes, not
    /// divided by spacings.
    #[inline]
    pub(crate) fn index_normal_to_world(&self, n: [f64; 3]) -> [f64; 3] {
        self.normal_to_world(self.index_normal_to_frame(n))
    }

    /// [`GridSpace::normal_to_world`] for a tile's vectors by axis, or [`GridSpace::index_normal_to_world`] for index
    /// space.
    pub(crate) fn normals_to_world(&self, form: Form, of_index: bool, normals: &mut [[f64; RAYS]; 3]) {
        let divisor = if of_index { self.frame_mm } else { [1.0; 3] };
        form.run(NormalsToWorld { rows: &self.normal_rows, divisor, normals });
    }

    /// Box-frame vector of a vector of index space.
    #[inline]
    pub(crate) fn index_normal_to_frame(&self, n: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| n[a] / self.frame_mm[a])
    }

    /// A direction of the world in the box frame, where normals are perpendicular to the surface.
    #[inline]
    pub(crate) fn direction_to_frame(&self, d: [f64; 3]) -> [f64; 3] {
        let rows = &self.normal_rows;
        std::array::from_fn(|a| rows[0][a] * d[0] + rows[1][a] * d[1] + rows[2][a] * d[2])
    }

    /// A world point in grid space: cell (i, j, k) is `[i, i + 1) x [j, j + 1) x [k, k + 1)`.
    #[inline]
    pub(crate) fn to_grid(&self, world: [f64; 3]) -> [f64; 3] {
        self.world_to_grid.apply(world)
    }

    /// Greatest value of `direction . p` over the skin's points p; for an empty model, over the volume's box.
    ///
    /// Exact for models of up to 2048 voxels a side; for larger ones over boxes 1/2048 of the grid wide that hold skin,
    /// so never too small. Descends only where a box with children that far out could still exceed the best so far: a
    /// few hundred nodes, and for a large flat face perpendicular to the direction one in eight of its boxes.
    pub fn support(&self, view: &ModelView<'_>, direction: [f64; 3]) -> f64 {
        self.support_to(view, direction, 0)
    }

    /// [`GridSpace::support`] with boxes of 2^`finest` voxels.
    pub(crate) fn support_to(&self, view: &ModelView<'_>, direction: [f64; 3], finest: u32) -> f64 {
        let finest = self.dims.depth().saturating_sub(FINEST_DEPTH).max(finest);
        self.support_within(view, self.along(direction), (self.whole(), finest), None)
    }

    /// [`GridSpace::support`] of the inside: in cells the part behind the surface, or with a label; of the labels that are
    /// not hidden within `shown`, if that is given.
    pub(crate) fn support_of_inside(
        &self,
        view: &ModelView<'_>,
        direction: [f64; 3],
        shown: Option<(&Hidden, Bounds)>,
    ) -> f64 {
        let Some(cells) = view.cells().filter(|_| self.dims.depth() <= FINEST_DEPTH) else {
            let all = || self.support(view, direction);
            return shown.map_or_else(all, |shown| self.support_of_visible(view, direction, shown, &|| {}));
        };
        let is_shown = |label: u16| shown.map_or(label, |(hidden, _)| hidden.seen(label)) > 0;
        let reach = |way: &GridDirection<'_>, cell: u64, at: [u32; 3]| match view.walls(cell) {
            Some(walls) => way.bound_of_walls(&walls, at, is_shown),
            None => match cells.shape(cell) {
                CellShape::Plane(plane) => way.bound_of_leaf(&plane, at, 1),
                CellShape::Corners(corners) => way.bound_of_corners(corners, at),
            },
        };
        let bounds = shown.map_or_else(|| self.whole(), |(_, bounds)| bounds);
        let along = self.along(direction);
        // The inside ends half a voxel beyond the outermost samples, which planes at the rim of a cut do not know.
        let (weight, constant) = along;
        let end = self.dims.to_array().map(|cells| f64::from(cells) - 0.5);
        let most = (0..3).fold(constant, |most, a| most + (0.5 * weight[a]).max(end[a] * weight[a]));
        self.support_within(view, along, (bounds, 0), Some(&reach)).min(most)
    }

    /// [`GridSpace::support`] of the cells with a label that is not hidden, exact for every size; `bounds` encloses them,
    /// and `look` is called now and then.
    ///
    /// Cost: the cells within `bounds` that are farther out.
    pub(crate) fn support_of_visible(
        &self,
        view: &ModelView<'_>,
        direction: [f64; 3],
        (hidden, bounds): (&Hidden, Bounds),
        look: &dyn Fn(),
    ) -> f64 {
        self.visible_within(view, self.along(direction), (hidden, bounds), look)
    }

    /// Bounds of the cells with a label that is not hidden.
    ///
    /// Each side is searched within the sides found before, so every cell beyond the bounds is looked at once.
    pub(crate) fn bounds_of_visible(&self, view: &ModelView<'_>, hidden: &Hidden, look: &dyn Fn()) -> Bounds {
        let mut bounds = self.whole();
        for (axis, side) in (0..6).map(|i| (i / 2, i % 2)) {
            let mut weight = [0.0; 3];
            weight[axis] = [-1.0, 1.0][side];
            let most = self.visible_within(view, (weight, 0.0), (hidden, bounds), look);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a side of a cell")]
            {
                bounds[side][axis] = most.abs() as u32;
            }
        }
        bounds
    }

    fn visible_within(
        &self,
        view: &ModelView<'_>,
        along: ([f64; 3], f64),
        (hidden, bounds): (&Hidden, Bounds),
        look: &dyn Fn(),
    ) -> f64 {
        let looked = Cell::new(0_u32);
        let reach = |way: &GridDirection<'_>, cell: u64, at: [u32; 3]| {
            looked.set(looked.get().wrapping_add(1));
            if looked.get().is_multiple_of(CELLS_A_LOOK) {
                look();
            }
            let is_visible =
                view.walls(cell).is_some_and(|walls| walls.holds(|label| hidden.seen(label) > 0));
            if is_visible { way.bound(at, 1) } else { f64::NEG_INFINITY }
        };
        self.support_within(view, along, (bounds, 0), Some(&reach))
    }

    /// All cells of the grid.
    fn whole(&self) -> Bounds {
        [[0; 3], [1 << self.dims.depth(); 3]]
    }

    /// A direction of the world as a function of the grid: weights and constant.
    fn along(&self, direction: [f64; 3]) -> ([f64; 3], f64) {
        let weight = std::array::from_fn(|a| dot(direction, self.grid_to_world.column(a)));
        (weight, dot(direction, self.grid_to_world.origin()))
    }

    /// Greatest value within `bounds` of boxes of 2^`finest` voxels, of which `reach` gives the value of a single cell.
    fn support_within(
        &self,
        view: &ModelView<'_>,
        (weight, constant): ([f64; 3], f64),
        (bounds, finest): (Bounds, u32),
        reach: Option<&Reach<'_>>,
    ) -> f64 {
        let depth = self.dims.depth();
        if view.is_empty() || (depth > 0 && view.infobyte(NodeIndex::ROOT) == 0) {
            let corner = self.dims.to_array();
            return (0..3).fold(constant, |sum, a| sum + weight[a].max(0.0) * f64::from(corner[a]));
        }
        let way = GridDirection { weight, constant, bounds, view };
        let root = (way.bound([0; 3], 1 << depth), BoxIndex::ROOT, [0_u32; 3], depth);
        let mut best = f64::NEG_INFINITY;
        let mut waiting = vec![root];
        // Nodes of a damaged model may share children.
        let mut visits = 0;
        while let Some((most, number, low, level)) = waiting.pop() {
            if most <= best {
                continue;
            }
            visits += 1;
            if level <= finest || visits > view.node_count() {
                best = most;
                continue;
            }
            let half = 1_u32 << (level - 1);
            let infobyte = view.infobyte(number.node());
            let children = view.first_child(number.node());
            let first = waiting.len();
            for octant in Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte)) {
                let child = children.after(octant.rank_in(infobyte));
                let at = std::array::from_fn(|a| low[a] + octant.high()[a] * half);
                if view.is_leaf(child.node()) {
                    best = best.max(way.bound_of_leaf(&view.leaf_plane(child.node()), at, half));
                    continue;
                }
                if level - 1 == finest {
                    let most = way.bound(at, half);
                    if most > best {
                        let cell = || child.voxel(view.node_count()).get();
                        best = best.max(reach.map_or(most, |reach| reach(&way, cell(), at)));
                    }
                    continue;
                }
                // At most as far as the farthest of its own children.
                let most = way.bound_of_node(child, at, level - 1);
                if most > best && level - 2 == finest && reach.is_none() {
                    best = most;
                } else if most > best {
                    waiting.push((most, child, at, level - 1));
                }
            }
            // The most promising child is taken first.
            waiting[first..].sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        if best.is_finite() { best } else { root.0 }
    }
}

/// [`GridSpace::normals_to_world`] for any lanes: the operations of one normal, in their order.
struct NormalsToWorld<'a> {
    rows: &'a [[f64; 3]; 3],
    divisor: [f64; 3],
    normals: &'a mut [[f64; RAYS]; 3],
}

impl Kernel for NormalsToWorld<'_> {
    type Output = ();

    // A loop over arrays: it is vectorised for the form that runs it.
    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { rows: [x, y, z], divisor, normals: [n_x, n_y, n_z] } = self;
        for i in 0..RAYS {
            let n = [n_x[i] / divisor[0], n_y[i] / divisor[1], n_z[i] / divisor[2]];
            let world = [
                x[0] * n[0] + x[1] * n[1] + x[2] * n[2],
                y[0] * n[0] + y[1] * n[1] + y[2] * n[2],
                z[0] * n[0] + z[1] * n[1] + z[2] * n[2],
            ];
            let length = (world[0] * world[0] + world[1] * world[1] + world[2] * world[2]).sqrt();
            let by = if length > 0.0 { length } else { 1.0 };
            (n_x[i], n_y[i], n_z[i]) = (world[0] / by, world[1] / by, world[2] / by);
        }
    }
}

/// A direction in the grid, with the model's boxes to measure along it.
struct GridDirection<'a> {
    weight: [f64; 3],
    constant: f64,
    bounds: Bounds,
    view: &'a ModelView<'a>,
}

impl GridDirection<'_> {
    /// Greatest value within a box and the bounds; -inf without a cell in both.
    fn bound(&self, low: [u32; 3], edge: u32) -> f64 {
        let [from, end] = self.bounds;
        if (0..3).any(|a| low[a] >= end[a] || low[a] + edge <= from[a]) {
            return f64::NEG_INFINITY;
        }
        (0..3).fold(self.constant, |sum, a| {
            let at = if self.weight[a] > 0.0 { (low[a] + edge).min(end[a]) } else { low[a].max(from[a]) };
            sum + self.weight[a] * f64::from(at)
        })
    }

    /// Greatest value within the inside part of a larger leaf's box (SPEC 4.9), -inf without an inside part.
    fn bound_of_leaf(&self, plane: &Plane, low: [u32; 3], edge: u32) -> f64 {
        // From the farthest corner, which lies this far in front of the plane, back along the cheapest edges.
        let up = self.weight.map(|w| w > 0.0);
        let normal = plane.normal.map(f64::from);
        let outward: [f64; 3] = std::array::from_fn(|a| if up[a] { normal[a] } else { -normal[a] });
        let mut in_front = outward.iter().sum::<f64>() - f64::from(plane.offset);
        let mut most = self.bound(low, edge);
        let mut axes = [0, 1, 2];
        let price = |a: usize| self.weight[a].abs() / outward[a];
        axes.sort_by(|a, b| price(*a).total_cmp(&price(*b)));
        for a in axes.into_iter().filter(|a| outward[*a] > 0.0) {
            // Part of the box's edge, which is 2 long in the leaf's coordinates.
            let part = (in_front.max(0.0) / (2.0 * outward[a])).min(1.0);
            in_front -= 2.0 * outward[a] * part;
            most -= self.weight[a].abs() * part * f64::from(edge);
        }
        if in_front > 1e-9 { f64::NEG_INFINITY } else { most }
    }

    /// Greatest value on the inside parts of the edges of a finest cell with corners.
    fn bound_of_corners(&self, corners: [i8; CORNERS], low: [u32; 3]) -> f64 {
        let at = |corner: usize| {
            self.bound_at(std::array::from_fn(|a| f64::from(low[a]) + (corner >> a & 1) as f64))
        };
        let depth = |corner: usize| f64::from(corners[corner]);
        let mut most = f64::NEG_INFINITY;
        for from in (0..CORNERS).filter(|corner| corners[*corner] > 0) {
            most = most.max(at(from));
            for to in (0..3).map(|axis| from ^ 1 << axis).filter(|corner| corners[*corner] <= 0) {
                let along = depth(from) / (depth(from) - depth(to));
                most = most.max(at(from) + along * (at(to) - at(from)));
            }
        }
        most
    }

    /// Greatest value within the part of a finest cell that has such labels.
    fn bound_of_walls(&self, walls: &Walls, low: [u32; 3], is_such: impl Fn(u16) -> bool) -> f64 {
        let at = |u: [f64; 3]| self.bound_at(std::array::from_fn(|a| f64::from(low[a]) + (1.0 + u[a]) / 2.0));
        walls.labelled(&walls.faces(), is_such).into_iter().map(at).fold(f64::NEG_INFINITY, f64::max)
    }

    fn bound_at(&self, at: [f64; 3]) -> f64 {
        (0..3).fold(self.constant, |sum, a| sum + self.weight[a] * at[a])
    }

    /// Greatest value within a node's children.
    fn bound_of_node(&self, node: BoxIndex, low: [u32; 3], level: u32) -> f64 {
        let (half, infobyte) = (1_u32 << (level - 1), self.view.infobyte(node.node()));
        let inside = Octant::ALL.into_iter().filter(|octant| octant.is_in(infobyte));
        let bound =
            |octant: Octant| self.bound(std::array::from_fn(|a| low[a] + octant.high()[a] * half), half);
        inside.map(bound).fold(f64::NEG_INFINITY, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::morton;
    use crate::memory_tree::MemoryTree;

    #[test]
    fn voxel_centres_are_cell_centres_and_normals_stay_perpendicular() {
        // Sheared, anisotropic and mirrored.
        let affine = Affine { rows: [[0.5, 0.0, 0.3, 10.0], [0.0, -0.5, 0.2, -20.0], [0.0, 0.1, 2.0, 30.0]] };
        let space = GridSpace::new(Dims::new(8, 8, 8).unwrap(), &affine).unwrap();
        let centre = affine.apply([3.0, 4.0, 5.0]);
        let ray = space.ray(centre, affine.column(2)).unwrap().unwrap();
        assert_eq!(ray.origin(), [7 << 15, 9 << 15, 11 << 15]);
        // The normal of an x face is perpendicular to the other two columns and on the side of the first.
        let n = space.normal_to_world([1.0, 0.0, 0.0]);
        assert!(dot(n, affine.column(1)).abs() < 1e-12 && dot(n, affine.column(2)).abs() < 1e-12);
        assert!(dot(n, affine.column(0)) > 0.0 && (dot(n, n) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn support_is_that_of_all_voxels() {
        let dims = Dims::new(40, 20, 64).unwrap();
        let codes: Vec<u64> =
            (0..60_u32).map(|i| morton::encode(i * 13 % 40, i * 7 % 20, i * 29 % 64)).collect();
        let tree = MemoryTree::new(dims, &codes).unwrap();
        let affine = Affine { rows: [[0.5, 0.0, 0.3, 1.0], [0.0, -0.5, 0.2, -2.0], [0.0, 0.1, 2.0, 3.0]] };
        let space = GridSpace::new(dims, &affine).unwrap();
        for d in [[1.0, 0.0, 0.0], [-1.0, 0.5, 0.2], [0.0, -1.0, 0.0], [0.3, 0.3, -0.9]] {
            let mut want = f64::NEG_INFINITY;
            for code in &codes {
                let low = morton::decode(*code);
                for corner in 0..8_u32 {
                    let at: [f64; 3] = std::array::from_fn(|a| f64::from(low[a] + (corner >> a & 1)));
                    want = want.max(dot(d, space.grid_to_world.apply(at)));
                }
            }
            assert!((space.support(&tree.view(), d) - want).abs() < 1e-9, "{d:?}");
        }
    }

    /// Such a face has a hundred thousand boxes that may reach farther than its voxels do.
    #[test]
    fn the_support_of_a_large_flat_face_is_exact() {
        let dims = Dims::new(1024, 1024, 128).unwrap();
        let turned = |angle: f64| {
            let (sin, cos) = (angle.sin(), angle.cos());
            Affine {
                rows: [
                    [0.5, 0.0, 0.0, 1.0],
                    [0.0, 0.5 * cos, -0.5 * sin, 2.0],
                    [0.0, 0.5 * sin, 0.5 * cos, 3.0],
                ],
            }
        };
        // A plate with holes and a slope, each at an odd height.
        let holes = |x: u32, y: u32| !(x * 7 + y * 3).is_multiple_of(11);
        let plate = |x: u32, y: u32| Some(if holes(x, y) { 101_u32 } else { 98 });
        let slope = |x: u32, y: u32| Some(1 + (x + 3 * y) / 64);
        for height in [&plate as &dyn Fn(u32, u32) -> Option<u32>, &slope] {
            let mut voxels: Vec<[u32; 3]> = Vec::new();
            for y in 0..1024 {
                voxels.extend((0..1024).filter_map(|x| Some([x, y, height(x, y)?])));
            }
            let mut codes: Vec<u64> = voxels.iter().map(|p| morton::encode(p[0], p[1], p[2])).collect();
            codes.sort_unstable();
            let tree = MemoryTree::new(dims, &codes).unwrap();
            for angle in [0.0, 0.01, -0.3] {
                let space = GridSpace::new(dims, &turned(angle)).unwrap();
                // Perpendicular to the slope, or along the axes of the world.
                let square = space.normal_to_world([-1.0, -3.0, 64.0]);
                for d in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], square, square.map(|c| -c)] {
                    let w: [f64; 3] = std::array::from_fn(|a| dot(d, space.grid_to_world.column(a)));
                    let farthest = |p: &[u32; 3]| {
                        (0..3).map(|a| w[a] * f64::from(p[a] + u32::from(w[a] > 0.0))).sum::<f64>()
                    };
                    let want = voxels.iter().map(farthest).fold(f64::NEG_INFINITY, f64::max)
                        + dot(d, space.grid_to_world.origin());
                    let found = space.support(&tree.view(), d);
                    assert!((found - want).abs() < 1e-9, "{angle} {d:?}: {found} {want}");
                }
            }
        }
    }

    #[test]
    fn singular_affines_are_refused() {
        let dims = Dims::new(2, 2, 2).unwrap();
        let flat = Affine { rows: [[1.0, 1.0, 0.0, 0.0], [0.0, 1e-12, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };
        let refused = GridSpace::new(dims, &flat).unwrap_err();
        assert!(refused.to_string().contains("(nearly) parallel"), "{refused}");
    }
}
