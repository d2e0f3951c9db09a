//! The side of a surface that is shown: normals that the skin around a hit contradicts give way to its own.
//!
//! A stored normal is the gradient of the values. Within a sheet one voxel thick, such as a scanner's table or
//! the wall of a label, and in a single slice, the values are alike on both sides: the gradient is noise, or it
//! lies in the sheet, and shading by it gives dark and light bands. The skin itself shows what is the case. A
//! ray comes in by a face of a voxel that is open towards the eye; of a surface of voxels only faces near its
//! direction are open wide. So where the stored normal is far from that face's, a plane is fitted to the skin
//! within two boxes of the hit that hangs together with it, and as far as the stored normal lies in that plane
//! the plane's takes its place.
//!
//! All this is counted in boxes, not in millimetres: in thick slices a steep surface shows wide treads of a stair
//! whose stored normals are right, and they stay. Memory: [`Surroundings`] for each thread. Cost: a
//! few nanoseconds where the stored normal is near the face's, else a look at the boxes around, some 0.2
//! microseconds.

use crate::format::normal;
use crate::load::{ModelView, NodeView};

use super::around::{SIDE, Surroundings};
use super::ray::Face;
use super::space::dot;

/// How far two stored normals are apart that agree, as the sum of the differences of their parts, whose sizes add
/// up to 1: some 25 degrees.
const AGREE: f64 = 0.5;

/// Of the normals of four boxes before and four behind in the order of the file, which lie around the box for the
/// most part, at most this many agree with its own where all of them are noise: four do on either side of an edge.
const MOST_BY_CHANCE: usize = 3;

/// What the normals of the boxes around say of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Company {
    /// They are as it is.
    Calm,
    /// Some differ: an edge, a narrow bend, or a sheet.
    Mixed,
    /// Hardly any is as it is.
    Noise,
}

/// What the boxes before and behind one in the order of the file say of its normal; `agrees` tells whether the one
/// so far away has a normal [`alike`], or none.
#[inline]
pub(super) fn company(agrees: impl Fn(i64) -> bool) -> Company {
    if agrees(1) && agrees(-1) && (agrees(2) || agrees(-2)) {
        return Company::Calm;
    }
    let agreeing = [1, -1, 2, -2, 3, -3, 4, -4].into_iter().filter(|at| agrees(*at)).count();
    if agreeing <= MOST_BY_CHANCE { Company::Noise } else { Company::Mixed }
}

/// As [`company`], of normals of 16 bits in boxes that are cubes: those of the box in the middle, and of the four before
/// and behind it. All are compared at once.
#[inline]
pub(super) fn company_of(codes: &[u16; 9]) -> Company {
    #[expect(clippy::cast_possible_truncation, reason = "a byte")]
    const SCALE: i16 = normal::SCALE as i16;
    let mut parts = [[0_i16; 9]; 3];
    for i in 0..9 {
        let [low, high] = codes[i].to_le_bytes();
        let (u, v) = (i16::from(low as i8).max(-SCALE), i16::from(high as i8).max(-SCALE));
        let (size_u, size_v) = (u.wrapping_abs(), v.wrapping_abs());
        let z = SCALE.wrapping_sub(size_u).wrapping_sub(size_v);
        let (fold_u, fold_v) = (SCALE.wrapping_sub(size_v), SCALE.wrapping_sub(size_u));
        let fold_u = if u < 0 { fold_u.wrapping_neg() } else { fold_u };
        let fold_v = if v < 0 { fold_v.wrapping_neg() } else { fold_v };
        let folded = z < 0;
        parts[0][i] = if folded { fold_u } else { u };
        parts[1][i] = if folded { fold_v } else { v };
        parts[2][i] = z;
    }
    let [x, y, z] = [parts[0][4], parts[1][4], parts[2][4]];
    let mut agrees = [0_u16; 9];
    // Sums of sizes up to 127 do not wrap; said so, because a check of each would keep the loop from being vectorised.
    for i in 0..9 {
        let [a, b, c] = [parts[0][i], parts[1][i], parts[2][i]];
        let size = |x: i16, y: i16, z: i16| {
            x.wrapping_abs().wrapping_add(y.wrapping_abs()).wrapping_add(z.wrapping_abs())
        };
        let to = size(x.wrapping_sub(a), y.wrapping_sub(b), z.wrapping_sub(c));
        let fro = size(x.wrapping_add(a), y.wrapping_add(b), z.wrapping_add(c));
        agrees[i] = u16::from(to.min(fro) < SCALE / 2 + 1);
    }
    if agrees[5] & agrees[3] & (agrees[6] | agrees[2]) == 1 {
        return Company::Calm;
    }
    // The one in the middle agrees with itself.
    let agreeing = agrees.iter().sum::<u16>() - 1;
    if usize::from(agreeing) <= MOST_BY_CHANCE { Company::Noise } else { Company::Mixed }
}

