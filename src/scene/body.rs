//! A model in its place: intersection with lines of the scene.
//!
//! A line is transformed to the model's grid and rounded there, once; all that follows is in integers. Intersections
//! are given as t along the line of the scene, so that bodies can be compared.
//!
//! A line that starts at a body leaves the box around its start first ([`crate::render::ray_offset`]). Beyond it a flat line
//! may still meet steps of the staircase of boxes that it started on. The normals reveal them: a line outside a solid
//! enters through faces that look at it, and exits through faces that look along it. So within [`STAIR`] boxes of its
//! start a hit whose stored normal contradicts this is a step of the staircase, and is skipped. The test is made in the
//! frame of the body's own boxes, where its normals are as good as they were stored, however it is placed. Beyond that,
//! every hit counts: a thin sheet has normals of one side only. Without stored normals every hit counts as well, and
//! the boxes on all sides of the start are left at once.

use std::sync::OnceLock;

use crate::cpu::Form;
use crate::format::Walls;
use crate::geom::{Affine, Dims, VoxelIndex, add_scaled, dot};
use crate::load::{ModelView, NodeView};
use crate::render::batch::Batch;
use crate::render::cells::Cells;
use crate::render::colors::{color_of, first_voxel};
use crate::render::normals::neighborhood::Neighborhood;
use crate::render::normals::shading_normal::{Line, NEAR_WALL, Normals, PixelHit, cell_coordinates};
use crate::render::ray::Ray;
use crate::render::ray_offset::{REACH, leaving};
use crate::render::shade::{Shader, linear_of};
use crate::render::space::Bounds;
use crate::render::surface::Skin;
use crate::render::traverse::Hit;
use crate::render::walls::Hidden;
use crate::render::{GridSpace, RenderError, Smoothing, single};

use super::clip::{Clip, Span};
use super::labels::Opacity;
use super::material::{Colors, Material};

/// Distance from its start, in boxes, up to which a line is held to the side that it runs on.
const STAIR: f64 = 32.0;

/// Most steps that a line skips: a line changes its box at most three times in each.
const MAX_STEPS: u32 = 128;

/// Largest component along a line of a unit normal that still counts as across it: normals are stored to within a
/// degree, and estimated to within two or three.
const ACROSS: f64 = 0.05;

/// Largest distance along a line, in boxes, between boxes of one wall.
const WALL: f64 = 1.75;

/// A model, its place in the scene, and its material.
#[derive(Debug)]
pub struct Instance<'a> {
    pub(crate) view: &'a ModelView<'a>,
    pub(crate) space: GridSpace,
    /// Number of the file: models of one file share it.
    pub(crate) file: usize,
    pub(super) material: Material,
    colors: Option<Colors<'a>>,
    opacity: Option<Opacity<'a>>,
    pub(crate) clip: Clip,
    /// Bounds of the visible labels; found when a camera is first placed.
    visible: OnceLock<Bounds>,
}

impl<'a> Instance<'a> {
    /// A model with this affine, moved by `placement` from its own millimetres to the scene.
    ///
    /// Instances of a file share their `view`, and have the same `file` number.
    ///
    /// # Errors
    /// [`RenderError`] if the placement leaves it without a volume.
    pub fn new(
        (view, file): (&'a ModelView<'a>, usize),
        dims: Dims,
        affine: &Affine,
        placement: &Affine,
        material: Material,
        clip: Clip,
    ) -> Result<Self, RenderError> {
        Ok(Self {
            view,
            space: GridSpace::placed(dims, affine, placement)?,
            file,
            material,
            colors: None,
            opacity: None,
            clip,
            visible: OnceLock::new(),
        })
    }

    /// A model in the place of its affine, in its own colours, if it has them.
    ///
    /// # Errors
    /// [`RenderError`] where its axes span no volume.
    pub(crate) fn alone(view: &'a ModelView<'a>, dims: Dims, affine: &Affine) -> Result<Self, RenderError> {
        let space = GridSpace::new(dims, affine)?;
        let (material, clip, colors) = (Material::default(), Clip::default(), Colors::stored(view));
        Ok(Self { view, space, file: 0, material, colors, opacity: None, clip, visible: OnceLock::new() })
    }

    /// This model with another material and cut.
    #[must_use]
    pub(crate) fn made_of(self, material: Material, clip: Clip) -> Self {
        Self { material, clip, ..self }
    }

    /// True if its colours show measured values.
    pub(crate) fn shows_values(&self) -> bool {
        matches!(self.colors, Some(Colors::Stored)) && self.view.value_colors().is_some()
    }

