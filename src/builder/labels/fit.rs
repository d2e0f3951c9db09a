//! The planes of a cell between labels (SPEC 4.12): one for two labels, two for three, else octants.
//!
//! A label on both sides of a thin sheet of another counts as two: samples connected around the cell belong together.
//!
//! A plane separates its corners strictly: `N . u` of a corner is odd, as the sizes of N sum up to 127, and offsets are
//! even. So samples never lie on a wall, and each has its own label. Where the fitted direction does not separate the
//! corners, it is turned until it does. Of three labels, one is separated from the others first: the one with the
//! fewest turned planes.

use std::sync::LazyLock;

use super::wall::{Fit, MAX_SMOOTH, Members, Wall, Window};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::cell::{CORNERS, SEPARABLE, at_corner};
use crate::format::{CornerLabels, WallItem, normal};

/// Most turns of a direction, and size of a turn.
const TURNS: u32 = 60;
const TURN: f32 = 0.03;
/// Overlap of two labels' corners along a direction beyond which its code does not separate them either: a code turns it
/// by up to a degree, which moves corners by .06.
const CODE_ERROR: f32 = 0.25;

/// Parameters of the fit of cells.
pub(super) struct CellFit {
    fit: Fit,
    /// Largest distance of a wall from the middle between the corners that it separates, in voxels.
    smooth: f32,
}

impl CellFit {
    /// A fit with walls at most `smooth` voxels from the middle.
    #[expect(clippy::cast_possible_truncation, reason = "0 to 0.5")]
    pub(super) fn new(smooth: f64) -> Self {
        Self { fit: Fit::new(), smooth: smooth.clamp(0.0, MAX_SMOOTH) as f32 }
    }
}

/// Stored form of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fitted {
    /// A plane: code of the normal, stored offset, labels behind and in front.
    Plane(u16, i8, [u16; 2]),
    /// Code of the normal, and the item that follows it.
    Item(u16, WallItem),
}

/// A plane that separates corners, and whether its normal was turned for it.
struct Parting {
    code: u16,
    offset: i8,
    is_turned: bool,
}

/// The labels of the corners, each once, the greatest first.
#[inline(always)]
fn distinct(corners: &CornerLabels) -> ([u16; CORNERS], usize) {
    let mut sorted = *corners;
    let (most, least) = sorted.iter().fold((0, u16::MAX), |(most, least), c| (most.max(*c), least.min(*c)));
    if corners.iter().fold(true, |two, corner| two & ((*corner == most) | (*corner == least))) {
        (sorted[0], sorted[1]) = (most, least);
        return (sorted, 1 + usize::from(most > least));
    }
    sorted.sort_unstable_by(|a, b| b.cmp(a));
    let mut count = 1;
    for at in 1..CORNERS {
        if sorted[at] != sorted[count - 1] {
            sorted[count] = sorted[at];
            count += 1;
        }
    }
    (sorted, count)
}

/// Describes a cell by its corners, which have at least two labels, and the samples around it.
#[inline(always)]
pub(super) fn fit_cell(
    isa: impl Lanes,
    fit: &CellFit,
    window: &Window<'_>,
    corners: &CornerLabels,
) -> Fitted {
    let (labels, count) = distinct(corners);
    match labels[..count] {
        [a, b] => {
            if let Some(Parting { code, offset, .. }) =
                parting((isa, fit), window.members(isa, a, Some(b)), corners, a, Some(b))
            {
                return Fitted::Plane(code, offset + i8::from(b > 0), [a, b]);
            }
            if let Some(two) = sheet((isa, fit), window, corners, [a, b]) {
                return two;
            }
        }
        [a, b, c] => {
            if let Some(two) = isa.call(TwoPlanes { fit, window, corners, labels: [a, b, c] }) {
                return two;
            }
        }
        _ => {}
    }
    let item = WallItem { labels: *corners, planes: None };
    Fitted::Item(smooth((isa, fit), window, corners, labels[0]), item)
}

