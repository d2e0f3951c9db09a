//! The bodies, with their exact surfaces.
//!
//! Lengths are in *units*: the finest distance of two samples. The origin is the low corner of the volume.

use super::lattice::Lattice;
use super::math::{Vector, minus, unit};
use super::smooth::{Smooth, Turn};
use super::wave::Wave;
use crate::geom::add_scaled;
#[cfg(test)]
use crate::geom::dot;

/// The nearest point of a surface, as seen from some place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueSurface {
    /// Distance to the surface in units of the finest spacing; negative inside.
    pub distance: f64,
    /// Unit vector out of the body at the nearest point.
    pub normal: [f64; 3],
}

/// A body whose surface is known in closed form.
#[derive(Clone, Debug)]
pub struct Body {
    pub(super) name: &'static str,
    pub(super) shape: Shape,
}

/// The formula of a body.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// A distance in closed form, in a turned frame about a centre.
    Smooth {
        shape: Smooth,
        centre: Vector,
        turn: Turn,
    },
    Wave(Wave),
    Lattice(Lattice),
}

/// Steps of a cast after which a ray counts as a miss: it runs along the surface.
const MAX_STEPS: u32 = 20_000;
/// Nearer than this, in units, a cast has arrived.
const ARRIVED: f64 = 1e-9;

impl Body {
    /// Name, as in `synthetic:NAME@N`.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The nearest surface, seen from a place in units: the true Euclidean distance.
    ///
    /// Bodies of a lattice (`menger`, `checkerboard`, `comb`, `salt`) look one cell around them: farther away than
    /// an edge of a cell, the distance is that edge, with its sign. Waves (`gyroid`, `marschner-lobb`) are exact
    /// where the distance is shorter than the radius of the surface's curvature.
    pub fn surface(&self, place: [f64; 3]) -> TrueSurface {
        match &self.shape {
            Shape::Smooth { shape, centre, turn } => {
                let (distance, normal) = shape.surface(turn.into_body(minus(place, *centre)));
                TrueSurface { distance, normal: turn.out_of_body(normal) }
            }
            Shape::Wave(wave) => wave.surface(place),
            Shape::Lattice(lattice) => lattice.surface(place),
        }
    }

    /// Distance for the samples: the true one, or for a wave its value over its slope, which vanishes at the same
    /// places. Farther away than `reach` it may be any other number beyond `reach` on the same side.
    #[inline]
    pub(super) fn distance_near(&self, place: Vector, reach: f64) -> f64 {
        match &self.shape {
            Shape::Smooth { shape, centre, turn } => {
                shape.distance_near(turn.into_body(minus(place, *centre)), reach)
            }
            Shape::Wave(wave) => wave.first_order(place),
            Shape::Lattice(lattice) => lattice.surface(place).distance,
        }
    }

    /// True for a place inside the body or on its surface.
    pub fn contains(&self, place: [f64; 3]) -> bool {
        self.distance_near(place, 0.0) <= 0.0
    }

    /// A distance that is never greater than the true one; its sign is true, too.
    fn safe_distance(&self, place: Vector) -> f64 {
        match &self.shape {
            Shape::Wave(wave) => wave.safe_distance(place),
            _ => self.distance_near(place, f64::INFINITY),
        }
    }

    /// Distance along a ray to its entry into the body, 0 for a ray that starts inside; `None` if it does not enter
    /// within `farthest`. Places in units; `direction` is taken at length 1.
    ///
    /// Cost: some ten distances, hundreds for a ray that nearly touches. One that touches within 1e-9 counts as a hit.
    pub(crate) fn cast(&self, origin: [f64; 3], direction: [f64; 3], farthest: f64) -> Option<f64> {
        let direction = unit(direction);
        let mut t = 0.0;
        for _ in 0..MAX_STEPS {
            let distance = self.safe_distance(add_scaled(origin, t, direction));
            if distance <= ARRIVED {
                return Some(t);
            }
            t += distance;
            if t > farthest {
                return None;
            }
        }
        None
    }

    /// True if a cast and a normal are defined everywhere on the surface: it is not made of cubes.
    pub(crate) fn is_smooth(&self) -> bool {
        !matches!(self.shape, Shape::Lattice(_))
    }

    /// True if the body ends within its volume, so that all of the model's surface is the body's.
    pub(crate) fn is_closed(&self) -> bool {
        match &self.shape {
            Shape::Smooth { shape, .. } => !matches!(shape, Smooth::Slab { .. }),
            Shape::Wave(_) => false,
            Shape::Lattice(lattice) => lattice.is_closed(),
        }
    }

    /// The signal itself, for a body whose samples are its signal: Marschner and Lobb's.
    pub(super) fn signal(&self, place: Vector) -> Option<f64> {
        match &self.shape {
            Shape::Wave(wave) => wave.signal(place),
            _ => None,
        }
    }
}

/// The gradient of a function by its values, for tests.
#[cfg(test)]
pub(super) fn slope_of(f: impl Fn(Vector) -> f64, at: Vector) -> Vector {
    const STEP: f64 = 1e-5;
    std::array::from_fn(|a| {
        let shifted = |s: f64| {
            let mut p = at;
            p[a] += s;
            f(p)
        };
        (shifted(STEP) - shifted(-STEP)) / (2.0 * STEP)
    })
}

/// Cosine of the angle between two unit vectors.
#[cfg(test)]
pub(super) fn cosine(a: Vector, b: Vector) -> f64 {
    dot(unit(a), unit(b))
}
