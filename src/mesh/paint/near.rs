//! Triangles that may be near to the voxels of a box, sorted by boxes in a scratch file.
//!
//! They wait in their order, are counted by boxes, and are then written again, box by box, within each in their order.
#![expect(clippy::cast_possible_truncation, reason = "boxes lie within the grid, their number is bounded")]

use std::fs::File;
use std::io;
use std::path::Path;

use super::super::lattice::{STEPS, Triangle, centres, edges};
use crate::geom::{Dims, cross};
use crate::platform::FileExt;

pub(super) type Numbered = [i32; 10];
const RECORD: usize = size_of::<Numbered>();
const MAX_BOXES: u64 = 1 << 15;
/// Voxels beyond a box that its triangles are near to.
pub(super) const BEYOND: i32 = 2;
/// Triangles that are sorted at a time, and read at a time.
const BATCH: usize = 4096;
pub(super) const BLOCK: usize = 1024;

/// Memory while triangles are gathered, without the boxes.
pub(super) const SORTING_BYTES: u64 = (BATCH * (RECORD + 16) + 4 * BLOCK * RECORD) as u64;

#[derive(Clone, Copy, Debug)]
struct Boxes {
    /// Edge of a box in voxels, as a power of two.
    shift: i32,
    sides: [i32; 3],
}

impl Boxes {
    fn new(dims: Dims) -> Self {
        let mut shift = 5;
        loop {
            let sides = dims.to_array().map(|side| side.div_ceil(1 << shift) as i32);
            if sides.iter().map(|side| *side as u64).product::<u64>() <= MAX_BOXES {
                return Self { shift, sides };
            }
            shift += 1;
        }
    }

    fn count(&self) -> usize {
        self.sides.iter().map(|side| *side as usize).product()
    }

    /// Calls `each` with every box that a triangle may be near to.
    fn each(&self, t: &Triangle, each: &mut dyn FnMut(usize)) {
        let mut ranges = [(0, 0); 3];
        for (axis, out) in ranges.iter_mut().enumerate() {
            let (low, high) = centres(t, axis);
            // Half a voxel more is allowed for a triangle between two centres; a cell begins half a voxel before its
            // centre.
            let first = (low - 1 - BEYOND) >> self.shift;
            *out = (first.max(0), ((high + 2 + BEYOND) >> self.shift).min(self.sides[axis] - 1));
        }
        let [(x0, x1), (y0, y1), (z0, z1)] = ranges;
        let plane = NearPlane::new(t, self.shift);
        for z in z0..=z1 {
            for y in y0..=y1 {
                for x in x0..=x1 {
                    if plane.is_near([x, y, z]) {
                        each(((z * self.sides[1] + y) * self.sides[0] + x) as usize);
                    }
                }
            }
        }
    }
}

/// The plane of a triangle, with the distance within which a box is near.
struct NearPlane {
    normal: [f64; 3],
    offset: f64,
    edge: f64,
    reach: f64,
}

impl NearPlane {
    fn new(t: &Triangle, shift: i32) -> Self {
        let [a, b, c] = edges(t);
        let n = cross(b, c);
        let edge = f64::from(STEPS) * f64::from(1 << shift);
        let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        // Half a box along each axis, three voxels, and a hundredth for rounding.
        let half = n.iter().map(|c| c.abs()).sum::<f64>() * edge * 0.51;
        let reach = half + length * f64::from((BEYOND + 1) * STEPS);
        Self { normal: n, offset: n[0] * a[0] + n[1] * a[1] + n[2] * a[2], edge, reach }
    }

    fn is_near(&self, at: [i32; 3]) -> bool {
        let along: f64 = (0..3).map(|k| self.normal[k] * (f64::from(at[k]) + 0.5) * self.edge).sum();
        (along - self.offset).abs() <= self.reach
    }
}

pub(super) struct Sorter {
    boxes: Boxes,
    counts: Vec<u32>,
    file: File,
    buffer: Vec<Numbered>,
    written: u64,
}

#[derive(Debug)]
pub(super) struct Near {
    boxes: Boxes,
    /// First triangle of every box, and one more.
    starts: Vec<u64>,
    file: File,
}

