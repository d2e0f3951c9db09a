//! Options of the commands that make pictures of models.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use infobyte::budget::parse_size;
use infobyte::format::ColorMap;
use infobyte::jobs::picture_set::PictureSet;
use infobyte::jobs::render::RenderRequest;
use infobyte::render::picture::Traversal;
use infobyte::render::{NamedView, Projection, Samples, Shading, Smoothing, ViewPoint};
use infobyte::scene::{LabelPick, LabelRule, Section};

use super::{Switch, ThreadArgs, parse};

/// The light, and the normals that it falls on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Shade {
    /// One lamp at the eye
    Plain,
    /// A key lamp, a lamp at the eye and the sky; one ray per pixel darkens hollows
    Soft,
    /// One lamp at the eye, and ambient occlusion: hollows turn dark
    Ao,
    /// Plain light by the normals as they are stored
    Stored,
    /// Plain light by normals blended between the boxes around a hit
    Blended,
    /// No light: colours as in the legend of values; the default for models with measured values
    Flat,
}

/// The colour map of measured values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ValueMap {
    /// As the quantity says
    Auto,
    /// Blue below 0, light grey at 0, red above
    Diverging,
    /// Dark violet to yellow
    Sequential,
}

#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// The model, - for standard input; or a scene of several models
    #[arg(value_name = "MODEL.oct|SCENE.toml")]
    pub(crate) model: PathBuf,
    /// The PNG to write; - for standard output
    #[arg(short, long, value_name = "IMAGE.png")]
    pub(crate) output: PathBuf,
    /// Write pictures even if their names say that they are other kinds of files
    #[arg(long)]
    pub(crate) force: bool,
    /// Size of the picture in pixels, one number for a square; by default that of the scene, or 1024x1024
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Named view; by default the scene's camera, or front
    #[arg(long, value_parser = parse::one_of(&NamedView::ALL, NamedView::name), conflicts_with = "eye")]
    pub(crate) view: Option<NamedView>,
    /// Position of the eye in mm (LPS), which looks at --look-at
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, requires = "look_at")]
    pub(crate) eye: Option<[f64; 3]>,
    /// Point in the middle of the picture, in mm (LPS), as seen from --eye; --view frames the model by itself
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, requires = "eye")]
    pub(crate) look_at: Option<[f64; 3]>,
    /// Direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::triple, requires = "eye")]
    pub(crate) up: Option<[f64; 3]>,
    /// Kind of projection; by default that of the scene, or parallel
    #[arg(long, value_parser = parse::projections())]
    pub(crate) projection: Option<Projection>,
    /// Vertical field of view in degrees, for the perspective projection; by default that of the scene, or 35
    #[arg(long, value_name = "DEG", value_parser = parse::fov)]
    pub(crate) fov: Option<f64>,
    /// Magnification about the middle of the picture
    #[arg(long, value_name = "FACTOR", value_parser = parse::zoom)]
    pub(crate) zoom: Option<f64>,
    /// Cut away everything outside bounds along the axes in mm (LPS), such as z=..40 or x=-20..20,y=0..; cut faces
    /// of closed models are red
    #[arg(long, value_name = "BOUNDS", value_parser = parse::bounds)]
    pub(crate) clip: Option<parse::Bounds>,
    /// Colour behind the model, #rrggbb or a name of CSS; transparent by default, for a scene its own
    #[arg(long, value_name = "COLOR", value_parser = parse::color)]
    pub(crate) background: Option<parse::Rgb>,
    /// Colour of models without colours of their own, #rrggbb or a name of CSS; by default that of bone, or of a scene's materials
    #[arg(long, value_name = "COLOR", value_parser = parse::color)]
    pub(crate) color: Option<parse::Rgb>,
    /// Colours of measured values: as their quantity says, diverging around 0, or sequential
    #[arg(long, value_enum)]
    pub(crate) colors: Option<ValueMap>,
    /// Lowest and highest value of the colours, such as -0.2..0.2, or 0.2 for that; a diverging map is symmetric around 0
    #[arg(long, value_name = "LO..HI", allow_hyphen_values = true, value_parser = parse::tolerance)]
    pub(crate) range: Option<[f64; 2]>,
    #[command(flatten)]
    pub(crate) labels: LabelArgs,
    /// Fraction of light that labels block, 0 to 1, such as skin=0.2 or all=0.3; repeatable, the last one wins
    #[arg(long, value_name = "LABELS=PART", value_parser = parse::opacity)]
    pub(crate) opacity: Vec<parse::Picks>,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Trace down to boxes about as small as a pixel, not to voxels: faster, less exact
    #[arg(long, value_enum, default_value_t = Switch::Off)]
    pub(crate) lod: Switch,
    /// With --lod on: boxes 2^N times as large, smaller if N is negative
    #[arg(long, value_name = "-8..8", default_value_t = 0, allow_negative_numbers = true, value_parser = clap::value_parser!(i8).range(-8..=8))]
    pub(crate) lod_bias: i8,
    /// Peak resident memory of the whole process; by default as much as the picture takes
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub(crate) memory: Option<u64>,
    /// The light; soft by default, for a scene its own
    #[arg(long, value_enum)]
    pub(crate) shading: Option<Shade>,
    /// Blend the normals of voxels between the boxes around a hit, in any light: no facets in close-ups
    #[arg(long)]
    pub(crate) blended: bool,
    /// Colour rays per pixel: eight where neighbours differ in depth or normal, else one (auto); or a fixed number; by
    /// default that of the scene, or auto
    #[arg(long, value_parser = parse::one_of(Samples::ALL, Samples::name))]
    pub(crate) samples: Option<Samples>,
    /// Ambient occlusion rays per pixel; by default 1 for soft light, 4 for ambient occlusion, for a scene with lights its
    /// own number
    #[arg(long, value_name = "1..1024", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) ao_rays: Option<u32>,
    /// What rays hit: the first voxel that the line intersects, or that of a discrete 6-connected ray
    #[arg(long, default_value = "exact", value_parser = parse::one_of(Traversal::ALL, Traversal::name))]
    pub(crate) traversal: Traversal,
    /// Six views on one sheet, each framed separately
    #[arg(long, conflicts_with_all = ["view", "eye", "turntable", "depth", "normals", "ids"])]
    pub(crate) contact: bool,
    /// Number of pictures around the model, from --view on: an animated PNG or, by its name, GIF; or one file each,
    /// in a folder (turn/) or with a number in the name (turn-%03d.png)
    #[arg(long, value_name = "N", conflicts_with_all = ["eye", "depth", "normals", "ids"], value_parser = clap::value_parser!(u32).range(2..=3600))]
    pub(crate) turntable: Option<u32>,
    /// A slice instead of a view: the filled section at a position on an axis, such as z=40 in mm (LPS), to scale; it has
    /// no light and no depth
    #[arg(long, value_name = "AXIS=MM", value_parser = parse::section, conflicts_with_all = ["view", "eye", "contact", "turntable", "depth", "normals", "ids"])]
    pub(crate) section: Option<Section>,
    /// Add a scale bar, and a cube with the patient's sides (R, L, A, P, S, I) or the axes
    #[arg(long)]
    pub(crate) annotate: bool,
    /// Add the file name and the size of what is visible, before cuts, or --title=TEXT, above the picture
    #[arg(long, value_name = "TEXT", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    pub(crate) title: Option<String>,
    /// List colours and names of the visible labels on the right, the largest first; for a scene also its models
    /// without labels. Of measured values: the bar of their colours, with numbers, unit and tolerance. A higher --size has room for more
    #[arg(long)]
    pub(crate) legend: bool,
    /// Also write a picture of the distances, in grey of 16 bits: 1 is the nearest point of the model and 65535 the
    /// farthest, 0 where nothing is hit; the report states both distances in mm
    #[arg(long, value_name = "F.png")]
    pub(crate) depth: Option<PathBuf>,
    /// Also write a picture of the normals
    #[arg(long, value_name = "F.png")]
    pub(crate) normals: Option<PathBuf>,
    /// Also write a picture of the numbers of the visible voxels, 48 bits in three channels, counted from 1; for a
    /// label model, of the numbers of the labels; the first channel counts the models of a scene from 0
    #[arg(long, value_name = "F.png")]
    pub(crate) ids: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ThumbnailArgs {
    /// The model; - for standard input
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// The PNG to write; - for standard output
    #[arg(short, long, value_name = "THUMB.png")]
    pub(crate) output: PathBuf,
    /// Write it even if its name says that it is another kind of file
    #[arg(long)]
    pub(crate) force: bool,
    /// Longest side in pixels
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = parse::side)]
    pub(crate) size: u32,
    #[command(flatten)]
    pub(crate) threads: ThreadArgs,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

