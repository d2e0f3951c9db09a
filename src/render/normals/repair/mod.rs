//! The visible side of a surface: stored normals that the skin around a hit contradicts are replaced by the skin's own.
//!
//! A stored normal is the gradient of the values. Within a sheet one voxel thick, such as a scanner's table or the wall
//! of a label, and in a single slice, the values are alike on both sides: the gradient is noise, or it lies in the
//! sheet, and shading by it gives dark and light bands. The skin itself is reliable. A ray enters by a face of a voxel
//! that is open towards the eye; on a surface of voxels only faces near its direction are open widely. So where the
//! stored normal is far from that face's, a plane is fitted to the skin within two boxes of the hit that is connected
//! with it, and the plane's normal replaces the stored one to the extent that the stored one lies in the plane.
//!
//! All distances are in boxes, not in millimetres: in thick slices a steep surface shows wide treads of a staircase
//! whose stored normals are right, and they stay. Memory: [`Neighborhood`] for each thread. Cost: a few nanoseconds
//! where the stored normal is near the face's, else a look-up of the boxes around, some 0.2 microseconds.

mod plane;
pub(in crate::render) mod tile;

use crate::geom::dot;
use crate::load::ModelView;

use super::neighborhood::Neighborhood;
use crate::render::ray::Face;
use plane::{Around, nearest_plane};

/// Distance up to which two stored normals agree, as the sum of the differences of their components, whose sizes add up
/// to 1: some 25 degrees.
const AGREE: f64 = 0.5;

/// The four boxes before and the four after in file order mostly lie around the box. At most this many of their normals
/// agree with its own where all of them are noise; at an edge, four do.
const MAX_BY_CHANCE: u32 = 3;

/// Agreement of a normal with the normals of the boxes around.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render) enum Neighbourhood {
    /// They agree.
    Calm,
    /// Some differ: an edge, a narrow bend, or a sheet.
    Mixed,
    /// Hardly any agree.
    Noise,
}

impl Neighbourhood {
    #[inline]
    fn of_flags(calm: u16, noise: u16) -> Self {
        match (calm, noise) {
            (0, 0) => Self::Mixed,
            (0, _) => Self::Noise,
            _ => Self::Calm,
        }
    }
}

/// The neighbourhood by the boxes before and after in file order; `agrees` tells whether the box at a distance has a
/// normal [`alike`], or none.
#[inline]
pub(super) fn neighbourhood(agrees: impl Fn(i64) -> bool) -> Neighbourhood {
    if agrees(1) && agrees(-1) && (agrees(2) || agrees(-2)) {
        return Neighbourhood::Calm;
    }
    let agreeing: u32 = [1, -1, 2, -2, 3, -3, 4, -4].into_iter().map(|at| u32::from(agrees(at))).sum();
    if agreeing <= MAX_BY_CHANCE { Neighbourhood::Noise } else { Neighbourhood::Mixed }
}

/// [`neighbourhood`] for normals of 16 bits in cubic boxes: the codes of the box in the middle, and of the four before
/// and after it.
#[inline]
pub(super) fn neighbourhood_of(codes: &[u16; 9]) -> Neighbourhood {
    let mut row = [0; tile::PLACES];
    row[..9].copy_from_slice(codes);
    let (calm, noise) = tile::neighbourhood_of(&row);
    Neighbourhood::of_flags(calm, noise)
}

/// True if two normals of any length agree, or one with the opposite of the other.
#[inline]
pub(super) fn alike(one: [f64; 3], other: [f64; 3]) -> bool {
    let (one, other) = (scaled(one), scaled(other));
    let apart = |sign: f64| (0..3).map(|a| (one[a] - sign * other[a]).abs()).sum::<f64>();
    apart(1.0) < AGREE || apart(-1.0) < AGREE
}

/// [`alike`] for normals whose components' sizes add up to `size`: integers in cubic boxes.
#[inline]
pub(super) fn alike_whole(one: [i32; 3], other: [i32; 3], size: i32) -> bool {
    let apart = |sign: i32| (0..3).map(|a| (one[a] - sign * other[a]).abs()).sum::<i32>();
    2 * apart(1).min(apart(-1)) < size
}

/// A vector scaled to a sum of sizes of 1.
#[inline]
fn scaled(n: [f64; 3]) -> [f64; 3] {
    let size = n[0].abs() + n[1].abs() + n[2].abs();
    n.map(|c| c / size)
}

/// Cosine between a stored normal and the face's from which it is kept: some axis is that near to any direction (1 /
/// sqrt 3), so the widest face of a sound surface never requires more. A mixed neighbourhood requires more.
const NEAR_FACE: f64 = 0.57;
const NEAR_FACE_MIXED: f64 = 0.85;

/// Range below [`NEAR_FACE`] over which the fitted plane gains weight, so that its onset shows no edge.
const FADE: f64 = 0.15;

/// Limits of the cosine between the stored normal and the plane's: a fit to some twenty boxes is within 30 degrees of a
/// sound surface's normal.
const NEAR_PLANE: f64 = 0.85;
const FAR_FROM_PLANE: f64 = 0.6;

