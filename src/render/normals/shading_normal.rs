//! The hit of a pixel, and the normal displayed there.

use crate::cpu::Form;
use crate::format::{Label, normal};
use crate::geom::{BoxIndex, NodeIndex, add_scaled, dot};
use crate::load::{ModelView, NodeView};

use super::blend;
use super::larger;
use super::neighborhood::Neighborhood;
use super::repair::{self, tile::Stored};
use super::smooth;
use crate::render::Smoothing;
use crate::render::cells::Cells;
use crate::render::ray::Face;
use crate::render::space::GridSpace;
use crate::render::tile::RAYS;
use crate::render::traverse::Hit;

/// Line of sight in the world: origin and direction.
pub(crate) type Line = ([f64; 3], [f64; 3]);

/// Largest distance of a hit from its wall, in half cells: rays are rounded in the grid, by 2^-14 cell at most.
pub(crate) const NEAR_WALL: f64 = 1.0 / 4096.0;
/// The same distance where the depth is in single precision.
const NEAR_BY_DEPTH: f64 = 1e-3;
/// Length of a step into the cell that was hit, in cells.
const AHEAD: f64 = 1e-4;
/// Factor by which a mean normal that points away is turned back to the visible side, just beyond its edge.
const SEEN: f64 = 1.05;
/// Cosine between a line of sight and a normal that points away up to which the surface counts as seen from outside.
const GRAZING: f64 = 0.35;

/// A pixel's hit in 16 bytes.
#[derive(Clone, Copy)]
pub(crate) struct PixelHit {
    box_number: u64,
    /// Depth in mm; NaN for background.
    depth: f32,
    /// Axis and side of the face, or [`PixelHit::NO_FACE`].
    face: u8,
    kind: HitKind,
    /// Code of the normal, where it is not the box's.
    code: u16,
}

/// Source of a hit's normal.
#[derive(Clone, Copy, PartialEq, Eq)]
enum HitKind {
    Voxel,
    Node,
    /// The hit itself, for a cell with corners, whose normal varies within it.
    Own,
    /// A larger leaf.
    Larger(LeafEdge),
    /// A cut face: `face` holds its plane, `code` its label.
    Cut,
}

/// The edge of a larger leaf, 2 to 32.
#[derive(Clone, Copy, PartialEq, Eq)]
enum LeafEdge {
    Two,
    Four,
    Eight,
    Sixteen,
    ThirtyTwo,
}

impl LeafEdge {
    fn of(edge_log2: u32) -> Self {
        match edge_log2 {
            0 | 1 => Self::Two,
            2 => Self::Four,
            3 => Self::Eight,
            4 => Self::Sixteen,
            _ => Self::ThirtyTwo,
        }
    }

    fn log2(self) -> u32 {
        self as u32 + 1
    }
}

impl PixelHit {
    const NO_FACE: u8 = u8::MAX;
    /// Background.
    pub(crate) const NOTHING: Self =
        Self { box_number: 0, depth: f32::NAN, face: Self::NO_FACE, kind: HitKind::Node, code: 0 };

    #[expect(clippy::cast_possible_truncation, reason = "a depth image has 16 bits")]
    fn new(hit: &Hit) -> Self {
        Self {
            box_number: hit.box_number,
            depth: (hit.t as f32).min(f32::MAX),
            face: hit.face.map_or(Self::NO_FACE, |f| 2 * f.axis + u8::from(f.high)),
            kind: if hit.edge_log2 == 0 { HitKind::Voxel } else { HitKind::Node },
            code: 0,
        }
    }

    /// The interior cut open by a plane of a clip, and the number of its label, or 0.
    #[expect(clippy::cast_possible_truncation, reason = "a depth image has 16 bits, and a clip few planes")]
    pub(crate) fn cut(plane: usize, t: f64, label: u16) -> Self {
        let (depth, face) = ((t as f32).min(f32::MAX), plane as u8);
        Self { box_number: 0, depth, face, kind: HitKind::Cut, code: label }
    }

    /// The plane and the label of a cut pixel; `None` for other hits.
    pub(crate) fn cut_of(self) -> Option<(usize, u16)> {
        (self.kind == HitKind::Cut).then_some((self.face.into(), self.code))
    }

