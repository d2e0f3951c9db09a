//! Discovery of every volume, mesh and tree of solids at a path or below some folders, with the reason where one
//! cannot be used.
//!
//! Surveying reads headers only. A [`Catalogue`] holds some 50 bytes per item in memory (a DICOM series,
//! a volume file, a stack of pictures); the names of the files wait in an anonymous scratch file, chained
//! per item. An item is opened when it is its turn, so that a disk full of studies needs no more memory
//! than its largest series: some 400 bytes for each of its images while it is opened, a third of that after.
//!
//! | file | what it holds |
//! |---|---|
//! | `kind` | volume, mesh or tree, by content |
//! | `open` | [`Subject::open`](crate::Subject::open), and the choice of a volume among some inputs |
//! | `walk`, `surveyor` | folders entry by entry; the kind of each file, and its item |
//! | `item` | series, stacks and files, and their opening |
//! | `content` | names and copies by content |
//! | `sidecar`, `placing` | texts that describe headerless voxels, or place others |
//! | `left_out` | files that are not built |
//! | `log`, `order` | names of files on disk; the order of items |

mod content;
mod item;
mod kind;
mod left_out;
mod log;
mod open;
mod order;
mod placing;
mod sidecar;
mod surveyor;
mod walk;

pub use left_out::LeftOut;
pub(crate) use left_out::NotVolume;
use open::join_segments;
pub(crate) use open::open_unprepared_in;
pub use open::{open, open_unprepared};

use std::path::{Path, PathBuf};

use crate::identity::file_identity;
use crate::source::{Finding, InputFiles, OpenOptions, STACKS, StableHash};
use crate::text::names::ALL_VOLUMES;
use crate::volume::{FileWatch, InfoOverride, Note, Result, SourceError, StatedBy, VolumeSource, place};
use content::{hash_of, is_copy};
use item::{Item, ItemKind, Name, changed_meanwhile};
use left_out::LeftOutFiles;
use log::Log;
use order::{full_path, precedes, sort_or_stop};
use surveyor::Surveyor;
use walk::{walk, without_repeats};

/// All items below some inputs.
#[derive(Debug)]
pub struct Catalogue {
    inputs: Vec<PathBuf>,
    items: Vec<Item>,
    log: Log,
    left_out: LeftOutFiles,
    options: OpenOptions,
}

/// Volumes of one input that are alike, and are all taken; echoes, phases and the like are fewer.
const MAX_ALIKE: usize = 16;

/// Depth to which the folders below an input are searched by default: enough for every archive, and an end for a file
/// system that contains itself.
const DEPTH: u32 = 16;

impl Catalogue {
    /// Searches the inputs: files are taken as they are, and descriptions of [`synthetic`](crate::synthetic) volumes;
    /// folders are searched with all levels below them (hidden entries are left out, and links to folders). The result
    /// does not depend on the order in which a folder lists its files.
    ///
    /// # Errors
    /// An input cannot be read at all or describes nothing, or `scratch` cannot hold the data that does not fit into
    /// memory.
    pub fn survey(inputs: &[PathBuf], options: &OpenOptions, scratch: &Path) -> Result<Self> {
        Self::survey_to_depth(inputs, options, scratch, DEPTH)
    }

    /// Like [`Catalogue::survey`], but folders are entered `depth` levels deep only.
    ///
    /// # Errors
    /// The errors of [`Catalogue::survey`].
    pub(crate) fn survey_to_depth(
        inputs: &[PathBuf],
        options: &OpenOptions,
        scratch: &Path,
        depth: u32,
    ) -> Result<Self> {
        let inputs = without_repeats(inputs)?;
        let mut surveyor = Surveyor::new(&inputs, options, scratch);
        walk(&inputs, depth, options.follow_links, &mut surveyor)?;
        let Surveyor { items, log, left_out, .. } = surveyor;
        let mut found = Self { inputs, items, log, left_out, options: options.clone() };
        found.leave_single_pictures()?;
        found.sort()?;
        found.items.shrink_to_fit();
        found.log.shrink();
        Ok(found)
    }

