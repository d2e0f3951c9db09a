//! A label map as a solid, walls between neighbours included, in one pass.
//!
//! ```text
//!   slices --read--> numbers of labels (ring) --> cells between labels, fitted one by one (cells, fit)
//! ```
//!
//! [`worker_bytes`] states the memory.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

mod cells;
mod fit;
mod ring;
mod wall;

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use super::cells::cell_dims;
use super::error::BuildError;
use super::item::ItemForm;
use super::options::BuildOptions;
use super::report::BuildNote;
use super::solid::{ScanSummary, Solid, SolidWorker, Tile};
use super::volume::metadata_of;
use crate::builder::BuildFault;
use crate::format::{
    Channel, LABEL_BYTES, Label, LabelName, MAX_LABELS, Metadata, Selection, SelectionKind, SurfaceKind,
    WALL_BYTES,
};
use crate::geom::Dims;
use crate::text::names::{ISO, NAMES, PRESET, RANGE};
use crate::text::{Short, nearest, shown};
use crate::volume::{SourceError, StatedLabel, VolumeSource};

use crate::fault::{Fault, bad, unfit, usage};
use cells::CellWorker;
pub(super) use cells::worker_bytes;
pub(super) use fit::mask_plane;
use ring::ConvertRow;
pub use wall::MAX_SMOOTH;
pub(super) use wall::Members;

/// The labels of a volume that a model is built of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LabelChoice {
    /// Every number but 0.
    All,
    /// Numbers in these ranges, both ends included.
    Only(Vec<[u16; 2]>),
    /// Numbers and ranges as text, and names of the table or of the input, in any case of letters.
    Named(Vec<String>),
}

/// The range that a number or a range stands for.
fn range_of(text: &str) -> Option<[u16; 2]> {
    let number = |text: &str| text.trim().parse().ok().filter(|n| *n > 0);
    match text.split_once("..") {
        Some((lo, hi)) => number(lo).zip(number(hi)).filter(|(lo, hi)| lo <= hi).map(|(lo, hi)| [lo, hi]),
        None => number(text).map(|n| [n, n]),
    }
}

impl LabelChoice {
    /// True if this number is chosen, by number.
    pub fn contains(&self, number: u16) -> bool {
        match self {
            Self::All => number > 0,
            Self::Only(ranges) => ranges.iter().any(|[lo, hi]| (*lo..=*hi).contains(&number)),
            Self::Named(parts) => {
                parts.iter().filter_map(|part| range_of(part)).any(|[lo, hi]| (lo..=hi).contains(&number))
            }
        }
    }

    /// The choice by numbers.
    ///
    /// # Errors
    /// A label has no such name.
    fn by_number(&self, names: &[LabelName]) -> Result<Cow<'_, Self>, Fault> {
        let Self::Named(parts) = self else { return Ok(Cow::Borrowed(self)) };
        let mut ranges = Vec::new();
        for part in parts {
            let before = ranges.len();
            let named = names.iter().filter(|label| label.name.to_lowercase() == part.to_lowercase());
            ranges.extend(range_of(part).into_iter().chain(named.map(|label| [label.number; 2])));
            if ranges.len() == before {
                let near = nearest(part, names.iter().map(|label| (&*label.name, &*label.name)));
                return Err(match near {
                    _ if names.is_empty() => {
                        usage!("has no names of labels; give a table of them ({NAMES}), or choose by numbers")
                    }
                    Some(near) => {
                        usage!("has no label named '{}'; did you mean '{}'?", shown(part), shown(near))
                    }
                    None => usage!(
                        "has no label named '{}'; give another name of its table, or a number",
                        shown(part)
                    ),
                });
            }
        }
        Ok(Cow::Owned(Self::Only(ranges)))
    }
}

/// Parses `all`, or a list such as `1,5,7..20,liver`.
impl FromStr for LabelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        let parts = || text.split(',').map(str::trim);
        if let Some(ranges) = parts().map(range_of).collect() {
            return Ok(Self::Only(ranges));
        }
        let is_name = |part: &str| part.starts_with(char::is_alphabetic) && part != "all";
        if parts().all(|part| range_of(part).is_some() || is_name(part)) {
            return Ok(Self::Named(parts().map(str::to_owned).collect()));
        }
        Err(format!(
            "'{text}' does not name labels; write all, or numbers from 1 to 65535 and names as 1,5,7..20,liver"
        ))
    }
}

