//! Distances between slices: even, repeated, or with gaps, and the treatment of gaps.

use std::fmt;
use std::path::PathBuf;

use super::axes::count;
use crate::fault::{Fault, FaultKind, unfit};
use crate::source::GapPolicy;
use crate::text::names::GAPS;
use crate::text::{Count, shown};
use crate::volume::Note;

/// Deviation from the mean below which gaps are even: scanners print positions in micrometres.
const EVEN: f64 = 1e-3;

/// Deviation above which a regular grid would be wrong by a visible part of a voxel, and is refused.
const UNEVEN: f64 = 0.05;

/// Greatest error along any direction of positions rounded to a tenth of a millimetre.
const ROUNDED_MM: f64 = 0.0867;

/// Differences that such rounding explains, as a part of the mean gap; where a slice is missing, others lie
/// further off.
const ROUNDED: f64 = 0.25;

/// Positions closer than this part of the usual gap are the same position.
const SAME: f64 = 0.01;

/// Closest positions in mm that count as two.
const SAME_MM: f64 = 1e-3;

/// Most slices made for each existing one: more would be a picture of the interpolation.
const MAX_MADE: f64 = 10.0;

/// Gaps named in one warning.
const NAMED: usize = 4;

/// Origin of the slices of the volume.
#[derive(Debug, PartialEq)]
pub(crate) enum Grid {
    /// One slice for each image.
    AsTheyAre,
    /// Part of the way from this image to the next; 0 is the image itself.
    Filled(Vec<(usize, f64)>),
}

/// The usual gap of sorted positions (the lower median of the gaps), and the distance below which two positions are
/// one.
fn usual_gap(along: &[f64]) -> (f64, f64) {
    let mut gaps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).filter(|g| *g > SAME_MM).collect();
    gaps.sort_by(f64::total_cmp);
    let usual = gaps.get(gaps.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
    (usual, SAME_MM.max(SAME * usual))
}

/// Numbers the distinct positions of images, in their order along the normal. Returns for each image, in the given
/// order, the number of its position; and the number of positions.
pub(crate) fn positions(along: &[f64]) -> (Vec<usize>, usize) {
    let mut order: Vec<usize> = (0..along.len()).collect();
    let at = |i: usize| along.get(i).copied().unwrap_or(0.0);
    crate::order::by(&mut order, |a, b| at(*a).total_cmp(&at(*b)));
    let sorted: Vec<f64> = order.iter().map(|i| at(*i)).collect();
    let (_, same) = usual_gap(&sorted);
    let mut numbers = vec![0; along.len()];
    let mut number = 0;
    for (k, i) in order.iter().enumerate() {
        let before = k.checked_sub(1).and_then(|k| sorted.get(k));
        if before.is_some_and(|before| at(*i) - before > same) {
            number += 1;
        }
        if let Some(slot) = numbers.get_mut(*i) {
            *slot = number;
        }
    }
    (numbers, if along.is_empty() { 0 } else { number + 1 })
}

/// Most slices of a segmentation, empty ones included.
const MAX_LAYERS: f64 = 4096.0;

/// Images of a segmentation, which leaves out empty slices, on the grid of all slices: for each slice the number of its
/// image. `None` if images lie evenly already, or on no grid.
pub(crate) fn with_empty_slices(along: &[f64], stated: Option<f64>) -> Option<Vec<Option<usize>>> {
    if !is_uneven(along) {
        return None;
    }
    let start = *along.first()?;
    let (usual, _) = usual_gap(along);
    let fits = |step: &f64| {
        let on_grid = |p: &f64| {
            let place = (p - start) / step;
            place < MAX_LAYERS && (place - place.round()).abs() <= UNEVEN
        };
        *step > SAME_MM && along.iter().all(on_grid)
    };
    let step = stated.map(f64::abs).into_iter().chain([usual]).find(fits)?;
    let mut layers = Vec::new();
    for (image, place) in along.iter().map(|p| ((p - start) / step).round()).enumerate() {
        while count(layers.len()) < place {
            layers.push(None);
        }
        if count(layers.len()) > place {
            return None;
        }
        layers.push(Some(image));
    }
    Some(layers)
}

/// An image of a series.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ImageName {
    /// Name of its file, without the folder.
    pub file: PathBuf,
    /// Number of the frame, from 0, where files have several.
    pub frame: Option<u32>,
}

impl fmt::Display for ImageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        shown(&self.file).fmt(f)?;
        match self.frame {
            Some(frame) => write!(f, " (frame {})", u64::from(frame) + 1),
            None => Ok(()),
        }
    }
}

