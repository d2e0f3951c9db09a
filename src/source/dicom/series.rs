//! Orders the images of a group by position and judges whether they form a volume
//! (PS3.3 C.7.6.2; `x` runs along a row, `y` down the columns, `z` along `x` x `y`).

use std::fmt::Write as _;

use super::survey::{Group, Slice};
use crate::geom::Affine;

/// Gaps that differ less than this from the mean are even: scanners print positions in micrometres.
const EVEN: f64 = 1e-3;

/// Gaps that differ more than this make a regular grid wrong by a visible part of a voxel: refused.
const UNEVEN: f64 = 0.05;

/// Positions closer than this part of the usual gap are the same position.
const SAME: f64 = 0.01;

/// Closest positions in mm that count as two.
const SAME_MM: f64 = 1e-3;

/// Tilt in degrees from which it is worth a sentence.
const TILT_DEGREES: f64 = 0.1;

/// Sideways deviation of a slice from the common line, in pixels, from which it is worth a sentence.
const SIDEWAYS_PIXELS: f64 = 0.1;

/// Images in order, with their place in the patient.
#[derive(Debug)]
pub(super) struct Stack {
    /// Indices into the group's slices, by increasing position.
    pub(super) order: Vec<usize>,
    pub(super) affine: Affine,
    pub(super) warnings: Vec<String>,
}

/// Why images form no volume.
#[derive(Debug)]
pub(super) enum Refusal {
    /// Some positions occur more than once: perhaps several volumes in one series.
    Repeated(String),
    /// Anything else.
    Other(String),
}

/// Orders the chosen slices of a group. `name` gives a file's name for messages.
pub(super) fn assemble(
    group: &Group,
    chosen: &[usize],
    name: &dyn Fn(usize) -> String,
) -> Result<Stack, Refusal> {
    let mut warnings = Vec::new();
    let slices: Vec<(usize, &Slice)> =
        chosen.iter().filter_map(|i| group.slices.get(*i).map(|s| (*i, s))).collect();
    let [dx, dy] = pixel_spacing(group, &mut warnings);
    let placed = slices.iter().all(|(_, s)| s.position.is_some());
    let Some(axes) = group.first.orientation.filter(|_| placed) else {
        return without_positions(group, &slices, [dx, dy], warnings);
    };
    let (row, column) = perpendicular(axes).ok_or_else(|| {
        Refusal::Other("the image orientation is not two perpendicular unit vectors".into())
    })?;
    let normal = cross(row, column);
    let mut placed: Vec<(f64, [f64; 3], usize, &Slice)> =
        slices.iter().filter_map(|(i, s)| s.position.map(|p| (dot(p, normal), p, *i, *s))).collect();
    placed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let (Some(first), Some(last)) = (placed.first(), placed.last()) else {
        return Err(Refusal::Other("no image".into()));
    };
    let file = |at: usize| placed.get(at).map(|p| name(p.3.file)).unwrap_or_default();
    let origin = first.1;
    let step = if placed.len() == 1 {
        normal.map(|c| c * lone_thickness(group, &mut warnings))
    } else {
        let along: Vec<f64> = placed.iter().map(|p| p.0).collect();
        judge_gaps(&along, &file, &mut warnings)?;
        let steps = count(placed.len() - 1);
        let step = [0, 1, 2].map(|i| (last.1[i] - origin[i]) / steps);
        judge_line(&placed.iter().map(|p| p.1).collect::<Vec<_>>(), step, normal, [dx, dy], &mut warnings);
        step
    };
    let numbers: Vec<i32> = placed.iter().filter_map(|p| p.3.instance).collect();
    if numbers.len() == placed.len()
        && !numbers.is_sorted_by(|a, b| a < b)
        && !numbers.is_sorted_by(|a, b| a > b)
    {
        warnings.push("instance numbers do not follow the positions; slices are ordered by position".into());
    }
    let order: Vec<usize> = placed.iter().map(|p| p.2).collect();
    let affine = Affine { rows: [0, 1, 2].map(|i| [row[i] * dx, column[i] * dy, step[i], origin[i]]) };
    if affine.inverse().is_none() {
        return Err(Refusal::Other("the positions do not span a volume".into()));
    }
    Ok(Stack { order, affine, warnings })
}

/// Splits slices that repeat positions: by image type (magnitude and phase), else by acquisition.
pub(super) fn split(group: &Group, chosen: &[usize]) -> Vec<Vec<usize>> {
    let by = |key: &dyn Fn(&Slice) -> i64| {
        let mut parts: Vec<(i64, Vec<usize>)> = Vec::new();
        for i in chosen {
            let Some(slice) = group.slices.get(*i) else { continue };
            let key = key(slice);
            match parts.iter_mut().find(|(k, _)| *k == key) {
                Some((_, part)) => part.push(*i),
                None => parts.push((key, vec![*i])),
            }
        }
        parts.into_iter().map(|(_, part)| part).collect::<Vec<_>>()
    };
    let types = by(&|s| s.image_type.into());
    if types.len() > 1 { types } else { by(&|s| s.acquisition.into()) }
}

