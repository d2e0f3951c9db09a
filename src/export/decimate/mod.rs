//! Fewer triangles within a bound of the distance, brick by brick.
//!
//! ```text
//!   layers --> columns of 32 x 32 samples (spool, on disk) --32 layers--> a brick's patch --> file
//!                                                                  fewer triangles (patch), checked (near)
//! ```
//!
//! Edges on the border of a patch stay as they are, so that the surface is closed if the fine one is, and patches
//! depend on nothing but the model: the file is the same on every machine of one kind.
//!
//! Memory: some MiB, the last two layers' vertices, and 12 bytes for each corner on the border of a slab's bricks. Disk:
//! 68 bytes a vertex of 32 layers.

mod near;
mod patch;
mod sheets;
mod spool;
mod tree;
mod whole;

pub(super) use sheets::Surface;
pub(super) use whole::{Goal, Whole, reduce};

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::iter;
use std::thread::{self, Builder, ScopedJoinHandle, available_parallelism};

use super::write::{Sink, Vertex, unit};
use crate::geom::Affine;
use patch::{Bound, Fewer, Patch};
use spool::{Contents, Place, Spool};

/// Samples along each side of a brick.
const BRICK: u32 = 32;
/// Most triangles of a patch: of a brick with more, parts.
const MAX_TRIANGLES: usize = 1 << 14;

/// Threads, each of which has a patch in memory.
const MAX_THREADS: usize = 4;

/// Takes fine triangles and hands on fewer.
pub(super) struct Decimator<'a> {
    to: &'a mut dyn Sink,
    from_mm: Affine,
    bound: Bound,
    /// Vertices that triangles may still have, from number `start` on.
    recent: Vec<Vertex>,
    start: u32,
    spool: Spool,
    /// Layers of this slab.
    layers: u32,
    /// New numbers of corners that several bricks have.
    seams: HashMap<u32, u32>,
    vertices: u32,
    triangles: u64,
    threads: usize,
}

impl<'a> Decimator<'a> {
    /// `from_mm`: to samples; `scratch`: an empty file.
    pub(super) fn new(
        to: &'a mut dyn Sink,
        from_mm: Affine,
        error_mm: f64,
        voxel_mm: f64,
        scratch: File,
    ) -> Self {
        Self {
            to,
            from_mm,
            bound: Bound { mm: error_mm, voxel_mm },
            recent: Vec::new(),
            start: 0,
            spool: Spool::new(scratch),
            layers: 0,
            seams: HashMap::new(),
            vertices: 0,
            triangles: 0,
            threads: available_parallelism().map_or(1, usize::from).min(MAX_THREADS),
        }
    }

    /// Hands on what waits; vertices and triangles in all.
    pub(super) fn finish(mut self) -> io::Result<(u64, u64)> {
        self.slab(u32::MAX)?;
        Ok((u64::from(self.vertices), self.triangles))
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "numbers below 0 are 0")]
    fn place(&self, at: [f32; 3]) -> Place {
        let [x, y, _] = self.from_mm.apply(at.map(f64::from));
        [x, y].map(|c| c as u32 / BRICK)
    }

    /// Hands on the slab; its vertices before `first` are not needed again.
    fn slab(&mut self, first: u32) -> io::Result<()> {
        let mut places = self.spool.places().into_iter().peekable();
        while places.peek().is_some() {
            let mut parts = Vec::new();
            for place in places.by_ref().take(self.threads) {
                let contents = self.spool.take(place)?;
                parts.extend(contents.triangles.chunks(MAX_TRIANGLES).map(|part| Part::new(&contents, part)));
            }
            for parts in parts.chunks(self.threads) {
                let bound = self.bound;
                let fewer: Vec<_> = thread::scope(|scope| {
                    let begin =
                        |part| Builder::new().spawn_scoped(scope, move || Part::decimated(part, bound));
                    let others: Vec<_> = parts[1..].iter().map(|part| (part, begin(part))).collect();
                    let first = parts[0].decimated(bound);
                    // A patch whose thread could not begin is as it was made here.
                    let ended = |(part, thread): (&Part, io::Result<ScopedJoinHandle<'_, _>>)| {
                        thread
                            .ok()
                            .and_then(|thread| thread.join().ok())
                            .unwrap_or_else(|| part.decimated(bound))
                    };
                    iter::once(first).chain(others.into_iter().map(ended)).collect()
                });
                for (part, fewer) in parts.iter().zip(fewer) {
                    self.hand_on(part, fewer)?;
                }
            }
        }
        self.seams.retain(|number, _| *number >= first);
        self.layers = 0;
        Ok(())
    }

    fn hand_on(&mut self, part: &Part, fewer: Fewer) -> io::Result<()> {
        let Part { numbers, vertices, patch } = part;
        let faces = fewer.faces.as_ref().unwrap_or(&patch.faces);
        let mut vertices = vertices.clone();
        vertices.extend(fewer.middles.iter().map(|ends| middle(ends.map(|end| part.vertices[end as usize]))));
        let is_shared = |local: usize| fewer.shared.get(local).is_some_and(|shared| *shared);
        let mut news = vec![None; vertices.len()];
        for face in faces {
            let mut corners = [0; 3];
            for (corner, local) in corners.iter_mut().zip(face.map(|local| local as usize)) {
                *corner = match news[local] {
                    Some(new) => new,
                    None => {
                        let new = self.number(&vertices[local], is_shared(local).then(|| numbers[local]))?;
                        *news[local].insert(new)
                    }
                };
            }
            self.to.triangle(corners, face.map(|local| vertices[local as usize].at))?;
        }
        self.triangles += faces.len() as u64;
        Ok(())
    }

    /// The new number of a vertex, which is handed on if it was not; `seam`: its old one, if other patches may have it.
    fn number(&mut self, vertex: &Vertex, seam: Option<u32>) -> io::Result<u32> {
        if let Some(known) = seam.and_then(|old| self.seams.get(&old)) {
            return Ok(*known);
        }
        self.to.vertex(vertex)?;
        let new = self.vertices;
        self.vertices += 1;
        if let Some(old) = seam {
            self.seams.insert(old, new);
        }
        Ok(new)
    }
}

