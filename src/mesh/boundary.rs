//! Open edges of a mesh, found in constant memory, and the caps that close them.
//!
//! Edges are thrown into a table of sums: each into three cells, with the sign of its direction. Edges of closed parts
//! cancel, however many they are; the rest is peeled off cell by cell, as long as few enough are open (Eppstein,
//! Goodrich 2011, *Straggler Identification in Round-Trip Data Streams via Newton's Identities and Invertible Bloom
//! Filters*). The open edges of any mesh form loops; a cap over each closes it. A face that is there twice, or turned
//! over, is such a loop, too: its cap undoes it.

use super::lattice::{Triangle, smallest_first};
use crate::fault::{Fault, bad};
use crate::text::names::FILL;

/// Cells of the table. The number is part of the definition of a solid: it decides which meshes can be closed.
const CELLS: usize = 3 << 13;
/// Most open edges that are taken off the table; it seldom holds more than three quarters of its cells.
const MAX_EDGES: usize = 18_000;

/// Memory for finding open edges and closing them, together with the reader's, which rests while edges are in lists.
/// These grow while the table shrinks: it is gone before loops are sought, which take 112 bytes an edge at most.
pub(super) const BOUNDARY_BYTES: u64 = (CELLS * size_of::<Cell>() + (64 << 10)) as u64;
const _: () = assert!((MAX_EDGES * size_of::<OpenEdge>()) as u64 <= super::read::READER_BYTES);
const _: () = assert!(MAX_EDGES as u64 * 112 <= BOUNDARY_BYTES + super::read::READER_BYTES);

type Point = [i32; 3];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sums {
    /// Edges count with the sign of their direction.
    Signed,
    /// Edges count modulo two.
    Odd,
}

/// Sums over the edges that fell into a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Cell {
    count: i64,
    ends: [i64; 6],
    check: u64,
}

/// An edge that is left, with its ends and its multiplicity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct OpenEdge {
    from: Point,
    to: Point,
    times: i32,
}

pub(super) struct Table {
    sums: Sums,
    cells: Vec<Cell>,
}

fn mix(x: u64) -> u64 {
    let x = (x ^ x >> 31).wrapping_mul(0x7fb5_d329_728e_a185);
    let x = (x ^ x >> 27).wrapping_mul(0x81da_def4_bc2d_d44d);
    x ^ x >> 33
}

fn check_of(ends: &[i64; 6]) -> u64 {
    ends.iter().fold(0x243f_6a88_85a3_08d3, |hash, c| mix(hash.rotate_left(9) ^ c.cast_unsigned()))
}

/// The three cells of an edge, one in each third.
fn places(check: u64) -> [usize; 3] {
    let third = CELLS as u64 / 3;
    std::array::from_fn(|k| {
        let at = mix(check ^ (k as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)) % third;
        usize::try_from(at + k as u64 * third).unwrap_or(0)
    })
}

impl Cell {
    fn add(&mut self, sums: Sums, count: i64, ends: &[i64; 6], check: u64) {
        match sums {
            Sums::Signed => {
                self.count += count;
                for (sum, c) in self.ends.iter_mut().zip(ends) {
                    *sum = sum.wrapping_add(c.wrapping_mul(count));
                }
                self.check = self.check.wrapping_add(check.wrapping_mul(count.cast_unsigned()));
            }
            Sums::Odd => {
                self.count ^= 1;
                for (sum, c) in self.ends.iter_mut().zip(ends) {
                    *sum ^= c;
                }
                self.check ^= check;
            }
        }
    }

    /// The only edge in the cell, its multiplicity, and its hash.
    fn single(&self) -> Option<([i64; 6], i64, u64)> {
        if self.count == 0 || self.ends.iter().any(|c| c % self.count != 0) {
            return None;
        }
        let ends = self.ends.map(|c| c / self.count);
        let check = check_of(&ends);
        let same = check.wrapping_mul(self.count.cast_unsigned()) == self.check;
        same.then_some((ends, self.count, check))
    }
}

impl Table {
    pub(super) fn new(sums: Sums) -> Self {
        Self { sums, cells: vec![Cell::default(); CELLS] }
    }