/// Distance of columns, then of rows: x before y, the reverse of the attribute.
fn pixel_spacing(group: &Group, warnings: &mut Vec<String>) -> [f64; 2] {
    match group.first.pixel_spacing {
        Some([dy, dx]) if dx > 0.0 && dy > 0.0 => [dx, dy],
        _ => {
            warnings.push("the images state no pixel spacing; 1 mm is assumed".into());
            [1.0, 1.0]
        }
    }
}

/// Extent of a single slice along its normal.
fn lone_thickness(group: &Group, warnings: &mut Vec<String>) -> f64 {
    let positive = |v: Option<f64>| v.filter(|mm| *mm > 0.0);
    let stated = positive(group.first.slice_thickness).or(positive(group.first.spacing_between));
    warnings.push(match stated {
        Some(mm) => {
            format!("there is one slice only; its stated thickness, {mm} mm, is taken as its spacing")
        }
        None => "there is one slice only, and no thickness is stated; 1 mm is assumed".into(),
    });
    stated.unwrap_or(1.0)
}

/// No positions: the order of instance numbers, and stated distances, with a warning.
fn without_positions(
    group: &Group,
    slices: &[(usize, &Slice)],
    [dx, dy]: [f64; 2],
    mut warnings: Vec<String>,
) -> Result<Stack, Refusal> {
    let mut numbered: Vec<(i32, usize)> =
        slices.iter().filter_map(|(i, s)| s.instance.map(|n| (n, *i))).collect();
    numbered.sort_unstable();
    let distinct = numbered.is_sorted_by(|a, b| a.0 < b.0) && numbered.len() == slices.len();
    let order = match slices {
        [(only, _)] => vec![*only],
        _ if distinct => numbered.iter().map(|(_, i)| *i).collect(),
        _ => {
            let reason = "the images state no positions and no distinct instance numbers, so their order is \
                          unknown; convert them to a raw volume in the right order";
            return Err(Refusal::Other(reason.into()));
        }
    };
    let positive = |v: Option<f64>| v.filter(|mm| *mm > 0.0);
    let dz = positive(group.first.spacing_between).or(positive(group.first.slice_thickness)).unwrap_or(1.0);
    warnings.push(format!(
        "the images state no positions: ordered by instance number, {dz} mm apart, placed at the origin"
    ));
    Ok(Stack { order, affine: Affine::from_spacing([dx, dy, dz]), warnings })
}

/// Refuses repeated positions and uneven gaps, and says where; warns of small deviations.
fn judge_gaps(
    along: &[f64],
    file: &dyn Fn(usize) -> String,
    warnings: &mut Vec<String>,
) -> Result<(), Refusal> {
    let gaps: Vec<f64> = along.windows(2).map(|w| w[1] - w[0]).collect();
    let mut sorted = gaps.clone();
    sorted.sort_by(f64::total_cmp);
    let total = along.last().zip(along.first()).map_or(0.0, |(b, a)| b - a);
    if total <= SAME_MM {
        return Err(Refusal::Repeated(format!(
            "all {} images are at one position; they form no volume",
            along.len()
        )));
    }
    let usual = sorted.get(sorted.len().saturating_sub(1) / 2).copied().unwrap_or(total);
    let same = SAME_MM.max(SAME * usual);
    let repeats = gaps.iter().filter(|g| **g <= same).count();
    if let Some(at) = gaps.iter().position(|g| *g <= same) {
        return Err(Refusal::Repeated(format!(
            "{repeats} of {} images repeat the position of another (first: {} and {}); remove duplicates, or give \
             the files of one volume",
            along.len(),
            file(at),
            file(at + 1)
        )));
    }
    let mean = total / count(gaps.len());
    let worst = gaps.iter().map(|g| (g - mean).abs()).fold(0.0, f64::max) / mean;
    if worst > UNEVEN {
        return Err(Refusal::Other(uneven(&gaps, usual, file)));
    }
    if worst > EVEN {
        let start = along.first().copied().unwrap_or(0.0);
        let off =
            along.iter().enumerate().map(|(i, p)| (p - start - count(i) * mean).abs()).fold(0.0, f64::max);
        warnings.push(format!(
            "slices are not quite evenly spaced: gaps differ by up to {:.2} % from their mean {mean:.4} mm, and \
             slices lie up to {off:.3} mm off the regular grid",
            100.0 * worst
        ));
    }
    Ok(())
}

