//! Files that are not built: their number by kind, and the list of all.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::log::{Log, Record};
use crate::platform::OsStrExt;
use crate::source::natural_cmp;
use crate::volume::{Result, SourceError};

/// Reason for leaving out a file or folder.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotVolume {
    /// A reason that no code distinguishes.
    #[error("{0}")]
    Said(Cow<'static, str>),
    #[error("{0}")]
    SideCar(String),
    #[error(
        "headerless voxels by its name, which lack a side-car: write NAME.json beside NAME.raw, or beside the folder NAME of slices, with {{\"dims\": [512, 512, 300], \"dtype\": \"u16\", \"spacing\": [0.5, 0.5, 1.0]}}"
    )]
    Headerless,
    #[error("not a volume")]
    Unknown,
    #[error("left out for other reasons")]
    Other,
}

/// A reason that no code distinguishes.
pub(super) fn said(reason: impl Into<Cow<'static, str>>) -> NotVolume {
    NotVolume::Said(reason.into())
}

/// Most reasons that are distinguished.
const MAX_REASONS: usize = 32;
/// Files left out up to which their names are sorted in memory.
const MAX_SORTED: u64 = 4096;

/// Files that are not volumes and no part of one: one line for each kind.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Reason for leaving them out.
    pub why: NotVolume,
    /// Number of files.
    pub count: u64,
    /// The first of them, in natural order.
    pub first: PathBuf,
}

/// Everything that was left out: summed up, and one by one on disk.
#[derive(Debug)]
pub(super) struct LeftOutFiles {
    kinds: Vec<LeftOut>,
    log: Log,
    /// Reasons of the kinds before they were sorted, by the number that a record has in place of the file's size.
    reasons: Vec<NotVolume>,
}

impl LeftOutFiles {
    pub(super) fn new(scratch: &Path) -> Self {
        Self { kinds: Vec::new(), log: Log::new(scratch), reasons: Vec::new() }
    }

    /// One line for each kind.
    pub(super) fn kinds(&self) -> &[LeftOut] {
        &self.kinds
    }

    /// Leaves out a file by its whole path; it is counted in any case.
    pub(super) fn add(&mut self, why: NotVolume, path: PathBuf) -> Result {
        let place_of = |why: &NotVolume| self.kinds.iter().position(|known| known.why == *why);
        // Offsets and counts can make many reasons; a bound keeps a folder of junk from piling them up.
        let is_new = place_of(&why).is_none();
        let why = if is_new && self.kinds.len() >= MAX_REASONS { NotVolume::Other } else { why };
        let at = place_of(&why).unwrap_or(self.kinds.len());
        let noted = self.log.push(&Record { size: at as u64, ..Record::of(0, &path) });
        match self.kinds.get_mut(at) {
            Some(known) => {
                known.count += 1;
                if natural_cmp(path.as_os_str().as_bytes(), known.first.as_os_str().as_bytes()).is_lt() {
                    known.first = path;
                }
            }
            None => self.kinds.push(LeftOut { why, count: 1, first: path }),
        }
        noted.map(drop)
    }

    /// Kinds by the number of their files, then in natural order of the first ones; called once, after all files.
    pub(super) fn sort(&mut self) {
        self.reasons = self.kinds.iter().map(|kind| kind.why.clone()).collect();
        crate::order::by(&mut self.kinds, |a, b| {
            let bytes = |l: &'_ LeftOut| l.first.clone().into_os_string();
            b.count.cmp(&a.count).then_with(|| natural_cmp(bytes(a).as_bytes(), bytes(b).as_bytes()))
        });
    }

    /// Every file with its reason, in the order in which they were met.
    fn all(&self) -> impl Iterator<Item = Result<(&NotVolume, PathBuf)>> + '_ {
        self.log.all().map(|record| {
            let record = record?;
            let why = usize::try_from(record.size).ok().and_then(|at| self.reasons.get(at));
            Ok((why.unwrap_or(&NotVolume::Other), record.path))
        })
    }

    /// Calls `each` for every file: in natural order, of very many in the order in which they were met.
    pub(super) fn for_each<E: From<SourceError>>(
        &self,
        each: &mut dyn FnMut(&NotVolume, &Path) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.kinds.iter().map(|kind| kind.count).sum::<u64>() > MAX_SORTED {
            return self.all().try_for_each(|file| {
                let (why, path) = file?;
                each(why, &path)
            });
        }
        let mut files = self.all().collect::<Result<Vec<_>, _>>()?;
        let bytes = |path: &PathBuf| path.clone().into_os_string();
        crate::order::by(&mut files, |a, b| natural_cmp(bytes(&a.1).as_bytes(), bytes(&b.1).as_bytes()));
        files.iter().try_for_each(|(why, path)| each(why, path))
    }
}