/// True if positions, in any order, are so uneven that they would be refused.
pub(crate) fn is_uneven(along: &[f64]) -> bool {
    let mut sorted = along.to_vec();
    sorted.sort_by(f64::total_cmp);
    let name = |_| ImageName::default();
    judge_gaps(&sorted, GapPolicy::Error, &name, &mut Vec::new())
        .is_err_and(|fault| fault.kind == FaultKind::Gaps)
}

/// Judges sorted positions: refuses repeated ones, and uneven gaps unless the policy handles them; notes small
/// deviations. `name` names an image.
pub(crate) fn judge_gaps(
    along: &[f64],
    policy: GapPolicy,
    name: &dyn Fn(usize) -> ImageName,
    notes: &mut Vec<Note>,
) -> Result<Grid, Fault> {
    let gaps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let total = along.last().zip(along.first()).map_or(0.0, |(b, a)| b - a);
    if total <= SAME_MM {
        return Err(unfit!(
            "all {} images are at one position; they form no volume: give the whole series, or build one image as a picture",
            along.len()
        ));
    }
    let (usual, same) = usual_gap(along);
    let repeats = gaps.iter().filter(|g| **g <= same).count();
    if let Some(at) = gaps.iter().position(|g| *g <= same) {
        let first = [name(at), name(at + 1)];
        return Err(unfit!(
            "{repeats} of {} images repeat the position of another (first: {} and {}), and nothing in their headers tells them apart; give the files of one volume",
            along.len(),
            first[0],
            first[1]
        ));
    }
    let mean = total / count(gaps.len());
    let worst = gaps.iter().map(|g| (g - mean).abs()).fold(0.0, f64::max) / mean;
    if worst <= EVEN {
        return Ok(Grid::AsTheyAre);
    }
    let start = along.first().copied().unwrap_or(0.0);
    let off = along.iter().enumerate().map(|(i, p)| (p - start - count(i) * mean).abs()).fold(0.0, f64::max);
    if worst <= UNEVEN || (off <= ROUNDED_MM && off <= ROUNDED * mean) {
        notes.push(Note::new(format!("slices are not quite evenly spaced: gaps differ by up to {:.2} % from their mean {mean:.4} mm, and slices lie up to {off:.3} mm off the regular grid", 100.0 * worst)));
        return Ok(Grid::AsTheyAre);
    }
    match policy {
        GapPolicy::Error => Err(uneven(&gaps, usual, name)),
        GapPolicy::Keep => {
            notes.push(Note::new(format!("unevenly spaced slices are used as if they were {mean:.4} mm apart; they lie up to {off:.3} mm off the places that the model shows them at")));
            Ok(Grid::AsTheyAre)
        }
        GapPolicy::Fill => fill(along, total, (usual, same), name, notes),
    }
}

/// A regular grid from the first to the last slice, its step as near to the usual gap as it can be.
fn fill(
    along: &[f64],
    total: f64,
    (usual, same): (f64, f64),
    name: &dyn Fn(usize) -> ImageName,
    notes: &mut Vec<Note>,
) -> Result<Grid, Fault> {
    let steps = (total / usual).round().max(1.0);
    if steps > MAX_MADE * count(along.len()) {
        return Err(unfit!(
            "{steps} slices would have to be made out of {}; give the files of an evenly spaced part",
            along.len()
        ));
    }
    let step = total / steps;
    // An image stands for a place that it misses by no more than is accepted where nothing is missing.
    let near = same.max(UNEVEN * step);
    let start = along.first().copied().unwrap_or(0.0);
    let mut places = Vec::new();
    let (mut made, mut used, mut worst, mut below, mut k) = (0_u64, 0_usize, 0.0_f64, 0_usize, 0_usize);
    let mut last_used = None;
    // Gaps with made slices: the image before each, and the number of slices.
    let mut holes: Vec<(usize, u64)> = Vec::new();
    while count(k) <= steps {
        let place = start + count(k) * step;
        while along.get(below + 1).is_some_and(|next| *next <= place) {
            below += 1;
        }
        let here = along.get(below).copied().unwrap_or(start);
        let next = along.get(below + 1).copied();
        let image = if (place - here).abs() <= near {
            Some(below)
        } else {
            next.filter(|next| (next - place).abs() <= near).map(|_| below + 1)
        };
        match (image, next) {
            (Some(at), _) => {
                worst = worst.max((along.get(at).copied().unwrap_or(place) - place).abs());
                used += usize::from(last_used != Some(at));
                last_used = Some(at);
                places.push((at, 0.0));
            }
            (None, Some(next)) => {
                made += 1;
                match holes.last_mut() {
                    Some((at, n)) if *at == below => *n += 1,
                    _ => holes.push((below, 1)),
                }
                places.push((below, (place - here) / (next - here)));
            }
            // Past the last image, by rounding alone.
            (None, None) => places.push((below, 0.0)),
        }
        k += 1;
    }
    let mut text = format!(
        "gaps between slices were filled: {made} of {} were made by interpolation between neighbours (",
        places.len()
    );
    for (i, (at, made)) in holes.iter().take(NAMED).enumerate() {
        text +=
            &format!("{}{made} between {} and {}", if i > 0 { ", " } else { "" }, name(*at), name(at + 1));
    }
    if holes.len() > NAMED {
        text += &format!(", and in {} more places", holes.len() - NAMED);
    }
    text += &format!("), on a regular grid of {step:.4} mm from the first to the last");
    let unused = along.len() - used.min(along.len());
    if unused > 0 {
        text += &format!("; {unused} that lie off the grid only lend their values to those");
    }
    if worst > EVEN * step {
        text += &format!("; the others lie up to {worst:.3} mm off it");
    }
    notes.push(Note::new(text));
    Ok(Grid::Filled(places))
}