/// The sentence on uneven gaps: which lengths occur how often, and where slices seem to be missing.
fn uneven(gaps: &[f64], usual: f64, file: &dyn Fn(usize) -> String) -> String {
    const KINDS: usize = 6;
    // Gaps as long as the first of their kind: how many, and their sum.
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
    kinds.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.total_cmp(&b.0)));
    let mut text = format!("the slices are unevenly spaced: {} gaps along the normal, ", gaps.len());
    for (i, (_, n, sum)) in kinds.iter().take(KINDS).enumerate() {
        let _ = write!(text, "{}{n} x {:.3}", if i > 0 { ", " } else { "" }, sum / count(*n));
    }
    if kinds.len() > KINDS {
        let _ = write!(text, " and {} other lengths", kinds.len() - KINDS);
    }
    text += " mm";
    // Missing slices leave gaps of whole multiples of the usual one.
    let multiple = |gap: f64| (gap / usual).round();
    let whole =
        gaps.iter().all(|g| multiple(*g) >= 1.0 && (g - multiple(*g) * usual).abs() <= UNEVEN * usual);
    let odd = |g: &f64| if whole { multiple(*g) > 1.0 } else { (g - usual).abs() > UNEVEN * usual };
    let at = gaps.iter().position(odd).unwrap_or(0);
    let place = format!("between {} and {}", file(at), file(at + 1));
    if whole {
        let lost: f64 = gaps.iter().map(|g| multiple(*g) - 1.0).sum();
        let places = gaps.iter().filter(|g| odd(g)).count();
        let _ = write!(text, "; {lost} slice(s) seem to be missing in {places} place(s), first {place}");
    } else {
        let _ = write!(text, "; first {place}");
    }
    text + "; add the missing slices, or give the files of an evenly spaced part"
}

/// Warns of tilt, and of slices beside the line from the first to the last.
fn judge_line(
    positions: &[[f64; 3]],
    step: [f64; 3],
    normal: [f64; 3],
    [dx, dy]: [f64; 2],
    warnings: &mut Vec<String>,
) {
    let tilt = (dot(step, normal) / dot(step, step).sqrt()).clamp(-1.0, 1.0).acos().to_degrees();
    if tilt > TILT_DEGREES {
        warnings.push(format!(
            "the slices are stacked {tilt:.2} degrees off their normal (gantry tilt); the volume is sheared to match"
        ));
    }
    let Some(origin) = positions.first() else { return };
    let sideways = positions.iter().enumerate().map(|(i, p)| {
        let off = [0, 1, 2].map(|k| p[k] - origin[k] - count(i) * step[k]);
        let along = dot(off, normal);
        let side = [0, 1, 2].map(|k| off[k] - along * normal[k]);
        dot(side, side).sqrt()
    });
    let worst = sideways.fold(0.0, f64::max);
    if worst > SIDEWAYS_PIXELS * dx.min(dy) {
        warnings.push(format!("some slices lie up to {worst:.3} mm beside the line of the others"));
    }
}

/// The two directions made unit length, if they are nearly so and perpendicular.
fn perpendicular(axes: [f64; 6]) -> Option<([f64; 3], [f64; 3])> {
    let [a, b, c, d, e, f] = axes;
    let unit = |v: [f64; 3]| {
        let length = dot(v, v).sqrt();
        ((length - 1.0).abs() < 0.01).then(|| v.map(|x| x / length))
    };
    let (row, column) = (unit([a, b, c])?, unit([d, e, f])?);
    (dot(row, column).abs() < 0.01).then_some((row, column))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[expect(clippy::cast_precision_loss, reason = "numbers of slices are far below 2^53")]
fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaps(along: &[f64]) -> Result<Vec<String>, String> {
        let mut warnings = Vec::new();
        match judge_gaps(along, &|i| format!("f{i}"), &mut warnings) {
            Ok(()) => Ok(warnings),
            Err(Refusal::Repeated(text) | Refusal::Other(text)) => Err(text),
        }
    }

    #[test]
    fn gaps_are_accepted_warned_of_or_refused_with_the_place() {
        assert_eq!(gaps(&[0.0, 5.0, 10.0, 15.0]), Ok(vec![]));
        assert_eq!(gaps(&[0.0, 5.0, 10.001, 15.0]), Ok(vec![]));
        let warned = gaps(&[0.0, 5.0, 10.1, 15.0]).unwrap();
        assert!(warned[0].contains("2.00 %"), "{warned:?}");
        let missing = gaps(&[0.0, 5.0, 10.0, 20.0, 35.0]).unwrap_err();
        assert!(
            missing.contains("3 slice(s) seem to be missing in 2 place(s), first between f2 and f3"),
            "{missing}"
        );
        let odd = gaps(&[0.0, 4.0, 8.0, 9.0, 13.0]).unwrap_err();
        assert!(odd.contains("3 x 4.000, 1 x 1.000 mm; first between f2 and f3"), "{odd}");
        assert!(gaps(&[3.0, 3.0, 3.0]).unwrap_err().contains("all 3 images are at one position"));
        let twice = gaps(&[0.0, 5.0, 5.0, 10.0]).unwrap_err();
        assert!(twice.contains("1 of 4 images") && twice.contains("f1 and f2"), "{twice}");
    }

    #[test]
    fn directions_must_be_perpendicular_units() {
        assert!(perpendicular([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).is_some());
        for bad in [[0.0; 6], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0]] {
            assert!(perpendicular(bad).is_none());
        }
    }
}
