//! Options of builds and pictures, which come as JSON from Python.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::prelude::*;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::failure::usage;
use crate::budget::parse_size;
use crate::builder::BuildOptions;
use crate::clean::CleanOptions;
use crate::format::ColorMap;
use crate::geom::{Affine, Dims, Orientation};
use crate::jobs::build::{EachLabel, GridOptions, viewed_from};
use crate::jobs::export::MAX_SMOOTH;
use crate::jobs::names::read_label_names;
use crate::jobs::render::RenderRequest;
use crate::jobs::scene::{LabelPick, LabelRule, Section};
use crate::render::{Projection, Samples, Shading, Smoothing, ViewPoint};
use crate::source::{OpenOptions, RawOptions};
use crate::volume::{Rescale, ScalarType};

/// Bytes of a size such as `8MiB`.
#[pyfunction]
pub(super) fn size(py: Python<'_>, text: &str) -> PyResult<u64> {
    parse_size(text).map_err(|sentence| usage(py, &sentence))
}

/// Reads options; the error is a sentence on the fault.
pub(super) fn read<'a, T: Deserialize<'a>>(py: Python<'_>, json: &'a str) -> PyResult<T> {
    serde_json::from_slice(json.as_bytes()).map_err(|error| {
        // The position in the text is useless to users, who did not write it.
        let said = error.to_string();
        usage(py, &format!("an option is wrong: {}", said.split(" at line ").next().unwrap_or(&said)))
    })
}

/// Options by name.
type Named = Map<String, Value>;

/// Options of a build by the part of the library that reads them; axes are x, y, z.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BuildAsked {
    build: Named,
    clean: Named,
    grid: Named,
    open: Named,
    raw: Option<RawAsked>,
    visible_from: Vec<String>,
    /// Table of the names of labels.
    names: Option<PathBuf>,
    /// Folder of a model of each label.
    each: Option<PathBuf>,
    affine: Option<[[f64; 4]; 3]>,
    rescale: Option<[f64; 2]>,
}

/// Layout of headerless files.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawAsked {
    dims: Dims,
    dtype: String,
    skip: u64,
}

/// Reads options; an error names the faulty one.
fn parsed<T: DeserializeOwned>(options: &Named) -> Result<T, String> {
    for (name, value) in options {
        let alone = Named::from_iter([(name.clone(), value.clone())]);
        serde_json::from_value::<T>(alone.into()).map_err(|error| format!("{name}: {error}"))?;
    }
    serde_json::from_value(options.clone().into()).map_err(|error| error.to_string())
}

impl BuildAsked {
    /// Folder of models of each label, if they are wanted; as the model of all labels, they replace existing files.
    pub(super) fn each(&self) -> Option<EachLabel<'_>> {
        self.each.as_ref().map(|folder| EachLabel { folder, replace: true, keep_whole: true })
    }

    fn options(&self) -> Result<BuildOptions, String> {
        let mut options: BuildOptions = parsed(&self.build)?;
        options.visible_from =
            self.visible_from.iter().map(|from| viewed_from(from)).collect::<Result<_, _>>()?;
        if let Some(table) = &self.names {
            let keep_names = self.opening()?.keep_names;
            options.label_names = read_label_names(table, keep_names).map_err(|error| error.to_string())?;
        }
        if !(0.0..=MAX_SMOOTH).contains(&options.smooth) {
            return Err(format!("smooth={} is not a distance from 0 to {MAX_SMOOTH} voxel", options.smooth));
        }
        if let Some((name, of)) = options.ignored() {
            return Err(format!("{name} is for {of}; leave it out"));
        }
        match options.threads {
            0 => Err("threads=0 makes no sense; choose 1 to 1024".into()),
            threads => Ok(BuildOptions { threads: threads.min(1024), ..options }),
        }
    }

    /// The options of the build, of the cleaning before it, and of the grid of meshes.
    pub(super) fn all(&self) -> Result<(BuildOptions, CleanOptions, GridOptions), String> {
        Ok((self.options()?, parsed(&self.clean)?, parsed(&self.grid)?))
    }

    pub(super) fn opening(&self) -> Result<OpenOptions, String> {
        let mut how: OpenOptions = parsed(&self.open)?;
        if let Some(RawAsked { dims, dtype, skip }) = &self.raw {
            let (scalar, endian) = ScalarType::parse(dtype).ok_or_else(|| {
                format!("dtype={dtype} is not a sample type; write for example u16 or i16be")
            })?;
            how.raw = Some(RawOptions {
                dims: *dims,
                scalar,
                endian,
                spacing_mm: how.placement.spacing_mm.unwrap_or([1.0; 3]),
                skip: *skip,
                orientation: how.placement.orientation.unwrap_or(Orientation::LPS),
            });
        }
        Ok(how)
    }

    /// The affine of an array, and the rescaling to its physical values.
    pub(super) fn place(&self) -> (Affine, Rescale) {
        let affine = self.affine.map_or(Affine::from_spacing([1.0; 3]), |rows| Affine { rows });
        let rescale = |[slope, intercept]: [f64; 2]| Rescale { slope, intercept };
        (affine, self.rescale.map_or(Rescale::IDENTITY, rescale))
    }
}

