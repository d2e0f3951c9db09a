//! Light and colour: a bone-grey surface, sRGB out; a lamp at the eye alone, or the soft light of a photographer's rig.
//!
//! Soft light has a key lamp from the left and above, which gives shape; a lamp at the eye, which keeps the rest from
//! turning black; and the sky, which is brighter above. The openness of a point's surroundings (`ambient`) dims the
//! last two in proportion and the key lamp by up to 70 %.
//!
//! All arithmetic is IEEE addition, multiplication, division and square root in a fixed order, so pixels are the same
//! on every machine; powers do not use the system's functions.

use super::Shading;
use super::pixel_rays::PixelRays;
use super::tile::RAYS;
use crate::cpu::{Kernel, Lanes};
use crate::geom::dot;

/// Part of the light that reaches every surface: keeps edges visible on a black background, and dark enough to be seen
/// on a white one.
const AMBIENT: f64 = 0.07;

/// Part of the light that falls off with the squared cosine instead of the cosine: a lamp at the eye makes shapes flat
/// in the middle, and this restores some relief.
const RELIEF: f64 = 0.6;

/// Colour of bone, for a surface without its own colour, in linear RGB (sRGB 236, 226, 208).
pub(crate) const SURFACE: [f64; 3] = [0.838_8, 0.760_5, 0.630_8];

/// Entries of the table from linear light to sRGB.
const STEPS: usize = 4096;

/// Turns normals into colours.
#[derive(Clone, Debug)]
pub(crate) struct Shader {
    srgb: Vec<u8>,
    /// Linear light of every sRGB code.
    lights: Vec<f64>,
}

impl Shader {
    /// Prepares the sRGB table.
    pub(crate) fn new() -> Self {
        let mut srgb = Vec::with_capacity(STEPS + 1);
        let mut code = 0_u8;
        let ends = |code: u8| linear((f64::from(code) + 0.5) / 255.0);
        let mut end = ends(code);
        for i in 0..=STEPS {
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let light = i as f64 / STEPS as f64;
            while code < 255 && end < light {
                code += 1;
                end = ends(code);
            }
            srgb.push(code);
        }
        let lights = (0..=255_u8).map(|code| linear_of([code; 3])[0]).collect();
        Self { srgb, lights }
    }

    /// Linear light of a colour (sRGB).
    #[inline]
    pub(crate) fn decode(&self, color: [u8; 3]) -> [f64; 3] {
        color.map(|code| self.lights.get(usize::from(code)).copied().unwrap_or_default())
    }

    /// sRGB code at an index of the table.
    #[inline]
    pub(crate) fn code(&self, at: u16) -> u8 {
        self.srgb.get(usize::from(at)).copied().unwrap_or(255)
    }

    /// The pixel of `rays` rays, `hits` of them with a hit, with this sum of colours.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
    pub(crate) fn pixel(&self, sum: [f64; 3], hits: f64, rays: f64) -> [u8; 4] {
        if hits <= 0.0 {
            return [0; 4];
        }
        let [r, g, b] = sum.map(|c| self.encode(c / hits));
        [r, g, b, (hits / rays * 255.0 + 0.5) as u8]
    }

    /// sRGB code of linear light 0..=1.
    #[inline]
    pub(crate) fn encode(&self, light: f64) -> u8 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let at = (light.clamp(0.0, 1.0) * STEPS as f64 + 0.5) as usize;
        self.srgb.get(at).copied().unwrap_or(255)
    }
}

/// The key lamp's direction in the camera's frame: from the left, above and in front of the surface; of length 1.
const KEY: [f64; 3] = [-0.451_129_236_405_376_94, 0.551_380_177_828_794_1, 0.701_756_589_963_919_7];
/// Linear RGB of the key lamp and of the sky: warm and cool.
const KEY_COLOR: [f64; 3] = [1.0, 0.97, 0.93];
const SKY_COLOR: [f64; 3] = [0.88, 0.94, 1.0];
/// Shares of the key lamp, of the lamp at the eye, of the ambient sky and of the sky from above, and of the highlight.
const OF_KEY: f64 = 0.66;
const OF_EYE: f64 = 0.22;
const OF_SKY: f64 = 0.015;
const OF_ZENITH: f64 = 0.0375;
const OF_SHINE: f64 = 0.07;
/// Part of the key lamp's light that falls off with the cosine, not with its square.
const KEY_FLAT: f64 = 0.35;
/// Part of the key lamp's light that reaches closed places: a lamp has one direction, to which some hollows are open.
const KEY_CLOSED: f64 = 0.3;