    pub(crate) fn is_hit(self) -> bool {
        !self.depth.is_nan()
    }

    /// Breadth-first number of the box.
    pub(crate) fn box_number(self) -> u64 {
        self.box_number
    }

    /// True for a voxel or cell, false for a coarser box.
    pub(in crate::render) fn is_finest(self) -> bool {
        self.kind != HitKind::Node
    }

    /// Depth in mm; NaN for background.
    pub(crate) fn depth(self) -> f32 {
        self.depth
    }

    /// True if its normal is the normal of the face of a box, for any line of sight.
    #[inline]
    pub(super) fn is_of_face(self) -> bool {
        self.face != Self::NO_FACE && self.kind != HitKind::Own
    }

    /// A number for each face of each box.
    #[inline]
    pub(super) fn key(self) -> u64 {
        self.box_number.wrapping_mul(8) | u64::from(self.face)
    }

    fn face(self) -> Option<Face> {
        (self.face != Self::NO_FACE).then(|| Face::new(usize::from(self.face / 2), self.face % 2 == 1))
    }
}

/// A world point in the coordinates of a cell, -1..=1.
pub(crate) fn cell_coordinates(space: &GridSpace, cell: [u32; 3], world: [f64; 3]) -> [f64; 3] {
    let at = space.to_grid(world);
    std::array::from_fn(|a| (2.0 * (at[a] - f64::from(cell[a])) - 1.0).clamp(-1.0, 1.0))
}

/// Computes the normals of a model in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Normals<'a> {
    view: &'a ModelView<'a>,
    /// The cells, if the model has them: normals are then of index space.
    cells: Option<Cells<'a>>,
    space: &'a GridSpace,
    smoothing: Smoothing,
    lod_edge_log2: u32,
}

impl<'a> Normals<'a> {
    /// Normals of a model whose hits may be boxes of `2^lod_edge_log2`.
    pub(crate) fn new(
        view: &'a ModelView<'a>,
        space: &'a GridSpace,
        smoothing: Smoothing,
        lod_edge_log2: u32,
    ) -> Self {
        Self { view, cells: view.cells().map(Cells::new), space, smoothing, lod_edge_log2 }
    }

    /// The pixel's form of a hit along a line.
    #[inline]
    pub(crate) fn seen(&self, hit: &Hit, line: impl FnOnce() -> Line) -> PixelHit {
        let mut seen = PixelHit::new(hit);
        if hit.edge_log2 > self.lod_edge_log2 && self.view.is_leaf(NodeIndex::new(hit.box_number)) {
            (seen.kind, seen.code) = (
                HitKind::Larger(LeafEdge::of(hit.edge_log2)),
                self.view.leaf_items(NodeIndex::new(hit.box_number)).0,
            );
        }
        if let Some(cells) = &self.cells
            && seen.kind == HitKind::Voxel
            && cells.has_corners(hit.box_number.wrapping_sub(self.view.node_count()))
        {
            (seen.kind, seen.code) = (HitKind::Own, self.corner_normal(cells, hit, line()));
        }
        seen
    }

