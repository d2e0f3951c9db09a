//! The surface between the samples as triangles: a vertex for each patch of a cube, a polygon around each edge
//! that changes sides.
//!
//! The dual of marching cubes (Nielson 2004): every polygon joins the patches of the four cubes around an edge. It is
//! closed, since these exist wherever the edge changes sides. Two cubes that meet in a face with inside corners on a
//! diagonal may be joined by the same two vertices twice; then a knot in the face keeps the two joints apart, so that
//! every edge has two triangles for any samples (Wenger 2013, section 3.3, names the case).
//!
//! A sample's side is kept exactly: a polygon stays between the two ends of its edge, and its corners lie around that
//! edge, so that a line through samples crosses the surface just where they change sides.
//!
//! Memory: two layers of cubes, and their vertices, or all vertices if the mesh is kept. Cost: in proportion to the
//! surface.

use std::collections::HashMap;
use std::io;

use super::bits::Bits;
use super::cases::{AMBIGUOUS_HIGH, CASES, edge_at, ends, is_inside, others};
use super::fault::ExportFault;
use super::patch::{Layer, Patch, PatchPoint, singles};
use super::vertex_color::{Light, Mixture};
use super::write::{Sink, Vertex, unit};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::geom::Affine;
use crate::interior::Rows;

/// A cube that the surface passes through, and the vertex of its first patch.
#[derive(Clone, Copy, Debug, Default)]
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
type Face = (usize, u32, u32, u32);

/// Triangles buffered before they are written.
const WAITING: usize = 1 << 12;

/// Vertices and triangles: all of them, or those of the last layers.
#[derive(Debug, Default)]
pub(super) struct Surface {
    pub(super) at: Vec<[f32; 3]>,
    /// Unit vectors, or zeros; empty for a model without normals.
    pub(super) normals: Vec<[f32; 3]>,
    /// Colours; empty for a model without them.
    pub(super) lights: Vec<Light>,
    pub(super) faces: Vec<[u32; 3]>,
}

/// Makes triangles of one layer of cubes after the other.
pub(super) struct Mesher<'a> {
    /// Maps the middle of a cube, by its numbers, to mm.
    to_mm: Affine,
    /// Destination, unless the mesh is kept.
    sink: Option<&'a mut dyn Sink>,
    has: [bool; 2],
    below: Rows<Cube>,
    here: Rows<Cube>,
    near: Near<Cube>,
    knots: HashMap<Face, [Option<u32>; 2]>,
    surface: Surface,
    /// Number of the first vertex in memory, of the first one not yet written, and of the first one of this layer.
    start: u32,
    unwritten: u32,
    layer_start: u32,
    mirrored: bool,
    triangles: u64,
}

impl<'a> Mesher<'a> {
    /// `has` is set for normals, and for colours. Without a sink the surface is kept.
    pub(super) fn new(to_mm: Affine, has: [bool; 2], sink: Option<&'a mut dyn Sink>) -> Self {
        Self {
            mirrored: to_mm.determinant() < 0.0,
            to_mm,
            sink,
            has,
            below: Rows::default(),
            here: Rows::default(),
            near: Near::default(),
            knots: HashMap::new(),
            surface: Surface::default(),
            start: 0,
            unwritten: 0,
            layer_start: 0,
            triangles: 0,
        }
    }

    /// The mesher with room for the patches of so many boxes: some have several.
    pub(super) fn with_room(mut self, boxes: usize) -> Self {
        let vertices = boxes.saturating_add(boxes / 4);
        let Surface { at, normals, lights, faces } = &mut self.surface;
        at.reserve(vertices);
        normals.reserve(if self.has[0] { vertices } else { 0 });
        lights.reserve(if self.has[1] { vertices } else { 0 });
        faces.reserve(vertices.saturating_mul(2));
        self
    }

    /// Vertices and triangles so far.
    pub(super) fn counts(&self) -> (u64, u64) {
        (u64::from(self.next_vertex()), self.triangles + self.surface.faces.len() as u64)
    }

    /// The surface that was kept.
    pub(super) fn finish(self) -> Surface {
        self.surface
    }

