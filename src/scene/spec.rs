//! A scene as stated by its text, checked.

use std::path::PathBuf;

use crate::geom::{Affine, add_scaled};
use crate::render::shade::linear_of;
use crate::render::{NamedView, Projection, Samples, Shading};

use super::clip::{Clip, CutPlane};
use super::labels::LabelRule;
use super::light::{Ambient, Light};
use super::material::{Coloring, Material};
use super::place::Placement;

/// A scene as stated by its text, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Width and height in pixels, if stated.
    pub size: Option<[u32; 2]>,
    /// Linear RGB behind everything; `None` is transparent.
    pub background: Option<[f64; 3]>,
    /// Most reflections and refractions of a line.
    pub bounces: u32,
    /// Rays of a pixel's colours, if stated.
    pub samples: Option<Samples>,
    /// The stated part of the camera.
    pub camera: SceneCamera,
    /// The light, unless the scene has lights of its own.
    pub shading: Option<Shading>,
    /// Light from everywhere.
    pub ambient: Ambient,
    /// Lights.
    pub lights: Vec<Light>,
    /// Models, at least one.
    pub models: Vec<SceneModel>,
}

/// Colour of cut faces (linear RGB).
const CUT_COLOR: [f64; 3] = [0.50, 0.13, 0.09];

impl Scene {
    /// One model by itself, in the default light.
    pub(crate) fn of_model(file: PathBuf) -> Self {
        let placement = Placement { scale: [1.0; 3], turn_deg: [0.0; 3], pivot: [0.0; 3], at: [0.0; 3] };
        let model = SceneModel {
            file,
            material: Material::default(),
            coloring: Coloring::Own,
            place: StatedPlacement::About(placement),
            clip: Clip::default(),
            framed: true,
            labels: Vec::new(),
        };
        Self {
            size: None,
            background: None,
            bounces: 0,
            samples: None,
            camera: SceneCamera::default(),
            shading: Some(Shading::Soft),
            ambient: Ambient { color: [0.1; 3], rays: 0, reach_mm: f64::INFINITY },
            lights: Vec::new(),
            models: vec![model],
        }
    }

    /// This scene with models in this colour (sRGB), unless they have their own, and cut to a box: low and high bounds
    /// along each axis in mm, which may be infinite.
    #[must_use]
    pub(crate) fn shown_as(mut self, color: Option<[u8; 3]>, bounds_mm: Option<[[f64; 2]; 3]>) -> Self {
        let mut planes = Vec::new();
        for (axis, [low, high]) in bounds_mm.into_iter().flatten().enumerate() {
            let mut normal = [0.0; 3];
            for (sign, limit) in [(1.0, high), (-1.0, -low)] {
                normal[axis] = sign;
                if limit.is_finite() {
                    planes.push(CutPlane { normal, limit, cap: Some(CUT_COLOR) });
                }
            }
        }
        let cut = Clip::new(planes);
        for model in &mut self.models {
            model.clip = model.clip.and(&cut);
            model.material.color = color.map_or(model.material.color, linear_of);
        }
        self
    }
}

/// The camera, as far as the text states it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneCamera {
    /// A named view.
    pub view: Option<NamedView>,
    /// Position of the eye, and a point in the middle of the picture, in mm.
    pub eye: Option<[[f64; 3]; 2]>,
    /// The upward direction.
    pub up: Option<[f64; 3]>,
    /// Projection of lines of sight.
    pub projection: Option<Projection>,
    /// Vertical field of view in degrees.
    pub fov_deg: Option<f64>,
    /// Near distance in mm: points closer to the eye along a line of sight are not seen.
    pub near_mm: f64,
}

/// A model of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneModel {
    /// File name, as in the text.
    pub file: PathBuf,
    /// Material.
    pub material: Material,
    /// Source of its colour.
    pub coloring: Coloring,
    /// Its placement.
    pub place: StatedPlacement,
    /// Cuts of this model and of all.
    pub clip: Clip,
    /// True if named views include it in the frame.
    pub framed: bool,
    /// Visibility of its labels; later rules override earlier ones.
    pub labels: Vec<LabelRule>,
}

/// Placement of a model, as stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatedPlacement {
    /// A map of its millimetres.
    Map(Affine),
    /// A placement about a point of its own.
    About(Placement),
    /// A placement about the middle of its volume; `at` is the new position of that, or a displacement.
    Middle {
        /// The remaining parameters; its pivot is ignored.
        placement: Placement,
        /// True if `at` of the placement is a displacement.
        moved: bool,
    },
}

impl StatedPlacement {
    /// The map, for a model whose volume has this middle.
    pub fn affine(&self, middle: [f64; 3]) -> Affine {
        match *self {
            Self::Map(affine) => affine,
            Self::About(placement) => placement.affine(),
            Self::Middle { placement, moved } => {
                let at = if moved { add_scaled(middle, 1.0, placement.at) } else { placement.at };
                Placement { pivot: middle, at, ..placement }.affine()
            }
        }
    }
}