/// Unit vector towards the key lamp, for a camera with these axes: to the right, up and forward in the picture.
pub(crate) fn towards_key([right, up, forward]: [[f64; 3]; 3]) -> [f64; 3] {
    std::array::from_fn(|a| KEY[0] * right[a] + KEY[1] * up[a] - KEY[2] * forward[a])
}

/// A rig of lamps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rig {
    /// World unit vectors upwards in the picture and towards the key lamp; `None` for the one lamp at the eye.
    soft: Option<[[f64; 3]; 2]>,
    /// True if colours are shown unshaded.
    flat: bool,
}

impl Rig {
    /// The rig for a camera with these axes: to the right, up and forward in the picture.
    pub(crate) fn new(shading: Shading, axes: [[f64; 3]; 3]) -> Self {
        Self {
            soft: (shading == Shading::Soft).then(|| [axes[1], towards_key(axes)]),
            flat: shading == Shading::Flat,
        }
    }

    /// Linear RGB of a surface of this colour, unit normal and openness, seen along `sight` (any length, not null); may
    /// be more than 1.
    ///
    /// Both sides of a surface are lit alike, so that a model can be viewed from within.
    #[inline(always)]
    pub(crate) fn of(&self, color: [f64; 3], normal: [f64; 3], sight: [f64; 3], open: f64) -> [f64; 3] {
        let length = dot(sight, sight).sqrt();
        let along = dot(normal, sight) / length;
        let cosine = along.abs();
        let cosine = if cosine < 1.0 { cosine } else { 1.0 };
        let Some([up, key]) = self.soft else {
            let falloff = cosine * ((1.0 - RELIEF) + RELIEF * cosine);
            let strength = if self.flat { 1.0 } else { (AMBIENT + (1.0 - AMBIENT) * falloff) * open };
            return [color[0] * strength, color[1] * strength, color[2] * strength];
        };
        let turn = if along > 0.0 { -1.0 } else { 1.0 };
        let positive = |c: f64| if c > 0.0 { c } else { 0.0 };
        let k = positive(turn * dot(normal, key));
        let half = [0, 1, 2].map(|a| key[a] - sight[a] / length);
        let h = positive(turn * dot(normal, half) / dot(half, half).sqrt());
        // The 40th power.
        let (h2, h8) = (h * h, h * h * (h * h) * (h * h) * (h * h));
        let h32 = h8 * h8 * (h8 * h8);
        let shine = OF_SHINE * open * (h32 * (h2 * h2) * (h2 * h2));
        let by_key =
            OF_KEY * k * (KEY_FLAT + (1.0 - KEY_FLAT) * k) * (KEY_CLOSED + (1.0 - KEY_CLOSED) * open);
        let by_eye = OF_EYE * cosine * cosine * open;
        let by_sky = (OF_SKY + OF_ZENITH * (1.0 + turn * dot(normal, up))) * open;
        [0, 1, 2].map(|c| color[c] * (by_key * KEY_COLOR[c] + by_eye + by_sky * SKY_COLOR[c]) + shine)
    }
}

/// Normals, colours and openness of a tile's pixels, axis by axis.
pub(crate) struct Lit {
    /// Unit normals of the world.
    pub(crate) normals: [[f64; RAYS]; 3],
    /// Linear RGB of the surfaces.
    pub(crate) colors: [[f64; RAYS]; 3],
    /// Openness of the surroundings.
    pub(crate) open: [f64; RAYS],
}

impl Lit {
    pub(crate) const NOTHING: Self =
        Self { normals: [[1.0; RAYS]; 3], colors: [[0.0; RAYS]; 3], open: [1.0; RAYS] };
}

