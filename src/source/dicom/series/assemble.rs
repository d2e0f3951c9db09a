//! Orders the images of a group by position and judges whether they form a volume
//! (PS3.3 C.7.6.2; `x` runs along a row, `y` down the columns, `z` along `x` x `y`).

use super::axes::{count, directions};
use super::gaps::{Grid, judge_gaps, with_empty_slices};
use super::group::{Group, Shared, Slice};
use super::mosaic;
use crate::fault::{Fault, unfit};
use crate::geom::{Affine, dot};
use crate::source::GapPolicy;
use crate::source::dicom::series::gaps::ImageName;
use crate::volume::Note;

/// Images in order, with their place in the patient.
pub(crate) struct Stack {
    /// The slices of the volume, by increasing position.
    pub(crate) layers: Vec<Layer>,
    pub(crate) affine: Affine,
    pub(crate) notes: Vec<Note>,
}

/// A slice of the volume; numbers are indices into the group's slices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Layer {
    /// An image.
    Image(usize),
    /// A tile of an image.
    Tile(usize, u32),
    /// An empty slice that a segmentation leaves out.
    Empty,
    /// A missing slice: part of the way from the first image to the second.
    Between(usize, usize, f64),
}

/// Tilt in degrees from which it is reported.
const TILT_DEGREES: f64 = 0.1;

/// Sideways deviation of a slice from the common line, in pixels, from which it is reported.
const SIDEWAYS_PIXELS: f64 = 0.1;

