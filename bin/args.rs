//! The command line as types, and the sentences for what cannot be parsed.

use std::ops::Range;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use infobyte::budget::parse_size;
use infobyte::clean::{CleanOptions, ComponentConnectivity, MOST_LARGEST, Preset, SizeLimit};
use infobyte::geom::{Dims, Orientation};
use infobyte::jobs::render::RenderRequest;
use infobyte::source::{Endian, GapPolicy, ScalarType};

/// Volumes into compact surface octrees in a fixed amount of memory, shown by exact ray traversal.
#[derive(Debug, Parser)]
#[command(name = "oct", version, arg_required_else_help = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Build a model from a volume: a file, a folder (DICOM series or slices) or several slice files
    Build(BuildArgs),
    /// Convert every volume below some folders, with thumbnails and a report
    Batch(BatchArgs),
    /// List what would be converted, and why the rest would be refused
    Scan(ScanArgs),
    /// Show what a model says of itself (mapped or packed)
    Info(InfoArgs),
    /// Check every invariant of a model (mapped or packed)
    Verify(VerifyArgs),
    /// Pack a model for archive and transport; lossless
    Pack(PackArgs),
    /// Unpack a packed model; gives the original byte for byte
    Unpack(PackArgs),
    /// Render a picture of a model
    Render(RenderArgs),
    /// Render a small square picture with a transparent background
    Thumbnail(ThumbnailArgs),
    /// Build a synthetic head and its picture, to see the program work without any data
    Demo(DemoArgs),
    /// Compare random rays through a model with a slow exact reference
    Selfcheck(SelfcheckArgs),
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("selection").multiple(false))]
pub(crate) struct BuildArgs {
    /// A file, a folder, or several slice files
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) input: Vec<PathBuf>,
    /// The model to write
    #[arg(short, long, value_name = "MODEL.oct")]
    pub(crate) output: PathBuf,
    /// Inside are values of V and more, in physical units (HU for CT)
    #[arg(long, value_name = "V", group = "selection", allow_hyphen_values = true, value_parser = number)]
    pub(crate) iso: Option<f64>,
    /// Inside are values from LO to HI, both included
    #[arg(long, value_name = "LO..HI", group = "selection", allow_hyphen_values = true, value_parser = range)]
    pub(crate) range: Option<[f64; 2]>,
    /// Choose the threshold by Otsu's method (the default)
    #[arg(long, group = "selection")]
    pub(crate) otsu: bool,
    /// Peak resident memory of the whole process
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Attributes per skin voxel: normal, value, or none
    #[arg(long, value_name = "LIST", default_value = "normal", value_parser = channels)]
    pub(crate) channels: ChannelChoice,
    /// Connectivity of the skin: 26 (thin) or 6 (thick)
    #[arg(long, default_value = "26", value_parser = connectivity)]
    pub(crate) connectivity: u8,
    /// Store mean attributes of coarse nodes, for quick small pictures
    #[arg(long, value_enum, default_value_t = Switch::On)]
    pub(crate) lod: Switch,
    /// Folder for the scratch file; beside the output by default
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress, no warnings
    #[arg(long)]
    pub(crate) quiet: bool,
    #[command(flatten)]
    pub(crate) which: WhichArgs,
    #[command(flatten)]
    pub(crate) clean: CleanArgs,
    #[command(flatten)]
    pub(crate) raw: RawArgs,
}

/// What is left to choose where folders hold several volumes, or series have gaps.
#[derive(Debug, Args)]
#[command(next_help_heading = "Folders and series")]
pub(crate) struct WhichArgs {
    /// Take the volume of this number in the list of `oct scan`; the largest by default
    #[arg(long, value_name = "N", value_parser = volume_number)]
    pub(crate) volume: Option<usize>,
    /// Where slices are missing or uneven: refuse, make them from their neighbours, or take them as even
    #[arg(long, value_enum, default_value_t = Gaps::Error)]
    pub(crate) gaps: Gaps,
}

/// What to do about gaps between slices.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Gaps {
    Error,
    Fill,
    Keep,
}

impl From<Gaps> for GapPolicy {
    fn from(gaps: Gaps) -> Self {
        match gaps {
            Gaps::Error => Self::Error,
            Gaps::Fill => Self::Fill,
            Gaps::Keep => Self::Keep,
        }
    }
}

