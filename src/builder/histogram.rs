//! Value statistics in streamed passes: extremes, and Otsu's threshold from an exact histogram.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::BuildError;
use super::parallel::{Blocks, run_workers};
use super::range::Ordered;
use crate::budget::costs::{MAPPED_FROM, MIN_WORKER};
use crate::progress::Progress;
use crate::volume::{ScalarType, VolumeSource};

/// Bins of a histogram: one for every value of the 16-bit types.
pub(super) const BINS: usize = 1 << 16;
/// Bytes that a worker reads at a time, and that its counts take.
const READ_BYTES: usize = 256 << 10;
/// Bytes that a worker reads at a time when it looks for extremes. Below the size from which the C library's
/// allocator maps a buffer of its own: freeing a mapped one raises that size, and the larger buffers of the
/// counting pass would then stay resident after it, at the expense of the scan.
const EXTREMES_READ_BYTES: usize = 64 << 10;
const _: () = assert!(EXTREMES_READ_BYTES < MAPPED_FROM);
/// Memory of one worker, and of the shared sum.
pub(super) const WORKER_BYTES: u64 = (READ_BYTES + 4 * BINS) as u64;
pub(super) const SHARED_BYTES: u64 = 8 * BINS as u64;
// The smallest plan is enough for a threshold that is still to be found, too.
const _: () = assert!(SHARED_BYTES + WORKER_BYTES <= MIN_WORKER);

/// Smallest and largest sample that is a finite number, or `None` if there is none.
pub(super) fn extremes<T: Ordered>(
    source: &dyn VolumeSource,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<(f64, f64)>, BuildError> {
    let total = Mutex::new((f64::INFINITY, f64::NEG_INFINITY));
    for_each_part::<T, _>(
        source,
        (threads, EXTREMES_READ_BYTES),
        progress,
        &|| (f64::INFINITY, f64::NEG_INFINITY),
        &|seen, samples| {
            for sample in samples {
                let v = sample.to_f64();
                if v.is_finite() {
                    *seen = (seen.0.min(v), seen.1.max(v));
                }
            }
        },
        &|seen| {
            let mut t = total.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *t = (t.0.min(seen.0), t.1.max(seen.1));
        },
    )?;
    let (min, max) = total.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    Ok((min <= max).then_some((min, max)))
}

/// Otsu's threshold in sample units: the sample value `t` that maximises the variance between the
/// classes `< t` and `>= t`; `None` when all values are alike (or none is a number).
///
/// Types of 8 and 16 bits are counted exactly in one pass; wider ones need their extremes first, and
/// then 65,536 bins between them. Source: Otsu 1979, *A threshold selection method from gray-level
/// histograms*.
pub(super) fn otsu<T: Ordered>(
    source: &dyn VolumeSource,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<f64>, BuildError> {
    let exact = |low: f64| (low, 1.0);
    let (low, width) = match T::TYPE {
        ScalarType::U8 | ScalarType::U16 => exact(0.0),
        ScalarType::I8 => exact(-128.0),
        ScalarType::I16 => exact(-32768.0),
        _ => match extremes::<T>(source, threads, progress)? {
            Some((min, max)) if max > min => {
                let width = max / (BINS - 1) as f64 - min / (BINS - 1) as f64;
                if !width.is_normal() {
                    // Values so close that no bin can tell them apart: the largest is the upper class.
                    return Ok(Some(max));
                }
                (min, width)
            }
            _ => return Ok(None),
        },
    };
    let counts: Vec<AtomicU64> = (0..BINS).map(|_| AtomicU64::new(0)).collect();
    let spill = |local: &mut Vec<u32>| {
        for (sum, n) in counts.iter().zip(local.iter_mut()).filter(|(_, n)| **n > 0) {
            sum.fetch_add(u64::from(std::mem::take(n)), Ordering::Relaxed);
        }
    };
    for_each_part::<T, _>(
        source,
        (threads, READ_BYTES),
        progress,
        &|| (vec![0_u32; BINS], 0_u64),
        &|(local, seen), samples| {
            *seen += samples.len() as u64;
            if *seen > u64::from(u32::MAX) {
                spill(local);
                *seen = samples.len() as u64;
            }
            for sample in samples {
                let v = sample.to_f64();
                if v.is_finite() {
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "clamped below"
                    )]
                    let bin = (v / width - low / width) as usize;
                    local[bin.min(BINS - 1)] += 1;
                }
            }
        },
        &|(mut local, _)| spill(&mut local),
    )?;
    let counts: Vec<u64> = counts.into_iter().map(AtomicU64::into_inner).collect();
    Ok(best_split(&counts).map(|bin| low + bin as f64 * width))
}

/// First bin of the upper class; the middle of the gap where several splits are equally good.
fn best_split(counts: &[u64]) -> Option<usize> {
    let total: f64 = counts.iter().map(|c| *c as f64).sum();
    let moment: f64 = counts.iter().enumerate().map(|(i, c)| i as f64 * *c as f64).sum();
    let (mut below, mut below_moment) = (0.0, 0.0);
    let (mut best, mut first, mut last) = (0.0, 0, 0);
    for (bin, count) in counts.iter().enumerate() {
        // Here `below` counts the bins before `bin`.
        let above = total - below;
        if below > 0.0 && above > 0.0 {
            let gap = below_moment / below - (moment - below_moment) / above;
            let between = below * above * gap * gap;
            if between > best {
                (best, first, last) = (between, bin, bin);
            } else if between == best && last + 1 == bin {
                last = bin;
            }
        }
        below += *count as f64;
        below_moment += bin as f64 * *count as f64;
    }
    (best > 0.0).then(|| first + (last - first).div_ceil(2))
}

/// Feeds every sample of the volume to workers, some rows at a time; each worker's state is joined last.
fn for_each_part<T: Ordered, L>(
    source: &dyn VolumeSource,
    (threads, read_bytes): (usize, usize),
    progress: &dyn Progress,
    start: &(dyn Fn() -> L + Sync),
    work: &(dyn Fn(&mut L, &[T]) + Sync),
    join: &(dyn Fn(L) + Sync),
) -> Result<(), BuildError> {
    let blocks = Blocks::new(source.info().dims, read_bytes / size_of::<T>());
    run_workers(threads, progress, &|stop| {
        let mut local = start();
        let mut buffer = vec![T::zeroed(); blocks.size().iter().product()];
        while !stop() {
            let Some((columns, lines, z)) = blocks.next() else { break };
            let part = &mut buffer[..columns.len() * lines.len()];
            source.read_rows(z, lines, columns, bytemuck::cast_slice_mut(part))?;
            work(&mut local, part);
        }
        join(local);
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_split_separates_two_peaks_in_the_middle_of_their_gap() {
        let mut counts = vec![0; 1000];
        counts[100] = 50;
        counts[101] = 60;
        counts[900] = 10;
        assert_eq!(best_split(&counts), Some(501));
        assert_eq!(best_split(&[0, 5, 0]), None);
        assert_eq!(best_split(&[3, 5]), Some(1));
        assert_eq!(best_split(&[]), None);
    }
}