/// Options of a picture.
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
    /// Name of the light; the model's own if missing.
    shading: Option<String>,
    colors: Option<String>,
    range: Option<[f64; 2]>,
    blended: bool,
    samples: String,
    ao_rays: Option<u32>,
    lod: bool,
    annotate: bool,
    smooth_edges: bool,
    background: Option<[u8; 3]>,
    pub(super) title: Option<String>,
    pub(super) legend: bool,
    /// Low and high bounds by axis, in mm.
    clip: Option<BTreeMap<String, [Option<f64>; 2]>>,
    only: Option<Vec<String>>,
    hide: Vec<String>,
    opacity: Vec<(String, f64)>,
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
        // Names were checked by the package.
        let (shading, smoothing) = match self.shading.as_deref() {
            Some("stored") => (Some(Shading::Plain), Smoothing::Stored),
            Some("blended") => (Some(Shading::Plain), Smoothing::Blended),
            light => (Shading::ALL.iter().find(|of| Some(of.name()) == light).copied(), Smoothing::Smooth),
        };
        let value_map = match self.colors.as_deref() {
            Some("diverging") => Some(ColorMap::Diverging),
            Some("sequential") => Some(ColorMap::Sequential),
            _ => None,
        };
        if self.range.is_some_and(|[lo, hi]| !(lo < hi && lo.is_finite() && hi.is_finite())) {
            return Err("range: give a lower and an upper value, the lower one first".into());
        }
        let projection = self.projection.parse()?;
        let unused = [
            ("fov", "projection='perspective'", self.fov.is_some() && projection == Projection::Parallel),
            (
                "ao_rays",
                "shading='soft' or 'ao'",
                self.ao_rays.is_some() && matches!(shading, Some(Shading::Plain | Shading::Flat)),
            ),
        ];
        if let Some((name, with, _)) = unused.into_iter().find(|(.., is_unused)| *is_unused) {
            return Err(format!("{name} changes nothing without {with}; add that, or leave {name} out"));
        }
        let samples = Samples::ALL.iter().find(|of| of.name() == self.samples).copied().unwrap_or_default();
        let axis = |name: &str| "xyz".find(name).unwrap_or_default();
        let mut clip_mm = [[f64::NEG_INFINITY, f64::INFINITY]; 3];
        for (name, [low, high]) in self.clip.iter().flatten() {
            let bounds = &mut clip_mm[axis(name)];
            *bounds = [low.unwrap_or(bounds[0]), high.unwrap_or(bounds[1])];
            if bounds[0] >= bounds[1] {
                return Err(format!("clip leaves nothing along {name}; give (low, high), low below high"));
            }
        }
        let section = |(name, at_mm): &(String, f64)| Section { axis: axis(name), at_mm: *at_mm };
        Ok(RenderRequest {
            size: Some(self.size),
            point: Some(point),
            projection: Some(projection),
            fov_deg: self.fov,
            zoom: self.zoom,
            shading,
            value_map,
            value_range: self.range,
            smoothing: if self.blended { Smoothing::Blended } else { smoothing },
            ambient_rays: self.ao_rays.unwrap_or(0),
            samples: Some(if self.smooth_edges && samples == Samples::One { Samples::Auto } else { samples }),
            lod: self.lod,
            color: self.color,
            background: self.background,
            clip_mm: self.clip.is_some().then_some(clip_mm),
            labels: self.labels()?,
            section: self.section.as_ref().map(section),
            annotate: self.annotate,
            threads: self.threads.unwrap_or(usual.threads).clamp(1, 1024),
            ..usual
        })
    }

    /// Visibility of labels; later rules override earlier ones.
    fn labels(&self) -> Result<Vec<LabelRule>, String> {
        if let Some((label, part)) = self.opacity.iter().find(|(_, part)| !(0.0..=1.0).contains(part)) {
            return Err(format!("opacity of {label} is {part}; choose 0 to 1"));
        }
        let mut rules = only_labels(self.only.as_deref())?;
        let opacity = self.opacity.iter().map(|(text, part)| (text, *part));
        for (text, part) in opacity.chain(self.hide.iter().map(|text| (text, 0.0))) {
            rules.push(rule(text, part)?);
        }
        Ok(rules)
    }
}

fn rule(label: &str, opacity: f64) -> Result<LabelRule, String> {
    Ok(LabelRule { labels: label.parse()?, opacity })
}

/// Rules that leave out all labels but some, if these are given.
pub(super) fn only_labels(labels: Option<&[String]>) -> Result<Vec<LabelRule>, String> {
    let none = labels.map(|_| Ok(LabelRule { labels: LabelPick::All, opacity: 0.0 }));
    none.into_iter().chain(labels.into_iter().flatten().map(|label| rule(label, 1.0))).collect()
}
