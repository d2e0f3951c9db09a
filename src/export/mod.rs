//! From a model back to what other programs read: the surface as triangles, the skin as points, the solid as a mask.
//!
//! ```text
//!   octree --> skin of a slice --> what it encloses --> samples inside, in rows --> cubes between two slices
//!     (enclosed)                                          (signs)                     |
//!   STL, PLY, OBJ, GLB <-- triangles <-- a vertex for each patch, a polygon around each crossed edge (dual)
//! ```
//!
//! The model is swept twice: what lies inside is known at the end of the first time. Everything is streamed; memory
//! follows the largest slice, not the model.
//!
//! | part | what it holds |
//! |---|---|
//! | `signs` | samples inside, as places where rows change sides |
//! | `cases` | the 256 cases of a cube, and its patches |
//! | `patch` | where a patch lies in its cube, and its normal |
//! | `coarse` | blocks of samples in their place, for fewer triangles |
//! | `dual` | vertices and triangles, layer by layer |
//! | `mask` | NRRD and NIfTI |
//! | [`Mesh`] | triangles in memory |
//! | `tint` | colours of vertices |
//! | `write` | STL, PLY, OBJ and GLB |

mod cases;
mod coarse;
mod dual;
mod fault;
mod mask;
mod mesh;
mod patch;
mod signs;
mod tint;
mod write;

pub use fault::ExportFault;
pub use mesh::Mesh;

use std::fs::File;
use std::io;
use std::path::Path;

use crate::enclosed::{Outward, SkinSlices, SkinVoxel, Sweep, extent};
use crate::format::normal;
use crate::geom::{Affine, Dims, VoxelIndex};
use crate::load::{ModelView, NodeView};
use crate::progress::{Progress, Stopped};
use crate::render::GridSpace;
use crate::render::shade::Shader;
use crate::scratch;

use coarse::Coarse;
use dual::Mesher;
use mask::{Mask, MaskForm, NIFTI_MOST};
use mesh::MeshSink;
use patch::Layer;
use signs::{Boxes, Signs, signs_of_cells};
use tint::Lights;
use write::{Glb, Obj, Ply, Sink, Stl, Vertex};

/// The form of an exported file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ExportForm {
    /// Triangles, binary STL.
    Stl,
    /// Triangles, binary PLY.
    Ply,
    /// Triangles, Wavefront OBJ.
    Obj,
    /// Triangles, binary glTF.
    Glb,
    /// Skin voxels (their middles) or cells (a point of the surface), binary PLY.
    Points,
    /// A mask, NRRD.
    Nrrd,
    /// A mask, NIfTI-1.
    #[serde(rename = "nii")]
    Nifti,
    /// A mask, gzipped NIfTI-1.
    #[serde(rename = "nii.gz")]
    NiftiGz,
    /// A page that shows the model in a browser, HTML.
    Html,
}

impl ExportForm {
    /// All forms.
    pub const ALL: [Self; 9] = [
        Self::Stl,
        Self::Ply,
        Self::Obj,
        Self::Glb,
        Self::Points,
        Self::Nrrd,
        Self::Nifti,
        Self::NiftiGz,
        Self::Html,
    ];

    /// The form by a name's suffix.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.as_encoded_bytes().to_ascii_lowercase();
        let by_suffix =
            |form: &Self| *form != Self::Points && name.ends_with(format!(".{}", form.name()).as_bytes());
        Self::ALL.into_iter().find(by_suffix)
    }

    /// Does the file hold coordinates, of 32 bits?
    pub(crate) fn has_coordinates(self) -> bool {
        !self.is_mask() && self != Self::Html
    }

    /// Is it a volume of voxels that are inside or outside?
    pub fn is_mask(self) -> bool {
        matches!(self, Self::Nrrd | Self::Nifti | Self::NiftiGz)
    }

    /// Is it a surface?
    pub fn has_triangles(self) -> bool {
        matches!(self, Self::Stl | Self::Ply | Self::Obj | Self::Glb)
    }

    /// Suffix of its files.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Points => Self::Ply.name(),
            form => form.name(),
        }
    }

    /// Name in reports and, but for points, suffix.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Glb => "glb",
            Self::Points => "points",
            Self::Nrrd => "nrrd",
            Self::Nifti => "nii",
            Self::NiftiGz => "nii.gz",
            Self::Html => "html",
        }
    }
}

