//! Fewer triangles: blocks of samples in the place of samples, each as far inside as its samples are.
//!
//! A coarse sample is the number of inside samples in a block of `step` along each axis; it is inside if these are more
//! than half. The surface crosses an edge where the numbers, joined by a straight line, pass the half. So walls thinner
//! than half a block go, and what stays is closed as the fine surface is.

use std::io;

use super::bits::{Bits, set};
use super::cases::{ENDS, is_crossed};
use super::dual::Mesher;
use super::patch::{Patch, Spot, Spots, held_within, in_world, middle};
use super::signs::Boxes;
use super::tint::{BlockTints, Light, Lights, Mixture};
use crate::load::ModelView;
use crate::render::GridSpace;

/// Numbers of inside samples in the blocks of one coarse slice, row by row, with an empty block around all.
#[derive(Clone, Debug)]
struct Blocks {
    step: u32,
    width: usize,
    height: usize,
    inside: Vec<u32>,
}

impl Blocks {
    /// Empty blocks over slices of `width` by `height` samples.
    fn new(step: u32, width: u32, height: usize) -> Self {
        let along = |samples: usize| samples.div_ceil(step as usize) + 2;
        let (width, height) = (along(width as usize), along(height));
        Self { step, width, height, inside: vec![0; width * height] }
    }

    /// Counts the samples of a fine slice; `height` is its number of rows.
    fn add(&mut self, samples: &Bits, height: usize) {
        let step = self.step;
        for row in 0..height {
            let first = (row / step as usize + 1) * self.width + 1;
            for [start, end] in samples.stretches(row) {
                for block in start / step..end.div_ceil(step) {
                    let samples = (block * step + step).min(end) - (block * step).max(start);
                    if let Some(inside) = self.inside.get_mut(first + block as usize) {
                        *inside += samples;
                    }
                }
            }
        }
    }

    fn full(&self) -> u32 {
        self.step * self.step * self.step
    }

    /// Which blocks are inside.
    fn samples(&self) -> Bits {
        let mut samples = Bits::new(u32::try_from(self.width).unwrap_or(u32::MAX), self.height);
        for (row, counts) in self.inside.chunks(self.width).enumerate() {
            let inside = (0..).zip(counts).filter(|(_, inside)| 2 * **inside > self.full());
            inside.for_each(|(x, _)| set(samples.row_mut(row), x, x + 1));
        }
        samples
    }

    /// How far a block is from half full, in blocks.
    fn value(&self, x: usize, row: usize) -> f64 {
        let inside = self.inside.get(row * self.width + x).copied().unwrap_or(0);
        f64::from(inside) / f64::from(self.full()) - 0.5
    }
}

/// Gathers fine slices into blocks, and hands on the layers between these.
#[derive(Debug)]
pub(super) struct Coarse {
    /// Blocks before anything is counted.
    empty: Blocks,
    now: Blocks,
    /// Fine slices counted in `now`.
    counted: u32,
    before: (Blocks, Bits),
    /// Colours of the blocks of both slices, if the model has any.
    tints: Option<[BlockTints; 2]>,
    nothing: Light,
    /// Slices of blocks handed on, the empty one before the first included.
    slices: u32,
}

impl Coarse {
    /// For slices of `width` by `height` samples.
    pub(super) fn new(step: u32, width: u32, height: usize, lights: Option<&Lights>) -> Self {
        let empty = Blocks::new(step, width, height);
        let before = (empty.clone(), empty.samples());
        let tints = lights.map(|_| Default::default());
        let nothing = lights.map_or([0; 3], Lights::nothing);
        Self { now: empty.clone(), empty, counted: 0, before, tints, nothing, slices: 1 }
    }

    /// Takes the colours of the slice of samples that comes next.
    pub(super) fn tint(&mut self, view: &ModelView<'_>, lights: &Lights, boxes: &Boxes, height: usize) {
        if let Some([_, now]) = &mut self.tints {
            now.add(view, lights, boxes, self.now.step, height);
        }
    }

    /// Takes the next slice of samples.
    pub(super) fn add(
        &mut self,
        samples: &Bits,
        height: usize,
        mesher: &mut Mesher<'_>,
        space: &GridSpace,
    ) -> io::Result<()> {
        self.now.add(samples, height);
        self.counted += 1;
        if self.counted == self.now.step { self.close(mesher, space) } else { Ok(()) }
    }