/// Directions of rows and columns that are assumed where slices state positions alone.
const UPRIGHT: [f64; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Orders the chosen slices of a group. `name` names a slice.
pub(crate) fn assemble(
    group: &Group,
    chosen: &[usize],
    gaps: GapPolicy,
    name: &dyn Fn(&Slice) -> ImageName,
) -> Result<Stack, Fault> {
    let mut notes = Vec::new();
    let slices: Vec<(usize, &Slice)> =
        chosen.iter().filter_map(|i| group.slices.get(*i).map(|s| (*i, s))).collect();
    if let Some(of_each) = &group.shared.mosaic
        && let [(index, slice)] = slices.as_slice()
    {
        let spacing = pixel_spacing(&group.shared, &mut notes);
        let place = group.shared.orientation.zip(slice.position());
        return mosaic::assemble(of_each, *index, spacing, place, notes);
    }
    let [dx, dy] = pixel_spacing(&group.shared, &mut notes);
    let placed = slices.iter().all(|(_, s)| s.position().is_some());
    let mut orientation = group.shared.orientation;
    if orientation.is_none() && placed && rises(&slices) {
        notes.push(Note::new("the images state positions, but no orientation; rows are taken as running to the left, columns to the back"));
        orientation = Some(UPRIGHT);
    }
    let Some(axes) = orientation.filter(|_| placed) else {
        return without_positions(group, &slices, [dx, dy], notes);
    };
    let (row, column, normal) =
        directions(axes).ok_or(unfit!("the image orientation is not two perpendicular unit vectors"))?;
    let mut placed: Vec<(f64, [f64; 3], usize, &Slice)> =
        slices.iter().filter_map(|(i, s)| s.position().map(|p| (dot(p, normal), p, *i, *s))).collect();
    crate::order::by(&mut placed, |a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let (Some(first), Some(last)) = (placed.first(), placed.last()) else {
        return Err(unfit!("no image"));
    };
    let origin = first.1;
    let (step, layers) = if placed.len() == 1 {
        (normal.map(|c| c * lone_thickness(group, &mut notes)), vec![Layer::Image(first.2)])
    } else {
        let along: Vec<f64> = placed.iter().map(|p| p.0).collect();
        let file = |at: usize| placed.get(at).map(|p| name(p.3)).unwrap_or_default();
        let image = |at: usize| placed.get(at).map_or(0, |p| p.2);
        let sparse = group.shared.leaves_out_empty && gaps != GapPolicy::Keep;
        let sparse = if sparse { with_empty_slices(&along, group.shared.spacing_between) } else { None };
        let grid = match &sparse {
            Some(_) => Grid::AsTheyAre,
            None => judge_gaps(&along, gaps, &file, &mut notes)?,
        };
        let layers: Vec<Layer> = match (sparse, grid) {
            (Some(places), _) => {
                let slices = places.iter().filter(|p| p.is_none()).count();
                notes.push(Note::new(format!(
                    "{slices} slices for which the segmentation has no frame are empty"
                )));
                places.iter().map(|place| place.map_or(Layer::Empty, |at| Layer::Image(image(at)))).collect()
            }
            (None, Grid::AsTheyAre) => (0..placed.len()).map(|at| Layer::Image(image(at))).collect(),
            (None, Grid::Filled(places)) => {
                let layer = |place: &(usize, f64)| match *place {
                    (at, 0.0) => Layer::Image(image(at)),
                    (at, part) => Layer::Between(image(at), image(at + 1), part),
                };
                places.iter().map(layer).collect()
            }
        };
        let whole = [0, 1, 2].map(|i| last.1[i] - origin[i]);
        let points: Vec<[f64; 3]> = placed.iter().map(|p| p.1).collect();
        judge_line(&points, whole, normal, [dx, dy], &mut notes);
        let steps = count(layers.len().saturating_sub(1));
        (whole.map(|c| c / steps), layers)
    };
    let numbers: Vec<(i32, u32)> =
        placed.iter().filter_map(|p| p.3.instance.map(|n| (n, p.3.frame))).collect();
    let one_file_each = placed.iter().all(|p| p.3.frame == 0);
    if one_file_each
        && numbers.len() == placed.len()
        && !numbers.is_sorted_by(|a, b| a < b)
        && !numbers.is_sorted_by(|a, b| a > b)
    {
        notes.push(Note::new("instance numbers do not follow the positions; slices are ordered by position"));
    }
    let affine = Affine { rows: [0, 1, 2].map(|i| [row[i] * dx, column[i] * dy, step[i], origin[i]]) };
    if affine.inverse().is_none() {
        return Err(unfit!("the positions do not span a volume"));
    }
    Ok(Stack { layers, affine, notes })
}

/// True if positions differ along z.
fn rises(slices: &[(usize, &Slice)]) -> bool {
    let mut heights = slices.iter().map(|(_, s)| s.at[2]);
    let first = heights.next().unwrap_or(0.0);
    heights.any(|z| (z - first).abs() > 1e-3)
}

/// Positions of the chosen slices along their common normal; `None` without directions or positions.
pub(crate) fn along_normal(group: &Group, chosen: &[usize]) -> Option<Vec<f64>> {
    let slices: Vec<(usize, &Slice)> =
        chosen.iter().filter_map(|i| group.slices.get(*i).map(|s| (*i, s))).collect();
    let axes = group.shared.orientation.or_else(|| rises(&slices).then_some(UPRIGHT));
    let (_, _, normal) = directions(axes?)?;
    slices.iter().map(|(_, s)| s.position().map(|p| dot(p, normal))).collect()
}

/// Distance of columns, then of rows: x before y, the reverse of the attribute.
pub(crate) fn pixel_spacing(shared: &Shared, notes: &mut Vec<Note>) -> [f64; 2] {
    match shared.pixel_spacing {
        Some([dy, dx]) if dx > 0.0 && dy > 0.0 => [dx, dy],
        stated => {
            notes.push(Note::spacing(match stated {
                Some([dy, dx]) => {
                    format!("the images state a pixel spacing of {dy} x {dx} mm; 1 mm is assumed")
                }
                None => "the images state no pixel spacing; 1 mm is assumed".to_owned(),
            }));
            [1.0, 1.0]
        }
    }
}

/// Extent of a single slice along its normal.
fn lone_thickness(group: &Group, notes: &mut Vec<Note>) -> f64 {
    let positive = |v: Option<f64>| v.filter(|mm| *mm > 0.0);
    let stated = positive(group.shared.slice_thickness).or(positive(group.shared.spacing_between));
    notes.push(match stated {
        Some(mm) => Note::new(format!(
            "there is only one slice; its stated thickness, {mm} mm, is taken as its spacing"
        )),
        None => Note::spacing("there is only one slice, and no thickness is stated; 1 mm is assumed"),
    });
    stated.unwrap_or(1.0)
}

/// No positions: the order of instance numbers, and stated distances, with a warning.
fn without_positions(
    group: &Group,
    slices: &[(usize, &Slice)],
    [dx, dy]: [f64; 2],
    mut notes: Vec<Note>,
) -> Result<Stack, Fault> {
    let number = |s: &Slice| s.instance.map(|n| (n, s.frame));
    let mut numbered: Vec<((i32, u32), usize)> =
        slices.iter().filter_map(|(i, s)| number(s).map(|n| (n, *i))).collect();
    crate::order::by(&mut numbered, Ord::cmp);
    let distinct = numbered.is_sorted_by(|a, b| a.0 < b.0) && numbered.len() == slices.len();
    let frames = slices.iter().all(|(_, s)| Some(s.file) == slices.first().map(|(_, s)| s.file));
    let order: Vec<usize> = match slices {
        [(only, _)] => vec![*only],
        _ if distinct => numbered.iter().map(|(_, i)| *i).collect(),
        _ if frames => {
            let mut order: Vec<(u32, usize)> = slices.iter().map(|(i, s)| (s.frame, *i)).collect();
            crate::order::by(&mut order, Ord::cmp);
            order.into_iter().map(|(_, i)| i).collect()
        }
        _ => {
            return Err(unfit!(
                "the images state no positions and no distinct instance numbers, so their order is unknown; convert them to a raw volume in the right order"
            ));
        }
    };
    let positive = |v: Option<f64>| v.filter(|mm| *mm > 0.0);
    let dz = positive(group.shared.spacing_between).or(positive(group.shared.slice_thickness)).unwrap_or(1.0);
    let by =
        if frames && slices.len() > 1 { "in the order of the frames" } else { "ordered by instance number" };
    notes
        .push(Note::new(format!("the images state no positions: {by}, {dz} mm apart, placed at the origin")));
    let layers = order.into_iter().map(Layer::Image).collect();
    Ok(Stack { layers, affine: Affine::from_spacing([dx, dy, dz]), notes })
}

/// Warns of tilt, and of slices off the line from the first to the last.
fn judge_line(
    positions: &[[f64; 3]],
    whole: [f64; 3],
    normal: [f64; 3],
    [dx, dy]: [f64; 2],
    notes: &mut Vec<Note>,
) {
    let tilt = (dot(whole, normal) / dot(whole, whole).sqrt()).clamp(-1.0, 1.0).acos().to_degrees();
    if tilt > TILT_DEGREES {
        notes.push(Note::new(format!("the slices are stacked {tilt:.2} degrees off their normal (gantry tilt); the volume is sheared to match")));
    }
    let Some(origin) = positions.first() else { return };
    let height = dot(whole, normal);
    let sideways = positions.iter().map(|p| {
        let away = [0, 1, 2].map(|k| p[k] - origin[k]);
        let part = dot(away, normal) / height;
        let off = [0, 1, 2].map(|k| away[k] - part * whole[k]);
        dot(off, off).sqrt()
    });
    let worst = sideways.fold(0.0, f64::max);
    if worst > SIDEWAYS_PIXELS * dx.min(dy) {
        notes.push(Note::new(format!("some slices are up to {worst:.3} mm off the line of the others")));
    }
}
