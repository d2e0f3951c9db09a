//! A DICOM series as a volume.

use std::ops::Range;
use std::path::PathBuf;

use super::pixels::{Padding, PixelLayout};
use super::series::{Refusal, Stack, assemble, split};
use super::survey::{Group, Slice, Survey, survey};
use crate::source::files::FileSet;
use crate::source::raw::{check_request, read_block};
use crate::source::{Rescale, ScalarType, SourceDescription, SourceError, VolumeInfo, VolumeSource};

/// Physical value that stands for padding in CT (air, in HU); elsewhere it is 0.
const CT_BACKGROUND: f64 = -1000.0;

/// Files named in one warning.
const NAMED: usize = 3;

/// A classic, uncompressed DICOM series, read by position.
///
/// x runs along the rows of an image, y down its columns, z along the images' normal (x cross y) by
/// increasing position, so the affine is right-handed. The step between slices is the mean step from
/// the first to the last; with a tilted gantry it is not parallel to the normal.
///
/// Samples are the stored values (masked to Bits Stored, sign-extended) with one rescale for all; if
/// slices differ in rescale, they are physical values as `F32`. MONOCHROME1 numbers are kept. Pixels
/// that equal the Pixel Padding Value (or lie in the padding range) become the stored value nearest to
/// -1000 HU in CT and to 0 elsewhere, as far as Bits Stored reach: background, but no outlier.
///
/// Holds some 60 bytes a slice with its name, and no pixels.
#[derive(Debug)]
pub struct DicomVolume {
    info: VolumeInfo,
    files: FileSet,
    layouts: Vec<PixelLayout>,
    paddings: Vec<Option<Padding>>,
    slices: Vec<Place>,
    /// Deliver physical `f32`s?
    physical: bool,
}

/// Where a slice lies.
#[derive(Clone, Copy, Debug)]
struct Place {
    offset: u64,
    slope: f64,
    intercept: f64,
    layout: u32,
    padding: u32,
}

/// Images that might be the volume, judged.
struct Candidate {
    group: usize,
    chosen: Vec<usize>,
    verdict: Result<Stack, String>,
}

impl Candidate {
    fn voxels(&self, groups: &[Group]) -> u64 {
        let first = groups.get(self.group).map(|g| &g.first);
        let area = first.map_or(0, |h| u64::from(h.rows.unwrap_or(0)) * u64::from(h.columns.unwrap_or(0)));
        area * self.chosen.len() as u64
    }

    fn describe(&self, groups: &[Group]) -> String {
        let Some(group) = groups.get(self.group) else { return String::new() };
        let header = &group.first;
        let kind = self.chosen.first().and_then(|i| group.slices.get(*i)).map_or(0, |s| s.image_type);
        let kind = match group.image_types.get(kind as usize) {
            Some(name) if group.image_types.len() > 1 => format!(" {name}"),
            _ => String::new(),
        };
        let (columns, rows) = (header.columns.unwrap_or(0), header.rows.unwrap_or(0));
        let scout = if header.is_localizer() { ", localizer" } else { "" };
        let fate = match &self.verdict {
            Ok(_) => String::new(),
            Err(reason) => format!(", refused: {reason}"),
        };
        format!("{}{kind} {columns}x{rows}x{}{scout}{fate}", header.kind(), self.chosen.len())
    }
}

impl DicomVolume {
    /// Finds the images of the inputs (files, or folders searched five levels deep) by content and
    /// opens the largest series that forms a volume; the others are listed in a warning. One image
    /// alone is a volume of one slice, but only if no series has several.
    ///
    /// # Errors
    /// [`SourceError::NoVolume`] when no image is found, or none that can be read, or none that forms
    /// a volume (uneven gaps, repeated positions); [`SourceError::Unusable`] when the pixels of a slice
    /// are cut short; [`SourceError::Unreadable`] when the system refuses.
    pub fn open(inputs: &[PathBuf]) -> Result<Self, SourceError> {
        let found = survey(inputs)?;
        let path = inputs.first().cloned().unwrap_or_default();
        let mut candidates = judge(&found);
        let groups = &found.groups;
        let several = candidates.iter().any(|c| c.chosen.len() > 1);
        // Largest first; equal ones stay in the order of their names.
        let lone = |c: &Candidate| several && c.chosen.len() == 1;
        candidates.sort_by_key(|c| std::cmp::Reverse((c.verdict.is_ok() && !lone(c), c.voxels(groups))));
        let refuse = |reason| Err(SourceError::NoVolume { path: path.clone(), reason });
        if let Some((broken, reason)) = broken_of(&found, &candidates) {
            return Err(SourceError::Unusable {
                path: broken,
                reason: format!("{reason}; copy the file again, or move it away to build without it"),
            });
        }
        let Some(best) = candidates.first() else { return refuse(nothing(&found)) };
        if best.verdict.is_err() || lone(best) {
            let largest = candidates.iter().filter(|c| c.verdict.is_err()).max_by_key(|c| c.voxels(groups));
            let Some(Err(reason)) = largest.map(|c| &c.verdict) else { return refuse(nothing(&found)) };
            return refuse(reason.clone());
        }
        let mut warnings = general_warnings(&found, &candidates);
        let best = candidates.swap_remove(0);
        let Ok(stack) = best.verdict else { return refuse(nothing(&found)) };
        warnings.extend(stack.warnings.iter().cloned());
        Self::build(found, best.group, stack, warnings)
            .map_err(|reason| SourceError::NoVolume { path, reason })
    }