    /// This model in other colours.
    #[must_use]
    pub(crate) fn colored(self, colors: Option<Colors<'a>>) -> Self {
        Self { colors, ..self }
    }

    /// This model with labels, some of which may be hidden or not solid.
    #[must_use]
    pub(crate) fn labelled(self, opacity: Option<Opacity<'a>>) -> Self {
        Self { opacity, visible: OnceLock::new(), ..self }
    }

    /// True if some labels let a part of the light through, but are visible.
    pub(super) fn is_translucent(&self) -> bool {
        self.opacity.as_ref().is_some_and(Opacity::is_translucent)
    }

    /// The level shown when `asked` is requested: 0 if labels of single voxels matter, since some are not solid or are
    /// cut open.
    pub(crate) fn level(&self, asked: u32) -> u32 {
        let is_exact = self.is_dimmed() || self.opacity.is_some() && !self.clip.is_empty();
        if is_exact { 0 } else { asked }
    }

    /// True if there are labels that are not solid.
    pub(super) fn is_dimmed(&self) -> bool {
        self.opacity.as_ref().is_some_and(|opacity| !opacity.is_solid())
    }

    /// The visible label at a hit: at a wall between two, the one behind, or where that is hidden the one before.
    fn label(&self, line: Line, hit: &Hit) -> Option<u16> {
        let (opacity, [before, behind]) = (self.opacity.as_ref()?, self.sides(line, hit)?);
        Some(if opacity.part(behind) > 0.0 { behind } else { before })
    }

    /// The labels before and behind a hit; `None` without walls.
    pub(super) fn sides(&self, line: Line, hit: &Hit) -> Option<[u16; 2]> {
        Some(self.beside(&self.view.walls(hit.voxel(self.view)?)?, line, hit))
    }

    /// The labels before and behind a hit in a cell with these walls.
    pub(super) fn beside(&self, walls: &Walls, line: Line, hit: &Hit) -> [u16; 2] {
        let u = cell_coordinates(&self.space, hit.cell, add_scaled(line.0, hit.t, line.1));
        let way = self.space.world_to_grid().apply_vector(line.1);
        [way.map(|c| -c), way].map(|way| walls.met(u, way, NEAR_WALL).0)
    }

    /// The labels invisible to sight; `None` for a model without labels.
    pub(super) fn hidden(&self) -> Option<&Hidden> {
        Some(self.opacity.as_ref()?.hidden(true))
    }

    /// The part of the light that stops at a hit.
    pub(super) fn opacity(&self, line: Line, hit: &Hit) -> f64 {
        let part = |opacity: &Opacity<'_>| Some(opacity.part(self.label(line, hit)?));
        self.opacity.as_ref().and_then(part).unwrap_or(1.0)
    }

    /// The number of the visible label at a hit; 0 without one.
    pub(super) fn label_number(&self, line: Line, hit: &Hit) -> u16 {
        self.label(line, hit).unwrap_or(0)
    }

    /// The colour of a label.
    pub(super) fn label_color(&self, label: u16) -> Option<[f64; 3]> {
        self.opacity.as_ref().filter(|_| self.colors.is_some())?.color(label).map(linear_of)
    }

    /// Greatest `direction . p` over the model's points p, in mm.
    pub(crate) fn support(&self, direction: [f64; 3]) -> f64 {
        self.space.support(self.view, direction)
    }

    /// [`Instance::support`] of the inside of what is visible, as `oct info` measures extents; -inf if all is hidden.
    pub(crate) fn support_of_inside(&self, direction: [f64; 3]) -> f64 {
        if self.is_invisible() {
            return f64::NEG_INFINITY;
        }
        self.space.support_of_inside(self.view, direction, self.visible(&|| {}))
    }

    /// [`Instance::support`] of what is visible, with boxes of 2^`finest` voxels, or cells where labels are hidden; -inf if
    /// all are. `look` is called now and then during a long search.
    pub(crate) fn support_to(&self, direction: [f64; 3], finest: u32, look: &dyn Fn()) -> f64 {
        if self.is_invisible() {
            return f64::NEG_INFINITY;
        }
        match self.visible(look) {
            Some(visible) => self.space.support_of_visible(self.view, direction, visible, look),
            None => self.space.support_to(self.view, direction, finest),
        }
    }

    fn is_invisible(&self) -> bool {
        self.opacity.as_ref().is_some_and(Opacity::is_invisible)
    }