fn volume_number(text: &str) -> Result<usize, String> {
    let number = text.parse::<usize>().ok().filter(|n| *n > 0);
    number.ok_or_else(|| format!("'{text}' is not the number of a volume; they are counted from 1"))
}

/// What is done to the volume before it is built, in the order of these options.
#[derive(Debug, Args)]
#[command(next_help_heading = "Cleaning (in this order, whatever the order given)")]
pub(crate) struct CleanArgs {
    /// Use a part of the volume: voxel indices from X0 up to but without X1, and so on
    #[arg(long, value_name = "X0..X1,Y0..Y1,Z0..Z1", value_parser = roi)]
    pub(crate) roi: Option<Roi>,
    /// Make the volume 2 or 4 times smaller along each axis, by means of blocks; each pass still reads all of it
    #[arg(long, value_name = "2|4", value_parser = downsample)]
    pub(crate) downsample: Option<u32>,
    /// Inside is a tissue by its range in HU (CT only): bone 226 and more, compact-bone 662 and more, teeth 1550
    /// and more, metal 2500 and more, skin -300 and more, muscle -5..135, fat -205..-51, lung -950..-500
    #[arg(long, value_name = "NAME", group = "selection", value_parser = preset)]
    pub(crate) preset: Option<Preset>,
    /// Close gaps: dilation, then erosion, by a ball of R + 1/2 voxels, R = 1 or 2, whatever the spacing. Extra
    /// passes: the volume once (for this and all below together), the bits once
    #[arg(long, value_name = "R", value_parser = closing)]
    pub(crate) close: Option<u32>,
    /// Fill what is enclosed: parts of the outside that do not reach the border of the volume, connected by the
    /// complement of --component-connectivity. Extra passes: the bits twice
    #[arg(long)]
    pub(crate) fill_cavities: bool,
    /// Keep the N largest components, of equal ones the first in z, y, x. Extra passes: the bits twice
    #[arg(long, value_name = "N", value_parser = keep_largest)]
    pub(crate) keep_largest: Option<u32>,
    /// Drop components of fewer voxels, or of less than a part of the largest one. Extra passes: the bits twice,
    /// together with --keep-largest
    #[arg(long, value_name = "VOXELS|PERCENT%", value_parser = drop_below)]
    pub(crate) drop_below: Option<SizeLimit>,
    /// Voxels of one component share a face (6), or a face, an edge or a corner (26)
    #[arg(long, value_name = "26|6", default_value = "26", value_parser = connectivity)]
    pub(crate) component_connectivity: u8,
}

impl CleanArgs {
    /// The options of the library.
    pub(crate) fn options(&self) -> CleanOptions {
        CleanOptions {
            roi: self.roi.as_ref().map(|roi| roi.0.clone()),
            downsample: self.downsample,
            preset: self.preset,
            close: self.close.unwrap_or(0),
            fill_cavities: self.fill_cavities,
            keep_largest: self.keep_largest,
            drop_below: self.drop_below,
            connectivity: match self.component_connectivity {
                6 => ComponentConnectivity::Faces6,
                _ => ComponentConnectivity::Corners26,
            },
        }
    }
}

/// A box of voxels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Roi([Range<u32>; 3]);

fn roi(text: &str) -> Result<Roi, String> {
    let range = |part: &str| {
        let (start, end) = part.split_once("..")?;
        let (start, end) = (start.trim().parse::<u32>().ok()?, end.trim().parse::<u32>().ok()?);
        (start < end).then_some(start..end)
    };
    let ranges: Option<Vec<_>> = text.split(',').map(range).collect();
    let ranges: Option<[Range<u32>; 3]> = ranges.and_then(|r| r.try_into().ok());
    ranges.map(Roi).ok_or_else(|| {
        format!("'{text}' is not a box; write X0..X1,Y0..Y1,Z0..Z1, for example 10..200,0..256,5..90")
    })
}

fn downsample(text: &str) -> Result<u32, String> {
    match text {
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err(format!("'{text}' is not a factor; choose 2 or 4")),
    }
}