    /// Number of items; each may hold several volumes.
    pub fn len(&self) -> usize {
        self.items.len()
    }

    /// True if nothing was found.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// The volumes of item `index`, refused ones included; none for an index out of range.
    ///
    /// Cost: headers, and some 256 KiB of the content of other formats than DICOM, which names them.
    pub fn open(&self, index: usize) -> Vec<Finding> {
        let findings = self.open_named(index, &|format, files| match hash_of(files) {
            Ok(hash) => format!("{format}-{hash}"),
            // An unreadable input is not built: its name only has to distinguish it from others in reports.
            Err(_) => format!("{format}-unreadable-{}", index + 1),
        });
        self.gathered(findings)
    }

    /// The segments of a segmentation as one map, if masks are taken together, and the first of very many volumes of one
    /// input that are alike, unless all are wanted: a functional study has five hundred.
    fn gathered(&self, findings: Vec<Finding>) -> Vec<Finding> {
        let findings = match self.options.masks {
            Some(overlap) => join_segments(findings, overlap),
            None => findings,
        };
        if self.options.all_volumes || findings.len() <= MAX_ALIKE {
            return findings;
        }
        let alike = |a: &Finding, b: &Finding| (a.format, &a.kind, a.size) == (b.format, &b.kind, b.size);
        let mut kept: Vec<(Finding, Vec<Finding>)> = Vec::new();
        for mut finding in findings {
            match kept.iter_mut().find(|(known, _)| alike(known, &finding)) {
                None => kept.push((finding, Vec::new())),
                Some((known, others)) => {
                    // The first that can be used stands for all of them.
                    if known.subject.is_err() && finding.subject.is_ok() {
                        std::mem::swap(known, &mut finding);
                    }
                    others.push(finding);
                }
            }
        }
        let mut all: Vec<Finding> = Vec::new();
        for (finding, others) in kept {
            if others.len() < MAX_ALIKE {
                all.push(finding);
                all.extend(others);
                continue;
            }
            let more = others.len();
            let note = Note::new(format!(
                "this is the first of {} similar volumes; {ALL_VOLUMES} also takes the others",
                more + 1
            ));
            let noted = |source| Ok(InfoOverride::with_note(source, note));
            let subject = finding.subject.and_then(|subject| subject.map_volume(noted));
            all.push(Finding { subject, more, ..finding });
        }
        crate::order::by_key(&mut all, |finding| finding.at);
        all
    }

    /// Like [`Catalogue::open`], without names: only headers are read.
    fn open_unnamed(&self, index: usize) -> Vec<Finding> {
        self.open_named(index, &|format, _| format.to_owned())
    }

    fn open_named(&self, index: usize, name: Name<'_>) -> Vec<Finding> {
        let Some(item) = self.items.get(index) else { return Vec::new() };
        let refused = |(path, error): (PathBuf, SourceError)| {
            let id = name("unknown", &|each| each(&path));
            vec![Finding::new(&path, "unknown", id, InputFiles::default(), Err(error))]
        };
        let before = self.stamp(item);
        let opened = self.open_item(item, name).unwrap_or_else(refused);
        let mut findings: Vec<Finding> = opened.into_iter().map(watched).collect();
        // From here on the volumes watch their files themselves.
        let has_changed = self.stamp(item) != before;
        for (at, finding) in findings.iter_mut().enumerate() {
            finding.at = at;
            if has_changed && finding.subject.is_ok() {
                finding.subject = Err(changed_meanwhile(&finding.path));
            }
            if finding.id.is_empty() {
                // Images that have become unreadable do not name their series.
                finding.id = name(finding.format, &|each| each(&finding.path));
            }
        }
        if !self.options.placement.is_empty() && self.options.raw.is_none() {
            let asked = self.options.placement;
            let placed = |f| with_volume(f, |_, volume| place(volume, asked, StatedBy::Caller));
            findings = findings.into_iter().map(placed).collect();
        }
        findings
    }