/// The plane between the inside and the outside of a mask in a cell: code of its normal, and offset; `None` where none
/// separates the corners. `inside` are the inside ones of the 8^3 samples around the cell, `mask` the inside corners.
pub(in crate::builder) fn mask_plane(inside: &Members, mask: u8) -> Option<(u16, i8)> {
    static FIT: LazyLock<CellFit> = LazyLock::new(|| CellFit::new(MAX_SMOOTH));
    let corners = std::array::from_fn(|corner| u16::from(mask >> corner & 1));
    dispatch(MaskKernel { fit: &FIT, inside, corners: &corners })
}

struct MaskKernel<'a> {
    fit: &'a CellFit,
    inside: &'a Members,
    corners: &'a CornerLabels,
}

impl Kernel for MaskKernel<'_> {
    type Output = Option<(u16, i8)>;

    #[inline(always)]
    fn run(self, isa: impl Lanes) -> Option<(u16, i8)> {
        let mut outside = *self.inside;
        outside.iter_mut().for_each(|row| *row = !*row);
        let found = parting((isa, self.fit), [*self.inside, outside], self.corners, 1, Some(0))?;
        Some((found.code, found.offset))
    }
}

/// Three labels, separated by two planes.
struct TwoPlanes<'a> {
    fit: &'a CellFit,
    window: &'a Window<'a>,
    corners: &'a CornerLabels,
    labels: [u16; 3],
}

impl Kernel for TwoPlanes<'_> {
    type Output = Option<Fitted>;

    #[inline(always)]
    fn run(self, isa: impl Lanes) -> Option<Fitted> {
        let Self { fit, window, corners, labels: [a, b, c] } = self;
        let mut best: Option<(u8, Fitted)> = None;
        for [alone, one, other] in [[a, b, c], [b, a, c], [c, a, b]] {
            let Some(first) = parting((isa, fit), window.members(isa, alone, None), corners, alone, None)
            else {
                continue;
            };
            let Some(second) =
                parting((isa, fit), window.members(isa, one, Some(other)), corners, one, Some(other))
            else {
                continue;
            };
            let turned = u8::from(first.is_turned) + u8::from(second.is_turned);
            if best.as_ref().is_none_or(|(least, _)| turned < *least) {
                let planes = Some((first.offset, second.code, second.offset));
                best = Some((turned, Fitted::Item(first.code, WallItem { labels: *corners, planes })));
            }
        }
        best.map(|(_, fitted)| fitted)
    }
}

/// Two planes of a cell with a thin sheet of one label and the other label on both sides; `None` where both sides are
/// connected around the cell.
#[cold]
fn sheet(
    (isa, fit): (impl Lanes, &CellFit),
    window: &Window<'_>,
    corners: &CornerLabels,
    labels: [u16; 2],
) -> Option<Fitted> {
    let far = window.unused();
    let [a, b] = labels;
    [[a, b], [b, a]].into_iter().find_map(|[label, sheet]| {
        let samples = window.apart(corners, label, far)?;
        let mut two_sided = *corners;
        for (corner, sample) in two_sided.iter_mut().zip(samples.corners()) {
            *corner = if *corner == label && sample == far { far } else { *corner };
        }
        if two_sided == *corners {
            return None;
        }
        let (window, labels) = (samples.window(), [label, sheet, far]);
        let fitted = isa.call(TwoPlanes { fit, window: &window, corners: &two_sided, labels })?;
        // Both sides have the same label.
        Some(match fitted {
            Fitted::Item(code, item) => Fitted::Item(code, WallItem { labels: *corners, ..item }),
            plane @ Fitted::Plane(..) => plane,
        })
    })
}

/// The plane with the corners of a label behind it and the corners of another in front (with `None`: all others).
#[inline(always)]
fn parting(
    (isa, fit): (impl Lanes, &CellFit),
    members: [Members; 2],
    corners: &CornerLabels,
    one: u16,
    other: Option<u16>,
) -> Option<Parting> {
    let (mut mask, mut others) = (0_u8, 0_u8);
    for (corner, label) in corners.iter().enumerate() {
        mask |= u8::from(*label == one) << corner;
        others |= u8::from(other.is_none_or(|other| *label == other)) << corner;
    }
    if mask | others == u8::MAX && !SEPARABLE[usize::from(mask)] {
        return None;
    }
    let wall = fit.fit.between(isa, members, corners, one, other);
    if let Some(wall) = wall
        && let Some(found) = parted_by(&wall, corners, (one, other), fit.smooth)
    {
        return Some(found);
    }
    turned(wall.unwrap_or_default(), corners, (one, other), fit.smooth)
}

