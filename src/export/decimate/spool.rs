//! Vertices and triangles of a slab of layers by their columns, on disk.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};

use crate::export::write::Vertex;

/// Words that wait in memory for all columns.
const MAX_WORDS: usize = 1 << 18;
/// The word before a triangle; no vertex has this number.
const TRIANGLE: u32 = u32::MAX;
const TRIANGLE_WORDS: usize = 4;
const VERTEX_WORDS: usize = 9;

/// A column by its numbers along x and y.
pub(super) type Place = [u32; 2];

#[derive(Debug, Default)]
struct Column {
    words: Vec<u32>,
    /// Where those before lie in the file, and how many.
    written: Vec<(u64, usize)>,
}

/// What a column held, in the order in which it came.
#[derive(Debug, Default)]
pub(super) struct Contents {
    /// With their numbers in order; each once.
    pub(super) vertices: Vec<(u32, Vertex)>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Memory: 1 MiB, and what a column holds when it is taken. Disk: 36 bytes a vertex, 16 a triangle.
#[derive(Debug)]
pub(super) struct Spool {
    file: File,
    end: u64,
    columns: BTreeMap<[u32; 2], Column>,
    waiting: usize,
}

impl Spool {
    pub(super) fn new(file: File) -> Self {
        Self { file, end: 0, columns: BTreeMap::new(), waiting: 0 }
    }

    pub(super) fn vertex(&mut self, place: Place, number: u32, vertex: &Vertex) -> io::Result<()> {
        let [[x, y, z], [i, j, k]] = [vertex.at, vertex.normal].map(|v| v.map(f32::to_bits));
        let [r, g, b] = vertex.light.map(u32::from);
        self.push(place, [number, x, y, z, i, j, k, r | g << 16, b])
    }

    pub(super) fn triangle(&mut self, place: Place, [a, b, c]: [u32; 3]) -> io::Result<()> {
        self.push(place, [TRIANGLE, a, b, c])
    }

    fn push<const N: usize>(&mut self, place: Place, words: [u32; N]) -> io::Result<()> {
        self.columns.entry(place).or_default().words.extend(words);
        self.waiting += N;
        if self.waiting < MAX_WORDS {
            return Ok(());
        }
        self.file.seek(SeekFrom::Start(self.end))?;
        let mut all = Vec::with_capacity(self.waiting);
        for column in self.columns.values_mut().filter(|column| !column.words.is_empty()) {
            let at = self.end + (all.len() * size_of::<u32>()) as u64;
            column.written.push((at, column.words.len()));
            all.append(&mut column.words);
            column.words = Vec::new();
        }
        self.file.write_all(bytemuck::cast_slice(&all))?;
        self.end += (all.len() * size_of::<u32>()) as u64;
        self.waiting = 0;
        Ok(())
    }

    /// The columns so far, in order.
    pub(super) fn places(&self) -> Vec<Place> {
        self.columns.keys().copied().collect()
    }

    /// Takes a column away.
    pub(super) fn take(&mut self, place: Place) -> io::Result<Contents> {
        let Column { words: last, written } = self.columns.remove(&place).unwrap_or_default();
        self.waiting -= last.len();
        let mut words = vec![0_u32; written.iter().map(|(_, count)| count).sum::<usize>()];
        let mut rest = words.as_mut_slice();
        for (at, count) in written {
            let (here, behind) = rest.split_at_mut(count);
            self.file.seek(SeekFrom::Start(at))?;
            self.file.read_exact(bytemuck::cast_slice_mut(here))?;
            rest = behind;
        }
        words.extend(last);
        if self.columns.is_empty() {
            self.end = 0;
        }
        Ok(contents(&words))
    }
}

fn contents(mut words: &[u32]) -> Contents {
    let mut contents = Contents::default();
    loop {
        if let Some(([TRIANGLE, corners @ ..], rest)) = words.split_first_chunk::<TRIANGLE_WORDS>() {
            contents.triangles.push(*corners);
            words = rest;
        } else if let Some(([number, x, y, z, i, j, k, rg, b], rest)) =
            words.split_first_chunk::<VERTEX_WORDS>()
        {
            let [at, normal] = [[x, y, z], [i, j, k]].map(|v| v.map(|word| f32::from_bits(*word)));
            #[expect(clippy::cast_possible_truncation, reason = "as they were put together")]
            let light = [*rg, rg >> 16, *b].map(|word| word as u16);
            contents.vertices.push((*number, Vertex { at, normal, light }));
            words = rest;
        } else {
            break;
        }
    }
    contents.vertices.sort_unstable_by_key(|(number, _)| *number);
    contents.vertices.dedup_by_key(|(number, _)| *number);
    contents
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_come_back_as_they_went() {
        let mut spool = Spool::new(tempfile::tempfile().unwrap());
        let vertex = |number: u32| Vertex {
            at: [number as f32, 0.5, -1.0],
            normal: [0.0, 1.0, number as f32],
            light: [7, 65535, (number % 60000) as u16],
        };
        for number in (0..60_000).rev() {
            let place = [number % 3, number % 2];
            spool.vertex(place, number, &vertex(number)).unwrap();
            spool.triangle(place, [number, number + 1, 5]).unwrap();
            spool.vertex(place, number, &vertex(number)).unwrap();
        }
        assert_eq!(spool.places(), [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1]]);
        for place in spool.places() {
            let found = spool.take(place).unwrap();
            let numbers: Vec<u32> = (0..60_000).filter(|n| [n % 3, n % 2] == place).collect();
            assert!(found.vertices.iter().map(|(number, _)| *number).eq(numbers.iter().copied()));
            for (number, is) in &found.vertices {
                let expected = vertex(*number);
                assert_eq!((is.at, is.normal, is.light), (expected.at, expected.normal, expected.light));
            }
            let expected = numbers.iter().rev().map(|n| [*n, n + 1, 5]);
            assert!(found.triangles.into_iter().eq(expected));
        }
        assert!(spool.places().is_empty());
    }
}