/// Part of the boxes' scatter along the plane's normal: up to the first they form a plane, from the second on a rod or
/// a lump, whose stored normals are better than a plane.
const FLAT: f64 = 0.1;
const NOT_FLAT: f64 = 0.18;

/// A box that a ray hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Struck {
    /// Breadth-first number of the box.
    pub(super) number: u64,
    /// Point of entry of the ray, in boxes of its size.
    pub(super) at: [f64; 3],
    /// Base-2 logarithm of the box's edge.
    pub(super) edge_log2: u32,
    /// The face of entry.
    pub(super) face: Face,
}

/// The decision about a stored normal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Keep,
    /// It belongs to the far side of something thin.
    Turn,
    /// It needs a comparison with the skin around.
    Doubt,
}

/// Judges a stored normal; `along` is its cosine with the face that was hit.
#[inline]
fn judge(along: f64, neighbourhood: Neighbourhood) -> Verdict {
    let near = nearness(neighbourhood);
    if neighbourhood == Neighbourhood::Noise {
        Verdict::Doubt
    } else if along >= near {
        Verdict::Keep
    } else if along <= -near {
        Verdict::Turn
    } else {
        Verdict::Doubt
    }
}

/// Least cosine with a face for a normal in this neighbourhood to be kept.
#[inline]
fn nearness(neighbourhood: Neighbourhood) -> f64 {
    if neighbourhood == Neighbourhood::Calm { NEAR_FACE } else { NEAR_FACE_MIXED }
}

/// The displayed normal for a stored one, both in the frame of the boxes (any length, each axis in its own spacing);
/// `None` where the stored one stays. `struck` is only called where the details of the hit matter.
#[inline]
pub(super) fn shown(
    view: &ModelView<'_>,
    around: &mut Neighborhood,
    face: Face,
    struck: impl FnOnce() -> Struck,
    stored: [f64; 3],
    neighbourhood: Neighbourhood,
) -> Option<[f64; 3]> {
    let along = along(face, stored);
    match judge(along, neighbourhood) {
        Verdict::Keep => None,
        Verdict::Turn => Some(stored.map(|c| -c)),
        Verdict::Doubt => fitted(view, around, &struck(), stored, neighbourhood),
    }
}

/// Cosine between a normal and a face.
#[inline]
fn along(face: Face, stored: [f64; 3]) -> f64 {
    let outward = if face.high { 1.0 } else { -1.0 };
    stored[usize::from(face.axis % 3)] * outward / dot(stored, stored).sqrt()
}

/// The normal of a hit whose stored one is doubtful, like [`shown`].
fn fitted(
    view: &ModelView<'_>,
    around: &mut Neighborhood,
    struck: &Struck,
    stored: [f64; 3],
    neighbourhood: Neighbourhood,
) -> Option<[f64; 3]> {
    let scatter = scatter_around(view, around, struck)?;
    let mut face = [0.0; 3];
    face[usize::from(struck.face.axis % 3)] = if struck.face.high { 1.0 } else { -1.0 };
    let (share, shown) =
        settled(scatter, face, stored, nearness(neighbourhood), neighbourhood == Neighbourhood::Noise);
    (share > 0.0).then_some(shown)
}

/// The scatter of the connected boxes around the hit; `None` where the hit box is not found.
#[inline]
pub(super) fn scatter_around(
    view: &ModelView<'_>,
    around: &mut Neighborhood,
    struck: &Struck,
) -> Option<[f64; 6]> {
    Some(Around::of(view, around, struck)?.scatter())
}

/// The mean of a doubtful stored normal and the plane that fits boxes of this scatter, and the plane's weight in it;
/// the stored one stays where that is 0.
#[inline(always)]
fn settled(scatter: [f64; 6], face: [f64; 3], stored: [f64; 3], near: f64, noise: bool) -> (f64, [f64; 3]) {
    let (plane, thick) = nearest_plane(scatter, face);
    let [x, y, z] = stored;
    let length = (x * x + y * y + z * z).sqrt();
    let along = (x * face[0] + y * face[1] + z * face[2]) / length;
    let across = x * plane[0] + y * plane[1] + z * plane[2];
    let toward = if across < 0.0 { -1.0 } else { 1.0 };
    let cosine = across * toward / length;
    let flat = ramp(thick, FLAT, NOT_FLAT);
    let say = ramp(along.abs(), near - FADE, near) * ramp(cosine, FAR_FROM_PLANE, NEAR_PLANE);
    let share = if noise { flat } else { flat * say };
    let mixed = |stored: f64, plane: f64| stored * toward / length * (1.0 - share) + plane * share;
    (share, [mixed(x, plane[0]), mixed(y, plane[1]), mixed(z, plane[2])])
}

