//! Triangles in memory.

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