    #[inline(always)]
    fn next_vertex(&self) -> u32 {
        // Limited by `push`.
        self.start + u32::try_from(self.surface.at.len()).unwrap_or(u32::MAX)
    }

    /// Takes the cubes between two slices of samples; `z` is the number of the upper slice.
    ///
    /// # Errors
    /// Errors of the sink, and [`ExportFault::TooLong`].
    pub(super) fn layer(
        &mut self,
        samples: [&Bits; 2],
        surface: &mut Layer<'_>,
        height: usize,
        z: u32,
    ) -> io::Result<()> {
        std::mem::swap(&mut self.below, &mut self.here);
        self.here.clear();
        if self.sink.is_some() {
            let gone = (self.layer_start - self.start) as usize;
            let Surface { at, normals, lights, .. } = &mut self.surface;
            at.drain(..gone);
            normals.drain(..gone.min(normals.len()));
            lights.drain(..gone.min(lights.len()));
            self.start = self.layer_start;
        }
        if let Some(sink) = &mut self.sink {
            sink.layer(self.start)?;
        }
        self.layer_start = self.next_vertex();
        if !self.knots.is_empty() {
            self.knots.retain(|(_, _, _, at), _| *at + 1 >= z);
        }
        if samples.iter().all(|samples| samples.is_empty()) {
            return Ok(());
        }
        dispatch(LayerOf { mesher: self, samples, surface, height, z })
    }

    /// Makes the vertices of a row of cubes between four rows of samples; bit 0 and 1 of a row's number are set for the
    /// higher one along y and z.
    #[inline(always)]
    fn row(&mut self, rows: [&[u64]; 4], row: usize, z: u32, surface: &mut Layer<'_>) -> io::Result<()> {
        let mut before = [0; 4];
        for (word, at) in (0..rows[0].len()).zip((0_u32..).step_by(64)) {
            let (mut high, mut low) = ([0; 4], [0; 4]);
            let (mut some, mut all) = (0, u64::MAX);
            for j in 0..4 {
                high[j] = rows[j][word];
                // The sample before each one.
                low[j] = high[j] << 1 | before[j] >> 63;
                some |= high[j] | low[j];
                all &= high[j] & low[j];
            }
            before = high;
            let mut crossed = some & !all;
            while crossed != 0 {
                let bit = crossed.trailing_zeros();
                crossed &= crossed - 1;
                let mut case = 0;
                for j in 0..4 {
                    case |= (low[j] >> bit & 1) << (2 * j) | (high[j] >> bit & 1) << (2 * j + 1);
                }
                let (x, case) = (at + bit, case.to_le_bytes()[0]);
                self.here.push(Cube { x, case, first: self.next_vertex() });
                for patch in 0..CASES[usize::from(case)].patches {
                    let spot = surface.spot(Patch { x, row, case, patch });
                    self.add([x, row_number(row), z], &spot)?;
                }
            }
        }
        self.here.end_row();
        Ok(())
    }

    /// A vertex in a cube, or on its face.
    #[inline(always)]
    fn add(&mut self, cube: [u32; 3], spot: &PatchPoint) -> io::Result<u32> {
        let at = placed(&self.to_mm, cube, spot.at);
        self.push(Vertex { at, normal: spot.normal, light: spot.light })
    }

    #[inline(always)]
    fn push(&mut self, vertex: Vertex) -> io::Result<u32> {
        let number = self.next_vertex();
        if number >= u32::MAX - 1 {
            return Err(ExportFault::TooLong { needed: u64::from(number) + 1 }.into());
        }
        self.surface.at.push(vertex.at);
        if self.has[0] {
            self.surface.normals.push(vertex.normal);
        }
        if self.has[1] {
            self.surface.lights.push(vertex.light);
        }
        Ok(number)
    }

    #[inline(always)]
    fn place(&self, number: u32) -> [f32; 3] {
        self.surface.at.get(number.wrapping_sub(self.start) as usize).copied().unwrap_or_default()
    }

