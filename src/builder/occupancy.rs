//! The range test of a whole volume, for stages that work on bits before the scan: one bit a voxel, and samples moved
//! to the side of the threshold that their bit states.

use std::ops::Range;

use super::classify::classify;
use super::error::BuildError;
use super::parallel::{Blocks, run_workers};
use super::range::{Ordered, SampleRange};
use crate::budget::costs::{MAPPED_FROM, WORKER_OVERHEAD};
use crate::format::Selection;
use crate::progress::Progress;
use crate::volume::{Rescale, ScalarType, VolumeSource};

/// Bytes of samples that a worker reads at a time; below the size from which the allocator maps a buffer of its own, so
/// that the memory is returned.
const READ_BYTES: usize = 64 << 10;
const _: () = assert!(READ_BYTES < MAPPED_FROM);

/// Memory of one worker of [`for_each_block`], including the source's memory for it.
pub(crate) fn worker_bytes(source: &dyn VolumeSource) -> u64 {
    2 * READ_BYTES as u64 + WORKER_OVERHEAD + source.resident_bytes()
}

/// The range test for samples whose type is known at run time only.
pub(crate) trait RangeTest: Send + Sync {
    /// Bit i of `words` is set where sample i is inside; bits beyond the last sample are 0. `words` is
    /// exactly as long as needed.
    fn classify(&self, samples: &[u8], words: &mut [u64]);

    /// Moves every sample whose side of the threshold differs from its bit in `wanted` to the nearest sample
    /// value on the other side. A range that holds every value of an integer type has no outside; a float is
    /// NaN there.
    fn enforce(&self, samples: &mut [u8], wanted: &[u64]);
}

/// The test of a selection, or `None` if no sample can be inside.
pub(crate) fn range_test(
    scalar: ScalarType,
    selection: &Selection,
    rescale: Rescale,
) -> Option<Box<dyn RangeTest>> {
    by_type!(scalar, T => typed::<T>(selection, rescale))
}

fn typed<T: Ordered>(selection: &Selection, rescale: Rescale) -> Option<Box<dyn RangeTest>> {
    let range = SampleRange::<T>::of_selection(selection, rescale)?;
    Some(Box::new(TypedTest { range, outside: range.nearest_outside() }))
}

struct TypedTest<T> {
    range: SampleRange<T>,
    /// Nearest samples below and above the range.
    outside: (Option<T>, Option<T>),
}

impl<T: Ordered> TypedTest<T> {
    /// The nearest sample outside the range for an inside one; the lower one of two.
    fn removed(&self, sample: T) -> T {
        match self.outside {
            (Some(below), Some(above)) => {
                let v = sample.to_f64();
                if v - below.to_f64() <= above.to_f64() - v { below } else { above }
            }
            (Some(only), None) | (None, Some(only)) => only,
            (None, None) => T::NO_NUMBER.unwrap_or(sample),
        }
    }

    /// The nearest sample inside the range for an outside one; the lower end for NaN.
    fn added(&self, sample: T) -> T {
        if sample > self.range.hi { self.range.hi } else { self.range.lo }
    }

    fn enforce_typed(&self, samples: &mut [T], wanted: &[u64]) {
        for (samples, wanted) in samples.chunks_mut(64).zip(wanted) {
            let mut is = [0];
            classify(samples, self.range, &mut is);
            let mask = u64::MAX >> (64 - samples.len());
            let mut differ = (is[0] ^ wanted) & mask;
            while differ != 0 {
                let i = differ.trailing_zeros();
                differ &= differ - 1;
                let sample = &mut samples[i as usize];
                *sample = if wanted >> i & 1 == 1 { self.added(*sample) } else { self.removed(*sample) };
            }
        }
    }
}