/// The vertex in the middle of an edge.
fn middle([a, b]: [Vertex; 2]) -> Vertex {
    let of = |p: [f32; 3], q: [f32; 3]| [0, 1, 2].map(|k| f32::midpoint(p[k], q[k]));
    let light = [0, 1, 2].map(|k| a.light[k].midpoint(b.light[k]));
    Vertex { at: of(a.at, b.at), normal: unit(of(a.normal, b.normal)), light }
}

/// A brick's triangles, or some of them.
struct Part {
    /// Of the corners in the whole, in order.
    numbers: Vec<u32>,
    vertices: Vec<Vertex>,
    patch: Patch,
}

impl Part {
    fn new(contents: &Contents, triangles: &[[u32; 3]]) -> Self {
        let mut numbers: Vec<u32> = triangles.as_flattened().to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        let local = |number: &u32| numbers.binary_search(number).ok().and_then(|at| u32::try_from(at).ok());
        let vertex = |number: &u32| {
            let at = contents.vertices.binary_search_by_key(number, |(number, _)| *number);
            at.map(|at| contents.vertices[at].1).unwrap_or_default()
        };
        let vertices: Vec<Vertex> = numbers.iter().map(vertex).collect();
        let faces =
            triangles.iter().map(|face| face.each_ref().map(|number| local(number).unwrap_or_default()));
        let patch = Patch { at: vertices.iter().map(|vertex| vertex.at).collect(), faces: faces.collect() };
        Self { numbers, vertices, patch }
    }

    fn decimated(&self, bound: Bound) -> Fewer {
        self.patch.decimated(bound)
    }
}

impl Sink for Decimator<'_> {
    fn layer(&mut self, first: u32) -> io::Result<()> {
        let gone = first.saturating_sub(self.start) as usize;
        self.recent.drain(..gone.min(self.recent.len()));
        self.start = first;
        if self.layers == BRICK {
            self.slab(first)?;
            // Triangles of the next slab have them, too.
            for (number, vertex) in (first..).zip(&self.recent) {
                self.spool.vertex(self.place(vertex.at), number, vertex)?;
            }
        }
        self.layers += 1;
        Ok(())
    }

    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        let number = self.start + u32::try_from(self.recent.len()).unwrap_or(u32::MAX);
        self.recent.push(*vertex);
        self.spool.vertex(self.place(vertex.at), number, vertex)
    }

    fn triangle(&mut self, corners: [u32; 3], at: [[f32; 3]; 3]) -> io::Result<()> {
        let places = at.map(|at| self.place(at));
        for (corner, place) in corners.into_iter().zip(places).skip(1) {
            if place != places[0]
                && let Some(vertex) = self.recent.get(corner.wrapping_sub(self.start) as usize)
            {
                self.spool.vertex(places[0], corner, vertex)?;
            }
        }
        self.spool.triangle(places[0], corners)
    }
}