    fn get(&self, number: u32) -> Vertex {
        let at = number.wrapping_sub(self.start) as usize;
        let Surface { normals, lights, .. } = &self.surface;
        Vertex {
            at: self.place(number),
            normal: normals.get(at).copied().unwrap_or_default(),
            light: lights.get(at).copied().unwrap_or_default(),
        }
    }

    /// Passes pending vertices and triangles to the sink.
    fn write(&mut self) -> io::Result<()> {
        let Some(sink) = self.sink.take() else { return Ok(()) };
        for number in self.unwritten..self.next_vertex() {
            sink.vertex(&self.get(number))?;
        }
        self.unwritten = self.next_vertex();
        for corners in &self.surface.faces {
            sink.triangle(*corners, corners.map(|corner| self.place(corner)))?;
        }
        self.triangles += self.surface.faces.len() as u64;
        self.surface.faces.clear();
        self.sink = Some(sink);
        Ok(())
    }

    /// Makes the polygons whose last cube is in this layer.
    #[inline(always)]
    fn join(&mut self, height: usize, width: usize, z: u32) -> io::Result<()> {
        self.near.widen(width);
        for row in 1..height {
            self.near.take([self.here.row(row), self.below.row(row)], |cube| cube.x);
            for at in 0..self.here.row(row).len() {
                let cube = self.here.row(row)[at];
                // Corner 0 is compared with its neighbours along the axes.
                let turned = cube.case ^ (cube.case & 1).wrapping_neg();
                let (x, at) = (cube.x as usize, [cube.x, row_number(row), z]);
                if turned >> 1 & 1 == 1 {
                    self.polygon::<0>(x, at)?;
                }
                if turned >> 2 & 1 == 1 {
                    self.polygon::<1>(x, at)?;
                }
                if turned >> 4 & 1 == 1 {
                    self.polygon::<2>(x, at)?;
                }
            }
            if self.surface.faces.len() > WAITING {
                self.write()?;
            }
        }
        self.write()
    }

    /// The polygon around the edge along an axis in the lowest corner of the cube at `x`.
    #[inline(always)]
    fn polygon<const AXIS: usize>(&mut self, x: usize, at: [u32; 3]) -> io::Result<()> {
        let [b, c] = others(AXIS);
        // The samples at the ends of the edge differ, so its four cubes are crossed.
        let [p, q, r, s] = self.near.around(x, AXIS);
        let reversed = (r.case & 1 == 0) ^ (AXIS == 1) ^ self.mirrored;
        // The faces between two of the cubes, each the high face of the lower one.
        let high = |cube: Cube| AMBIGUOUS_HIGH[usize::from(cube.case)];
        if ((high(p) | high(s)) >> b | (high(p) | high(q)) >> c) & 1 == 1 {
            let edge = 4 * AXIS;
            let cubes =
                [(1 << b | 1 << c, p, edge + 3), (1 << c, q, edge + 2), (0, r, edge), (1 << b, s, edge + 1)];
            return self.knotted(AXIS, cubes, at, reversed);
        }
        // Without ambiguous faces between them, no two cubes are joined twice.
        let edge = 4 * AXIS;
        let corners = [p.vertex(edge + 3), q.vertex(edge + 2), r.vertex(edge), s.vertex(edge + 1)];
        self.quad(corners, reversed);
        Ok(())
    }

    /// A polygon of four corners, cut along its shorter diagonal.
    #[inline(always)]
    fn quad(&mut self, [p, q, r, s]: [u32; 4], reversed: bool) {
        let [p, q, r, s] = if reversed { [s, r, q, p] } else { [p, q, r, s] };
        let across = distance(self.place(q), self.place(s)) < distance(self.place(p), self.place(r));
        let pair = if across { [[q, r, s], [q, s, p]] } else { [[p, q, r], [p, r, s]] };
        self.surface.faces.extend_from_slice(&pair);
    }

