//! A model in its place: where a line of the scene meets it.
//!
//! A line is carried into the model's grid and rounded there, once; all that follows is whole numbers. What it meets is
//! told as t along the line of the scene, so that bodies can be compared.
//!
//! A line that starts at a body leaves the boxes around its start first ([`crate::render::leave`]). Beyond them a flat
//! line may still meet a step of the stair that it started on, some boxes on. The normals tell: a line outside a solid
//! comes in by faces that look at it, and goes out by faces that look along it. So within [`STAIR`] boxes of its start a
//! hit whose stored normal says otherwise is a step of the stair, and is passed. Where no normals are stored, or beyond
//! that, every hit counts: a thin sheet has normals of one side only.

use crate::geom::{Affine, Dims};
use crate::load::NodeView;
use crate::render::cells::Cells;
use crate::render::form::Form;
use crate::render::leave::leaving;
use crate::render::ray::Ray;
use crate::render::shown::{Line, Normals};
use crate::render::space::{add_scaled, dot};
use crate::render::surface::Skin;
use crate::render::traverse::{Hit, Trace};
use crate::render::{GridSpace, RenderError, single};

use super::clip::{Clip, Span};
use super::material::Material;

/// How far from its start, in boxes, a line is held to the side that it runs on.
const STAIR: f64 = 32.0;

/// How far along a line a normal of unit length may look and still be across it: normals are stored to within a degree,
/// and estimated to within two or three.
const ACROSS: f64 = 0.05;

/// A model, its place in the scene, and what it is made of.
#[derive(Debug)]
pub struct Part<'a, V> {
    view: &'a V,
    space: GridSpace,
    /// Models of one file have one number.
    file: usize,
    material: Material,
    clip: Clip,
}

impl<'a, V: NodeView> Part<'a, V> {
    /// A model with this affine, from its millimetres put into the scene by `placement`.
    ///
    /// Instances of a file share their `view`, and have the same number of a `file`.
    ///
    /// # Errors
    /// [`RenderError::SingularAffine`] where that leaves it without a volume.
    pub fn new(
        (view, file): (&'a V, usize),
        dims: Dims,
        affine: &Affine,
        placement: &Affine,
        material: Material,
        clip: Clip,
    ) -> Result<Self, RenderError> {
        Ok(Self { view, space: GridSpace::new(dims, &placement.after(affine))?, file, material, clip })
    }

    /// Greatest `direction . p` over its points p, in mm.
    pub fn support(&self, direction: [f64; 3]) -> f64 {
        self.space.support(self.view, direction)
    }

    pub(super) fn view(&self) -> &'a V {
        self.view
    }

    pub(super) fn space(&self) -> &GridSpace {
        &self.space
    }

    pub(super) fn file(&self) -> usize {
        self.file
    }

    pub(super) fn material(&self) -> &Material {
        &self.material
    }

    pub(super) fn clip(&self) -> &Clip {
        &self.clip
    }
}

/// The side of a body's surface that a line runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Outside,
    Inside,
}

/// Where on a body a line starts.
#[derive(Clone, Copy, Debug)]
pub(super) enum Start {
    /// At its surface, on this side of it.
    Surface { hit: Hit, side: Side },
    /// Where this plane cuts it.
    Cut { plane: usize },
}

/// What a line meets.
#[derive(Clone, Copy, Debug)]
pub(super) enum Met {
    /// The surface; t of the hit is along the line.
    Surface(Hit),
    /// Matter that a plane cut open.
    Cut { plane: usize, t: f64, hit: Hit },
}

impl Met {
    pub(super) fn t(&self) -> f64 {
        match self {
            Self::Surface(hit) => hit.t,
            Self::Cut { t, .. } => *t,
        }
    }
}

/// A part with what its lines need.
#[derive(Debug)]
pub(super) struct Body<'a, V> {
    pub(super) part: &'a Part<'a, V>,
    pub(super) normals: Normals<'a, V>,
    pub(super) cells: Option<Cells<'a>>,
    form: Form,
    least_mm: f64,
    /// The surface lies between these two corners of the grid, one box aside.
    bounds: [[f64; 3]; 2],
}

impl<'a, V: NodeView> Body<'a, V> {
    pub(super) fn of(part: &'a Part<'a, V>, form: Form) -> Self {
        let [x, y, z] = part.space.spacing_mm();
        Self {
            part,
            normals: Normals::new(part.view, &part.space, true, 0),
            cells: part.view.cells().map(Cells::new),
            form,
            least_mm: x.min(y).min(z),
            bounds: bounds(part),
        }
    }

    /// Does a line of the grid pass the surface's surroundings by? Only what is a box away from them is told so.
    fn passes_by(&self, origin: [f64; 3], direction: [f64; 3]) -> bool {
        let [low, high] = self.bounds;
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for a in 0..3 {
            let (one, other) = ((low[a] - origin[a]) / direction[a], (high[a] - origin[a]) / direction[a]);
            // A line along a wall divides by 0, and has no number where it starts in one: such are not compared.
            if one < other {
                (enter, leave) = (enter.max(one), leave.min(other));
            } else if other < one {
                (enter, leave) = (enter.max(other), leave.min(one));
            }
        }
        enter > leave
    }