    /// The hidden labels, and bounds of the visible ones; `None` if no label is hidden.
    fn visible(&self, look: &dyn Fn()) -> Option<(&Hidden, Bounds)> {
        let hidden = self.opacity.as_ref().filter(|opacity| opacity.hides_some())?.hidden(true);
        let bounds = || self.space.bounds_of_visible(self.view, hidden, look);
        Some((hidden, *self.visible.get_or_init(bounds)))
    }
}

/// The side of a body's surface that a line runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Outside,
    Inside,
}

/// Start of a line on a body.
#[derive(Clone, Copy, Debug)]
pub(super) enum Start {
    /// At the surface, on this side of it.
    Surface { hit: Hit, side: Side },
    /// At the cut by this plane.
    Cut { plane: usize },
    /// Behind a wall of a label that is not solid.
    Through { hit: Hit },
}

/// Purpose of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RayKind {
    /// Sight, which meets every label that is not hidden.
    PixelRays,
    /// Light, which meets the solid labels.
    Light,
}

/// The place where a line meets a body.
#[derive(Clone, Copy, Debug)]
pub(super) enum SurfaceHit {
    /// The surface; t of the hit is along the line.
    Surface(Hit),
    /// The interior cut open by a plane, with its label, if it has one.
    Cut { plane: usize, t: f64, label: Option<u16> },
}

impl SurfaceHit {
    pub(super) fn t(&self) -> f64 {
        match self {
            Self::Surface(hit) => hit.t,
            Self::Cut { t, .. } => *t,
        }
    }
}

/// The inside segment of a line within a box of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    /// Hit at its beginning.
    pub(super) hit: Hit,
    /// t at its end.
    pub(super) leave: f64,
    /// True if it ends within the box.
    is_open: bool,
}

/// A line on its way to a body.
#[derive(Clone, Copy, Debug)]
pub(super) struct BodyRay {
    line: Line,
    /// t at its start.
    least: f64,
    span: Span,
    purpose: RayKind,
    /// Hit where the line left the body last, and the side that it runs on.
    from: Option<(Hit, Side)>,
}

/// Result for a line before its ray is traced.
enum Begun {
    SurfaceHit(SurfaceHit),
    BodyRay(BodyRay),
}

/// A part with the data that its lines need.
#[derive(Debug)]
pub(super) struct Body<'a> {
    pub(super) part: &'a Instance<'a>,
    pub(super) normals: Normals<'a>,
    pub(super) cells: Option<Cells<'a>>,
    /// The cells that light meets: labels that let some of it through are left out.
    solids: Option<Cells<'a>>,
    pub(super) form: Form,
    /// Base-2 logarithm of the edge of nodes that count as surface.
    pub(super) level: u32,
    /// Boxes around the starting box that a line leaves at once.
    reach: u32,
    /// Corners of the grid that enclose the surface with a margin of one box; found by the first line that goes alone.
    bounds: OnceLock<[[f64; 3]; 2]>,
}

impl<'a> Body<'a> {
    /// A body with boxes of `2^level` voxels as its surface, as far as [`Instance::level`] allows.
    pub(super) fn of(part: &'a Instance<'a>, form: Form, smoothing: Smoothing, level: u32) -> Self {
        let dimmed = part.opacity.as_ref().filter(|opacity| !opacity.is_solid());
        let level = part.level(level);
        let cells = |of_sight: bool| {
            // Coarse boxes are solid, in models of cells as well, except for larger leaves among them.
            let items = part.view.cells().filter(|_| level == 0 || part.view.has_leaves())?;
            let hidden = dimmed.map(|opacity| opacity.hidden(of_sight));
            Some(hidden.map_or(Cells::new(items), |hidden| Cells::new(items).hiding(hidden, 0)))
        };
        let knows_sides = part.view.cells().is_some() || part.view.voxel_normal(VoxelIndex::new(0)).is_some();
        Self {
            part,
            normals: Normals::new(part.view, &part.space, smoothing, level),
            cells: cells(true),
            solids: cells(false),
            form,
            level,
            reach: if knows_sides { 0 } else { REACH },
            bounds: OnceLock::new(),
        }
    }

    /// The stored form of a hit in a pixel, and the visible label there where some are not solid; else 0.
    pub(super) fn pixel(&self, line: Line, met: &SurfaceHit) -> (PixelHit, u16) {
        match met {
            SurfaceHit::Cut { plane, t, label } => (PixelHit::cut(*plane, *t, label.unwrap_or(0)), 0),
            SurfaceHit::Surface(hit) => {
                let label = if self.part.is_dimmed() { self.part.label_number(line, hit) } else { 0 };
                (self.normals.seen(hit, || line), label)
            }
        }
    }

