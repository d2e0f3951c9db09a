//! Crossings of a triangle with rows of voxel centres along all three axes: the voxel, and the half of it.
//!
//! ```text
//!        voxel i - 1        |        voxel i         |
//!   --------- c ---upper----|---lower--- c ---upper--|---
//!             └──── from one centre to the next ─────┘
//! ```
//!
//! Centres are moved by (-e, e^2, e^3) as in [`super::super::raster`], so that a closed mesh is crossed an even number
//! of times along every row, and never at a centre.

use super::super::lattice::{HALF, STEPS, Triangle, first_centre, last_centre, span};

/// Least distance of a crossing in f64 from a whole number at which its half is certain: errors are below 2^-31.
const SURE: f64 = 1e-6;

/// A crossing in the slice that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Crossing {
    pub(super) axis: usize,
    /// Voxel in which it lies.
    pub(super) x: i32,
    pub(super) y: i32,
    /// True beyond the voxel's centre.
    pub(super) upper: bool,
    /// True if the triangle looks along the axis.
    pub(super) along: bool,
}

/// Columns and rows that are wanted, the ends included.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    pub(super) x: (i32, i32),
    pub(super) y: (i32, i32),
}

/// A triangle projection along an axis.
struct Projection {
    axis: usize,
    /// The other two axes.
    p: usize,
    q: usize,
    corners: [[i64; 3]; 3],
    /// Twice the area, positive, and the sign that it had.
    area: i64,
    sign: i64,
    /// The triangle's direction, of any length.
    normal: [i64; 3],
}

impl Projection {
    /// Returns `None` for a triangle that contains the direction of the axis.
    fn new(t: &Triangle, normal: [i64; 3], axis: usize) -> Option<Self> {
        let (p, q) = [(1, 2), (0, 2), (0, 1)][axis];
        // The other two axes are in reverse order for the second.
        let area = if axis == 1 { -normal[1] } else { normal[axis] };
        let corners = std::array::from_fn(|k| std::array::from_fn(|a| i64::from(t[3 * k + a])));
        (area != 0).then(|| Self { axis, p, q, corners, area: area.abs(), sign: area.signum(), normal })
    }

    /// Calls `each(column, half)` for the rows at columns `first..=last` of `p` and at column `q` that cross the
    /// triangle: half 2 i is the lower one of voxel i, half 2 i + 1 the upper one.
    fn line(&self, q: i32, (first, last): (i32, i32), each: &mut impl FnMut(i32, i64)) {
        let centre = |at: i32| i64::from(at) * i64::from(STEPS) + i64::from(HALF);
        let (cp, cq) = (centre(first), centre(q));
        // Twice the area left of an edge, positive inside; the amount added where zero counts as outside; and the step.
        let edge = |a: usize, b: usize| {
            let (a, b) = (&self.corners[a], &self.corners[b]);
            let (dp, dq) = (self.sign * (b[self.p] - a[self.p]), self.sign * (b[self.q] - a[self.q]));
            let at = dp * (cq - a[self.q]) - dq * (cp - a[self.p]);
            // Along x centres are moved back, along y and z forward, each less than the one before.
            let towards = if self.p == 0 { dq } else { -dq };
            let inside = if dq == 0 { dp > 0 } else { towards > 0 };
            (at, if inside { 0 } else { -1 }, -dq * i64::from(STEPS))
        };
        let edges = [edge(1, 2), edge(2, 0), edge(0, 1)];
        let Some((skipped, count)) = between(&edges, last - first) else { return };
        let [(mut e0, t0, s0), (mut e1, t1, s1), (mut e2, t2, s2)] =
            edges.map(|(at, outside, step)| (at + i64::from(skipped) * step, outside, step));
        let [x0, x1, x2] = self.corners.map(|corner| corner[self.axis]);
        let scale = 1.0 / (self.area as f64 * f64::from(HALF));
        let first = first + skipped;
        for column in first..=first + count {
            if ((e0 + t0) | (e1 + t1) | (e2 + t2)) >= 0 {
                let at = (e0 as f64 * x0 as f64 + e1 as f64 * x1 as f64 + e2 as f64 * x2 as f64) * scale;
                // The sum is rounded without a call, as `floor` is one.
                #[expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^18 halves")]
                let towards_zero = at as i64;
                let whole = towards_zero - i64::from(towards_zero as f64 > at);
                let rest = at - whole as f64;
                let is_sure = rest > SURE && rest < 1.0 - SURE;
                each(column, if is_sure { whole } else { self.exact_half([e0, e1, e2]) });
            }
            e0 += s0;
            e1 += s1;
            e2 += s2;
        }
    }

