//! Finds the images among the inputs by content, and groups those that could be one volume.
//!
//! Memory: one header at a time, some 90 bytes per image, the names once.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::header::DicomHeader;
use super::image::Obstacle;
use super::pixels::PixelLayout;
use super::scan::{ScanError, scan};
use crate::source::SourceError;
use crate::source::files::FileList;
use crate::source::raw::base_name;

/// How deep folders are searched below the one given.
const MAX_FOLDER_DEPTH: u32 = 5;

/// Orientation cosines that differ by less are the same; scanners print six digits.
const ORIENTATION_TOLERANCE: f64 = 1e-4;

/// Relative difference of pixel spacings that are the same.
const SPACING_TOLERANCE: f64 = 1e-4;

/// Everything that was found.
pub(super) struct Survey {
    pub(super) files: FileList,
    pub(super) name: String,
    pub(super) groups: Vec<Group>,
    /// DICOM files that are no usable image: the reason, how many, the first of them.
    pub(super) unusable: Vec<(String, u64, PathBuf)>,
    /// Files that are no DICOM at all.
    pub(super) foreign: u64,
}

/// Images of one series, orientation and size.
pub(super) struct Group {
    /// Header of the first image, for all that the images share.
    pub(super) first: DicomHeader,
    pub(super) layouts: Vec<PixelLayout>,
    pub(super) image_types: Vec<String>,
    pub(super) slices: Vec<Slice>,
    /// An image of this group that is there, but cannot be read.
    pub(super) broken: Option<(PathBuf, String)>,
}

/// One image.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    /// Index in the survey's files.
    pub(super) file: usize,
    pub(super) layout: u32,
    pub(super) image_type: u32,
    pub(super) acquisition: i32,
    pub(super) instance: Option<i32>,
    pub(super) position: Option<[f64; 3]>,
    pub(super) offset: u64,
    /// Slope and intercept, if stated.
    pub(super) rescale: Option<(f64, f64)>,
    /// Pixel Padding Value and Range Limit as their bits.
    pub(super) padding: (Option<u16>, Option<u16>),
}

/// Searches files and folders. Order of the result does not depend on the order of a folder.
pub(super) fn survey(inputs: &[PathBuf]) -> Result<Survey, SourceError> {
    let (files, name) = list(inputs)?;
    let mut survey = Survey { files, name, groups: Vec::new(), unusable: Vec::new(), foreign: 0 };
    for file in 0..survey.files.len() {
        let path = survey.files.path(file);
        let header = match File::open(&path).map_err(ScanError::Io).and_then(|f| scan(&f)) {
            Ok(header) => header,
            Err(ScanError::NotDicom) => {
                survey.foreign += 1;
                continue;
            }
            // A file that was named must be readable; one met in a folder is only reported.
            Err(ScanError::Io(cause)) if inputs.contains(&path) => {
                return Err(SourceError::Unreadable { path, cause });
            }
            Err(error) => {
                survey.set_aside(error.to_string(), path);
                continue;
            }
        };
        survey.add(file, path, header);
    }
    Ok(survey)
}

impl Survey {
    fn set_aside(&mut self, reason: String, path: PathBuf) {
        // Offsets and counts make reasons distinct; a bound keeps a folder of junk from piling up.
        const MAX_REASONS: usize = 16;
        let known = self.unusable.iter().position(|(known, ..)| *known == reason);
        if known.is_none() && self.unusable.len() < MAX_REASONS {
            self.unusable.push((reason, 1, path));
        } else if let Some((_, count, _)) = self.unusable.get_mut(known.unwrap_or(MAX_REASONS - 1)) {
            *count += 1;
        }
    }

    fn add(&mut self, file: usize, path: PathBuf, header: DicomHeader) {
        let layout = match PixelLayout::of(&header) {
            Ok(layout) => layout,
            Err(obstacle @ Obstacle::Truncated { .. }) => {
                // It belongs to a series: without it the volume would silently lack a slice.
                if let Some(group) = self.groups.iter_mut().find(|g| g.same_stack(&header)) {
                    group.broken.get_or_insert((path, obstacle.to_string()));
                } else {
                    let mut group = Group::new(header);
                    group.broken = Some((path, obstacle.to_string()));
                    self.groups.push(group);
                }
                return;
            }
            Err(obstacle) => return self.set_aside(obstacle.to_string(), path),
        };
        let at = self.groups.iter().position(|g| g.same_stack(&header)).unwrap_or_else(|| {
            self.groups.push(Group::new(header.clone()));
            self.groups.len() - 1
        });
        if let Some(group) = self.groups.get_mut(at) {
            group.add(file, &header, layout);
        }
    }
}

