//! Slices numbered by the names of their files: detection of missing numbers, and their treatment.
//!
//! Names that differ in numbers only (`ct_007.png`, `ct_8.png`) are numbered alike. Where the numbers of three or more
//! such files go on by the same step most of the time, numbers between them are missing: a gap, to be refused, filled
//! or kept like the gaps of any other series. Numbers that follow no step (times, identifiers) say nothing.
//!
//! Files of other names among them are another stack, to be refused, or one picture that is left out.

use std::fmt;
use std::path::{Path, PathBuf};

use super::GapPolicy;
use super::files::FileList;
use super::header::unusable;
use super::natural::{MAX_SETS, Meaning, Number, Piece, decimals, integers, pieces};
use super::stable_hash::StableHash;
use crate::fault::{Fault, FaultKind, bad};
use crate::text::names::GAPS;
use crate::text::{Count, shown};
use crate::volume::{GapFill, InfoOverride, Note, Result, VolumeSource};

/// Most numbers of a name that are looked at; names have few.
const FIELDS: usize = 16;

/// Most digits of a number that may count slices.
const MAX_DIGITS: usize = 15;

/// Most digits of a fraction, and of the number before it.
const MAX_DECIMALS: u32 = 6;
const MAX_WHOLE: usize = 6;

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
#[derive(Debug, Default, PartialEq)]
pub(super) struct Order {
    /// Part of the way from this file to the next, and a note of it; 0 is the file itself. Without them the files follow
    /// one after the other.
    filled: Option<(Vec<(u32, f64)>, Note)>,
    note: Option<Note>,
    /// A note on a file of another name.
    other: Option<Note>,
}

impl Order {
    /// The volume in the order of its files, with made slices between them.
    pub(super) fn apply(self, volume: Box<dyn VolumeSource>) -> Box<dyn VolumeSource> {
        let volume = match self.filled {
            Some((places, note)) => GapFill::between(volume, places, note),
            None => volume,
        };
        self.note.into_iter().chain(self.other).fold(volume, InfoOverride::with_note)
    }
}

/// A name with its numbers taken out, and these.
struct Parts {
    /// Hash of the text; the case of letters does not count.
    template: u64,
    numbers: [Option<i64>; FIELDS],
    /// Number of a channel, as in `z000_c1`.
    channel: Option<usize>,
}

impl Parts {
    fn of(name: &[u8], meaning: Meaning) -> Self {
        let mut hash = StableHash::new();
        let mut numbers = [None; FIELDS];
        let (mut at, mut used, mut channel) = (0, 0, None);
        let mut before: &[u8] = &[];
        for piece in pieces(name) {
            let number = match piece {
                Piece::Text(text) => {
                    before = text;
                    hash = hash.part(&text.to_ascii_lowercase());
                    continue;
                }
                Piece::Number(number) => number,
            };
            if is_channel(before) {
                channel = Some(used);
            }
            before = &[];
            let (read, text) = values(number, at, meaning);
            at += 1;
            hash = hash.part(&text);
            for (digits, value) in read.into_iter().flatten() {
                match value.and_then(|value| Some((numbers.get_mut(used)?, value))) {
                    Some((slot, value)) => {
                        *slot = Some(value);
                        used += 1;
                        hash = hash.number(1);
                    }
                    None => hash = hash.part(digits),
                }
            }
        }
        Self { template: hash.finish(), numbers, channel }
    }
}

/// True for text that ends in the name of a channel.
fn is_channel(text: &[u8]) -> bool {
    let start = text.iter().rposition(|c| !c.is_ascii_alphabetic()).map_or(0, |at| at + 1);
    let word = &text[start..];
    ["c", "ch", "chan", "channel"].iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes()))
}

/// Digits, and their value where they may count slices.
type Digits<'a> = (&'a [u8], Option<i64>);