    /// The label of a hit on the finest level, for a model of cells between labels.
    pub(crate) fn label(&self, seen: PixelHit, (origin, direction): Line) -> Option<&'a Label> {
        let (labels, number) = (self.view.labels()?, seen.box_number.wrapping_sub(self.view.node_count()));
        let walls = self.view.walls(number).filter(|_| seen.is_finest())?;
        let at = self.space.to_grid(add_scaled(origin, f64::from(seen.depth), direction));
        let way = self.space.world_to_grid().apply_vector(direction);
        // A little ahead: the point of a hit on a face may be on either side.
        let longest = way.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        // At least the rounding of single precision.
        let step = (AHEAD / longest).max(f64::from(seen.depth) * f64::from(f32::EPSILON));
        let ahead = add_scaled(at, step, way);
        let u = std::array::from_fn(|a| 2.0 * (ahead[a] - ahead[a].floor()) - 1.0);
        labels.named(walls.met(u, way, NEAR_BY_DEPTH).0)
    }

    /// Code of the normal where a cell with corners was hit.
    #[cold]
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    fn corner_normal(&self, cells: &Cells<'_>, hit: &Hit, (origin, direction): Line) -> u16 {
        let at = std::array::from_fn(|i| origin[i] + hit.t * direction[i]);
        let number = hit.box_number.wrapping_sub(self.view.node_count());
        let u = cell_coordinates(self.space, hit.cell, at);
        if let Some(walls) = self.view.walls(number) {
            let met = walls.met(u, self.space.world_to_grid().apply_vector(direction), NEAR_WALL).1;
            if met != [0.0; 3] {
                return normal::encode(met.map(|c| c as f32));
            }
        }
        normal::encode(cells.normal(number, u).map(|c| c as f32))
    }

    /// A normal of the hit's box, blended with the normals of the boxes around.
    #[inline]
    fn blended(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
        own: [f64; 3],
    ) -> [f64; 3] {
        if seen.kind == HitKind::Node {
            return own;
        }
        let at = self.at(seen, line);
        if let HitKind::Larger(edge) = seen.kind {
            return larger::blended(self.view, &mut around.larger, at, edge.log2(), own);
        }
        blend::blended(self.view, at, own)
    }

    /// Position of a hit in the grid.
    #[inline]
    fn at(&self, seen: PixelHit, line: impl Fn() -> Line) -> [f64; 3] {
        let (origin, sight) = line();
        self.space.to_grid(add_scaled(origin, f64::from(seen.depth), sight))
    }

    /// A normal of the hit's cell or larger leaf, smoothed if requested.
    #[inline]
    fn of_cells(
        &self,
        cells: &Cells<'_>,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
        own: [f64; 3],
    ) -> [f64; 3] {
        let smooth = match (self.smoothing, seen.kind) {
            (Smoothing::Stored, _) | (_, HitKind::Node) => return own,
            (_, HitKind::Larger(edge)) => {
                larger::blended(self.view, &mut around.larger, self.at(seen, &line), edge.log2(), own)
            }
            _ => {
                let at = self.at(seen, &line);
                smooth::smooth((self.view, cells.items()), around, seen.box_number, at, own)
            }
        };
        let (direction, spacing) =
            (self.space.world_to_grid().apply_vector(line().1), self.space.spacing_mm());
        not_away(own, smooth, direction, spacing)
    }

    /// World normal: the stored one unless the skin around contradicts it, else the face's, else towards the eye. The
    /// plane of a cell is the surface itself, and is never contradicted.
    pub(crate) fn normal(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
    ) -> [f64; 3] {
        match self.in_boxes(around, seen, &line) {
            Some(normal) => self.space.normal_to_world(normal),
            None => towards_eye(line()),
        }
    }

    /// [`Normals::normal`] in the frame of the boxes, of any length; `None` towards the eye.
    #[inline]
    pub(super) fn in_boxes(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
    ) -> Option<[f64; 3]> {
        let Some(stored) = self.stored(seen, 0) else {
            let face = seen.face()?;
            let mut n = [0.0; 3];
            n[usize::from(face.axis % 3)] = if face.high { 1.0 } else { -1.0 };
            return Some(n);
        };
        let mut own = [f64::from(stored[0]), f64::from(stored[1]), f64::from(stored[2])];
        if let Some(cells) = &self.cells {
            let own = self.of_cells(cells, around, seen, line, own);
            let [x, y, z] = self.space.spacing_mm();
            return Some([own[0] / x, own[1] / y, own[2] / z]);
        }
        if let Some(face) = seen.face()
            && let Some(turned) = self.facing(around, seen, face, &line, stored)
        {
            own = turned;
        }
        Some(if self.smoothing == Smoothing::Blended { self.blended(around, seen, line, own) } else { own })
    }

    /// World unit vector out of the body by the stored normal; `None` without one.
    pub(crate) fn outward(&self, seen: PixelHit) -> Option<[f64; 3]> {
        Some(self.to_world(self.stored(seen, 0)?.map(f64::from)))
    }

    /// Cosine of the angle between that vector and a direction of the world, both in the frame of the box: a placement
    /// that stretches a body also stretches the errors of its normals.
    pub(crate) fn along(&self, seen: PixelHit, direction: [f64; 3]) -> Option<f64> {
        let stored = self.stored(seen, 0)?.map(f64::from);
        let normal = if self.cells.is_some() { self.space.index_normal_to_frame(stored) } else { stored };
        let direction = self.space.direction_to_frame(direction);
        Some(dot(normal, direction) / (dot(normal, normal) * dot(direction, direction)).sqrt())
    }

    /// Like [`Self::outward`], blended between the boxes around.
    pub(crate) fn smooth_outward(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: Line,
    ) -> Option<[f64; 3]> {
        let stored = self.stored(seen, 0)?.map(f64::from);
        Some(self.to_world(self.blended(around, seen, || line, stored)))
    }

    fn to_world(self, normal: [f64; 3]) -> [f64; 3] {
        if self.cells.is_some() {
            self.space.index_normal_to_world(normal)
        } else {
            self.space.normal_to_world(normal)
        }
    }

    /// The normal stored for the box at a distance behind the hit box in file order, in the frame of the box, with
    /// sizes of components that add up to [`normal::SCALE`].
    #[inline]
    fn stored(&self, seen: PixelHit, distance: i64) -> Option<[i32; 3]> {
        let number = seen.box_number.wrapping_add_signed(distance);
        match seen.kind {
            HitKind::Voxel => self.view.voxel_direction(BoxIndex::new(number).voxel(self.view.node_count())),
            HitKind::Node => self.view.node_normal(NodeIndex::new(number)).map(normal::decode_l1),
            HitKind::Own | HitKind::Larger(_) => Some(normal::decode_l1(seen.code)),
            HitKind::Cut => None,
        }
    }

    /// A stored normal in the frame of the box, turned to the visible side; `None` where it stays.
    #[inline]
    fn facing(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        face: Face,
        line: impl Fn() -> Line,
        stored: [i32; 3],
    ) -> Option<[f64; 3]> {
        let space = self.space;
        // In voxels instead of millimetres: a normal's components grow with the spacing.
        let spacing = space.spacing_mm();
        let scale = |n: [i32; 3]| {
            [f64::from(n[0]) * spacing[0], f64::from(n[1]) * spacing[1], f64::from(n[2]) * spacing[2]]
        };
        let in_voxels = scale(stored);
        let struck = || self.struck(seen, face, line);
        let cubes = self.has_cubes();
        let near = if cubes { self.codes_near(seen) } else { None };
        let neighbourhood = match &near {
            Some(codes) => repair::neighbourhood_of(codes),
            None => repair::neighbourhood(|distance| match self.stored(seen, distance) {
                Some(other) if cubes => repair::alike_whole(stored, other, normal::SCALE),
                Some(other) => repair::alike(in_voxels, scale(other)),
                None => true,
            }),
        };
        let shown = repair::shown(self.view, around, face, struck, in_voxels, neighbourhood)?;
        Some([shown[0] / spacing[0], shown[1] / spacing[1], shown[2] / spacing[2]])
    }

    /// Details of the hit on a box.
    #[inline]
    fn struck(&self, seen: PixelHit, face: Face, line: impl Fn() -> Line) -> repair::Struck {
        let edge_log2 = if seen.kind == HitKind::Voxel { 0 } else { self.lod_edge_log2 };
        let (origin, sight) = line();
        let world = add_scaled(origin, f64::from(seen.depth), sight);
        let edge = f64::from(1_u32 << edge_log2.min(31));
        let at = self.space.world_to_grid().apply(world);
        let at = [at[0] / edge, at[1] / edge, at[2] / edge];
        repair::Struck { number: seen.box_number, at, edge_log2, face }
    }

    fn has_cubes(&self) -> bool {
        let spacing = self.space.spacing_mm();
        spacing[0] == spacing[1] && spacing[1] == spacing[2]
    }

    /// Codes of a box, of the four before and of the four after it.
    #[inline]
    fn codes_near(&self, seen: PixelHit) -> Option<[u16; 9]> {
        match seen.kind {
            HitKind::Voxel => {
                let voxel = BoxIndex::new(seen.box_number).voxel(self.view.node_count());
                self.view.voxel_normals_near(voxel)
            }
            HitKind::Node => self.view.node_normals_near(NodeIndex::new(seen.box_number)),
            HitKind::Own | HitKind::Larger(_) | HitKind::Cut => None,
        }
    }

    /// Transforms normals of a tile in the frame of the boxes, by axis, to world unit vectors.
    pub(super) fn to_units(self, form: Form, in_boxes: &mut [[f64; RAYS]; 3]) {
        self.space.normals_to_world(form, false, in_boxes);
    }

    /// True if normals of one face of a box may vary with position.
    pub(super) fn differ_by_place(&self) -> bool {
        match self.smoothing {
            Smoothing::Stored => false,
            Smoothing::Smooth => self.cells.is_some(),
            Smoothing::Blended => true,
        }
    }

    /// Edge of a voxel in mm, if the normals of a tile can be judged all at once.
    pub(super) fn judged_together(&self) -> Option<f64> {
        let plain = self.cells.is_none() && self.smoothing != Smoothing::Blended && self.has_cubes();
        plain.then(|| self.space.spacing_mm()[0])
    }

    /// Notes the hit of a pixel, to be judged together with others; `false` if it must be handled alone.
    #[inline]
    pub(super) fn note(&self, stored: &mut Stored, pixel: usize, seen: PixelHit) -> bool {
        let found = seen.face().zip(self.codes_near(seen));
        if let Some((face, codes)) = &found {
            stored.set(pixel, codes, *face);
        }
        found.is_some()
    }

    /// The scatter of the boxes around a noted pixel whose normal is doubtful; `None` where the normal stays.
    #[inline]
    pub(super) fn scatter(
        &self,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
    ) -> Option<[f64; 6]> {
        repair::scatter_around(self.view, around, &self.struck(seen, seen.face()?, line))
    }
}

