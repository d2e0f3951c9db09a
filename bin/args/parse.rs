//! Values of options, and the sentences for wrong ones.

use std::fmt::Display;
use std::ops::Range;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use infobyte::builder::{Connectivity, Gradient};
use infobyte::clean::{ComponentConnectivity, MAX_LARGEST, Preset};
use infobyte::format::{Channel, Channels, SurfaceKind};
use infobyte::geom::{Affine, Dims};
use infobyte::jobs::export::MAX_SMOOTH;
use infobyte::render::Projection;
use infobyte::scene::{LabelRule, Section};
use infobyte::text;
use infobyte::volume::{Endian, ScalarType};

pub(super) fn number(text: &str) -> Result<f64, String> {
    text.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
        format!(
            "'{text}' is not a finite number{}",
            if text.contains(',') { "; write decimals with a point" } else { "" }
        )
    })
}

pub(super) fn range(text: &str) -> Result<[f64; 2], String> {
    let (lo, hi) = text
        .split_once("..")
        .ok_or_else(|| format!("'{text}' is not a range; write for example -300..500"))?;
    let (lo, hi) = (number(lo)?, number(hi)?);
    if lo > hi {
        return Err(format!("the range {lo}..{hi} is empty; write the lower value first"));
    }
    Ok([lo, hi])
}

/// A whole number from 1 to `most`.
fn count<T: Copy + Display + From<u8> + FromStr + PartialOrd>(
    text: &str,
    what: &str,
    most: T,
) -> Result<T, String> {
    let number = text.parse().ok().filter(|number| (T::from(1)..=most).contains(number));
    number.ok_or_else(|| format!("'{text}' is not a {what}; choose 1 to {most}"))
}

pub(super) fn threads(text: &str) -> Result<usize, String> {
    count(text, "number of threads", 1024)
}

pub(super) fn jobs(text: &str) -> Result<usize, String> {
    count(text, "number of jobs", 1024)
}

pub(super) fn volume_number(text: &str) -> Result<usize, String> {
    let number = text.parse::<usize>().ok().filter(|n| *n > 0);
    number.ok_or_else(|| format!("'{text}' is not the number of a volume; they are counted from 1"))
}

/// Parses `t=12`.
pub(super) fn place_on_axis(text: &str) -> Result<(String, u64), String> {
    let parsed =
        text.split_once('=').and_then(|(axis, place)| Some((axis.trim(), place.trim().parse().ok()?)));
    let found = parsed.filter(|(axis, _)| !axis.is_empty()).map(|(axis, place)| (axis.to_owned(), place));
    found.ok_or_else(|| format!("'{text}' is not a place on an axis; write for example t=12,c=0"))
}

/// Parses `26` or `6`, which stand for these two.
fn either<T>(text: &str, of_26: T, of_6: T) -> Result<T, String> {
    match text {
        "26" => Ok(of_26),
        "6" => Ok(of_6),
        _ => Err(format!("'{text}' is not a connectivity; choose 26 or 6")),
    }
}

pub(super) fn connectivity(text: &str) -> Result<Connectivity, String> {
    either(text, Connectivity::Thin26, Connectivity::Thick6)
}

pub(super) fn component_connectivity(text: &str) -> Result<ComponentConnectivity, String> {
    either(text, ComponentConnectivity::Corners26, ComponentConnectivity::Faces6)
}

pub(super) fn gradient(text: &str) -> Result<Gradient, String> {
    Gradient::by_name(text).ok_or_else(|| {
        let names = Gradient::ALL.map(Gradient::name).join(", ");
        format!("'{text}' is not an estimator of normals; choose one of {names}")
    })
}

pub(super) fn surface(text: &str) -> Result<SurfaceKind, String> {
    [SurfaceKind::Skin, SurfaceKind::Cells]
        .into_iter()
        .find(|surface| surface.name() == text)
        .ok_or_else(|| format!("'{text}' is not a surface; choose skin or cells"))
}

/// Channels that this version can build of a volume.
const BUILT: Channels = Channels::NONE
    .with(Channel::Normal)
    .with(Channel::Value)
    .with(Channel::Offset)
    .with(Channel::Color)
    .with(Channel::Material);

/// Channels separated by commas, or `none`.
fn channel_list(text: &str, channel: impl Fn(&str) -> Result<Channel, String>) -> Result<Channels, String> {
    if text == "none" {
        return Ok(Channels::NONE);
    }
    text.split(',').map(str::trim).map(channel).collect()
}

pub(super) fn channels(text: &str) -> Result<Channels, String> {
    let choices = || BUILT.iter().map(Channel::name).collect::<Vec<_>>().join(", ");
    channel_list(text, |name| match Channel::by_name(name) {
        Some(channel) if BUILT.contains(channel) => Ok(channel),
        Some(_) => {
            Err(format!("the channel '{name}' cannot be built by this version; choose from {}", choices()))
        }
        None => Err(format!("'{name}' is not a channel; choose from {}, or none", choices())),
    })
}

