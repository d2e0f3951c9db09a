//! What a ray saw, and the normal that is shown there.

use crate::format::normal;
use crate::geom::{BoxIndex, NodeIndex, VoxelIndex, add_scaled, dot};
use crate::load::{ModelView, NodeView};

use super::around::Surroundings;
use super::blend;
use super::cells::Cells;
use super::facing::{self, tile::Stored};
use super::ray::Face;
use super::space::GridSpace;
use super::traverse::{Hit, Trace};

/// Line of sight in the world: origin and direction.
pub(crate) type Line = ([f64; 3], [f64; 3]);

/// A pixel's hit in 16 bytes.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    box_number: u64,
    /// Depth in mm; NaN for background.
    depth: f32,
    /// Axis and side of the face, or [`Seen::NO_FACE`].
    face: u8,
    kind: SeenKind,
    /// The normal's code, where it is not that of the box.
    code: u16,
}

/// Where the normal of a hit comes from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SeenKind {
    Voxel,
    Node,
    /// The hit itself: of a cell with corners, whose normal is not the same everywhere.
    Own,
}

impl Seen {
    const NO_FACE: u8 = u8::MAX;
    /// Background.
    pub(super) const NOTHING: Self =
        Self { box_number: 0, depth: f32::NAN, face: Self::NO_FACE, kind: SeenKind::Node, code: 0 };

    #[expect(clippy::cast_possible_truncation, reason = "a depth image has 16 bits")]
    pub(super) fn new(trace: &Trace) -> Self {
        trace.hit.map_or(Self::NOTHING, |hit| Self {
            box_number: hit.box_number,
            depth: (hit.t as f32).min(f32::MAX),
            face: hit.face.map_or(Self::NO_FACE, |f| 2 * f.axis + u8::from(f.high)),
            kind: if hit.edge_log2 == 0 { SeenKind::Voxel } else { SeenKind::Node },
            code: 0,
        })
    }

    pub(super) fn is_hit(self) -> bool {
        !self.depth.is_nan()
    }

    /// Breadth-first number of the box.
    pub(super) fn box_number(self) -> u64 {
        self.box_number
    }

    /// Is it a voxel or cell, not a coarser box?
    pub(super) fn is_finest(self) -> bool {
        self.kind != SeenKind::Node
    }

    /// Depth in mm; NaN for background.
    pub(super) fn depth(self) -> f32 {
        self.depth
    }

    /// Is its normal that of the face of a box, whatever the line of sight?
    #[inline]
    pub(super) fn is_of_face(self) -> bool {
        self.face != Self::NO_FACE && self.kind != SeenKind::Own
    }

    /// Of every face of every box another.
    #[inline]
    pub(super) fn key(self) -> u64 {
        self.box_number.wrapping_mul(8) | u64::from(self.face)
    }

    fn face(self) -> Option<Face> {
        (self.face != Self::NO_FACE).then(|| Face::new(usize::from(self.face / 2), self.face % 2 == 1))
    }
}

/// A world point in the coordinates of a cell, -1..=1.
pub(super) fn cell_coordinates(space: &GridSpace, cell: [u32; 3], world: [f64; 3]) -> [f64; 3] {
    let at = space.to_grid(world);
    std::array::from_fn(|a| (2.0 * (at[a] - f64::from(cell[a])) - 1.0).clamp(-1.0, 1.0))
}

/// Finds the normals of a model in its place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Normals<'a> {
    view: &'a ModelView<'a>,
    /// The cells, if the model has them: normals are of index space then.
    cells: Option<Cells<'a>>,
    space: &'a GridSpace,
    blended: bool,
    /// Have normals 24 bits?
    fine: bool,
    lod_edge_log2: u32,
}

impl<'a> Normals<'a> {
    /// Of a model; `blended` between the boxes around a hit, where hits may be boxes of `2^lod_edge_log2`.
    pub(crate) fn new(
        view: &'a ModelView<'a>,
        space: &'a GridSpace,
        blended: bool,
        lod_edge_log2: u32,
    ) -> Self {
        let fine = view.voxel_fine(VoxelIndex::new(0)).is_some();
        Self { view, cells: view.cells().map(Cells::new), space, blended, fine, lod_edge_log2 }
    }

