//! The images of one series, grouped by those that could lie in one volume.

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::PathBuf;

use super::assemble::along_normal;
use super::gaps::{is_uneven, positions};
use super::mosaic::Mosaic;
use crate::platform::PositionalFile;
use crate::source::dicom::attribute::Attribute;
use crate::source::dicom::image::describe::Obstacle;
use crate::source::dicom::image::pixels::{PaddingAttributes, PixelLayout};
use crate::source::dicom::parse::error::ScanError;
use crate::source::files::FileList;
use crate::source::finding::BurnedIn;
use crate::source::stable_hash::StableHash;
use crate::volume::{Note, StatedLabel};

/// Difference below which orientation cosines are the same; scanners print six digits.
const ORIENTATION_TOLERANCE: f64 = 1e-4;

/// Relative difference below which pixel spacings are the same.
const SPACING_TOLERANCE: f64 = 1e-4;

/// Most texts that are distinguished in one series; all later ones count as one.
const MAX_TEXTS: usize = 256;

/// Most notes on the files of a group; notes on damaged files may all differ.
const MAX_NOTES: usize = 16;

/// [`Slice::obstacle`] of an image that can be read.
pub(crate) const NO_OBSTACLE: u32 = u32::MAX;

/// Kinds of images that never lie in one volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Image,
    Derived,
    Localizer,
}

/// Attributes that distinguish images at the same position, in order of preference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Key {
    ImageType,
    /// Index in [`NUMBERS`].
    Number(usize),
    Rescale,
}

/// For each [`Key::Number`]: the word before a value, the attribute, and whether its values mean nothing to people.
const NUMBERS: [(&str, Attribute, bool); Key::NUMBERS] = [
    ("stack", Attribute::Stack, true),
    ("segment", Attribute::Segment, false),
    ("echo", Attribute::EchoNumber, false),
    ("TE", Attribute::EchoTime, false),
    ("TI", Attribute::InversionTime, false),
    ("flip", Attribute::FlipAngle, false),
    ("time", Attribute::TemporalPosition, false),
    ("b", Attribute::BValue, false),
    ("direction", Attribute::GradientDirection, true),
    ("trigger", Attribute::TriggerTime, false),
    ("phase", Attribute::CardiacPhase, false),
    ("acquisition", Attribute::AcquisitionNumber, false),
    ("acquired", Attribute::AcquisitionTime, true),
    ("reference time", Attribute::FrameReferenceTime, false),
    ("frames", Attribute::FrameVectors, true),
    ("dimension 1 index", Attribute::DimensionIndex, false),
    ("dimension 2 index", Attribute::DimensionIndex, false),
    ("dimension 3 index", Attribute::DimensionIndex, false),
    ("dimension 4 index", Attribute::DimensionIndex, false),
    ("dimension 5 index", Attribute::DimensionIndex, false),
];

impl Key {
    /// Count of a slice's numbers: [`Slice::keys`], then [`Slice::dimensions`].
    pub(crate) const NUMBERS: usize = Self::KEPT + 5;

    /// Numbers that a slice keeps as such.
    pub(crate) const KEPT: usize = 15;

    pub(crate) const STACK: Self = Self::Number(0);
    pub(crate) const SEGMENT: Self = Self::Number(1);
    pub(crate) const TRIGGER: Self = Self::Number(9);
    pub(crate) const TIME: Self = Self::Number(12);
    pub(crate) const REFERENCE: Self = Self::Number(13);
    /// The vectors of nuclear medicine, other than the slice.
    pub(crate) const VECTORS: Self = Self::Number(14);