/// Channels of a model.
pub(super) fn kept_channels(text: &str) -> Result<Channels, String> {
    channel_list(text, |name| {
        Channel::by_name(name).ok_or_else(|| {
            let names = Channel::all().map(Channel::name).collect::<Vec<_>>().join(", ");
            format!("'{name}' is not a channel; choose from {names}, or none")
        })
    })
}

/// A box of voxels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Roi(pub(super) [Range<u32>; 3]);

pub(super) fn roi(text: &str) -> Result<Roi, String> {
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

pub(super) fn downsample(text: &str) -> Result<u32, String> {
    match text {
        "2" => Ok(2),
        "4" => Ok(4),
        _ => Err(format!("'{text}' is not a factor; choose 2 or 4")),
    }
}

pub(super) fn closing(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        _ => Err(format!("'{text}' is not a radius; choose 1 or 2 voxels")),
    }
}

pub(super) fn preset(text: &str) -> Result<Preset, String> {
    Preset::parse(text).ok_or_else(|| {
        let names = Preset::ALL.map(Preset::name).join(", ");
        format!("'{text}' is not a preset; choose one of {names}")
    })
}

pub(super) fn keep_largest(text: &str) -> Result<u32, String> {
    count(text, "number of components", MAX_LARGEST)
}

/// Splits `AxBxC` into parts.
fn parts<const K: usize>(text: &str, separator: char) -> Option<[&str; K]> {
    let parts: Vec<&str> = text.split(separator).map(str::trim).collect();
    parts.try_into().ok()
}

pub(super) fn dims(text: &str) -> Result<Dims, String> {
    let bad = || format!("'{text}' is not a size in voxels; write for example 512x512x300, each 1 to 65536");
    let [x, y, z] = parts(text, 'x').ok_or_else(bad)?.map(|side| side.parse().unwrap_or(0));
    Dims::new(x, y, z).ok_or_else(bad)
}

pub(super) fn dtype(text: &str) -> Result<(ScalarType, Endian), String> {
    ScalarType::parse(text)
        .ok_or_else(|| format!("'{text}' is not a sample type; write for example u16, i16be or f32"))
}

pub(super) fn spacing(text: &str) -> Result<[f64; 3], String> {
    let bad = || {
        format!(
            "'{text}' is not a spacing in mm; write for example 0.5x0.5x1.25, each above 0 and none a billion times another"
        )
    };
    let three = parts::<3>(text, 'x').or_else(|| parts::<3>(text, ','));
    let parsed = three.ok_or_else(bad)?.map(|p| number(p).unwrap_or(0.0));
    let sound = parsed.iter().all(|s| *s > 0.0) && Affine::from_spacing(parsed).inverse().is_some();
    if sound { Ok(parsed) } else { Err(bad()) }
}

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let bad = || {
        format!(
            "'{text}' is not a picture size; write for example 1024x768, or 512 for a square, each 1 to 32768"
        )
    };
    let side = |text: &str| text.parse::<u32>().ok().filter(|n| (1..=32_768).contains(n));
    let [width, height] = parts::<2>(text, 'x').unwrap_or([text; 2]).map(side);
    width.zip(height).map(<[u32; 2]>::from).ok_or_else(bad)
}

/// Bytes at the start of a file.
pub(super) fn skip(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("'{text}' is not a number of bytes; write 0 or more"))
}

/// Voxels around a mesh.
pub(super) fn margin(text: &str) -> Result<u16, String> {
    text.parse().map_err(|_| format!("'{text}' is not a margin; write 0 to {} voxels", u16::MAX))
}

pub(super) fn side(text: &str) -> Result<u32, String> {
    count(text, "size", 16384)
}

pub(super) fn side_or_none(text: &str) -> Result<u32, String> {
    if text == "0" { Ok(0) } else { side(text) }
}

pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    let bad = || format!("'{text}' is not a point or direction; write for example 10,-250.5,0");
    match parts(text, ',').ok_or_else(bad)?.map(number) {
        [Ok(x), Ok(y), Ok(z)] => Ok([x, y, z]),
        _ => Err(bad()),
    }
}

/// Least and greatest deviation: a length stands for both.
pub(super) fn tolerance(text: &str) -> Result<[f64; 2], String> {
    match number(text) {
        Ok(most) if most >= 0.0 => Ok([-most, most]),
        Ok(_) => Err(format!("'{text}' is below 0; write a length, or for example -0.2..0.1")),
        Err(_) => range(text),
    }
}

/// A length above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let length = number(text).ok().filter(|length| *length > 0.0);
    length.ok_or_else(|| "write a length above 0".into())
}

/// A length of 0 or more.
pub(super) fn clearance(text: &str) -> Result<f64, String> {
    let length = number(text).ok().filter(|length| *length >= 0.0);
    length.ok_or_else(|| "write a length in mm, of 0 or more".into())
}

/// Voxels along the longest side of a mesh.
pub(super) fn grid_side(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(side @ 1..=16384) => Ok(side),
        _ => Err("write a number of voxels from 1 to 16384".into()),
    }
}