/// Counts of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Exported {
    /// Corners of triangles, or points.
    pub(crate) vertices: u64,
    pub(crate) triangles: u64,
    /// Voxels set in a mask.
    pub(crate) inside: u64,
    /// Boxes that the skin encloses, of which the normals do not tell whether they are inside.
    pub(crate) unknown: u64,
}

/// Why an export stopped.
#[derive(Debug)]
pub(crate) enum ExportStop {
    /// The model is damaged: it does not hold the boxes that it says.
    Damaged,
    /// The output could not be written, or cannot hold the model (an [`ExportFault`]).
    Output(io::Error),
    /// The caller stopped it.
    Stopped,
}

impl From<Stopped> for ExportStop {
    fn from(_: Stopped) -> Self {
        Self::Stopped
    }
}

impl From<io::Error> for ExportStop {
    fn from(cause: io::Error) -> Self {
        Self::Output(cause)
    }
}

/// Slices after which the model's pages leave memory.
const SLICES_KEPT: u32 = 64;

/// Most blocks of samples in a slice, of which three are held: 4 bytes each.
const MAX_BLOCKS: u64 = 1 << 24;

/// A model with its place.
pub(crate) struct Exporter<'a> {
    pub(crate) view: &'a ModelView<'a>,
    /// Size in boxes of the finest level.
    pub(crate) dims: Dims,
    /// Index of a box to LPS mm.
    pub(crate) affine: Affine,
    pub(crate) space: &'a GridSpace,
    /// Only the skin counts as inside in a mask.
    pub(crate) skin_only: bool,
    /// Triangles are made of blocks of this many samples along each axis; 1 for the samples themselves.
    pub(crate) step: u32,
    /// Called now and then, where what was looked at of the model can leave memory.
    pub(crate) give_back: &'a dyn Fn(),
}

/// The product of the samples.
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
enum Product<'a> {
    /// Made of the samples, or of blocks of them.
    Mesh(Mesher<'a>, Option<Coarse>),
    Mask(Mask),
}

