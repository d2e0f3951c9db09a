//! Recognition of images among other files, and loading of the images of one series.
//!
//! Memory: one header at a time, some 250 bytes per image, the names once.

use std::io;
use std::path::{Path, PathBuf};

use super::group::{Key, Kind, NO_OBSTACLE, Series, Shared, Slice};
use super::mosaic::{MosaicLayout, is_one, look};
use crate::budget::costs;
use crate::platform::PositionalFile;
use crate::source::dicom::image::describe::{Access, Image, Obstacle, Storage};
use crate::source::dicom::image::encapsulated::{MissingEnd, missing_end};
use crate::source::dicom::image::pixels::PaddingAttributes;
use crate::source::dicom::parse::error::ScanError;
use crate::source::dicom::parse::frames::{FrameGeometry, Origin, visit};
use crate::source::dicom::parse::header::DicomHeader;
use crate::source::dicom::parse::scan::scan;
use crate::source::dicom::parse::segments::segments;
use crate::source::files::FileList;
use crate::source::stable_hash::StableHash;
use crate::volume::Note;

/// [`costs::OPENING_FRAME`] of a tiled (mosaic) image, whose tables hold every tile.
const OPENING_MOSAIC: u64 = 2600;

/// Kind of a file in terms of DICOM.
pub(crate) enum Recognition {
    /// An image, of the series with this UID (empty if it names none).
    Image {
        /// Series Instance UID.
        series: String,
        /// Number of its frames.
        frames: u32,
        /// Approximate memory that is taken for a moment when the series is opened.
        opening_bytes: u64,
    },
    /// A report, a plan, a directory, ...
    NoImage(Obstacle),
    /// A file that begins as DICOM, but is damaged.
    Damaged(ScanError),
    /// The system refused.
    Unreadable(io::Error),
    /// Something else.
    Foreign,
}

/// Looks at the header of a file.
pub(crate) fn recognise(file: &PositionalFile) -> Recognition {
    match scan(file) {
        // An image that ends before its pixels is still an image; it is refused when it is opened.
        Ok(header) if header.pixels.is_some() || (header.rows.is_some() && header.columns.is_some()) => {
            // No more than lie in the file.
            let frames = Image::of(&header).map_or(1, |image| image.frames);
            let each = if is_one(&header) { OPENING_MOSAIC } else { costs::OPENING_FRAME };
            Recognition::Image { series: header.series_uid, frames, opening_bytes: u64::from(frames) * each }
        }
        Ok(header) => Recognition::NoImage(Obstacle::new(format!("{} without pixels", header.kind()))),
        Err(ScanError::Io(fault)) => Recognition::Unreadable(fault.into()),
        Err(ScanError::NotDicom) => Recognition::Foreign,
        Err(error @ ScanError::Damaged { .. }) => Recognition::Damaged(error),
    }
}

/// Reads the headers of the files of one series; `facts` are size and time of change of each.
pub(crate) fn load(files: FileList, facts: &[(u64, u64)]) -> Series {
    let mut series = Series::new(files, facts.to_vec());
    for file in 0..series.files.len() {
        let path = series.files.path(file);
        let opened = PositionalFile::open(&path).map_err(ScanError::from);
        let scanned = opened.and_then(|f| scan(&f).map(|header| (f, header)));
        match scanned {
            Ok((input, header)) => add_file(&mut series, file, &input, &header),
            Err(error) => series.lost(path, error),
        }
    }
    series.finish();
    series
}

/// Reason why a frame cannot be placed, scaled or told apart.
fn illegible(header: &DicomHeader, frame: &FrameGeometry) -> Option<Obstacle> {
    let unmapped = |(slope, intercept): (f64, f64)| !(slope.is_finite() && intercept.is_finite());
    let wrong = frame.wrong.as_ref().map(|wrong| Obstacle::new(wrong.to_string()));
    wrong.or_else(|| {
        frame.mapping.filter(|mapping| header.is_parametric_map() && unmapped(*mapping)).map(|_| {
            Obstacle::new("its Real World Value Slope (0040,9225) or Intercept (0040,9224) is infinite or not a number; correct the header")
        })
    })
}

