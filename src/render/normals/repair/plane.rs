//! The plane nearest to the skin around a hit.

use crate::load::{ModelView, NodeView};

use super::super::neighborhood::{Neighborhood, SIDE};
use super::Struck;

/// Weight of the face's own direction in the fit: it decides where the boxes form a line or a point.
const FACE_WEIGHT: f64 = 1e-3;

/// Occupancy near a box, from [`Neighborhood::window`]: bit `x + 5 y + 25 z`.
pub(super) struct Around(pub(super) u128);

impl Around {
    /// The boxes around the hit; `None` where the hit box is not found: a hit's point is rounded, and may fall into a
    /// neighbour.
    pub(super) fn of(view: &ModelView<'_>, around: &mut Neighborhood, struck: &Struck) -> Option<Self> {
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

    /// The boxes connected with the middle one, by faces, edges and corners.
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

    /// For the connected boxes: their count times the sums of products of their positions, less the products of the
    /// sums: their scatter times the count squared, all integers. Elements in the order of [`PAIRS`].
    pub(super) fn scatter(&self) -> [f64; 6] {
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
        let sum = [field(6), field(7), field(8)];
        let count = field(9);
        std::array::from_fn(|k| count * field(k) - sum[PAIRS[k].0] * sum[PAIRS[k].1])
    }
}

/// Unit normal of the plane nearest to boxes (least squares), on the side of `face`, and the part of their scatter
/// along it.
///
/// The normal is the eigenvector of the greatest eigenvalue of the adjugate of their scatter, by repeated squaring: sums
/// and products in one order, the same on every machine. Written without branches, so that loops over it vectorise.
#[inline(always)]
pub(super) fn nearest_plane([xx, yy, zz, xy, xz, yz]: [f64; 6], face: [f64; 3]) -> ([f64; 3], f64) {
    let [adj_xx, adj_yy, adj_zz] = [yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy];
    let [adj_xy, adj_xz, adj_yz] = [xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - yz * xx];
    let size = adj_xx + adj_yy + adj_zz;
    let size = if size > 1.0 { size } else { 1.0 };
    let mut m_xx = adj_xx / size + FACE_WEIGHT * face[0] * face[0];
    let mut m_yy = adj_yy / size + FACE_WEIGHT * face[1] * face[1];
    let mut m_zz = adj_zz / size + FACE_WEIGHT * face[2] * face[2];
    let mut m_xy = adj_xy / size + FACE_WEIGHT * face[0] * face[1];
    let mut m_xz = adj_xz / size + FACE_WEIGHT * face[0] * face[2];
    let mut m_yz = adj_yz / size + FACE_WEIGHT * face[1] * face[2];
    for _ in 0..5 {
        let sq_xx = m_xx * m_xx + m_xy * m_xy + m_xz * m_xz;
        let sq_yy = m_xy * m_xy + m_yy * m_yy + m_yz * m_yz;
        let sq_zz = m_xz * m_xz + m_yz * m_yz + m_zz * m_zz;
        let sq_xy = m_xx * m_xy + m_xy * m_yy + m_xz * m_yz;
        let sq_xz = m_xx * m_xz + m_xy * m_yz + m_xz * m_zz;
        let sq_yz = m_xy * m_xz + m_yy * m_yz + m_yz * m_zz;
        // Its length does not matter as long as it does not vanish: scaling by a power of two keeps it exact.
        let trace = sq_xx + sq_yy + sq_zz;
        let scale = f64::from_bits((2045_u64 << 52).wrapping_sub(trace.to_bits() & 0x7ff << 52));
        (m_xx, m_yy, m_zz) = (sq_xx * scale, sq_yy * scale, sq_zz * scale);
        (m_xy, m_xz, m_yz) = (sq_xy * scale, sq_xz * scale, sq_yz * scale);
    }
    // The column of the greatest element of the diagonal.
    let first = (m_xx >= m_yy) & (m_xx >= m_zz);
    let second = m_yy >= m_zz;
    let x = if first {
        m_xx
    } else if second {
        m_xy
    } else {
        m_xz
    };
    let y = if first {
        m_xy
    } else if second {
        m_yy
    } else {
        m_yz
    };
    let z = if first {
        m_xz
    } else if second {
        m_yz
    } else {
        m_zz
    };
    let length = (x * x + y * y + z * z).sqrt();
    let side = if x * face[0] + y * face[1] + z * face[2] < 0.0 { -length } else { length };
    let (x, y, z) = (x / side, y / side, z / side);
    let along = xx * x * x + yy * y * y + zz * z * z + 2.0 * xy * x * y + 2.0 * xz * x * z + 2.0 * yz * y * z;
    let all = xx + yy + zz;
    ([x, y, z], along / if all > 1.0 { all } else { 1.0 })
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