impl Group {
    fn new(first: DicomHeader) -> Self {
        Self { first, layouts: Vec::new(), image_types: Vec::new(), slices: Vec::new(), broken: None }
    }

    /// Could the image lie in the same volume as this group's first?
    fn same_stack(&self, other: &DicomHeader) -> bool {
        let first = &self.first;
        let close =
            |a: &[f64], b: &[f64], tolerance: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance);
        let orientation = match (&first.orientation, &other.orientation) {
            (Some(a), Some(b)) => close(a, b, ORIENTATION_TOLERANCE),
            (a, b) => a.is_none() && b.is_none(),
        };
        let spacing = match (&first.pixel_spacing, &other.pixel_spacing) {
            (Some(a), Some(b)) => close(a, b, SPACING_TOLERANCE * a[0].abs().max(a[1].abs())),
            (a, b) => a.is_none() && b.is_none(),
        };
        first.series_uid == other.series_uid
            && (first.rows, first.columns) == (other.rows, other.columns)
            && first.bits_allocated == other.bits_allocated
            && first.pixel_representation.unwrap_or(0) == other.pixel_representation.unwrap_or(0)
            && first.photometric == other.photometric
            && first.is_localizer() == other.is_localizer()
            && orientation
            && spacing
    }

    fn add(&mut self, file: usize, header: &DicomHeader, layout: PixelLayout) {
        let rescale = (header.slope.is_some() || header.intercept.is_some())
            .then(|| (header.slope.unwrap_or(1.0), header.intercept.unwrap_or(0.0)));
        self.slices.push(Slice {
            file,
            layout: index_of(&mut self.layouts, layout),
            image_type: index_of(&mut self.image_types, header.image_type.clone()),
            acquisition: header.acquisition.unwrap_or(0),
            instance: header.instance,
            position: header.position,
            offset: header.pixels.map_or(0, |p| p.offset),
            rescale,
            padding: (header.padding, header.padding_limit),
        });
    }
}

/// Index of a value in a short list of distinct ones, added if new.
fn index_of<T: PartialEq>(known: &mut Vec<T>, value: T) -> u32 {
    let at = known.iter().position(|k| *k == value).unwrap_or_else(|| {
        known.push(value);
        known.len() - 1
    });
    u32::try_from(at).unwrap_or(u32::MAX)
}

/// Files to look into, and the base name of what was given.
fn list(inputs: &[PathBuf]) -> Result<(FileList, String), SourceError> {
    let Some(first) = inputs.first() else {
        return Err(SourceError::Usage { path: PathBuf::new(), reason: "no input file is given".into() });
    };
    let unreadable = |path: &Path, cause| SourceError::Unreadable { path: path.to_path_buf(), cause };
    // One folder: names relative to it. Otherwise: names as given.
    let alone = inputs.len() == 1 && fs::metadata(first).map_err(|e| unreadable(first, e))?.is_dir();
    let mut files = FileList::new(if alone { first } else { Path::new("") });
    if alone {
        walk(first, Path::new(""), 0, &mut files).map_err(|e| unreadable(first, e))?;
    } else {
        for input in inputs {
            let meta = fs::metadata(input).map_err(|e| unreadable(input, e))?;
            if meta.is_dir() {
                walk(input, input, 0, &mut files).map_err(|e| unreadable(input, e))?;
            } else if meta.is_file() {
                files.push(input);
            } else {
                // Opening a pipe could wait forever.
                let reason = "is neither a file nor a folder".into();
                return Err(SourceError::Unusable { path: input.clone(), reason });
            }
        }
    }
    let order = files.natural_order();
    Ok((files.select(order.into_iter()), base_name(first)))
}

/// Adds the files of `folder` under the name `prefix`; hidden ones are left out, links to files are
/// followed, links to folders are not (they may run in circles).
fn walk(folder: &Path, prefix: &Path, depth: u32, files: &mut FileList) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let file_name = entry.file_name();
        if file_name.as_encoded_bytes().starts_with(b".") {
            continue;
        }
        let name = prefix.join(&file_name);
        let kind = entry.file_type()?;
        if kind.is_dir() {
            // A subfolder that may not be read is no reason to give up the rest.
            if depth < MAX_FOLDER_DEPTH {
                let _ = walk(&entry.path(), &name, depth + 1, files);
            }
        } else if kind.is_file()
            || (kind.is_symlink() && fs::metadata(entry.path()).is_ok_and(|m| m.is_file()))
        {
            files.push(&name);
        }
    }
    Ok(())
}
