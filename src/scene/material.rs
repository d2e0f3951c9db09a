//! The materials of bodies, and the sources of their colour.

use crate::format::Channel;
use crate::load::{Items, Model, ModelView};
use crate::render::colors::has_colors;
use crate::render::shade::{SURFACE, linear_of};

/// Optical properties of a surface. Colours are linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Colour of a surface in full light; for a clear material, the tint of transmitted light.
    pub color: [f64; 3],
    /// Strength of the diffuse reflection, 0..=1.
    pub diffuse: f64,
    /// Strength of the highlight (Blinn 1977), 0..=1.
    pub specular: f64,
    /// Sharpness of the highlight: the power of the cosine.
    pub exponent: u32,
    /// Part of the light that is mirrored, 0..=1.
    pub mirror: f64,
    /// Part of the rest that passes through, 0..=1.
    pub clear: f64,
    /// Refractive index; 1 bends nothing.
    pub index: f64,
}

/// A matte surface.
const MATTE: Material = Material {
    color: SURFACE,
    diffuse: 1.0,
    specular: 0.0,
    exponent: 32,
    mirror: 0.0,
    clear: 0.0,
    index: 1.0,
};

/// Materials by name, in the order of listings.
pub(crate) const PRESETS: &[(&str, Material)] = &[
    ("matt", MATTE),
    ("bone", Material { specular: 0.15, exponent: 24, ..MATTE }),
    ("skin", Material { color: [0.791, 0.491, 0.356], specular: 0.08, exponent: 12, ..MATTE }),
    ("plastic", Material { color: [0.6, 0.6, 0.6], specular: 0.5, exponent: 60, mirror: 0.05, ..MATTE }),
    (
        "metal",
        Material {
            color: [0.55, 0.56, 0.58],
            diffuse: 0.45,
            specular: 0.7,
            exponent: 80,
            mirror: 0.45,
            ..MATTE
        },
    ),
    ("mirror", Material { color: [1.0; 3], diffuse: 0.0, mirror: 0.92, ..MATTE }),
    ("glass", Material { color: [1.0; 3], specular: 0.8, exponent: 400, clear: 1.0, index: 1.5, ..MATTE }),
    (
        "water",
        Material { color: [0.94, 0.98, 1.0], specular: 0.6, exponent: 200, clear: 1.0, index: 1.33, ..MATTE },
    ),
    ("ct", Material { specular: 0.1, exponent: 16, ..MATTE }),
    ("ct-bone", Material { specular: 0.15, exponent: 24, ..MATTE }),
];

/// Source of a surface's diffuse colour; reflections and clear bodies keep the material's. Colours are linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Coloring {
    /// The material's own colour.
    #[default]
    Own,
    /// The stored colour of the model, or the colour of its label.
    Stored,
    /// Colour by the volume's value there, in its own unit (CT: Hounsfield units): ascending values with their colours,
    /// interpolated between them.
    Values(Vec<(f64, [f64; 3])>),
    /// Colour by the model's stored material number; others have the material's own.
    Labels(Vec<(u8, [f64; 3])>),
}

/// A transfer function by name: values and `0xrrggbb` in sRGB.
type Ramp = (&'static str, &'static [(f64, u32)]);

/// Presets with colours from a CT's values; their other properties are in [`PRESETS`].
const RAMPS: &[Ramp] = &[
    // Lung, fat, muscle, contrast medium, spongy and hard bone, metal.
    (
        "ct",
        &[
            (-700.0, 0x9c_5a_4a),
            (-100.0, 0xe2_b4_84),
            (50.0, 0xb4_50_3e),
            (180.0, 0xcc_6a_50),
            (350.0, 0xe0_c8_a0),
            (1200.0, 0xf8_f2_e2),
            (2500.0, 0xff_ff_ff),
        ],
    ),
    // Spongy to hard bone, enamel, metal.
    (
        "ct-bone",
        &[
            (150.0, 0xb8_70_50),
            (350.0, 0xd8_b4_84),
            (800.0, 0xec_dc_bc),
            (1600.0, 0xff_fc_f0),
            (2800.0, 0xb8_c4_d0),
        ],
    ),
];

/// `#rrggbb` as linear RGB.
fn color_of(code: u32) -> [f64; 3] {
    linear_of([16, 8, 0].map(|shift| (code >> shift).to_le_bytes()[0]))
}

impl Coloring {
    /// Colouring of a preset.
    pub(crate) fn preset(name: &str) -> Self {
        match RAMPS.iter().find(|(known, _)| *known == name) {
            Some((_, ramp)) => {
                Self::Values(ramp.iter().map(|(value, code)| (*value, color_of(*code))).collect())
            }
            None => Self::Own,
        }
    }

    /// The channel that the colouring needs.
    pub(crate) fn channel(&self) -> Option<Channel> {
        match self {
            Self::Own => None,
            Self::Stored => Some(Channel::Color),
            Self::Values(_) => Some(Channel::Value),
            Self::Labels(_) => Some(Channel::Material),
        }
    }
}

/// Colours of a model's voxels or cells.
#[derive(Clone, Debug)]
pub enum Colors<'a> {
    /// Stored colours, or the colours of its labels.
    Stored,
    /// Colours by a channel.
    Channel {
        /// The channel's items.
        items: Items<'a>,
        /// Slope and intercept from stored items to the volume's unit.
        scale: [f64; 2],
        /// Colours by value or number.
        coloring: Coloring,
    },
}