impl Sorter {
    pub(super) fn new(dims: Dims, folder: &Path) -> io::Result<Self> {
        let boxes = Boxes::new(dims);
        let file = crate::scratch::unnamed(folder)?;
        let buffer = Vec::with_capacity(BLOCK);
        Ok(Self { boxes, counts: vec![0; boxes.count()], file, buffer, written: 0 })
    }

    pub(super) fn add(&mut self, t: &Triangle, number: u32) -> io::Result<()> {
        let Self { boxes, counts, .. } = self;
        boxes.each(t, &mut |at| counts[at] = counts[at].saturating_add(1));
        let [a, b, c, d, e, f, g, h, i] = *t;
        self.buffer.push([a, b, c, d, e, f, g, h, i, number.cast_signed()]);
        if self.buffer.len() == BLOCK { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.write_all_at(bytemuck::cast_slice(&self.buffer), self.written * RECORD as u64)?;
        self.written += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    /// Writes them box by box.
    pub(super) fn finish(mut self, folder: &Path) -> io::Result<Near> {
        self.flush()?;
        let mut starts = Vec::with_capacity(self.counts.len() + 1);
        let mut all = 0;
        for count in &self.counts {
            starts.push(all);
            all += u64::from(*count);
        }
        starts.push(all);
        drop(std::mem::take(&mut self.counts));
        let out = crate::scratch::unnamed(folder)?;
        let mut next = starts.clone();
        // Boxes of the triangles, and their places in the block.
        let mut order: Vec<(u32, u16)> = Vec::with_capacity(BATCH);
        let mut sorted: Vec<Numbered> = Vec::with_capacity(BATCH);
        let mut block = vec![[0; 10]; BLOCK];
        let mut from = 0;
        while from < self.written {
            let count = (self.written - from).min(BLOCK as u64) as usize;
            let block = block.get_mut(..count).unwrap_or_default();
            self.file.read_exact_at(bytemuck::cast_slice_mut(block), from * RECORD as u64)?;
            from += count as u64;
            let mut failed = Ok(());
            for (at, record) in block.iter().enumerate() {
                let [t @ .., _] = record;
                self.boxes.each(t, &mut |number| {
                    if order.len() == BATCH && failed.is_ok() {
                        failed = write(&mut order, &mut sorted, block, &mut next, &out);
                    }
                    order.push((number as u32, at as u16));
                });
            }
            failed?;
            write(&mut order, &mut sorted, block, &mut next, &out)?;
        }
        Ok(Near { boxes: self.boxes, starts, file: out })
    }
}

/// Writes a batch in runs of one box each.
fn write(
    order: &mut Vec<(u32, u16)>,
    sorted: &mut Vec<Numbered>,
    block: &[Numbered],
    next: &mut [u64],
    out: &File,
) -> io::Result<()> {
    order.sort_unstable();
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        sorted.clear();
        sorted.extend(run.iter().map(|(_, at)| block[usize::from(*at)]));
        let to = &mut next[run[0].0 as usize];
        out.write_all_at(bytemuck::cast_slice(sorted), *to * RECORD as u64)?;
        *to += run.len() as u64;
    }
    order.clear();
    Ok(())
}

impl Near {
    pub(super) fn bytes(&self) -> u64 {
        (self.starts.len() * size_of::<u64>()) as u64
    }

    pub(super) fn box_of(&self, voxel: [u32; 3]) -> usize {
        let [x, y, z] = voxel.map(|c| c as i32 >> self.boxes.shift);
        ((z * self.boxes.sides[1] + y) * self.boxes.sides[0] + x) as usize
    }

    /// Triangles of a box.
    pub(super) fn count(&self, at: usize) -> u64 {
        match (self.starts.get(at), self.starts.get(at + 1)) {
            (Some(from), Some(to)) => to - from,
            _ => 0,
        }
    }

    /// Triangles of a box from one on, as many as there is room for.
    pub(super) fn read(&self, at: usize, from: u64, out: &mut Vec<Numbered>, most: usize) -> io::Result<()> {
        let count = self.count(at).saturating_sub(from).min(most as u64) as usize;
        out.clear();
        out.resize(count, [0; 10]);
        let first = self.starts.get(at).copied().unwrap_or(0) + from;
        self.file.read_exact_at(bytemuck::cast_slice_mut(out), first * RECORD as u64)
    }
}