/// Do two normals of any length agree, or one and what is opposite to the other?
#[inline]
pub(super) fn alike(one: [f64; 3], other: [f64; 3]) -> bool {
    let (one, other) = (scaled(one), scaled(other));
    let apart = |sign: f64| (0..3).map(|a| (one[a] - sign * other[a]).abs()).sum::<f64>();
    apart(1.0) < AGREE || apart(-1.0) < AGREE
}

/// As [`alike`], of normals whose parts' sizes add up to `size`: whole numbers in boxes that are cubes.
#[inline]
pub(super) fn alike_whole(one: [i32; 3], other: [i32; 3], size: i32) -> bool {
    let apart = |sign: i32| (0..3).map(|a| (one[a] - sign * other[a]).abs()).sum::<i32>();
    2 * apart(1).min(apart(-1)) < size
}

/// At a sum of sizes of 1.
#[inline]
fn scaled(n: [f64; 3]) -> [f64; 3] {
    let size = n[0].abs() + n[1].abs() + n[2].abs();
    n.map(|c| c / size)
}

/// Cosine between a stored normal and the face's from which on it is taken as it is: some axis is that near to
/// any direction (1 / sqrt 3), so the widest face of a sound surface never asks for more. In mixed company more is
/// asked for.
const NEAR_FACE: f64 = 0.57;
const NEAR_FACE_MIXED: f64 = 0.85;

/// Over this much below [`NEAR_FACE`] the fitted plane gains its say, so that no edge shows where it sets in.
const FADE: f64 = 0.15;

/// The same for the cosine between the stored normal and that of the plane: a fit to some twenty boxes is within
/// 30 degrees of a sound surface's normal.
const NEAR_PLANE: f64 = 0.85;
const FAR_FROM_PLANE: f64 = 0.6;

/// Part of the boxes' scatter that is along the plane's normal: up to the first they form a plane, from the second
/// on a rod or a lump, whose stored normals are better than a plane.
const FLAT: f64 = 0.1;
const NOT_FLAT: f64 = 0.18;

/// Weight of the face's own direction in the fit: it decides where the boxes form a line or a point.
const FACE_WEIGHT: f64 = 1e-3;

/// A box that a ray hit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Struck {
    /// Its breadth-first number.
    pub(super) number: u64,
    /// Where the ray came in, in boxes of its size.
    pub(super) at: [f64; 3],
    /// Base-2 logarithm of its edge.
    pub(super) edge_log2: u32,
    /// The face by which the ray came in.
    pub(super) face: Face,
}

/// The normal that is shown of a stored one, both in the frame of the boxes (any length, each axis in its own
/// spacing); `None` where the stored one stays. `struck` is asked for what was hit only where that matters.
#[inline]
pub(super) fn shown(
    view: &ModelView<'_>,
    around: &mut Surroundings,
    face: Face,
    struck: impl FnOnce() -> Struck,
    stored: [f64; 3],
    company: Company,
) -> Option<[f64; 3]> {
    let axis = usize::from(face.axis % 3);
    let outward = if face.high { 1.0 } else { -1.0 };
    let length = dot(stored, stored).sqrt();
    let along = stored[axis] * outward / length;
    let near = if company == Company::Calm { NEAR_FACE } else { NEAR_FACE_MIXED };
    if company != Company::Noise {
        if along >= near {
            return None;
        }
        if along <= -near {
            // The stored normal tells of the far side of something thin.
            return Some(stored.map(|c| -c));
        }
    }
    let mut face = [0.0; 3];
    face[axis] = outward;
    let (plane, scatter) = Around::of(view, around, &struck())?.plane(face);
    let toward = if dot(stored, plane) < 0.0 { -1.0 } else { 1.0 };
    let cosine = dot(stored, plane) * toward / length;
    let mut share = ramp(scatter, FLAT, NOT_FLAT);
    if company != Company::Noise {
        share *= ramp(along.abs(), near - FADE, near) * ramp(cosine, FAR_FROM_PLANE, NEAR_PLANE);
    }
    (share > 0.0)
        .then(|| std::array::from_fn(|a| stored[a] * toward / length * (1.0 - share) + plane[a] * share))
}

/// 1 up to `all`, 0 from `none` on, and straight between.
fn ramp(value: f64, all: f64, none: f64) -> f64 {
    ((none - value) / (none - all)).clamp(0.0, 1.0)
}

/// Which boxes near one are skin, as [`Surroundings::window`] tells: bit `x + 5 y + 25 z`.
struct Around(u128);