    /// First hit of a ray of the grid.
    fn trace(&self, ray: &Ray) -> Option<Hit> {
        match &self.cells {
            Some(cells) => single::trace(self.form, self.part.view, cells, ray, 0).hit,
            None => single::trace(self.form, self.part.view, &Skin, ray, 0).hit,
        }
    }

    /// First hit of a line from t = `least` on, or from where it leaves the boxes around `from`.
    fn hit(&self, line: Line, least: f64, from: Option<&Hit>) -> Option<Hit> {
        let space = &self.part.space;
        let (origin, direction) = (space.to_grid(line.0), space.world_to_grid().apply_vector(line.1));
        if self.passes_by(origin, direction) {
            return None;
        }
        let Some(from) = from else {
            let ray = Ray::new(space.dims().depth(), origin, direction, least).ok().flatten()?;
            return self.trace(&ray);
        };
        let (ray, before) = leaving(space, from, line.0, line.1, least)?;
        let hit = self.trace(&ray)?;
        Some(Hit { t: before + hit.t, ..hit })
    }

    /// What a line meets first between two values of t.
    pub(super) fn meet(&self, line: Line, limits: [f64; 2], start: Option<&Start>) -> Option<Met> {
        let mut from = None;
        let mut span = Span::of(limits);
        if !self.part.clip.is_empty() {
            let on = match start {
                Some(Start::Cut { plane }) => Some(*plane),
                _ => None,
            };
            span = self.part.clip.span(line, limits, on)?;
            if let Some(cut) = span.by.and_then(|plane| self.cut(line, span, plane)) {
                return Some(cut);
            }
        }
        if let Some(Start::Surface { hit, side }) = start {
            from = Some((*hit, *side));
        }
        let most = limits[0] + STAIR * self.least_mm / dot(line.1, line.1).sqrt();
        let mut passed = None;
        loop {
            let Some(hit) = self.hit(line, span.enter, from.as_ref().map(|(hit, _)| hit)) else {
                // A line within comes out somewhere: where nothing follows, what was passed last was no step.
                return passed.map(Met::Surface);
            };
            if hit.t > span.leave {
                return None;
            }
            match from {
                Some((last, side))
                    if hit.t <= most && last.cell != hit.cell && !self.comes_by(line, hit, side) =>
                {
                    passed = (side == Side::Inside).then_some(hit);
                    from = Some((hit, side));
                }
                _ => return Some(Met::Surface(hit)),
            }
        }
    }

    /// Does a line on this side of a body meet its surface from that side?
    fn comes_by(&self, line: Line, hit: Hit, side: Side) -> bool {
        let Some(outward) = self.outward(line, hit) else { return true };
        let along = dot(outward, line.1) / dot(line.1, line.1).sqrt();
        match side {
            Side::Outside => along < -ACROSS,
            Side::Inside => along > ACROSS,
        }
    }

    /// Unit vector out of the body, as its normals have it, at a hit of a line.
    pub(super) fn outward(&self, line: Line, hit: Hit) -> Option<[f64; 3]> {
        self.normals.outward(self.normals.seen(&Trace { hit: Some(hit), steps: 0 }, || line))
    }

    /// The same, blended between the boxes around.
    pub(super) fn smooth_outward(&self, line: Line, hit: Hit) -> Option<[f64; 3]> {
        self.normals.smooth_outward(self.normals.seen(&Trace { hit: Some(hit), steps: 0 }, || line), line)
    }

    /// Matter that a plane has cut open where a line comes in by it, if the plane has a cap.
    ///
    /// A point is within where lines along all six axes meet the surface, and more of them from within than from
    /// outside; or in a box of the surface.
    fn cut(&self, line: Line, span: Span, plane: usize) -> Option<Met> {
        self.part.clip.planes().get(plane)?.cap?;
        let at = add_scaled(line.0, span.enter, line.1);
        let mut first = None;
        let mut votes = 0;
        for axis in 0..6 {
            let mut direction = [0.0; 3];
            direction[axis / 2] = if axis % 2 == 0 { 1.0 } else { -1.0 };
            let hit = self.hit((at, direction), 0.0, None)?;
            if hit.t == 0.0 && hit.face.is_none() {
                return Some(Met::Cut { plane, t: span.enter, hit });
            }
            let outward = self.outward((at, direction), hit)?;
            votes += if dot(outward, direction) > 0.0 { 1 } else { -1 };
            first.get_or_insert(hit);
        }
        first.filter(|_| votes > 0).map(|hit| Met::Cut { plane, t: span.enter, hit })
    }
}

/// Corners of the grid between which the surface lies, and a box more.
fn bounds<V: NodeView>(part: &Part<'_, V>) -> [[f64; 3]; 2] {
    let mut found = [[0.0; 3]; 2];
    for (a, [x, y, z, constant]) in part.space.world_to_grid().rows.into_iter().enumerate() {
        found[0][a] = constant - part.support([-x, -y, -z]) - 1.0;
        found[1][a] = constant + part.support([x, y, z]) + 1.0;
    }
    found
}