    /// Every key, the preferred ones first.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let last = [Self::Rescale].into_iter();
        [Self::ImageType].into_iter().chain((0..Self::NUMBERS).map(Self::Number)).chain(last)
    }

    /// True for a time, which may differ from slice to slice of one volume.
    pub(crate) fn is_time(self) -> bool {
        [Self::TRIGGER, Self::TIME, Self::REFERENCE].contains(&self)
    }

    /// The attribute.
    pub(crate) fn attribute(self) -> Attribute {
        match self {
            Self::ImageType => Attribute::ImageType,
            Self::Rescale => Attribute::Rescale,
            Self::Number(at) => NUMBERS.get(at).map_or(Attribute::DimensionIndex, |(_, own, _)| *own),
        }
    }

    /// The word before a value; `None` where values mean nothing to people, and their rank is used.
    pub(crate) fn word(self) -> (&'static str, bool) {
        match self {
            Self::ImageType => ("", false),
            Self::Rescale => ("rescale", true),
            Self::Number(at) => NUMBERS.get(at).map_or(("", false), |(word, _, ranked)| (word, *ranked)),
        }
    }

    /// The number that a slice states, for keys with a number.
    pub(crate) fn number(self, slice: &Slice) -> Option<f64> {
        if let Self::Number(at) = self { slice.number(at) } else { None }
    }

    /// The value as bits that are equal when the values are, and in their order.
    pub(crate) fn value(self, slice: &Slice) -> [u64; 2] {
        // Missing values come first.
        let bits = |v: f64| {
            if v.is_nan() {
                return 0;
            }
            let bits = (v + 0.0).to_bits();
            if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
        };
        match self {
            Self::ImageType => [slice.image_type.into(), 0],
            Self::Number(at) => [slice.number(at).map_or(0, bits), 0],
            Self::Rescale => {
                slice.rescale().map_or([0, 0], |(slope, intercept)| [bits(slope), bits(intercept)])
            }
        }
    }
}

/// One image.
#[derive(Clone, Debug)]
pub(crate) struct Slice {
    /// Index in the series' files.
    pub(crate) file: u32,
    /// Number of the frame in its file.
    pub(crate) frame: u32,
    /// Index in the series' layouts.
    pub(crate) layout: u32,
    /// Index in the series' image types.
    pub(crate) image_type: u32,
    /// Index in the series' obstacles, or [`NO_OBSTACLE`].
    pub(crate) obstacle: u32,
    /// Hash of the SOP Instance UID; 0 without one.
    pub(crate) identity: u64,
    pub(crate) instance: Option<i32>,
    /// Position in mm, NaN where not stated; see [`Slice::position`].
    pub(crate) at: [f64; 3],
    /// Offset of the pixels where they can be read by position, else `u64::MAX`.
    pub(crate) native: u64,
    /// Offset and length of the pixel element of a file of one frame; of length 0 otherwise.
    pub(crate) pixels: (u64, u64),
    /// Slope and intercept, if stated and to be applied, else NaN; see [`Slice::rescale`].
    pub(crate) linear: (f64, f64),
    /// True if slope and intercept apply at all.
    pub(crate) rescales: bool,
    /// Stored values that mean "no pixel".
    pub(crate) padding: PaddingAttributes,
    /// Numbers that distinguish images at one position; NaN where not stated.
    pub(crate) keys: [f32; Key::KEPT],
    /// The first Dimension Index Values; 0 where absent.
    pub(crate) dimensions: [u16; 5],
}

impl Slice {
    /// Image Position (Patient), if stated.
    pub(crate) fn position(&self) -> Option<[f64; 3]> {
        Some(self.at).filter(|p| !p[0].is_nan())
    }

    /// A number that may distinguish it from others, if stated.
    pub(crate) fn number(&self, at: usize) -> Option<f64> {
        match at.checked_sub(Key::KEPT) {
            None => self.keys.get(at).map(|v| f64::from(*v)).filter(|v| !v.is_nan()),
            Some(dimension) => self.dimensions.get(dimension).map(|v| f64::from(*v)).filter(|v| *v > 0.0),
        }
    }

    /// Slope and intercept, if stated and to be applied.
    pub(crate) fn rescale(&self) -> Option<(f64, f64)> {
        Some(self.linear).filter(|(slope, _)| !slope.is_nan())
    }

    /// Offset of the pixels where they can be read by position.
    pub(crate) fn native(&self) -> Option<u64> {
        Some(self.native).filter(|at| *at != u64::MAX)
    }

    /// The position as bits that are equal when positions are.
    fn place(&self) -> Option<[u64; 3]> {
        self.position().map(|p| p.map(|c| (c + 0.0).to_bits()))
    }
}

