//! Light and colour: a lamp at the eye, a bone-grey surface, sRGB out.
//!
//! All arithmetic is IEEE addition, multiplication, division and square root in a fixed order, so pixels
//! are the same on every machine; powers are not taken from the system.

use super::form::LanesKernel;
use super::lanes::Lanes;
use super::sight::Sight;
use super::tile::RAYS;

/// Part of the light that reaches every surface: keeps edges visible on a black background, and dark enough
/// to be seen on a white one.
const AMBIENT: f64 = 0.07;

/// How much of the light falls off with the squared cosine instead of the cosine: a lamp at the eye makes
/// shapes flat in the middle, and this gives them back some relief.
const RELIEF: f64 = 0.6;

/// Colour of a surface that faces the light, in linear RGB (sRGB 236, 226, 208).
const SURFACE: [f64; 3] = [0.838_8, 0.760_5, 0.630_8];

/// Entries of the table from linear light to sRGB.
const STEPS: usize = 4096;

/// Turns normals into colours.
#[derive(Clone, Debug)]
pub(crate) struct Shader {
    srgb: Vec<u8>,
    /// Linear light of every sRGB code.
    lights: Vec<f64>,
}

impl Default for Shader {
    fn default() -> Self {
        Self::new()
    }
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
        let lights = (0..=255_u8).map(|code| linear(f64::from(code) / 255.0)).collect();
        Self { srgb, lights }
    }

    /// Linear RGB of a surface with this unit normal, seen along `sight` (any length, not null).
    ///
    /// Both sides of a surface are lit alike, so that a model can be looked at from within.
    #[inline]
    pub(crate) fn light(&self, normal: [f64; 3], sight: [f64; 3]) -> [f64; 3] {
        Self::lit(SURFACE, normal, sight)
    }

    /// Linear light of a colour (sRGB).
    #[inline]
    pub(crate) fn decode(&self, color: [u8; 3]) -> [f64; 3] {
        color.map(|code| self.lights.get(usize::from(code)).copied().unwrap_or_default())
    }

    /// [`Shader::light`] of a surface of this colour (linear RGB).
    #[inline]
    pub(crate) fn lit(color: [f64; 3], normal: [f64; 3], sight: [f64; 3]) -> [f64; 3] {
        let along = normal[0] * sight[0] + normal[1] * sight[1] + normal[2] * sight[2];
        let length = (sight[0] * sight[0] + sight[1] * sight[1] + sight[2] * sight[2]).sqrt();
        let cosine = (along / length).abs().min(1.0);
        let falloff = cosine * ((1.0 - RELIEF) + RELIEF * cosine);
        let strength = AMBIENT + (1.0 - AMBIENT) * falloff;
        color.map(|c| c * strength)
    }

    /// sRGB code at a place in the table.
    #[inline]
    pub(super) fn code(&self, at: u16) -> u8 {
        self.srgb.get(usize::from(at)).copied().unwrap_or(255)
    }

    /// sRGB code of linear light 0..=1.
    #[inline]
    pub(crate) fn encode(&self, light: f64) -> u8 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let at = (light.clamp(0.0, 1.0) * STEPS as f64 + 0.5) as usize;
        self.srgb.get(at).copied().unwrap_or(255)
    }
}

/// Normals and openness of a tile's pixels, axis by axis.
pub(super) struct Lit {
    /// Normals in the frame of the boxes, of any length, not null.
    pub(super) normals: [[f64; RAYS]; 3],
    /// Part of the light that comes through.
    pub(super) open: [f64; RAYS],
}

impl Lit {
    pub(super) const NOTHING: Self = Self { normals: [[1.0; RAYS]; 3], open: [1.0; RAYS] };
}

/// Colours of a tile's pixels: the same as those of [`Shader::light`] and [`Shader::encode`] one by one.
pub(super) struct TileLight<'a> {
    pub(super) sight: &'a Sight<'a>,
    /// Column and row of the tile's first pixel.
    pub(super) corner: [usize; 2],
    pub(super) lit: &'a Lit,
    /// Places in the table of codes, colour by colour.
    pub(super) out: &'a mut [[u16; RAYS]; 3],
}

impl LanesKernel for TileLight<'_> {
    type Output = ();

    // Loops over arrays instead of lanes or closures: they are vectorised for the form that runs them.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    fn run(self, _: impl Lanes) {
        let Self { sight, corner, lit, out } = self;
        let rows = sight.space().normal_rows();
        let mut sights = [[0.0; RAYS]; 3];
        sight.directions(corner, &mut sights);
        for i in 0..RAYS {
            let n = [lit.normals[0][i], lit.normals[1][i], lit.normals[2][i]];
            let s = [sights[0][i], sights[1][i], sights[2][i]];
            let mut world = [0.0; 3];
            for a in 0..3 {
                world[a] = rows[a][0] * n[0] + rows[a][1] * n[1] + rows[a][2] * n[2];
            }
            let length = (world[0] * world[0] + world[1] * world[1] + world[2] * world[2]).sqrt();
            let unit = if length > 0.0 { length } else { 1.0 };
            let along = world[0] / unit * s[0] + world[1] / unit * s[1] + world[2] / unit * s[2];
            let length = (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]).sqrt();
            let cosine = (along / length).abs();
            let cosine = if cosine < 1.0 { cosine } else { 1.0 };
            let falloff = cosine * ((1.0 - RELIEF) + RELIEF * cosine);
            let strength = AMBIENT + (1.0 - AMBIENT) * falloff;
            for c in 0..3 {
                let light = SURFACE[c] * strength * lit.open[i];
                out[c][i] = (light * STEPS as f64 + 0.5) as i32 as u16;
            }
        }
    }
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
        let shader = Shader::new();
        let facing = shader.light([0.0, -1.0, 0.0], [0.0, 3.0, 0.0]);
        let half = shader.light([0.8, -0.6, 0.0], [0.0, 1.0, 0.0]);
        let edge = shader.light([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        assert!(facing[0] > half[0] && half[0] > edge[0] && edge[0] > 0.05);
        assert_eq!(facing, SURFACE);
        assert_eq!(shader.light([0.0, 1.0, 0.0], [0.0, 3.0, 0.0]), facing);
    }
}