    /// A polygon with knots where its cubes are joined twice.
    #[inline(never)]
    fn knotted(
        &mut self,
        axis: usize,
        cubes: [(usize, Cube, usize); 4],
        at: [u32; 3],
        reversed: bool,
    ) -> io::Result<()> {
        let mut corners = [0; 8];
        let mut count = 0;
        for i in 0..4 {
            let (here, next) = (cubes[i], cubes[(i + 1) % 4]);
            corners[count] = here.1.vertex(here.2);
            count += 1;
            if let Some(knot) = self.knot(axis, here, next, at)? {
                corners[count] = knot;
                count += 1;
            }
        }
        if let [p, q, r, s] = corners[..count] {
            self.quad([p, q, r, s], reversed);
            return Ok(());
        }
        let corners = &mut corners[..count];
        if reversed {
            corners.reverse();
        }
        let mut all = [Vertex::default(); 8];
        for (vertex, corner) in all.iter_mut().zip(&*corners) {
            *vertex = self.get(*corner);
        }
        let all = &all[..corners.len()];
        let share = 1.0 / all.len() as f32;
        let middle = Vertex {
            at: [0, 1, 2].map(|a| all.iter().map(|v| v.at[a] * share).sum()),
            normal: unit([0, 1, 2].map(|a| all.iter().map(|v| v.normal[a]).sum())),
            light: mean(all),
        };
        let middle = self.push(middle)?;
        let count = corners.len();
        self.surface.faces.extend((0..count).map(|i| [corners[i], corners[(i + 1) % count], middle]));
        Ok(())
    }

    /// The knot between two cubes of a polygon, if these are joined twice.
    fn knot(
        &mut self,
        axis: usize,
        one: (usize, Cube, usize),
        other: (usize, Cube, usize),
        [x, row, z]: [u32; 3],
    ) -> io::Result<Option<u32>> {
        // The axis along which they differ; the cube with the lower coordinate is below.
        let across = ((one.0 ^ other.0).trailing_zeros() as usize).min(2);
        let (low, high) = if one.0 >> across & 1 == 1 { (one, other) } else { (other, one) };
        if AMBIGUOUS_HIGH[usize::from(low.1.case)] >> across & 1 == 0 {
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
        let cube = [x - less(0), row - less(1), z - less(2)];
        let face = (across, cube[0], cube[1], cube[2]);
        let which = usize::from(inside > opposite);
        if let Some(knot) = self.knots.get(&face).and_then(|knots| knots[which]) {
            return Ok(Some(knot));
        }
        let mut at = super::patch::corner_at(inside).map(|c| c / 2.0);
        at[across] = 0.5;
        let ends = [self.get(low.1.vertex(low.2)), self.get(high.1.vertex(high.2))];
        let normal = unit([0, 1, 2].map(|a| ends[0].normal[a] + ends[1].normal[a]));
        let light = mean(&ends);
        let knot = self.add(cube, &PatchPoint { at, normal, light })?;
        self.knots.entry(face).or_default()[which] = Some(knot);
        Ok(Some(knot))
    }
}

/// The cubes of the last two rows of two layers by their places, the last row of the upper layer first: bit 0 and 1 of
/// a row's number are set for one less along y and z.
#[derive(Debug, Default)]
pub(super) struct Near<C>([Vec<C>; 4]);

impl<C: Copy + Default> Near<C> {
    /// Makes room for rows of so many cubes.
    pub(super) fn widen(&mut self, width: usize) {
        self.0.iter_mut().for_each(|row| row.resize(width, C::default()));
    }

    /// Takes the next row of a layer and of the one below; `x` is the place of a cube in its row.
    #[inline(always)]
    pub(super) fn take(&mut self, rows: [&[C]; 2], x: impl Fn(&C) -> u32) {
        self.0.swap(0, 1);
        self.0.swap(2, 3);
        for (cubes, near) in rows.into_iter().zip([0, 2]) {
            for cube in cubes {
                self.0[near][x(cube) as usize] = *cube;
            }
        }
    }