/// The attributes that all images of a group share.
#[derive(Clone, Debug)]
pub(crate) struct Shared {
    pub(crate) kind: Kind,
    /// Kind of object, in words.
    pub(crate) object: String,
    pub(crate) modality: String,
    pub(crate) body_part: String,
    pub(crate) series_uid: String,
    pub(crate) series_number: Option<i32>,
    /// Columns and rows, of a tile in a mosaic.
    pub(crate) size: [u32; 2],
    /// Arrangement of the slices in each image, where one image is a volume.
    pub(crate) mosaic: Option<Mosaic>,
    pub(crate) orientation: Option<[f64; 6]>,
    pub(crate) pixel_spacing: Option<[f64; 2]>,
    pub(crate) slice_thickness: Option<f64>,
    pub(crate) spacing_between: Option<f64>,
    /// True for a segmentation, where empty slices need no frame.
    pub(crate) leaves_out_empty: bool,
    /// Reason why the pixels of some image may carry text.
    pub(crate) burned_in: Option<BurnedIn>,
    /// Memory that decoding takes; 0 where pixels are read by position.
    pub(crate) unroll_bytes: u64,
    pub(crate) notes: Vec<Note>,
}

impl Shared {
    /// Keeps a note once, of few.
    pub(crate) fn note(&mut self, note: Option<Note>) {
        if let Some(note) = note
            && self.notes.len() < MAX_NOTES
            && !self.notes.contains(&note)
        {
            self.notes.push(note);
        }
    }

    /// True if an image could lie in the same volume, as far as directions and distances of pixels go.
    fn is_like(&self, other: &Self) -> bool {
        self.turns_like(other) && self.spaced_like(other)
    }

    fn turns_like(&self, other: &Self) -> bool {
        match (&self.orientation, &other.orientation) {
            (Some(a), Some(b)) => close(a, b, ORIENTATION_TOLERANCE),
            (a, b) => a.is_none() && b.is_none(),
        }
    }

    fn spaced_like(&self, other: &Self) -> bool {
        match (&self.pixel_spacing, &other.pixel_spacing) {
            (Some(a), Some(b)) => close(a, b, SPACING_TOLERANCE * a[0].abs().max(a[1].abs())),
            (a, b) => a.is_none() && b.is_none(),
        }
    }

    /// The attributes by which images of two groups of a series were distinguished; never empty.
    pub(crate) fn differences(&self, other: &Self) -> Vec<Attribute> {
        let found = [
            (Attribute::ImageType, self.kind != other.kind),
            (Attribute::Size, self.size != other.size),
            (Attribute::Orientation, !self.turns_like(other)),
            (Attribute::PixelSpacing, !self.spaced_like(other)),
            (Attribute::MosaicSlices, self.mosaic != other.mosaic),
        ];
        let differ: Vec<Attribute> =
            found.into_iter().filter(|(_, differs)| *differs).map(|(own, _)| own).collect();
        if differ.is_empty() { vec![Attribute::PixelFormat] } else { differ }
    }

    /// A whole number that differs by at most one between equal orientations.
    fn bucket(&self) -> i64 {
        const WEIGHTS: [f64; 6] = [1.0, 0.7, 0.5, 0.9, 0.6, 0.8];
        const WIDTH: f64 = 1e-2;
        let sum: f64 = self.orientation.iter().flatten().zip(WEIGHTS).map(|(a, w)| a * w).sum();
        #[expect(clippy::cast_possible_truncation, reason = "saturates for directions out of any range")]
        let bucket = (sum / WIDTH).floor() as i64;
        bucket
    }
}