    /// What was seen along a line.
    #[inline]
    pub(crate) fn seen(&self, trace: &Trace, line: impl FnOnce() -> Line) -> Seen {
        let mut seen = Seen::new(trace);
        if let (Some(cells), Some(hit)) = (&self.cells, &trace.hit)
            && seen.kind == SeenKind::Voxel
            && cells.has_corners(hit.box_number.wrapping_sub(self.view.node_count()))
        {
            (seen.kind, seen.code) = (SeenKind::Own, self.corner_normal(cells, hit, line()));
        }
        seen
    }

    /// Code of the normal where a cell with corners was hit.
    #[cold]
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    fn corner_normal(&self, cells: &Cells<'_>, hit: &Hit, (origin, direction): Line) -> u16 {
        let at = std::array::from_fn(|i| origin[i] + hit.t * direction[i]);
        let number = hit.box_number.wrapping_sub(self.view.node_count());
        let u = cell_coordinates(self.space, hit.cell, at);
        normal::encode(cells.normal(number, u).map(|c| c as f32))
    }

    /// A normal of the hit's box, blended with those of the boxes around where that is wanted.
    #[inline]
    fn blended(&self, seen: Seen, line: impl Fn() -> Line, own: [f64; 3]) -> [f64; 3] {
        if !self.blended || seen.kind == SeenKind::Node {
            return own;
        }
        let (origin, sight) = line();
        let world = add_scaled(origin, f64::from(seen.depth), sight);
        blend::blended(self.view, self.space.to_grid(world), own)
    }

    /// World normal: the stored one unless the skin around contradicts it, else that of the face, else towards
    /// the eye. The plane of a cell is the surface itself; nothing contradicts it.
    pub(crate) fn normal(&self, around: &mut Surroundings, seen: Seen, line: Line) -> [f64; 3] {
        match self.in_boxes(around, seen, || line) {
            Some(normal) => self.space.normal_to_world(normal),
            None => towards_eye(line),
        }
    }

    /// The same in the frame of the boxes, of any length; `None` towards the eye.
    #[inline]
    pub(super) fn in_boxes(
        &self,
        around: &mut Surroundings,
        seen: Seen,
        line: impl Fn() -> Line,
    ) -> Option<[f64; 3]> {
        let Some(stored) = self.stored(seen, 0) else {
            let face = seen.face()?;
            let mut n = [0.0; 3];
            n[usize::from(face.axis % 3)] = if face.high { 1.0 } else { -1.0 };
            return Some(n);
        };
        let mut own = [f64::from(stored[0]), f64::from(stored[1]), f64::from(stored[2])];
        if self.cells.is_some() {
            let own = self.blended(seen, line, own);
            let [x, y, z] = self.space.spacing_mm();
            return Some([own[0] / x, own[1] / y, own[2] / z]);
        }
        if let Some(face) = seen.face()
            && let Some(turned) = self.facing(around, seen, face, &line, stored)
        {
            own = turned;
        }
        Some(self.blended(seen, line, own))
    }

    /// Unit vector of the world out of the body, as it is stored; `None` where none is stored.
    pub(crate) fn outward(&self, seen: Seen) -> Option<[f64; 3]> {
        Some(self.to_world(self.stored(seen, 0)?.map(f64::from)))
    }

    /// Cosine of the angle between that vector and a direction of the world, both in the frame of the box: a placement
    /// that draws a body out draws out what its normals err by, too.
    pub(crate) fn along(&self, seen: Seen, direction: [f64; 3]) -> Option<f64> {
        let stored = self.stored(seen, 0)?.map(f64::from);
        let normal = if self.cells.is_some() { self.space.index_normal_to_frame(stored) } else { stored };
        let direction = self.space.direction_to_frame(direction);
        Some(dot(normal, direction) / (dot(normal, normal) * dot(direction, direction)).sqrt())
    }

    /// The same, blended where that is wanted.
    pub(crate) fn smooth_outward(&self, seen: Seen, line: Line) -> Option<[f64; 3]> {
        Some(self.to_world(self.blended(seen, || line, self.stored(seen, 0)?.map(f64::from))))
    }

    fn to_world(self, normal: [f64; 3]) -> [f64; 3] {
        if self.cells.is_some() {
            self.space.index_normal_to_world(normal)
        } else {
            self.space.normal_to_world(normal)
        }
    }