fn closing(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        _ => Err(format!("'{text}' is not a radius; choose 1 or 2 voxels")),
    }
}

fn preset(text: &str) -> Result<Preset, String> {
    Preset::parse(text).ok_or_else(|| {
        let names = Preset::ALL.map(Preset::name).join(", ");
        format!("'{text}' is not a preset; choose one of {names}")
    })
}

fn keep_largest(text: &str) -> Result<u32, String> {
    text.parse::<u32>()
        .ok()
        .filter(|n| (1..=MOST_LARGEST).contains(n))
        .ok_or_else(|| format!("'{text}' is not a number of components; choose 1 to {MOST_LARGEST}"))
}

fn drop_below(text: &str) -> Result<SizeLimit, String> {
    let refuse = || format!("'{text}' is not a size; write a number of voxels, or a percentage such as 5%");
    match text.strip_suffix('%') {
        Some(percent) => match number(percent) {
            Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(SizeLimit::PercentOfLargest(percent)),
            _ => Err(refuse()),
        },
        None => text.parse().map(SizeLimit::Voxels).map_err(|_| refuse()),
    }
}

/// Heading of the options that serve raw volumes and others alike.
const PLACE: &str = "Spacing and directions";

/// What a headerless volume cannot say of itself.
#[derive(Debug, Args)]
#[command(next_help_heading = "Raw volumes only")]
pub(crate) struct RawArgs {
    /// Size in voxels, x fastest
    #[arg(long, value_name = "NXxNYxNZ", value_parser = dims)]
    pub(crate) dims: Option<Dims>,
    /// Sample type: u8, i8, u16, i16, u32, i32, f32 or f64, with le (default) or be
    #[arg(long, value_name = "TYPE", value_parser = dtype)]
    pub(crate) dtype: Option<(ScalarType, Endian)>,
    /// Distance between neighbours in mm, for any input; comes before what files state. Where nothing states it, 1x1x1
    #[arg(long, value_name = "XxYxZ", value_parser = spacing, help_heading = PLACE)]
    pub(crate) spacing: Option<[f64; 3]>,
    /// Bytes to skip at the start of every file
    #[arg(long, value_name = "BYTES")]
    pub(crate) skip: Option<u64>,
    /// Patient directions that the axes run to, such as LPS or RAI, for any input; comes before what files state
    #[arg(long, value_name = "LETTERS", value_parser = orientation, help_heading = PLACE)]
    pub(crate) orientation: Option<Orientation>,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("selection").multiple(false))]
pub(crate) struct BatchArgs {
    /// Folders (or files) to search
    #[arg(required = true, value_name = "DIR")]
    pub(crate) input: Vec<PathBuf>,
    /// Folder of the models, thumbnails and reports; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Inside are values of V and more, in physical units (HU for CT)
    #[arg(long, value_name = "V", group = "selection", allow_hyphen_values = true, value_parser = number)]
    pub(crate) iso: Option<f64>,
    /// Inside are values from LO to HI, both included
    #[arg(long, value_name = "LO..HI", group = "selection", allow_hyphen_values = true, value_parser = range)]
    pub(crate) range: Option<[f64; 2]>,
    /// Choose the threshold of each volume by Otsu's method (the default)
    #[arg(long, group = "selection")]
    pub(crate) otsu: bool,
    /// Peak resident memory of the whole process, shared by the jobs
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    /// Volumes worked on at a time; as many as cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) jobs: Option<usize>,
    /// Worker threads in all; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Longest side of the thumbnails in pixels; 0 for none
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = side_or_none)]
    pub(crate) thumbnails: u32,
    /// Attributes per skin voxel: normal, value, or none
    #[arg(long, value_name = "LIST", default_value = "normal", value_parser = channels)]
    pub(crate) channels: ChannelChoice,
    /// Connectivity of the skin: 26 (thin) or 6 (thick)
    #[arg(long, default_value = "26", value_parser = connectivity)]
    pub(crate) connectivity: u8,
    /// Folder for scratch files; the output folder by default
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    /// Leave patient names in reported paths; they are masked by default
    #[arg(long)]
    pub(crate) keep_names: bool,
    /// Where slices are missing or uneven: refuse, make them from their neighbours, or take them as even
    #[arg(long, value_enum, default_value_t = Gaps::Error)]
    pub(crate) gaps: Gaps,
    /// Leave volumes of fewer slices alone, such as scouts and scanned documents; they are listed as skipped
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(crate) min_slices: u32,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress, no lines for volumes
    #[arg(long)]
    pub(crate) quiet: bool,
    #[command(flatten)]
    pub(crate) clean: CleanArgs,
}