/// Choice of labels.
#[derive(Debug, Args)]
pub(crate) struct LabelArgs {
    /// Only these labels, by number, range or name, such as 5,7..20,liver; the others are left out
    #[arg(long, value_name = "LABELS", value_parser = parse::label_picks)]
    only: Option<parse::Picks>,
    /// Leave out these labels
    #[arg(long, value_name = "LABELS", value_parser = parse::label_picks)]
    hide: Option<parse::Picks>,
}

impl LabelArgs {
    /// How much of the light labels stop, 0 if they are left out; later rules count before earlier ones.
    pub(crate) fn rules(&self, opacity: &[parse::Picks]) -> Vec<LabelRule> {
        let none = |rule: &LabelRule| LabelRule { opacity: 0.0, ..rule.clone() };
        let all = LabelRule { labels: LabelPick::All, opacity: 0.0 };
        let only = self.only.iter().flat_map(|only| std::iter::once(all.clone()).chain(only.0.clone()));
        let opacity = opacity.iter().flat_map(|picks| picks.0.clone());
        let hidden = self.hide.iter().flat_map(|picks| &picks.0).map(none);
        only.chain(opacity).chain(hidden).collect()
    }
}

impl RenderArgs {
    /// Where the camera stands, if that is said.
    fn point(&self) -> Option<ViewPoint> {
        match (self.eye, self.look_at) {
            (Some(eye), Some(look_at)) => Some(ViewPoint::Free { eye, look_at, up: self.up }),
            _ => self.view.map(ViewPoint::Named),
        }
    }

