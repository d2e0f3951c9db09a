//! What bodies are made of.

/// What a body does with light. Colours are linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Colour of a surface in full light; of what is clear, the colour that it gives to the light that passes through.
    pub color: [f64; 3],
    /// Strength of the matt part of the light that is thrown back, 0..=1.
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

/// A matt surface.
const MATT: Material = Material {
    color: [0.838_8, 0.760_5, 0.630_8],
    diffuse: 1.0,
    specular: 0.0,
    exponent: 32,
    mirror: 0.0,
    clear: 0.0,
    index: 1.0,
};

/// Materials by name, in the order in which they are listed.
pub const PRESETS: &[(&str, Material)] = &[
    ("matt", MATT),
    ("bone", Material { specular: 0.15, exponent: 24, ..MATT }),
    ("skin", Material { color: [0.791, 0.491, 0.356], specular: 0.08, exponent: 12, ..MATT }),
    ("plastic", Material { color: [0.6, 0.6, 0.6], specular: 0.5, exponent: 60, mirror: 0.05, ..MATT }),
    (
        "metal",
        Material {
            color: [0.55, 0.56, 0.58],
            diffuse: 0.45,
            specular: 0.7,
            exponent: 80,
            mirror: 0.45,
            ..MATT
        },
    ),
    ("mirror", Material { color: [1.0; 3], diffuse: 0.0, mirror: 0.92, ..MATT }),
    ("glass", Material { color: [1.0; 3], specular: 0.8, exponent: 400, clear: 1.0, index: 1.5, ..MATT }),
    (
        "water",
        Material { color: [0.94, 0.98, 1.0], specular: 0.6, exponent: 200, clear: 1.0, index: 1.33, ..MATT },
    ),
];

impl Default for Material {
    fn default() -> Self {
        MATT
    }
}

impl Material {
    /// The material of this name, if there is one.
    pub fn preset(name: &str) -> Option<Self> {
        PRESETS.iter().find(|(known, _)| *known == name).map(|(_, material)| *material)
    }

    /// Does light pass through?
    pub fn is_clear(&self) -> bool {
        self.clear > 0.0 && self.mirror < 1.0
    }

    /// Part of the light that is thrown back without a direction, or with a highlight.
    pub(super) fn solid(&self) -> f64 {
        (1.0 - self.mirror) * (1.0 - self.clear)
    }
}

/// A whole power, by products in a fixed order.
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

/// Part of the light that a smooth surface throws back (Fresnel), and the cosine of the angle behind it; `cosine` is
/// that before it, `ratio` the index before over the index behind. `None` where all is thrown back.
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
    fn powers_and_fresnel_are_what_they_are() {
        for (base, exponent) in [(0.5, 0), (0.9, 1), (0.99, 400), (1.0, 7)] {
            assert!((power(base, exponent) - base.powf(f64::from(exponent))).abs() < 1e-12);
        }
        // Straight on, glass throws back 4 %; all of it beyond the critical angle; as much from either side.
        let (part, behind) = fresnel(1.0, 1.0 / 1.5).unwrap();
        assert!((part - 0.04).abs() < 1e-12 && (behind - 1.0).abs() < 1e-12);
        assert!(fresnel(0.7, 1.5).is_none());
        let (out, back) = fresnel(0.9, 1.5).unwrap();
        let (inwards, again) = fresnel(back, 1.0 / 1.5).unwrap();
        assert!((out - inwards).abs() < 1e-12 && (again - 0.9).abs() < 1e-12);
        // What does not bend does not throw back.
        assert!(fresnel(0.3, 1.0).unwrap().0 < 1e-30);
    }
}
