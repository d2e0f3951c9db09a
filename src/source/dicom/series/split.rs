//! Tells images apart that lie at the same positions: echoes, phases of the heart, magnitude and phase, ...
//!
//! A series that repeats positions holds several volumes. It is split by the attribute that leaves the
//! fewest repeats, then the fewest parts; parts that still repeat positions are split again. Where no
//! attribute helps, but every position occurs equally often, the images of a position are numbered by
//! time and instance, and each number makes a volume, provided that the images follow each other volume by
//! volume, position by position, or so within slabs: any other order says nothing.
//!
//! Segments, and frames of nuclear medicine that differ in more than their slice, are volumes of their own
//! wherever they lie; stacks are, where they leave a gap between them.

use std::collections::{BTreeMap, HashMap};

use super::assemble::along_normal;
use super::gaps::{is_uneven, positions};
use super::group::{Group, Key, Slice};
use crate::source::dicom::attribute::Attribute;

/// Images that may be one volume.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Indices into the group's slices.
    pub(crate) chosen: Vec<usize>,
    /// Its label among its siblings, for example `echo 2`; empty without siblings.
    pub(crate) label: String,
    /// The attributes that it was split off by.
    pub(crate) by: Vec<Attribute>,
}

/// Repetition of positions.
struct Repeats {
    /// For each image the number of its position.
    numbers: Vec<usize>,
    /// Distinct positions.
    places: usize,
    /// Images beyond the first at their position.
    extra: usize,
}

fn repeats(group: &Group, chosen: &[usize]) -> Repeats {
    // Every mosaic is a volume of its own, wherever it lies.
    if group.shared.mosaic.is_some() {
        let extra = chosen.len().saturating_sub(1);
        return Repeats { numbers: vec![0; chosen.len()], places: chosen.len().min(1), extra };
    }
    let along = along_normal(group, chosen).unwrap_or_default();
    let (numbers, places) = positions(&along);
    // Without positions none repeats.
    let extra = numbers.len() - places;
    Repeats { numbers, places, extra }
}

/// Splits the images of a group into parts that repeat no position, as far as that is possible.
/// `types` are the image types that slices refer to.
pub(crate) fn split(group: &Group, types: &[String]) -> Vec<Part> {
    let whole = Part { chosen: (0..group.slices.len()).collect(), label: String::new(), by: Vec::new() };
    let mut done = Vec::new();
    let mut waiting = vec![whole];
    // The loop ends, as each split makes smaller parts.
    while let Some(part) = waiting.pop() {
        if let Some((key, parts)) = apart(group, &part.chosen) {
            waiting.extend(named(key, parts, &part, group, types).into_iter().rev());
            continue;
        }
        let repeats = repeats(group, &part.chosen);
        if repeats.extra == 0 || (repeats.places < 2 && group.shared.mosaic.is_none()) {
            done.push(part);
            continue;
        }
        let mut found = best(group, &part.chosen, repeats.extra, true);
        // Times that differ from position to position do not separate volumes.
        let ragged = |(key, parts): &(Key, Parts)| {
            key.is_time() && parts.values().any(|own| self::repeats(group, own).places < repeats.places)
        };
        if found.as_ref().is_some_and(ragged) && by_turn(group, &part, &repeats).is_some() {
            found = best(group, &part.chosen, repeats.extra, false);
        }
        let smaller = match found {
            Some((key, parts)) => named(key, parts, &part, group, types),
            None => match by_turn(group, &part, &repeats) {
                Some(parts) => parts,
                None if group.shared.mosaic.is_some() => one_by_one(&part),
                None => {
                    done.push(part);
                    continue;
                }
            },
        };
        waiting.extend(smaller.into_iter().rev());
    }
    done
}

type Parts = BTreeMap<[u64; 2], Vec<usize>>;

/// Images by the value of an attribute.
fn by_key(group: &Group, chosen: &[usize], key: Key) -> Parts {
    let mut parts = Parts::new();
    for i in chosen {
        if let Some(slice) = group.slices.get(*i) {
            parts.entry(key.value(slice)).or_default().push(*i);
        }
    }
    parts
}

