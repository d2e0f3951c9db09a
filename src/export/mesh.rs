//! Triangles in memory.

use std::mem::take;

use super::decimate::{Goal, Surface, reduce};
use crate::progress::{Progress, Silent, Stopped};

/// A surface as triangles, in millimetres of the patient's axes (LPS): closed, without holes or edges of more than two
/// triangles.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners.
    pub vertices: Vec<[f32; 3]>,
    /// Numbers of the corners of each triangle; seen from outside they run anticlockwise.
    pub faces: Vec<[u32; 3]>,
    /// A unit vector out of the surface for each corner, zeros where none is known; empty for a model without normals.
    pub normals: Vec<[f32; 3]>,
    /// Colour of each corner (sRGB); empty for a model without colours.
    pub colors: Vec<[u8; 3]>,
}

impl Mesh {
    /// Reduces the mesh to at most so many triangles, closed as before, by collapsing edges (quadric error metrics,
    /// Garland and Heckbert 1997); remaining corners move, and keep their normals and colours. Returns the greatest
    /// distance in mm between both surfaces, as measured from corners and middles of triangles, and from points half a
    /// voxel (`voxel_mm`) apart.
    ///
    /// Memory: some 260 bytes a triangle. Cost: 5 to 35 microseconds a triangle.
    pub fn reduce(&mut self, triangles: u64, voxel_mm: f64) -> f64 {
        self.reduced(triangles, voxel_mm, &Silent).unwrap_or_default()
    }

    pub(crate) fn reduced(
        &mut self,
        triangles: u64,
        voxel_mm: f64,
        progress: &dyn Progress,
    ) -> Result<f64, Stopped> {
        let goal = Goal { triangles: Some(triangles), error_mm: None };
        let fine = Surface::new(take(&mut self.vertices), take(&mut self.faces));
        let (few, apart) = reduce(fine, goal, false, voxel_mm, progress)?;
        self.normals = few.olds.iter().filter_map(|old| self.normals.get(*old as usize).copied()).collect();
        self.colors = few.olds.iter().filter_map(|old| self.colors.get(*old as usize).copied()).collect();
        (self.vertices, self.faces) = (few.at, few.faces);
        Ok(apart.distance_mm)
    }
}
