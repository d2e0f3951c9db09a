//! In which form samples stand in the ring of slices: as they are, or as depths inside the range.

use super::lanes::RingSample;
use super::range::{Ordered, SampleRange};
use super::simd::{Isa, Kernel, dispatch};
use crate::volume::{Scalar, ScalarType};

/// The form in which samples of the file's type stand in the ring.
pub(super) trait RingForm: Sync + Copy {
    /// Type in the file.
    type File: Ordered;
    /// Type in the ring.
    type Ring: RingSample;
    /// Are they the same, so that slices are read straight into the ring?
    const IN_PLACE: bool;
    /// The range test.
    fn range(&self) -> SampleRange<Self::File>;
    /// File sample to ring sample (unused when in place).
    fn convert(&self, sample: Self::File) -> Self::Ring;
    /// Depth inside the range of a ring sample.
    fn depth(&self, sample: Self::Ring) -> f32;
}

/// Samples stay as they are: one lower bound, and a type whose values a single holds exactly.
#[derive(Clone, Copy)]
pub(super) struct Samples<T>(pub(super) SampleRange<T>);

impl<T: Ordered + RingSample> RingForm for Samples<T> {
    type File = T;
    type Ring = T;
    const IN_PLACE: bool = true;
    fn range(&self) -> SampleRange<T> {
        self.0
    }
    #[inline(always)]
    fn convert(&self, sample: T) -> T {
        sample
    }
    #[inline(always)]
    fn depth(&self, sample: T) -> f32 {
        self.0.depth(sample)
    }
}

/// The ring holds depths inside the range: wide types, two-sided ranges, falling scales.
#[derive(Clone, Copy)]
pub(super) struct Depths<T>(pub(super) SampleRange<T>);

impl<T: Ordered> RingForm for Depths<T> {
    type File = T;
    type Ring = f32;
    const IN_PLACE: bool = false;
    fn range(&self) -> SampleRange<T> {
        self.0
    }
    #[inline(always)]
    fn convert(&self, sample: T) -> f32 {
        self.0.depth(sample)
    }
    #[inline(always)]
    fn depth(&self, sample: f32) -> f32 {
        sample
    }
}

/// Converts a row of file samples.
pub(super) fn convert<F: RingForm>(form: &F, from: &[F::File], to: &mut [F::Ring]) {
    dispatch(ConvertKernel { form, from, to });
}

struct ConvertKernel<'a, F: RingForm> {
    form: &'a F,
    from: &'a [F::File],
    to: &'a mut [F::Ring],
}

impl<F: RingForm> Kernel for ConvertKernel<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Isa) {
        for (to, from) in self.to.iter_mut().zip(self.from) {
            *to = self.form.convert(*from);
        }
    }
}

/// Step beyond the border: one unit for integers, so that a sample just at the bound still falls.
pub(super) fn border_unit<F: RingForm>() -> f32 {
    if matches!(<F::File as Scalar>::TYPE, ScalarType::F32 | ScalarType::F64) { 0.0 } else { 1.0 }
}
