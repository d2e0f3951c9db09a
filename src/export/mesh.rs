//! Triangles in memory.

use super::decimate::{Goal, reduce};

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
    /// Makes at most so many triangles, closed as before, by collapsing edges (quadric error metrics, Garland and Heckbert
    /// 1997); corners that stay move, and keep their normals and colours. Returns the greatest distance in mm between both
    /// surfaces, as measured from corners and middles of triangles, and from points half a voxel (`voxel_mm`) apart.
    ///
    /// Memory: some 300 bytes a triangle. Cost: some microseconds a triangle.
    pub fn reduce(&mut self, triangles: u64, voxel_mm: f64) -> f64 {
        let goal = Goal { triangles: Some(triangles), error_mm: None };
        let distance = reduce(&mut self.vertices, &mut self.faces, goal, voxel_mm);
        let (mut news, mut kept) = (vec![None; self.vertices.len()], Vec::new());
        for corner in self.faces.as_flattened_mut() {
            let old = *corner as usize;
            *corner = *news[old].get_or_insert_with(|| {
                kept.push(old);
                u32::try_from(kept.len() - 1).unwrap_or(u32::MAX)
            });
        }
        self.vertices = kept.iter().map(|old| self.vertices[*old]).collect();
        self.normals = kept.iter().filter_map(|old| self.normals.get(*old).copied()).collect();
        self.colors = kept.iter().filter_map(|old| self.colors.get(*old).copied()).collect();
        distance
    }
}
