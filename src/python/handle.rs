//! An open model: the calls of `infobyte.Model`.

use std::io::{self, Read};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::Arc;

use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use super::failure::{raised, usage};
use super::options::{PictureAsked, only_labels, read};
use super::rays::{self, Found, Given, Rays, Room};
use super::watch::watched;
use crate::error::Error;
use crate::export::ExportForm;
use crate::format::{Encoding, SurfaceKind};
use crate::geom::Affine;
use crate::jobs::export::{ExportRequest, triangles_of};
use crate::jobs::info::{Info, Measured};
use crate::jobs::nearest::nearest_points;
use crate::jobs::open_model::unpacked;
use crate::jobs::picture::{Outputs, framed};
use crate::jobs::scene::camera_of;
use crate::load::{Fault, FileIdentity, Frame, LoadError, LoadFault, Mapping, Model, StoredVoxel};
use crate::platform::PositionalFile;
use crate::progress::{Progress, Silent};
use crate::render::pixel_rays::PixelRays;
use crate::render::{Image, Layout, RayCaster};
use crate::text::data;

/// The bytes of a model.
#[derive(Debug)]
enum Store {
    /// A mapping with its file, which is kept open so that a change of its bytes can be noticed.
    Mapped(Mapping, PositionalFile, FileIdentity),
    Read(Vec<u8>),
}

/// Bytes shared by the model and the watch over its file.
#[derive(Clone, Debug)]
struct Bytes(Arc<Store>);

impl AsRef<[u8]> for Bytes {
    #[inline]
    fn as_ref(&self) -> &[u8] {
        match &*self.0 {
            Store::Mapped(mapping, ..) => mapping.as_ref(),
            Store::Read(bytes) => bytes,
        }
    }
}

/// An open model.
#[pyclass(frozen, module = "infobyte._infobyte")]
pub(super) struct Handle {
    path: PathBuf,
    bytes: Bytes,
    model: Model<Bytes>,
}

impl Handle {
    fn load(path: PathBuf, mmap: bool) -> Result<Self, Error> {
        let unreadable = |cause| LoadError::from(LoadFault::Unreadable { path: path.clone(), cause });
        let mut file = PositionalFile::open(&path).map_err(unreadable)?;
        if Frame::read(&file).map_err(|fault| fault.at(&path))?.header.encoding == Encoding::Packed {
            file = unpacked(&file, &path)?;
        }
        let then = FileIdentity::of(&file).map_err(unreadable)?;
        let mapping = Mapping::of(&file).map_err(unreadable)?;
        let store = if mmap {
            Store::Mapped(mapping, file, then)
        } else {
            let bytes = read_whole(&file, mapping.as_ref().len()).map_err(unreadable)?;
            then.check(&file, &path)?;
            Store::Read(bytes)
        };
        let bytes = Bytes(Arc::new(store));
        let model = Model::from_bytes(bytes.clone()).map_err(|cause| Fault::Format(cause).at(&path))?;
        Ok(Self { path, bytes, model })
    }

    /// Runs a short job on the model without the interpreter's lock; raises an exception if its file was changed before
    /// or meanwhile, when the bytes may be a mixture of two models.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        job: impl FnOnce(&Model<Bytes>) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        py.detach(|| self.unchanged(|| job(&self.model))).map_err(|error| raised(py, &error))
    }

    /// [`Handle::with`] for so many rays or points: a long job can be stopped by signals.
    fn each<T: Send>(
        &self,
        py: Python<'_>,
        count: usize,
        job: impl FnOnce(&Model<Bytes>, &dyn Progress) -> Result<T, Error> + Send,
    ) -> PyResult<T> {
        if count <= rays::PART {
            return self.with(py, |model| job(model, &Silent));
        }
        watched(py, None, |progress| self.unchanged(|| job(&self.model, progress)))
    }

    /// A fact of each voxel, in the order of the file.
    fn voxels<T: Send>(&self, py: Python<'_>, of: impl Fn(StoredVoxel) -> T + Send) -> PyResult<Vec<T>> {
        self.with(py, |model| Ok(model.voxels().map(of).collect()))
    }

    fn paint(
        &self,
        py: Python<'_>,
        asked: &PictureAsked,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Image> {
        let request = asked.request().map_err(|sentence| usage(py, &sentence))?;
        let outputs =
            Outputs { title: asked.title.as_deref(), legend: asked.legend, ..Outputs::of(&self.path) };
        watched(py, progress, |progress| self.unchanged(|| framed(&self.model, &outputs, &request, progress)))
    }

    /// Runs a job on the model, whose file is checked before and after. Bytes that change meanwhile may be those of no
    /// valid model, and the job may then panic: this is an error of the file, too.
    fn unchanged<T>(&self, job: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
        let check = || match &*self.bytes.0 {
            Store::Mapped(_, file, then) => then.check(file, &self.path),
            Store::Read(_) => Ok(()),
        };
        check()?;
        let made = catch_unwind(AssertUnwindSafe(job));
        check()?;
        made.unwrap_or_else(|panic| resume_unwind(panic))
    }
}