/// The form of a channel's items; `None` for channels that labels lack.
pub(super) fn label_form(channel: Channel) -> Option<ItemForm> {
    let bytes = match channel {
        Channel::Normal => 2,
        Channel::Offset => 1,
        Channel::Corners => WALL_BYTES,
        Channel::Label => LABEL_BYTES,
        _ => return None,
    };
    Some(ItemForm::AsIs { bytes })
}

/// Names and colours of a table, or of the input if the table is empty.
fn names<'a>(table: &'a [LabelName], stated: &[StatedLabel]) -> Cow<'a, [LabelName]> {
    if !table.is_empty() {
        return Cow::Borrowed(table);
    }
    let of = |StatedLabel { number, name, color, .. }: &StatedLabel| LabelName {
        number: *number,
        name: name.clone(),
        color: *color,
    };
    stated.iter().map(of).collect()
}

/// The solid of the chosen labels.
///
/// # Errors
/// The options ask for something that labels lack.
pub(super) fn label_solid<'a>(
    source: &'a dyn VolumeSource,
    choice: &'a LabelChoice,
    options: &'a BuildOptions,
) -> Result<Box<dyn Solid + 'a>, BuildError> {
    let refused = options.labels_refused();
    if let Some(asked) = refused {
        let name = source.info().description.name.clone();
        return Err(BuildFault::Said {
            name,
            fault: usage!("a label model does not support {asked} yet; leave it out"),
        }
        .into());
    }
    let info = source.info();
    let dims = cell_dims(info.dims).ok_or_else(|| {
        let name = info.description.name.clone();
        BuildFault::no_room_for_cells(name)
    })?;
    let names = names(&options.label_names, &info.description.labels);
    let choice = choice
        .by_number(&names)
        .map_err(|fault| BuildFault::Said { name: info.description.name.clone(), fault })?;
    let solid = LabelSolid {
        source,
        dims,
        choice,
        names,
        smooth: options.smooth,
        convert: by_type!(info.scalar, T => ring::convert::<T>),
        counts: Mutex::default(),
    };
    Ok(Box::new(solid))
}

fn not_label(value: f64, labels: &str) -> Fault {
    bad!(
        "holds the value {value}, and labels are {labels}; the surface of a scan is chosen by {ISO}, {RANGE} or {PRESET}"
    )
}

/// A label and its number of voxels.
type Count = (u16, u64);

struct LabelSolid<'a> {
    source: &'a dyn VolumeSource,
    /// Cells along each axis.
    dims: Dims,
    /// By number.
    choice: Cow<'a, LabelChoice>,
    names: Cow<'a, [LabelName]>,
    /// [`BuildOptions::smooth`]
    smooth: f64,
    /// Row conversion for the file's sample type: so solid and worker are compiled once.
    convert: ConvertRow,
    /// Counts of all finished workers, by number.
    counts: Mutex<Vec<Count>>,
}