/// The fault of uneven gaps: their lengths with counts, and the places where slices seem to be missing.
fn uneven(gaps: &[f64], usual: f64, name: &dyn Fn(usize) -> ImageName) -> Fault {
    const KINDS: usize = 6;
    // Length of the first gap of each kind, number of gaps as long, and their sum.
    let mut kinds: Vec<(f64, usize, f64)> = Vec::new();
    for gap in gaps {
        match kinds.iter_mut().find(|(length, ..)| (length - gap).abs() <= EVEN * usual) {
            Some((_, n, sum)) => {
                *n += 1;
                *sum += gap;
            }
            None => kinds.push((*gap, 1, *gap)),
        }
    }
    crate::order::by(&mut kinds, |a, b| b.1.cmp(&a.1).then(a.0.total_cmp(&b.0)));
    // Missing slices leave gaps of whole multiples of the usual one.
    let multiple = |gap: f64| (gap / usual).round();
    let whole =
        gaps.iter().all(|g| multiple(*g) >= 1.0 && (g - multiple(*g) * usual).abs() <= UNEVEN * usual);
    let odd = |g: &f64| if whole { multiple(*g) > 1.0 } else { (g - usual).abs() > UNEVEN * usual };
    let at = gaps.iter().position(odd).unwrap_or(0);
    let mut text = format!("the slices are unevenly spaced: {} gaps along the normal, ", gaps.len());
    for (i, (_, n, sum)) in kinds.iter().take(KINDS).enumerate() {
        text += &format!("{}{n} x {:.3}", if i > 0 { ", " } else { "" }, sum / count(*n));
    }
    if kinds.len() > KINDS {
        text += &format!(" and {} other lengths", kinds.len() - KINDS);
    }
    text += " mm; ";
    if whole {
        let slices: f64 = gaps.iter().map(|g| multiple(*g) - 1.0).sum();
        let places = gaps.iter().filter(|g| odd(g)).count();
        text += &format!("probably missing: {} in {}, ", Count(slices, "slice"), Count(places, "place"));
    }
    text += &format!(
        "first between {} and {}; add the missing slices, give the files of an evenly spaced part, or choose {GAPS} fill or {GAPS} keep",
        name(at),
        name(at + 1)
    );
    Fault::new(FaultKind::Gaps, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(along: &[f64], policy: GapPolicy) -> Result<(Grid, Vec<String>), String> {
        let mut notes = Vec::new();
        let name = |i| ImageName { file: format!("f{i}").into(), frame: None };
        match judge_gaps(along, policy, &name, &mut notes) {
            Ok(grid) => Ok((grid, notes.iter().map(Note::to_string).collect())),
            Err(fault) => Err(fault.to_string()),
        }
    }

    fn gaps(along: &[f64]) -> Result<Vec<String>, String> {
        judged(along, GapPolicy::Error).map(|(grid, warnings)| {
            assert_eq!(grid, Grid::AsTheyAre);
            warnings
        })
    }

    #[test]
    fn gaps_are_accepted_warned_of_or_refused_with_the_place() {
        assert_eq!(gaps(&[0.0, 5.0, 10.0, 15.0]), Ok(vec![]));
        assert_eq!(gaps(&[0.0, 5.0, 10.001, 15.0]), Ok(vec![]));
        let warned = gaps(&[0.0, 5.0, 10.1, 15.0]).unwrap();
        assert!(warned[0].contains("2.00 %"), "{warned:?}");
        let missing = gaps(&[0.0, 5.0, 10.0, 20.0, 35.0]).unwrap_err();
        assert!(
            missing.contains("probably missing: 3 slices in 2 places, first between f2 and f3"),
            "{missing}"
        );
        let odd = gaps(&[0.0, 4.0, 8.0, 9.0, 13.0]).unwrap_err();
        assert!(odd.contains("3 x 4.000, 1 x 1.000 mm; first between f2 and f3"), "{odd}");
        assert!(gaps(&[3.0, 3.0, 3.0]).unwrap_err().contains("all 3 images are at one position"));
        let twice = gaps(&[0.0, 5.0, 5.0, 10.0]).unwrap_err();
        assert!(twice.contains("1 of 4 images") && twice.contains("f1 and f2"), "{twice}");
    }

    #[test]
    fn segmentations_leave_out_empty_slices() {
        let (a, none) = (Some, None);
        assert_eq!(with_empty_slices(&[0.0, 2.0, 4.0], Some(1.0)), None);
        assert_eq!(with_empty_slices(&[1.0, 3.0, 9.0], None), Some(vec![a(0), a(1), none, none, a(2)]));
        assert_eq!(
            with_empty_slices(&[1.0, 3.0, 6.0], Some(-1.0)),
            Some(vec![a(0), none, a(1), none, none, a(2)])
        );
        for bad in [&[0.0, 1.0, 2.5][..], &[0.0, 1.0, 1e9], &[0.0, 0.0, 1.0, 5.0]] {
            assert_eq!(with_empty_slices(bad, None), None, "{bad:?}");
        }
    }

    #[test]
    fn missing_slices_are_made_where_they_are_missing() {
        let (grid, warnings) = judged(&[0.0, 5.0, 10.0, 20.0, 35.0], GapPolicy::Fill).unwrap();
        let third = 1.0 / 3.0;
        let Grid::Filled(places) = grid else { panic!("not filled") };
        let expected =
            [(0, 0.0), (1, 0.0), (2, 0.0), (2, 0.5), (3, 0.0), (3, third), (3, 2.0 * third), (4, 0.0)];
        assert_eq!(places.len(), expected.len());
        for ((at, part), (e, f)) in places.iter().zip(expected) {
            assert!(*at == e && (part - f).abs() < 1e-12, "{places:?}");
        }
        assert!(warnings.len() == 1 && warnings[0].contains("3 of 8 were made"), "{warnings:?}");
        assert!(warnings[0].contains("(1 between f2 and f3, 2 between f3 and f4)"), "{warnings:?}");
    }

    #[test]
    fn irregular_slices_are_resampled_between_the_ends_only() {
        let along = [0.0, 4.0, 8.0, 9.0, 13.0, 20.0];
        let (grid, warnings) = judged(&along, GapPolicy::Fill).unwrap();
        let Grid::Filled(places) = grid else { panic!("not filled") };
        assert_eq!(places.len(), 6);
        for (k, (at, part)) in places.iter().enumerate() {
            let here = along[*at] + part * (along.get(at + 1).unwrap_or(&along[*at]) - along[*at]);
            assert!((here - 4.0 * count(k)).abs() < 0.2001, "{k}: {here}");
        }
        assert!(
            warnings[0].contains("2 of 6 were made") && warnings[0].contains("2 that lie off"),
            "{warnings:?}"
        );
        let far = judged(&[0.0, 1.0, 1e6], GapPolicy::Fill).unwrap_err();
        assert!(far.contains("1000000 slices"), "{far}");
    }

    #[test]
    fn kept_slices_state_their_largest_error() {
        let (grid, warnings) = judged(&[0.0, 5.0, 10.0, 20.0], GapPolicy::Keep).unwrap();
        assert_eq!(grid, Grid::AsTheyAre);
        assert!(
            warnings[0].contains("6.6667 mm apart") && warnings[0].contains("3.333 mm off"),
            "{warnings:?}"
        );
        // Repeats are not gaps: no policy covers them.
        assert!(judged(&[0.0, 0.0, 1.0], GapPolicy::Keep).is_err());
    }

    #[test]
    fn positions_are_numbered_along_the_normal() {
        assert_eq!(positions(&[5.0, 0.0, 5.0001, 10.0, 0.0]), (vec![1, 0, 1, 2, 0], 3));
        assert_eq!(positions(&[]), (vec![], 0));
    }
}