#[derive(Debug, Args)]
pub(crate) struct ScanArgs {
    /// Folders (or files) to search
    #[arg(required = true, value_name = "DIR")]
    pub(crate) input: Vec<PathBuf>,
    /// Leave patient names in reported paths; they are masked by default
    #[arg(long)]
    pub(crate) keep_names: bool,
    /// Where slices are missing or uneven: refuse, make them from their neighbours, or take them as even
    #[arg(long, value_enum, default_value_t = Gaps::Error)]
    pub(crate) gaps: Gaps,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// The model
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// The model
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct PackArgs {
    /// The file to read
    #[arg(value_name = "IN.oct")]
    pub(crate) input: PathBuf,
    /// The file to write
    #[arg(short, long, value_name = "OUT.oct")]
    pub(crate) output: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct RenderArgs {
    /// The model
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// The PNG to write
    #[arg(short, long, value_name = "IMAGE.png")]
    pub(crate) output: PathBuf,
    /// Size of the picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub(crate) size: [u32; 2],
    /// Named view
    #[arg(long, value_enum, default_value_t = View::Front, conflicts_with = "eye")]
    pub(crate) view: View,
    /// Position of the eye in mm (LPS)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple, requires = "look_at")]
    pub(crate) eye: Option<[f64; 3]>,
    /// Point in the middle of the picture, in mm (LPS)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple, requires = "eye")]
    pub(crate) look_at: Option<[f64; 3]>,
    /// Direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = triple, requires = "eye")]
    pub(crate) up: Option<[f64; 3]>,
    /// Kind of projection
    #[arg(long, value_enum, default_value_t = Projection::Parallel)]
    pub(crate) projection: Projection,
    /// Vertical field of view in degrees, for the perspective projection
    #[arg(long, value_name = "DEG", default_value_t = RenderRequest::FOV_DEG, value_parser = fov)]
    pub(crate) fov: f64,
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Stop at nodes about as small as a pixel instead of at voxels
    #[arg(long, value_enum, default_value_t = Switch::Off)]
    pub(crate) lod: Switch,
    /// Also write a picture of the distances
    #[arg(long, value_name = "F.png")]
    pub(crate) depth: Option<PathBuf>,
    /// Also write a picture of the normals
    #[arg(long, value_name = "F.png")]
    pub(crate) normals: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ThumbnailArgs {
    /// The model
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// The PNG to write, whatever its name ends in
    #[arg(short, long, value_name = "THUMB.png")]
    pub(crate) output: PathBuf,
    /// Longest side in pixels
    #[arg(long, value_name = "PIXELS", default_value = "256", value_parser = side)]
    pub(crate) size: u32,
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// The model to write
    #[arg(short, long, value_name = "MODEL.oct", default_value = "head.oct")]
    pub(crate) output: PathBuf,
    /// Voxels along a side of the synthetic volume
    #[arg(long, value_name = "N", default_value = "512", value_parser = side)]
    pub(crate) size: u32,
    /// Write the volume itself (16-bit signed, little-endian) to a file, and do nothing else
    #[arg(long, value_name = "FILE")]
    pub(crate) write_raw: Option<PathBuf>,
    /// Inside are values of V and more; 400 (the skull) by default, -400 shows the skin
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = number, default_value = "400")]
    pub(crate) iso: f64,
    /// Picture to write
    #[arg(long, value_name = "IMAGE.png")]
    pub(crate) picture: Option<PathBuf>,
    /// Peak resident memory of the whole process
    #[arg(long, value_name = "SIZE", default_value = "8MiB", value_parser = parse_size)]
    pub(crate) memory: u64,
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    /// No progress, no warnings
    #[arg(long)]
    pub(crate) quiet: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SelfcheckArgs {
    /// The model
    #[arg(value_name = "MODEL.oct")]
    pub(crate) model: PathBuf,
    /// Random rays to compare with the exact reference
    #[arg(long, value_name = "N", default_value = "1000000")]
    pub(crate) rays: u64,
    /// Where the random sequence starts
    #[arg(long, value_name = "N", default_value = "1")]
    pub(crate) seed: u64,
    /// Worker threads; all cores by default
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

/// `on` or `off`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Switch {
    On,
    Off,
}

/// Named views, by patient direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum View {
    Front,
    Back,
    Left,
    Right,
    Top,
    Bottom,
    Iso,
}

/// Kinds of projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Projection {
    Parallel,
    Perspective,
}

