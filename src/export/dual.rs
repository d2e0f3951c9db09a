//! The surface between the samples as triangles: a vertex for each patch of a cube, a polygon around each edge
//! that changes sides.
//!
//! The dual of marching cubes (Nielson 2004): every polygon joins the patches of the four cubes around an edge. It
//! closes, since these exist wherever the edge changes sides. Two cubes that meet in a face with inside corners on a
//! diagonal may be joined by the same two vertices twice; then a knot in the face keeps the two joints apart, so that
//! every edge has two triangles for any samples (Wenger 2013, section 3.3, names the case).
//!
//! A sample's side is kept exactly: a polygon stays between the two ends of its edge, and its corners lie
//! around that edge, so that a line through samples crosses the surface just where they change sides.
//!
//! Memory: two layers of cubes and vertices. Cost: follows the surface.

use std::collections::{HashMap, VecDeque};
use std::io;

use super::cases::{CASES, edge_at, ends, is_ambiguous, is_crossed, is_inside, others};
use super::fault::ExportFault;
use super::patch::{Patch, Spot, Spots};
use super::signs::Signs;
use super::tint::{Light, Mixture};
use super::write::{Sink, Vertex};
use crate::enclosed::Rows;
use crate::geom::Affine;

/// A cube that the surface passes through, and the vertex of its first patch.
#[derive(Clone, Copy, Debug)]
struct Cube {
    x: u32,
    case: u8,
    first: u32,
}

impl Cube {
    fn patch(self, edge: usize) -> u8 {
        CASES[usize::from(self.case)].patch_of[edge]
    }

    fn vertex(self, edge: usize) -> u32 {
        self.first + u32::from(self.patch(edge))
    }
}

/// A face with two joints: the axis across it, and the cube below it.
type Face = (usize, u32, usize, u32);

/// Makes triangles of one layer of cubes after the other.
pub(super) struct Mesher<'a> {
    /// Middle of a cube, in its numbers, to mm.
    to_mm: Affine,
    sink: &'a mut dyn Sink,
    below: Rows<Cube>,
    here: Rows<Cube>,
    knots: HashMap<Face, [Option<u32>; 2]>,
    /// Vertices of the two layers, the first of them by number.
    window: VecDeque<Vertex>,
    window_start: u32,
    layer_start: u32,
    mirrored: bool,
    triangles: u64,
}

impl<'a> Mesher<'a> {
    pub(super) fn new(to_mm: Affine, sink: &'a mut dyn Sink) -> Self {
        Self {
            mirrored: to_mm.determinant() < 0.0,
            to_mm,
            sink,
            below: Rows::default(),
            here: Rows::default(),
            knots: HashMap::new(),
            window: VecDeque::new(),
            window_start: 0,
            layer_start: 0,
            triangles: 0,
        }
    }

    /// Vertices and triangles so far.
    pub(super) fn counts(&self) -> (u64, u64) {
        (u64::from(self.next_vertex()), self.triangles)
    }

    fn next_vertex(&self) -> u32 {
        // Bounded by `add`.
        self.window_start + u32::try_from(self.window.len()).unwrap_or(u32::MAX)
    }

    /// Takes the cubes between two slices of samples; `z` is the number of the upper slice.
    ///
    /// # Errors
    /// The sink's, and [`ExportFault::TooLong`].
    pub(super) fn layer(
        &mut self,
        signs: [&Signs; 2],
        spots: &dyn Spots,
        height: usize,
        z: u32,
    ) -> io::Result<()> {
        std::mem::swap(&mut self.below, &mut self.here);
        self.here.clear();
        let keep_from = self.layer_start;
        self.window.drain(..(keep_from - self.window_start) as usize);
        self.window_start = keep_from;
        self.layer_start = self.next_vertex();
        self.knots.retain(|(_, _, _, at), _| *at + 1 >= z);
        if signs.iter().all(|signs| signs.is_empty()) {
            return Ok(());
        }
        // Row `y` of cubes lies between the samples' rows `y - 1` and `y`.
        self.here.end_row();
        let mut found = Vec::new();
        for row in 1..height {
            let [low, high] = signs;
            found.clear();
            cubes([low.row(row - 1), low.row(row), high.row(row - 1), high.row(row)], &mut found);
            for (x, case) in &found {
                let cube = Cube { x: *x, case: *case, first: self.next_vertex() };
                for patch in 0..CASES[usize::from(*case)].patches {
                    let spot = spots.spot(Patch { x: *x, row, case: *case, patch });
                    self.add(*x, row, z, &spot)?;
                }
                self.here.push(cube);
            }
            self.here.end_row();
        }
        self.join(height, z)
    }