/// The one or two numbers behind a text, and their signs and points that are text.
fn values(number: Number<'_>, at: u32, meaning: Meaning) -> ([Option<Digits<'_>>; 2], Vec<u8>) {
    let is_signed = meaning.is_signed(at);
    let own_sign = if is_signed && number.sign == Some(b'-') { -1 } else { 1 };
    let mut text: Vec<u8> = number.sign.into_iter().filter(|_| !is_signed).collect();
    let value = |digits: &[u8], most: usize| {
        let significant = digits.iter().position(|digit| *digit != b'0').map_or(0, |at| digits.len() - at);
        let read = std::str::from_utf8(digits).ok().and_then(|digits| digits.parse::<i64>().ok());
        read.filter(|_| significant <= most)
    };
    let fraction = number.fraction.unwrap_or_default();
    if meaning.is_decimal(at) {
        let missing = u32::try_from(fraction.len()).ok().and_then(|own| MAX_DECIMALS.checked_sub(own));
        let scaled = missing.and_then(|missing| {
            let below = if fraction.is_empty() { 0 } else { value(fraction, MAX_DIGITS)? };
            let above = value(number.whole, MAX_WHOLE)? * 10_i64.pow(MAX_DECIMALS);
            Some(above + below * 10_i64.pow(missing))
        });
        return ([Some((number.whole, scaled.map(|scaled| own_sign * scaled))), None], text);
    }
    text.extend(number.fraction.map(|_| b'.'));
    let whole = value(number.whole, MAX_DIGITS).map(|value| own_sign * value);
    let behind = number.fraction.map(|digits| (digits, value(digits, MAX_DIGITS)));
    ([Some((number.whole, whole)), behind], text)
}

/// Files that are numbered alike.
struct Set {
    template: u64,
    /// Index of the first file.
    at: usize,
    first: [Option<i64>; FIELDS],
    /// True for each number that differs from the first file's.
    varies: [bool; FIELDS],
    /// The first file of another channel, where another number varies, too.
    other_channel: Option<usize>,
    files: usize,
}

fn sets(list: &FileList, meaning: Meaning) -> Vec<Set> {
    let mut sets: Vec<Set> = Vec::new();
    for index in 0..list.len() {
        let Parts { template, numbers, channel } = Parts::of(list.bytes(index), meaning);
        let full = sets.len() == MAX_SETS;
        match sets.iter_mut().find(|set| set.template == template) {
            Some(set) => {
                set.files += 1;
                for (varies, (a, b)) in set.varies.iter_mut().zip(set.first.iter().zip(&numbers)) {
                    *varies |= a != b;
                }
                if channel.is_some_and(|at| set.first.get(at) != numbers.get(at)) {
                    set.other_channel.get_or_insert(index);
                }
            }
            None if !full => sets.push(Set {
                template,
                at: index,
                first: numbers,
                varies: [false; FIELDS],
                other_channel: None,
                files: 1,
            }),
            None => {}
        }
    }
    for set in &mut sets {
        set.other_channel = set.other_channel.filter(|_| !set.is_single());
    }
    sets
}