/// Channels to store per skin voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ChannelChoice {
    pub(crate) normal: bool,
    pub(crate) value: bool,
}

fn number(text: &str) -> Result<f64, String> {
    text.trim()
        .parse::<f64>()
        .ok()
        .filter(|v| v.is_finite())
        .ok_or_else(|| format!("'{text}' is not a finite number"))
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let (lo, hi) = text
        .split_once("..")
        .ok_or_else(|| format!("'{text}' is not a range; write for example -300..500"))?;
    let (lo, hi) = (number(lo)?, number(hi)?);
    if lo > hi {
        return Err(format!("the range {lo}..{hi} is empty; write the lower value first"));
    }
    Ok([lo, hi])
}

fn threads(text: &str) -> Result<usize, String> {
    text.parse::<usize>()
        .ok()
        .filter(|n| (1..=1024).contains(n))
        .ok_or_else(|| format!("'{text}' is not a number of threads; choose 1 to 1024"))
}

fn connectivity(text: &str) -> Result<u8, String> {
    match text {
        "26" => Ok(26),
        "6" => Ok(6),
        _ => Err(format!("'{text}' is not a connectivity; choose 26 or 6")),
    }
}

fn channels(text: &str) -> Result<ChannelChoice, String> {
    let mut choice = ChannelChoice::default();
    if text == "none" {
        return Ok(choice);
    }
    for name in text.split(',').map(str::trim) {
        match name {
            "normal" => choice.normal = true,
            "value" => choice.value = true,
            "offset" | "color" | "material" => {
                return Err(format!(
                    "the channel '{name}' cannot be built by this version; choose from normal, value"
                ));
            }
            _ => return Err(format!("'{name}' is not a channel; choose from normal, value, or none")),
        }
    }
    Ok(choice)
}

/// Splits `AxBxC` into parts.
fn parts<const K: usize>(text: &str, separator: char) -> Option<[&str; K]> {
    let parts: Vec<&str> = text.split(separator).map(str::trim).collect();
    parts.try_into().ok()
}

fn dims(text: &str) -> Result<Dims, String> {
    let bad = || format!("'{text}' is not a size in voxels; write for example 512x512x300, each 1 to 65536");
    let [x, y, z] = parts::<3>(text, 'x').ok_or_else(bad)?.map(str::parse::<u32>);
    match (x, y, z) {
        (Ok(x), Ok(y), Ok(z)) => Dims::new(x, y, z).ok_or_else(bad),
        _ => Err(bad()),
    }
}

fn dtype(text: &str) -> Result<(ScalarType, Endian), String> {
    ScalarType::parse(text)
        .ok_or_else(|| format!("'{text}' is not a sample type; write for example u16, i16be or f32"))
}

fn spacing(text: &str) -> Result<[f64; 3], String> {
    let bad = || format!("'{text}' is not a spacing in mm; write for example 0.5x0.5x1.25, each above 0");
    let three = parts::<3>(text, 'x').or_else(|| parts::<3>(text, ','));
    let parsed = three.ok_or_else(bad)?.map(|p| number(p).unwrap_or(0.0));
    if parsed.iter().all(|s| *s > 0.0) { Ok(parsed) } else { Err(bad()) }
}

fn orientation(text: &str) -> Result<Orientation, String> {
    Orientation::parse(text).ok_or_else(|| {
        format!(
            "'{text}' is not an orientation; write three letters, one each of L/R, P/A and S/I, such as LPS"
        )
    })
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let bad = || format!("'{text}' is not a picture size; write for example 1024x768, each 1 to 16384");
    let [w, h] = parts::<2>(text, 'x').ok_or_else(bad)?.map(side);
    match (w, h) {
        (Ok(w), Ok(h)) => Ok([w, h]),
        _ => Err(bad()),
    }
}

