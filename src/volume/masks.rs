//! Several masks of one grid as one map of labels, as segmentation tools write them: a file, or a segment, for each
//! part.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{
    ImageKind, Preparation, Rescale, Result, ScalarType, StatedLabel, VolumeInfo, VolumeSource, Workspace,
};
use crate::fault::{Fault, bad, usage};
use crate::geom::Dims;
use crate::text::Count;
use crate::text::names::{OVERLAP, VOLUME};
use crate::volume::Note;

/// Most masks that one map may be made of.
///
/// Each holds two open files, of which a process may have 1,024 where nothing else is set.
pub(crate) const MAX_MASKS: usize = 400;

/// Label of a voxel in several masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// The label of the first mask.
    First,
    /// The label of the last mask.
    #[default]
    Last,
    /// No label: overlapping masks are refused.
    Refuse,
}

/// A mask, and the label of the voxels in it.
pub(crate) struct MaskPart {
    pub(crate) source: Box<dyn VolumeSource>,
    pub(crate) label: StatedLabel,
}

/// Masks of one grid as labels; inside a mask are its samples above 0.
///
/// Memory: 64 KiB (or a row) for each thread, and that of the masks. Cost: each mask is read once more than the map
/// itself, to count overlaps.
pub(crate) struct Masks {
    info: VolumeInfo,
    parts: Vec<MaskPart>,
    /// Place of the first voxel of each mask.
    places: Vec<[u32; 3]>,
    overlap: Overlap,
    is_counted: bool,
}

/// Bytes of a mask that are read at a time.
const PART_BYTES: usize = 64 << 10;

/// Samples that are skipped together where all are 0.
const SEVERAL: usize = 64;

/// Greatest distance of the corners of two grids, in voxels.
const APART: f64 = 0.01;

impl Masks {
    /// The map of these masks, at least one.
    ///
    /// # Errors
    /// The masks lie on different grids, or are of different sizes; `segments`, which are parts of one file, may have
    /// sizes of their own.
    pub(crate) fn of(parts: Vec<MaskPart>, overlap: Overlap, segments: bool) -> Result<Self> {
        let Some(first) = parts.first().map(|part| part.source.info()) else {
            return Err(Fault::no_volume().into());
        };
        let mut ranges: Vec<[Range<i64>; 3]> = Vec::new();
        for part in &parts {
            let info = part.source.info();
            match range_on(first, info) {
                Some(range) if segments || range.iter().all(|r| r.start == 0) && info.dims == first.dims => {
                    ranges.push(range);
                }
                _ => {
                    let misuse = usage!(
                        "lies on another grid than {}; masks of one grid become one map of labels: give those, or choose a volume with {VOLUME} N",
                        first.description.name
                    );
                    return Err(misuse.at(path_of(info)).into());
                }
            }
        }
        let low: [i64; 3] = std::array::from_fn(|a| ranges.iter().map(|r| r[a].start).min().unwrap_or(0));
        let side = |a: usize| ranges.iter().map(|r| r[a].end).max().unwrap_or(0) - low[a];
        let dims = match [side(0), side(1), side(2)].map(|side| u32::try_from(side).ok()) {
            [Some(nx), Some(ny), Some(nz)] => Dims::new(nx, ny, nz),
            _ => None,
        };
        let Some(dims) = dims else {
            let misuse = usage!(
                "lies on another grid than {}; masks of one grid become one map of labels: give those, or choose a volume with {VOLUME} N",
                first.description.name
            );
            return Err(misuse.at(path_of(first)).into());
        };
        let mut info =
            VolumeInfo { dims, scalar: ScalarType::U16, rescale: Rescale::IDENTITY, ..first.clone() };
        let origin = first.affine.apply(low.map(|c| c as f64));
        for (row, at) in info.affine.rows.iter_mut().zip(origin) {
            row[3] = at;
        }
        let places =
            ranges.iter().map(|r| std::array::from_fn(|a| u32::try_from(r[a].start - low[a]).unwrap_or(0)));
        let places = places.collect();
        info.description.labels = parts.iter().map(|part| part.label.clone()).collect();
        if let ImageKind::Series { part, .. } = &mut info.description.kind {
            part.clear();
        }
        info.description.files = parts.iter().map(|part| part.source.info().description.files).sum();
        info.description.bytes = parts.iter().map(|part| part.source.info().description.bytes).sum();
        // Each mask has the same notes.
        info.notes = parts.iter().flat_map(|part| part.source.info().notes.clone()).fold(
            Vec::new(),
            |mut kept, note| {
                if !kept.contains(&note) {
                    kept.push(note);
                }
                kept
            },
        );
        Ok(Self { info, parts, places, overlap, is_counted: false })
    }