/// Adds every frame of a file.
fn add_file(series: &mut Series, file: usize, input: &PositionalFile, header: &DicomHeader) {
    let image = Image::of(header);
    let frames = image.as_ref().map_or(1, |image| image.frames);
    let mut obstacle = image.as_ref().err().cloned();
    if header.is_segmentation() {
        match segments(input, header) {
            Ok(found) => series.add_segments(found),
            Err(error) => {
                let fault = Obstacle::new(format!("its segments (0062,0002) cannot be read: {error}"));
                obstacle = obstacle.or(Some(fault));
            }
        }
    }
    if header.is_tiled() {
        obstacle = obstacle.or(Some(Obstacle::new("its frames are tiles of a larger picture (a whole slide, or what was found on one), not slices, so they form no volume")));
    }
    let mut mosaic = None;
    if is_one(header) {
        match look(input, header) {
            Ok(found) => mosaic = Some(found),
            Err(fault) => obstacle = obstacle.or(Some(fault)),
        }
    }
    let plain =
        frames == 1 && header.offsets.frame_groups.is_none() && header.offsets.shared_groups.is_none();
    if plain {
        obstacle = obstacle.or(illegible(header, &FrameGeometry::of_file(header)));
    }
    let image = image.ok().filter(|_| obstacle.is_none());
    let note = image.as_ref().and_then(|image| end_note(input, header, image));
    if plain || image.is_none() {
        let mut own = FrameGeometry::of_file(header);
        if let Some(mosaic) = &mosaic {
            own = mosaic.first_slice(own);
        }
        let shared =
            add_frame(series, file, header, image.as_ref(), mosaic.as_ref(), &own, obstacle.as_ref());
        shared.note(note);
        for note in mosaic.iter().flat_map(|mosaic| &mosaic.notes) {
            shared.note(Some(note.clone()));
        }
        return;
    }
    if let Ok(true) = is_planar(input, header) {
        let fault = Obstacle::new(
            "its frames are views, detectors, energy windows or points in time, not slices (there is no Slice Vector (0054,0080)), so they form no volume",
        );
        add_frame(series, file, header, None, None, &FrameGeometry::of_file(header), Some(&fault));
        return;
    }
    let mut seen = 0;
    let visited = visit(input, header, &mut |frame| {
        let fault = illegible(header, frame);
        let image = image.as_ref().filter(|_| fault.is_none());
        add_frame(series, file, header, image, None, frame, fault.as_ref()).note(note.clone());
        seen += 1;
        seen < frames
    });
    if let Err(error) = visited {
        let fault = Obstacle::new(format!("its frames cannot be distinguished: {error}"));
        // Frames before the damage are no volume without the rest.
        let number = u32::try_from(file).unwrap_or(u32::MAX);
        series.wrong.get_or_insert_with(|| (number, fault.to_string()));
        add_frame(series, file, header, None, None, &FrameGeometry::of_file(header), Some(&fault));
    }
}

/// True if the frames of nuclear medicine differ in anything but their slice, which none of them states.
fn is_planar(input: &PositionalFile, header: &DicomHeader) -> Result<bool, ScanError> {
    let places = &header.offsets;
    if places.slice_vector.is_some() || places.frame_vectors.iter().all(Option::is_none) {
        return Ok(false);
    }
    let (mut first, mut differ) = (None, false);
    visit(input, header, &mut |frame| {
        differ = *first.get_or_insert(frame.vectors) != frame.vectors;
        !differ
    })?;
    Ok(differ)
}

/// Note on a missing end of compressed pixels. A file that cannot be read says so when it is decoded.
fn end_note(input: &PositionalFile, header: &DicomHeader, image: &Image) -> Option<Note> {
    let Storage::Coded(codec) = image.storage else { return None };
    let MissingEnd { fragments, lacking } = missing_end(input, &header.pixels?, codec).ok().flatten()?;
    let lost = match lacking {
        0 if image.frames > 1 && fragments >= image.frames.into() => {
            format!(" All {} frames were found", image.frames)
        }
        0 => String::new(),
        bytes => format!(" The last fragment lacks {bytes} bytes"),
    };
    Some(Note::new(format!("the end of the pixel data is missing; was the file cut short?{lost}")))
}