/// The plane along a wall's direction, nearest to the wall among those close enough to the middle.
#[inline(always)]
fn parted_by(
    wall: &Wall,
    corners: &CornerLabels,
    (one, other): (u16, Option<u16>),
    smooth: f32,
) -> Option<Parting> {
    let code = normal::encode(wall.normal);
    let n = normal::decode_l1(code);
    let (mut behind, mut before) = (i32::MIN, i32::MAX);
    for (corner, label) in corners.iter().enumerate() {
        let at = at_corner(n, corner);
        if *label == one {
            behind = behind.max(at);
        } else if other.is_none_or(|other| *label == other) {
            before = before.min(at);
        }
    }
    if behind >= before {
        return None;
    }
    // The cell's own coordinates are in half voxels.
    let length = ((n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) as f32).sqrt();
    #[expect(clippy::cast_possible_truncation, reason = "clamped below")]
    let even = 2 * (wall.along * length).round() as i32;
    let middle = (behind + before) / 2;
    #[expect(clippy::cast_possible_truncation, reason = "at most 127")]
    let reach = (2.0 * smooth * length) as i32;
    // The nearest even number to the middle may differ from it by one.
    let [low, high] = [(middle - reach + 1).div_euclid(2) * 2, (middle + reach).div_euclid(2) * 2];
    #[expect(clippy::cast_possible_truncation, reason = "between two corners: within 126")]
    let offset = even.clamp(low.max(behind + 1), high.max(low).min(before - 1)) as i8;
    Some(Parting { code, offset, is_turned: false })
}