/// Differences that always separate volumes, whether positions repeat or not.
fn apart(group: &Group, chosen: &[usize]) -> Option<(Key, Parts)> {
    for key in [Key::SEGMENT, Key::VECTORS] {
        let parts = by_key(group, chosen, key);
        if parts.len() > 1 {
            return Some((key, parts));
        }
    }
    let along = along_normal(group, chosen)?;
    let stacks = by_key(group, chosen, Key::STACK);
    (stacks.len() > 1 && 2 * stacks.len() <= chosen.len() && is_uneven(&along))
        .then_some((Key::STACK, stacks))
}

/// The attribute that leaves the fewest repeats, with the parts it makes, in the order of its values; times
/// count if `timed`.
fn best(group: &Group, chosen: &[usize], extra: usize, timed: bool) -> Option<(Key, Parts)> {
    let mut best: Option<(usize, usize, Key, Parts)> = None;
    for key in Key::all().filter(|key| timed || !key.is_time()) {
        let parts = by_key(group, chosen, key);
        // A number that differs for every image (a time, say) does not group them.
        let own = 2 * parts.len() > chosen.len() && group.shared.mosaic.is_none();
        if parts.len() < 2 || own {
            continue;
        }
        let left: usize = parts.values().map(|part| repeats(group, part).extra).sum();
        let better = best.as_ref().is_none_or(|(l, n, ..)| (left, parts.len()) < (*l, *n));
        if left < extra && better {
            best = Some((left, parts.len(), key, parts));
        }
    }
    best.map(|(_, _, key, parts)| (key, parts))
}

/// Parts with their labels, which differ from each other.
fn named(key: Key, parts: Parts, whole: &Part, group: &Group, types: &[String]) -> Vec<Part> {
    let siblings: Vec<&str> = parts
        .values()
        .filter_map(|part| group.slices.get(*part.first()?))
        .filter_map(|s| types.get(s.image_type as usize).map(String::as_str))
        .collect();
    let mut labels: Vec<String> = Vec::new();
    for (rank, part) in parts.values().enumerate() {
        let slice = part.first().and_then(|i| group.slices.get(*i));
        let label = slice.map_or_else(String::new, |s| label_of(key, s, rank, &siblings, types));
        let known = labels.contains(&label);
        labels.push(if known || label.is_empty() { format!("{label} set {}", rank + 1) } else { label });
    }
    let join = |label: String| {
        let label = label.trim().to_owned();
        if whole.label.is_empty() { label } else { format!("{} {label}", whole.label) }
    };
    let part = |(chosen, label): (Vec<usize>, String)| {
        let mut by = whole.by.clone();
        by.push(key.attribute());
        Part { chosen, label: join(label), by }
    };
    parts.into_values().zip(labels).map(part).collect()
}

fn label_of(key: Key, slice: &Slice, rank: usize, siblings: &[&str], types: &[String]) -> String {
    let (word, ranked) = key.word();
    match key {
        Key::ImageType => {
            type_label(types.get(slice.image_type as usize).map_or("", String::as_str), siblings)
        }
        _ if ranked => format!("{word} {}", rank + 1),
        Key::Number(at) => match slice.number(at) {
            // The value was a single, so the cast is exact.
            #[expect(clippy::cast_possible_truncation, reason = "it was a single")]
            Some(value) => format!("{word} {}", value as f32),
            None => format!("no {word}"),
        },
        Key::Rescale => format!("{word} {}", rank + 1),
    }
}

/// The difference between an image type and its siblings, in words: `magnitude`, `phase`, or its own values.
fn type_label(own: &str, siblings: &[&str]) -> String {
    let shared = |part: &&str| siblings.iter().all(|s| s.split('\\').any(|p| p == *part));
    let special: Vec<&str> = own.split('\\').filter(|p| !p.is_empty() && !shared(p)).collect();
    let is = |letter: &str, word: &str| {
        special.iter().any(|p| {
            *p == letter
                || *p == word
                || p.strip_suffix(letter).is_some_and(|head| head.ends_with('_'))
                || p.strip_prefix(letter).is_some_and(|tail| tail.starts_with('_'))
        })
    };
    for (letter, word, label) in [
        ("M", "MAGNITUDE", "magnitude"),
        ("P", "PHASE", "phase"),
        ("R", "REAL", "real"),
        ("I", "IMAGINARY", "imaginary"),
    ] {
        if is(letter, word) {
            return label.into();
        }
    }
    // Long types make no names: the shortest value that is its own says enough.
    special.iter().min_by_key(|p| (p.len(), **p)).map(|p| p.to_lowercase()).unwrap_or_default()
}

