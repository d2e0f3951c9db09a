//! Samples on their way from the file into the ring of slices: unchanged, or as depths inside the range.
//!
//! The type of the file's samples stays behind [`FileRange`], whose functions take whole rows: so solids and workers
//! are compiled once for each of the five types of the ring instead of once for each pair of a file's type and a ring's
//! (13), and a row costs one indirect call.

use std::ops::Range;

use super::classify::classify;
use super::item::push_swapped;
use super::range::{Ordered, SampleRange};
use super::slices::OddSamples;
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::format::Selection;
use crate::volume::{Rescale, Scalar, ScalarType};

/// Form of the samples in the ring, and their depth inside the range.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleForm {
    /// True if ring samples equal the file's, so that slices are read straight into the ring: with one lower bound, and
    /// a type whose values a single holds exactly. Otherwise the ring holds depths.
    pub(super) in_place: bool,
    /// Type of a ring sample; singles for depths.
    pub(super) scalar: ScalarType,
    /// Step beyond the border: one unit for integers, so that depth falls even from a sample at the bound.
    pub(super) unit: f32,
    /// Ends of the range in samples of the file.
    lo: f64,
    hi: f64,
    is_open_above: bool,
}

impl SampleForm {
    fn new<T: Ordered>(range: SampleRange<T>) -> Self {
        let is_open_above = range.is_open_above();
        let is_float = matches!(T::TYPE, ScalarType::F32 | ScalarType::F64);
        let in_place = is_open_above && (T::TYPE.bytes() <= 2 || T::TYPE == ScalarType::F32);
        Self {
            in_place,
            scalar: if in_place { T::TYPE } else { ScalarType::F32 },
            unit: if is_float { 0.0 } else { 1.0 },
            lo: range.lo.to_f64(),
            hi: range.hi.to_f64(),
            is_open_above,
        }
    }

    /// The form of samples that are only inside or outside, whatever their values: depths 0 and -1.
    const MASK: Self =
        Self { in_place: false, scalar: ScalarType::F32, unit: 1.0, lo: 0.0, hi: 0.0, is_open_above: false };

    /// True if a single value is inside, as in a map of labels.
    pub(super) fn is_label(&self) -> bool {
        self.lo == self.hi
    }

    /// Ring sample at depth 0.
    #[inline(always)]
    fn zero(&self) -> f64 {
        if self.in_place { self.lo } else { 0.0 }
    }

    /// Depth inside the range of a ring sample.
    #[inline(always)]
    pub(super) fn depth(&self, sample: impl Scalar) -> f32 {
        super::range::depth_of(sample.to_f64() - self.zero())
    }

    /// The ring sample at the surface, where the range begins at `bound` in samples of the file; `None` for a
    /// range with two ends. Among integers a surface lies between the last sample outside and the first inside.
    pub(super) fn level(&self, bound: Option<f64>) -> f32 {
        let unit = f64::from(self.unit);
        if self.in_place {
            return single(bound.map_or(self.lo, |bound| bound.clamp(self.lo - unit, self.lo)));
        }
        let level = match bound.filter(|_| !self.is_label()) {
            Some(bound) if self.is_open_above => bound - self.lo,
            Some(bound) => self.hi - bound,
            // Half way between neighbouring integers at either end.
            None => -0.5 * unit,
        };
        single(level.clamp(-unit, 0.0))
    }

    /// Depth of a ring sample relative to `level`.
    #[inline(always)]
    pub(super) fn depth_from(sample: impl Scalar, level: f32) -> f32 {
        single(sample.to_f64()) - level
    }

    /// [`SampleForm::zero`] as a single, which holds every sample of a ring that is kept as it is in the file.
    pub(super) fn zero_single(&self) -> f32 {
        single(self.zero())
    }

    /// True for a ring sample inside the range; never for NaN.
    #[inline(always)]
    pub(super) fn is_inside(&self, sample: impl Scalar) -> bool {
        sample.to_f64() >= self.zero()
    }
}

/// Nearest single of a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounded, and far from overflow where it matters")]
fn single(v: f64) -> f32 {
    v as f32
}