/// The plane of a direction that is turned, by the corners on the wrong side, until it separates both labels.
#[cold]
fn turned(
    wall: Wall,
    corners: &CornerLabels,
    (one, other): (u16, Option<u16>),
    smooth: f32,
) -> Option<Parting> {
    let mut wall = wall;
    let part = |corner: usize, a: usize| if corner >> a & 1 == 1 { 1.0_f32 } else { -1.0 };
    // The foremost corner of the label, and the backmost of the other.
    let ends = |normal: [f32; 3]| {
        let (mut last, mut first) = ((f32::NEG_INFINITY, 0), (f32::INFINITY, 0));
        for (corner, label) in corners.iter().enumerate() {
            let at = (0..3).fold(0.0, |sum, a| sum + normal[a] * part(corner, a));
            if *label == one && at > last.0 {
                last = (at, corner);
            } else if *label != one && other.is_none_or(|other| *label == other) && at < first.0 {
                first = (at, corner);
            }
        }
        [last, first]
    };
    let [mut last, mut first] = ends(wall.normal);
    for _ in 0..TURNS {
        let way: [f32; 3] = std::array::from_fn(|a| part(first.1, a) - part(last.1, a));
        let length = |v: [f32; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let (scale, before) = (TURN / length(way).max(1.0), wall.normal);
        let moved: [f32; 3] = std::array::from_fn(|a| before[a] + scale * way[a]);
        let of = length(moved);
        if of < 1e-3 {
            return None;
        }
        wall.normal = moved.map(|c| c / of);
        [last, first] = ends(wall.normal);
        if last.0 - first.0 < CODE_ERROR
            && let Some(found) = parted_by(&wall, corners, (one, other), smooth)
        {
            return Some(Parting { is_turned: true, ..found });
        }
    }
    None
}

/// A smooth direction in a cell of octants: out of all labels if there is background, else out of the greatest.
#[cold]
fn smooth(
    (isa, fit): (impl Lanes, &CellFit),
    window: &Window<'_>,
    corners: &CornerLabels,
    greatest: u16,
) -> u16 {
    let with_none = corners.contains(&0);
    let one = if with_none { 0 } else { greatest };
    let out = fit
        .fit
        .between(isa, window.members(isa, one, None), corners, one, None)
        .map_or([0.0, 0.0, 1.0], |wall| wall.normal);
    normal::encode(if with_none { out.map(|c| -c) } else { out })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::Portable;
    use crate::format::cell::Plane;
    use crate::format::{Walls, wall_offset};

    /// All 2^8 masks of two labels, and three and more labels: planes separate all corners that planes can separate.
    #[test]
    fn every_corner_has_its_label_whatever_the_samples_say() {
        let fit = CellFit::new(MAX_SMOOTH);
        let (mut state, mut kinds) = (1_u32, [0; 3]);
        let mut any = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) % n
        };
        for round in 0..6000_u32 {
            let most = 2 + round % 4;
            let samples: Vec<u16> = (0..512).map(|_| u16::try_from(any(most)).unwrap()).collect();
            let mut corners: CornerLabels = std::array::from_fn(|_| u16::try_from(any(most)).unwrap());
            if round < 256 {
                corners = std::array::from_fn(|c| u16::try_from(round >> c & 1).unwrap());
            }
            let slices = std::array::from_fn(|z| &samples[64 * z..64 * z + 64]);
            let window = Window { slices, first: 0, stride: 8 };
            if corners.iter().all(|label| *label == corners[0]) {
                continue;
            }
            let fitted = fit_cell(Portable, &fit, &window, &corners);
            let (walls, kind) = match fitted {
                Fitted::Plane(code, offset, pair) => {
                    assert!((offset % 2 == 0) == (pair[1] == 0) && pair[0] > pair[1]);
                    (Walls::of_pair(Plane::new(code, wall_offset(offset)), pair), 0)
                }
                Fitted::Item(code, item) => {
                    assert!(!WallItem::is_illegal(&item.to_bytes()));
                    (Walls::of_item(code, &item), if item.planes.is_some() { 1 } else { 2 })
                }
            };
            kinds[kind] += 1;
            for (corner, label) in corners.iter().enumerate() {
                assert_eq!(walls.corner(corner), *label, "{corners:?} {fitted:?}");
            }
            // The number of masks that a plane separates is known: 104 of 256, two of them with a single label.
            if round == 255 {
                assert_eq!(kinds[..2], [102, 0]);
            }
        }
        assert!(kinds.iter().all(|count| *count > 200), "{kinds:?}");
    }

    /// A wall lies within its bound of the middle between the corners that it separates, and with a bound of 0 in the
    /// middle.
    #[test]
    fn walls_stay_within_their_bound() {
        let (mut state, mut moved) = (7_u32, 0.0_f64);
        let mut any = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) % n
        };
        for round in 0..2000_u16 {
            let bound = f64::from(round % 6) / 10.0;
            let fit = CellFit::new(bound);
            let samples: Vec<u16> = (0..512).map(|_| u16::try_from(any(2)).unwrap()).collect();
            let corners: CornerLabels = std::array::from_fn(|_| u16::try_from(any(2)).unwrap());
            let slices = std::array::from_fn(|z| &samples[64 * z..64 * z + 64]);
            let window = Window { slices, first: 0, stride: 8 };
            if corners.iter().all(|label| *label == corners[0]) {
                continue;
            }
            let Fitted::Plane(code, offset, [behind, _]) = fit_cell(Portable, &fit, &window, &corners) else {
                continue;
            };
            let plane = Plane::new(code, wall_offset(offset));
            let part = |label: bool| (0..CORNERS).filter(move |c| (corners[*c] == behind) == label);
            let last = part(true).map(|c| at_corner(plane.normal, c)).max().unwrap();
            let first = part(false).map(|c| at_corner(plane.normal, c)).min().unwrap();
            let length = plane.normal.map(f64::from).iter().map(|n| n * n).sum::<f64>().sqrt();
            let off = (f64::from(plane.offset) - f64::from(last + first) / 2.0).abs() / (2.0 * length);
            assert!(
                off <= bound + 0.51 / length && last < plane.offset && plane.offset < first,
                "{off} {bound}"
            );
            moved = moved.max(off);
        }
        assert!(moved > 0.15, "{moved}");
    }
}
