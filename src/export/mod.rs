//! Export of a model to formats of other programs: the surface as triangles, the skin as points, the solid as a mask.
//!
//! ```text
//!   octree --> skin of a slice --> where all else lies --> samples inside, as bits --> cubes between two slices
//!     (enclosed)                      (signs)                                            |
//!   memory, STL, PLY, OBJ, GLB, 3MF <-- triangles <-- a vertex for each patch, a polygon around each crossed edge (dual)
//! ```
//!
//! The model is swept slice by slice; memory follows the largest slice, not the model, unless the triangles are to stay
//! in memory. Models of voxels, and of cells that do not determine the inside, are first swept once more to derive it
//! from the normals (enclosed).
//!
//! | part | content |
//! |---|---|
//! | `threaded` | triangles in memory, on a second thread |
//! | `bits` | slices of bits |
//! | `bodies` | how many bodies triangles enclose |
//! | `boundary` | whether triangles are closed |
//! | `sample_signs` | samples inside |
//! | `cases` | the 256 cases of a cube, and its patches |
//! | `patch` | position of a patch in its cube, and its normal |
//! | `decimate` | fewer triangles, within a distance or to a number |
//! | `dual` | vertices and triangles, layer by layer |
//! | `labels` | the same for models of labels, a part for each label |
//! | `mask` | NRRD and NIfTI |
//! | [`Mesh`] | triangles in memory |
//! | `regions` | samples as runs of one label, with the cells between two slices |
//! | `vertex_color` | colours of vertices |
//! | `write` | STL, PLY, OBJ, GLB and 3MF |

mod bits;
mod bodies;
mod boundary;
mod cases;
mod decimate;
mod dual;
mod fault;
mod labels;
mod mask;
mod mesh;
mod patch;
mod regions;
mod sample_signs;
mod threaded;
mod vertex_color;
mod write;

pub use fault::ExportFault;
pub(crate) use labels::{LabelMesh, part_name};
pub use mesh::Mesh;
pub(crate) use regions::{LayerCell, RegionFrame, RegionSlice, Run};

use std::fs::File;
use std::io::{self, Seek};
use std::path::Path;

use crate::format::normal;
use crate::geom::{Affine, Dims, VoxelIndex};
use crate::interior::{ComponentSides, Outward, Rows, SkinSlices, SkinVoxel, Sweep, extent};
use crate::load::{CellItems, CellShape, ModelView, NodeView};
use crate::progress::{Progress, Stopped};
use crate::render::GridSpace;
use crate::render::shade::Shader;
use crate::scratch;

use bits::Bits;
use bodies::Bodies;
use boundary::Bounded;
use decimate::{Goal, Whole};
use dual::Mesher;
use mask::Mask;
use patch::singles;
use sample_signs::{Boxes, Extent, Item};
use threaded::Ground;
use vertex_color::{Lights, UNCOLORED};
use write::{Glb, Obj, Output, PartHead, Ply, Sink, Stl, ThreeMf, Vertex, unit};

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
    /// Triangles, 3MF.
    #[serde(rename = "3mf")]
    ThreeMf,
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
    /// A page without the model, which it fetches from its web server.
    Linked,
}

impl ExportForm {
    /// All forms.
    pub const ALL: [Self; 11] = [
        Self::Stl,
        Self::Ply,
        Self::Obj,
        Self::Glb,
        Self::ThreeMf,
        Self::Points,
        Self::Nrrd,
        Self::Nifti,
        Self::NiftiGz,
        Self::Html,
        Self::Linked,
    ];

    /// The form of a name by its suffix.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.as_encoded_bytes().to_ascii_lowercase();
        let by_suffix = |form: &Self| {
            form.suffix() == form.name() && name.ends_with(format!(".{}", form.name()).as_bytes())
        };
        Self::ALL.into_iter().find(by_suffix)
    }

    /// True if the file holds coordinates, which have 32 bits.
    pub(crate) fn has_coordinates(self) -> bool {
        !self.is_mask() && !self.is_page()
    }

    /// True for a volume of voxels inside or outside.
    pub fn is_mask(self) -> bool {
        matches!(self, Self::Nrrd | Self::Nifti | Self::NiftiGz)
    }

    /// True for a page for browsers.
    pub(crate) fn is_page(self) -> bool {
        matches!(self, Self::Html | Self::Linked)
    }

    /// True for a surface of triangles.
    pub fn has_triangles(self) -> bool {
        matches!(self, Self::Stl | Self::Ply | Self::Obj | Self::Glb | Self::ThreeMf)
    }

    /// Suffix of its files.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Points => Self::Ply.name(),
            Self::Linked => Self::Html.name(),
            form => form.name(),
        }
    }

    /// Name in reports; except for points and linked pages also the suffix.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "stl",
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Glb => "glb",
            Self::ThreeMf => "3mf",
            Self::Points => "points",
            Self::Nrrd => "nrrd",
            Self::Nifti => "nii",
            Self::NiftiGz => "nii.gz",
            Self::Html => "html",
            Self::Linked => "linked",
        }
    }
}

