//! Cameras: the named views of a patient, and free ones.
//!
//! World axes are DICOM's: +x to the patient's left, +y to the back, +z to the head. The named views, with the
//! directions on the picture's right and at its top:
//!
//! | view | looks along | right | top |
//! |---|---|---|---|
//! | front | +y, the viewer facing the patient | patient's left (+x) | head (+z) |
//! | back | -y | patient's right (-x) | head |
//! | left | -x, the viewer at the patient's left | back (+y) | head |
//! | right | +x | front (-y) | head |
//! | top | -z, from above the head | patient's left (+x) | back (+y): the face is at the bottom |
//! | bottom | +z, from below the feet | patient's left (+x) | front (-y), as radiologists view slices |
//! | iso | from the front, left and above | patient's left | head |

use std::str::FromStr;

use super::{RenderError, RenderFault};
use crate::fault::{Fault, usage};
use crate::geom::{add_scaled, angle, cross, dot};
use crate::text::names::{EYE, LOOK_AT, UP};

/// Projection of lines of sight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// Parallel lines: sizes are comparable everywhere in the picture.
    #[default]
    Parallel,
    /// Lines from one point: near things are larger.
    Perspective,
}

impl FromStr for Projection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "parallel" => Ok(Self::Parallel),
            "perspective" => Ok(Self::Perspective),
            _ => Err(format!("unknown projection {text:?}; choose parallel or perspective")),
        }
    }
}

/// A named view; the module's text lists their directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NamedView {
    /// The patient's face.
    #[default]
    Front,
    /// The patient's back.
    Back,
    /// The patient's left side.
    Left,
    /// The patient's right side.
    Right,
    /// The top of the head.
    Top,
    /// From below the feet.
    Bottom,
    /// Three quarters from the front, left and above.
    Iso,
}

impl NamedView {
    /// All views, in the order of the command's help.
    pub const ALL: [Self; 7] =
        [Self::Front, Self::Back, Self::Left, Self::Right, Self::Top, Self::Bottom, Self::Iso];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        self.row().0
    }

    /// World direction of the line of sight.
    pub(crate) fn looks_along(self) -> [f64; 3] {
        self.row().1
    }

    /// Name, and the world directions of the line of sight and of the picture's top (not yet orthogonal for iso).
    fn row(self) -> (&'static str, [f64; 3], [f64; 3]) {
        let head = [0.0, 0.0, 1.0];
        match self {
            Self::Front => ("front", [0.0, 1.0, 0.0], head),
            Self::Back => ("back", [0.0, -1.0, 0.0], head),
            Self::Left => ("left", [-1.0, 0.0, 0.0], head),
            Self::Right => ("right", [1.0, 0.0, 0.0], head),
            Self::Top => ("top", [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
            Self::Bottom => ("bottom", [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]),
            Self::Iso => ("iso", [-0.55, 0.75, -0.38], head),
        }
    }
}

impl FromStr for NamedView {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|v| v.name() == text).ok_or_else(|| {
            format!("unknown view {text:?}; choose front, back, left, right, top, bottom or iso")
        })
    }
}

/// Viewpoint of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewPoint {
    /// A named view, framed so that the model fills the picture.
    Named(NamedView),
    /// A free camera, in world millimetres.
    Free {
        /// Position.
        eye: [f64; 3],
        /// A point in the middle of the picture.
        look_at: [f64; 3],
        /// A direction that is upwards in the picture; by default towards the head, or, when looking along that,
        /// towards the back.
        up: Option<[f64; 3]>,
    },
    /// A named view turned about the head's axis through the model's middle, framed so that the whole model is seen
    /// from all around.
    Turned {
        /// The view to begin with; for top and bottom the picture turns in its plane.
        view: NamedView,
        /// Angle in degrees: the eye goes from the patient's front to the left side.
        degrees: f64,
    },
}

/// Empty border around a framed model, as a part of its size.
const MARGIN: f64 = 0.04;

/// Widest and narrowest field of view in degrees.
const FOV_RANGE_DEG: (f64, f64) = (0.1, 170.0);

/// Least and greatest magnification of a framed picture.
const ZOOM_RANGE: (f64, f64) = (0.01, 1000.0);

/// A camera ready to cast rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    projection: Projection,
    eye: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
    forward: [f64; 3],
    /// Half the picture's width and height: in mm, or per mm of distance in perspective.
    half_width: f64,
    half_height: f64,
}