    /// True if a volume is a copy of the volume `part` of item `index`, byte for byte and placed alike.
    ///
    /// Cost: that item is opened again, and all files of both are read, up to the first difference. An unreadable
    /// volume is not a copy.
    pub(crate) fn is_copy(&self, finding: &Finding, (index, part): (usize, usize)) -> bool {
        let mut others = self.gathered(self.open_unnamed(index)).into_iter();
        others.nth(part).is_some_and(|other| is_copy(finding, &other).unwrap_or(false))
    }

    /// Approximate memory that opening item `index` takes for a moment; a third of it stays while its volumes are held.
    pub fn opening_bytes(&self, index: usize) -> u64 {
        self.items.get(index).map_or(0, |item| item.weight.opening_bytes)
    }

    /// Bounds the memory that [`Catalogue::open`] may take for a moment; items that need more are refused.
    pub(crate) fn allow_opening(&mut self, bytes: u64) {
        self.options.opening_bytes = Some(bytes);
    }

    /// Files that are left out, summed up.
    pub fn left_out(&self) -> &[LeftOut] {
        self.left_out.kinds()
    }

    /// Calls `each` for every file that is left out, with its reason: in natural order of their paths, of very many
    /// in the order in which they were met.
    ///
    /// # Errors
    /// The list is on disk and cannot be read, or `each` fails.
    pub fn for_each_left_out<E: From<SourceError>>(
        &self,
        each: &mut dyn FnMut(&NotVolume, &Path) -> Result<(), E>,
    ) -> Result<(), E> {
        self.left_out.for_each(each)
    }

    /// Identity of an item's files; differs when one of them does.
    fn stamp(&self, item: &Item) -> u64 {
        // A log that cannot be read is reported where the item is opened.
        let records = self.log.chain(item.last).filter_map(Result::ok);
        let stamps = records.map(|record| file_identity(&full_path(&self.inputs, &record)));
        stamps.fold(StableHash::new(), StableHash::number).finish()
    }

    /// One picture alone in a folder is not a stack, unless it was given by name.
    fn leave_single_pictures(&mut self) -> Result {
        let mut kept = Vec::with_capacity(self.items.len());
        for item in &self.items {
            if let ItemKind::Stack(at) = item.what
                && item.files == 1
            {
                let record = self.log.get(item.first)?;
                let path = full_path(&self.inputs, &record);
                let is_whole = STACKS.get(usize::from(at)).is_some_and(|format| (format.is_whole)(&path));
                if !record.path.as_os_str().is_empty() && !is_whole {
                    self.left_out.add(left_out::said("single picture, no stack"), path)?;
                    continue;
                }
            }
            kept.push(*item);
        }
        self.items = kept;
        Ok(())
    }

    /// Items in natural order of their first paths, kinds of left-out files by their number, then in the same way.
    fn sort(&mut self) -> Result {
        let (log, inputs) = (&self.log, &self.inputs);
        sort_or_stop(&mut self.items, |a, b| {
            Ok::<_, SourceError>(precedes(inputs, &log.get(a.first)?, &log.get(b.first)?))
        })?;
        self.left_out.sort();
        Ok(())
    }
}

/// A finding with another volume in place of its own.
fn with_volume(
    finding: Finding,
    change: impl FnOnce(&Path, Box<dyn VolumeSource>) -> Result<Box<dyn VolumeSource>>,
) -> Finding {
    let path = &finding.path;
    let subject = finding.subject.and_then(|subject| subject.map_volume(|volume| change(path, volume)));
    Finding { subject, ..finding }
}

/// A finding whose volume notices a change of its files, of a header among them.
fn watched(finding: Finding) -> Finding {
    with_volume(finding, |path, volume| {
        Ok(FileWatch::files(volume, Some(path).filter(|path| path.is_file())))
    })
}