    /// Linear RGB of such a pixel.
    #[inline]
    pub(super) fn color(
        &self,
        shader: &Shader,
        seen: PixelHit,
        label: u16,
        line: impl Fn() -> Line,
    ) -> [f64; 3] {
        let (part, own) = (self.part, self.part.material.color);
        if let Some((plane, label)) = seen.cut_of() {
            let cap = part.clip.planes().get(plane).and_then(|plane| plane.cap);
            return part.label_color(label).or(cap).unwrap_or(own);
        }
        match &part.colors {
            None => own,
            Some(Colors::Stored) if label > 0 => part.label_color(label).unwrap_or(own),
            Some(Colors::Stored) => {
                let named = part.view.labels().and_then(|_| self.normals.label(seen, line()));
                let label = named.map(|label| shader.decode(label.color));
                label.or_else(|| color_of(part.view, shader, seen)).unwrap_or(own)
            }
            Some(colors) => first_voxel(part.view, seen).and_then(|voxel| colors.color(voxel)).unwrap_or(own),
        }
    }

    /// True if a line of the grid misses the surface by a box or more.
    fn passes_by(&self, origin: [f64; 3], direction: [f64; 3]) -> bool {
        let [low, high] = *self.bounds.get_or_init(|| bounds(self.part));
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for a in 0..3 {
            let (one, other) = ((low[a] - origin[a]) / direction[a], (high[a] - origin[a]) / direction[a]);
            // A line along a wall divides by 0, which gives NaN if it starts in one: such values are not compared.
            if one < other {
                (enter, leave) = (enter.max(one), leave.min(other));
            } else if other < one {
                (enter, leave) = (enter.max(other), leave.min(one));
            }
        }
        enter > leave
    }

    /// First hit of a ray of the grid.
    fn trace(&self, purpose: RayKind, ray: &Ray) -> Option<Hit> {
        match if purpose == RayKind::PixelRays { &self.cells } else { &self.solids } {
            Some(cells) => single::trace(self.form, self.part.view, cells, ray, self.level).hit,
            None => single::trace(self.form, self.part.view, &Skin, ray, self.level).hit,
        }
    }

    /// First hits of rays of light in the grid.
    pub(super) fn nearest(&self, batch: &mut Batch, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        match &self.solids {
            Some(cells) => batch.nearest(self.part.view, cells, rays, self.level, hits),
            None => batch.nearest(self.part.view, &Skin, rays, self.level, hits),
        }
    }

    /// A line from t = `least` on, or from its exit from the boxes around `from`, as a ray of the grid; and t at the
    /// ray's start. `None` if it misses the surface.
    pub(super) fn ray(&self, line: Line, least: f64, from: Option<&Hit>) -> Option<(Ray, f64)> {
        self.ray_beyond(line, least, from.map(|hit| (hit, self.reach)))
    }

    /// Like [`Body::ray`], leaving this many boxes around the one that it starts from.
    fn ray_beyond(&self, line: Line, least: f64, from: Option<(&Hit, u32)>) -> Option<(Ray, f64)> {
        let space = &self.part.space;
        let (origin, direction) = (space.to_grid(line.0), space.world_to_grid().apply_vector(line.1));
        if self.passes_by(origin, direction) {
            return None;
        }
        match from {
            Some(from) => leaving(space, from, line.0, line.1, least),
            None => {
                Ray::new(space.dims().depth(), origin, direction, least).ok().flatten().map(|ray| (ray, 0.0))
            }
        }
    }

    /// First hit of such a line.
    fn hit(&self, purpose: RayKind, line: Line, least: f64, from: Option<&Hit>) -> Option<Hit> {
        let (ray, before) = self.ray(line, least, from)?;
        let hit = self.trace(purpose, &ray)?;
        Some(Hit { t: before + hit.t, ..hit })
    }

    /// The first intersection of a line with the body, between two values of t.
    pub(super) fn meet(
        &self,
        purpose: RayKind,
        line: Line,
        limits: [f64; 2],
        start: Option<&Start>,
    ) -> Option<SurfaceHit> {
        match self.begin(purpose, line, limits, start)? {
            Begun::SurfaceHit(met) => Some(met),
            Begun::BodyRay(way) => {
                let first = match start {
                    Some(Start::Through { hit }) if self.has_walls() => self.next_wall(line, hit),
                    _ => self.hit(purpose, line, way.span.enter, left(&way, start)),
                };
                self.follow(way, first)
            }
        }
    }