impl Camera {
    /// Builds the camera of a view point for a picture of `aspect` = width / height.
    ///
    /// `fov_deg` is the angle between the bottom and the top of the picture. A free parallel camera has the same extent
    /// at every distance as a perspective one at the distance of `look_at`. `support` gives the model's extent: the
    /// greatest `direction . p` over its points.
    ///
    /// # Errors
    /// [`RenderError`] for coordinates that are not finite, an eye equal to `look_at`, an `up` along the line of sight,
    /// or a field of view out of range.
    pub fn new(
        point: ViewPoint,
        projection: Projection,
        fov_deg: f64,
        aspect: f64,
        support: impl Fn([f64; 3]) -> f64,
    ) -> Result<Self, RenderError> {
        if !(FOV_RANGE_DEG.0..=FOV_RANGE_DEG.1).contains(&fov_deg) {
            let (least, most) = FOV_RANGE_DEG;
            return Err(wrong(usage!("the field of view is {fov_deg} degrees; choose {least} to {most}")));
        }
        let tangent = tan_deg(fov_deg / 2.0);
        match point {
            ViewPoint::Named(view) => {
                let (_, forward, up) = view.row();
                let axes = Axes::new(forward, up)?;
                Ok(match projection {
                    Projection::Parallel => Self::framed_parallel(axes, aspect, support),
                    Projection::Perspective => Self::framed_perspective(axes, tangent, aspect, support),
                })
            }
            ViewPoint::Turned { view, degrees } => {
                if !degrees.is_finite() {
                    return Err(not_finite());
                }
                let (_, forward, up) = view.row();
                let axes = Axes::new(turned(forward, degrees), turned(up, degrees))?;
                Ok(Self::around(axes, projection, fov_deg, aspect, support))
            }
            ViewPoint::Free { eye, look_at, up } => {
                let given = [eye, look_at, up.unwrap_or([0.0; 3])];
                if !given.iter().flatten().all(|v| v.is_finite()) {
                    return Err(not_finite());
                }
                let sight = add_scaled(look_at, -1.0, eye);
                let distance = dot(sight, sight).sqrt();
                if !distance.is_finite() {
                    return Err(wrong(usage!(
                        "the eye is too far from the point that it looks at for any picture; give both in mm, near the model ({EYE}, {LOOK_AT})"
                    )));
                }
                if !distance.is_normal() {
                    return Err(wrong(usage!(
                        "the eye is at the point that it looks at; move one of them ({EYE}, {LOOK_AT})"
                    )));
                }
                let axes = match up {
                    Some(up) => Axes::new(sight, up)?,
                    None => {
                        Axes::new(sight, [0.0, 0.0, 1.0]).or_else(|_| Axes::new(sight, [0.0, 1.0, 0.0]))?
                    }
                };
                let half_height = match projection {
                    Projection::Parallel => tangent * distance,
                    Projection::Perspective => tangent,
                };
                Ok(Self::assemble(projection, eye, axes, half_height, aspect))
            }
        }
    }

    fn assemble(projection: Projection, eye: [f64; 3], axes: Axes, half_height: f64, aspect: f64) -> Self {
        let Axes { right, up, forward } = axes;
        Self { projection, eye, right, up, forward, half_width: half_height * aspect, half_height }
    }

    /// Parallel camera in front of the model, which fills the picture except for a margin.
    fn framed_parallel(axes: Axes, aspect: f64, support: impl Fn([f64; 3]) -> f64) -> Self {
        let span = |v: [f64; 3]| (-support(v.map(|c| -c)), support(v));
        let (left, right) = span(axes.right);
        let (bottom, top) = span(axes.up);
        let (near, far) = span(axes.forward);
        let half = ((top - bottom) / 2.0).max((right - left) / 2.0 / aspect) * (1.0 + MARGIN);
        let before = near - (far - near) * MARGIN;
        let eye = axes.point((left + right) / 2.0, (bottom + top) / 2.0, before);
        Self::assemble(Projection::Parallel, eye, axes, half, aspect)
    }