/// Linear ramp: 1 up to `all`, 0 from `none` on.
#[inline(always)]
fn ramp(value: f64, all: f64, none: f64) -> f64 {
    let share = (none - value) / (none - all);
    let share = if share < 0.0 { 0.0 } else { share };
    if share > 1.0 { 1.0 } else { share }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{BoxIndex, Dims, Octant};
    use crate::load::NodeView;
    use crate::memory_tree::MemoryTree;

    const UP: Face = Face { axis: 2, high: true };

    fn tree(cells: impl IntoIterator<Item = [u32; 3]>) -> MemoryTree {
        MemoryTree::of_cells(Dims::new(16, 16, 16).unwrap(), cells)
    }

    fn sheet(height: impl Fn(u32, u32) -> u32) -> MemoryTree {
        tree((0..256).map(|i| [i % 16, i / 16, height(i % 16, i / 16)]))
    }

    /// The hit of a ray from above with the box of a cell.
    fn struck(tree: &MemoryTree, [x, y, z]: [u32; 3]) -> Struck {
        let mut number = BoxIndex::ROOT;
        for level in (0..4).rev() {
            let octant = (x >> level & 1) | (y >> level & 1) << 1 | (z >> level & 1) << 2;
            number = tree.child(number.node(), Octant::new(octant).unwrap()).unwrap();
        }
        let at = [f64::from(x) + 0.5, f64::from(y) + 0.5, f64::from(z) + 1.0];
        Struck { number: number.get(), at, edge_log2: 0, face: UP }
    }

    fn of(tree: &MemoryTree, hit: Struck, stored: [f64; 3]) -> Option<[f64; 3]> {
        shown(&tree.view(), &mut Neighborhood::new(), hit.face, || hit, stored, Neighbourhood::Calm)
    }

    #[test]
    fn a_normal_within_a_sheet_gives_way_to_the_sheets() {
        let flat = sheet(|_, _| 5);
        for stored in [[1.0, 0.0, 0.0], [0.0, -3.0, 0.1], [0.6, 0.6, -0.3]] {
            let n = of(&flat, struck(&flat, [7, 8, 5]), stored).unwrap();
            assert!(n[2] / dot(n, n).sqrt() > 0.95, "{stored:?}: {n:?}");
        }
        // At the border of the sheet and of the grid as well.
        let n = of(&flat, struck(&flat, [0, 15, 5]), [1.0, 0.0, 0.0]).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
        // A slope of 45 degrees.
        let slope = sheet(|x, _| x);
        let n = of(&slope, struck(&slope, [7, 8, 7]), [0.0, 1.0, 0.0]).unwrap();
        assert!((n[0] + 0.707).abs() < 0.01 && (n[2] - 0.707).abs() < 0.01, "{n:?}");
    }

    #[test]
    fn sound_normals_stay_and_those_of_the_far_side_are_turned() {
        let flat = sheet(|_, _| 5);
        let hit = struck(&flat, [7, 8, 5]);
        assert_eq!(of(&flat, hit, [0.3, 0.3, 0.9]), None);
        assert_eq!(of(&flat, hit, [0.0, 0.1, -0.9]), Some([0.0, -0.1, 0.9]));
        // The tread of a gentle slope, hit at its rise: the normal is far from that face, and right.
        let steps = sheet(|x, _| x / 4);
        let mut rise = struck(&steps, [7, 8, 1]);
        rise.face = Face { axis: 0, high: true };
        rise.at = [8.0, 8.5, 1.5];
        assert_eq!(of(&steps, rise, [-0.25, 0.0, 1.0]), None);
    }

    #[test]
    fn noise_is_told_from_edges_and_bends() {
        let up = [0.0, 0.0, 1.0];
        let side = [1.0, 0.0, 0.0];
        let of = |others: [[f64; 3]; 8]| {
            neighbourhood(|at| {
                let other = others[usize::try_from(at + if at < 0 { 4 } else { 3 }).unwrap()];
                #[expect(clippy::cast_possible_truncation, reason = "whole numbers")]
                let whole = |n: [f64; 3]| n.map(|c| c as i32 * 127);
                assert_eq!(alike(up, other), alike_whole(whole(up), whole(other), 127));
                alike(up, other)
            })
        };
        assert_eq!(of([up; 8]), Neighbourhood::Calm);
        // The far side of a thin sheet has the same direction.
        assert_eq!(of([up.map(|c| -c); 8]), Neighbourhood::Calm);
        assert_eq!(of([side; 8]), Neighbourhood::Noise);
        assert_eq!(of([up, up, up, up, side, side, side, side]), Neighbourhood::Mixed);
        assert_eq!(neighbourhood(|_| true), Neighbourhood::Calm);
    }

    #[test]
    fn a_place_on_an_edge_is_found_again_or_left_alone() {
        let flat = sheet(|_, _| 5);
        let mut hit = struck(&flat, [7, 8, 5]);
        hit.at[0] = 8.000_001;
        assert!(of(&flat, hit, [1.0, 0.0, 0.0]).is_some());
        hit.at[0] = 12.5;
        assert_eq!(of(&flat, hit, [1.0, 0.0, 0.0]), None);
        // A line of boxes and a single one: the face decides.
        let line = tree((0..16).map(|y| [7, y, 5]));
        let n = of(&line, struck(&line, [7, 8, 5]), [1.0, 0.0, 0.0]).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
        let point = tree([[7, 8, 5]]);
        let n = of(&point, struck(&point, [7, 8, 5]), [1.0, 0.0, 0.0]).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
    }
}