    /// A vertex in a cube, or on its face.
    #[expect(clippy::cast_possible_truncation, reason = "files hold 32-bit coordinates")]
    fn add(&mut self, x: u32, row: usize, z: u32, spot: &Spot) -> io::Result<u32> {
        let row = u32::try_from(row).unwrap_or(u32::MAX);
        let cube = [x, row, z].map(f64::from);
        let mm = self.to_mm.apply(std::array::from_fn(|a| cube[a] + spot.at[a]));
        let normal = spot.normal.map(|c| c as f32);
        self.push(Vertex { at: mm.map(|c| c as f32), normal, light: spot.light })
    }

    fn push(&mut self, vertex: Vertex) -> io::Result<u32> {
        let number = self.next_vertex();
        if number >= u32::MAX - 1 {
            return Err(ExportFault::TooLong { needed: u64::from(number) + 1 }.into());
        }
        self.sink.vertex(&vertex)?;
        self.window.push_back(vertex);
        Ok(number)
    }

    fn get(&self, number: u32) -> Vertex {
        let at = number.checked_sub(self.window_start).map(|at| at as usize);
        at.and_then(|at| self.window.get(at)).copied().unwrap_or_default()
    }

    /// Makes the polygons whose last cube lies in this layer.
    fn join(&mut self, height: usize, z: u32) -> io::Result<()> {
        let (below, here) = (std::mem::take(&mut self.below), std::mem::take(&mut self.here));
        let mut outcome = Ok(());
        'rows: for row in 1..height {
            let around = [here.row(row), here.row(row - 1), below.row(row), below.row(row - 1)];
            let mut at = [0; 4];
            for cube in around[0] {
                // The cubes at `x` and `x - 1` of the four rows; bit 0, 1, 2: one less along x, y, z.
                let mut near = [None; 8];
                for (i, (cubes, at)) in around.iter().zip(&mut at).enumerate() {
                    while cubes.get(*at).is_some_and(|other| other.x + 1 < cube.x) {
                        *at += 1;
                    }
                    for other in cubes[*at..].iter().take(2).filter(|other| other.x <= cube.x) {
                        near[2 * i + (cube.x - other.x) as usize] = Some(*other);
                    }
                }
                for axis in 0..3 {
                    if is_crossed(cube.case, 4 * axis) {
                        outcome = self.polygon(axis, &near, [cube.x, z], row);
                        if outcome.is_err() {
                            break 'rows;
                        }
                    }
                }
            }
        }
        (self.below, self.here) = (below, here);
        outcome
    }

    /// The polygon around the edge along `axis` in the lowest corner of a cube.
    fn polygon(
        &mut self,
        axis: usize,
        near: &[Option<Cube>; 8],
        [x, z]: [u32; 2],
        row: usize,
    ) -> io::Result<()> {
        let [b, c] = others(axis);
        let ring = [[1, 1], [0, 1], [0, 0], [1, 0]];
        let mut cubes = [(0, Cube { x: 0, case: 0, first: 0 }, 0); 4];
        for (place, [less_b, less_c]) in cubes.iter_mut().zip(ring) {
            let less = less_b << b | less_c << c;
            // The samples around the edge say that its four cubes are crossed.
            let Some(cube) = near[less] else { return Ok(()) };
            *place = (less, cube, 4 * axis + less_b + 2 * less_c);
        }
        let mut corners = [0_u32; 8];
        let mut count = 0;
        for i in 0..4 {
            let (here, next) = (cubes[i], cubes[(i + 1) % 4]);
            corners[count] = here.1.vertex(here.2);
            count += 1;
            if let Some(knot) = self.knot(axis, here, next, [x, z], row)? {
                corners[count] = knot;
                count += 1;
            }
        }
        let inside_first = is_inside(cubes[2].1.case, 0);
        let corners = &mut corners[..count];
        if !inside_first ^ (axis == 1) ^ self.mirrored {
            corners.reverse();
        }
        self.fill(corners)
    }

    /// The knot between two cubes of a polygon, if these are joined twice.
    fn knot(
        &mut self,
        axis: usize,
        one: (usize, Cube, usize),
        other: (usize, Cube, usize),
        [x, z]: [u32; 2],
        row: usize,
    ) -> io::Result<Option<u32>> {
        // The axis along which they differ; the one that is one less lies below.
        let across = ((one.0 ^ other.0).trailing_zeros() as usize).min(2);
        let (low, high) = if one.0 >> across & 1 == 1 { (one, other) } else { (other, one) };
        if !is_ambiguous(low.1.case, across, 1) {
            return Ok(None);
        }
        let [p, q] = ends(low.2);
        let inside = if is_inside(low.1.case, p) { p } else { q };
        let along = 3 - axis - across;
        let opposite = inside ^ 1 << axis ^ 1 << along;
        let twice_low = low.1.patch(low.2) == low.1.patch(edge_at(opposite, axis));
        let twice_high = high.1.patch(high.2) == high.1.patch(edge_at(opposite ^ 1 << across, axis));
        if !(twice_low && twice_high) {
            return Ok(None);
        }
        let less = |a: usize| u32::try_from(low.0 >> a & 1).unwrap_or(0);
        let cube = (x - less(0), row - less(1) as usize, z - less(2));
        let face = (across, cube.0, cube.1, cube.2);
        let which = usize::from(inside > opposite);
        if let Some(knot) = self.knots.get(&face).and_then(|knots| knots[which]) {
            return Ok(Some(knot));
        }
        let mut at = super::patch::corner_at(inside).map(|c| c / 2.0);
        at[across] = 0.5;
        let ends = [self.get(low.1.vertex(low.2)), self.get(high.1.vertex(high.2))];
        let normal = [0, 1, 2].map(|a| f64::from(ends[0].normal[a]) + f64::from(ends[1].normal[a]));
        let light = mean(&ends);
        let knot = self.add(cube.0, cube.1, cube.2, &Spot { at, normal, light })?;
        self.knots.entry(face).or_default()[which] = Some(knot);
        Ok(Some(knot))
    }

    fn fill(&mut self, corners: &[u32]) -> io::Result<()> {
        if let [p, q, r, s] = *corners {
            // The shorter diagonal.
            let far = |a: u32, b: u32| -> f32 {
                let (a, b) = (self.get(a).at, self.get(b).at);
                (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
            };
            let [first, second] =
                if far(q, s) < far(p, r) { [[q, r, s], [q, s, p]] } else { [[p, q, r], [p, r, s]] };
            self.triangle(first)?;
            return self.triangle(second);
        }
        let all: Vec<Vertex> = corners.iter().map(|corner| self.get(*corner)).collect();
        #[expect(clippy::cast_precision_loss, reason = "five to eight")]
        let share = 1.0 / all.len() as f32;
        let middle = Vertex {
            at: [0, 1, 2].map(|a| all.iter().map(|v| v.at[a] * share).sum()),
            normal: [0, 1, 2].map(|a| all.iter().map(|v| v.normal[a]).sum()),
            light: mean(&all),
        };
        let middle = self.push(middle)?;
        (0..corners.len())
            .try_for_each(|i| self.triangle([corners[i], corners[(i + 1) % corners.len()], middle]))
    }

    fn triangle(&mut self, corners: [u32; 3]) -> io::Result<()> {
        self.triangles += 1;
        let vertices = corners.map(|corner| self.get(corner).at);
        self.sink.triangle(corners, vertices)
    }
}