impl Around {
    /// The boxes around the one that was struck; `None` where it is not found: a hit's place is rounded, and may
    /// come out in a neighbour.
    fn of(view: &ModelView<'_>, around: &mut Surroundings, struck: &Struck) -> Option<Self> {
        let axis = usize::from(struck.face.axis % 3);
        let levels = view.depth().checked_sub(struck.edge_log2)?;
        let limit = (1_i64 << levels) - 1;
        let mut cell = [0; 3];
        for (a, cell) in cell.iter_mut().enumerate() {
            let at = struck.at[a];
            let at = if a != axis {
                at.floor()
            } else {
                (at + 0.5).floor() - f64::from(u8::from(struck.face.high))
            };
            #[expect(clippy::cast_possible_truncation, reason = "clamped to the grid")]
            let at = at as i64;
            *cell = at.clamp(0, limit);
        }
        if levels == 0 {
            return Some(Self(1 << 62));
        }
        let mut look = |cell: [i64; 3]| {
            let (found, middle) = around.window(view, levels, cell);
            (middle == Some(struck.number)).then_some(Self(found))
        };
        // On an edge of the box, the neighbour across it.
        let beside = (0..3).filter(|a| *a != axis).map(|a| {
            let mut next = cell;
            let within = struck.at[a] - struck.at[a].floor();
            next[a] += if within < 0.5 { -1 } else { 1 };
            next
        });
        look(cell).or_else(|| beside.into_iter().find_map(look))
    }

    /// The boxes that hang together with the middle one, by faces, edges and corners.
    fn connected(&self) -> u128 {
        let mut piece = 1_u128 << 62;
        while piece != self.0 {
            let mut wider = piece;
            for (step, low, high) in [(1, ROW_LOW, ROW_HIGH), (5, COLUMN_LOW, COLUMN_HIGH), (25, 0, 0)] {
                wider |= (wider & !high) << step | (wider & !low) >> step;
            }
            wider &= self.0;
            if wider | piece == piece {
                break;
            }
            piece |= wider;
        }
        piece
    }

    /// Unit normal of the plane nearest to the connected boxes (least squares), on the side of `face`, and the part
    /// of their scatter that is along it.
    ///
    /// The normal is the eigenvector of the greatest eigenvalue of the adjugate of their scatter, by repeated
    /// squaring: sums and products in one order, the same on every machine.
    fn plane(&self, face: [f64; 3]) -> ([f64; 3], f64) {
        let mut packed = [0_u64; 2];
        let boxes = self.connected();
        #[expect(clippy::cast_possible_truncation, reason = "one half after the other")]
        for (mut boxes, from) in [(boxes as u64, 0), ((boxes >> 64) as u64, 64)] {
            while boxes != 0 {
                let moments = MOMENTS[(boxes.trailing_zeros() & 63 | from) as usize];
                boxes &= boxes - 1;
                packed = [packed[0] + moments[0], packed[1] + moments[1]];
            }
        }
        // At most 125 boxes of moments up to 16: 12 bits hold every sum.
        let field = |k: usize| (packed[k / 5] >> (12 * (k % 5)) & 0xfff) as f64;
        let products = [field(0), field(1), field(2), field(3), field(4), field(5)];
        let sum = [field(6), field(7), field(8)];
        let count = field(9);
        // Times the count squared, all whole numbers.
        let s: [f64; 6] = std::array::from_fn(|k| count * products[k] - sum[PAIRS[k].0] * sum[PAIRS[k].1]);
        let [xx, yy, zz, xy, xz, yz] = s;
        let adjugate = [
            yy * zz - yz * yz,
            xx * zz - xz * xz,
            xx * yy - xy * xy,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xy * xz - yz * xx,
        ];
        let size = (adjugate[0] + adjugate[1] + adjugate[2]).max(1.0);
        let mut m: [f64; 6] =
            std::array::from_fn(|k| adjugate[k] / size + FACE_WEIGHT * face[PAIRS[k].0] * face[PAIRS[k].1]);
        for _ in 0..5 {
            let [xx, yy, zz, xy, xz, yz] = m;
            let square = [
                xx * xx + xy * xy + xz * xz,
                xy * xy + yy * yy + yz * yz,
                xz * xz + yz * yz + zz * zz,
                xx * xy + xy * yy + xz * yz,
                xx * xz + xy * yz + xz * zz,
                xy * xz + yy * yz + yz * zz,
            ];
            // Its length does not matter, only that it does not vanish: by a power of two it stays exact.
            let trace = square[0] + square[1] + square[2];
            let scale = f64::from_bits((2045 << 52) - (trace.to_bits() & 0x7ff << 52));
            for (m, v) in m.iter_mut().zip(square) {
                *m = v * scale;
            }
        }
        let [xx, yy, zz, xy, xz, yz] = m;
        let column = if xx >= yy && xx >= zz {
            [xx, xy, xz]
        } else if yy >= zz {
            [xy, yy, yz]
        } else {
            [xz, yz, zz]
        };
        let length = dot(column, column).sqrt();
        let side = if dot(column, face) < 0.0 { -length } else { length };
        let n = [column[0] / side, column[1] / side, column[2] / side];
        let along: f64 = (0..6)
            .map(|k| if k < 3 { s[k] * n[k] * n[k] } else { 2.0 * s[k] * n[PAIRS[k].0] * n[PAIRS[k].1] })
            .sum();
        (n, along / (s[0] + s[1] + s[2]).max(1.0))
    }
}

