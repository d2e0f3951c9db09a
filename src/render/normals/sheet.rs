//! The visible side of skin: normals that the boxes around contradict.
//!
//! A stored normal is the gradient of the values. Within a sheet one box thick, such as a scanner's table or a single
//! slice, the values are alike on both sides: the gradient is noise. The skin itself is reliable. So where the
//! normals of the boxes around do not agree with one, the plane of those boxes replaces it, the sooner the farther it is
//! from the face of entry; and a normal of the far side is turned.
//!
//! All distances are in boxes, not in millimetres: in thick slices a steep surface shows wide treads of a staircase
//! whose stored normals are right, and they stay, as they agree. Cost: three or four normals before and after it in the
//! file, and where these do not agree a look-up of the boxes around, some 0.2 microseconds.

use crate::geom::dot;
use crate::load::{ModelView, NodeView};

use super::neighborhood::Neighborhood;
use crate::render::ray::Face;

/// Cosine between a normal and the face of entry that the widest face of a sound surface has: some axis is that near to
/// any direction (1 / sqrt 3).
const NEAR_FACE: f64 = 0.57;

/// Weight of the face's own direction in the fit: it decides where the boxes form a line or a point.
const FACE_WEIGHT: f64 = 1e-3;

/// Part of the boxes' scatter along the plane's normal: up to the first they form a plane, from the second on a rod or
/// a lump, whose stored normals are better than a plane.
const FLAT: f64 = 0.1;
const NOT_FLAT: f64 = 0.18;

/// Size of the cosine between normals that agree, and the part of those around that must, near the face and far from it.
const ALIKE: f64 = 0.9;
const SOUND_NEAR: f64 = 0.4;
const SOUND_FAR: f64 = 0.6;

/// A box that a ray hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Struck {
    /// Point of entry of the ray, in boxes of its size.
    pub(super) at: [f64; 3],
    /// Base-2 logarithm of the box's edge.
    pub(super) edge_log2: u32,
}

/// The displayed normal for the stored one of box `number`, both in the frame of the boxes (any length, each axis in its
/// own spacing); `None` where the stored one stays. `struck` is only called where the details of the hit matter;
/// `others` gives the stored normals of other boxes by their numbers.
#[inline]
pub(super) fn shown(
    view: &ModelView<'_>,
    around: &mut Neighborhood,
    (face, number): (Face, u64),
    struck: impl FnOnce() -> Struck,
    stored: [f64; 3],
    others: impl Fn(u64) -> Option<[f64; 3]>,
) -> Option<[f64; 3]> {
    let mut outward = [0.0; 3];
    outward[usize::from(face.axis % 3)] = if face.high { 1.0 } else { -1.0 };
    let square = dot(stored, stored);
    let along = dot(stored, outward);
    let is_near = along * along >= NEAR_FACE * NEAR_FACE * square;
    let agree = |number: u64| {
        others(number).is_none_or(|other| {
            let product = dot(stored, other);
            product * product >= ALIKE * ALIKE * square * dot(other, other)
        })
    };
    // Those before and after it in the file mostly touch it.
    let beside = |distance: i64| agree(number.wrapping_add_signed(distance));
    let turned = || (is_near && along < 0.0).then(|| stored.map(|c| -c));
    if beside(1) && beside(-1) && (beside(2) || beside(-2)) {
        return turned();
    }
    let least = if is_near && along > 0.0 { SOUND_NEAR } else { SOUND_FAR };
    if let Some(offsets) = unsound(view, around, face, (number, &struck()), (least, agree)) {
        let (plane, thick) = nearest_plane(&offsets, outward);
        let share = ((NOT_FLAT - thick) / (NOT_FLAT - FLAT)).clamp(0.0, 1.0);
        let toward = if dot(stored, plane) < 0.0 { -1.0 } else { 1.0 };
        let kept = toward * (1.0 - share) / square.sqrt();
        return Some([0, 1, 2].map(|a| stored[a] * kept + plane[a] * share));
    }
    turned()
}

/// The boxes that touch the one that was hit, and itself, as offsets from it; `None` where the part `least` of the
/// normals agrees, or the box is not found: a hit's point is rounded, and may fall into a neighbour.
fn unsound(
    view: &ModelView<'_>,
    around: &mut Neighborhood,
    face: Face,
    (number, struck): (u64, &Struck),
    (least, agree): (f64, impl Fn(u64) -> bool),
) -> Option<Vec<[f64; 3]>> {
    let axis = usize::from(face.axis % 3);
    let levels = view.depth().checked_sub(struck.edge_log2).filter(|levels| *levels > 0)?;
    // The box of the point; then, on an edge of it, those across.
    let mut at = struck.at;
    at[axis] += if face.high { -0.5 } else { 0.5 };
    let beside = (0..3).filter(|a| *a != axis).flat_map(|a| [(a, 0.5), (a, -0.5)]);
    [(axis, 0.0)].into_iter().chain(beside).find_map(|(a, step)| {
        #[expect(clippy::cast_possible_truncation, reason = "clamped to the grid")]
        let cell: [i64; 3] = std::array::from_fn(|b| {
            let at = at[b] + if a == b { step } else { 0.0 };
            (at.floor() as i64).clamp(0, (1 << levels) - 1)
        });
        let (mut offsets, mut found, mut agreeing) = (Vec::with_capacity(27), false, 0_usize);
        around.neighbours(view, levels, cell, |slot, other| {
            offsets.push([slot % 3, slot / 3 % 3, slot / 9].map(|c| c as f64 - 1.0));
            found |= other == number && slot == 13;
            agreeing += usize::from(other != number && agree(other));
        });
        let sound = offsets.len() > 1 && agreeing as f64 >= least * (offsets.len() - 1) as f64;
        found.then_some((!sound).then_some(offsets))
    })?
}