    fn build(
        mut found: Survey,
        group: usize,
        stack: Stack,
        mut warnings: Vec<String>,
    ) -> Result<Self, String> {
        let group = found.groups.swap_remove(group);
        let header = &group.first;
        let slices: Vec<&Slice> = stack.order.iter().filter_map(|i| group.slices.get(*i)).collect();
        let stated = slices.iter().filter(|s| s.rescale.is_some()).count();
        if stated > 0 && stated < slices.len() {
            return Err(format!(
                "{} of {} slices state no rescale slope and intercept, so their values cannot be compared",
                slices.len() - stated,
                slices.len()
            ));
        }
        let rescale_of = |s: &Slice| s.rescale.unwrap_or((1.0, 0.0));
        if slices.iter().any(|s| rescale_of(s).0 == 0.0) {
            return Err("the rescale slope is 0, so every pixel would have the same value".into());
        }
        let shared = slices.first().map_or((1.0, 0.0), |s| rescale_of(s));
        let physical = slices.iter().any(|s| rescale_of(s) != shared);
        if physical {
            warnings.push("slices differ in rescale; values are converted to single precision".into());
        }
        if stated == 0 && header.modality == "CT" {
            warnings.push("the images state no rescale; values may not be HU".into());
        }
        let background = if header.modality == "CT" { CT_BACKGROUND } else { 0.0 };
        let mut paddings: Vec<Option<Padding>> = Vec::new();
        let mut places = Vec::with_capacity(slices.len());
        for slice in &slices {
            let (slope, intercept) = rescale_of(slice);
            let layout = group.layouts.get(slice.layout as usize).ok_or("an image without layout")?;
            let padding = layout.padding(slice.padding, background, slope, intercept).filter(|p| p.matters());
            let at = paddings.iter().position(|p| *p == padding).unwrap_or_else(|| {
                paddings.push(padding);
                paddings.len() - 1
            });
            let padding = u32::try_from(at).map_err(|_| "too many padding values")?;
            places.push(Place { offset: slice.offset, slope, intercept, layout: slice.layout, padding });
        }
        let layout = group.layouts.first().ok_or("no image")?;
        let dims = layout.dims(slices.len()).ok_or_else(|| {
            format!("{}x{}x{} voxels are out of range", layout.columns, layout.rows, slices.len())
        })?;
        let description = SourceDescription {
            format: "dicom".into(),
            name: std::mem::take(&mut found.name),
            files: slices.len() as u64,
            bytes: dims.voxels() * layout.scalar().bytes() as u64,
        };
        let info = VolumeInfo {
            dims,
            scalar: if physical { ScalarType::F32 } else { layout.scalar() },
            rescale: if physical {
                Rescale::IDENTITY
            } else {
                Rescale { slope: shared.0, intercept: shared.1 }
            },
            spacing_mm: stack.affine.spacing_mm(),
            affine: stack.affine,
            description,
            warnings,
        };
        let files = FileSet::new(found.files.select(slices.iter().map(|s| s.file)));
        Ok(Self { info, files, layouts: group.layouts, paddings, slices: places, physical })
    }
}

