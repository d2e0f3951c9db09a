//! The plane nearest to the skin around a hit.

use crate::load::{ModelView, NodeView};

use super::super::around::{SIDE, Surroundings};
use super::super::space::dot;
use super::Struck;

/// Weight of the face's own direction in the fit: it decides where the boxes form a line or a point.
const FACE_WEIGHT: f64 = 1e-3;

/// Which boxes near one are skin, as [`Surroundings::window`] tells: bit `x + 5 y + 25 z`.
pub(super) struct Around(u128);

impl Around {
    /// The boxes around the one that was struck; `None` where it is not found: a hit's place is rounded, and may
    /// come out in a neighbour.
    pub(super) fn of(view: &ModelView<'_>, around: &mut Surroundings, struck: &Struck) -> Option<Self> {
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
    pub(super) fn plane(&self, face: [f64; 3]) -> ([f64; 3], f64) {
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