/// Counts of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Exported {
    /// Corners of triangles, or points.
    pub(crate) vertices: u64,
    pub(crate) triangles: u64,
    /// Triangles before they were made fewer within a bound.
    pub(crate) fine_triangles: u64,
    /// Greatest distance in mm between the reduced surface and the fine one, where it was measured.
    pub(crate) distance_mm: Option<f64>,
    /// Place of that distance, in LPS mm.
    pub(crate) distance_at: Option<[f32; 3]>,
    /// Bound of that distance, in mm.
    pub(crate) within_mm: Option<f64>,
    /// Root mean square distance from places of the fine surface to the reduced one, in mm, where it was measured.
    pub(crate) rms_mm: Option<f64>,
    /// True where each edge has as many triangles one way as the other, in each part; of triangles.
    pub(crate) is_closed: Option<bool>,
    /// Separate bodies of a closed surface without labels, and cavities in them.
    pub(crate) bodies: Option<[u64; 2]>,
    /// Separate parts of the surface that were left out, where it was in memory.
    pub(crate) parts_gone: Option<u64>,
    /// Bodies that came apart from a single one where triangles were made few, and were left out.
    pub(crate) pieces_gone: u64,
    /// True if the surface enclosed one body before.
    pub(crate) was_one: bool,
    /// Voxels set in a mask.
    pub(crate) inside: u64,
    /// Enclosed boxes whose normals do not tell inside from outside.
    pub(crate) unknown: u64,
}

/// Reason for a stopped export.
#[derive(Debug)]
pub(crate) enum ExportStop {
    /// The model is damaged: its boxes are not as many as it states.
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

/// Slices after which the model's pages are released.
const SLICES_KEPT: u32 = 4;

/// A model, its placement, and options of its export.
pub(crate) struct Exporter<'a> {
    pub(crate) view: &'a ModelView<'a>,
    /// Size in boxes of the finest level.
    pub(crate) dims: Dims,
    /// Index of a box to LPS mm.
    pub(crate) affine: Affine,
    pub(crate) space: &'a GridSpace,
    /// True for a mask in which only the skin counts as inside.
    pub(crate) skin_only: bool,
    /// Reduces the triangles within this distance of the full surface, in mm.
    pub(crate) error_mm: Option<f64>,
    /// Reduces the triangles to about this number.
    pub(crate) triangles: Option<u64>,
    /// Called at intervals to release the pages of the model that have been read.
    pub(crate) give_back: &'a dyn Fn(),
}

