//! Facts of the whole volume that parts need, found share by share: every stage has a file for each share and one for
//! all of them, which holds the combined result.
//!
//! ```text
//! extremes (samples of more than 16 bits) --> histogram --> the threshold of Otsu's method --+--> parts
//!                                                                    occupancy --> cleaning --+
//! ```
//!
//! A file, little-endian: magic, digest of the plan, stage, number and count of the shares, the words of the finding,
//! the CRC of all that. Words are counts, or the bits of numbers, so that values are never rounded.

use std::fmt;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::cut::PartId;
use super::fault::PartFault;
use super::read::at;
use crate::atomic::AtomicFile;
use crate::builder::choose::Chooser;
use crate::builder::error::{BuildError, BuildFault};
use crate::builder::extremes::Extremes;
use crate::builder::histogram::{BINS, Tally, needs_extremes};
use crate::builder::parallel::Share;
use crate::builder::report::BuildNote;
use crate::format::{Selection, SelectionKind};
use crate::platform::PositionalFile;
use crate::volume::ScalarType;

const MAGIC: [u8; 8] = *b"\x89OSTAGE\n";
/// Number of the file of all shares.
const WHOLE: u32 = u32::MAX;
pub(super) const HEAD_BYTES: usize = 8 + 32 + 4 + 4 + 4;
/// Length limit of a file.
const MAX_BYTES: u64 = (HEAD_BYTES + 8 * (64 + 2 * BINS) + 4) as u64;

/// Kinds of selections, by their numbers in a file.
const KINDS: [SelectionKind; 3] = [SelectionKind::Iso, SelectionKind::Otsu, SelectionKind::Range];

/// A stage before the parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The least and the greatest sample.
    Extremes,
    /// The counts of all samples, from which the threshold follows.
    Histogram,
    /// One bit a voxel, the input of cleaning.
    Occupancy,
}

impl Stage {
    /// The stages of Otsu's method, in their order.
    pub(crate) fn of_otsu(scalar: ScalarType) -> &'static [Self] {
        if needs_extremes(scalar) { &[Self::Extremes, Self::Histogram] } else { &[Self::Histogram] }
    }

    /// Name of the stage.
    pub fn name(self) -> &'static str {
        match self {
            Self::Extremes => "extremes",
            Self::Histogram => "histogram",
            Self::Occupancy => "occupancy",
        }
    }

    /// The file of a share in the folder of a job.
    pub(crate) fn path(self, part: &PartId, folder: &Path) -> PathBuf {
        part.named(folder, &format!("{self}-{:04}", part.number))
    }

    /// The file of all shares.
    pub(crate) fn whole_path(self, part: &PartId, folder: &Path) -> PathBuf {
        part.named(folder, self.name())
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Stage {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known =
            [Self::Extremes, Self::Histogram, Self::Occupancy].into_iter().find(|stage| stage.name() == text);
        known.ok_or_else(|| format!("'{text}' is not a stage; they are extremes, histogram and occupancy"))
    }
}

/// Result of a stage, for a share of the volume or for all of it.
pub(crate) enum Finding {
    /// The outermost finite samples.
    Extremes(Extremes),
    /// Counts.
    Tally(Tally),
    /// The selection of the inside values, by the counts of the whole.
    Chosen(Selection, Option<BuildNote>),
}

impl Finding {
    fn words(&self) -> Box<dyn Iterator<Item = u64> + '_> {
        match self {
            Self::Extremes(extremes) => Box::new(extremes.words()),
            Self::Tally(tally) => Box::new(tally.words()),
            Self::Chosen(Selection { kind, lo, hi }, note) => {
                let (what, of) = match note {
                    Some(BuildNote::Labels { count }) => (1, *count as u64),
                    Some(BuildNote::Padding { value }) => (2, value.to_bits()),
                    Some(BuildNote::Greys { count }) => (3, *count as u64),
                    _ => (0, 0),
                };
                let kind = KINDS.iter().position(|of| of == kind).unwrap_or(0) as u64;
                Box::new([kind, lo.to_bits(), hi.to_bits(), what, of].into_iter())
            }
        }
    }

    fn parse(stage: Stage, is_whole: bool, words: &mut dyn Iterator<Item = u64>) -> Option<Self> {
        if (stage, is_whole) == (Stage::Histogram, false) {
            return Tally::parse(words).map(Self::Tally);
        }
        let words: Vec<u64> = words.take(Extremes::WORDS + 1).collect();
        Some(match (stage, words.as_slice()) {
            (Stage::Extremes, words) => Self::Extremes(Extremes::parse(words)?),
            (Stage::Histogram, [kind, lo, hi, what, of]) => {
                let kind = *KINDS.get(usize::try_from(*kind).ok()?)?;
                let note = match what {
                    1 => Some(BuildNote::Labels { count: usize::try_from(*of).ok()? }),
                    2 => Some(BuildNote::Padding { value: f64::from_bits(*of) }),
                    3 => Some(BuildNote::Greys { count: usize::try_from(*of).ok()? }),
                    _ => None,
                };
                Self::Chosen(Selection { kind, lo: f64::from_bits(*lo), hi: f64::from_bits(*hi) }, note)
            }
            _ => return None,
        })
    }

    /// Adds the finding of another share; `false` if its kind differs.
    fn join(&mut self, other: Self) -> bool {
        match (self, other) {
            (Self::Extremes(all), Self::Extremes(own)) => all.join(&own),
            (Self::Tally(all), Self::Tally(own)) => all.join(&own),
            _ => return false,
        }
        true
    }
}