    pub(super) fn add(&mut self, t: &Triangle) {
        let p = [[t[0], t[1], t[2]], [t[3], t[4], t[5]], [t[6], t[7], t[8]]];
        for (a, b) in [(p[0], p[1]), (p[1], p[2]), (p[2], p[0])] {
            if a == b {
                continue;
            }
            let ((low, high), count) = if a < b { ((a, b), 1) } else { ((b, a), -1) };
            let ends = [low[0], low[1], low[2], high[0], high[1], high[2]].map(i64::from);
            let check = check_of(&ends);
            for place in places(check) {
                self.cells[place].add(self.sums, count, &ends, check);
            }
        }
    }

    /// The edges that are left, in their order; `None` if they are too many.
    pub(super) fn open_edges(mut self) -> Option<Vec<OpenEdge>> {
        let mut edges = Vec::with_capacity(MAX_EDGES);
        loop {
            let before = edges.len();
            for at in 0..self.cells.len() {
                let Some((ends, count, check)) = self.cells[at].single() else { continue };
                for place in places(check) {
                    self.cells[place].add(self.sums, -count, &ends, check);
                }
                let point = |k: usize| -> Option<Point> {
                    let c = [ends[k], ends[k + 1], ends[k + 2]].map(|c| i32::try_from(c).ok());
                    Some([c[0]?, c[1]?, c[2]?])
                };
                let (low, high) = (point(0)?, point(3)?);
                let (from, to) = if count > 0 { (low, high) } else { (high, low) };
                if edges.len() == MAX_EDGES {
                    return None;
                }
                edges.push(OpenEdge { from, to, times: i32::try_from(count.abs()).ok()? });
            }
            if edges.len() == before {
                break;
            }
        }
        if self.cells.iter().any(|cell| *cell != Cell::default()) {
            return None;
        }
        edges.sort_unstable();
        Some(edges)
    }
}

/// True if the mesh has edges whose faces disagree about their direction.
pub(super) fn disagree(edges: &[OpenEdge]) -> bool {
    edges.iter().any(|edge| edge.times % 2 == 0)
}

/// The fault of a mesh with too many open edges.
pub(super) fn too_open() -> Fault {
    bad!(
        "has more than {} open edges, too many to close; repair the mesh, or say what is inside with {FILL} winding or {FILL} parity",
        MAX_EDGES as u64
    )
}

/// Edges of a graph, by the vertex at which they begin.
struct Graph {
    edges: Vec<OpenEdge>,
    odd: bool,
    /// For the first edge of each vertex: its place on the path, and the next edge to look at.
    on_path: Vec<u32>,
}

const NOT: u32 = u32::MAX;

impl Graph {
    fn first(&self, from: Point) -> usize {
        self.edges.partition_point(|edge| edge.from < from)
    }

    /// Takes an edge that begins at a vertex, the smallest that is left.
    fn take(&mut self, from: Point) -> Option<Point> {
        let first = self.first(from);
        let at = (first..self.edges.len())
            .take_while(|at| self.edges[*at].from == from)
            .find(|at| self.edges[*at].times > 0)?;
        let to = self.edges[at].to;
        self.edges[at].times -= 1;
        if self.odd {
            let twin = self.edges.partition_point(|edge| (edge.from, edge.to) < (to, from));
            if let Some(twin) = self.edges.get_mut(twin) {
                twin.times = 0;
            }
        }
        Some(to)
    }
}

