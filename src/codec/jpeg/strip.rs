//! One row of MCUs of a DCT image as samples, and the rows of pixels made of it.

use super::super::{CodecError, RowSink};
use super::markers::Frame;

/// The samples of every component in one row of MCUs.
pub(super) struct Strip {
    planes: Vec<Plane>,
    row: Vec<i32>,
    rows_left: u32,
}

struct Plane {
    samples: Vec<u16>,
    stride: usize,
}

/// Arrangement of the data units of a frame (A.1.1, A.2).
#[derive(Clone, Copy)]
pub(super) struct Layout {
    /// MCUs side by side in an interleaved scan.
    pub(super) mcus_x: u32,
    /// Rows of MCUs.
    pub(super) mcus_y: u32,
}

impl Layout {
    /// The layout in blocks of 8x8 samples.
    pub(super) fn new(frame: &Frame) -> Self {
        Self { mcus_x: frame.columns.div_ceil(8 * frame.h_max), mcus_y: frame.rows.div_ceil(8 * frame.v_max) }
    }

    /// Blocks of a component that a scan of its own codes: across and down.
    pub(super) fn alone(frame: &Frame, h: u32, v: u32) -> (u32, u32) {
        let across = (frame.columns * h).div_ceil(frame.h_max).div_ceil(8);
        (across, (frame.rows * v).div_ceil(frame.v_max).div_ceil(8))
    }
}

impl Strip {
    /// Memory that the strip of a frame takes.
    pub(super) fn bytes(frame: &Frame) -> u64 {
        let mcus_x = u64::from(Layout::new(frame).mcus_x);
        let blocks: u64 = frame.components.iter().map(|c| u64::from(c.h * c.v)).sum();
        blocks * mcus_x * 128 + u64::from(frame.columns) * frame.components.len() as u64 * 4
    }

    /// Allocates the number of bytes that [`Strip::bytes`] gives.
    pub(super) fn new(frame: &Frame) -> Self {
        let mcus_x = Layout::new(frame).mcus_x as usize;
        let plane = |h: u32, v: u32| {
            let stride = mcus_x * h as usize * 8;
            Plane { samples: vec![0; stride * v as usize * 8], stride }
        };
        Self {
            planes: frame.components.iter().map(|c| plane(c.h, c.v)).collect(),
            row: vec![0; frame.columns as usize * frame.components.len()],
            rows_left: frame.rows,
        }
    }

    /// Puts the samples of the block at `x`, `y`, counted in blocks within the strip.
    pub(super) fn put(&mut self, component: usize, x: usize, y: usize, samples: &[u16; 64]) {
        let Some(plane) = self.planes.get_mut(component) else { return };
        let lines = plane.samples.chunks_exact_mut(plane.stride).skip(y * 8);
        for (line, samples) in lines.zip(samples.as_chunks::<8>().0) {
            if let Some(place) = line.get_mut(x * 8..x * 8 + 8) {
                place.copy_from_slice(samples);
            }
        }
    }

    /// Hands the rows of pixels on. Components with fewer samples than pixels repeat them.
    pub(super) fn emit(&mut self, frame: &Frame, sink: &mut dyn RowSink) -> Result<(), CodecError> {
        let rows = self.rows_left.min(8 * frame.v_max);
        self.rows_left -= rows;
        let count = frame.components.len();
        for y in 0..rows {
            for (index, (plane, component)) in self.planes.iter().zip(&frame.components).enumerate() {
                let line = (y * component.v / frame.v_max) as usize;
                let line = plane.samples.chunks_exact(plane.stride).nth(line).unwrap_or(&[]);
                let pixels = self.row.iter_mut().skip(index).step_by(count);
                if component.h == frame.h_max {
                    pixels.zip(line).for_each(|(pixel, &sample)| *pixel = sample.into());
                } else {
                    for (x, pixel) in (0..).zip(pixels) {
                        let x: u32 = x * component.h / frame.h_max;
                        *pixel = line.get(x as usize).copied().unwrap_or(0).into();
                    }
                }
            }
            sink.row(&self.row)?;
        }
        Ok(())
    }
}