    /// Ends a slice of blocks.
    fn close(&mut self, mesher: &mut Mesher<'_>, space: &GridSpace) -> io::Result<()> {
        let now = std::mem::replace(&mut self.now, self.empty.clone());
        let samples = now.samples();
        let Self { tints, nothing, .. } = self;
        let mut layer =
            CoarseLayer { blocks: [&self.before.0, &now], tints: tints.as_ref(), nothing: *nothing, space };
        mesher.layer([&self.before.1, &samples], &mut layer, now.height, self.slices)?;
        self.slices += 1;
        self.counted = 0;
        self.before = (now, samples);
        if let Some(tints) = &mut self.tints {
            tints.swap(0, 1);
            tints[1] = BlockTints::default();
        }
        Ok(())
    }

    /// Ends the last slice of blocks, and puts an empty one behind it.
    pub(super) fn finish(mut self, mesher: &mut Mesher<'_>, space: &GridSpace) -> io::Result<()> {
        if self.counted > 0 {
            self.close(mesher, space)?;
        }
        self.close(mesher, space)
    }
}

/// A layer of cubes between two slices of blocks.
struct CoarseLayer<'a> {
    blocks: [&'a Blocks; 2],
    tints: Option<&'a [BlockTints; 2]>,
    nothing: Light,
    space: &'a GridSpace,
}

impl Spots for CoarseLayer<'_> {
    fn spot(&mut self, place: Patch) -> Spot {
        let value = |corner: usize| {
            let (x, row) = (place.x as usize - 1 + (corner & 1), place.row - 1 + (corner >> 1 & 1));
            self.blocks[corner >> 2].value(x, row)
        };
        let at = middle(place, |edge| {
            debug_assert!(is_crossed(place.case, edge));
            let [low, high] = ENDS[edge].map(value);
            // A block that is just half full counts as outside.
            if low == high { 0.5 } else { low / (low - high) }
        });
        let values = [0, 1, 2, 3, 4, 5, 6, 7].map(value);
        // The mean of the crossings lies on the chords of a bent surface: from there to the surface itself.
        let mut at = held_within(at);
        for _ in 0..2 {
            let (depth, slope) = trilinear(&values, at);
            let square = slope.iter().map(|s| s * s).sum::<f64>();
            if square > 1e-6 {
                at = held_within(std::array::from_fn(|a| at[a] - depth * slope[a] / square));
            }
        }
        let (_, slope) = trilinear(&values, at);
        Spot { at, normal: in_world(self.space, slope.map(|s| -s)), light: self.light(place) }
    }
}

impl CoarseLayer<'_> {
    /// The mean of the skin in the blocks of a cube.
    fn light(&self, place: Patch) -> Light {
        let Some(tints) = self.tints else { return self.nothing };
        let mut mixture = Mixture::default();
        let row = u32::try_from(place.row).unwrap_or(u32::MAX);
        for corner in 0..8_u32 {
            // An empty block lies before the first along each axis.
            let block = [(place.x + (corner & 1)).checked_sub(2), (row + (corner >> 1 & 1)).checked_sub(2)];
            if let [Some(x), Some(row)] = block {
                tints[(corner >> 2) as usize].mix((x, row), &mut mixture);
            }
        }
        mixture.mean(self.nothing)
    }
}

/// The interpolation of eight corners, and its slope, at a point given from the middle of the cube.
fn trilinear(corners: &[f64; 8], at: [f64; 3]) -> (f64, [f64; 3]) {
    let mut sum = (0.0, [0.0; 3]);
    for (corner, value) in corners.iter().enumerate() {
        let side = |a: usize| if corner >> a & 1 == 1 { 1.0 } else { -1.0 };
        let weight = [0, 1, 2].map(|a| 0.5 + side(a) * at[a]);
        sum.0 += value * weight[0] * weight[1] * weight[2];
        for a in 0..3 {
            sum.1[a] += value * side(a) * weight[(a + 1) % 3] * weight[(a + 2) % 3];
        }
    }
    sum
}