    /// The light of the picture, if that is said, and the normals that it falls on.
    fn light(&self) -> (Option<Shading>, Smoothing) {
        let (shading, smoothing) = match self.shading {
            None => (None, Smoothing::Smooth),
            Some(Shade::Soft) => (Some(Shading::Soft), Smoothing::Smooth),
            Some(Shade::Plain) => (Some(Shading::Plain), Smoothing::Smooth),
            Some(Shade::Ao) => (Some(Shading::Ao), Smoothing::Smooth),
            Some(Shade::Stored) => (Some(Shading::Plain), Smoothing::Stored),
            Some(Shade::Flat) => (Some(Shading::Flat), Smoothing::Smooth),
            Some(Shade::Blended) => (Some(Shading::Plain), Smoothing::Blended),
        };
        (shading, if self.blended { Smoothing::Blended } else { smoothing })
    }

    /// Refuses a flag that changes nothing without another one; a scene has a projection of its own.
    pub(crate) fn refuse_ignored(&self, is_scene: bool) -> Result<(), String> {
        let is_flat = match self.projection {
            Some(projection) => projection == Projection::Parallel,
            None => !is_scene,
        };
        let given = [
            (self.fov.is_some() && is_flat, "--fov", "--projection perspective"),
            (
                self.ao_rays.is_some() && matches!(self.light().0, Some(Shading::Plain | Shading::Flat)),
                "--ao-rays",
                "--shading ao",
            ),
            (self.lod_bias != 0 && self.lod == Switch::Off, "--lod-bias", "--lod on"),
        ];
        match given.into_iter().find(|(given, ..)| *given) {
            Some((_, flag, with)) => {
                Err(format!("{flag} changes nothing without {with}; add that, or leave {flag} out"))
            }
            None => Ok(()),
        }
    }

    /// The picture that is asked for.
    pub(crate) fn request(&self) -> RenderRequest {
        let usual = RenderRequest::default();
        let (shading, smoothing) = self.light();
        RenderRequest {
            size: self.size,
            point: self.point(),
            projection: self.projection,
            fov_deg: self.fov,
            zoom: self.zoom.unwrap_or(usual.zoom),
            shading,
            smoothing,
            ambient_rays: self.ao_rays.unwrap_or(0),
            samples: self.samples,
            lod: self.lod == Switch::On,
            lod_bias: self.lod_bias,
            traversal: self.traversal,
            color: self.color.map(|color| color.0),
            value_map: self.colors.and_then(|map| match map {
                ValueMap::Auto => None,
                ValueMap::Diverging => Some(ColorMap::Diverging),
                ValueMap::Sequential => Some(ColorMap::Sequential),
            }),
            value_range: self.range,
            background: self.background.map(|color| color.0),
            clip_mm: self.clip.map(|bounds| bounds.0),
            section: self.section,
            labels: self.labels.rules(&self.opacity),
            annotate: self.annotate,
            threads: self.threads.count(),
            memory_bytes: self.memory,
            ..usual
        }
    }

    /// How many pictures.
    pub(crate) fn shots(&self) -> PictureSet {
        match self.turntable {
            Some(count) => PictureSet::Turntable(count),
            None if self.contact => PictureSet::Contact,
            None => PictureSet::One,
        }
    }
}