    /// The way of a line, as far as it is known without a ray.
    fn begin(&self, purpose: RayKind, line: Line, limits: [f64; 2], start: Option<&Start>) -> Option<Begun> {
        let mut span = Span::of(limits);
        if !self.part.clip.is_empty() {
            let on = match start {
                Some(Start::Cut { plane }) => Some(*plane),
                _ => None,
            };
            span = self.part.clip.span(line, limits, on)?;
            if let Some(cut) = span.by.and_then(|plane| self.cut(line, span, plane)) {
                return Some(Begun::SurfaceHit(cut));
            }
        }
        let from = match start {
            Some(Start::Surface { hit, side }) => Some((*hit, *side)),
            _ => None,
        };
        Some(Begun::BodyRay(BodyRay { line, least: limits[0], span, purpose, from }))
    }

    /// The way of a line for a batch of rays: its ray, and t at the ray's start. `Err` with the result if it is already
    /// known.
    pub(super) fn set_out(
        &self,
        line: Line,
        limits: [f64; 2],
        start: Option<&Start>,
    ) -> Result<(BodyRay, Ray, f64), Option<SurfaceHit>> {
        match self.begin(RayKind::Light, line, limits, start) {
            Some(Begun::BodyRay(way)) => {
                // As in pictures of one model: a surface is not darkened by its own steps.
                let reach = if way.from.is_some() { REACH } else { self.reach };
                let from = left(&way, start).map(|hit| (hit, reach));
                let (ray, before) = self.ray_beyond(line, way.span.enter, from).ok_or(None)?;
                Ok((way, ray, before))
            }
            Some(Begun::SurfaceHit(met)) => Err(Some(met)),
            None => Err(None),
        }
    }

    /// Resolves a way whose ray has this first hit, t along the line: skips the steps of its own staircase.
    pub(super) fn follow(&self, way: BodyRay, first: Option<Hit>) -> Option<SurfaceHit> {
        let BodyRay { line, least, span, purpose, mut from } = way;
        let mut found = first;
        let mut passed = None;
        let mut steps = 0..MAX_STEPS;
        loop {
            let Some(hit) = found else {
                // A line within must exit somewhere: if nothing follows, the hit skipped last was not a step.
                return passed.map(SurfaceHit::Surface);
            };
            if hit.t > span.leave {
                return None;
            }
            match from {
                Some((_, side))
                    if steps.next().is_some()
                        && self.is_near(line, hit.t - least)
                        && !self.comes_by(line, hit, side) =>
                {
                    passed = (side == Side::Inside).then_some(hit);
                    from = Some((hit, side));
                    found = self.hit(purpose, line, span.enter, Some(&hit));
                }
                _ => return Some(SurfaceHit::Surface(hit)),
            }
        }
    }

    /// True for a part of a line no longer than [`STAIR`] boxes.
    fn is_near(&self, line: Line, t: f64) -> bool {
        self.boxes(line, t) <= STAIR
    }

    /// Length of a part of a line, in boxes.
    pub(super) fn boxes(&self, line: Line, t: f64) -> f64 {
        let direction = self.part.space.world_to_grid().apply_vector(line.1);
        t * dot(direction, direction).sqrt()
    }

    /// True if a line on this side of a body meets its surface from that side.
    fn comes_by(&self, line: Line, hit: Hit, side: Side) -> bool {
        let seen = self.normals.seen(&hit, || line);
        let Some(along) = self.normals.along(seen, line.1) else { return true };
        match side {
            Side::Outside => along < -ACROSS,
            Side::Inside => along > ACROSS,
        }
    }

    /// Unit vector out of the body, by its normals, at a hit of a line.
    pub(super) fn outward(&self, line: Line, hit: Hit) -> Option<[f64; 3]> {
        self.normals.outward(self.normals.seen(&hit, || line))
    }

    /// Like [`Self::outward`], blended between the boxes around.
    pub(super) fn smooth_outward(&self, around: &mut Neighborhood, line: Line, hit: Hit) -> Option<[f64; 3]> {
        let seen = self.normals.seen(&hit, || line);
        self.normals.smooth_outward(around, seen, line)
    }

    /// First hits of a line in every box of the surface.
    fn hits(&self, line: Line) -> Vec<Hit> {
        let next = |last: Option<&Hit>| self.hit(RayKind::PixelRays, line, 0.0, last);
        std::iter::successors(next(None), |last| next(Some(last))).collect()
    }