/// A slice of samples.
struct SampleSlice<'s> {
    /// Number of the slice, from 0 on.
    z: u32,
    /// The slice before, and this one.
    samples: [&'s mut Bits; 2],
    /// Items of the last two slices of boxes, the latest last; cells of the first one lie between both slices of samples.
    items: [&'s mut Rows<Item>; 2],
}

/// First box of the skin along each axis, and the one after the last.
type Bounds = [[u32; 3]; 2];

impl Exporter<'_> {
    /// Writes the model into an empty file, in a form other than a page; pending data goes to anonymous files in
    /// `scratch`.
    pub(crate) fn write(
        &self,
        form: ExportForm,
        out: &File,
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<Exported, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let [normals, colors] = self.has();
        let copy = || out.try_clone();
        if form == ExportForm::Points {
            return self.points(Box::new(Ply::new(copy()?, None, normals, colors)?), bounds, progress);
        }
        self.knowing_inside(bounds, progress, &mut |fates| {
            let mut out = copy()?;
            out.set_len(0)?;
            out.rewind()?;
            if form.is_mask() {
                return self.mask(out, form, bounds, fates, progress);
            }
            let mut sink =
                Bounded::new(sink(form, out, scratch, [normals, colors])?, Some(Bodies::default()));
            let made = if self.is_fewer() {
                self.whole(bounds, &mut sink, fates, progress)?
            } else {
                self.feed(bounds, &mut sink, fates, progress)?
            };
            let Some(made) = made else { return Ok(None) };
            let (is_closed, bodies) = sink.finish()?;
            Ok(Some(Exported { is_closed: Some(is_closed), bodies: bodies.filter(|_| is_closed), ..made }))
        })
    }

    /// Fewer triangles, from all of them in memory, or from reduced slabs of a large surface.
    fn whole(
        &self,
        bounds: Bounds,
        sink: &mut dyn Sink,
        fates: Option<ComponentSides>,
        progress: &dyn Progress,
    ) -> Result<Option<Exported>, ExportStop> {
        let mut whole = self.fewer(self.triangles, progress);
        let fed = self.feed(bounds, &mut whole, fates, progress);
        // Slabs report a stop to the mesher as an error of output.
        progress.check()?;
        let Some(made) = fed? else { return Ok(None) };
        let made = whole.reduce(made)?;
        whole.hand_on(sink)?;
        Ok(Some(made))
    }

    fn is_fewer(&self) -> bool {
        self.triangles.is_some() || self.error_mm.is_some()
    }

    /// The reducer of triangles, to a number or within the distance.
    fn fewer<'p>(&self, triangles: Option<u64>, progress: &'p dyn Progress) -> Whole<'p> {
        let goal = Goal { triangles, error_mm: self.error_mm };
        Whole::new(goal, self.voxel_mm(), progress)
    }

    /// The finest spacing.
    fn voxel_mm(&self) -> f64 {
        self.affine.spacing_mm().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Sends all triangles to a sink.
    fn feed(
        &self,
        bounds: Bounds,
        sink: &mut dyn Sink,
        fates: Option<ComponentSides>,
        progress: &dyn Progress,
    ) -> Result<Option<Exported>, ExportStop> {
        let lights = self.lights();
        let ground = self.ground(bounds, lights.as_ref());
        let mut mesher = self.mesher(bounds, Some(sink));
        let swept = self.sweep(bounds, fates, progress, &mut |slice| {
            let SampleSlice { z, samples: [before, samples], items: [below, boxes] } = slice;
            // A layer of cells is the slice between two slices of samples.
            if z == 0 { Ok(()) } else { ground.layer(&mut mesher, [before, samples], [below, boxes], z) }
        })?;
        let (vertices, triangles) = mesher.counts();
        Ok(swept.map(|unknown| Exported { vertices, triangles, unknown, ..Exported::default() }))
    }

    /// All triangles in memory, or fewer with their distance in mm.
    pub(crate) fn triangles(&self, progress: &dyn Progress) -> Result<(Mesh, Option<f64>), ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let mut mesh =
            self.knowing_inside(bounds, progress, &mut |fates| self.kept(bounds, fates, progress))?;
        let reduced = self.triangles.map(|most| mesh.reduced(most, self.voxel_mm(), progress)).transpose()?;
        Ok((mesh, reduced))
    }

    fn kept(
        &self,
        bounds: Bounds,
        fates: Option<ComponentSides>,
        progress: &dyn Progress,
    ) -> Result<Option<Mesh>, ExportStop> {
        let room = usize::try_from(self.view.voxel_count()).unwrap_or(0);
        let mesher = self.mesher(bounds, None).with_room(room);
        let lights = self.lights();
        let surface = self.ground(bounds, lights.as_ref()).mesh(mesher, |slices| {
            self.sweep(bounds, fates, progress, &mut |slice| {
                let SampleSlice { samples: [_, samples], items: [below, boxes], .. } = slice;
                slices.send(if self.cells() { below } else { boxes }, samples);
                Ok(())
            })
        })?;
        let Some(surface) = surface else { return Ok(None) };
        let shader = Shader::new();
        let color =
            |light: &vertex_color::Light| light.map(|light| shader.encode(f64::from(light) / 65535.0));
        let colors = surface.lights.iter().map(color).collect();
        let (vertices, faces, normals) = (surface.at, surface.faces, surface.normals);
        Ok(Some(Mesh { vertices, faces, normals, colors }))
    }

    fn cells(&self) -> bool {
        self.view.cells().is_some()
    }

    /// True if the model has normals; true if it has colours.
    fn has(&self) -> [bool; 2] {
        let first = VoxelIndex::new(0);
        let has_normals = self.cells() || self.view.voxel_normal(first).is_some();
        [has_normals, self.view.voxel_color(first).is_some()]
    }

    /// The table from colours to light, if the model has colours.
    fn lights(&self) -> Option<Lights> {
        self.has()[1].then(Lights::new)
    }

    /// Runs `work` with the inside by the cells; if they do not suffice, with the fates by all normals.
    fn knowing_inside<T>(
        &self,
        bounds: Bounds,
        progress: &dyn Progress,
        work: &mut dyn FnMut(Option<ComponentSides>) -> Result<Option<T>, ExportStop>,
    ) -> Result<T, ExportStop> {
        if self.cells()
            && let Some(done) = work(None)?
        {
            return Ok(done);
        }
        work(Some(self.fates(bounds, progress)?))?.ok_or(ExportStop::Damaged)
    }

    /// The fates of enclosed components by all normals.
    fn fates(&self, bounds: Bounds, progress: &dyn Progress) -> Result<ComponentSides, ExportStop> {
        progress.stage("inside", u64::from(bounds[1][2] - bounds[0][2]));
        let mut sweep = Sweep::new(bounds, self.outward()).keeping_fates();
        self.each_slice(bounds, |skin| {
            sweep.slice(self.view, skin);
            Ok(Some(progress.step(1)?))
        })?;
        Ok(sweep.finish().1)
    }

    fn outward(&self) -> Outward {
        Outward::new(self.cells(), self.affine.spacing_mm())
    }

    fn ground<'a>(&'a self, bounds: Bounds, lights: Option<&'a Lights>) -> Ground<'a> {
        Ground { view: self.view, space: self.space, extent: extent_of(bounds), lights }
    }

    /// A mesher whose triangles go to a sink, or are kept without one.
    fn mesher<'a>(&self, bounds: Bounds, sink: Option<&'a mut (dyn Sink + 'a)>) -> Mesher<'a> {
        Mesher::new(self.to_mm(bounds), self.has(), sink)
    }

    /// Maps middles of cubes, by their numbers, to mm.
    fn to_mm(&self, bounds: Bounds) -> Affine {
        // Cube x has its middle half a voxel before sample x; a cell is a cube.
        let before = if self.cells() { 1.0 } else { 1.5 };
        self.affine.starting_at(bounds[0].map(|low| f64::from(low) - before))
    }

    fn mask(
        &self,
        out: File,
        form: ExportForm,
        bounds: Bounds,
        fates: Option<ComponentSides>,
        progress: &dyn Progress,
    ) -> Result<Option<Exported>, ExportStop> {
        // Cells have samples between them: one less along each axis, beginning half a cell later.
        let (less, later) = if self.cells() { (1, 0.5) } else { (0, 0.0) };
        let [nx, ny, nz] = self.dims.to_array().map(|n| n - less);
        let dims = Dims::new(nx, ny, nz).ok_or(ExportStop::Damaged)?;
        let affine = self.affine.starting_at([later; 3]);
        let mut mask = Mask::new(out, form, dims, &affine, false)?;
        // Samples of voxels begin one before the skin; so do cells, and the sample after the first.
        let [x, y, first] = bounds[0].map(|low| i64::from(low) - 1);
        let swept = self.sweep(bounds, fates, progress, &mut |SampleSlice { z, samples, .. }| {
            // A slice before the volume is empty.
            let Ok(z) = u32::try_from(first + i64::from(z)) else { return Ok(()) };
            mask.empty_until(z)?;
            mask.slice(samples[1], [x, y])
        })?;
        let Some(unknown) = swept else { return Ok(None) };
        let inside = mask.inside();
        mask.finish()?;
        Ok(Some(Exported { inside, unknown, ..Exported::default() }))
    }

    /// Sweeps the model, and calls `each` with every slice of samples. Returns the number of undecided boxes; `None` if
    /// the cells do not determine the inside.
    fn sweep(
        &self,
        bounds: Bounds,
        fates: Option<ComponentSides>,
        progress: &dyn Progress,
        each: &mut dyn FnMut(SampleSlice<'_>) -> io::Result<()>,
    ) -> Result<Option<u64>, ExportStop> {
        let (cells, extent) = (self.cells(), extent_of(bounds));
        let unknown = fates.as_ref().map_or(0, |fates| fates.unknown);
        let mut votes = fates.map(|fates| Sweep::new(bounds, self.outward()).knowing(fates));
        // The latest slice, and the one before.
        let mut boxes = [(); 2].map(|()| Boxes::new(extent));
        let mut both = [(); 2].map(|()| Bits::new(extent.width, extent.height));
        let mut taken = 0_u32;
        progress.stage("export", u64::from(bounds[1][2] - bounds[0][2]));
        let done = self.each_slice(bounds, |skin| {
            if let Some(votes) = &mut votes {
                votes.slice(self.view, skin);
            }
            progress.step(1)?;
            boxes.rotate_right(1);
            let [here, below] = &mut boxes;
            if here.take(self.view, skin, below, votes.as_ref()).is_none() {
                return Ok(None);
            }
            // Samples of cells lie between two slices.
            if let Some(z) = taken.checked_sub(u32::from(cells)) {
                both.rotate_right(1);
                let [samples, before] = &mut both;
                if cells {
                    below.of_cells(here, samples);
                } else {
                    here.of_voxels(self.skin_only, samples);
                }
                let items = [&mut below.items, &mut here.items];
                each(SampleSlice { z, samples: [before, samples], items })?;
            }
            taken += 1;
            Ok(Some(()))
        })?;
        Ok(done.map(|()| unknown))
    }

    /// Calls `work` with the skin of each slice, from the one before the first to the one after the last, until it
    /// returns `None`.
    fn each_slice(
        &self,
        [low, end]: Bounds,
        mut work: impl FnMut(&[SkinVoxel]) -> Result<Option<()>, ExportStop>,
    ) -> Result<Option<()>, ExportStop> {
        let mut slices = SkinSlices::new(self.view, [low, end]);
        if work(&[])?.is_none() {
            return Ok(None);
        }
        for z in low[2]..end[2] {
            if z % SLICES_KEPT == 0 {
                (self.give_back)();
            }
            let slice = slices.slice(z).ok_or(ExportStop::Damaged)?;
            if z % SLICES_KEPT == 0 {
                // The nodes of the next slices have been read.
                (self.give_back)();
            }
            if work(slice)?.is_none() {
                return Ok(None);
            }
        }
        work(&[])
    }

    fn points(
        &self,
        mut sink: Box<dyn Output>,
        bounds: Bounds,
        progress: &dyn Progress,
    ) -> Result<Exported, ExportStop> {
        progress.stage("export", u64::from(bounds[1][2] - bounds[0][2]));
        let mut vertices = 0;
        let lights = self.lights();
        let mut z = i64::from(bounds[0][2]) - 1;
        self.each_slice(bounds, |skin| {
            for found in skin.iter().filter(|found| found.is_surface()) {
                let at = [f64::from(found.x), f64::from(found.y), z as f64];
                sink.vertex(&self.point(at, found, lights.as_ref()))?;
                vertices += 1;
            }
            z += 1;
            Ok(Some(progress.step(1)?))
        })?;
        sink.finish()?;
        Ok(Exported { vertices, ..Exported::default() })
    }

    fn point(&self, at: [f64; 3], found: &SkinVoxel, lights: Option<&Lights>) -> Vertex {
        let normal = found.code(self.view).map(|code| normal::decode(code).map(f64::from));
        let normal = normal.unwrap_or_default();
        let wall = |items: CellItems<'_>| items.wall(found.voxel.get()).filter(|_| items.has_walls());
        let within = match self.view.cells().map(|items| (wall(items), found.shape(&items))) {
            Some((Some(plane), _) | (None, CellShape::Plane(plane))) => plane.nearest_to_middle(),
            _ => [0.0; 3],
        };
        let mm = self.affine.apply(std::array::from_fn(|a| at[a] + within[a]));
        let normal = if self.cells() {
            self.space.index_normal_to_world(normal)
        } else {
            self.space.normal_to_world(normal)
        };
        let color = lights.and_then(|lights| Some(lights.of(self.view.voxel_color(found.voxel)?)));
        Vertex { at: singles(mm), normal: unit(singles(normal)), light: color.unwrap_or_default() }
    }
}

/// Extent of the boxes around the skin.
fn extent_of([low, end]: Bounds) -> Extent {
    Extent { low: [low[0], low[1]], width: end[0] - low[0] + 2, height: (end[1] - low[1] + 2) as usize }
}

/// The sink of a form; `has` is set for normals, and for colours.
fn sink(
    form: ExportForm,
    out: File,
    scratch: &Path,
    [normals, colors]: [bool; 2],
) -> Result<Box<dyn Output>, ExportStop> {
    let waiting = || scratch::unnamed(scratch);
    Ok(match form {
        ExportForm::Ply => Box::new(Ply::new(out, Some(waiting()?), normals, colors)?),
        ExportForm::Obj => Box::new(Obj::new(out, normals)?),
        ExportForm::Glb => {
            let normals = normals.then(waiting).transpose()?;
            Box::new(Glb::new(out, normals, colors.then(waiting).transpose()?, waiting()?)?)
        }
        ExportForm::ThreeMf => {
            let model = PartHead { name: "model".into(), color: UNCOLORED, ..PartHead::default() };
            let mut sink = ThreeMf::new(out, std::slice::from_ref(&model), waiting()?)?;
            sink.part(&model)?;
            Box::new(sink)
        }
        _ => Box::new(Stl::new(out)?),
    })
}