    /// The four cubes around the edge along an axis in the lowest corner of the cube at `x` of the last row, in their
    /// order around it: one less along both other axes, along the second, along neither, along the first.
    #[inline(always)]
    pub(super) fn around(&self, x: usize, axis: usize) -> [C; 4] {
        let [b, c] = others(axis);
        // Bit 0, 1, 2 are set if a cube is one less along x, y, z.
        let cube = |less: usize| self.0[less >> 1][x - (less & 1)];
        [cube(1 << b | 1 << c), cube(1 << c), cube(0), cube(1 << b)]
    }
}

/// A point within a cube, relative to its middle, in mm.
#[inline(always)]
pub(super) fn placed(to_mm: &Affine, cube: [u32; 3], within: [f64; 3]) -> [f32; 3] {
    let [x, y, z] = cube;
    let [p, q, r] = within;
    let at = [f64::from(x) + p, f64::from(y) + q, f64::from(z) + r];
    let rows = &to_mm.rows;
    singles([along(&rows[0], at), along(&rows[1], at), along(&rows[2], at)])
}

/// The squared distance of two points.
#[inline(always)]
pub(super) fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

/// A row of an affine applied to a place.
#[inline(always)]
fn along(row: &[f64; 4], at: [f64; 3]) -> f64 {
    row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3]
}

/// Number of a row; a slice has at most 65537.
fn row_number(row: usize) -> u32 {
    u32::try_from(row).unwrap_or(u32::MAX)
}

/// Work on one layer.
struct LayerOf<'m, 'a, 's, 'l> {
    mesher: &'m mut Mesher<'a>,
    samples: [&'s Bits; 2],
    surface: &'s mut Layer<'l>,
    height: usize,
    z: u32,
}

impl Kernel for LayerOf<'_, '_, '_, '_> {
    type Output = io::Result<()>;

    #[inline(always)]
    fn run(self, _: impl Lanes) -> io::Result<()> {
        let Self { mesher, samples: [low, high], surface, height, z } = self;
        // Row `y` of cubes lies between the samples' rows `y - 1` and `y`.
        mesher.here.end_row();
        for row in 1..height {
            let rows = [low.row(row - 1), low.row(row), high.row(row - 1), high.row(row)];
            mesher.row(rows, row, z, surface)?;
        }
        mesher.join(height, 64 * low.stride(), z)
    }
}

/// The mean colour of some vertices.
fn mean(vertices: &[Vertex]) -> Light {
    let mut mixture = Mixture::default();
    vertices.iter().for_each(|vertex| mixture.add(vertex.light));
    mixture.mean([0; 3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::bits::set;
    use crate::geom::Dims;
    use crate::memory_tree::MemoryTree;
    use crate::render::GridSpace;

    #[test]
    fn rows_become_cubes() {
        let (dims, affine) = (Dims::new(100, 2, 2).unwrap(), Affine::from_spacing([1.0; 3]));
        let (tree, space) = (MemoryTree::of_cells(dims, [[0; 3]]), GridSpace::new(dims, &affine).unwrap());
        let (view, none) = (tree.view(), Rows::default());
        let mut surface = Layer { view: &view, space: &space, items: [&none; 2], lights: None, at: (0, 0) };
        let mut found = |rows: [&[[u32; 2]]; 4]| {
            let mut samples = [Bits::new(100, 2), Bits::new(100, 2)];
            for (j, stretches) in rows.into_iter().enumerate() {
                let row = samples[j / 2].row_mut(j % 2);
                stretches.iter().for_each(|[start, end]| set(row, *start, *end));
            }
            let mut mesher = Mesher::new(affine, [false; 2], None);
            let [low, high] = &samples;
            let rows = [low.row(0), low.row(1), high.row(0), high.row(1)];
            mesher.row(rows, 1, 1, &mut surface).unwrap();
            mesher.here.row(0).iter().map(|cube| (cube.x, cube.case)).collect::<Vec<_>>()
        };
        assert_eq!(found([&[[2, 5]], &[], &[], &[]]), [(2, 0b0000_0010), (3, 0b11), (4, 0b11), (5, 0b01)]);
        let slab: &[[u32; 2]] = &[[1, 64]];
        assert_eq!(found([slab; 4]), [(1, 0b1010_1010), (64, 0b0101_0101)]);
    }
}