/// Calls `cap` with triangles that close the loops of open edges; returns the number of loops.
///
/// A loop of three edges is closed by one triangle, a longer one by a fan around its mean. Loops that meet in a vertex
/// are parted there.
pub(super) fn close(
    mut edges: Vec<OpenEdge>,
    sums: Sums,
    cap: &mut dyn FnMut(Triangle) -> Result<(), crate::volume::SourceError>,
) -> Result<u64, crate::volume::SourceError> {
    if sums == Sums::Odd {
        let back: Vec<OpenEdge> =
            edges.iter().map(|e| OpenEdge { from: e.to, to: e.from, times: 1 }).collect();
        edges.extend(back);
        edges.sort_unstable();
    }
    let count = edges.len();
    let mut graph = Graph { edges, odd: sums == Sums::Odd, on_path: vec![NOT; count] };
    let mut loops = 0;
    let mut path: Vec<Point> = Vec::new();
    for at in 0..count {
        while graph.edges[at].times > 0 {
            let mut here = graph.edges[at].from;
            loop {
                let place = graph.first(here);
                let known = graph.on_path.get(place).copied().unwrap_or(NOT);
                if known != NOT {
                    // A loop: the path since that vertex.
                    let from = known as usize;
                    for p in &path[from..] {
                        let place = graph.first(*p);
                        graph.on_path[place] = NOT;
                    }
                    close_loop(&path[from..], cap)?;
                    loops += 1;
                    path.truncate(from);
                }
                let place = graph.first(here);
                if let Some(on_path) = graph.on_path.get_mut(place) {
                    *on_path = u32::try_from(path.len()).unwrap_or(NOT);
                }
                path.push(here);
                match graph.take(here) {
                    Some(next) => here = next,
                    None => break,
                }
            }
            for p in path.drain(..) {
                let place = graph.first(p);
                if let Some(on_path) = graph.on_path.get_mut(place) {
                    *on_path = NOT;
                }
            }
        }
    }
    Ok(loops)
}

fn close_loop(
    points: &[Point],
    cap: &mut dyn FnMut(Triangle) -> Result<(), crate::volume::SourceError>,
) -> Result<(), crate::volume::SourceError> {
    if let [a, b, c] = points {
        return cap(smallest_first([*b, *a, *c]));
    }
    let n = i64::try_from(points.len()).unwrap_or(1).max(1);
    let middle: Point = std::array::from_fn(|k| {
        let sum: i64 = points.iter().map(|p| i64::from(p[k])).sum();
        i32::try_from(sum.div_euclid(n)).unwrap_or(0)
    });
    for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
        cap(smallest_first([*b, *a, middle]))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::edge_parity::{Closed, EdgeParity};
    use super::*;

    /// A grid of squares, each of two triangles.
    fn sheet(n: i32) -> Vec<Triangle> {
        let p = |x: i32, y: i32| [100 * x, 100 * y, x * y % 7];
        let square = |x: i32, y: i32| {
            [
                smallest_first([p(x, y), p(x + 1, y), p(x + 1, y + 1)]),
                smallest_first([p(x, y), p(x + 1, y + 1), p(x, y + 1)]),
            ]
        };
        (0..n).flat_map(|x| (0..n).flat_map(move |y| square(x, y))).collect()
    }

    fn closed(mut mesh: Vec<Triangle>, sums: Sums) -> (Closed, u64, usize) {
        let mut table = Table::new(sums);
        mesh.iter().for_each(|t| table.add(t));
        let edges = table.open_edges().unwrap();
        let open = edges.len();
        let mut caps = Vec::new();
        let loops = close(edges, sums, &mut |t| {
            caps.push(t);
            Ok(())
        })
        .unwrap();
        mesh.extend(caps);
        let mut census = EdgeParity::default();
        mesh.iter().for_each(|t| census.add(t));
        (census.closed(), loops, open)
    }

    #[test]
    fn any_mesh_is_closed_by_caps_over_its_loops() {
        let mesh = sheet(40);
        assert_eq!(closed(mesh.clone(), Sums::Signed), (Closed::Oriented, 1, 160));
        // Holes, two of them meeting in a vertex, a face that is there twice and one that is turned over.
        let mut holes = mesh;
        for at in [900, 402, 322] {
            holes.remove(at);
        }
        let [a, b, c, d, e, f, g, h, i] = holes[50];
        holes.push([a, b, c, d, e, f, g, h, i]);
        let (result, loops, _) = closed(holes.clone(), Sums::Signed);
        assert_eq!((result, loops), (Closed::Oriented, 5));
        holes[70] = {
            let t = holes[70];
            [t[0], t[1], t[2], t[6], t[7], t[8], t[3], t[4], t[5]]
        };
        assert_eq!(closed(holes.clone(), Sums::Signed).0, Closed::Oriented);
        assert_ne!(closed(holes, Sums::Odd).0, Closed::No);
    }

    #[test]
    fn what_is_too_open_is_told() {
        let mut table = Table::new(Sums::Signed);
        for i in 0..10_000 {
            table.add(&[i, 0, 0, i, 9, 0, i, 0, 9]);
        }
        assert!(table.open_edges().is_none());
    }
}
