//! One ray after another, from the world and back to it.

use super::cells::Cells;
use super::form::Form;
use super::picture::cell_coordinates;
use super::single;
use super::surface::Skin;
use super::{GridSpace, RenderError};
use crate::geom::VoxelIndex;
use crate::load::{Model, ModelView, NodeView};

/// Traces single rays through a model, in world coordinates (LPS mm).
///
/// Every decision is exact, as in pictures: the ray is rounded once, and no ray slips between two voxels that
/// touch. Cost: some hundred nanoseconds a ray; for pictures, [`crate::render()`] is several times faster.
///
/// ```
/// # use infobyte::{BuildOptions, Dims, Model, Threshold, RayCaster, Voxels};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("box.oct");
/// # let cube = Voxels::from_fn(Dims::new(8, 8, 8).unwrap(), |p| u8::from(p.iter().all(|v| (2..6).contains(v))));
/// # infobyte::build(&cube, &BuildOptions { threshold: Threshold::Iso(1.0), ..Default::default() }, &path)?;
/// let model = Model::open(&path)?;
/// let hit = RayCaster::new(&model)?.first_hit([4.0, 4.0, -10.0], [0.0, 0.0, 1.0])?;
/// assert_eq!(hit.unwrap().voxel, [4, 4, 2]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct RayCaster<'a> {
    view: ModelView<'a>,
    space: GridSpace,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The point on the voxel's face, or on the surface within the cell, in LPS mm.
    pub position_mm: [f64; 3],
    /// Distance along the ray, as a multiple of the direction's length.
    pub t: f64,
    /// Index of the skin voxel (x, y, z), or of the cell: cell i lies between samples i - 1 and i.
    pub voxel: [u32; 3],
    /// Unit vector out of the surface, where the model has normals.
    pub normal: Option<[f64; 3]>,
}

impl<'a> RayCaster<'a> {
    /// Prepares rays through a model.
    ///
    /// # Errors
    /// [`RenderError::SingularAffine`] for a model whose axes span no volume.
    pub fn new<D: AsRef<[u8]>>(model: &'a Model<D>) -> Result<Self, RenderError> {
        Ok(Self { view: model.view(), space: GridSpace::new(model.dims(), &model.affine())? })
    }

    /// The first skin voxel on a ray, if it meets one: `origin_mm` in LPS mm, `direction` of any length. A ray that
    /// starts in a skin voxel meets that one.
    ///
    /// # Errors
    /// [`RenderError::Ray`] for a ray that is not finite or has no direction.
    pub fn first_hit(
        &self,
        origin_mm: [f64; 3],
        direction: [f64; 3],
    ) -> Result<Option<SurfacePoint>, RenderError> {
        let Some(ray) = self.space.ray(origin_mm, direction)? else { return Ok(None) };
        let cells = self.view.cells().map(Cells::new);
        let trace = match &cells {
            Some(cells) => single::trace(Form::best(), &self.view, cells, &ray, 0),
            None => single::trace(Form::best(), &self.view, &Skin, &ray, 0),
        };
        let Some(hit) = trace.hit else { return Ok(None) };
        let position_mm = std::array::from_fn(|i| origin_mm[i] + hit.t * direction[i]);
        let voxel = hit.voxel(&self.view);
        let normal = match (&cells, voxel) {
            (Some(cells), Some(cell)) => {
                let u = cell_coordinates(&self.space, hit.cell, position_mm);
                Some(self.space.index_normal_to_world(cells.normal(cell, u)))
            }
            _ => voxel
                .and_then(|voxel| self.view.voxel_direction(VoxelIndex::new(voxel)))
                .map(|stored| self.space.normal_to_world(stored.map(f64::from))),
        };
        Ok(Some(SurfacePoint { position_mm, t: hit.t, voxel: hit.cell, normal }))
    }
}
