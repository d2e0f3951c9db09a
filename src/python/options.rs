//! Options of builds and pictures, which come as JSON from Python.

use std::path::PathBuf;

use pyo3::prelude::*;
use serde::Deserialize;

use super::failure::usage;
use crate::budget::{MemoryCap, parse_size};
use crate::builder::{BuildOptions, Connectivity, Gradient, Threshold, ViewedFrom};
use crate::clean::{CleanOptions, ComponentConnectivity, MAX_LARGEST, Preset, SizeLimit};
use crate::format::normal::NormalBits;
use crate::format::{Channel, Channels, LabelName, SurfaceKind};
use crate::geom::{Affine, Dims, Orientation};
use crate::jobs::build::{EachLabel, GridOptions};
use crate::jobs::export::MAX_SMOOTH;
use crate::jobs::names::read_label_names;
use crate::jobs::render::RenderRequest;
use crate::jobs::scene::SceneRequest;
use crate::jobs::scene::Section;
use crate::mesh::{Fill, GridChoice, UpAxis, usual_channels};
use crate::render::{NamedView, Projection, Samples, Shading, Smoothing, ViewPoint};
use crate::source::{GapPolicy, OpenOptions, RawOptions, SubjectKind};
use crate::volume::Overlap;
use crate::volume::{Placement, Rescale, ScalarType};

/// Bytes of a size such as `8MiB`.
#[pyfunction]
pub(super) fn size(py: Python<'_>, text: &str) -> PyResult<u64> {
    parse_size(text).map_err(|sentence| usage(py, &sentence))
}

/// Reads options; a sentence on what is wrong in them.
pub(super) fn read<'a, T: Deserialize<'a>>(py: Python<'_>, json: &'a str) -> PyResult<T> {
    serde_json::from_str(json).map_err(|error| usage(py, &format!("an option is wrong: {error}")))
}

/// Either of two kinds of values.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum Either<A, B> {
    A(A),
    B(B),
}

/// What a build is asked for; axes are x, y, z.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BuildAsked {
    iso: Option<f64>,
    range: Option<[f64; 2]>,
    preset: Option<String>,
    labels: Option<String>,
    /// A table, or numbers and names.
    names: Either<PathBuf, Vec<(u16, String)>>,
    keep_names: bool,
    smooth: Option<f64>,
    /// Folder of a model of each label.
    each: Option<PathBuf>,
    surface: Option<String>,
    channels: Option<Vec<String>>,
    gradient: Option<String>,
    normal_bits: Option<u32>,
    connectivity: Option<u32>,
    visible_from: Vec<Either<String, [f64; 3]>>,
    error: Option<String>,
    lod: bool,
    memory: u64,
    threads: Option<usize>,
    scratch: Option<PathBuf>,
    roi: Option<[[u32; 2]; 3]>,
    downsample: Option<u32>,
    close: u32,
    fill_cavities: bool,
    keep_largest: Option<u32>,
    drop_below: Option<Either<u64, f64>>,
    component_connectivity: Option<u32>,
    grid: Option<u32>,
    voxel: Option<f64>,
    origin: Option<[f64; 3]>,
    margin: u32,
    unit: f64,
    up: String,
    fill: Option<String>,
    keep_thin: bool,
    volume: Option<usize>,
    index: Vec<(String, u64)>,
    gaps: String,
    follow_links: bool,
    spacing: Option<[f64; 3]>,
    orientation: Option<String>,
    dims: Option<[u32; 3]>,
    dtype: Option<String>,
    skip: Option<u64>,
    affine: Option<[[f64; 4]; 3]>,
    rescale: Option<[f64; 2]>,
}

fn choice<T>(what: &str, name: &str, all: impl IntoIterator<Item = (String, T)>) -> Result<T, String> {
    let (mut names, mut found) = (Vec::new(), None);
    for (known, value) in all {
        if known == name {
            found = Some(value);
        }
        names.push(known);
    }
    found.ok_or_else(|| format!("{what}={name} is not known; choose one of {}", names.join(", ")))
}

