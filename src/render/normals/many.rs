//! The normals of a tile's pixels together: pixels of one face share theirs.

use super::neighborhood::Neighborhood;
use super::shading_normal::{Line, Normals, PixelHit, towards_eye};
use crate::cpu::Form;
use crate::render::tile::RAYS;

/// Base-2 logarithm of the number of cached normals, and an odd number that scatters their keys.
const KEPT_BITS: u32 = 9;
const MIXER: u64 = 0x9e37_79b9_7f4a_7c15;

/// Cached normals of faces for a worker.
pub(crate) struct TileNormals {
    form: Form,
    /// Round, box and face, and the normal displayed there, in the frame of the boxes.
    normals: Vec<(u32, u64, [f64; 3])>,
    round: u32,
}

impl TileNormals {
    pub(crate) fn new(form: Form) -> Self {
        Self { form, normals: vec![(0, 0, [0.0; 3]); 1 << KEPT_BITS], round: 0 }
    }

    fn slot(seen: PixelHit) -> usize {
        (seen.key().wrapping_mul(MIXER) >> (u64::BITS - KEPT_BITS)) as usize
    }

    /// The normal of a box's face, if it is cached.
    #[inline]
    fn recall(&self, seen: PixelHit) -> Option<[f64; 3]> {
        let (round, key, normal) = self.normals.get(Self::slot(seen))?;
        ((*round, *key) == (self.round, seen.key())).then_some(*normal)
    }

    #[inline]
    fn keep(&mut self, seen: PixelHit, normal: [f64; 3]) {
        if let Some(place) = self.normals.get_mut(Self::slot(seen)) {
            *place = (self.round, seen.key(), normal);
        }
    }

    /// Begins a row of tiles without normals, so that the picture does not depend on which worker paints which row.
    pub(crate) fn forget(&mut self) {
        self.round += 1;
    }

    /// Fills in the displayed world unit normals at a tile's hits; `line` gives the line of sight of a pixel.
    pub(crate) fn fill(
        &mut self,
        normals: &Normals<'_>,
        around: &mut Neighborhood,
        hits: &[PixelHit],
        line: impl Fn(usize) -> Line,
        out: &mut [[f32; 3]],
    ) {
        let (mut parts, to_eye) = self.in_boxes(normals, around, hits, &line);
        normals.to_units(self.form, &mut parts);
        for ((at, _), out) in hits.iter().enumerate().zip(out).filter(|((_, hit), _)| hit.is_hit()) {
            let normal = if to_eye >> at & 1 == 1 {
                towards_eye(line(at))
            } else {
                [parts[0][at % RAYS], parts[1][at % RAYS], parts[2][at % RAYS]]
            };
            #[expect(clippy::cast_possible_truncation, reason = "single precision will do")]
            let single = normal.map(|c| c as f32);
            *out = single;
        }
    }

    /// The normals of a tile's hits in the frame of the boxes, of any length; and the mask of pixels whose normals
    /// point to the eye instead, for lack of a normal in that frame.
    fn in_boxes(
        &mut self,
        all: &Normals<'_>,
        around: &mut Neighborhood,
        seen: &[PixelHit],
        line: impl Fn(usize) -> Line,
    ) -> ([[f64; RAYS]; 3], u64) {
        let mut normals = [[1.0; RAYS]; 3];
        let mut to_eye = 0_u64;
        for (at, pixel) in seen.iter().enumerate().take(RAYS).filter(|(_, pixel)| pixel.is_hit()) {
            match self.one(all, around, *pixel, || line(at)) {
                Some(normal) => normals.iter_mut().zip(normal).for_each(|(out, part)| out[at] = part),
                None => to_eye |= 1 << at,
            }
        }
        (normals, to_eye)
    }

    /// [`Normals::in_boxes`] for one pixel; pixels of one face have one normal, which is found once.
    #[inline]
    fn one(
        &mut self,
        all: &Normals<'_>,
        around: &mut Neighborhood,
        seen: PixelHit,
        line: impl Fn() -> Line,
    ) -> Option<[f64; 3]> {
        // Without a face it may depend on the line of sight.
        if !seen.is_of_face() || all.differ_by_place() {
            return all.in_boxes(around, seen, line);
        }
        if let Some(normal) = self.recall(seen) {
            return Some(normal);
        }
        let normal = all.in_boxes(around, seen, line)?;
        self.keep(seen, normal);
        Some(normal)
    }
}