/// A mean of normals in cells, turned back to the edge of the visible side where it points away.
///
/// Near silhouettes the mean of the cells around may point away from the eye though their surface is visible. Light
/// falls on both sides of a surface, so it would come from the opposite side there: dark dots on bright ridges, bright
/// ones on dark. A surface that points away by more is seen from within.
fn not_away(own: [f64; 3], mean: [f64; 3], sight: [f64; 3], spacing: [f64; 3]) -> [f64; 3] {
    let away = dot(mean, sight);
    if away <= 0.0 {
        return mean;
    }
    // The line of sight as a normal, and the squares of lengths in mm.
    let normal: [f64; 3] = std::array::from_fn(|a| sight[a] * spacing[a] * spacing[a]);
    let of_sight = dot(sight, normal);
    let of_mean = (0..3).fold(0.0, |sum, a| sum + (mean[a] / spacing[a]) * (mean[a] / spacing[a]));
    if dot(own, sight) >= 0.0 && away * away > GRAZING * GRAZING * of_sight * of_mean {
        return mean;
    }
    let share = SEEN * away / of_sight;
    [0, 1, 2].map(|a| mean[a] - share * normal[a])
}

/// Unit vector against a line of sight.
pub(super) fn towards_eye((_, sight): Line) -> [f64; 3] {
    let length = dot(sight, sight).sqrt();
    sight.map(|c| -c / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_that_looks_away_is_drawn_back_to_the_side_that_is_seen() {
        // Down the z axis through cells of 1 x 1 x 4 mm.
        let (sight, spacing) = ([0.1, 0.0, -1.0], [1.0, 1.0, 4.0]);
        let towards = [0.3, 0.1, 1.0];
        assert_eq!(not_away(towards, towards, sight, spacing), towards);
        // A ridge that faces up keeps its slope, and is seen from the visible side.
        let drawn = not_away(towards, [0.0, 1.0, -0.3], sight, spacing);
        assert!(dot(drawn, sight) < 0.0 && dot(drawn, sight) > -0.1 && drawn[1] == 1.0, "{drawn:?}");
        // On a surface seen from within both point away.
        let within = [0.0, 0.2, -1.0];
        assert_eq!(not_away(within, within, sight, spacing), within);
        let grazing = not_away([0.0, 1.0, -0.1], [0.0, 1.0, -0.1], sight, spacing);
        assert!(dot(grazing, sight) < 0.0, "{grazing:?}");
    }
}