/// Axes of the six different elements of a symmetric matrix.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// For each box of the window, counted from its low corner: products of its coordinates as in [`PAIRS`], its
/// coordinates, and 1, five in a word, 12 bits each. (128 entries, so that an index is masked.)
const MOMENTS: [[u64; 2]; 128] = {
    let mut table = [[0; 2]; 128];
    let mut bit = 0_usize;
    while bit < 125 {
        let p = [(bit % 5) as u64, (bit / 5 % 5) as u64, (bit / 25) as u64];
        let fields = [
            p[0] * p[0],
            p[1] * p[1],
            p[2] * p[2],
            p[0] * p[1],
            p[0] * p[2],
            p[1] * p[2],
            p[0],
            p[1],
            p[2],
            1,
        ];
        let mut k = 0;
        while k < 10 {
            table[bit][k / 5] |= fields[k] << (12 * (k % 5));
            k += 1;
        }
        bit += 1;
    }
    table
};

/// Boxes at the ends of the window's rows along x, and of its columns along y.
const ROW_LOW: u128 = ends(1, 0);
const ROW_HIGH: u128 = ends(1, 4);
const COLUMN_LOW: u128 = ends(5, 0);
const COLUMN_HIGH: u128 = ends(5, 4);

const fn ends(step: u32, at: u32) -> u128 {
    let mut bits = 0;
    let mut bit = 0;
    while bit < SIDE * SIDE * SIDE {
        if bit / step % SIDE == at {
            bits |= 1 << bit;
        }
        bit += 1;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{BoxIndex, Dims, Octant, morton};
    use crate::load::MemoryTree;

    const UP: Face = Face { axis: 2, high: true };

    fn sheet(height: impl Fn(u32, u32) -> u32) -> MemoryTree {
        let dims = Dims::new(16, 16, 16).unwrap();
        let mut codes: Vec<u64> =
            (0..256).map(|i| morton::encode(i % 16, i / 16, height(i % 16, i / 16))).collect();
        codes.sort_unstable();
        MemoryTree::new(dims, &codes).unwrap()
    }

    /// The box of a cell, as a ray from above meets it.
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
        shown(&tree.view(), &mut Surroundings::new(), hit.face, || hit, stored, Company::Calm)
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
        // The tread of a gentle slope, met by its rise: the normal is far from that face, and right.
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
            company(|at| {
                let other = others[usize::try_from(at + if at < 0 { 4 } else { 3 }).unwrap()];
                #[expect(clippy::cast_possible_truncation, reason = "whole numbers")]
                let whole = |n: [f64; 3]| n.map(|c| c as i32 * 127);
                assert_eq!(alike(up, other), alike_whole(whole(up), whole(other), 127));
                alike(up, other)
            })
        };
        assert_eq!(of([up; 8]), Company::Calm);
        // The far side of a thin sheet is no other direction.
        assert_eq!(of([up.map(|c| -c); 8]), Company::Calm);
        assert_eq!(of([side; 8]), Company::Noise);
        assert_eq!(of([up, up, up, up, side, side, side, side]), Company::Mixed);
        assert_eq!(company(|_| true), Company::Calm);
    }

    #[test]
    fn a_place_on_an_edge_is_found_again_or_left_alone() {
        let flat = sheet(|_, _| 5);
        let mut hit = struck(&flat, [7, 8, 5]);
        hit.at[0] = 8.000_001;
        assert!(of(&flat, hit, [1.0, 0.0, 0.0]).is_some());
        hit.at[0] = 12.5;
        assert_eq!(of(&flat, hit, [1.0, 0.0, 0.0]), None);
        // Boxes of a line and a single one: the face decides.
        let dims = Dims::new(16, 16, 16).unwrap();
        let mut line: Vec<u64> = (0..16).map(|y| morton::encode(7, y, 5)).collect();
        line.sort_unstable();
        let line = MemoryTree::new(dims, &line).unwrap();
        let n = of(&line, struck(&line, [7, 8, 5]), [1.0, 0.0, 0.0]).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
        let point = MemoryTree::new(dims, &[morton::encode(7, 8, 5)]).unwrap();
        let n = of(&point, struck(&point, [7, 8, 5]), [1.0, 0.0, 0.0]).unwrap();
        assert!(n[2] > 0.99, "{n:?}");
    }
}