    /// The half of a crossing; for a crossing at a centre, the half on the other side of the moved centre.
    fn exact_half(&self, weights: [i64; 3]) -> i64 {
        let sum: i128 =
            weights.iter().zip(&self.corners).map(|(w, p)| i128::from(*w) * i128::from(p[self.axis])).sum();
        let unit = i128::from(self.area) * i128::from(HALF);
        let half = i64::try_from(sum.div_euclid(unit)).unwrap_or(i64::MAX / 4);
        if sum.rem_euclid(unit) != 0 || half & 1 == 0 {
            return half;
        }
        // Side of the plane on which the moved centre lies.
        let [nx, ny, nz] = self.normal;
        let side = [-nx, ny, nz].into_iter().find(|c| *c != 0).map_or(0, i64::signum);
        if side * self.normal[self.axis].signum() < 0 { half } else { half - 1 }
    }
}

/// The first of steps 0 to `last` along a row on which all three edges may be positive, and the number of such steps
/// after it; `None` where no step is left. Each edge is given by its value at step 0, the amount added to it, and the
/// change per step.
fn between(edges: &[(i64, i64, i64); 3], last: i32) -> Option<(i32, i32)> {
    let (mut from, mut to) = (0, last);
    for (at, outside, step) in edges {
        #[expect(clippy::cast_possible_truncation, reason = "widened by one; saturates")]
        let zero = (-(at + outside) as f64 / *step as f64) as i32;
        match step.signum() {
            0 if at + outside < 0 => return None,
            0 => {}
            1 => from = from.max(zero.saturating_sub(1)),
            _ => to = to.min(zero.saturating_add(1)),
        }
    }
    (from <= to).then_some((from, to - from))
}

/// The direction of a triangle: differences are below 2^30, so that it fits.
fn direction(t: &Triangle) -> [i64; 3] {
    let t = t.map(i64::from);
    let (b, c) = ([t[3] - t[0], t[4] - t[1], t[5] - t[2]], [t[6] - t[0], t[7] - t[1], t[8] - t[2]]);
    [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]]
}

/// Calls `each` with every crossing of a triangle by rows of centres that lies in slice `z` and in the window.
pub(super) fn crossings(t: &Triangle, z: i32, window: &Window, each: &mut impl FnMut(Crossing)) {
    let (low, high) = span(t, 2);
    let floor = i64::from(z) * i64::from(STEPS);
    if i64::from(high) < floor || i64::from(low) > floor + i64::from(STEPS) {
        return;
    }
    let normal = direction(t);
    let within = |axis: usize, (from, to): (i32, i32)| {
        let (low, high) = span(t, axis);
        (first_centre(low).max(from), last_centre(high).min(to))
    };
    let (columns, rows) = (within(0, window.x), within(1, window.y));
    let wanted = |at: i64, (from, to): (i32, i32)| {
        i32::try_from(at >> 1).ok().filter(|voxel| (from..=to).contains(voxel))
    };
    if first_centre(low) <= z && z <= last_centre(high) {
        if let Some(projection) = Projection::new(t, normal, 0) {
            let along = normal[0] > 0;
            projection.line(z, rows, &mut |y, half| {
                if let Some(x) = wanted(half, window.x) {
                    each(Crossing { axis: 0, x, y, upper: half & 1 == 1, along });
                }
            });
        }
        if let Some(projection) = Projection::new(t, normal, 1) {
            let along = normal[1] > 0;
            projection.line(z, columns, &mut |x, half| {
                if let Some(y) = wanted(half, window.y) {
                    each(Crossing { axis: 1, x, y, upper: half & 1 == 1, along });
                }
            });
        }
    }
    if let Some(projection) = Projection::new(t, normal, 2) {
        let (along, slab) = (normal[2] > 0, Slab::new(t, normal, z));
        for y in rows.0..=rows.1 {
            let (from, to) = slab.columns(y);
            projection.line(y, (columns.0.max(from), columns.1.min(to)), &mut |x, half| {
                if half >> 1 == i64::from(z) {
                    each(Crossing { axis: 2, x, y, upper: half & 1 == 1, along });
                }
            });
        }
    }
}

/// Approximate location of a triangle's plane within a slice, which limits the cost of a triangle to its surface.
struct Slab {
    /// A row next to a corner, columns in which the plane meets the slice's two faces there, and their change from row
    /// to row; `None` where rows are parallel to the plane. From far away the columns would be lost in rounding.
    columns: Option<(f64, [f64; 2], f64)>,
}

impl Slab {
    fn new(t: &Triangle, normal: [i64; 3], z: i32) -> Self {
        let [nx, ny, nz] = normal.map(|c| c as f64);
        let [x0, y0, z0] = [t[0], t[1], t[2]].map(f64::from);
        let floor = f64::from(z) * f64::from(STEPS);
        // The slice, with a step more on either side.
        let faces = [floor - 1.0, floor + f64::from(STEPS) + 1.0];
        let column = |x: f64| (x - f64::from(HALF)) / f64::from(STEPS);
        let row = f64::from(last_centre(t[1]));
        let dy = row * f64::from(STEPS) + f64::from(HALF) - y0;
        let at = |z: f64| column(x0 - (nz * (z - z0) + ny * dy) / nx);
        Self { columns: (normal[0] != 0).then(|| (row, faces.map(at), -ny / nx)) }
    }

