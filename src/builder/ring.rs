//! In which form samples stand in the ring of slices: as they are, or as depths inside the range.

use super::lanes::RingSample;
use super::range::{Ordered, SampleRange};
use crate::cpu::{Kernel, Lanes, dispatch};
use crate::volume::{Scalar, ScalarType};

/// The form in which samples of the file's type stand in the ring.
pub(super) trait RingForm: Sync + Copy {
    type File: Ordered;
    type Ring: RingSample;
    /// Are they the same, so that slices are read straight into the ring?
    const IN_PLACE: bool;
    fn range(&self) -> SampleRange<Self::File>;
    /// File sample to ring sample (unused when in place).
    fn convert(&self, sample: Self::File) -> Self::Ring;
    /// Depth inside the range of a ring sample.
    fn depth(&self, sample: Self::Ring) -> f32;
    /// The ring sample at the surface, where the range begins at `bound` in samples of the file; `None` for a
    /// range with two ends. Among integers a surface lies between the last sample outside and the first inside.
    fn level(&self, bound: Option<f64>) -> f32;
    /// Depth of a ring sample below that level.
    fn depth_from(&self, sample: Self::Ring, level: f32) -> f32;
    /// Is a ring sample inside? (Of depths: not outside; what is not a number has none.)
    fn is_inside(&self, sample: Self::Ring) -> bool;
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
    fn level(&self, bound: Option<f64>) -> f32 {
        let lo = self.0.lo.to_f64();
        single(bound.map_or(lo, |bound| bound.clamp(lo - f64::from(border_unit::<Self>()), lo)))
    }
    #[inline(always)]
    fn depth_from(&self, sample: T, level: f32) -> f32 {
        single(sample.to_f64()) - level
    }
    #[inline(always)]
    fn is_inside(&self, sample: T) -> bool {
        self.0.contains(sample)
    }
}

/// Nearest single of a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounded, and far from overflow where it matters")]
fn single(v: f64) -> f32 {
    v as f32
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
    fn level(&self, bound: Option<f64>) -> f32 {
        let unit = f64::from(border_unit::<Self>());
        let SampleRange { lo, hi } = self.0;
        let level = match bound {
            Some(bound) if self.0.is_open_above() => bound - lo.to_f64(),
            Some(bound) => hi.to_f64() - bound,
            // Half way between neighbouring integers at either end.
            None => -0.5 * unit,
        };
        single(level.clamp(-unit, 0.0))
    }
    #[inline(always)]
    fn depth_from(&self, sample: f32, level: f32) -> f32 {
        sample - level
    }
    #[inline(always)]
    fn is_inside(&self, sample: f32) -> bool {
        sample >= 0.0
    }
}

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
    fn run(self, _: impl Lanes) {
        for (to, from) in self.to.iter_mut().zip(self.from) {
            *to = self.form.convert(*from);
        }
    }
}

/// Step beyond the border: one unit for integers, so that a sample just at the bound still falls.
pub(super) fn border_unit<F: RingForm>() -> f32 {
    if matches!(<F::File as Scalar>::TYPE, ScalarType::F32 | ScalarType::F64) { 0.0 } else { 1.0 }
}
