//! Slices numbered by the names of their files: detection of missing numbers, and their treatment.
//!
//! Names that differ in numbers only (`ct_007.png`, `ct_8.png`) are numbered alike. Where the numbers of three or more
//! such files go on by the same step most of the time, numbers between them are missing: a gap, to be refused, filled
//! or kept like the gaps of any other series. Numbers that follow no step (times, identifiers) say nothing.

use std::fmt;
use std::path::{Path, PathBuf};

use super::GapPolicy;
use super::files::FileList;
use super::stable_hash::StableHash;
use crate::fault::{Fault, FaultKind, bad};
use crate::platform::OsStrExt;
use crate::text::names::GAPS;
use crate::text::{Count, shown};
use crate::volume::{GapFill, InfoOverride, Note, VolumeSource};

/// Most numbers of a name that are looked at; names have few.
const FIELDS: usize = 16;

/// Most digits of a number that may count slices.
const MAX_DIGITS: usize = 15;

/// Most slices made for each existing one: more would be a picture of the interpolation.
const MAX_MADE: u64 = 10;

/// Greatest average distance of numbers at which they count slices even without a usual step between them.
const DENSE: u64 = 3;

/// Numbers of slices that lack some.
#[derive(Clone, Debug, PartialEq)]
struct NumberGaps {
    /// Files that are numbered alike.
    files: usize,
    /// Slices that seem to be missing; `None` where the gaps are not whole multiples of the usual one.
    missing: Option<u64>,
    /// Number of gaps.
    places: usize,
    /// The files on both sides of the first gap.
    first: [PathBuf; 2],
    /// True if the missing slices can be made: not between files that are numbered in several ways.
    can_fill: bool,
}

impl fmt::Display for NumberGaps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { files, missing, places, first: [a, b], .. } = self;
        match missing {
            Some(slices) => write!(
                f,
                "probably missing: {} in {} among {files} numbered files",
                Count(*slices, "slice"),
                Count(*places, "place")
            )?,
            None => write!(f, "the numbers of {files} files do not follow each other evenly")?,
        }
        write!(f, ", first between {} and {}", shown(a), shown(b))
    }
}

/// Treatment of the slices of a stack.
#[derive(Debug, PartialEq)]
pub(super) enum Order {
    /// The files one after the other.
    AsTheyAre(Option<Note>),
    /// Part of the way from this file to the next; 0 is the file itself.
    Filled(Vec<(u32, f64)>, Note),
}

impl Order {
    /// The volume in the order of its files, with made slices between them.
    pub(super) fn apply(self, volume: Box<dyn VolumeSource>) -> Box<dyn VolumeSource> {
        match self {
            Self::AsTheyAre(note) => match note {
                Some(note) => InfoOverride::with_note(volume, note),
                None => volume,
            },
            Self::Filled(places, note) => GapFill::between(volume, places, note),
        }
    }
}

/// A name with its numbers taken out, as a hash; and the numbers.
fn parts(name: &Path) -> (u64, [Option<u64>; FIELDS]) {
    let mut hash = StableHash::new();
    let mut fields = [None; FIELDS];
    let mut free = fields.iter_mut();
    for run in name.as_os_str().as_bytes().chunk_by(|a, b| a.is_ascii_digit() == b.is_ascii_digit()) {
        let significant = run.iter().position(|digit| *digit != b'0').map_or(0, |at| run.len() - at);
        let number = std::str::from_utf8(run).ok().and_then(|digits| digits.parse::<u64>().ok());
        match number.filter(|_| significant <= MAX_DIGITS).and_then(|number| Some((free.next()?, number))) {
            Some((slot, number)) => {
                *slot = Some(number);
                hash = hash.number(1);
            }
            None => hash = hash.part(run),
        }
    }
    (hash.finish(), fields)
}