/// One of 26 and 6.
fn neighbours<T>(what: &str, number: Option<u32>, of_26: T, of_6: T) -> Result<T, String> {
    match number {
        None | Some(26) => Ok(of_26),
        Some(6) => Ok(of_6),
        Some(other) => Err(format!("{what}={other} is not a connectivity; choose 26 or 6")),
    }
}

impl BuildAsked {
    fn threshold(&self) -> Threshold {
        match (self.iso, self.range) {
            (Some(iso), _) => Threshold::Iso(iso),
            (None, Some([lo, hi])) => Threshold::Range(lo, hi),
            (None, None) => Threshold::Otsu,
        }
    }

    fn surface(&self) -> Result<SurfaceKind, String> {
        let all = [SurfaceKind::Skin, SurfaceKind::Cells].map(|kind| (kind.name().to_owned(), kind));
        // Cells, unless something is asked for that only skin has.
        let of_normals = |names: &Vec<String>| names.iter().all(|name| name == Channel::Normal.name());
        let is_offset = |names: &Vec<String>| names.iter().any(|name| name == Channel::Offset.name());
        let only_skin = self.gradient.is_some()
            || self.normal_bits.is_some_and(|bits| bits != 16)
            || self.connectivity == Some(6)
            || self.channels.as_ref().is_some_and(|names| names.is_empty() || !of_normals(names))
            || self.keep_thin
            || self.fill.as_deref() == Some("surface");
        let only_cells = self.channels.as_ref().is_some_and(is_offset);
        let usual = if only_skin && !only_cells && self.labels.is_none() {
            SurfaceKind::Skin
        } else {
            SurfaceKind::Cells
        };
        let surface = self.surface.as_ref().map_or(Ok(usual), |surface| choice("surface", surface, all))?;
        if surface == SurfaceKind::Skin && self.labels.is_some() {
            return Err("surface=skin is for volumes, and labels are stored as cells; leave it out".into());
        }
        let given = [("gradient", self.gradient.is_some()), ("connectivity", self.connectivity == Some(6))];
        match given.into_iter().find(|(_, given)| *given && surface == SurfaceKind::Cells) {
            Some((name, _)) => Err(format!("{name} is for skin voxels, and cells are built; leave it out")),
            None => Ok(surface),
        }
    }