    /// Camera that sees the whole model at any turn about the head's axis.
    fn around(
        axes: Axes,
        projection: Projection,
        fov_deg: f64,
        aspect: f64,
        support: impl Fn([f64; 3]) -> f64,
    ) -> Self {
        let span = |axis: usize| {
            let mut v = [0.0; 3];
            v[axis] = 1.0;
            let (low, high) = (-support(v.map(|c| -c)), support(v));
            ((low + high) / 2.0, (high - low) / 2.0)
        };
        let [x, y, z] = [0, 1, 2].map(span);
        let (middle, reach) = ([x.0, y.0, z.0], (x.1 * x.1 + y.1 * y.1).sqrt());
        // A cylinder about the head's axis, as the camera sees it.
        let slope = axes.forward[2].abs();
        let high = z.1 * (1.0 - slope * slope).max(0.0).sqrt() + reach * slope;
        let half = high.max(reach / aspect) * (1.0 + MARGIN);
        let ball = (reach * reach + z.1 * z.1).sqrt();
        let (half_height, back) = match projection {
            Projection::Parallel => (half, ball * (1.0 + MARGIN)),
            Projection::Perspective => {
                // The narrower of the picture's sides touches the ball around the model.
                let tangent = tan_deg(fov_deg / 2.0);
                let narrow = tangent * aspect.min(1.0);
                (tangent, ball * (1.0 + MARGIN) * (1.0 + narrow * narrow).sqrt() / narrow)
            }
        };
        let eye = add_scaled(middle, -back, axes.forward);
        Self::assemble(projection, eye, axes, half_height, aspect)
    }

    /// Perspective camera at the least distance from which the whole model is seen.
    fn framed_perspective(axes: Axes, tangent: f64, aspect: f64, support: impl Fn([f64; 3]) -> f64) -> Self {
        // An eye (e, f) sees a point (side, depth), along one picture axis and forward, if
        // |side - e| <= k (depth - f), that is e - k f >= side - k depth and e + k f <= side + k depth.
        let fit = |axis: [f64; 3], k: f64| {
            let most = support(add_scaled(axis, -k, axes.forward));
            let least = -support(add_scaled(axis.map(|c| -c), -k, axes.forward));
            ((most + least) / 2.0, (least - most) / (2.0 * k))
        };
        let inner = tangent / (1.0 + MARGIN);
        let (across, f_across) = fit(axes.right, inner * aspect);
        let (along, f_along) = fit(axes.up, inner);
        let eye = axes.point(across, along, f_across.min(f_along));
        Self::assemble(Projection::Perspective, eye, axes, tangent, aspect)
    }

    /// The same camera, magnified by a factor about the middle of the picture.
    ///
    /// # Errors
    /// [`RenderError`] for a factor out of 0.01..=1000.
    pub(crate) fn zoomed(mut self, factor: f64) -> Result<Self, RenderError> {
        let (least, most) = ZOOM_RANGE;
        if !(least..=most).contains(&factor) {
            return Err(wrong(usage!("the magnification is {factor}; choose {least} to {most}")));
        }
        self.half_width /= factor;
        self.half_height /= factor;
        Ok(self)
    }

    /// Line of sight through the picture point (x, y), each -1..=1, x to the right and y up: origin, and a
    /// direction with length 1 along the line of sight of the middle, so that t is the depth in mm.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> ([f64; 3], [f64; 3]) {
        let (across, along) = (x * self.half_width, y * self.half_height);
        match self.projection {
            Projection::Parallel => {
                (add_scaled(add_scaled(self.eye, across, self.right), along, self.up), self.forward)
            }
            Projection::Perspective => {
                (self.eye, add_scaled(add_scaled(self.forward, across, self.right), along, self.up))
            }
        }
    }

    /// The formula of [`Camera::ray`] as numbers.
    pub(super) fn frame(&self) -> RayFrame {
        let sides = [self.right.map(|c| c * self.half_width), self.up.map(|c| c * self.half_height)];
        let parallel = self.projection == Projection::Parallel;
        let (of_origin, of_direction) =
            if parallel { (sides, [[0.0; 3]; 2]) } else { ([[0.0; 3]; 2], sides) };
        RayFrame {
            parallel,
            origin: [self.eye, of_origin[0], of_origin[1]],
            direction: [self.forward, of_direction[0], of_direction[1]],
            unit_right: self.right,
            unit_up: self.up,
        }
    }

    /// Half the picture's width and height, which scale the point of [`Camera::ray`].
    pub(super) fn half_sides(&self) -> (f64, f64) {
        (self.half_width, self.half_height)
    }

    /// Position of the eye; `None` for a parallel camera.
    pub(crate) fn eye(&self) -> Option<[f64; 3]> {
        (self.projection == Projection::Perspective).then_some(self.eye)
    }

    /// Unit vectors to the right, up and forward in the picture.
    pub(crate) fn axes(&self) -> [[f64; 3]; 3] {
        [self.right, self.up, self.forward]
    }

    /// Height in mm of a pixel at a depth, for a picture `height` pixels high.
    pub(crate) fn pixel_mm(&self, height: u32, depth_mm: f64) -> f64 {
        let per_pixel = 2.0 * self.half_height / f64::from(height);
        match self.projection {
            Projection::Parallel => per_pixel,
            Projection::Perspective => per_pixel * depth_mm.max(0.0),
        }
    }

    /// Least and greatest depth in mm of a model with this support; the part behind the camera does not count.
    pub(crate) fn depth_range_mm(&self, support: impl Fn([f64; 3]) -> f64) -> (f64, f64) {
        let at = dot(self.eye, self.forward);
        let near = (-support(self.forward.map(|c| -c)) - at).max(0.0);
        (near, (support(self.forward) - at).max(near))
    }
}