impl<'a> Colors<'a> {
    /// The colours of a model; `None` if it lacks the channel, or if no channel is needed.
    pub fn of<D: AsRef<[u8]>>(model: &'a Model<D>, coloring: &Coloring) -> Option<Self> {
        match coloring.channel()? {
            Channel::Color => Self::stored(&model.view()),
            channel => Some(Self::Channel {
                items: model.items(channel)?,
                scale: model.metadata().value_scale,
                coloring: coloring.clone(),
            }),
        }
    }

    /// The stored colours of a model, or the colours of its labels.
    pub(crate) fn stored(view: &ModelView<'_>) -> Option<Self> {
        (view.labels().is_some() || has_colors(view)).then_some(Self::Stored)
    }

    /// The colour of a voxel or cell by a channel; `None` if it has the material's.
    pub(super) fn color(&self, voxel: u64) -> Option<[f64; 3]> {
        let Self::Channel { items, scale, coloring } = self else { return None };
        let value = |stored: u16| scale[0] * f64::from(stored) + scale[1];
        match (coloring, items.get(voxel)?) {
            (Coloring::Values(ramp), [low]) => mixed(ramp, value((*low).into())),
            (Coloring::Values(ramp), [low, high]) => mixed(ramp, value(u16::from_le_bytes([*low, *high]))),
            (Coloring::Labels(labels), [label]) => {
                labels.iter().find(|(known, _)| known == label).map(|(_, color)| *color)
            }
            _ => None,
        }
    }
}

/// The colour at a value, mixed between its neighbours.
fn mixed(ramp: &[(f64, [f64; 3])], value: f64) -> Option<[f64; 3]> {
    let above = ramp.partition_point(|(stop, _)| *stop <= value);
    let (Some((low, below)), Some((high, next))) = (ramp.get(above.wrapping_sub(1)), ramp.get(above)) else {
        // Beyond both ends, the colour of the nearer end.
        return if above == 0 { ramp.first() } else { ramp.last() }.map(|(_, color)| *color);
    };
    let part = (value - low) / (high - low);
    Some(std::array::from_fn(|c| below[c] + part * (next[c] - below[c])))
}

impl Default for Material {
    fn default() -> Self {
        MATTE
    }
}

impl Material {
    /// The material of this name; `None` if it is unknown.
    pub fn preset(name: &str) -> Option<Self> {
        PRESETS.iter().find(|(known, _)| *known == name).map(|(_, material)| *material)
    }

    /// True for a matte surface that reflects all of its colour, as in pictures of single models.
    pub(super) fn is_plain(&self) -> bool {
        let Self { diffuse, specular, mirror, clear, .. } = *self;
        [diffuse, specular, mirror, clear] == [1.0, 0.0, 0.0, 0.0]
    }

    /// True if light passes through.
    pub(crate) fn is_clear(&self) -> bool {
        self.clear > 0.0 && self.mirror < 1.0
    }

    /// Part of the light that is reflected diffusely or as a highlight.
    pub(super) fn solid(&self) -> f64 {
        (1.0 - self.mirror) * (1.0 - self.clear)
    }
}

/// An integer power, by products in a fixed order.
pub(super) fn power(base: f64, exponent: u32) -> f64 {
    let (mut result, mut square, mut rest) = (1.0, base, exponent);
    while rest > 0 {
        if rest & 1 == 1 {
            result *= square;
        }
        square *= square;
        rest >>= 1;
    }
    result
}

/// Part of the light that a smooth surface reflects (Fresnel), and the cosine of the refracted angle; `cosine` is that
/// of the incident angle, `ratio` the index in front over the index behind. `None` for total reflection.
pub(super) fn fresnel(cosine: f64, ratio: f64) -> Option<(f64, f64)> {
    let square = 1.0 - ratio * ratio * (1.0 - cosine * cosine);
    if square <= 0.0 {
        return None;
    }
    let behind = square.sqrt();
    let across = (ratio * cosine - behind) / (ratio * cosine + behind);
    let along = (cosine - ratio * behind) / (cosine + ratio * behind);
    Some((0.5 * (across * across + along * along), behind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_two_colours_are_mixed_and_beside_them_held() {
        let ramp = [(-10.0, [0.0, 1.0, 0.5]), (30.0, [1.0, 0.0, 0.5])];
        for (value, want) in [(-1e9, 0.0), (-10.0, 0.0), (0.0, 0.25), (30.0, 1.0), (1e9, 1.0)] {
            assert_eq!(mixed(&ramp, value), Some([want, 1.0 - want, 0.5]));
        }
        assert_eq!(mixed(&ramp[..1], 5.0), Some([0.0, 1.0, 0.5]));
        assert_eq!(mixed(&[], 5.0), None);
        for (name, ramp) in RAMPS {
            assert!(ramp.is_sorted_by(|a, b| a.0 < b.0) && Material::preset(name).is_some(), "{name}");
        }
    }

    #[test]
    fn powers_and_fresnel_are_what_they_are() {
        for (base, exponent) in [(0.5, 0), (0.9, 1), (0.99, 400), (1.0, 7)] {
            assert!((power(base, exponent) - base.powf(f64::from(exponent))).abs() < 1e-12);
        }
        // At normal incidence glass reflects 4 %; all of it beyond the critical angle; equal from both sides.
        let (part, behind) = fresnel(1.0, 1.0 / 1.5).unwrap();
        assert!((part - 0.04).abs() < 1e-12 && (behind - 1.0).abs() < 1e-12);
        assert!(fresnel(0.7, 1.5).is_none());
        let (out, back) = fresnel(0.9, 1.5).unwrap();
        let (inwards, again) = fresnel(back, 1.0 / 1.5).unwrap();
        assert!((out - inwards).abs() < 1e-12 && (again - 0.9).abs() < 1e-12);
        // A boundary without refraction does not reflect.
        assert!(fresnel(0.3, 1.0).unwrap().0 < 1e-30);
    }
}