fn read_whole(file: &PositionalFile, bytes: usize) -> io::Result<Vec<u8>> {
    let mut whole = Vec::new();
    whole.try_reserve_exact(bytes)?;
    file.onwards(0).take(bytes as u64).read_to_end(&mut whole)?;
    Ok(whole)
}

/// A flat array of numbers as triples.
fn triples<'a>(py: Python<'_>, array: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [[f64; 3]]> {
    match array.as_slice()?.as_chunks::<3>() {
        (triples, []) => Ok(triples),
        _ => Err(usage(py, "rays and points have three coordinates each")),
    }
}

/// Rays, as many directions as origins.
fn rays_of<'a>(
    py: Python<'_>,
    [origins, directions]: [&'a PyReadonlyArray1<'_, f64>; 2],
) -> PyResult<Given<'a>> {
    let given = Given(triples(py, origins)?, triples(py, directions)?);
    let is_even = given.0.len() == given.1.len();
    is_even.then_some(given).ok_or_else(|| usage(py, "there are not as many directions as origins"))
}

/// Tuples of each voxel, one after the other.
fn flat<T: Element, const N: usize>(py: Python<'_>, all: Vec<[T; N]>) -> Bound<'_, PyAny> {
    PyArray1::from_vec(py, all.into_flattened()).into_any()
}

/// Lines of sight through the middles of pixels, row by row.
struct Pixels<'a> {
    sight: PixelRays<'a>,
    width: usize,
    height: usize,
}

impl Rays for Pixels<'_> {
    fn count(&self) -> usize {
        self.width * self.height
    }

    fn layout(&self) -> Layout {
        Layout::image(self.width)
    }

    fn of<'a>(&'a self, part: Range<usize>, room: &'a mut Room) -> (&'a [[f64; 3]], &'a [[f64; 3]]) {
        room.origins.clear();
        room.directions.clear();
        for pixel in part {
            let (x, y) = (pixel % self.width, pixel / self.width);
            let (origin, direction) = self.sight.line(x as f64 + 0.5, y as f64 + 0.5);
            room.origins.push(origin);
            room.directions.push(direction);
        }
        (&room.origins, &room.directions)
    }
}

type Array<'py, T> = Bound<'py, PyArray1<T>>;

/// Distance, position, normal, side, cell.
type Nearest<'py> = (Array<'py, f64>, Array<'py, f64>, Array<'py, f64>, Array<'py, i8>, Array<'py, i64>);

/// Depth, position, normal, voxel.
type Arrays<'py> = (Array<'py, f64>, Array<'py, f64>, Array<'py, f64>, Array<'py, i64>);