/// Files that are numbered alike.
struct Set {
    template: u64,
    first: [Option<u64>; FIELDS],
    /// True for each number that differs from the first file's.
    varies: [bool; FIELDS],
    files: usize,
}

/// Most sets that are distinguished; folders have one or two.
const MAX_SETS: usize = 64;

fn sets(list: &FileList) -> Vec<Set> {
    let mut sets: Vec<Set> = Vec::new();
    for index in 0..list.len() {
        let (template, fields) = parts(list.name(index));
        let full = sets.len() == MAX_SETS;
        match sets.iter_mut().find(|set| set.template == template) {
            Some(set) => {
                set.files += 1;
                for (varies, (a, b)) in set.varies.iter_mut().zip(set.first.iter().zip(&fields)) {
                    *varies |= a != b;
                }
            }
            None if !full => {
                sets.push(Set { template, first: fields, varies: [false; FIELDS], files: 1 });
            }
            None => {}
        }
    }
    sets
}

/// Judges the numbers of files, which are in natural order.
///
/// Memory: 16 bytes a file meanwhile.
///
/// # Errors
/// Numbers are missing and the policy is to refuse that, the gaps cannot be filled, or files of two names count the same
/// slices.
pub(super) fn judge(list: &FileList, policy: GapPolicy) -> Result<Order, Fault> {
    let sets = sets(list);
    refuse_two_stacks(list, &sets)?;
    let mut found = None;
    for set in sets.iter().filter(|set| set.files > 2) {
        if let Some(gaps) = set.gaps(list, sets.len() == 1)? {
            found = Some((set, gaps));
            break;
        }
    }
    let Some((set, gaps)) = found else { return Ok(Order::AsTheyAre(None)) };
    match policy {
        GapPolicy::Error => Err(refusal(&gaps)),
        GapPolicy::Keep => Ok(Order::AsTheyAre(Some(Note::new(format!(
            "{gaps}; the files are taken as evenly spaced slices"
        ))))),
        GapPolicy::Fill if gaps.can_fill => set.fill(list, gaps),
        GapPolicy::Fill => Err(refusal(&gaps)),
    }
}

/// Refuses files of two names whose numbers overlap, such as images and their masks: they are two stacks.
fn refuse_two_stacks(list: &FileList, sets: &[Set]) -> Result<(), Fault> {
    let mut before: Vec<[(u64, u32); 2]> = Vec::new();
    for set in sets.iter().filter(|set| set.files > 2) {
        let numbers = set.numbers(list).unwrap_or_default();
        let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { continue };
        if let Some([other, _]) = before.iter().find(|[from, to]| first.0 <= to.0 && from.0 <= last.0) {
            let [a, b] = [other, first].map(|(_, index)| list.name(*index as usize).to_path_buf());
            return Err(bad!(
                "holds two stacks, one with {} and one with {}; move one of them into a folder of its own",
                shown(&a),
                shown(&b)
            ));
        }
        before.push([*first, *last]);
    }
    Ok(())
}

fn refusal(gaps: &NumberGaps) -> Fault {
    let keep = if gaps.can_fill { format!("{GAPS} fill or {GAPS} keep") } else { format!("{GAPS} keep") };
    Fault::new(FaultKind::Gaps, format!("{gaps}; add the missing slices, or choose {keep}"))
}

/// The step that occurs most often between sorted numbers, of several the smallest; and its count.
fn usual(steps: &[u64]) -> (u64, usize) {
    let mut sorted = steps.to_vec();
    sorted.sort_unstable();
    let mut best = (1, 0);
    for run in sorted.chunk_by(|a, b| a == b) {
        if let Some(step) = run.first()
            && run.len() > best.1
        {
            best = (*step, run.len());
        }
    }
    best
}