/// A volume of each image, where no attribute distinguishes them.
fn one_by_one(whole: &Part) -> Vec<Part> {
    let part = |(k, image): (usize, &usize)| Part {
        chosen: vec![*image],
        label: format!("{} set {}", whole.label, k + 1).trim().to_owned(),
        by: whole.by.clone(),
    };
    whole.chosen.iter().enumerate().map(part).collect()
}

/// The k-th image of every position makes volume k, where all positions have equally many, or where the
/// last of several volumes was not finished.
fn by_turn(group: &Group, whole: &Part, repeats: &Repeats) -> Option<Vec<Part>> {
    let mut at_place: HashMap<usize, Vec<usize>> = HashMap::new();
    for (i, number) in whole.chosen.iter().zip(&repeats.numbers) {
        at_place.entry(*number).or_default().push(*i);
    }
    let turns = at_place.values().map(Vec::len).max()?;
    let complete = at_place.values().all(|images| images.len() == turns);
    // Times of day: a series that goes on past midnight begins with the late ones.
    const HALF_A_DAY: f64 = 12e4;
    let time = |s: &Slice| Key::TIME.number(s);
    let times = || whole.chosen.iter().filter_map(|i| group.slices.get(*i).and_then(time));
    let past_midnight = times().fold(0.0, f64::max) - times().fold(f64::MAX, f64::min) > HALF_A_DAY;
    let is_late = |s: &Slice| past_midnight && time(s).is_some_and(|time| time < HALF_A_DAY);
    let order = |i: &usize| {
        group
            .slices
            .get(*i)
            .map(|s| (is_late(s), Key::TIME.value(s), Key::TRIGGER.value(s), s.instance, s.frame, s.identity))
    };
    let numbered = |i: &usize| group.slices.get(*i).is_some_and(|s| s.instance.is_some() || s.frame > 0);
    if !whole.chosen.iter().all(numbered) {
        return None;
    }
    let mut parts = vec![Vec::new(); turns];
    for images in at_place.values_mut() {
        crate::order::by_key(images, order);
        // Two images without a distinguishing attribute have no order.
        if !images.is_sorted_by(|a, b| order(a) < order(b)) {
            return None;
        }
        for (part, image) in parts.iter_mut().zip(images) {
            part.push(*image);
        }
    }
    let mut ordered: Vec<(usize, usize)> =
        whole.chosen.iter().copied().zip(repeats.numbers.iter().copied()).collect();
    let is_sound = |ordered: &[(usize, usize)]| {
        let mut turn: HashMap<usize, usize> = HashMap::new();
        let count = |(_, place): &(usize, usize)| {
            let next = turn.entry(*place).or_default();
            *next += 1;
            (*next - 1, *place)
        };
        let sequence: Vec<(usize, usize)> = ordered.iter().map(count).collect();
        if complete { is_regular(&sequence, turns) } else { is_broken_off(&sequence, repeats.places, turns) }
    };
    crate::order::by_key(&mut ordered, |(i, _)| order(i));
    if !is_sound(&ordered) {
        // Times since the beat of a heart differ from slice to slice: then the order of instances counts, if
        // times follow it at every position.
        let instance = |i: &usize| group.slices.get(*i).map(|s| (s.instance, s.frame, s.identity));
        let agrees = |images: &Vec<usize>| images.is_sorted_by_key(instance);
        crate::order::by_key(&mut ordered, |(i, _)| instance(i));
        if !at_place.values().all(agrees) || !is_sound(&ordered) {
            return None;
        }
    }
    let part = |(k, mut chosen): (usize, Vec<usize>)| {
        chosen.sort_unstable();
        let label = format!("{} set {} of {turns}", whole.label, k + 1).trim().to_owned();
        let mut by = whole.by.clone();
        by.push(Attribute::AcquisitionOrder);
        Part { chosen, label, by }
    };
    Some(parts.into_iter().enumerate().map(part).collect())
}