/// Adds a frame; returns the attributes that its group shares.
fn add_frame<'s>(
    series: &'s mut Series,
    file: usize,
    header: &DicomHeader,
    image: Option<&Image>,
    mosaic: Option<&MosaicLayout>,
    frame: &FrameGeometry,
    obstacle: Option<&Obstacle>,
) -> &'s mut Shared {
    let file = u32::try_from(file).unwrap_or(u32::MAX);
    if let Some(wrong) = &frame.wrong {
        series.wrong.get_or_insert_with(|| (file, wrong.to_string()));
    }
    let rescale = if header.is_dose() {
        header.dose_scaling.map(|scaling| (scaling, 0.0))
    } else {
        // Parametric maps have an identity as rescale; the mapping holds the real one.
        frame.mapping.filter(|_| header.is_parametric_map()).or_else(|| stated_rescale(frame))
    };
    let rescales = image.is_none_or(Image::rescales);
    let native = match image.map(|i| i.access) {
        Some(Access::Native { offset, frame_bytes }) => {
            offset.checked_add(frame_bytes.saturating_mul(frame.index.into()))
        }
        _ => None,
    };
    let slice = Slice {
        file,
        frame: frame.index,
        layout: image.map_or(u32::MAX, |i| {
            series.layout_index(mosaic.map_or(i.layout, |m| i.layout.tile(m.mosaic.across)))
        }),
        image_type: series.type_index(&frame.frame_type, &frame.complex_component),
        obstacle: obstacle.map_or(NO_OBSTACLE, |fault| series.obstacle_index(fault)),
        identity: if header.instance_uid.is_empty() {
            0
        } else {
            StableHash::new().part(header.instance_uid.as_bytes()).finish()
        },
        instance: header.instance,
        at: frame.position.unwrap_or([f64::NAN; 3]),
        native: native.unwrap_or(u64::MAX),
        pixels: header
            .pixels
            .filter(|_| image.is_some_and(|i| i.frames == 1))
            .map_or((0, 0), |p| (p.offset, p.available)),
        linear: rescale.filter(|_| rescales).unwrap_or((f64::NAN, f64::NAN)),
        rescales,
        padding: PaddingAttributes::of(header),
        keys: keys_of(series, header, frame),
        dimensions: frame.dimensions.map(|n| u16::try_from(n).unwrap_or(u16::MAX)),
    };
    let shared = shared_of(header, mosaic, frame);
    let burned_in = shared.burned_in;
    let group = series.group_of(group_key(header, mosaic, frame), format_of(header), shared);
    group.shared.burned_in = group.shared.burned_in.or(burned_in);
    if let Some(image) = image {
        let bytes = if native_of(image) { 0 } else { image.unroll_bytes() };
        group.shared.unroll_bytes = group.shared.unroll_bytes.max(bytes);
        group.shared.note(image.note());
    }
    if header.is_dose() && header.dose_scaling.is_none() && rescales {
        group.shared.note(Some(Note::new(
            "the RT dose states no dose grid scaling; values are as stored, not in Gy",
        )));
    }
    group.shared.note(match frame.origin {
        Origin::Stated if frame.position.is_none() && frame.index > 0 && header.is_film() => {
            Some(Note::new("frames follow each other in time (Frame Increment Pointer (0028,0009)), and are stacked as if they were slices"))
        }
        Origin::Stated => None,
        Origin::Grid => Some(Note::new("positions of frames are taken from the grid frame offset vector")),
        Origin::StackedByThickness => Some(Note::new(
            "frames state one position and no distance; they are placed in their order by the slice thickness",
        )),
        Origin::StackedBlindly => Some(Note::spacing(
            "frames state one position and no distance; they are placed in their order, and 1 mm is assumed between them",
        )),
        Origin::Stepped => Some(Note::new("frames state no positions of their own; they are placed in their order by the stated spacing between slices")),
    });
    group.shared.note(
        frame
            .comma
            .map(|attribute| Note::new(format!("decimal commas of the {attribute} are read as points"))),
    );
    group.slices.push(slice);
    &mut group.shared
}

/// Hash of all attributes in which the images of one volume agree, except for the format of their pixels.
fn group_key(header: &DicomHeader, mosaic: Option<&MosaicLayout>, frame: &FrameGeometry) -> u64 {
    let mut key = StableHash::new().part(header.series_uid.as_bytes());
    for number in [
        header.rows.map_or(0, u64::from),
        header.columns.map_or(0, u64::from),
        kind_of(&frame.frame_type) as u64,
        frame.position.is_some().into(),
        frame.orientation.is_some().into(),
        frame.pixel_spacing.is_some().into(),
        header.modality_lut.into(),
        header.pixels.map_or(0, |p| p.element as u64),
    ] {
        key = key.number(number);
    }
    // Volumes in single images are grouped by their exact directions.
    if let Some(MosaicLayout { mosaic, .. }) = mosaic {
        key = key.number(mosaic.across.into()).number(mosaic.slices.into()).number(mosaic.backwards.into());
        let (orientation, spacing) =
            (frame.orientation.iter().flatten(), frame.pixel_spacing.iter().flatten());
        let numbers = orientation.chain(spacing).chain([&mosaic.distance_mm]);
        key = numbers.fold(key, |key, number| key.number((number + 0.0).to_bits()));
    }
    key.finish()
}