/// The inside range for samples whose type is known at run time only. Samples are aligned bytes.
pub(super) trait FileRange: Send + Sync {
    /// Form of the samples in the ring.
    fn form(&self) -> SampleForm;

    /// Inside bits of the samples `own` of a row; the words before and after hold their neighbours in the row.
    fn classify(&self, row: &[u8], own: Range<usize>, words: &mut [u64]);

    /// Searches for samples to report to the user.
    fn look(&self, samples: &[u8], odd: &mut OddSamples);

    /// Depths of a row inside the range.
    fn depths(&self, row: &[u8], to: &mut [f32]);

    /// Appends the swapped values of the samples with `chosen` bits, from `first` on, and widens `extent` by them.
    fn push_values(
        &self,
        samples: &[u8],
        first: usize,
        chosen: u32,
        values: &mut Vec<u8>,
        extent: &mut (f32, f32),
    );
}

/// The range of samples that lie in a selection, or `None` if no sample can.
pub(super) fn file_range(
    scalar: ScalarType,
    selection: &Selection,
    rescale: Rescale,
) -> Option<Box<dyn FileRange>> {
    by_type!(scalar, T => Some(Box::new(SampleRange::<T>::of_selection(selection, rescale)?)))
}

/// A range of a map of labels: the distance of a label's number from the range has no meaning.
pub(super) struct MaskRange(pub(super) Box<dyn FileRange>);

impl FileRange for MaskRange {
    fn form(&self) -> SampleForm {
        SampleForm::MASK
    }

    fn classify(&self, row: &[u8], own: Range<usize>, words: &mut [u64]) {
        self.0.classify(row, own, words);
    }

    fn look(&self, samples: &[u8], odd: &mut OddSamples) {
        self.0.look(samples, odd);
    }

    fn depths(&self, row: &[u8], to: &mut [f32]) {
        self.0.depths(row, to);
        to.iter_mut().for_each(|depth| *depth = if *depth >= 0.0 { 0.0 } else { -1.0 });
    }

    fn push_values(
        &self,
        samples: &[u8],
        first: usize,
        chosen: u32,
        values: &mut Vec<u8>,
        extent: &mut (f32, f32),
    ) {
        self.0.push_values(samples, first, chosen, values, extent);
    }
}

impl<T: Ordered> FileRange for SampleRange<T> {
    fn form(&self) -> SampleForm {
        SampleForm::new(*self)
    }

    fn classify(&self, row: &[u8], own: Range<usize>, words: &mut [u64]) {
        let samples: &[T] = bytemuck::cast_slice(row);
        let [before, words @ .., after] = words else { return };
        let (full, rest) = words.split_at_mut(own.len().div_ceil(64));
        classify(&samples[own.clone()], *self, full);
        rest.fill(0);
        *before = if own.start > 0 { u64::from(self.contains(samples[own.start - 1])) << 63 } else { 0 };
        *after = samples.get(own.end).map_or(0, |v| u64::from(self.contains(*v)));
    }

    fn look(&self, samples: &[u8], odd: &mut OddSamples) {
        odd.look::<T>(bytemuck::cast_slice(samples), *self);
    }

    fn depths(&self, row: &[u8], to: &mut [f32]) {
        dispatch(DepthKernel { range: *self, from: bytemuck::cast_slice(row), to });
    }

    fn push_values(
        &self,
        samples: &[u8],
        first: usize,
        chosen: u32,
        values: &mut Vec<u8>,
        extent: &mut (f32, f32),
    ) {
        let samples: &[T] = bytemuck::cast_slice(samples);
        let mut rest = chosen;
        while rest != 0 {
            push_swapped(samples[first + rest.trailing_zeros() as usize], values, extent);
            rest &= rest - 1;
        }
    }
}

struct DepthKernel<'a, T> {
    range: SampleRange<T>,
    from: &'a [T],
    to: &'a mut [f32],
}

impl<T: Ordered> Kernel for DepthKernel<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        for (to, from) in self.to.iter_mut().zip(self.from) {
            let (depth, value) = (self.range.depth(*from), from.to_f64());
            // Samples that are not finite stay that way.
            *to = if value.is_finite() { depth } else { depth * f32::INFINITY };
        }
    }
}