impl Set {
    /// The files of the set with their numbers, in the order of these; `None` if no number of the names can be the
    /// slice's.
    fn numbers(&self, list: &FileList) -> Option<Vec<(u64, u32)>> {
        let field = self.varies.iter().position(|varies| *varies)?;
        let mut numbers = Vec::with_capacity(self.files);
        for index in 0..list.len() {
            let (template, fields) = parts(list.name(index));
            if template == self.template {
                numbers.push((fields.get(field).copied().flatten()?, u32::try_from(index).ok()?));
            }
        }
        numbers.sort_unstable();
        Some(numbers)
    }

    /// The gaps, if there are any.
    fn gaps(&self, list: &FileList, alone: bool) -> Result<Option<NumberGaps>, Fault> {
        let Some(numbers) = self.numbers(list) else { return Ok(None) };
        let single = self.varies.iter().filter(|varies| **varies).count() == 1;
        let files = |at: usize| {
            let name = |at: usize| numbers.get(at).map(|(_, i)| list.name(*i as usize).to_path_buf());
            [at, at + 1].map(|at| name(at).unwrap_or_default())
        };
        let steps: Vec<u64> = numbers.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        if let Some(at) = steps.iter().position(|step| *step == 0) {
            // Another of several numbers in a name may distinguish the files.
            if !single {
                return Ok(None);
            }
            let [a, b] = files(at);
            return Err(bad!(
                "{} and {} have the same number; rename one of them, or move it away",
                shown(&a),
                shown(&b)
            ));
        }
        let (step, times) = usual(&steps);
        let span: u64 = steps.iter().sum();
        let is_usual = 2 * times >= steps.len();
        let is_dense = single && step == 1 && span <= DENSE * steps.len() as u64;
        if !(is_dense || is_usual && (single || 2 * times > steps.len())) {
            return Ok(None);
        }
        let Some(at) = steps.iter().position(|own| *own != step) else { return Ok(None) };
        let whole = steps.iter().all(|own| own % step == 0);
        let first = if whole { steps.iter().position(|own| *own > step).unwrap_or(at) } else { at };
        Ok(Some(NumberGaps {
            files: numbers.len(),
            missing: whole.then(|| steps.iter().map(|own| own / step - 1).sum()),
            places: steps.iter().filter(|own| **own != step).count(),
            first: files(first),
            can_fill: whole && alone,
        }))
    }

