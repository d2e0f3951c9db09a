//! Colours of vertices: means over skin voxels, in linear light.

use crate::render::shade::linear;

/// Linear red, green and blue, in 65535ths.
pub(super) type Light = [u16; 3];

/// Colour of models without one, as in pictures (sRGB).
pub(super) const UNCOLORED: [u8; 3] = [236, 226, 208];

/// The linear light of every stored value, in 65535ths.
#[derive(Debug)]
pub(super) struct Lights([u16; 256]);

/// A sum of colours.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mixture {
    sum: [u64; 3],
    count: u64,
}

impl Mixture {
    pub(super) fn add(&mut self, light: Light) {
        (0..3).for_each(|k| self.sum[k] += u64::from(light[k]));
        self.count += 1;
    }

    /// The mean, rounded; `nothing` for an empty sum.
    pub(super) fn mean(&self, nothing: Light) -> Light {
        if self.count == 0 {
            return nothing;
        }
        self.sum.map(|sum| u16::try_from((sum + self.count / 2) / self.count).unwrap_or(u16::MAX))
    }
}

impl Lights {
    pub(super) fn new() -> Self {
        let mut all = [0; 256];
        for (stored, light) in (0_u8..=255).zip(&mut all) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65535")]
            let rounded = (linear(f64::from(stored) / 255.0) * 65535.0).round() as u16;
            *light = rounded;
        }
        Self(all)
    }

    pub(super) fn of(&self, color: [u8; 3]) -> Light {
        color.map(|stored| self.0[usize::from(stored)])
    }

    /// The colour of vertices without a coloured voxel near them.
    pub(super) fn nothing(&self) -> Light {
        self.of(UNCOLORED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::shade::Shader;

    #[test]
    fn every_stored_value_comes_back() {
        let (lights, shader) = (Lights::new(), Shader::new());
        for stored in 0..=255 {
            let light = lights.of([stored; 3]);
            let mut mixture = Mixture::default();
            (0..7).for_each(|_| mixture.add(light));
            assert_eq!(mixture.mean([0; 3]), light);
            assert_eq!(shader.encode(f64::from(light[0]) / 65535.0), stored);
        }
        assert_eq!(Mixture::default().mean([1, 2, 3]), [1, 2, 3]);
    }
}