/// Runs a stage on the share of a part; `extremes` come from the whole volume, if they are found first.
///
/// # Errors
/// The volume cannot be read, or the memory is too small.
pub(crate) fn find(
    chooser: &Chooser<'_>,
    stage: Stage,
    part: &PartId,
    extremes: &Extremes,
) -> Result<Finding, BuildError> {
    let share = Share { number: part.number, of: part.cuts.parts };
    Ok(match stage {
        Stage::Extremes => Finding::Extremes(chooser.extremes_of(share)?),
        _ => Finding::Tally(chooser.tally_of(share, extremes)?),
    })
}

/// Combines the shares of all parts; of a histogram, returns the threshold that follows.
///
/// Memory: the counts of two shares.
///
/// # Errors
/// A share is missing, damaged or not of this plan, or all values are alike.
pub(crate) fn join(
    chooser: &Chooser<'_>,
    stage: Stage,
    part: &PartId,
    folder: &Path,
    extremes: &Extremes,
) -> Result<Finding, BuildError> {
    let (mut missing, mut first) = (0, Vec::new());
    let mut all: Option<Finding> = None;
    for number in 0..part.cuts.parts {
        chooser.progress.check()?;
        let part = PartId { number, ..*part };
        let Some(own) = read(stage, &part, folder, false)? else {
            missing += 1;
            first.extend((first.len() < super::join::NAMED).then_some(number));
            continue;
        };
        match &mut all {
            None => all = Some(own),
            Some(all) => {
                if !all.join(own) {
                    return Err(at(&stage.path(&part, folder), PartFault::Damaged { number }));
                }
            }
        }
    }
    match all.filter(|_| missing == 0) {
        None => Err(at(folder, PartFault::Missing { parts: part.cuts.parts, missing, first })),
        Some(Finding::Tally(tally)) => {
            let (selection, note) = chooser.choose_by(tally, extremes)?;
            Ok(Finding::Chosen(selection, note))
        }
        Some(all) => Ok(all),
    }
}

pub(super) fn head(stage: Stage, part: &PartId, is_whole: bool) -> [u8; HEAD_BYTES] {
    let mut head = [0; HEAD_BYTES];
    head[..8].copy_from_slice(&MAGIC);
    head[8..40].copy_from_slice(&part.digest);
    let number = if is_whole { WHOLE } else { part.number };
    let words = [stage as u32, number, part.cuts.parts];
    head[40..].as_chunks_mut().0.iter_mut().zip(words).for_each(|(to, word)| *to = word.to_le_bytes());
    head
}

/// Writes the finding of a share, or of all of them, atomically.
///
/// # Errors
/// The disk fails.
pub(crate) fn write(
    finding: &Finding,
    stage: Stage,
    part: &PartId,
    folder: &Path,
    is_whole: bool,
) -> Result<(), BuildError> {
    let path = if is_whole { stage.whole_path(part, folder) } else { stage.path(part, folder) };
    let put = || -> io::Result<()> {
        let atomic = AtomicFile::create(&path)?;
        let mut file = io::BufWriter::new(atomic.file());
        let mut crc = 0;
        let mut put = |bytes: &[u8]| {
            crc = crc32c::crc32c_append(crc, bytes);
            file.write_all(bytes)
        };
        put(&head(stage, part, is_whole))?;
        finding.words().try_for_each(|word| put(&word.to_le_bytes()))?;
        file.write_all(&crc.to_le_bytes())?;
        file.flush()?;
        drop(file);
        atomic.file().sync_all()?;
        atomic.commit()
    };
    put().map_err(|cause| BuildFault::Output { path: path.clone(), cause }.into())
}

/// Reads the finding of a share, or of all of them; `None` if it does not exist.
///
/// # Errors
/// It cannot be read, or is damaged.
pub(crate) fn read(
    stage: Stage,
    part: &PartId,
    folder: &Path,
    is_whole: bool,
) -> Result<Option<Finding>, BuildError> {
    let path = if is_whole { stage.whole_path(part, folder) } else { stage.path(part, folder) };
    let mut bytes = Vec::new();
    let all = |file: PositionalFile| {
        let length = file.metadata()?.len().min(MAX_BYTES + 1);
        bytes.reserve_exact(usize::try_from(length).unwrap_or(0));
        file.onwards(0).take(length).read_to_end(&mut bytes)
    };
    match PositionalFile::open(&path).and_then(all) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(cause) => return Err(at(&path, PartFault::Unreadable(cause))),
        Ok(_) => {}
    }
    let parsed = || {
        let (content, crc) = bytes.split_last_chunk::<4>()?;
        let is_sound = crc32c::crc32c(content) == u32::from_le_bytes(*crc);
        let (own, words) = content.split_first_chunk::<HEAD_BYTES>()?;
        let (words, rest) = words.as_chunks::<8>();
        let is_it = is_sound && rest.is_empty() && *own == head(stage, part, is_whole);
        let mut words = words.iter().map(|word| u64::from_le_bytes(*word));
        Finding::parse(stage, is_whole, &mut words).filter(|_| is_it)
    };
    match parsed() {
        Some(finding) => Ok(Some(finding)),
        None => Err(at(&path, PartFault::DamagedStage { stage })),
    }
}