    /// A slice for each number from the first to the last.
    fn fill(&self, list: &FileList, gaps: NumberGaps) -> Result<Order, Fault> {
        let numbers = self.numbers(list).unwrap_or_default();
        let steps: Vec<u64> = numbers.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        let (step, _) = usual(&steps);
        let slices = steps.iter().map(|own| own / step).sum::<u64>() + 1;
        if slices > MAX_MADE * numbers.len() as u64 {
            return Err(bad!(
                "the numbers of {} files span {slices} slices, so that most would be made; add the missing slices",
                numbers.len()
            ));
        }
        let mut places = Vec::new();
        for (at, own) in steps.iter().enumerate() {
            let many = own / step;
            // Files in the order of their numbers are in natural order, as they have one number only. Exact below 2^53.
            places.extend((0..many).map(|k| (numbers[at].1, k as f64 / many as f64)));
        }
        places.extend(numbers.last().map(|(_, index)| (*index, 0.0)));
        let made = slices - numbers.len() as u64;
        let [a, b] = &gaps.first;
        let note = Note::new(format!(
            "gaps in the numbers of the files were filled: {made} of {} slices were made by interpolation between neighbours, the first between {} and {}",
            places.len(),
            shown(a),
            shown(b)
        ));
        Ok(Order::Filled(places, note))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(names: &[&str]) -> FileList {
        let mut list = FileList::new(Path::new("folder"));
        names.iter().for_each(|name| list.push(Path::new(name)));
        let order = list.natural_order();
        list.select(order.into_iter())
    }

    fn missing(names: &[&str]) -> Option<Option<u64>> {
        let list = list(names);
        let sets = sets(&list);
        let gaps =
            sets.iter().filter(|set| set.files > 2).find_map(|set| set.gaps(&list, sets.len() == 1).unwrap());
        match judge(&list, GapPolicy::Error) {
            Ok(order) => assert!(order == Order::AsTheyAre(None) && gaps.is_none()),
            Err(fault) => assert_eq!(fault.kind, FaultKind::Gaps),
        }
        gaps.map(|gaps| gaps.missing)
    }

    #[test]
    fn missing_numbers_are_noticed_and_other_numbers_are_not() {
        for whole in [
            &["s1.png", "s2.png", "s3.png"][..],
            &["s8", "s9", "s10", "s11"],
            &["z000_10um", "z002_10um", "z004_10um"],
            &["a.png", "b.png", "d.png"],
            &["s1", "s5"],
            // Times and identifiers.
            &["8713.tif", "9122.tif", "12040.tif", "12900.tif"],
            &["12-01-33", "12-03-10", "12-04-51", "12-09-02"],
            &["20190101123059999999999", "20190101123100000000000", "20190101123200000000000"],
            // The second number orders them.
            &["c1z1", "c1z2", "c2z1", "c2z2"],
        ] {
            assert_eq!(missing(whole), None, "{whole:?}");
        }
        assert_eq!(missing(&["s1", "s2", "s4", "s5"]), Some(Some(1)));
        assert_eq!(missing(&["s1", "s2", "s4"]), Some(Some(1)));
        assert_eq!(missing(&["s1", "s3", "s4", "s7"]), Some(Some(3)));
        assert_eq!(missing(&["s2", "s4", "s6", "s10", "s12"]), Some(Some(1)));
        assert_eq!(missing(&["s10", "s20", "s30", "s45"]), Some(None));
        assert_eq!(missing(&["cover", "s1", "s2", "s4", "s5"]), Some(Some(1)));
        // A position in the name changes along with the number.
        let placed = ["s1_0.5mm", "s2_1.0mm", "s3_1.5mm", "s5_2.5mm", "s6_3.0mm", "s7_3.5mm"];
        assert_eq!(missing(&placed), Some(Some(1)));
        let repeated = judge(&list(&["s1", "s01", "s2"]), GapPolicy::Keep);
        let fault = repeated.unwrap_err();
        assert!(fault.kind == FaultKind::Damage && fault.text.contains("same number"), "{fault}");
    }

    #[test]
    fn files_of_two_names_that_count_the_same_slices_are_two_stacks() {
        for policy in [GapPolicy::Error, GapPolicy::Keep, GapPolicy::Fill] {
            let two = list(&["img_1", "img_2", "img_3", "mask_2", "mask_3", "mask_4"]);
            let Err(refused) = judge(&two, policy) else { panic!("{policy:?}") };
            assert!(refused.text.contains("img_1") && refused.text.contains("mask_2"), "{refused}");
            let one = list(&["a_1", "a_2", "a_3", "b_4", "b_5", "b_6", "cover"]);
            assert!(judge(&one, policy).is_ok(), "{policy:?}");
        }
    }

    #[test]
    fn gaps_are_filled_where_the_numbers_say_how() {
        let files = list(&["s1", "s2", "s5", "s6"]);
        let Ok(Order::Filled(places, _)) = judge(&files, GapPolicy::Fill) else { panic!("not filled") };
        let third = 1.0 / 3.0;
        assert_eq!(places, [(0, 0.0), (1, 0.0), (1, third), (1, 2.0 * third), (2, 0.0), (3, 0.0)]);
        assert!(matches!(judge(&files, GapPolicy::Keep), Ok(Order::AsTheyAre(Some(_)))));
        for (names, why) in [
            (&["cover", "s1", "s2", "s4"][..], "several sets"),
            (&["s10", "s20", "s30", "s45"], "no multiples"),
            (&["s1", "s2", "s900"], "too far"),
        ] {
            assert!(judge(&list(names), GapPolicy::Fill).is_err(), "{why}");
        }
    }
}
