//! Zarr arrays of versions 2 and 3, with shards, and images of OME-Zarr 0.4 and 0.5, in a local folder.
//!
//! | file | what it holds |
//! |---|---|
//! | `array` | the metadata of an array: shape, chunks, storage of samples and chunks |
//! | `image` | the levels, axes, units and scales of OME-Zarr |
//! | `packing`, `blosc` | chunks unpacked in pieces |
//! | `volume` | rows read from chunks, which are unpacked when they are first asked for |
//!
//! The last three axes are z, y and x. Each combination of the axes before them (time, channel) is a volume of its own,
//! and the caller may choose one by its places on them.
//! An image gives its finest level; another one is chosen by the path of its folder, and finds its scale in the folder
//! above. Sources: Zarr specifications 2 and 3.1, OME-NGFF 0.4 and 0.5, the format of C-Blosc 1.

mod array;
mod blosc;
mod image;
mod packing;
mod volume;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value;

use super::OpenOptions;
use super::files::base_name;
use super::header::{unreadable, unusable};
use crate::fault::{Fault, bad, usage};
use crate::geom::{Affine, Dims};
use crate::text::mark_bytes;
use crate::text::names::{FOLLOW_LINKS, INDEX};
use crate::volume::{Note, Rescale, Result, SourceDescription, SourceError, VolumeInfo, VolumeSource};
use array::Array;
use image::Image;
use volume::ZarrVolume;

/// Longest metadata: an image lists its channels there, and some programs their history.
const MAX_METADATA: u64 = 4 << 20;

/// Most volumes of one array that are offered.
const MAX_VOLUMES: u64 = 1 << 10;

/// Files that describe an array or an image; the first that exists counts.
const HEADS: [&str; 3] = ["zarr.json", ".zarray", ".zattrs"];

/// Result whose error refuses metadata, before the file is named.
type Read<T> = std::result::Result<T, Fault>;

/// True for the metadata of an array or an image; false for a group's, whose folder is searched like any other.
pub(super) fn recognise(head: &[u8], path: &Path) -> bool {
    let named = path.file_name().is_some_and(|name| HEADS.iter().any(|head| name == *head));
    let is_text = head.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{');
    // Metadata that cannot be read is refused by name.
    let found = || metadata(path).unwrap_or_default();
    named && is_text && found().is_none_or(|what| is_volume(path, &what))
}

/// The metadata that makes a folder an array or an image.
pub(crate) fn head_of(folder: &Path) -> Option<PathBuf> {
    let head = |name| Some(folder.join(name)).filter(|path| path.is_file());
    let found = HEADS.iter().find_map(head)?;
    recognise(b"{", &found).then_some(found)
}

/// True for the metadata of a group, which says nothing about voxels.
pub(crate) fn is_of_group(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == "zarr.json")
        && metadata(path).is_ok_and(|found| found.is_some_and(|what| what.get("node_type").is_some()))
}

/// The content of a file of metadata; `None` if it is not JSON.
fn metadata(path: &Path) -> Result<Option<Value>> {
    let failed = |cause| unreadable(path, cause);
    let bytes = fs::metadata(path).map_err(failed)?.len();
    if bytes > MAX_METADATA {
        return Err(unusable(path, bad!("has {bytes} bytes of metadata; up to {MAX_METADATA} are read")));
    }
    let text = fs::read(path).map_err(failed)?;
    let mark = mark_bytes(&text).map_err(|wide| unusable(path, bad!("{wide}")))?;
    Ok(serde_json::from_slice(text.get(mark..).unwrap_or_default()).ok())
}

/// True if metadata describes voxels.
fn is_volume(path: &Path, what: &Value) -> bool {
    let name = path.file_name().unwrap_or_default();
    let is_array = name == ".zarray" || what.get("node_type").is_some_and(|kind| kind == "array");
    is_array || Image::is_there(what)
}

/// Opens an array, or the finest level of an image: one volume for each time and channel.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let refused = |fault| unusable(path, fault);
    let folder = path.parent().unwrap_or(Path::new(""));
    let what = metadata(path)?.ok_or_else(|| {
        refused(bad!(
            "is not the metadata of a Zarr array or of an image in OME-Zarr: it cannot be parsed as JSON"
        ))
    })?;
    let (image, array_folder, name) = if Image::is_there(&what) {
        let (image, level) = Image::read(&what, None).map_err(refused)?;
        let inside = folder.join(&level);
        if !options.follow_links && !super::stays(path, &inside) {
            return Err(refused(bad!(
                "its data file `{}` is a link that leads out of the folder of the header; put the data there, or add {FOLLOW_LINKS}",
                level.escape_debug()
            )));
        }
        (Some(image), inside, base_name(folder))
    } else {
        (of_level(folder)?, folder.to_path_buf(), base_name(folder))
    };
    let head = HEADS[..2].iter().map(|name| array_folder.join(name)).find(|path| path.is_file());
    let head = head.unwrap_or_else(|| array_folder.join(HEADS[0]));
    let what = if head == path { Some(what) } else { metadata(&head)? };
    let what = what.ok_or_else(|| {
        unusable(
            &head,
            bad!(
                "is not the metadata of a Zarr array or of an image in OME-Zarr: it cannot be parsed as JSON"
            ),
        )
    })?;
    let array = Array::read(&array_folder, &what).map_err(|fault| unusable(&head, fault))?;
    let mut numbers = 0..array.leading_count().min(MAX_VOLUMES);
    if !options.index.is_empty() {
        let axes = leading_axes(&array, image.as_ref(), &what, &array_folder);
        let number =
            chosen(&axes, &options.index).ok_or_else(|| SourceError::from(unchosen(&axes).at(path)))?;
        numbers = number..number + 1;
    }
    volumes(array, image, name, (&head, numbers))
}