/// Rays as affine functions of the picture point (x, y): each is a constant, its change with x, and with y.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayFrame {
    /// True if the origin changes, and not the direction.
    pub(super) parallel: bool,
    pub(super) origin: [[f64; 3]; 3],
    pub(super) direction: [[f64; 3]; 3],
    pub(super) unit_right: [f64; 3],
    pub(super) unit_up: [f64; 3],
}

/// A camera that cannot be.
fn wrong(fault: Fault) -> RenderError {
    RenderFault::Camera(fault).into()
}

fn not_finite() -> RenderError {
    wrong(usage!("a camera coordinate is not a finite number"))
}

/// Three orthogonal unit vectors.
#[derive(Clone, Copy)]
struct Axes {
    right: [f64; 3],
    up: [f64; 3],
    forward: [f64; 3],
}

impl Axes {
    fn new(forward: [f64; 3], up: [f64; 3]) -> Result<Self, RenderError> {
        let short = || wrong(usage!("the up direction has no length; give another ({UP})"));
        let along = || wrong(usage!("the up direction is along the line of sight; give another ({UP})"));
        let (forward, up) = unit(forward).zip(unit(up)).ok_or_else(short)?;
        let right = cross(forward, up);
        // Under a thousandth of a radian the picture's rotation would be noise.
        let right = unit(right).filter(|_| dot(right, right) >= 1e-6).ok_or_else(along)?;
        Ok(Self { right, up: cross(right, forward), forward })
    }

    /// World point of coordinates along the three axes.
    fn point(&self, right: f64, up: f64, forward: f64) -> [f64; 3] {
        let across = add_scaled([0.0; 3], right, self.right);
        add_scaled(add_scaled(across, up, self.up), forward, self.forward)
    }
}

/// A direction turned about the head's axis.
fn turned(v: [f64; 3], degrees: f64) -> [f64; 3] {
    let [sin, cos] = angle::sin_cos_deg(degrees);
    [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]]
}

/// The vector scaled to length 1; `None` for a zero vector.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    if !largest.is_normal() {
        return None;
    }
    let v = v.map(|c| c / largest);
    let length = dot(v, v).sqrt();
    Some(v.map(|c| c / length))
}