fn side(text: &str) -> Result<u32, String> {
    text.parse::<u32>()
        .ok()
        .filter(|n| (1..=16384).contains(n))
        .ok_or_else(|| format!("'{text}' is not a size; choose 1 to 16384"))
}

fn side_or_none(text: &str) -> Result<u32, String> {
    if text == "0" { Ok(0) } else { side(text) }
}

fn triple(text: &str) -> Result<[f64; 3], String> {
    let bad = || format!("'{text}' is not a point or direction; write for example 10,-250.5,0");
    let [x, y, z] = parts::<3>(text, ',').ok_or_else(bad)?.map(number);
    match (x, y, z) {
        (Ok(x), Ok(y), Ok(z)) => Ok([x, y, z]),
        _ => Err(bad()),
    }
}

fn fov(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|d| (0.01..=170.0).contains(d))
        .ok_or_else(|| format!("'{text}' is not a field of view; choose 0.01 to 170 degrees"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(extra: &[&str]) -> Result<BuildArgs, clap::Error> {
        let line = ["oct", "build", "in.raw", "-o", "out.oct"].iter().chain(extra);
        match Cli::try_parse_from(line)?.command {
            Command::Build(args) => Ok(args),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn negative_values_and_ranges_are_understood_and_exclude_each_other() {
        assert_eq!(build(&["--iso", "-300"]).unwrap().iso, Some(-300.0));
        assert_eq!(build(&["--iso=-300"]).unwrap().iso, Some(-300.0));
        assert_eq!(build(&["--range", "-300..500"]).unwrap().range, Some([-300.0, 500.0]));
        assert_eq!(build(&["--range", "-3.5..-1"]).unwrap().range, Some([-3.5, -1.0]));
        assert_eq!(build(&[]).unwrap().memory, 64 << 20);
        for bad in [
            vec!["--iso", "1", "--otsu"],
            vec!["--iso", "1", "--range", "1..2"],
            vec!["--iso", "nan"],
            vec!["--range", "5..1"],
            vec!["--range", "5"],
            vec!["--threads", "0"],
            vec!["--channels", "offset"],
            vec!["--channels", "smell"],
            vec!["--connectivity", "18"],
            vec!["--dims", "4x4"],
            vec!["--dims", "0x4x4"],
            vec!["--spacing", "1x1x0"],
            vec!["--orientation", "LRS"],
            vec!["--dtype", "u12"],
            vec!["--memory", "lots"],
        ] {
            assert_eq!(build(&bad).unwrap_err().exit_code(), 2, "{bad:?}");
        }
    }

    #[test]
    fn raw_options_parse() {
        let raw = build(&[
            "--dims",
            "3x4x5",
            "--dtype",
            "i16be",
            "--spacing",
            "0.5x0.5x1.25",
            "--orientation",
            "rai",
        ])
        .unwrap()
        .raw;
        assert_eq!(raw.dims.unwrap().to_array(), [3, 4, 5]);
        assert_eq!(raw.dtype, Some((ScalarType::I16, Endian::Big)));
        assert_eq!(raw.spacing, Some([0.5, 0.5, 1.25]));
        assert_eq!(raw.orientation.unwrap().to_string(), "RAI");
        assert_eq!(build(&["--spacing", "0.5,0.5,1.25"]).unwrap().raw.spacing, raw.spacing);
    }

    #[test]
    fn an_eye_needs_something_to_look_at() {
        let render = |extra: &[&str]| {
            Cli::try_parse_from(["oct", "render", "a.oct", "-o", "a.png"].iter().chain(extra))
        };
        assert!(render(&["--eye", "-1,-2,3.5", "--look-at", "0,0,0", "--up", "0,0,1"]).is_ok());
        assert!(render(&["--eye", "1,2,3"]).is_err());
        assert!(render(&["--look-at", "1,2,3"]).is_err());
        assert!(render(&["--view", "front", "--eye", "1,2,3", "--look-at", "0,0,0"]).is_err());
    }
}