/// Colours of a tile's pixels, equal to [`Rig::of`] and [`Shader::encode`] one by one.
pub(crate) struct TileLight<'a> {
    pub(crate) sight: &'a PixelRays<'a>,
    pub(crate) rig: &'a Rig,
    /// Column and row of the tile's first pixel.
    pub(crate) corner: [usize; 2],
    pub(crate) lit: &'a Lit,
    /// Indices in the table of codes, colour by colour.
    pub(crate) out: &'a mut [[u16; RAYS]; 3],
}

impl Kernel for TileLight<'_> {
    type Output = ();

    // Loops over arrays: they are vectorised for the form that runs them.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    fn run(self, _: impl Lanes) {
        let Self { sight, rig, corner, lit, out } = self;
        let mut sights = [[0.0; RAYS]; 3];
        sight.directions(corner, &mut sights);
        for i in 0..RAYS {
            let n = [lit.normals[0][i], lit.normals[1][i], lit.normals[2][i]];
            let s = [sights[0][i], sights[1][i], sights[2][i]];
            let color = [lit.colors[0][i], lit.colors[1][i], lit.colors[2][i]];
            let colors = rig.of(color, n, s, lit.open[i]);
            for c in 0..3 {
                let part = if colors[c] < 1.0 { colors[c] } else { 1.0 };
                out[c][i] = (part * STEPS as f64 + 0.5) as i32 as u16;
            }
        }
    }
}

/// Linear RGB of a colour in sRGB.
pub(crate) fn linear_of(color: [u8; 3]) -> [f64; 3] {
    color.map(|code| linear(f64::from(code) / 255.0))
}

/// Linear light of an sRGB value 0..=1 (IEC 61966-2-1).
pub(crate) fn linear(s: f64) -> f64 {
    if s <= 0.040_45 {
        return s / 12.92;
    }
    let x = (s + 0.055) / 1.055;
    // x^2.4 = x^2 * (x^2)^(1/5), the root by Newton's method.
    let square = x * x;
    let mut root = 1.0;
    for _ in 0..40 {
        let power = root * root * root * root;
        root -= (power * root - square) / (5.0 * power);
    }
    square * root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_is_the_standard_curve() {
        for i in 0..=255_u8 {
            let s = f64::from(i) / 255.0;
            let want = if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            assert!((linear(s) - want).abs() < 1e-12);
        }
        let shader = Shader::new();
        // 0.5 -> 188, 0.2140 -> 127 or 128, and the ends.
        assert_eq!((shader.encode(0.0), shader.encode(0.5), shader.encode(1.0)), (0, 188, 255));
        assert_eq!(SURFACE.map(|c| shader.encode(c)), [236, 226, 208]);
    }

    #[test]
    fn faces_towards_the_eye_are_brightest_and_edges_keep_some_light() {
        // Axes to the right, up, forward, as for a camera at the front.
        let axes = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];
        for shading in Shading::ALL {
            let light = Rig::new(*shading, axes);
            let of = |normal, open| light.of(SURFACE, normal, [0.0, 3.0, 0.0], open);
            let (facing, half, edge) =
                (of([0.0, -1.0, 0.0], 1.0), of([0.8, -0.6, 0.0], 1.0), of([1.0, 0.0, 0.0], 1.0));
            if *shading == Shading::Flat {
                assert_eq!([half, edge, of([0.0, -1.0, 0.0], 0.5)], [SURFACE; 3]);
                continue;
            }
            assert!(facing[0] > half[0] && half[0] > edge[0] && edge[0] > 0.02, "{shading:?}");
            // Both sides are lit alike, and closed places are darker.
            assert_eq!(of([0.0, 1.0, 0.0], 1.0), facing);
            assert!(of([0.0, -1.0, 0.0], 0.5)[0] < facing[0]);
            if *shading == Shading::Soft {
                // Brightest between the eye and the key lamp.
                let [_, key] = light.soft.unwrap();
                assert!((dot(key, key) - 1.0).abs() < 1e-9);
                assert!(
                    of(key, 1.0)[0] > facing[0] && of([key[0], key[1], -key[2]], 1.0)[0] < of(key, 1.0)[0]
                );
            } else {
                assert_eq!(facing, SURFACE);
            }
        }
    }
}