    /// Where models of each label go, if they are wanted; like that of all labels they replace what is there.
    pub(super) fn each(&self) -> Option<EachLabel<'_>> {
        self.each.as_ref().map(|folder| EachLabel { folder, replace: true, keep_whole: true })
    }

    /// The channels, or those that are usual.
    fn channels(&self, kind: SubjectKind) -> Result<Channels, String> {
        let Some(names) = &self.channels else {
            return Ok(match kind {
                SubjectKind::Mesh => usual_channels(self.surface()?),
                SubjectKind::Volume | SubjectKind::Tree => Channels::default(),
            });
        };
        let channel =
            |name: &String| choice("channels", name, Channel::all().map(|c| (c.name().to_owned(), c)));
        names.iter().map(channel).collect()
    }

    pub(super) fn options(&self, kind: SubjectKind) -> Result<BuildOptions, String> {
        let usual = BuildOptions::default();
        let gradient = |name: &String| {
            choice("gradient", name, Gradient::ALL.map(|gradient| (gradient.name().to_owned(), gradient)))
        };
        let bits = |number: u32| {
            choice(
                "normal_bits",
                &number.to_string(),
                NormalBits::ALL.map(|bits| (bits.number().to_string(), bits)),
            )
        };
        let viewed = |from: &Either<String, [f64; 3]>| match from {
            Either::A(name) if name == "outside" => Ok(ViewedFrom::Outside),
            Either::A(name) => name.parse().map(|view: NamedView| ViewedFrom::Along(view.looks_along())),
            Either::B(point) => Ok(ViewedFrom::Point(*point)),
        };
        if self.threads == Some(0) {
            return Err("threads=0 makes no sense; choose 1 to 1024".into());
        }
        Ok(BuildOptions {
            threshold: self.threshold(),
            labels: self.labels.as_deref().map(str::parse).transpose()?,
            smooth: match self.smooth {
                Some(voxels) if !(0.0..=MAX_SMOOTH).contains(&voxels) => {
                    return Err(format!("smooth={voxels} is not a distance from 0 to {MAX_SMOOTH} voxel"));
                }
                Some(_) if self.labels.is_none() => {
                    return Err("smooth is for labels; give labels, too".into());
                }
                smooth => smooth.unwrap_or(MAX_SMOOTH),
            },
            overlap: Overlap::default(),
            label_names: match &self.names {
                Either::A(table) => {
                    read_label_names(table, self.keep_names).map_err(|error| error.to_string())?
                }
                Either::B(names) => names
                    .iter()
                    .map(|(number, name)| LabelName { number: *number, name: name.clone(), color: None })
                    .collect(),
            },
            surface: self.surface()?,
            connectivity: neighbours(
                "connectivity",
                self.connectivity,
                Connectivity::Thin26,
                Connectivity::Thick6,
            )?,
            channels: self.channels(kind)?,
            gradient: self.gradient.as_ref().map_or(Ok(usual.gradient), gradient)?,
            normal_bits: self.normal_bits.map_or(Ok(usual.normal_bits), bits)?,
            visible_from: self.visible_from.iter().map(viewed).collect::<Result<_, String>>()?,
            error: self.error.as_deref().map(str::parse).transpose()?,
            lod: self.lod,
            memory: MemoryCap::Share(self.memory),
            threads: self.threads.unwrap_or(usual.threads).min(1024),
            scratch: self.scratch.clone(),
        })
    }

    pub(super) fn cleaning(&self) -> Result<CleanOptions, String> {
        let preset = |name: &String| {
            choice("preset", name, Preset::ALL.map(|preset| (preset.name().to_owned(), preset)))
        };
        if self.roi.is_some_and(|roi| roi.iter().any(|[start, end]| start >= end)) {
            return Err("roi is not a box; give (start, end) for each axis, start below end".into());
        }
        if let Some(factor @ (0 | 1 | 3 | 5..)) = self.downsample {
            return Err(format!("downsample={factor} is not a factor; choose 2 or 4"));
        }
        if self.close > 2 {
            return Err(format!("close={} is not a radius; choose 1 or 2 voxels", self.close));
        }
        if self.keep_largest.is_some_and(|count| !(1..=MAX_LARGEST).contains(&count)) {
            return Err(format!("keep_largest is not a number of components; choose 1 to {MAX_LARGEST}"));
        }
        Ok(CleanOptions {
            roi: self.roi.map(|roi| roi.map(|[start, end]| start..end)),
            downsample: self.downsample,
            preset: self.preset.as_ref().map(preset).transpose()?,
            close: self.close,
            fill_cavities: self.fill_cavities,
            keep_largest: self.keep_largest,
            drop_below: self.drop_below.as_ref().map(|limit| match limit {
                Either::A(voxels) => SizeLimit::Voxels(*voxels),
                Either::B(percent) => SizeLimit::PercentOfLargest(*percent),
            }),
            connectivity: neighbours(
                "component_connectivity",
                self.component_connectivity,
                ComponentConnectivity::Corners26,
                ComponentConnectivity::Faces6,
            )?,
        })
    }

    pub(super) fn grid(&self) -> Result<GridOptions, String> {
        let fills = [("winding", Fill::Winding), ("parity", Fill::Parity), ("surface", Fill::Surface)];
        let fill = |name: &String| choice("fill", name, fills.map(|(name, fill)| (name.to_owned(), fill)));
        let margin = self.margin;
        let grid = match (self.grid, self.voxel, self.origin, self.dims()?) {
            (Some(_), Some(_), ..) => return Err("grid and voxel are both given; choose one".into()),
            (None, Some(edge_mm), Some(origin_mm), Some(dims)) => {
                Some(GridChoice::Exact { edge_mm, origin_mm, dims })
            }
            (None, Some(edge_mm), None, None) => Some(GridChoice::Voxel { edge_mm, margin }),
            (_, _, Some(_), _) => return Err("origin needs voxel and dims".into()),
            (Some(voxels), ..) if !(1..=16384).contains(&voxels) => {
                return Err(format!("grid={voxels} is not a number of voxels; choose 1 to 16384"));
            }
            (Some(voxels), ..) => Some(GridChoice::Side { voxels, margin }),
            _ => None,
        };
        let fill = self.fill.as_ref().map(fill).transpose()?;
        Ok(GridOptions {
            grid,
            unit_mm: self.unit,
            up: choice("up", &self.up, [("z".to_owned(), UpAxis::Z), ("y".to_owned(), UpAxis::Y)])?,
            fill,
            keep_thin: self.keep_thin,
            follow_links: self.follow_links,
            keep_colors: self.surface.is_none() && self.channels.is_none() && self.error.is_none(),
        })
    }

    fn dims(&self) -> Result<Option<Dims>, String> {
        let of = |[x, y, z]: [u32; 3]| {
            Dims::new(x, y, z)
                .ok_or_else(|| format!("{x} x {y} x {z} is not a size; each side is 1 to 65536"))
        };
        self.dims.map(of).transpose()
    }

    pub(super) fn opening(&self) -> Result<OpenOptions, String> {
        let policies = [("error", GapPolicy::Error), ("fill", GapPolicy::Fill), ("keep", GapPolicy::Keep)];
        let letters = |letters: &String| {
            Orientation::parse(letters).ok_or_else(|| {
                format!("orientation={letters} is not one; write three letters, one each of L/R, P/A and S/I")
            })
        };
        let orientation = self.orientation.as_ref().map(letters).transpose()?;
        let raw = match (self.dims()?, &self.dtype) {
            (Some(dims), Some(dtype)) => {
                let (scalar, endian) = ScalarType::parse(dtype).ok_or_else(|| {
                    format!("dtype={dtype} is not a sample type; write for example u16 or i16be")
                })?;
                Some(RawOptions {
                    dims,
                    scalar,
                    endian,
                    spacing_mm: self.spacing.unwrap_or([1.0; 3]),
                    skip: self.skip.unwrap_or(0),
                    orientation: orientation.unwrap_or(Orientation::LPS),
                })
            }
            (Some(_), None) if self.origin.is_some() => None,
            (None, None) if self.skip.is_none() => None,
            _ => return Err("headerless files need dims and dtype".into()),
        };
        if self.volume.is_some() && !self.index.is_empty() {
            return Err("volume and index exclude each other; give one".into());
        }
        Ok(OpenOptions {
            raw,
            gaps: choice("gaps", &self.gaps, policies.map(|(name, policy)| (name.to_owned(), policy)))?,
            volume: self.volume,
            index: self.index.clone(),
            follow_links: self.follow_links,
            keep_names: self.keep_names,
            placement: Placement { spacing_mm: self.spacing, orientation },
            ..OpenOptions::default()
        })
    }

    /// The place of an array, and its physical values.
    pub(super) fn place(&self) -> (Affine, Rescale) {
        let affine = self.affine.map_or(Affine::from_spacing([1.0; 3]), |rows| Affine { rows });
        let rescale = |[slope, intercept]: [f64; 2]| Rescale { slope, intercept };
        (affine, self.rescale.map_or(Rescale::IDENTITY, rescale))
    }
}