impl LabelSolid<'_> {
    fn wrong(&self, fault: Fault) -> SourceError {
        let path = PathBuf::from(&self.source.info().description.name);
        fault.at(path).into()
    }

    /// The label of a sample; 0 for none.
    #[cold]
    fn label_of(&self, sample: f64) -> Result<u16, SourceError> {
        let value = self.source.info().rescale.apply(sample);
        if value.fract() != 0.0 {
            return Err(self.wrong(not_label(value, "whole numbers")));
        }
        let number = if (0.0..=65_535.0).contains(&value) { Some(value as u16) } else { None };
        match (&*self.choice, number) {
            (LabelChoice::All, None) => {
                Err(self.wrong(not_label(value, "numbers from 1 to 65535, 0 for none")))
            }
            (choice, Some(number)) if choice.contains(number) => Ok(number),
            _ => Ok(0),
        }
    }

    fn counted(&self) -> std::sync::MutexGuard<'_, Vec<Count>> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Solid for LabelSolid<'_> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn surface(&self) -> SurfaceKind {
        SurfaceKind::Cells
    }

    fn lookbehind(&self) -> u32 {
        cells::AROUND.low
    }

    fn metadata(&self, _: &ScanSummary) -> Metadata {
        let found = self.counted();
        let ends = found.first().zip(found.last()).map_or((1, u16::MAX), |(first, last)| (first.0, last.0));
        let selection = Selection { kind: SelectionKind::Range, lo: ends.0.into(), hi: ends.1.into() };
        let gradient = if self.smooth < MAX_SMOOTH {
            format!("{} within {} voxel", cells::ESTIMATOR, Short(self.smooth))
        } else {
            cells::ESTIMATOR.into()
        };
        metadata_of(self.source.info(), selection, gradient)
    }

    fn name(&self) -> String {
        self.source.info().description.name.clone()
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        label_form(channel)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        worker_bytes(self.source.info(), tile)
    }

    fn input_bytes(&self) -> u64 {
        self.source.resident_bytes()
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(CellWorker::new(self, tile))
    }

    fn labels(&self) -> Result<Vec<Label>, BuildError> {
        let found = self.counted();
        if found.len() > MAX_LABELS {
            return Err(BuildFault::Source(
                self.wrong(bad!("holds more than {MAX_LABELS} labels; choose some of them")),
            )
            .into());
        }
        let label = |(number, voxels): &Count| {
            let stated = self.names.iter().find(|stated| stated.number == *number);
            Label {
                number: *number,
                name: stated.map_or_else(String::new, |stated| stated.name.clone()),
                color: stated.and_then(|s| s.color).unwrap_or_else(|| Label::default_color(*number)),
                voxels: *voxels,
            }
        };
        Ok(found.iter().map(label).collect())
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.source.for_each_file(each);
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.source.check_unchanged()
    }

    /// Notes a table that names other labels only, or the first label without voxels that was requested or has a name.
    fn note(&self) -> Option<BuildNote> {
        let (found, names) = (self.counted(), &self.names);
        let is_found = |named: &LabelName| found.binary_search_by_key(&named.number, |count| count.0).is_ok();
        if !names.is_empty() && !names.iter().any(is_found) {
            return Some(BuildNote::LabelsUnnamed { named: names.len() });
        }
        let LabelChoice::Only(ranges) = &*self.choice else {
            let mut absent = names.iter().filter(|named| !is_found(named));
            let first = absent.next()?.number;
            return Some(BuildNote::NamesAbsent { first, others: absent.count() });
        };
        let is_there = |[lo, hi]: &[u16; 2]| found.iter().any(|(number, _)| (*lo..=*hi).contains(number));
        let mut absent = ranges.iter().filter(|range| !is_there(range));
        let first = absent.next()?[0];
        Some(BuildNote::LabelsAbsent { first, others: absent.count() })
    }

    fn nothing_inside(&self) -> BuildError {
        BuildFault::Said {
            name: self.name(),
            fault: unfit!("no voxel has one of the labels asked for; choose others, or all of them"),
        }
        .into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{RawOptions, RawVolume};

    #[test]
    fn files_of_the_volume_are_files_of_the_solid() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("labels.raw");
        std::fs::write(&path, [1; 8]).unwrap();
        let volume = RawVolume::open(std::slice::from_ref(&path), &RawOptions::small()).unwrap();
        let options = BuildOptions { labels: Some(LabelChoice::All), ..BuildOptions::default() };
        let solid = label_solid(&volume, &LabelChoice::All, &options).unwrap();
        let mut files = Vec::new();
        solid.for_each_file(&mut |file| files.push(file.to_path_buf()));
        assert_eq!(files, [path]);
    }

    #[test]
    fn labels_are_chosen_by_number_and_range() {
        assert_eq!("all".parse(), Ok(LabelChoice::All));
        let some: LabelChoice = "1, 5,7..20".parse().unwrap();
        assert_eq!(some, LabelChoice::Only(vec![[1, 1], [5, 5], [7, 20]]));
        let named: LabelChoice = "5, Liver".parse().unwrap();
        let name = |number, name: &str| LabelName { number, name: name.into(), color: None };
        let table = [name(3, "liver"), name(9, "spleen"), name(4, "liver")];
        assert_eq!(*named.by_number(&table).unwrap(), LabelChoice::Only(vec![[5, 5], [3, 3], [4, 4]]));
        for (names, told) in
            [(&table[..], "did you mean 'liver'"), (&table[1..2], "another name"), (&[], "no names")]
        {
            let fault = "livre".parse::<LabelChoice>().unwrap().by_number(names).unwrap_err();
            assert!(fault.text.contains(told), "{}", fault.text);
        }
        let chosen: Vec<u16> = (0..40).filter(|n| some.contains(*n)).collect();
        assert_eq!(chosen, [1, 5].into_iter().chain(7..=20).collect::<Vec<_>>());
        for wrong in ["", "0", "1,", "5..3", "-1", "1.5", "65536", "liver,", "all,1", "1...", "_a"] {
            assert!(wrong.parse::<LabelChoice>().is_err(), "{wrong}");
        }
    }
}
