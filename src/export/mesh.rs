//! Triangles in memory.

use std::io;

use super::write::{Sink, Vertex, unit};
use crate::render::shade::Shader;

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

/// Takes the triangles of an export.
pub(super) struct MeshSink<'a> {
    pub(super) mesh: &'a mut Mesh,
    pub(super) normals: bool,
    /// Turns light into colours, if there are any.
    pub(super) colors: Option<Shader>,
}

impl Sink for MeshSink<'_> {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.mesh.vertices.push(vertex.at);
        if self.normals {
            self.mesh.normals.push(unit(vertex.normal));
        }
        if let Some(shader) = &self.colors {
            self.mesh.colors.push(vertex.light.map(|light| shader.encode(f64::from(light) / 65535.0)));
        }
        Ok(())
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.mesh.faces.push(corners);
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}