impl VolumeSource for DicomVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let index = z as usize;
        let failed = |cause| SourceError::ReadFailed { path: self.files.list().path(index), slice: z, cause };
        check_request(&self.info, z, &rows, &cols, out.len()).map_err(failed)?;
        let found = self.slices.get(index).and_then(|place| {
            let padding = self.paddings.get(place.padding as usize).copied().flatten();
            Some((place, self.layouts.get(place.layout as usize)?, padding))
        });
        let Some((place, layout, padding)) = found else {
            return Err(failed(std::io::ErrorKind::InvalidInput.into()));
        };
        let width = layout.scalar().bytes();
        // Stored values wait in the tail of `out` when they have to grow to `f32`.
        let tail = if self.physical { out.len() - out.len() / 4 * width } else { 0 };
        let stored = out.get_mut(tail..).unwrap_or(&mut []);
        self.files
            .with(index, |f| read_block(f, place.offset, layout.columns, width, &rows, &cols, stored))
            .map_err(failed)?;
        layout.decode_padded(stored, padding);
        if self.physical {
            layout.widen(out, place.slope, place.intercept);
        }
        Ok(())
    }
}

/// Every group as a candidate; a group that repeats positions as its parts, where these do not.
fn judge(found: &Survey) -> Vec<Candidate> {
    let name = |file: usize| found.files.name(file).display().to_string();
    let mut candidates = Vec::new();
    for (at, group) in found.groups.iter().enumerate() {
        // Parts left to judge; each split has fewer images, so this ends.
        let mut parts = vec![(0..group.slices.len()).collect::<Vec<_>>()];
        while let Some(chosen) = parts.pop() {
            if chosen.is_empty() {
                continue;
            }
            let verdict = match assemble(group, &chosen, &name) {
                Ok(stack) => Ok(stack),
                Err(Refusal::Other(reason)) => Err(reason),
                Err(Refusal::Repeated(reason)) => {
                    let smaller = split(group, &chosen);
                    // Split into single images, nothing is gained.
                    if smaller.len() > 1 && smaller.iter().any(|part| part.len() > 1) {
                        parts.extend(smaller.into_iter().rev());
                        continue;
                    }
                    Err(reason)
                }
            };
            candidates.push(Candidate { group: at, chosen, verdict });
        }
    }
    candidates
}

/// The unreadable slice of the chosen group, or, when nothing is chosen, of any.
fn broken_of(found: &Survey, candidates: &[Candidate]) -> Option<(PathBuf, String)> {
    match candidates.first() {
        Some(best) => found.groups.get(best.group)?.broken.clone(),
        None => found.groups.iter().find_map(|g| g.broken.clone()),
    }
}

/// Sentence for inputs without any usable image.
fn nothing(found: &Survey) -> String {
    if found.files.len() == 0 {
        return "the folder holds no file".into();
    }
    let Some((reason, count, _)) = found.unusable.iter().max_by_key(|(_, count, _)| *count) else {
        return format!(
            "no DICOM image is among the {} file(s); for headerless voxels add --dims NXxNYxNZ and --dtype",
            found.files.len()
        );
    };
    if found.files.len() == 1 {
        return reason.clone();
    }
    let others: u64 = found.unusable.iter().map(|(_, n, _)| n).sum::<u64>() - count;
    let rest = if others > 0 {
        format!("; {others} other DICOM file(s) cannot be used either")
    } else {
        String::new()
    };
    format!("none of its images can be used; of {count} file(s): {reason}{rest}")
}

/// What was left out, and of what kind.
fn general_warnings(found: &Survey, candidates: &[Candidate]) -> Vec<String> {
    let mut warnings = Vec::new();
    if let [best, others @ ..] = candidates
        && !others.is_empty()
    {
        let mut list: Vec<String> = others.iter().take(NAMED).map(|c| c.describe(&found.groups)).collect();
        if others.len() > NAMED {
            list.push(format!("and {} more", others.len() - NAMED));
        }
        warnings.push(format!(
            "{} sets of images were found; the largest that forms a volume is used ({}); not used: {}",
            candidates.len(),
            best.describe(&found.groups),
            list.join("; ")
        ));
    }
    for (path, reason) in found.groups.iter().filter_map(|g| g.broken.as_ref()).take(NAMED) {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        warnings.push(format!("{name}, of a series that is not used: {reason}"));
    }
    for (reason, count, first) in found.unusable.iter().take(NAMED) {
        let name = first.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        warnings.push(format!("{count} DICOM file(s) left out: {reason} (first: {name})"));
    }
    if found.unusable.len() > NAMED {
        let rest: u64 = found.unusable.iter().skip(NAMED).map(|(_, n, _)| n).sum();
        warnings.push(format!("{rest} more DICOM file(s) left out for other reasons"));
    }
    if found.foreign > 0 {
        warnings.push(format!("{} file(s) that are no DICOM were left out", found.foreign));
    }
    warnings
}