/// True if such a sequence goes through all positions several times, and through some of them at the end. After a
/// single pass those could as well be replacements.
fn is_broken_off(sequence: &[(usize, usize)], places: usize, turns: usize) -> bool {
    let mut runs = sequence.chunks(places).enumerate();
    turns > 2 && runs.all(|(k, run)| run.iter().all(|(turn, _)| *turn == k))
}

/// True if a sequence of (times that the position was met before, position) consists of blocks in which the same
/// positions are met once, then all of them once more, and so on.
fn is_regular(sequence: &[(usize, usize)], turns: usize) -> bool {
    let mut rest = sequence;
    while let Some((first, _)) = rest.first() {
        if *first != 0 {
            return false;
        }
        let mut places: Option<Vec<usize>> = None;
        for turn in 0..turns {
            let length = match &places {
                Some(known) => known.len(),
                None => rest.iter().take_while(|(t, _)| *t == 0).count(),
            };
            let Some((run, after)) = rest.split_at_checked(length) else { return false };
            let mut own: Vec<usize> = run.iter().map(|(_, place)| *place).collect();
            own.sort_unstable();
            if run.iter().any(|(t, _)| *t != turn) || places.as_ref().is_some_and(|known| *known != own) {
                return false;
            }
            places = Some(own);
            rest = after;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_order_that_says_something_is_regular() {
        let sequence = |places: &[usize]| {
            let mut met = HashMap::new();
            let mut turn = |place: &usize| {
                let next = met.entry(*place).or_insert(0);
                *next += 1;
                (*next - 1, *place)
            };
            places.iter().map(&mut turn).collect::<Vec<_>>()
        };
        for good in [
            &[0, 1, 2, 3, 0, 1, 2, 3][..],
            &[0, 2, 1, 3, 3, 1, 0, 2],
            &[0, 0, 1, 1, 2, 2, 3, 3],
            &[0, 2, 0, 2, 1, 3, 1, 3],
        ] {
            assert!(is_regular(&sequence(good), 2), "{good:?}");
        }
        assert!(is_regular(&sequence(&[0, 1, 0, 1, 0, 1, 2, 2, 2]), 3));
        for bad in [&[0, 1, 2, 1, 0, 3, 2, 3][..], &[0, 1, 1, 2, 0, 2, 3, 3]] {
            assert!(!is_regular(&sequence(bad), 2), "{bad:?}");
        }
        assert!(is_broken_off(&sequence(&[0, 1, 2, 1, 0, 2, 2, 0]), 3, 3));
        assert!(!is_broken_off(&sequence(&[0, 1, 2, 1]), 3, 2));
        assert!(!is_broken_off(&sequence(&[0, 1, 2, 1, 0, 0, 2, 0]), 3, 4));
    }

    #[test]
    fn types_are_told_apart_in_words() {
        let philips = ["ORIGINAL\\PRIMARY\\SW_M_FFE\\SW_M\\FFE", "ORIGINAL\\PRIMARY\\SW_P_FFE\\SW_P\\FFE"];
        assert_eq!(type_label(philips[0], &philips), "magnitude");
        assert_eq!(type_label(philips[1], &philips), "phase");
        let siemens = ["ORIGINAL\\PRIMARY\\M\\ND", "ORIGINAL\\PRIMARY\\P\\ND"];
        assert_eq!(
            (type_label(siemens[0], &siemens), type_label(siemens[1], &siemens)),
            ("magnitude".into(), "phase".into())
        );
        let dixon = ["ORIGINAL\\PRIMARY\\WATER", "ORIGINAL\\PRIMARY\\FAT", "ORIGINAL\\PRIMARY"];
        assert_eq!(type_label(dixon[0], &dixon), "water");
        assert_eq!(type_label(dixon[2], &dixon), "");
    }
}
