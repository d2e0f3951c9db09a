//! Colours and normals of vertices, looked up by the numbers of vertices.

use std::ops::RangeInclusive;

use super::appearance::{Appearance, linear};
use super::stop::Stop;
use super::vertices::{FEW_PAGES, Pages, Vertices};
use crate::fault::{Fault, bad};

#[derive(Debug, Default)]
pub(super) struct VertexLooks {
    /// sRGB, and the factor that brings it to 0 to 1.
    pub(super) colors: Option<(Vertices, f64)>,
    pub(super) normals: Option<Vertices>,
    /// Colours of triangles, by their numbers, where vertices have none.
    pub(super) of_triangles: Option<(Vertices, f64)>,
}

/// Reader of looks, while triangles are read.
pub(super) struct LookReader<'a> {
    colors: Option<(Pages<'a>, f64)>,
    normals: Option<Pages<'a>>,
    of_triangles: Option<(Pages<'a>, f64)>,
}

impl VertexLooks {
    pub(super) fn open(&self) -> LookReader<'_> {
        LookReader {
            colors: paged(self.colors.as_ref()),
            normals: self.normals.as_ref().map(|of| Pages::new(of, FEW_PAGES)),
            of_triangles: paged(self.of_triangles.as_ref()),
        }
    }
}

fn paged(of: Option<&(Vertices, f64)>) -> Option<(Pages<'_>, f64)> {
    of.map(|(of, scale)| (Pages::new(of, FEW_PAGES), *scale))
}

#[expect(clippy::cast_possible_truncation, reason = "looks are in single precision")]
pub(super) fn single(v: [f64; 3]) -> [f32; 3] {
    v.map(|c| c as f32)
}

/// Parts of a colour; a little beyond 0 and 1 for the rounding of text.
const PARTS: RangeInclusive<f64> = -0.001..=1.001;

/// Linear light of a stored colour (0 to 1).
///
/// # Errors
/// A part outside 0 to 1, such as one out of 255, or NaN.
pub(super) fn light(stored: [f64; 3]) -> Result<[f32; 3], Fault> {
    match stored.into_iter().find(|part| !PARTS.contains(part)) {
        Some(part) => Err(bad!("{part} is not a part of a colour, from 0 to 1; correct its colours")),
        None => Ok(single(stored).map(|c| linear(c.clamp(0.0, 1.0)))),
    }
}

/// Linear light of a colour as PLY stores it, by the factor of its type.
///
/// # Errors
/// A part is outside the range of colours of its type.
pub(super) fn scaled(stored: [f64; 3], scale: f64) -> Result<[f32; 3], Fault> {
    let wrong = |_| {
        let part = stored.into_iter().find(|part| !PARTS.contains(&(part * scale))).unwrap_or_default();
        bad!(
            "{part} is not a part of a colour: these are uchar (0 to 255), ushort (0 to 65535) or float (0 to 1); correct its colours"
        )
    };
    light(stored.map(|part| part * scale)).map_err(wrong)
}

impl LookReader<'_> {
    /// The look of a triangle, by the numbers of its vertices.
    pub(super) fn look(&mut self, corners: [u32; 3], face: u64) -> Result<Appearance, Stop> {
        let mut look = Appearance::NONE;
        if let Some((pages, scale)) = &mut self.colors {
            let mut three = [[0.0; 3]; 3];
            for (out, at) in three.iter_mut().zip(corners) {
                *out = scaled(pages.get(at.into(), face)?, *scale)?;
            }
            look.colors = Some(three);
        }
        if let Some(pages) = &mut self.normals {
            let mut three = [[0.0; 3]; 3];
            for (out, at) in three.iter_mut().zip(corners) {
                *out = single(pages.get(at.into(), face)?);
            }
            look.normals = Some(three);
        }
        Ok(look)
    }

    /// Like [`LookReader::look`], for a triangle with a number of its own from 0.
    pub(super) fn look_of(
        &mut self,
        triangle: u64,
        corners: [u32; 3],
        face: u64,
    ) -> Result<Appearance, Stop> {
        let mut look = self.look(corners, face)?;
        if let Some((pages, scale)) = &mut self.of_triangles {
            look.colors = Some([scaled(pages.get(triangle, face)?, *scale)?; 3]);
        }
        Ok(look)
    }
}