fn close(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

/// Images of one size, kind and orientation.
#[derive(Debug)]
pub(crate) struct Group {
    /// Hash of all attributes in which the images of one volume agree, except for the format of their pixels.
    family: u64,
    pub(crate) shared: Shared,
    pub(crate) slices: Vec<Slice>,
}

/// The images of one series.
#[derive(Debug, Default)]
pub(crate) struct Series {
    pub(crate) files: FileList,
    /// Size and time of change of each file.
    pub(crate) facts: Vec<(u64, u64)>,
    pub(crate) groups: Vec<Group>,
    pub(crate) layouts: Vec<PixelLayout>,
    pub(crate) image_types: Vec<String>,
    pub(crate) obstacles: Vec<Obstacle>,
    /// Images that were dropped, because they are in the series twice: the numbers of their files.
    pub(crate) duplicates: Vec<u32>,
    /// Files of those whose pixels differ from the image that stayed, behind the file of that image.
    pub(crate) unlike: Vec<[u32; 2]>,
    /// The first file with an image that cannot be placed, scaled or told apart, as its header states wrong numbers,
    /// and these: which of the others it belongs to is not known, either.
    pub(crate) wrong: Option<(u32, String)>,
    /// The first file that was an image when it was found, and is not any more.
    pub(crate) lost: Option<(PathBuf, ScanError)>,
    /// The segments of a segmentation, by number.
    pub(crate) segments: Vec<StatedLabel>,
    directions: Vec<[i64; 3]>,
    stacks: Vec<String>,
    vectors: Vec<[u16; 8]>,
    index: HashMap<(u64, i64), Vec<u32>>,
}

impl Series {
    pub(crate) fn new(files: FileList, facts: Vec<(u64, u64)>) -> Self {
        Self { files, facts, ..Self::default() }
    }

    /// The group of an image, by the hash of the attributes that must be equal and by the attributes that may differ a
    /// little; found in constant time.
    pub(crate) fn group_of(&mut self, family: u64, format: u64, shared: Shared) -> &mut Group {
        let key = StableHash::new().number(family).number(format).finish();
        let bucket = shared.bucket();
        let near = [bucket, bucket.saturating_sub(1), bucket.saturating_add(1)];
        let known = near.iter().filter_map(|b| self.index.get(&(key, *b))).flatten().copied();
        let known =
            known.filter(|at| self.groups.get(*at as usize).is_some_and(|g| g.shared.is_like(&shared)));
        let at = known.min().map_or(self.groups.len(), |at| at as usize);
        if at == self.groups.len() {
            self.index.entry((key, bucket)).or_default().push(u32::try_from(at).unwrap_or(u32::MAX));
            // Most series are one group of as many images as files.
            let slices = Vec::with_capacity(if at == 0 { self.files.len() } else { 0 });
            self.groups.push(Group { family, shared, slices });
        }
        &mut self.groups[at]
    }

    /// Takes in the segments of a file; of several with one number the first stays.
    pub(crate) fn add_segments(&mut self, segments: Vec<StatedLabel>) {
        for segment in segments {
            if let Err(at) = self.segments.binary_search_by_key(&segment.number, |known| known.number) {
                self.segments.insert(at, segment);
            }
        }
    }

    pub(crate) fn layout_index(&mut self, layout: PixelLayout) -> u32 {
        index_of(&mut self.layouts, layout, usize::MAX)
    }

    /// Index of an image type with its complex component.
    pub(crate) fn type_index(&mut self, image_type: &str, component: &str) -> u32 {
        let parts = image_type.split('\\').map(str::trim).chain([component.trim()]);
        let text = parts.filter(|p| !p.is_empty()).collect::<Vec<_>>().join("\\");
        index_of(&mut self.image_types, text, MAX_TEXTS)
    }

    pub(crate) fn obstacle_index(&mut self, fault: &Obstacle) -> u32 {
        index_of(&mut self.obstacles, fault.clone(), MAX_TEXTS)
    }

    /// Number of a direction of diffusion, in the order of first appearance.
    pub(crate) fn direction_index(&mut self, direction: Option<[f64; 3]>) -> f64 {
        const DIGITS: f64 = 1e4;
        let Some(direction) = direction else { return f64::NAN };
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let rounded = direction.map(|c| (c * DIGITS).round() as i64);
        index_of(&mut self.directions, rounded, 4 * MAX_TEXTS).into()
    }

    /// Number of a frame's vectors of nuclear medicine, in the order of first appearance.
    pub(crate) fn vectors_index(&mut self, vectors: [u16; 8]) -> f64 {
        if vectors == [0; 8] { f64::NAN } else { index_of(&mut self.vectors, vectors, 4 * MAX_TEXTS).into() }
    }

    /// Number of a stack, in the order of first appearance.
    pub(crate) fn stack_index(&mut self, stack: &str) -> f64 {
        if stack.is_empty() {
            f64::NAN
        } else {
            index_of(&mut self.stacks, stack.to_owned(), MAX_TEXTS).into()
        }
    }

    /// Remembers a file that could not be read again.
    pub(crate) fn lost(&mut self, path: PathBuf, error: ScanError) {
        self.lost.get_or_insert((path, error));
    }

    /// Ends loading: images are put in an order that no file name decides, and copies are dropped.
    pub(crate) fn finish(&mut self) {
        self.index = HashMap::new();
        // Image types are compared by their text, not by who came first.
        let mut order: Vec<u32> = (0..u32::try_from(self.image_types.len()).unwrap_or(0)).collect();
        crate::order::by_key(&mut order, |i| self.image_types.get(*i as usize));
        let mut rank = vec![0; order.len()];
        for (new, old) in order.iter().enumerate() {
            if let Some(slot) = rank.get_mut(*old as usize) {
                *slot = u32::try_from(new).unwrap_or(u32::MAX);
            }
        }
        crate::order::by(&mut self.image_types, Ord::cmp);
        for group in &mut self.groups {
            for slice in &mut group.slices {
                slice.image_type = rank.get(slice.image_type as usize).copied().unwrap_or(u32::MAX);
            }
            // Copies lie side by side, the one that stays first.
            group.slices.sort_unstable_by_key(|s| {
                let coded = s.native().is_none();
                (s.instance, s.identity, s.frame, s.place(), s.obstacle != NO_OBSTACLE, coded, s.file)
            });
            group.slices.shrink_to_fit();
        }
        let files = &self.files;
        for group in &mut self.groups {
            drop_copies(&mut group.slices, files, (&mut self.duplicates, &mut self.unlike));
        }
        self.duplicates.sort_unstable();
        self.groups.retain(|g| !g.slices.is_empty());
        crate::order::by_key(&mut self.groups, |g| {
            let first = g.slices.first().map(|s| (s.instance, s.identity, s.frame));
            (first, g.shared.size)
        });
        self.join_formats();
    }

    /// Images of one family whose pixels are of several formats lie in one volume, unless they repeat positions; grey
    /// ones and colours only where they make one even stack.
    fn join_formats(&mut self) {
        let mut joined: Vec<Group> = Vec::new();
        for mut group in std::mem::take(&mut self.groups) {
            if !joined.iter_mut().any(|host| host.join(&mut group)) {
                joined.push(group);
            }
        }
        self.groups = joined;
    }
}

impl Group {
    /// Takes the images of another group if they may lie in one volume.
    fn join(&mut self, other: &mut Self) -> bool {
        if self.family != other.family || self.shared.mosaic.is_some() || !self.shared.is_like(&other.shared)
        {
            return false;
        }
        let own = self.slices.len();
        self.slices.append(&mut other.slices);
        let are_grey = self.slices.iter().all(|slice| slice.rescales);
        if is_stack(self).is_some_and(|even| even || are_grey) {
            other.shared.notes.drain(..).for_each(|note| self.shared.note(Some(note)));
            self.shared.unroll_bytes = self.shared.unroll_bytes.max(other.shared.unroll_bytes);
            self.shared.burned_in = self.shared.burned_in.or(other.shared.burned_in);
            self.slices.sort_unstable_by_key(|s| (s.instance, s.identity, s.frame));
            return true;
        }
        other.slices = self.slices.split_off(own);
        false
    }
}

/// True if images at different positions lie evenly; `None` where they repeat positions, or state none.
fn is_stack(group: &Group) -> Option<bool> {
    let along = along_normal(group, &(0..group.slices.len()).collect::<Vec<_>>())?;
    (positions(&along).1 == along.len()).then(|| !is_uneven(&along))
}

/// Drops images that are there twice: with one SOP Instance UID at one position, or with the same numbers
/// at one position and equal pixels. Of copies the one that can be read stays, then the one that needs
/// no decoding. The files of those that were dropped are noted, and of pixels that differ under one UID.
fn drop_copies(
    slices: &mut Vec<Slice>,
    files: &FileList,
    (duplicates, unlike): (&mut Vec<u32>, &mut Vec<[u32; 2]>),
) {
    let identity = |s: &Slice| (s.identity, s.frame, s.place(), s.instance);
    slices.dedup_by(|s, kept| {
        let copy = s.identity != 0 && identity(s) == identity(kept);
        if copy {
            duplicates.push(s.file);
            if differ(kept, s, files) {
                unlike.push([kept.file, s.file]);
            }
        }
        copy
    });
    // Pixels are read only where all the numbers agree.
    let mut alike: Vec<(u64, usize)> = Vec::new();
    for (i, s) in slices.iter().enumerate() {
        let (Some(place), 1.., Some(instance)) = (s.place(), s.pixels.1, s.instance) else { continue };
        let keys = Key::all().filter(|k| *k != Key::Rescale).flat_map(|k| k.value(s));
        let hash = place.into_iter().chain(keys).fold(StableHash::new(), StableHash::number);
        alike.push((hash.number(instance.cast_unsigned().into()).finish(), i));
    }
    alike.sort_unstable();
    let mut dropped = HashSet::new();
    for copies in alike.chunk_by(|a, b| a.0 == b.0).filter(|c| c.len() > 1) {
        let mut known: Vec<(usize, u64)> = Vec::new();
        for (_, i) in copies {
            let Some(slice) = slices.get(*i) else { continue };
            let Ok(hash) = pixel_hash(slice, files) else { continue };
            let same = |(k, h): &(usize, u64)| {
                *h == hash && slices.get(*k).is_some_and(|k| same_pixels(k, slice, files).unwrap_or(false))
            };
            if known.iter().any(same) {
                dropped.insert(*i);
            } else {
                known.push((*i, hash));
            }
        }
    }
    let mut at = 0;
    slices.retain(|slice| {
        at += 1;
        let copy = dropped.contains(&(at - 1));
        if copy {
            duplicates.push(slice.file);
        }
        !copy
    });
}

/// True if pixels that are stored in the same way have other bytes.
fn differ(a: &Slice, b: &Slice, files: &FileList) -> bool {
    let is_alike = a.layout == b.layout && a.pixels.1 == b.pixels.1 && a.pixels.1 > 0;
    let is_native = a.native().is_some() && b.native().is_some();
    is_alike && is_native && same_pixels(a, b, files).is_ok_and(|same| !same)
}

const PIECE: usize = 16 << 10;

/// Runs over the pixel bytes of an image.
fn pieces(slice: &Slice, files: &FileList, each: &mut dyn FnMut(&[u8])) -> io::Result<()> {
    let (mut at, mut left) = slice.pixels;
    let file = PositionalFile::open(&files.path(slice.file as usize))?;
    let mut piece = [0; PIECE];
    while left > 0 {
        let want = usize::try_from(left).unwrap_or(PIECE).min(PIECE);
        let part = piece.get_mut(..want).unwrap_or(&mut []);
        file.read_exact_at(part, at)?;
        each(part);
        at += want as u64;
        left -= want as u64;
    }
    Ok(())
}

fn pixel_hash(slice: &Slice, files: &FileList) -> io::Result<u64> {
    let mut hash = StableHash::new();
    pieces(slice, files, &mut |part| hash = hash.part(part))?;
    Ok(hash.finish())
}

fn same_pixels(a: &Slice, b: &Slice, files: &FileList) -> io::Result<bool> {
    let ((_, length), (mut at, other)) = (a.pixels, b.pixels);
    if length != other {
        return Ok(false);
    }
    let file = PositionalFile::open(&files.path(b.file as usize))?;
    let mut beside = [0; PIECE];
    let mut same = Ok(true);
    pieces(a, files, &mut |part| {
        let twin = beside.get_mut(..part.len()).unwrap_or(&mut []);
        same = match (&same, file.read_exact_at(twin, at)) {
            (Ok(true), Ok(())) => Ok(part == twin),
            (Ok(_), Ok(())) => Ok(false),
            (_, Err(e)) => Err(e),
            (Err(_), _) => Ok(false),
        };
        at += part.len() as u64;
    })?;
    same
}

/// Index of a value in a short list of distinct ones, added if new; values past `most` share an index.
fn index_of<T: PartialEq>(known: &mut Vec<T>, value: T, most: usize) -> u32 {
    let at = known.iter().position(|k| *k == value).unwrap_or_else(|| {
        if known.len() < most {
            known.push(value);
        }
        known.len() - 1
    });
    u32::try_from(at).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_where_their_names_say() {
        for (key, attribute) in [
            (Key::STACK, Attribute::Stack),
            (Key::SEGMENT, Attribute::Segment),
            (Key::TRIGGER, Attribute::TriggerTime),
            (Key::TIME, Attribute::AcquisitionTime),
            (Key::REFERENCE, Attribute::FrameReferenceTime),
            (Key::VECTORS, Attribute::FrameVectors),
        ] {
            assert_eq!(key.attribute(), attribute, "{key:?}");
        }
    }
}