    /// Calls `found` with the samples of a block of the map that are inside a mask, counted row by row. Gives the first
    /// of their values, and another one if they differ.
    fn for_each_inside(
        &self,
        number: usize,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        mut found: impl FnMut(usize),
    ) -> Result<Option<[f64; 2]>> {
        let (Some(MaskPart { source, .. }), Some(place)) = (self.parts.get(number), self.places.get(number))
        else {
            return Ok(None);
        };
        let info = source.info();
        let [nx, ny, nz] = info.dims.to_array();
        let within = |r: &Range<u32>, a: usize, side: u32| {
            let end = place[a] + side;
            r.start.clamp(place[a], end) - place[a]..r.end.clamp(place[a], end) - place[a]
        };
        let (own_cols, own_rows) = (within(&cols, 0, nx), within(&rows, 1, ny));
        if own_cols.is_empty() || own_rows.is_empty() || z < place[2] || z - place[2] >= nz {
            return Ok(None);
        }
        // Index in the block of the first sample of the mask, and of any other.
        let stride = cols.len();
        let first = ((own_rows.start + place[1] - rows.start) as usize) * stride
            + (own_cols.start + place[0] - cols.start) as usize;
        let width = own_cols.len();
        let mut found = |at: usize| found(first + at / width * stride + at % width);
        let (z, rows, cols) = (z - place[2], own_rows, own_cols);
        let (scalar, rescale) = (info.scalar, info.rescale);
        let row_bytes = cols.len() * scalar.bytes();
        let at_once = u32::try_from((PART_BYTES / row_bytes.max(1)).max(1)).unwrap_or(1);
        let mut bytes = vec![0; row_bytes * (at_once as usize).min(rows.len())];
        let (mut at, mut values) = (0, None);
        let air = rescale.apply(0.0) <= 0.0;
        let mut start = rows.start;
        while start < rows.end {
            let end = rows.end.min(start.saturating_add(at_once));
            let part = &mut bytes[..row_bytes * (end - start) as usize];
            source.read_rows(z, start..end, cols.clone(), part)?;
            for several in part.chunks(SEVERAL * scalar.bytes()) {
                // Most of a mask is empty.
                if air && several.iter().all(|byte| *byte == 0) {
                    at += several.len() / scalar.bytes();
                    continue;
                }
                for sample in several.chunks_exact(scalar.bytes()) {
                    let value = rescale.apply(scalar.value(sample));
                    if value > 0.0 {
                        found(at);
                        let [first, other] = values.get_or_insert([value; 2]);
                        *other = if value == *first { *other } else { value };
                    }
                    at += 1;
                }
            }
            start = end;
        }
        Ok(values)
    }

    /// Bytes that are held while overlaps are counted.
    fn held_bytes(&self) -> u64 {
        u64::from(self.info.dims.nx()) * u64::from(ROWS)
    }

    /// Number of voxels in several masks, and true if every mask has one value.
    fn count_overlaps(&self, workspace: &Workspace<'_>) -> Result<u64> {
        let [nx, ny, nz] = self.info.dims.to_array();
        let _reserved = workspace.reserve(self.held_bytes(), || path_of(&self.info))?;
        let mut held = vec![0_u8; nx as usize * ROWS as usize];
        let mut values = vec![None; self.parts.len()];
        let mut overlaps = 0;
        workspace.progress.stage("masks", nz.into());
        for z in 0..nz {
            for low in (0..ny).step_by(ROWS as usize) {
                let rows = low..ny.min(low + ROWS);
                held.fill(0);
                for (number, known) in values.iter_mut().enumerate() {
                    let count = |at: usize| held[at] = held[at].saturating_add(1);
                    let found = self.for_each_inside(number, z, rows.clone(), 0..nx, count)?;
                    let Some(found) = found else { continue };
                    let one = *known.get_or_insert(found[0]);
                    if let Some(other) = found.into_iter().find(|value| *value != one) {
                        let fault = bad!(
                            "holds the values {one} and {other}, where a mask has one; build it alone, or choose it with {VOLUME} N"
                        );
                        let path = path_of(self.parts[number].source.info());
                        return Err(fault.at(path).into());
                    }
                }
                overlaps += held.iter().filter(|count| **count > 1).count() as u64;
            }
            workspace.progress.step(1)?;
        }
        Ok(overlaps)
    }
}

