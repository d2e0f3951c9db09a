//! Sources of light.

use crate::geom::{add_scaled, dot};
use crate::render::Camera;
use crate::render::shade::towards_key;

/// A light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Position or direction.
    pub kind: LightKind,
    /// Linear RGB, its strength included.
    pub color: [f64; 3],
    /// True if bodies cast shadows in it.
    pub shadows: bool,
}

/// Position or direction of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// At the eye; with a parallel camera, it shines along the line of sight.
    Head,
    /// Far away, over the viewer's left shoulder.
    Key,
    /// Far away.
    Directional {
        /// Unit vector towards the light.
        towards: [f64; 3],
    },
    /// At a point, with the same strength at any distance.
    Point {
        /// Position in mm.
        at: [f64; 3],
    },
}

/// Ambient light, from all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// Linear RGB, its strength included.
    pub color: [f64; 3],
    /// Rays of a pixel for ambient occlusion; 0 counts the surroundings as open.
    pub rays: u32,
    /// Length of these rays in mm.
    pub reach_mm: f64,
}

/// A way to a light: unit vector and distance in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LightSample {
    pub(super) towards: [f64; 3],
    pub(super) distance: f64,
}

/// Linear RGB of the key lamp, and of the lamp at the eye that comes with it.
const KEY_COLOR: [f64; 3] = [0.70, 0.68, 0.65];
const FILL_COLOR: [f64; 3] = [0.25; 3];

impl Light {
    /// The default lamps of a scene: a key lamp, and one at the eye.
    pub(super) fn usual() -> Vec<Self> {
        let lamp = |kind, color| Self { kind, color, shadows: false };
        vec![lamp(LightKind::Key, KEY_COLOR), lamp(LightKind::Head, FILL_COLOR)]
    }

    /// The way to the light from a point; `None` at the light itself.
    pub(super) fn way(&self, from: [f64; 3], camera: &Camera) -> Option<LightSample> {
        let to = |at: [f64; 3]| {
            let way = add_scaled(at, -1.0, from);
            let distance = dot(way, way).sqrt();
            (distance > 0.0).then(|| LightSample { towards: way.map(|c| c / distance), distance })
        };
        let far = |towards| Some(LightSample { towards, distance: f64::INFINITY });
        match self.kind {
            LightKind::Directional { towards } => far(towards),
            LightKind::Key => far(towards_key(camera.axes())),
            LightKind::Point { at } => to(at),
            LightKind::Head => match (camera.eye(), camera.axes()) {
                (Some(eye), _) => to(eye),
                (None, [_, _, forward]) => far(forward.map(|c| -c)),
            },
        }
    }
}