/// The refusal of a choice on the axes before z, which have these names and lengths.
pub(crate) fn unchosen(axes: &[(String, u64)]) -> Fault {
    if axes.is_empty() {
        return usage!("has no axes before z, y and x, on which {INDEX} could choose; leave it out");
    }
    let axes: Vec<String> =
        axes.iter().map(|(name, length)| format!(" {} (of {length})", name.escape_debug())).collect();
    usage!(
        "{INDEX} has to say one place, from 0 on, on each axis before z, y and x that is longer than 1:{}",
        axes.join(",")
    )
}

/// Names and lengths of the axes before z, as the image or the array names them, or by their numbers.
fn leading_axes(array: &Array, image: Option<&Image>, what: &Value, folder: &Path) -> Vec<(String, u64)> {
    // Version 2 names axes as xarray does, in a file of attributes.
    let beside = || metadata(&folder.join(HEADS[2])).ok()?;
    let named = |key: &str, of: Option<Value>| of?.get(key).and_then(Value::as_array).cloned();
    let named = named("dimension_names", Some(what.clone())).or_else(|| named("_ARRAY_DIMENSIONS", beside()));
    let name = |axis: usize| match image {
        Some(image) => image.axis(axis).map(str::to_owned),
        None => named.as_ref()?.get(axis)?.as_str().map(str::to_owned),
    };
    let sides = array.leading_sides().enumerate();
    sides.map(|(axis, side)| (name(axis).unwrap_or_else(|| axis.to_string()), side)).collect()
}

/// The number of the volume at some places on the axes before z; an axis of length 1 need not be named.
fn chosen(axes: &[(String, u64)], index: &[(String, u64)]) -> Option<u64> {
    let place = |(name, length): &(String, u64)| {
        let mut places = index.iter().filter(|(axis, _)| axis == name).map(|(_, place)| *place);
        match (places.next(), places.next()) {
            (None, _) => (*length == 1).then_some(0),
            (Some(place), None) => (place < *length).then_some(place),
            _ => None,
        }
    };
    let are_known = index.iter().all(|(name, _)| axes.iter().any(|(axis, _)| axis == name));
    let join = |number: u64, axis: &(String, u64)| number.checked_mul(axis.1)?.checked_add(place(axis)?);
    axes.iter().try_fold(0, join).filter(|_| are_known && !axes.is_empty())
}

/// Statements of an image in the folder above about this level, if it is one of its levels.
fn of_level(folder: &Path) -> Result<Option<Image>> {
    let (Some(above), Some(level)) = (folder.parent(), folder.file_name().and_then(|name| name.to_str()))
    else {
        return Ok(None);
    };
    let heads = [HEADS[0], HEADS[2]].map(|name| above.join(name));
    let Some(head) = heads.iter().find(|path| path.is_file()) else { return Ok(None) };
    match metadata(head)? {
        Some(what) if Image::has_level(&what, level) => {
            let read = Image::read(&what, Some(level));
            read.map(|(image, _)| Some(image)).map_err(|fault| unusable(head, fault))
        }
        Some(_) => Ok(None),
        None => Err(unusable(
            head,
            bad!(
                "lies above a Zarr array, whose spacing it may state, and cannot be parsed as JSON; repair or remove it"
            ),
        )),
    }
}

/// The volumes of these numbers.
fn volumes(
    array: Array,
    image: Option<Image>,
    name: String,
    (head, numbers): (&Path, Range<u64>),
) -> Result<Vec<Box<dyn VolumeSource>>> {
    let refused = |fault: Fault| unusable(head, fault);
    let side = |side: u64| u32::try_from(side).unwrap_or(u32::MAX);
    let [nz, ny, nx] = array.size.map(side);
    let dims = Dims::new(nx, ny, nz)
        .ok_or_else(|| refused(bad!("has a side of 0 voxels, or of more than {}", Dims::MAX_SIDE)))?;
    let mut notes = Vec::new();
    let mut affine = Affine::from_spacing([1.0; 3]);
    let mut spacing_mm = [1.0; 3];
    match image.as_ref().map(|image| image.placed(array.axes(), &mut notes)).transpose().map_err(refused)? {
        Some((spacing, origin)) => {
            spacing_mm = spacing;
            affine = Affine::from_spacing(spacing);
            (0..3).for_each(|axis| affine.rows[axis][3] = origin[axis]);
        }
        None => notes.push(Note::no_spacing("a Zarr array")),
    }
    notes.push(Note::no_directions("a Zarr array"));
    if let Some(name) = array.lost(numbers.clone()) {
        return Err(refused(bad!(
            "none of its chunks is there under its name, the first of which is `{}`; were they copied, and does the metadata state how they are named?",
            name.escape_debug()
        )));
    }
    notes.extend(array.samples.note());
    let scalar = array.samples.delivered();
    let array = Arc::new(array);
    let volume = |number: u64| -> Box<dyn VolumeSource> {
        let info = VolumeInfo {
            dims,
            scalar,
            rescale: Rescale::IDENTITY,
            spacing_mm,
            affine,
            description: SourceDescription {
                format: "zarr".into(),
                name: name.clone(),
                files: array.file_count(),
                bytes: dims.voxels() * array.samples.bytes() as u64,
                ..SourceDescription::default()
            },
            notes: notes.clone(),
        };
        Box::new(ZarrVolume::new(Arc::clone(&array), number, info))
    };
    Ok(numbers.map(volume).collect())
}