/// Judges the names of files, which are in natural order. Returns the files of the stack, too, which may lack one of
/// another name.
///
/// Memory: 16 bytes a file meanwhile.
///
/// # Errors
/// Numbers are missing and the policy is to refuse that, the gaps cannot be filled, the files are two stacks, or their
/// order cannot be decided.
pub(super) fn judge(list: FileList, policy: GapPolicy) -> Result<(FileList, Order)> {
    let first = list.path(0);
    let folder = first.parent().filter(|path| !path.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let meaning = list.meaning();
    let mut sets = sets(&list, meaning);
    let other = other_file(&list, &sets, meaning).map_err(|fault| unusable(folder, fault))?;
    let (list, note) = match other {
        None => (list, None),
        Some(other) => {
            let name = shown(list.name(other.index)).to_string();
            if other.is_first {
                (list, Some(Note::new(format!("{name} is taken as the first slice, by its name"))))
            } else {
                let rest = list.select((0..list.len()).filter(|index| *index != other.index));
                let count = Count(rest.len(), "file");
                let note = format!("{name} is left out: its name is unlike the names of the other {count}");
                sets = self::sets(&rest, meaning);
                (rest, Some(Note::new(note)))
            }
        }
    };
    undecided(&list, meaning).map_err(|fault| unusable(folder, fault))?;
    let order = judge_gaps(&list, &sets, policy, meaning).map_err(|fault| unusable(&list.path(0), fault))?;
    Ok((list, Order { other: note, ..order }))
}

fn judge_gaps(list: &FileList, sets: &[Set], policy: GapPolicy, meaning: Meaning) -> Result<Order, Fault> {
    let mut found = None;
    for set in sets.iter().filter(|set| set.files > 2) {
        if let Some(gaps) = set.gaps(list, sets.len() == 1, meaning)? {
            found = Some((set, gaps));
            break;
        }
    }
    let Some((set, gaps)) = found else { return Ok(Order::default()) };
    match policy {
        GapPolicy::Error => Err(refusal(&gaps)),
        GapPolicy::Keep => {
            let note = Note::new(format!("{gaps}; the files are taken as evenly spaced slices"));
            Ok(Order { note: Some(note), ..Order::default() })
        }
        GapPolicy::Fill if gaps.can_fill => set.fill(list, gaps, meaning),
        GapPolicy::Fill => Err(refusal(&gaps)),
    }
}

/// A file whose name is unlike the others'.
struct Other {
    index: usize,
    /// True if its name is theirs without a number, and their numbers begin behind 0: `a.png` before `a (2).png`.
    is_first: bool,
}

/// The file whose name is unlike the others'. Refuses several stacks: several such files, names whose numbers overlap,
/// such as images and their masks, and channels.
fn other_file(list: &FileList, sets: &[Set], meaning: Meaning) -> Result<Option<Other>, Fault> {
    let large = || sets.iter().filter(|set| set.files > 2);
    let Some(main) = large().next() else { return Ok(None) };
    let mut before: Vec<[(i64, u32); 2]> = Vec::new();
    for set in large() {
        if let Some(other) = set.other_channel {
            return Err(two_stacks(list, set.at, other));
        }
        let numbers = set.numbers(list, meaning).unwrap_or_default();
        let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { continue };
        if let Some([other, _]) = before.iter().find(|[from, to]| first.0 <= to.0 && from.0 <= last.0) {
            return Err(two_stacks(list, other.1 as usize, first.1 as usize));
        }
        before.push([*first, *last]);
    }
    let is_other = |index: &usize| {
        let own = Parts::of(list.bytes(*index), meaning).template;
        large().all(|set| set.template != own)
    };
    let mut others = (0..list.len()).filter(is_other);
    let Some(index) = others.next() else { return Ok(None) };
    if others.next().is_some() {
        return Err(two_stacks(list, main.at, index));
    }
    let text = |index: usize| {
        let mut text = Vec::new();
        for piece in pieces(list.bytes(index)) {
            let Piece::Text(piece) = piece else { continue };
            text.extend(piece.iter().filter(|c| c.is_ascii_alphanumeric() || !c.is_ascii()));
        }
        text.make_ascii_lowercase();
        text
    };
    let starts_behind_0 = before.first().is_some_and(|[first, _]| first.0 > 0);
    Ok(Some(Other { index, is_first: starts_behind_0 && text(index) == text(main.at) }))
}

fn two_stacks(list: &FileList, a: usize, b: usize) -> Fault {
    bad!(
        "holds two stacks, one with {} and one with {}; move one of them into a folder of its own",
        shown(list.name(a)),
        shown(list.name(b))
    )
}

/// Refuses names whose digits behind a point have one order as fractions and another as numbers, and hexadecimal numbers.
fn undecided(list: &FileList, meaning: Meaning) -> Result<(), Fault> {
    let (mut pairs, mut counted, mut first) = (0, 0, None);
    for index in 1..list.len() {
        let names = [index - 1, index].map(|index| list.bytes(index).to_ascii_lowercase());
        let template = |name: &[u8]| Parts::of(name, meaning).template;
        if names[0].len() == names[1].len()
            && names[0] > names[1]
            && template(&names[0]) != template(&names[1])
        {
            return Err(bad!(
                "holds {} and {}, whose order is one by numbers and another by letters; number the files by decimal numbers",
                shown(list.name(index - 1)),
                shown(list.name(index))
            ));
        }
        let [a, b] = [index - 1, index].map(|index| {
            pieces(list.bytes(index)).filter_map(|piece| match piece {
                Piece::Number(number) => Some(number),
                Piece::Text(_) => None,
            })
        });
        // The last number with a point, of names that are the same before it.
        let is_whole = |a: &Number<'_>, b: &Number<'_>| integers(a.whole, b.whole).is_eq();
        let differs = (0..).zip(a.zip(b)).find(|(_, (a, b))| !is_whole(a, b) || a.fraction != b.fraction);
        let Some((at, (a, b))) = differs.filter(|(_, (a, b))| is_whole(a, b)) else { continue };
        let (Some(a), Some(b)) = (a.fraction, b.fraction) else { continue };
        if meaning.is_decimal(at) {
            continue;
        }
        pairs += 1;
        let value = |digits: &[u8]| std::str::from_utf8(digits).ok()?.parse::<u64>().ok();
        if value(a).and_then(|a| a.checked_add(1)) == value(b) {
            counted += 1;
        } else if integers(a, b) != decimals(a, b) {
            first.get_or_insert(index);
        }
    }
    match first.filter(|_| 2 * counted < pairs) {
        Some(index) => Err(bad!(
            "holds {} and {}, whose order is one by numbers and another by decimals; give the decimals of all files as many digits",
            shown(list.name(index - 1)),
            shown(list.name(index))
        )),
        None => Ok(()),
    }
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

/// The steps between sorted numbers.
fn steps_of(numbers: &[(i64, u32)]) -> Vec<u64> {
    numbers.windows(2).map(|pair| pair[1].0.abs_diff(pair[0].0)).collect()
}

impl Set {
    /// True if one number of the names varies.
    fn is_single(&self) -> bool {
        self.varies.iter().filter(|varies| **varies).count() == 1
    }

    /// The files of the set with their numbers, in the order of these; `None` if no number of the names can be the
    /// slice's.
    fn numbers(&self, list: &FileList, meaning: Meaning) -> Option<Vec<(i64, u32)>> {
        let field = self.varies.iter().position(|varies| *varies)?;
        let mut numbers = Vec::with_capacity(self.files);
        for index in 0..list.len() {
            let own = Parts::of(list.bytes(index), meaning);
            if own.template == self.template {
                numbers.push((own.numbers.get(field).copied().flatten()?, u32::try_from(index).ok()?));
            }
        }
        numbers.sort_unstable();
        Some(numbers)
    }

    /// The gaps, if there are any.
    fn gaps(&self, list: &FileList, alone: bool, meaning: Meaning) -> Result<Option<NumberGaps>, Fault> {
        let Some(numbers) = self.numbers(list, meaning) else { return Ok(None) };
        let single = self.is_single();
        let files = |at: usize| {
            let name = |at: usize| numbers.get(at).map(|(_, i)| list.name(*i as usize).to_path_buf());
            [at, at + 1].map(|at| name(at).unwrap_or_default())
        };
        let steps = steps_of(&numbers);
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
    fn fill(&self, list: &FileList, gaps: NumberGaps, meaning: Meaning) -> Result<Order, Fault> {
        let numbers = self.numbers(list, meaning).unwrap_or_default();
        let steps = steps_of(&numbers);
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
        Ok(Order { filled: Some((places, note)), ..Order::default() })
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
        let sentence = match judge(list(names), GapPolicy::Error) {
            Ok((_, order)) => {
                assert!(order.filled.is_none() && order.note.is_none(), "{order:?}");
                return None;
            }
            Err(error) => error.to_string(),
        };
        let Some((_, behind)) = sentence.split_once("probably missing: ") else {
            assert!(sentence.contains("do not follow each other evenly"), "{sentence}");
            return Some(None);
        };
        Some(behind.split(' ').next().and_then(|count| count.parse().ok()))
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
            &["b1z1", "b1z2", "b2z1", "b2z2"],
            &["z-2", "z-1", "z0", "z1"],
            &["z9", "z9.25", "z9.5", "z9.75", "z10"],
            &["S1.tif", "s2.tiff", "S3.TIF", "s4.tif"],
            &["scan-1", "scan-2", "scan-3"],
            &["v1.8", "v1.9", "v1.10", "v1.11"],
        ] {
            assert_eq!(missing(whole), None, "{whole:?}");
        }
        assert_eq!(missing(&["s1", "s2", "s4", "s5"]), Some(Some(1)));
        assert_eq!(missing(&["s1", "s2", "s4"]), Some(Some(1)));
        assert_eq!(missing(&["s1", "s3", "s4", "s7"]), Some(Some(3)));
        assert_eq!(missing(&["s2", "s4", "s6", "s10", "s12"]), Some(Some(1)));
        assert_eq!(missing(&["s10", "s20", "s30", "s45"]), Some(None));
        assert_eq!(missing(&["cover", "s1", "s2", "s4", "s5"]), Some(Some(1)));
        assert_eq!(missing(&["z-3", "z-2", "z0", "z1"]), Some(Some(1)));
        // A position in the name changes along with the number.
        let placed = ["s1_0.5mm", "s2_1.0mm", "s3_1.5mm", "s5_2.5mm", "s6_3.0mm", "s7_3.5mm"];
        assert_eq!(missing(&placed), Some(Some(1)));
        let fault = judge(list(&["s1", "s01", "s2"]), GapPolicy::Keep).unwrap_err().to_string();
        assert!(fault.contains("same number"), "{fault}");
    }

    #[test]
    fn two_stacks_are_refused_and_one_other_picture_is_left_out() {
        for policy in [GapPolicy::Error, GapPolicy::Keep, GapPolicy::Fill] {
            for (names, words) in [
                (
                    &["img_1", "img_2", "img_3", "mask_2", "mask_3", "mask_4"][..],
                    "folder: holds two stacks, one with img_1 and one with mask_2",
                ),
                (&["z0_c0", "z0_c1", "z1_c0", "z1_c1"], "one with z0_c0 and one with z0_c1"),
                (&["c0_z0", "c0_z1", "C1_z0", "C1_z1"], "one with c0_z0 and one with C1_z0"),
                (&["s1", "s2", "s3", "front", "side"], "one with s1 and one with front"),
                (&["s8", "s9", "s10", "sa", "sb"], "one with s8 and one with sa"),
                (&["z9.0", "z9.25", "z9.5"], "z9.5 and z9.25, whose order"),
                (&["s08", "s09", "s0a", "s0b"], "s0b and s08, whose order"),
            ] {
                let refused = judge(list(names), policy).unwrap_err().to_string();
                assert!(refused.contains(words), "{refused}");
            }
            for (names, count, words) in [
                (&["a_1", "a_2", "a_3", "b_4", "b_5", "b_6"][..], 6, None),
                (&["s1.tif", "s2.tif", "s3.tif", "cover.tif"], 3, Some("cover.tif is left out")),
                (&["x__rec01", "x__rec02", "x__rec03", "x__rec_spr"], 3, Some("x__rec_spr is left out")),
                (&["a00", "a01", "a02", "a"], 3, Some("a is left out")),
                (&["a.png", "a (2).png", "a (3).png", "a (4).png"], 4, Some("a.png is taken as the first")),
                (&["c1_1", "c1_2", "c1_3"], 3, None),
            ] {
                let (files, order) = judge(list(names), policy).unwrap();
                assert_eq!(files.len(), count, "{names:?}");
                let note = order.other.map(|note| note.to_string());
                assert_eq!(note.is_some(), words.is_some(), "{note:?}");
                assert!(words.is_none_or(|words| note.unwrap().contains(words)), "{names:?}");
            }
        }
    }

    #[test]
    fn gaps_are_filled_where_the_numbers_say_how() {
        let files = list(&["s1", "s2", "s5", "s6"]);
        let (places, _) = judge(files, GapPolicy::Fill).unwrap().1.filled.unwrap();
        let third = 1.0 / 3.0;
        assert_eq!(places, [(0, 0.0), (1, 0.0), (1, third), (1, 2.0 * third), (2, 0.0), (3, 0.0)]);
        assert!(judge(list(&["s1", "s2", "s5", "s6"]), GapPolicy::Keep).unwrap().1.note.is_some());
        for (names, why) in [
            (&["a1", "a2", "a4", "b5", "b6", "b7"][..], "several sets"),
            (&["s10", "s20", "s30", "s45"], "no multiples"),
            (&["s1", "s2", "s900"], "too far"),
        ] {
            assert!(judge(list(names), GapPolicy::Fill).is_err(), "{why}");
        }
    }
}