fn arrays(py: Python<'_>, found: Found) -> Arrays<'_> {
    (
        PyArray1::from_vec(py, found.t),
        PyArray1::from_vec(py, found.position.into_flattened()),
        PyArray1::from_vec(py, found.normal.into_flattened()),
        PyArray1::from_vec(py, found.voxel),
    )
}

#[pymethods]
impl Handle {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, mmap: bool) -> PyResult<Self> {
        py.detach(|| Self::load(path, mmap)).map_err(|error| raised(py, &error))
    }

    fn __len__(&self) -> usize {
        usize::try_from(self.model.header().voxels).unwrap_or(usize::MAX)
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// Sides of the volume, x, y, z.
    #[getter]
    fn dims(&self) -> [u32; 3] {
        self.model.metadata().dims
    }

    #[getter]
    fn is_cells(&self) -> bool {
        self.model.frame().surface() == SurfaceKind::Cells
    }

    /// Index (x, y, z) of a sample to LPS mm.
    #[getter]
    fn affine(&self) -> [[f64; 4]; 3] {
        self.model.metadata().affine
    }

    fn info(&self, py: Python<'_>, measured: bool) -> PyResult<String> {
        let info = |measured| {
            let info = Info { input: data(&self.path), frame: self.model.frame().clone(), measured };
            serde_json::to_string(&info.json()).map_err(|_| Error::Internal)
        };
        if !measured {
            return self.with(py, |_| info(None));
        }
        watched(py, None, |progress| self.unchanged(|| info(Some(Measured::of(&self.model, progress)))))
    }

    /// Width, height, and RGBA of every pixel.
    fn render<'py>(
        &self,
        py: Python<'py>,
        asked: &str,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py, u8>> {
        Ok(PyArray1::from_vec(py, self.paint(py, &read(py, asked)?, progress)?.rgba))
    }

    fn png<'py>(&self, py: Python<'py>, asked: &str) -> PyResult<Bound<'py, PyBytes>> {
        let image = self.paint(py, &read(py, asked)?, None)?;
        let mut png = Vec::new();
        py.detach(|| image.write_png_to(&mut png))?;
        Ok(PyBytes::new(py, &png))
    }

    /// The surface at each pixel: depth, position, normal, voxel.
    fn cast<'py>(&self, py: Python<'py>, asked: &str) -> PyResult<Arrays<'py>> {
        let asked: PictureAsked = read(py, asked)?;
        let request = asked.request().map_err(|sentence| usage(py, &sentence))?;
        let [width, height] = asked.size;
        let found = self.each(py, width as usize * height as usize, |model, progress| {
            let (space, camera) = camera_of(model, &request)?;
            let sight = PixelRays::new(&space, &camera, width, height);
            let pixels = Pixels { sight, width: width as usize, height: height as usize };
            rays::first_hits(&RayCaster::new(model)?, &pixels, (request.threads, progress))
        })?;
        Ok(arrays(py, found))
    }

    /// Nearest points of the surface.
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Nearest<'py>> {
        let points = triples(py, &points)?;
        let found =
            self.each(py, points.len(), |model, progress| nearest_points(model, points, threads, progress))?;
        let cell = |cell: &Option<u64>| cell.and_then(|cell| i64::try_from(cell).ok()).unwrap_or(-1);
        let cells = found.cell.iter().map(cell).collect();
        Ok((
            PyArray1::from_vec(py, found.distance_mm),
            PyArray1::from_vec(py, found.position_mm.into_flattened()),
            PyArray1::from_vec(py, found.normal.into_flattened()),
            PyArray1::from_vec(py, found.side),
            PyArray1::from_vec(py, cells),
        ))
    }

    fn first_hits<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray1<'py, f64>,
        directions: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Arrays<'py>> {
        let given = rays_of(py, [&origins, &directions])?;
        let found = self.each(py, given.0.len(), |model, progress| {
            rays::first_hits(&RayCaster::new(model)?, &given, (threads, progress))
        })?;
        Ok(arrays(py, found))
    }

    fn any_hit<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray1<'py, f64>,
        directions: PyReadonlyArray1<'py, f64>,
        t_max: f64,
        threads: usize,
    ) -> PyResult<Array<'py, bool>> {
        let given = rays_of(py, [&origins, &directions])?;
        let met = self.each(py, given.0.len(), |model, progress| {
            rays::any_hit(&RayCaster::new(model)?, &given, t_max, (threads, progress))
        })?;
        Ok(PyArray1::from_vec(py, met))
    }

    /// Corners, triangles, normals, colours; distance in mm of fewer triangles.
    fn triangles<'py>(
        &self,
        py: Python<'py>,
        most: Option<u64>,
        only: Option<Vec<String>>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let labels = &only_labels(only.as_deref()).map_err(|sentence| usage(py, &sentence))?[..];
        let request = ExportRequest { triangles: most, labels, ..ExportRequest::of(ExportForm::Ply) };
        let (mesh, distance_mm) = watched(py, progress, |progress| {
            self.unchanged(|| triangles_of(&self.model, &self.path, request, progress))
        })?;
        let arrays = PyDict::new(py);
        arrays.set_item("vertices", PyArray1::from_vec(py, mesh.vertices.into_flattened()))?;
        arrays.set_item("faces", PyArray1::from_vec(py, mesh.faces.into_flattened()))?;
        arrays.set_item("normals", PyArray1::from_vec(py, mesh.normals.into_flattened()))?;
        arrays.set_item("colors", PyArray1::from_vec(py, mesh.colors.into_flattened()))?;
        arrays.set_item("distance", PyArray1::from_iter(py, distance_mm))?;
        Ok(arrays)
    }

    /// Indices (x, y, z), centres in LPS mm, normals, values or colours of all voxels, in the order of the file.
    fn stored<'py>(&self, py: Python<'py>, what: &str) -> PyResult<Bound<'py, PyAny>> {
        const NONE: [f64; 3] = [f64::NAN; 3];
        Ok(match what {
            "index" => flat(py, self.voxels(py, |v| v.voxel)?),
            "center" => {
                let affine: Affine = self.model.affine();
                flat(py, self.voxels(py, |v| affine.apply(v.voxel.map(f64::from)))?)
            }
            "normal" => flat(py, self.voxels(py, |v| v.normal.unwrap_or(NONE))?),
            "color" => flat(py, self.voxels(py, |v| v.color.unwrap_or([0; 3]))?),
            "label" => flat(py, self.voxels(py, |v| [v.label.unwrap_or(0)])?),
            _ => flat(py, self.voxels(py, |v| [v.value.unwrap_or(f64::NAN)])?),
        })
    }
}