/// Tangent of 0..=85 degrees, the same on every machine.
fn tan_deg(degrees: f64) -> f64 {
    let [sin, cos] = angle::sin_cos_series(degrees);
    sin / cos
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Support of a box.
    fn of_box(low: [f64; 3], high: [f64; 3]) -> impl Fn([f64; 3]) -> f64 {
        move |d| (0..3).map(|a| (d[a] * low[a]).max(d[a] * high[a])).sum()
    }

    fn named(view: NamedView, projection: Projection, aspect: f64) -> Camera {
        let model = of_box([-10.0, 20.0, 5.0], [30.0, 26.0, 9.0]);
        Camera::new(ViewPoint::Named(view), projection, 40.0, aspect, model).unwrap()
    }

    /// Checks that the whole box is in front of the camera and in the picture; returns the greatest coordinate of a
    /// corner there.
    fn sees(c: &Camera, low: [f64; 3], high: [f64; 3]) -> f64 {
        let mut most = 0.0_f64;
        for corner in 0..8_u32 {
            let p = std::array::from_fn(|a| if corner >> a & 1 == 1 { high[a] } else { low[a] });
            let v = add_scaled(p, -1.0, c.eye);
            let depth = dot(v, c.forward);
            let scale = if c.projection == Projection::Parallel { 1.0 } else { depth };
            let x = dot(v, c.right) / (c.half_width * scale);
            let y = dot(v, c.up) / (c.half_height * scale);
            assert!(depth > 0.0 && x.abs() < 1.0 && y.abs() < 1.0, "{c:?} {p:?} {x} {y}");
            most = most.max(x.abs()).max(y.abs());
        }
        most
    }

    #[test]
    fn named_views_have_the_documented_sides() {
        for (view, forward, right, up) in [
            (NamedView::Front, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            (NamedView::Back, [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            (NamedView::Left, [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
            (NamedView::Right, [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]),
            (NamedView::Top, [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            (NamedView::Bottom, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ] {
            let c = named(view, Projection::Parallel, 1.0);
            assert_eq!((c.forward, c.right, c.up), (forward, right, up), "{view:?}");
        }
        let c = named(NamedView::Iso, Projection::Parallel, 1.0);
        assert!(c.right[0] > 0.5 && c.up[2] > 0.8 && c.forward[1] > 0.5 && c.forward[2] < 0.0);
    }

    #[test]
    fn framed_models_are_seen_whole_and_fill_the_picture() {
        for view in NamedView::ALL {
            for projection in [Projection::Parallel, Projection::Perspective] {
                for aspect in [0.5, 1.0, 2.0] {
                    let c = named(view, projection, aspect);
                    let most = sees(&c, [-10.0, 20.0, 5.0], [30.0, 26.0, 9.0]);
                    assert!(most > 0.94, "{view:?} {projection:?} {aspect}: {most}");
                }
            }
        }
    }

    #[test]
    fn cameras_that_make_no_sense_are_refused_with_a_reason() {
        let free = |eye, look_at, up| {
            let point = ViewPoint::Free { eye, look_at, up };
            Camera::new(point, Projection::Perspective, 40.0, 1.0, |_| 0.0).map_err(|e| e.to_string())
        };
        assert!(free([1.0; 3], [1.0; 3], None).unwrap_err().contains("the eye is at the point"));
        assert!(
            free([0.0; 3], [0.0, 0.0, 5.0], Some([0.0, 0.0, -2.0])).unwrap_err().contains("up direction")
        );
        assert!(free([0.0; 3], [0.0, 1.0, 5.0], Some([0.0; 3])).unwrap_err().contains("no length"));
        assert!(free([f64::NAN; 3], [0.0; 3], None).unwrap_err().contains("finite"));
        assert!(free([0.0; 3], [0.0, 0.0, 5.0], None).is_ok());
        let c = Camera::new(ViewPoint::Named(NamedView::Front), Projection::Parallel, 180.0, 1.0, |_| 0.0);
        assert!(c.unwrap_err().to_string().contains("field of view"));
    }

    #[test]
    fn turned_views_see_the_whole_model_and_go_from_the_front_to_the_left() {
        let (low, high) = ([-10.0, 20.0, 5.0], [30.0, 26.0, 9.0]);
        for projection in [Projection::Parallel, Projection::Perspective] {
            for view in [NamedView::Front, NamedView::Iso, NamedView::Top] {
                for (step, aspect) in [(0, 1.0), (1, 0.5), (2, 2.0), (3, 1.0), (4, 0.7)] {
                    let point = ViewPoint::Turned { view, degrees: 73.0 * f64::from(step) };
                    let c = Camera::new(point, projection, 40.0, aspect, of_box(low, high)).unwrap();
                    sees(&c, low, high);
                }
            }
        }
        let quarter = ViewPoint::Turned { view: NamedView::Front, degrees: 90.0 };
        let c = Camera::new(quarter, Projection::Parallel, 40.0, 1.0, of_box(low, high)).unwrap();
        assert_eq!(c.forward.map(|v| v + 0.0), NamedView::Left.looks_along());
        let bad = ViewPoint::Turned { view: NamedView::Front, degrees: f64::NAN };
        assert!(Camera::new(bad, Projection::Parallel, 40.0, 1.0, of_box(low, high)).is_err());
    }

    #[test]
    fn the_tangent_is_right() {
        for degrees in [0.05, 1.0, 20.0, 45.0, 60.0, 85.0_f64] {
            assert!((tan_deg(degrees) / degrees.to_radians().tan() - 1.0).abs() < 1e-13, "{degrees}");
        }
    }
}