    /// The normal stored for the box so far behind the one that was hit in the order of the file, in the frame of
    /// the box, its parts' sizes adding up to [`normal::FINE_SCALE`].
    #[inline]
    fn stored(&self, seen: Seen, distance: i64) -> Option<[i32; 3]> {
        let number = seen.box_number.wrapping_add_signed(distance);
        let coarse = |code| normal::decode_fine(code, normal::FINE_NONE);
        match seen.kind {
            SeenKind::Voxel => self.view.voxel_direction(BoxIndex::new(number).voxel(self.view.node_count())),
            SeenKind::Node => self.view.node_normal(NodeIndex::new(number)).map(coarse),
            SeenKind::Own => Some(coarse(seen.code)),
        }
    }

    /// A stored normal in the frame of the box, turned to the side that is seen; `None` where it stays.
    #[inline]
    fn facing(
        &self,
        around: &mut Surroundings,
        seen: Seen,
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
        let near = if cubes && !self.fine { self.codes_near(seen) } else { None };
        let company = match &near {
            Some(codes) => facing::company_of(codes),
            None => facing::company(|distance| match self.stored(seen, distance) {
                Some(other) if cubes => facing::alike_whole(stored, other, normal::FINE_SCALE),
                Some(other) => facing::alike(in_voxels, scale(other)),
                None => true,
            }),
        };
        let shown = facing::shown(self.view, around, face, struck, in_voxels, company)?;
        Some([shown[0] / spacing[0], shown[1] / spacing[1], shown[2] / spacing[2]])
    }

    /// Where a box was hit.
    #[inline]
    fn struck(&self, seen: Seen, face: Face, line: impl Fn() -> Line) -> facing::Struck {
        let edge_log2 = if seen.kind == SeenKind::Voxel { 0 } else { self.lod_edge_log2 };
        let (origin, sight) = line();
        let world = add_scaled(origin, f64::from(seen.depth), sight);
        let edge = f64::from(1_u32 << edge_log2.min(31));
        let at = self.space.world_to_grid().apply(world);
        let at = [at[0] / edge, at[1] / edge, at[2] / edge];
        facing::Struck { number: seen.box_number, at, edge_log2, face }
    }

    fn has_cubes(&self) -> bool {
        let spacing = self.space.spacing_mm();
        spacing[0] == spacing[1] && spacing[1] == spacing[2]
    }

    /// Codes of a box, of the four before and of the four behind it.
    #[inline]
    fn codes_near(&self, seen: Seen) -> Option<[u16; 9]> {
        match seen.kind {
            SeenKind::Voxel => {
                let voxel = BoxIndex::new(seen.box_number).voxel(self.view.node_count());
                self.view.voxel_normals_near(voxel)
            }
            SeenKind::Node => self.view.node_normals_near(NodeIndex::new(seen.box_number)),
            SeenKind::Own => None,
        }
    }

    /// Can the normals of a tile be judged all at once? Edge of a voxel in mm, if so.
    pub(super) fn judged_together(&self) -> Option<f64> {
        let plain = self.cells.is_none() && !self.fine && !self.blended && self.has_cubes();
        plain.then(|| self.space.spacing_mm()[0])
    }

    /// Notes what a pixel hit, to be judged together with others; `false` where it must be looked at alone.
    #[inline]
    pub(super) fn note(&self, stored: &mut Stored, pixel: usize, seen: Seen) -> bool {
        let found = seen.face().zip(self.codes_near(seen));
        if let Some((face, codes)) = &found {
            stored.set(pixel, codes, *face);
        }
        found.is_some()
    }

    /// The scatter of the boxes around a pixel that was noted, but is in doubt; `None` where its normal stays.
    #[inline]
    pub(super) fn scatter(
        &self,
        around: &mut Surroundings,
        seen: Seen,
        line: impl Fn() -> Line,
    ) -> Option<[f64; 6]> {
        facing::scatter_around(self.view, around, &self.struck(seen, seen.face()?, line))
    }
}

/// Unit vector against a line of sight.
pub(super) fn towards_eye((_, sight): Line) -> [f64; 3] {
    let length = dot(sight, sight).sqrt();
    sight.map(|c| -c / length)
}