    /// Columns of a row between which the plane may be within the slice.
    fn columns(&self, y: i32) -> (i32, i32) {
        let Some((row, faces, step)) = self.columns else { return (i32::MIN / 2, i32::MAX / 2) };
        let [a, b] = faces.map(|column| column + step * (f64::from(y) - row));
        #[expect(clippy::cast_possible_truncation, reason = "clamped")]
        let [low, high] = [a.min(b), a.max(b)].map(|column| column.clamp(-1e6, 1e6) as i32);
        (low - 2, high + 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, with wide integers and a real, if small, shift: coordinates times 2^40, the shift far below any
    /// difference of lattice distances.
    fn by_definition(t: &Triangle, z: i32, window: &Window) -> Vec<(usize, i32, i32, bool, bool)> {
        let scale = 1_i128 << 40;
        let moved = [-(1_i128 << 30), 1 << 15, 1];
        let centre = |at: i32, axis: usize| (i128::from(at) * 4096 + 2048) * scale + moved[axis];
        let corner = |k: usize, a: usize| i128::from(t[3 * k + a]) * scale;
        let mut out = Vec::new();
        for axis in 0..3 {
            let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
            let ranges = [window.x, window.y, (z - 3, z + 3)];
            for i in ranges[p].0..=ranges[p].1 {
                for j in ranges[q].0..=ranges[q].1 {
                    let (cp, cq) = (centre(i, p), centre(j, q));
                    let side = |a: usize, b: usize| {
                        (corner(b, p) - corner(a, p)) * (cq - corner(a, q))
                            - (corner(b, q) - corner(a, q)) * (cp - corner(a, p))
                    };
                    // At most 2^110: one scale is taken out where products of three are needed.
                    let w = [side(1, 2), side(2, 0), side(0, 1)];
                    let along = w.iter().all(|w| *w > 0);
                    if !along && !w.iter().all(|w| *w < 0) {
                        continue;
                    }
                    // The half in which the row that was not moved is crossed, and which centres lie beyond.
                    let small = |k: usize, a: usize| i128::from(t[3 * k + a]);
                    let at = |c: i32| i128::from(c) * 4096 + 2048;
                    let plain = |a: usize, b: usize| {
                        (small(b, p) - small(a, p)) * (at(j) - small(a, q))
                            - (small(b, q) - small(a, q)) * (at(i) - small(a, p))
                    };
                    let v = [plain(1, 2), plain(2, 0), plain(0, 1)];
                    let area: i128 = v.iter().sum();
                    let sum: i128 = (0..3).map(|k| v[k] * small(k, axis)).sum();
                    let (area, sum) = (area * area.signum(), sum * area.signum());
                    let voxel = sum.div_euclid(area * 4096);
                    let voxel = i32::try_from(voxel).unwrap();
                    // The upper half is crossed if the moved centre of that voxel lies before the plane.
                    let mut at = [0; 3];
                    (at[axis], at[p], at[q]) = (voxel, i, j);
                    let d: [i128; 3] = std::array::from_fn(|a| centre(at[a], a) - corner(0, a));
                    let n = direction(t).map(i128::from);
                    let side: i128 = (0..3).map(|a| n[a] * d[a]).sum();
                    let upper = (side < 0) == (n[axis] > 0);
                    let fits = |c: i32, r: (i32, i32)| (r.0..=r.1).contains(&c);
                    if at[2] == z && fits(at[0], window.x) && fits(at[1], window.y) {
                        out.push((axis, at[0], at[1], upper, along));
                    }
                }
            }
        }
        out.sort_unstable();
        out
    }

    #[test]
    fn crossings_are_those_of_the_definition_also_through_edges_and_corners() {
        let mut state = 7_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 10) % n
        };
        let window = Window { x: (-1, 6), y: (-1, 6) };
        let mut met = 0;
        for round in 0..2000 {
            // Every other triangle has its vertices on centres and corners, where ties are.
            let t: Triangle = std::array::from_fn(|_| {
                let c = if round % 2 == 0 { next(11) * 2048 } else { next(5 * 4096) };
                i32::try_from(c).unwrap()
            });
            for z in -1..7 {
                let mut got = Vec::new();
                crossings(&t, z, &window, &mut |c| got.push((c.axis, c.x, c.y, c.upper, c.along)));
                got.sort_unstable();
                let want = by_definition(&t, z, &window);
                assert_eq!(got, want, "{t:?} slice {z}");
                met += want.len();
            }
        }
        assert!(met > 5000, "{met}");
    }

    #[test]
    fn rows_far_from_the_first_of_a_long_steep_triangle_keep_their_columns() {
        // The triangle is 131,072 voxels wide and high, nearly faces y, and lies 16,000 rows away: a column more moves
        // it by 2^29.
        let [x, y, z] = [-65_536 * STEPS, 16_000 * STEPS + HALF, STEPS - 1];
        let t: Triangle = [x, y, z, -x, y, STEPS, x, y + 1, -2 * x - STEPS];
        let (from, to) = Slab::new(&t, direction(&t), 0).columns(16_000);
        assert!(from <= 0 && to >= 63, "{from} to {to}");
    }
}