/// Millimetres of a unit.
pub(super) fn unit_mm(text: &str) -> Result<f64, String> {
    match text {
        "um" => Ok(0.001),
        "mm" => Ok(1.0),
        "cm" => Ok(10.0),
        "m" => Ok(1000.0),
        "in" => Ok(25.4),
        _ => Err("write um, mm, cm, m or in".into()),
    }
}

pub(super) fn fov(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|d| (0.01..=170.0).contains(d))
        .ok_or_else(|| format!("'{text}' is not a field of view; choose 0.01 to 170 degrees"))
}

/// Magnification of a picture.
pub(super) fn zoom(text: &str) -> Result<f64, String> {
    number(text)
        .ok()
        .filter(|factor| (0.01..=1000.0).contains(factor))
        .ok_or_else(|| format!("'{text}' is not a magnification; choose 0.01 to 1000"))
}

/// A colour in sRGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rgb(pub(super) [u8; 3]);

pub(super) fn color(text: &str) -> Result<Rgb, String> {
    text::color(text).map(Rgb)
}

/// Some labels, and how much of the light they stop.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picks(pub(super) Vec<LabelRule>);

pub(super) fn label_picks(text: &str) -> Result<Picks, String> {
    let one = |part: &str| Ok(LabelRule { labels: part.parse()?, opacity: 1.0 });
    text.split(',').map(one).collect::<Result<_, _>>().map(Picks)
}

pub(super) fn opacity(text: &str) -> Result<Picks, String> {
    let bad =
        || format!("'{text}' is not an opacity; write labels and a part from 0 to 1, for example skin=0.2");
    let (labels, part) = text.rsplit_once('=').ok_or_else(bad)?;
    let opacity = number(part).ok().filter(|part| (0.0..=1.0).contains(part)).ok_or_else(bad)?;
    let picks = label_picks(labels)?.0.into_iter().map(|rule| LabelRule { opacity, ..rule });
    Ok(Picks(picks.collect()))
}

/// Low and high bounds along each axis in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds(pub(super) [[f64; 2]; 3]);

pub(super) fn bounds(text: &str) -> Result<Bounds, String> {
    let bad = || format!("'{text}' are not bounds; write for example z=..40 or x=-20..20,y=0..");
    let mut bounds = [[f64::NEG_INFINITY, f64::INFINITY]; 3];
    for part in text.split(',') {
        let (axis, limits) = part.split_once('=').ok_or_else(bad)?;
        let axis = ["x", "y", "z"].iter().position(|name| *name == axis.trim()).ok_or_else(bad)?;
        let (low, high) = limits.split_once("..").ok_or_else(bad)?;
        let limit = |text: &str, open: f64| if text.trim().is_empty() { Ok(open) } else { number(text) };
        let [low, high] = [limit(low, f64::NEG_INFINITY)?, limit(high, f64::INFINITY)?];
        if low >= high || bounds[axis] != [f64::NEG_INFINITY, f64::INFINITY] {
            return Err(bad());
        }
        bounds[axis] = [low, high];
    }
    Ok(Bounds(bounds))
}

/// Such as z=40.
pub(super) fn section(text: &str) -> Result<Section, String> {
    let (name, at) = text.split_once('=').unwrap_or((text, ""));
    let axis = ["x", "y", "z"].iter().position(|axis| *axis == name.trim());
    match (axis, number(at)) {
        (Some(axis), Ok(at_mm)) => Ok(Section { axis, at_mm }),
        _ => Err(format!("'{text}' is not a plane; write for example z=40, in mm")),
    }
}

/// One of these, by its name.
pub(super) fn one_of<T: Copy + Send + Sync>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|one| name(*one)))
        .try_map(move |given| all.iter().copied().find(|one| name(*one) == given).ok_or("no such name"))
}

/// A choice that is read by its name.
pub(super) fn choice<T, const N: usize>(names: [&'static str; N]) -> impl TypedValueParser<Value = T>
where
    T: serde::de::DeserializeOwned + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value::<T>(name.into()))
}

pub(super) fn projections() -> impl TypedValueParser<Value = Projection> {
    PossibleValuesParser::new(["parallel", "perspective"]).try_map(|name| name.parse())
}

/// Three rows of four numbers.
pub(super) fn placement(text: &str) -> Result<Affine, String> {
    let numbers: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>().unwrap_or_default();
    match numbers.as_chunks::<4>() {
        (&[x, y, z], []) => Ok(Affine { rows: [x, y, z] }),
        _ => Err(format!("'{text}' is not three rows of four numbers, with commas between all of them")),
    }
}

/// How far walls may be moved, in voxels.
pub(super) fn smooth(text: &str) -> Result<f64, String> {
    let voxels = text.parse().ok().filter(|voxels| (0.0..=MAX_SMOOTH).contains(voxels));
    voxels.ok_or_else(|| format!("'{text}' is not a distance from 0 to {MAX_SMOOTH} voxel"))
}

/// A number of triangles.
pub(super) fn triangles(text: &str) -> Result<u64, String> {
    let count = text.parse().ok().filter(|count| *count > 0);
    count.ok_or_else(|| {
        format!("'{text}' is not a number of triangles; give 1 or more in digits, such as 50000")
    })
}
