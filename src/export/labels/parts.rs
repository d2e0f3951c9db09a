//! Vertices and triangles of each label, which wait on disk until all are known.
//!
//! Memory: 2 MiB for all buffers, less than 1 KiB a label more, and 4 bytes a page.

use std::fs::File;
use std::io;

use crate::export::write::{bytes_of, counted};
use crate::platform::FileExt;

/// Bytes of a vertex: its place and its normal; and of a triangle.
const VERTEX: usize = 24;
const TRIANGLE: usize = 12;
/// Bytes of all buffers, unless there are so many labels that pages would be shorter than the least.
const BUFFERS: usize = 2 << 20;
const LEAST: usize = 20 * VERTEX;
const MOST: usize = 2048 * VERTEX;

/// Bytes in pages of one file.
#[derive(Debug, Default)]
struct Pages {
    full: Vec<u32>,
    open: Vec<u8>,
}

/// The surface of one label.
#[derive(Debug)]
struct Part {
    vertices: Pages,
    triangles: Pages,
    counts: [u64; 2],
    low: [f32; 3],
    high: [f32; 3],
}

/// A vertex: where it is in mm, and its normal, of length 1 or zeros.
pub(super) type Point = [[f32; 3]; 2];

/// The surfaces of all labels.
#[derive(Debug)]
pub(super) struct Parts {
    file: File,
    page: usize,
    pages: u32,
    parts: Vec<Part>,
}

impl Parts {
    pub(super) fn new(file: File, count: usize) -> Self {
        let page = (BUFFERS / (2 * count.max(1))).clamp(LEAST, MOST) / VERTEX * VERTEX;
        let part = || Part {
            vertices: Pages::default(),
            triangles: Pages::default(),
            counts: [0; 2],
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
        };
        Self { file, page, pages: 0, parts: std::iter::repeat_with(part).take(count).collect() }
    }

    /// Vertices and triangles of a part so far.
    pub(super) fn counts(&self, part: usize) -> [u64; 2] {
        self.parts.get(part).map_or([0; 2], |part| part.counts)
    }

    /// Least and greatest coordinates of a part that has vertices.
    pub(super) fn bounds(&self, part: usize) -> [[f32; 3]; 2] {
        self.parts.get(part).map_or([[0.0; 3]; 2], |part| [part.low, part.high])
    }

    /// Adds a vertex, and gives its number within its part.
    #[inline]
    pub(super) fn vertex(&mut self, part: usize, point: &Point) -> io::Result<u32> {
        let Some(of) = self.parts.get_mut(part) else { return Ok(0) };
        let [at, normal] = point;
        for (a, c) in at.iter().enumerate() {
            of.low[a] = of.low[a].min(*c);
            of.high[a] = of.high[a].max(*c);
        }
        let number = counted(of.counts[0])?;
        of.counts[0] += 1;
        of.vertices.open.reserve_exact(self.page - of.vertices.open.len());
        of.vertices.open.extend_from_slice(&bytes_of(*at));
        of.vertices.open.extend_from_slice(&bytes_of(*normal));
        turn(&mut of.vertices, self.page, &self.file, &mut self.pages)?;
        Ok(number)
    }

    /// Adds a triangle of a part's vertices.
    #[inline]
    pub(super) fn triangle(&mut self, part: usize, corners: [u32; 3]) -> io::Result<()> {
        let Some(of) = self.parts.get_mut(part) else { return Ok(()) };
        of.counts[1] += 1;
        of.triangles.open.reserve_exact(self.page - of.triangles.open.len());
        let bytes: [u8; TRIANGLE] = bytemuck::cast(corners.map(u32::to_le_bytes));
        of.triangles.open.extend_from_slice(&bytes);
        turn(&mut of.triangles, self.page, &self.file, &mut self.pages)
    }

    /// A part's vertices in order.
    pub(super) fn each_vertex(
        &self,
        part: usize,
        mut work: impl FnMut(Point) -> io::Result<()>,
    ) -> io::Result<()> {
        let Some(part) = self.parts.get(part) else { return Ok(()) };
        self.each::<VERTEX>(&part.vertices, |record| {
            let number = |at: usize| f32::from_le_bytes(std::array::from_fn(|i| record[4 * at + i]));
            work([0, 3].map(|first| std::array::from_fn(|a| number(first + a))))
        })
    }

    /// A part's triangles in order, by the numbers of its vertices.
    pub(super) fn each_triangle(
        &self,
        part: usize,
        mut work: impl FnMut([u32; 3]) -> io::Result<()>,
    ) -> io::Result<()> {
        let Some(part) = self.parts.get(part) else { return Ok(()) };
        self.each::<TRIANGLE>(&part.triangles, |record| {
            work(std::array::from_fn(|k| u32::from_le_bytes(std::array::from_fn(|i| record[4 * k + i]))))
        })
    }

    fn each<const N: usize>(
        &self,
        pages: &Pages,
        mut work: impl FnMut(&[u8; N]) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut bytes = vec![0; self.page];
        for page in &pages.full {
            self.file.read_exact_at(&mut bytes, u64::from(*page) * self.page as u64)?;
            bytes.as_chunks::<N>().0.iter().try_for_each(&mut work)?;
        }
        pages.open.as_chunks::<N>().0.iter().try_for_each(work)
    }
}

/// Puts a full page into the file.
#[inline]
fn turn(pages: &mut Pages, page: usize, file: &File, count: &mut u32) -> io::Result<()> {
    if pages.open.len() < page {
        return Ok(());
    }
    file.write_all_at(&pages.open, u64::from(*count) * page as u64)?;
    pages.full.push(*count);
    *count = counted(u64::from(*count) + 1)?;
    pages.open.clear();
    Ok(())
}