/// Hash of the attributes by which pixels are read.
fn format_of(header: &DicomHeader) -> u64 {
    let photometric = if header.photometric.is_empty() { "MONOCHROME2" } else { &header.photometric };
    let numbers = [header.bits_allocated, header.pixel_representation, header.samples.or(Some(1))];
    let key = StableHash::new().part(photometric.as_bytes());
    numbers.into_iter().fold(key, |key, number| key.number(number.map_or(0, u64::from))).finish()
}

/// The numbers that distinguish the volumes of a series; NaN where one is not stated.
fn keys_of(series: &mut Series, header: &DicomHeader, frame: &FrameGeometry) -> [f32; Key::KEPT] {
    let number = |v: Option<i32>| v.map_or(f64::NAN, f64::from);
    let value = |v: Option<f64>| v.unwrap_or(f64::NAN);
    let mut keys = [f32::NAN; Key::KEPT];
    for (slot, value) in keys.iter_mut().zip([
        series.stack_index(&frame.stack_id),
        frame.segment.map_or(f64::NAN, f64::from),
        number(header.echo_number),
        value(frame.echo_time),
        value(header.inversion_time),
        value(header.flip_angle),
        number(frame.temporal_position),
        value(frame.b_value),
        series.direction_index(frame.gradient),
        value(frame.trigger_time),
        value(header.cardiac_phase),
        number(frame.acquisition),
        value(frame.acquisition_time),
        value(header.frame_reference_time),
        series.vectors_index(frame.vectors),
    ]) {
        #[expect(clippy::cast_possible_truncation, reason = "seven digits tell images apart")]
        let short = value as f32;
        *slot = short;
    }
    keys
}

/// Attributes that the images of a volume share, from one of them.
fn shared_of(header: &DicomHeader, mosaic: Option<&MosaicLayout>, frame: &FrameGeometry) -> Shared {
    Shared {
        kind: kind_of(&frame.frame_type),
        object: header.kind(),
        modality: header.modality.clone(),
        body_part: header.body_part.clone(),
        series_uid: header.series_uid.clone(),
        series_number: header.series_number,
        size: mosaic
            .map_or([header.columns.unwrap_or(0).into(), header.rows.unwrap_or(0).into()], |m| m.size),
        mosaic: mosaic.map(|m| m.mosaic),
        orientation: frame.orientation,
        pixel_spacing: frame.pixel_spacing,
        slice_thickness: frame.slice_thickness,
        spacing_between: frame.spacing_between,
        leaves_out_empty: header.is_segmentation(),
        burned_in: header.may_show_text(),
        unroll_bytes: 0,
        notes: Vec::new(),
    }
}

/// Rescale slope and intercept; where only one is stated, the other changes nothing.
fn stated_rescale(frame: &FrameGeometry) -> Option<(f64, f64)> {
    (frame.slope.is_some() || frame.intercept.is_some())
        .then(|| (frame.slope.unwrap_or(1.0), frame.intercept.unwrap_or(0.0)))
}

fn native_of(image: &Image) -> bool {
    matches!(image.access, Access::Native { .. })
}

/// Kinds of images that never lie in one volume, by Image Type (PS3.3 C.7.6.1.1.2).
fn kind_of(image_type: &str) -> Kind {
    const OVERVIEWS: [&str; 5] = ["LOCALIZER", "SCOUT", "SCANOGRAM", "TOPOGRAM", "OVERVIEW"];
    let mut parts = image_type.split('\\').map(str::trim);
    let derived = parts.clone().next() == Some("DERIVED");
    if parts.any(|part| OVERVIEWS.contains(&part)) {
        Kind::Localizer
    } else if derived {
        Kind::Derived
    } else {
        Kind::Image
    }
}

/// Path of a file of a series, for messages.
pub(crate) fn path_of(series: &Series, slice: &Slice) -> PathBuf {
    series.files.path(slice.file as usize)
}

/// The folder that all files lie in.
pub(crate) fn folder_of(series: &Series, files: &mut dyn Iterator<Item = u32>) -> PathBuf {
    let mut shared: Option<PathBuf> = None;
    for file in files {
        let path = series.files.path(file as usize);
        let folder = path.parent().unwrap_or(Path::new(""));
        shared = Some(match shared {
            None => folder.to_path_buf(),
            Some(known) => {
                known.ancestors().find(|a| folder.starts_with(a)).unwrap_or(Path::new("")).to_path_buf()
            }
        });
    }
    shared.unwrap_or_default()
}