/// Copies samples that need not be aligned.
fn aligned<T: Ordered>(samples: &[u8]) -> Vec<T> {
    samples.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

impl<T: Ordered> RangeTest for TypedTest<T> {
    fn classify(&self, samples: &[u8], words: &mut [u64]) {
        match bytemuck::try_cast_slice::<u8, T>(samples) {
            Ok(samples) => classify(samples, self.range, words),
            Err(_) => classify(&aligned::<T>(samples), self.range, words),
        }
    }

    fn enforce(&self, samples: &mut [u8], wanted: &[u64]) {
        if let Ok(typed) = bytemuck::try_cast_slice_mut::<u8, T>(samples) {
            return self.enforce_typed(typed, wanted);
        }
        let mut copy = aligned::<T>(samples);
        self.enforce_typed(&mut copy, wanted);
        samples.copy_from_slice(bytemuck::cast_slice(&copy));
    }
}

/// Receives rows of bits: slice, first row, first word of each row, words of a row, and the words row by row.
pub(crate) type BlockSink<'a> = dyn Fn(u32, u32, usize, usize, &[u64]) -> Result<(), BuildError> + Sync + 'a;

/// Reads slices of the volume once, some rows at a time on several threads, and hands the bits of every block to `sink`
/// in any order. A block starts at a column that is a multiple of 64.
///
/// # Errors
/// The errors of the source and of `sink`.
pub(crate) fn for_each_block(
    source: &dyn VolumeSource,
    test: &dyn RangeTest,
    threads: usize,
    progress: &dyn Progress,
    slices: Range<u32>,
    sink: &BlockSink<'_>,
) -> Result<(), BuildError> {
    let sample_bytes = source.info().scalar.bytes();
    let blocks = Blocks::new(source.info().dims, READ_BYTES / sample_bytes).of_slices(slices);
    let [cols, rows] = blocks.size();
    run_workers(threads, progress, &|stop| {
        // A buffer of words, which aligns the samples for every type.
        let mut buffer = vec![0_u64; (cols * rows * sample_bytes).div_ceil(8)];
        let mut words = vec![0_u64; cols.div_ceil(64) * rows];
        while !stop() {
            let Some((columns, lines, z)) = blocks.next() else { break };
            let per_row = columns.len().div_ceil(64);
            let row_bytes = columns.len() * sample_bytes;
            let samples = &mut bytemuck::cast_slice_mut::<u64, u8>(&mut buffer)[..row_bytes * lines.len()];
            source.read_rows(z, lines.clone(), columns.clone(), samples)?;
            let words = &mut words[..per_row * lines.len()];
            for (row, bits) in samples.chunks_exact(row_bytes).zip(words.chunks_exact_mut(per_row)) {
                test.classify(row, bits);
            }
            sink(z, lines.start, columns.start as usize / 64, per_row, words)?;
            if columns.start == 0 && lines.start == 0 {
                progress.advance(1);
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::SelectionKind;

    fn enforced<T: Ordered + std::fmt::Debug>(lo: f64, hi: f64, samples: &[T], wanted: u64) -> Vec<T> {
        let selection = Selection { kind: SelectionKind::Range, lo, hi };
        let test = typed::<T>(&selection, Rescale::IDENTITY).unwrap();
        let mut bytes: Vec<u8> = bytemuck::cast_slice(samples).to_vec();
        test.enforce(&mut bytes, &[wanted]);
        let mut is = [0];
        test.classify(&bytes, &mut is);
        assert_eq!(is[0], wanted & (u64::MAX >> (64 - samples.len())));
        aligned(&bytes)
    }

    #[test]
    fn samples_move_to_the_nearest_value_on_the_side_that_is_wanted() {
        assert_eq!(enforced(10.0, 20.0, &[5_u8, 10, 14, 16, 25], 0b10001), [10, 9, 9, 21, 20]);
        // No value exists below, or above, the range.
        assert_eq!(enforced(0.0, 20.0, &[3_u8, 30], 0b10), [21, 20]);
        assert_eq!(enforced(-5.0, f64::INFINITY, &[3_i16, -30], 0b10), [-6, -5]);
        let got = enforced(1.0, f64::INFINITY, &[f32::NAN, 0.5, 2.0, f32::INFINITY], 0b0011);
        assert_eq!(got, [1.0, 1.0, 1.0_f32.next_down(), 1.0_f32.next_down()]);
        assert!(enforced(f64::NEG_INFINITY, f64::INFINITY, &[1.0_f64, 2.0], 0b10)[0].is_nan());
    }

    #[test]
    fn samples_that_are_not_aligned_are_moved_too() {
        let selection = Selection { kind: SelectionKind::Iso, lo: 100.0, hi: f64::INFINITY };
        let test = range_test(ScalarType::F64, &selection, Rescale::IDENTITY).unwrap();
        let mut bytes = vec![0; 8 * 70 + 1];
        test.enforce(&mut bytes[1..], &[1, 1 << 5]);
        let values: Vec<f64> = aligned(&bytes[1..]);
        for (i, v) in values.iter().enumerate() {
            assert_eq!(*v, if i == 0 || i == 69 { 100.0 } else { 0.0 });
        }
    }
}
