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
    /// Makes at most so many triangles, closed as before, by collapsing edges (quadric error metrics, Garland and Heckbert
    /// 1997); corners that stay move, and keep their normals and colours. Returns the greatest distance in mm between both
    /// surfaces, as measured from corners and middles of triangles, and from points half a voxel (`voxel_mm`) apart.
    ///
    /// Memory: some 220 bytes a triangle. Cost: some microseconds a triangle.
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
        let (few, apart) = reduce(fine, goal, voxel_mm, progress)?;
        self.normals = few.olds.iter().filter_map(|old| self.normals.get(*old as usize).copied()).collect();
        self.colors = few.olds.iter().filter_map(|old| self.colors.get(*old as usize).copied()).collect();
        (self.vertices, self.faces) = (few.at, few.faces);
        Ok(apart.distance_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{add_scaled, cross, dot};
    use crate::{BuildOptions, Dims, Model, Threshold, Voxels};
    use std::collections::HashSet;

    /// Noise: sheets touch in many places, and there are hundreds of parts.
    fn noise() -> Mesh {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.oct");
        let value = |p: [u32; 3]| {
            let mixed = (p[0] ^ p[1] << 8 ^ p[2] << 16).wrapping_mul(0x9e37_79b9);
            ((mixed ^ mixed >> 15).wrapping_mul(0x85eb_ca6b) >> 8) as f32 / (1 << 23) as f32 - 1.2
        };
        let volume = Voxels::from_fn(Dims::new(24, 24, 24).unwrap(), value);
        let options = BuildOptions { threshold: Threshold::Iso(0.0), ..BuildOptions::default() };
        crate::build(&volume, &options, &path).unwrap();
        crate::triangles(&Model::open(&path).unwrap(), &Silent).unwrap()
    }

    #[test]
    fn noise_has_no_more_triangles_than_were_asked_for_and_is_closed() {
        let fine = noise();
        assert!(fine.faces.len() > 20_000, "{}", fine.faces.len());
        let place = |mesh: &Mesh, corner: u32| mesh.vertices[corner as usize].map(f64::from);
        for wanted in [10_000, 3000, 300] {
            let mut mesh = fine.clone();
            let stated = mesh.reduce(wanted, 1.0);
            assert!(mesh.faces.len() as u64 <= wanted, "{} of {wanted}", mesh.faces.len());
            assert!(mesh.faces.len() as u64 * 4 > wanted * 3, "{} of {wanted}", mesh.faces.len());
            let places: HashSet<_> =
                mesh.vertices.iter().map(|at| at.map(|c| (c + 0.0).to_bits())).collect();
            assert_eq!(places.len(), mesh.vertices.len());
            assert_eq!(mesh.normals.len(), mesh.vertices.len());
            let mut edges = HashSet::new();
            for face in &mesh.faces {
                let [a, b, c] = face.map(|corner| place(&mesh, corner));
                let normal = cross(add_scaled(b, -1.0, a), add_scaled(c, -1.0, a));
                assert!(dot(normal, normal) > 0.0);
                assert!((0..3).all(|k| edges.insert([face[k], face[(k + 1) % 3]])), "an edge twice");
            }
            assert!(edges.iter().all(|[a, b]| edges.contains(&[*b, *a])), "an open edge");
            // Corners lie no nearer to corners than to the surface: some are as far away as is stated.
            let nearest = |at: [f32; 3], mesh: &Mesh| {
                let square = |other: &[f32; 3]| {
                    let way = add_scaled(at.map(f64::from), -1.0, other.map(f64::from));
                    dot(way, way)
                };
                mesh.vertices.iter().map(square).fold(f64::INFINITY, f64::min).sqrt()
            };
            let most = fine.vertices.iter().step_by(20).map(|at| nearest(*at, &mesh)).fold(0.0, f64::max);
            assert!(stated > 0.0 && stated.is_finite() && most < stated + 8.0, "{most} {stated}");
        }
    }
}