/// Unit normal of the plane nearest to points (least squares), on the side of `face`, and the part of their scatter
/// along it. The normal is the eigenvector of the greatest eigenvalue of the adjugate of their scatter, by repeated
/// squaring.
fn nearest_plane(points: &[[f64; 3]], face: [f64; 3]) -> ([f64; 3], f64) {
    let count = points.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|a| points.iter().map(|p| p[a]).sum::<f64>() / count);
    let scatter =
        |i: usize, j: usize| points.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>();
    let scatter: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| scatter(i, j)));
    let minor = |i: usize, j: usize| {
        let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        scatter[a][c] * scatter[b][d] - scatter[a][d] * scatter[b][c]
    };
    let size = (0..3).map(|i| minor(i, i)).sum::<f64>().max(1.0);
    let mut m: [[f64; 3]; 3] = std::array::from_fn(|i| {
        std::array::from_fn(|j| minor(i, j) / size + FACE_WEIGHT * face[i] * face[j])
    });
    for _ in 0..5 {
        let trace: f64 = (0..3).map(|i| dot(m[i], m[i])).sum();
        m = std::array::from_fn(|i| std::array::from_fn(|j| dot(m[i], m[j]) / trace));
    }
    // The column of the greatest element of the diagonal.
    let column = (0..3).fold(0, |best, i| if m[i][i] > m[best][best] { i } else { best });
    let length = dot(m[column], m[column]).sqrt().copysign(dot(m[column], face));
    let plane = m[column].map(|c| c / length);
    let along = dot(plane, scatter.map(|row| dot(row, plane)));
    (plane, along / (0..3).map(|i| scatter[i][i]).sum::<f64>().max(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{BoxIndex, Dims, Octant};
    use crate::memory_tree::MemoryTree;

    const UP: Face = Face { axis: 2, high: true };

    fn tree(cells: impl IntoIterator<Item = [u32; 3]>) -> MemoryTree {
        MemoryTree::of_cells(Dims::new(16, 16, 16).unwrap(), cells)
    }

    /// A sheet one box thick, of this height.
    fn sheet(height: impl Fn(u32, u32) -> u32) -> MemoryTree {
        tree((0..256).map(|i| [i % 16, i / 16, height(i % 16, i / 16)]))
    }

    /// The normal displayed where a ray hits the box of a cell from above, and the others have this normal.
    fn of(tree: &MemoryTree, cell: [u32; 3], stored: [f64; 3], other: [f64; 3]) -> Option<[f64; 3]> {
        let at = [f64::from(cell[0]) + 0.5, f64::from(cell[1]) + 0.5, f64::from(cell[2]) + 1.0];
        let struck = Struck { at, edge_log2: 0 };
        shown(
            &tree.view(),
            &mut Neighborhood::new(),
            (UP, number(tree, cell)),
            || struck,
            stored,
            |_| Some(other),
        )
    }

    fn number(tree: &MemoryTree, [x, y, z]: [u32; 3]) -> u64 {
        let mut number = BoxIndex::ROOT;
        for level in (0..4).rev() {
            let octant = (x >> level & 1) | (y >> level & 1) << 1 | (z >> level & 1) << 2;
            number = tree.child(number.node(), Octant::new(octant).unwrap()).unwrap();
        }
        number.get()
    }

    #[test]
    fn noise_in_a_sheet_gives_way_to_the_sheets_normal() {
        let flat = sheet(|_, _| 5);
        let other = [0.7, -0.7, 0.2];
        for stored in [[1.0, 0.0, 0.0], [0.0, -3.0, 0.1], [0.6, 0.6, -0.3], [0.0, 0.1, -0.9]] {
            let n = of(&flat, [7, 8, 5], stored, other).unwrap();
            assert!(n[2] > 0.99, "{stored:?}: {n:?}");
        }
        // At the border of the sheet and of the grid as well.
        let n = of(&flat, [0, 15, 5], [1.0, 0.0, 0.0], other).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
        // A slope of 45 degrees.
        let n = of(&sheet(|x, _| x), [7, 8, 7], [0.0, 1.0, 0.0], other).unwrap();
        assert!((n[0] + 0.707).abs() < 0.01 && (n[2] - 0.707).abs() < 0.01, "{n:?}");
        // A line of boxes and a single one: the face decides.
        for cells in [(0..16).map(|y| [7, y, 5]).collect(), vec![[7, 8, 5]]] {
            let n = of(&tree(cells), [7, 8, 5], [1.0, 0.0, 0.0], other).unwrap();
            assert!(n[2] > 0.99, "{n:?}");
        }
    }

    #[test]
    fn sound_normals_stay_and_the_far_sides_are_turned() {
        let flat = sheet(|_, _| 5);
        assert_eq!(of(&flat, [7, 8, 5], [0.3, 0.3, 0.9], [0.2, 0.3, 0.9]), None);
        let far = [0.0, 0.1, -0.9];
        assert_eq!(of(&flat, [7, 8, 5], far, far.map(|c| -c)), Some([0.0, -0.1, 0.9]));
        assert_eq!(of(&flat, [7, 8, 5], [0.9, 0.0, -0.3], [0.9, 0.1, -0.3]), None);
    }
}