/// What picture is asked for.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PictureAsked {
    pub(super) size: [u32; 2],
    view: Option<String>,
    eye: Option<[f64; 3]>,
    look_at: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    turned: Option<f64>,
    projection: String,
    fov: Option<f64>,
    zoom: f64,
    color: Option<[u8; 3]>,
    shading: String,
    blended: bool,
    samples: String,
    ao_rays: Option<u32>,
    lod: bool,
    annotate: bool,
    smooth_edges: bool,
    background: Option<[u8; 3]>,
    pub(super) title: Option<String>,
    pub(super) legend: bool,
    /// An axis, and a place along it in mm.
    section: Option<(String, f64)>,
    threads: Option<usize>,
}

impl PictureAsked {
    pub(super) fn request(&self) -> Result<RenderRequest, String> {
        let view = self.view.as_deref().map(str::parse).transpose()?;
        let point = match (self.eye, self.look_at, self.turned) {
            (Some(eye), Some(look_at), None) if view.is_none() => {
                ViewPoint::Free { eye, look_at, up: self.up }
            }
            (None, None, Some(degrees)) => ViewPoint::Turned { view: view.unwrap_or_default(), degrees },
            (None, None, None) if self.up.is_none() => ViewPoint::Named(view.unwrap_or_default()),
            _ => return Err("give a view, or eye and look_at, with up if it matters".into()),
        };
        let usual = RenderRequest::default();
        let [width, height] = self.size;
        let shadings = [
            ("plain", (Shading::Plain, Smoothing::Smooth)),
            ("soft", (Shading::Soft, Smoothing::Smooth)),
            ("ao", (Shading::Ao, Smoothing::Smooth)),
            ("stored", (Shading::Plain, Smoothing::Stored)),
            ("blended", (Shading::Plain, Smoothing::Blended)),
        ];
        let (shading, smoothing) =
            choice("shading", &self.shading, shadings.map(|(name, kind)| (name.to_owned(), kind)))?;
        let projection = self.projection.parse()?;
        let unused = [
            ("fov", "projection='perspective'", self.fov.is_some() && projection == Projection::Parallel),
            ("ao_rays", "shading='soft' or 'ao'", self.ao_rays.is_some() && shading == Shading::Plain),
        ];
        if let Some((name, with, _)) = unused.into_iter().find(|(.., is_unused)| *is_unused) {
            return Err(format!("{name} changes nothing without {with}; add that, or leave {name} out"));
        }
        let samples =
            choice("samples", &self.samples, Samples::ALL.iter().map(|s| (s.name().to_owned(), *s)))?;
        Ok(RenderRequest {
            width,
            height,
            point,
            projection,
            fov_deg: self.fov.unwrap_or(RenderRequest::FOV_DEG),
            threads: self.threads.unwrap_or(usual.threads).clamp(1, 1024),
            lod: self.lod,
            samples: if self.smooth_edges && samples == Samples::One { Samples::Auto } else { samples },
            zoom: self.zoom,
            color: self.color,
            shading,
            smoothing: if self.blended { Smoothing::Blended } else { smoothing },
            ambient_rays: self.ao_rays.unwrap_or(0),
            annotate: self.annotate,
            background: self.background,
            ..usual
        })
    }

    /// What is asked of a slice, if it is one.
    pub(super) fn section(&self) -> Result<Option<SceneRequest>, String> {
        let Some((axis, at_mm)) = &self.section else { return Ok(None) };
        let axes = ["x", "y", "z"].into_iter().zip(0..).map(|(name, axis)| (name.to_owned(), axis));
        let section = Section { axis: choice("section", axis, axes)?, at_mm: *at_mm };
        let threads = self.threads.unwrap_or(RenderRequest::default().threads).clamp(1, 1024);
        Ok(Some(SceneRequest {
            size: Some(self.size),
            zoom: Some(self.zoom),
            background: self.background,
            color: self.color,
            section: Some(section),
            annotate: self.annotate,
            threads,
            ..SceneRequest::default()
        }))
    }
}
