//! The normals of a tile's pixels together: normals of skin are judged 64 at once, and pixels of one face share theirs.

use super::neighborhood::Neighborhood;
use super::repair::tile::{Doubts, Judge, Settle, Stored, Verdicts};
use super::shading_normal::{Line, Normals, PixelHit, towards_eye};
use crate::cpu::Form;
use crate::render::tile::RAYS;

/// The pixels of a tile selected by `wanted`.
fn each(wanted: u64, seen: &[PixelHit]) -> impl Iterator<Item = (usize, PixelHit)> {
    let mut left = wanted;
    std::iter::from_fn(move || {
        let at = left.trailing_zeros() as usize;
        let pixel = *seen.get(at)?;
        left &= left - 1;
        Some((at, pixel))
    })
}

/// Base-2 logarithm of the number of cached normals, and an odd number that scatters their keys.
const KEPT_BITS: u32 = 9;
const MIXER: u64 = 0x9e37_79b9_7f4a_7c15;

/// A normal that is known, or will be once the tile's doubtful normals are settled.
#[derive(Clone, Copy)]
enum Normal {
    /// A normal in the frame of the boxes.
    Known([f64; 3]),
    /// The number of the doubtful normal.
    Awaited(u8),
}

/// Cached normals of faces for a worker, and buffers for the normals of a tile.
pub(crate) struct TileNormals {
    form: Form,
    stored: Stored,
    doubts: Doubts,
    /// Round, box and face, and the normal displayed there.
    normals: Vec<(u32, u64, Normal)>,
    round: u32,
}

impl TileNormals {
    pub(crate) fn new(form: Form) -> Self {
        let nothing = (0, 0, Normal::Awaited(0));
        let (stored, doubts) = (Stored::NOTHING, Doubts::NOTHING);
        Self { form, stored, doubts, normals: vec![nothing; 1 << KEPT_BITS], round: 0 }
    }

    fn slot(seen: PixelHit) -> usize {
        (seen.key().wrapping_mul(MIXER) >> (u64::BITS - KEPT_BITS)) as usize
    }

    /// The normal of a box's face, if it is cached.
    #[inline]
    fn recall(&self, seen: PixelHit) -> Option<Normal> {
        let (round, key, normal) = self.normals.get(Self::slot(seen))?;
        ((*round, *key) == (self.round, seen.key())).then_some(*normal)
    }

    #[inline]
    fn keep(&mut self, seen: PixelHit, normal: Normal) {
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
        let (mut noted, mut alone, mut to_eye) = (0_u64, 0_u64, 0_u64);
        let edge_mm = all.judged_together();
        for (at, pixel) in seen.iter().enumerate().filter(|(_, pixel)| pixel.is_hit()) {
            if edge_mm.is_some() && all.note(&mut self.stored, at, *pixel) {
                noted |= 1 << (at % RAYS);
            } else {
                alone |= 1 << (at % RAYS);
            }
        }
        let mut judged = Verdicts::NOTHING;
        if let (Some(edge_mm), 1..) = (edge_mm, noted) {
            self.form.run(Judge { stored: &self.stored, edge_mm, out: &mut judged });
            normals = judged.normals;
        }
        let mut put = |at: usize, normal: [f64; 3]| {
            for (out, part) in normals.iter_mut().zip(normal) {
                out[at % RAYS] = part;
            }
        };
        for (at, pixel) in each(alone, seen) {
            match self.one(all, around, pixel, || line(at)) {
                Some(normal) => put(at, normal),
                None => to_eye |= 1 << at,
            }
        }
        self.doubts.clear();
        let mut awaited = [0_u8; RAYS];
        let mut unsettled = 0_u64;
        for (at, pixel) in each(noted & judged.doubts, seen) {
            let normal = self.recall(pixel).or_else(|| {
                let scatter = all.scatter(around, pixel, || line(at))?;
                let awaited = Normal::Awaited(self.doubts.add(&judged, &self.stored, at, scatter));
                self.keep(pixel, awaited);
                Some(awaited)
            });
            match normal {
                Some(Normal::Known(normal)) => put(at, normal),
                Some(Normal::Awaited(number)) => {
                    awaited[at % RAYS] = number;
                    unsettled |= 1 << at;
                }
                None => {}
            }
        }
        if let (Some(edge_mm), 1..) = (edge_mm, unsettled) {
            self.form.run(Settle { doubts: &mut self.doubts, edge_mm });
            for (at, pixel) in each(unsettled, seen) {
                let normal = self.doubts.normal(awaited[at % RAYS]);
                put(at, normal);
                self.keep(pixel, Normal::Known(normal));
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
        match self.recall(seen) {
            Some(Normal::Known(normal)) => Some(normal),
            _ => {
                let normal = all.in_boxes(around, seen, line)?;
                self.keep(seen, Normal::Known(normal));
                Some(normal)
            }
        }
    }
}
