//! Where light comes from.

use crate::geom::{add_scaled, dot};
use crate::render::Camera;

/// A light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Where it is.
    pub kind: LightKind,
    /// Linear RGB, its strength included.
    pub color: [f64; 3],
    /// Do bodies keep it from others?
    pub shadows: bool,
}

/// Where a light is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// At the eye; with a parallel camera, it shines along the line of sight.
    Head,
    /// Far away.
    Directional {
        /// Unit vector towards it.
        towards: [f64; 3],
    },
    /// At a point; it is as strong near as far.
    Point {
        /// Where, in mm.
        at: [f64; 3],
    },
}

/// Light from everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// Linear RGB, its strength included.
    pub color: [f64; 3],
    /// Rays of a pixel that tell how open its surroundings are; 0 takes them for open.
    pub rays: u32,
    /// How far in mm those look.
    pub reach_mm: f64,
}

/// A way to a light: unit vector and distance in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Way {
    pub(super) towards: [f64; 3],
    pub(super) distance: f64,
}

impl Light {
    /// The way there from a point; `None` at the light itself.
    pub(super) fn way(&self, from: [f64; 3], camera: &Camera) -> Option<Way> {
        let to = |at: [f64; 3]| {
            let way = add_scaled(at, -1.0, from);
            let distance = dot(way, way).sqrt();
            (distance > 0.0).then(|| Way { towards: way.map(|c| c / distance), distance })
        };
        match self.kind {
            LightKind::Directional { towards } => Some(Way { towards, distance: f64::INFINITY }),
            LightKind::Point { at } => to(at),
            LightKind::Head => match camera.eye() {
                Some(eye) => to(eye),
                None => {
                    let [_, _, forward] = camera.axes();
                    Some(Way { towards: forward.map(|c| -c), distance: f64::INFINITY })
                }
            },
        }
    }
}