/// The mean colour of some vertices.
fn mean(vertices: &[Vertex]) -> Light {
    let mut mixture = Mixture::default();
    vertices.iter().for_each(|vertex| mixture.add(vertex.light));
    mixture.mean([0; 3])
}

/// The cubes of a row that are crossed: where they are, and their cases. Of the rows of samples, bit 0 and 1 of
/// their number say which lies higher along y and z.
fn cubes(rows: [&[u32]; 4], found: &mut Vec<(u32, u8)>) {
    let mut at = [0; 4];
    // Bit j: the sample of row j is inside.
    let mut before = 0_u8;
    let mut x = 0;
    while let Some(change) = rows.iter().zip(at).filter_map(|(row, at)| row.get(at)).min().copied() {
        if before != 0 && before != 0b1111 {
            let case = spread(before) | spread(before) << 1;
            found.extend((x + 1..change).map(|x| (x, case)));
        }
        let mut now = before;
        for (j, row) in rows.iter().enumerate() {
            if row.get(at[j]) == Some(&change) {
                now ^= 1 << j;
                at[j] += 1;
            }
        }
        found.push((change, spread(before) | spread(now) << 1));
        (before, x) = (now, change);
    }
}

/// Bits 0 to 3 as bits 0, 2, 4, 6.
const fn spread(bits: u8) -> u8 {
    (bits & 1) | (bits & 2) << 1 | (bits & 4) << 2 | (bits & 8) << 3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_cubes() {
        let mut found = Vec::new();
        cubes([&[2, 5], &[], &[], &[]], &mut found);
        assert_eq!(found, [(2, 0b0000_0010), (3, 0b11), (4, 0b11), (5, 0b01)]);
        found.clear();
        cubes([&[1, 3]; 4], &mut found);
        assert_eq!(found, [(1, 0b1010_1010), (3, 0b0101_0101)]);
    }
}