impl Exporter<'_> {
    /// Writes the model into an empty file; data that has to wait goes to anonymous files in `scratch`.
    pub(crate) fn write(
        &self,
        form: ExportForm,
        out: File,
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<Exported, ExportStop> {
        let normals = self.view.voxel_normal(VoxelIndex::new(0)).is_some();
        let colors = self.lights().is_some();
        let waiting = || scratch::unnamed(scratch);
        let normals_wait = || normals.then(waiting).transpose();
        let sink: Box<dyn Sink> = match form {
            ExportForm::Stl => Box::new(Stl::new(out)?),
            ExportForm::Ply => Box::new(Ply::new(out, Some(waiting()?), normals, colors)?),
            ExportForm::Obj => Box::new(Obj::new(out, normals)?),
            ExportForm::Glb => {
                let colors_wait = colors.then(waiting).transpose()?;
                Box::new(Glb::new(out, normals_wait()?, colors_wait, waiting()?)?)
            }
            ExportForm::Points => {
                return self.points(Box::new(Ply::new(out, None, normals, colors)?), progress);
            }
            ExportForm::Nrrd => return self.mask(out, MaskForm::Nrrd, progress),
            ExportForm::Nifti => return self.mask(out, MaskForm::Nifti, progress),
            ExportForm::NiftiGz => return self.mask(out, MaskForm::NiftiGz, progress),
            // Not of what is inside, and made elsewhere.
            ExportForm::Html => return Err(io::Error::from(io::ErrorKind::Unsupported).into()),
        };
        self.mesh(sink, progress)
    }

    /// The triangles in memory.
    pub(crate) fn triangles(&self, progress: &dyn Progress) -> Result<Mesh, ExportStop> {
        let mut mesh = Mesh::default();
        let normals = self.view.voxel_normal(VoxelIndex::new(0)).is_some();
        let colors = self.lights().map(|_| Shader::new());
        self.mesh(Box::new(MeshSink { mesh: &mut mesh, normals, colors }), progress)?;
        Ok(mesh)
    }

    fn cells(&self) -> bool {
        self.view.cells().is_some()
    }

    /// The table from colours to light, if the model has colours.
    fn lights(&self) -> Option<Lights> {
        self.view.voxel_color(VoxelIndex::new(0)).map(|_| Lights::new())
    }

    fn mesh(&self, mut sink: Box<dyn Sink + '_>, progress: &dyn Progress) -> Result<Exported, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        // Cube x has its middle half a voxel before sample x; a cell is a cube.
        let before = if self.cells() { 1.0 } else { 1.5 };
        let low = bounds[0].map(|low| f64::from(low) - before);
        let step = f64::from(self.step);
        // Blocks begin one before the samples.
        let first = if self.step == 1 { low } else { low.map(|c| c - step) };
        let mut to_mm = self.affine.starting_at(first);
        to_mm.rows.iter_mut().for_each(|row| row[..3].iter_mut().for_each(|v| *v *= step));
        let [width, height] = [0, 1].map(|a| bounds[1][a] - bounds[0][a] + 2);
        let blocks = u64::from(width / self.step) * u64::from(height / self.step);
        if self.step > 1 && blocks > MAX_BLOCKS {
            return Err(ExportStop::Output(ExportFault::TooBroad { blocks }.into()));
        }
        let coarse =
            (self.step > 1).then(|| Coarse::new(self.step, width, height as usize, self.lights().as_ref()));
        let mut product = Product::Mesh(Mesher::new(to_mm, sink.as_mut()), coarse);
        let unknown = self.sweep(bounds, &mut product, progress)?;
        let Product::Mesh(mut mesher, coarse) = product else { return Err(ExportStop::Damaged) };
        if let Some(coarse) = coarse {
            coarse.finish(&mut mesher, self.space)?;
        }
        let (vertices, triangles) = mesher.counts();
        sink.finish()?;
        Ok(Exported { vertices, triangles, unknown, ..Exported::default() })
    }

    fn mask(&self, out: File, form: MaskForm, progress: &dyn Progress) -> Result<Exported, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        // Of cells, the samples between them: one less along each axis, beginning half a cell later.
        let (less, later) = if self.cells() { (1, 0.5) } else { (0, 0.0) };
        let [nx, ny, nz] = self.dims.to_array().map(|n| n - less);
        let dims = Dims::new(nx, ny, nz).ok_or(ExportStop::Damaged)?;
        let side = dims.to_array().into_iter().max().unwrap_or(0);
        if form != MaskForm::Nrrd && side > NIFTI_MOST {
            return Err(ExportStop::Output(ExportFault::TooWide { side }.into()));
        }
        let affine = self.affine.starting_at([later; 3]);
        let mut product = Product::Mask(Mask::new(out, form, dims, &affine)?);
        let unknown = self.sweep(bounds, &mut product, progress)?;
        let Product::Mask(mask) = product else { return Err(ExportStop::Damaged) };
        let inside = mask.inside();
        mask.finish()?;
        Ok(Exported { inside, unknown, ..Exported::default() })
    }

    /// Sweeps the model twice: to know what is inside, and to make the product of it.
    fn sweep(
        &self,
        bounds: [[u32; 3]; 2],
        product: &mut Product<'_>,
        progress: &dyn Progress,
    ) -> Result<u64, ExportStop> {
        let slices = u64::from(bounds[1][2] - bounds[0][2]);
        let outward = Outward::new(self.cells(), self.affine.spacing_mm());
        let mut sweep = Sweep::new(bounds, outward).keeping_fates();
        progress.stage("inside", slices);
        self.each_slice(bounds, |skin| {
            sweep.slice(self.view, skin);
            Ok(progress.step(1)?)
        })?;
        let (enclosed, fates) = sweep.finish();
        let mut sweep = Sweep::new(bounds, outward).knowing(fates);
        let mut samples = Samples { lights: self.lights(), ..Samples::default() };
        progress.stage("export", slices);
        self.each_slice(bounds, |skin| {
            sweep.slice(self.view, skin);
            let boxes = Boxes::of(&sweep);
            progress.step(1)?;
            self.next_slice(&mut samples, boxes, sweep.height(), bounds[0], product)
        })?;
        Ok(enclosed.unknown)
    }

    /// The skin of each slice, from the one before the first to the one behind the last.
    fn each_slice(
        &self,
        [low, end]: [[u32; 3]; 2],
        mut work: impl FnMut(&[SkinVoxel]) -> Result<(), ExportStop>,
    ) -> Result<(), ExportStop> {
        let mut slices = SkinSlices::new(self.view);
        work(&[])?;
        for z in low[2]..end[2] {
            if z % SLICES_KEPT == 0 {
                (self.give_back)();
            }
            work(slices.slice(z).ok_or(ExportStop::Damaged)?)?;
        }
        work(&[])
    }

    /// Takes a slice of boxes, and makes what follows from it and those before.
    fn next_slice(
        &self,
        samples: &mut Samples,
        boxes: Boxes,
        height: usize,
        low: [u32; 3],
        product: &mut Product<'_>,
    ) -> Result<(), ExportStop> {
        let skin_only = self.skin_only && matches!(product, Product::Mask(_));
        let signs = match (self.view.cells(), &samples.boxes) {
            (None, _) => Some(boxes.signs(height, skin_only)),
            (Some(items), Some(below)) => Some(signs_of_cells(below, &boxes, items, height)),
            (Some(_), None) => None,
        };
        let cells = self.cells();
        if let Some(signs) = signs {
            match (product, &samples.signs, &samples.boxes) {
                (Product::Mesh(mesher, Some(coarse)), ..) => {
                    let height = if cells { height - 1 } else { height };
                    if let Some(lights) = &samples.lights {
                        coarse.tint(self.view, lights, &boxes, height);
                    }
                    coarse.add(&signs, height, mesher, self.space)?;
                }
                (Product::Mesh(mesher, None), Some(before), Some(below)) => {
                    // A layer of cells is the slice between two slices of samples.
                    let lights = samples.lights.as_ref();
                    let layer = Layer { view: self.view, space: self.space, boxes: [below, &boxes], lights };
                    let height = if cells { height - 1 } else { height };
                    mesher.layer([before, &signs], &layer, height, samples.slices)?;
                }
                (Product::Mask(mask), ..) => {
                    // Samples of voxels begin one before the skin; so do cells, and the sample behind the first.
                    let [x, y, z] = low.map(|low| i64::from(low) - 1);
                    // A slice before the volume holds nothing.
                    if let Ok(z) = u32::try_from(z + i64::from(samples.slices)) {
                        mask.empty_until(z)?;
                        mask.slice(&signs, [x, y])?;
                    }
                }
                _ => {}
            }
            samples.signs = Some(signs);
            samples.slices += 1;
        }
        samples.boxes = Some(boxes);
        Ok(())
    }

    fn points(&self, mut sink: Box<dyn Sink>, progress: &dyn Progress) -> Result<Exported, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        progress.stage("export", u64::from(bounds[1][2] - bounds[0][2]));
        let mut vertices = 0;
        let lights = self.lights();
        let mut z = i64::from(bounds[0][2]) - 1;
        self.each_slice(bounds, |skin| {
            for found in skin {
                let at = [f64::from(found.x), f64::from(found.y), z as f64];
                sink.vertex(&self.point(at, found.voxel, lights.as_ref()))?;
                vertices += 1;
            }
            z += 1;
            Ok(progress.step(1)?)
        })?;
        sink.finish()?;
        Ok(Exported { vertices, ..Exported::default() })
    }

    #[expect(clippy::cast_possible_truncation, reason = "files hold 32-bit coordinates")]
    fn point(&self, at: [f64; 3], voxel: VoxelIndex, lights: Option<&Lights>) -> Vertex {
        let plane = self.view.cells().and_then(|items| items.plane(voxel.get()));
        let normal = self.view.voxel_normal(voxel).map(|code| normal::decode(code).map(f64::from));
        let normal = normal.unwrap_or_default();
        let within = plane.map_or([0.0; 3], patch::nearest_on_plane);
        let mm = self.affine.apply(std::array::from_fn(|a| at[a] + within[a]));
        let normal = if self.cells() {
            self.space.index_normal_to_world(normal)
        } else {
            self.space.normal_to_world(normal)
        };
        let color = lights.and_then(|lights| Some(lights.of(self.view.voxel_color(voxel)?)));
        let light = color.unwrap_or_default();
        Vertex { at: mm.map(|c| c as f32), normal: normal.map(|c| c as f32), light }
    }
}

/// The state between two slices.
#[derive(Default)]
struct Samples {
    /// If the model has colours.
    lights: Option<Lights>,
    boxes: Option<Boxes>,
    signs: Option<Signs>,
    /// Slices of samples so far.
    slices: u32,
}