    /// Inside segments of a line of this length within every box of the surface. A line in the other direction finds
    /// their ends.
    pub(super) fn stretches(&self, line: Line, length: f64) -> Vec<Stretch> {
        let back = self.hits((add_scaled(line.0, length, line.1), line.1.map(|c| -c)));
        let mut ends = back.iter().rev();
        let of = |hit: Hit| {
            let mut ahead = ends.clone();
            // A corner that is only touched may be in one list alone.
            let end = ahead.by_ref().take(8).find(|end| end.box_number == hit.box_number);
            let Some(end) = end else { return Stretch { hit, leave: hit.t, is_open: true } };
            ends = ahead;
            Stretch { hit, leave: length - end.t, is_open: end.face.is_none() }
        };
        self.hits(line).into_iter().map(of).collect()
    }

    /// The interior between two consecutive stretches of a line, as a box of the wall around it; `None` outside.
    ///
    /// For neighbouring boxes, decided in cells by the points where the line leaves one and enters the other, in voxels
    /// by their normals. For boxes farther apart that may mislead, as planes of neighbouring cells do not quite meet:
    /// lines along all axes decide.
    pub(super) fn between(&self, line: Line, one: &Stretch, other: &Stretch) -> Option<Hit> {
        let ends = match self.cells {
            Some(_) => Some((!one.is_open, other.hit.face.is_some())),
            None => {
                let along = |hit: Hit| self.outward(line, hit).map(|outward| dot(outward, line.1));
                along(one.hit).zip(along(other.hit)).map(|(one, other)| (one < 0.0, other > 0.0))
            }
        };
        let is_near = self.boxes(line, other.hit.t - one.leave) <= WALL;
        match ends {
            Some((false, false)) => None,
            Some((true, true)) if is_near => Some(one.hit),
            Some(_) if is_near && self.cells.is_some() => None,
            _ => self.within(add_scaled(line.0, (one.leave + other.hit.t) / 2.0, line.1), true),
        }
    }

    /// The cut face where a line enters by a plane, if the plane has a cap.
    fn cut(&self, line: Line, span: Span, plane: usize) -> Option<SurfaceHit> {
        self.part.clip.planes().get(plane)?.cap?;
        let at = add_scaled(line.0, span.enter, line.1);
        let label = if self.has_walls() {
            Some(self.label_at(at)?.1)
        } else {
            self.within(at, false)?;
            None
        };
        // Hidden labels have no cut face.
        let part = self.part.opacity.as_ref().zip(label).map_or(1.0, |(opacity, label)| opacity.part(label));
        (part > 0.0).then_some(SurfaceHit::Cut { plane, t: span.enter, label })
    }

    /// A box of the wall around an inside point; `None` outside. A point is inside if lines along all six axes meet the
    /// surface from within, or, where the surface may be open, more of them from within than from outside; or if it
    /// lies in a box of the surface.
    fn within(&self, at: [f64; 3], may_be_open: bool) -> Option<Hit> {
        let mut exit = None;
        let mut votes = 0;
        for axis in 0..6 {
            let mut direction = [0.0; 3];
            direction[axis / 2] = if axis % 2 == 0 { 1.0 } else { -1.0 };
            let Some(hit) = self.hit(RayKind::Light, (at, direction), 0.0, None) else {
                if may_be_open {
                    continue;
                }
                return None;
            };
            if hit.t == 0.0 && hit.face.is_none() {
                return Some(hit);
            }
            let outward = self.outward((at, direction), hit)?;
            if dot(outward, direction) > 0.0 {
                votes += 1;
                exit.get_or_insert(hit);
            } else {
                votes -= 1;
            }
        }
        exit.filter(|_| votes > 0)
    }
}

/// The box that a line leaves first.
fn left<'h>(way: &'h BodyRay, start: Option<&'h Start>) -> Option<&'h Hit> {
    match start {
        Some(Start::Through { hit }) => Some(hit),
        _ => way.from.as_ref().map(|(hit, _)| hit),
    }
}

/// Corners of the grid that enclose the surface, with a margin of one box.
fn bounds(part: &Instance<'_>) -> [[f64; 3]; 2] {
    let mut found = [[0.0; 3]; 2];
    for (a, [x, y, z, constant]) in part.space.world_to_grid().rows.into_iter().enumerate() {
        found[0][a] = constant - part.support([-x, -y, -z]) - 1.0;
        found[1][a] = constant + part.support([x, y, z]) + 1.0;
    }
    found
}
