//! Vertices and triangles of each label, on disk until all are known.
//!
//! Memory: 2 MiB for all buffers, and less than 1 KiB a label more.

use std::fs::File;
use std::io;

use crate::export::write::{bytes_of, counted};
use crate::scratch::Chains;

/// Bytes of a vertex: its position and its normal; and of a triangle.
const VERTEX: usize = 24;
const TRIANGLE: usize = 12;
/// Bytes of all buffers, unless so many labels would make chunks shorter than the minimum.
const BUFFERS: usize = 2 << 20;
const LEAST: usize = 20 * VERTEX;
const MOST: usize = 2048 * VERTEX;

/// The surface of one label.
#[derive(Debug)]
struct Part {
    is_wanted: bool,
    counts: [u64; 2],
    low: [f32; 3],
    high: [f32; 3],
}

/// A vertex: its position in mm, and its normal, a unit vector or zeros.
pub(super) type Point = [[f32; 3]; 2];

/// The surfaces of all labels.
#[derive(Debug)]
pub(super) struct Parts {
    /// Vertices of part `n` have key `2 n`, its triangles the next one.
    records: Chains,
    parts: Vec<Part>,
}

impl Parts {
    /// Parts that are not wanted stay empty.
    pub(super) fn new(file: File, wanted: &[bool]) -> Self {
        let count = wanted.len();
        let page = (BUFFERS / (2 * count.max(1))).clamp(LEAST, MOST) / VERTEX * VERTEX;
        let (low, high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let part = |is_wanted: &bool| Part { is_wanted: *is_wanted, counts: [0; 2], low, high };
        Self { records: Chains::new(file, 2 * count, page), parts: wanted.iter().map(part).collect() }
    }

    /// Vertices and triangles of a part so far.
    pub(super) fn counts(&self, part: usize) -> [u64; 2] {
        self.parts.get(part).map_or([0; 2], |part| part.counts)
    }

    /// Least and greatest coordinates of a part that has vertices.
    pub(super) fn bounds(&self, part: usize) -> [[f32; 3]; 2] {
        self.parts.get(part).map_or([[0.0; 3]; 2], |part| [part.low, part.high])
    }

    fn wanted(&mut self, part: usize) -> Option<&mut Part> {
        self.parts.get_mut(part).filter(|part| part.is_wanted)
    }

    /// Adds a vertex, and gives its number within its part.
    #[inline]
    pub(super) fn vertex(&mut self, part: usize, point: &Point) -> io::Result<u32> {
        let Some(of) = self.wanted(part) else { return Ok(0) };
        let [at, normal] = point;
        for (a, c) in at.iter().enumerate() {
            of.low[a] = of.low[a].min(*c);
            of.high[a] = of.high[a].max(*c);
        }
        let number = counted(of.counts[0])?;
        of.counts[0] += 1;
        let record: [u8; VERTEX] = bytemuck::cast([bytes_of(*at), bytes_of(*normal)]);
        self.records.push(2 * part, &record)?;
        Ok(number)
    }

    /// Adds a triangle of a part's vertices.
    #[inline]
    pub(super) fn triangle(&mut self, part: usize, corners: [u32; 3]) -> io::Result<()> {
        let Some(of) = self.wanted(part) else { return Ok(()) };
        of.counts[1] += 1;
        let record: [u8; TRIANGLE] = bytemuck::cast(corners.map(u32::to_le_bytes));
        self.records.push(2 * part + 1, &record)
    }

    /// A part's vertices in order.
    pub(super) fn each_vertex(
        &self,
        part: usize,
        mut work: impl FnMut(Point) -> io::Result<()>,
    ) -> io::Result<()> {
        self.each::<VERTEX>(2 * part, |record| {
            let point: [[[u8; 4]; 3]; 2] = bytemuck::cast(*record);
            work(point.map(|numbers| numbers.map(f32::from_le_bytes)))
        })
    }

    /// A part's triangles in order, by the numbers of its vertices.
    pub(super) fn each_triangle(
        &self,
        part: usize,
        mut work: impl FnMut([u32; 3]) -> io::Result<()>,
    ) -> io::Result<()> {
        self.each::<TRIANGLE>(2 * part + 1, |record| {
            work(bytemuck::cast::<_, [[u8; 4]; 3]>(*record).map(u32::from_le_bytes))
        })
    }

    fn each<const N: usize>(
        &self,
        key: usize,
        mut work: impl FnMut(&[u8; N]) -> io::Result<()>,
    ) -> io::Result<()> {
        self.records.for_each_chunk(
            key,
            |e| e,
            |bytes| bytes.as_chunks::<N>().0.iter().try_for_each(&mut work),
        )
    }
}