/// Notes the voxels that several masks, or layers, hold.
///
/// # Errors
/// There are such voxels, and they are to be refused.
pub(crate) fn settle_overlaps(info: &mut VolumeInfo, voxels: u64, overlap: Overlap) -> Result {
    if voxels > 0 && overlap == Overlap::Refuse {
        return Err(usage!(
            "several masks share {}; choose which mask wins with {OVERLAP} first or last",
            Count(voxels, "voxel")
        )
        .at(path_of(info))
        .into());
    }
    if voxels > 0 {
        info.notes.push(Note::new(format!(
            "several masks share {}; the {} of these masks wins there",
            Count(voxels, "voxel"),
            if overlap == Overlap::First { "first" } else { "last" }
        )));
    }
    Ok(())
}

/// Rows of a slice in which overlaps are counted at a time.
const ROWS: u32 = 64;

/// The input of a volume, as messages name it.
fn path_of(info: &VolumeInfo) -> PathBuf {
    PathBuf::from(&info.description.name)
}

/// The range of the first volume's grid that another volume covers, which may begin before it and end beyond it; `None`
/// where the grids do not match.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a whole number of voxels, and compared with the place itself"
)]
fn range_on(first: &VolumeInfo, other: &VolumeInfo) -> Option<[Range<i64>; 3]> {
    let onto = first.affine.inverse()?.after(&other.affine);
    let sides = other.dims.to_array().map(i64::from);
    let start = onto.apply([0.0; 3]).map(|c| c.round().clamp(-1e6, 1e6) as i64);
    let is_at = (0..8).all(|corner| {
        let of = |a: usize| if corner >> a & 1 == 1 { sides[a] } else { 0 };
        let at = onto.apply([0, 1, 2].map(|a| of(a) as f64));
        (0..3).all(|a| (at[a] - (start[a] + of(a)) as f64).abs() <= APART)
    });
    is_at.then(|| std::array::from_fn(|a| start[a]..start[a] + sides[a]))
}

impl VolumeSource for Masks {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn modality(&self) -> Option<&str> {
        self.parts.first().and_then(|part| part.source.modality())
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.parts.iter().for_each(|part| part.source.for_each_file(each));
    }

    fn check_unchanged(&self) -> Result {
        self.parts.iter().try_for_each(|part| part.source.check_unchanged())
    }

    fn preparation(&self) -> Preparation {
        let own = if self.is_counted { 0 } else { self.held_bytes() };
        let start = Preparation { memory_bytes: own, ..Preparation::default() };
        self.parts.iter().map(|part| part.source.preparation()).fold(start, |all, one| Preparation {
            scratch_bytes: all.scratch_bytes + one.scratch_bytes,
            memory_bytes: all.memory_bytes.max(one.memory_bytes),
            on_demand: false,
        })
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        if self.is_counted {
            return Ok(());
        }
        for part in &mut self.parts {
            part.source.prepare(workspace)?;
        }
        let voxels = self.count_overlaps(workspace)?;
        self.is_counted = true;
        settle_overlaps(&mut self.info, voxels, self.overlap)
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        out.fill(0);
        let labels = out.as_chunks_mut::<2>().0;
        for (number, part) in self.parts.iter().enumerate() {
            self.for_each_inside(number, z, rows.clone(), cols.clone(), |at| {
                if let Some(label) = labels.get_mut(at)
                    && (self.overlap != Overlap::First || *label == [0; 2])
                {
                    label.copy_from_slice(bytemuck::bytes_of(&part.label.number));
                }
            })?;
        }
        Ok(())
    }

    fn resident_bytes(&self) -> u64 {
        let own = (PART_BYTES as u64).max(u64::from(self.info.dims.nx()) * 8);
        own + self.parts.iter().map(|part| part.source.resident_bytes()).max().unwrap_or(0)
    }
}
