//! The chosen range in sample units, and the depth of samples inside it.

use crate::format::Selection;
use crate::volume::{Rescale, Scalar};

/// Inside means `lo <= sample <= hi`; NaN is never inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SampleRange<T> {
    /// Lowest inside sample.
    pub(super) lo: T,
    /// Highest inside sample.
    pub(super) hi: T,
}

impl<T: Scalar> SampleRange<T> {
    #[inline(always)]
    pub(super) fn contains(self, sample: T) -> bool {
        // Not `&&`: both tests always run, so that blocks of samples vectorise.
        (sample >= self.lo) & (sample <= self.hi)
    }
}

/// Samples as positions on an integer line, so that a bound can be found by bisection.
pub(super) trait Ordered: Scalar {
    /// NaN, for types that have it.
    const NO_NUMBER: Option<Self>;
    /// Lowest and highest position, NaN excluded.
    const ENDS: (i128, i128);
    /// Sample at a position.
    fn at(position: i128) -> Self;
}

macro_rules! ordered_integer {
    ($($t:ty),*) => {$(
        impl Ordered for $t {
            const NO_NUMBER: Option<Self> = None;
            const ENDS: (i128, i128) = (<$t>::MIN as i128, <$t>::MAX as i128);
            fn at(position: i128) -> Self {
                Self::try_from(position.clamp(Self::ENDS.0, Self::ENDS.1)).unwrap_or(0)
            }
        }
    )*};
}
ordered_integer!(u8, i8, u16, i16, u32, i32);

macro_rules! ordered_float {
    ($($t:ty, $bits:ty);*) => {$(
        impl Ordered for $t {
            const NO_NUMBER: Option<Self> = Some(<$t>::NAN);
            // Positions are sign and magnitude of the bit pattern: monotone from -inf to +inf.
            const ENDS: (i128, i128) =
                (-(<$t>::INFINITY.to_bits() as i128), <$t>::INFINITY.to_bits() as i128);
            fn at(position: i128) -> Self {
                let magnitude = <$bits>::try_from(position.unsigned_abs()).unwrap_or(0);
                let value = <$t>::from_bits(magnitude);
                if position < 0 { -value } else { value }
            }
        }
    )*};
}
ordered_float!(f32, u32; f64, u64);

impl<T: Ordered> SampleRange<T> {
    /// The samples whose physical value lies in the selection; `None` without any.
    ///
    /// `slope * sample + intercept` is monotone, so each end is found by bisection over the samples with the predicate
    /// that defines it: thresholds are not rounded.
    pub(super) fn of_selection(selection: &Selection, rescale: Rescale) -> Option<Self> {
        let physical = |position| {
            let sample = T::at(position).to_f64();
            // An infinite sample stays infinite at any intercept.
            rescale.apply(sample)
        };
        let rising = rescale.slope > 0.0;
        let above_lo = |p| if rising { physical(p) >= selection.lo } else { physical(p) <= selection.hi };
        let above_hi = |p| if rising { physical(p) > selection.hi } else { physical(p) < selection.lo };
        let lo = first_position::<T>(above_lo)?;
        let hi = first_position::<T>(above_hi).map_or(T::ENDS.1, |p| p - 1);
        (lo <= hi).then(|| Self { lo: T::at(lo), hi: T::at(hi) })
    }

    /// The nearest samples below and above the range; `None` at the ends of the type.
    pub(super) fn nearest_outside(self) -> (Option<T>, Option<T>) {
        let low = first_position::<T>(|p| T::at(p) >= self.lo);
        let high = first_position::<T>(|p| T::at(p) > self.hi);
        (low.filter(|p| *p > T::ENDS.0).map(|p| T::at(p - 1)), high.map(T::at))
    }

    /// True if the range extends to the type's largest sample.
    pub(super) fn is_open_above(self) -> bool {
        self.hi >= T::at(T::ENDS.1)
    }

    /// True if the range extends to the type's smallest sample.
    fn is_open_below(self) -> bool {
        self.lo <= T::at(T::ENDS.0)
    }

    /// Signed depth inside the range: positive inside, rising inwards, 0 for NaN; for a range with two
    /// ends the distance to the nearer one. Clamped so that sums over a neighbourhood stay finite.
    #[inline(always)]
    pub(super) fn depth(self, sample: T) -> f32 {
        let v = sample.to_f64();
        let (from_lo, from_hi) = (v - self.lo.to_f64(), self.hi.to_f64() - v);
        let depth = match (self.is_open_below(), self.is_open_above()) {
            (_, true) => from_lo,
            (true, false) => from_hi,
            (false, false) => from_lo.min(from_hi),
        };
        depth_of(depth)
    }
}

/// A distance as a depth: 0 for NaN, clamped to [`DEPTH_LIMIT`] in magnitude.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "clamped to the range of f32")]
pub(super) fn depth_of(distance: f64) -> f32 {
    if distance.is_nan() { 0.0 } else { distance.clamp(-DEPTH_LIMIT, DEPTH_LIMIT) as f32 }
}

/// Largest magnitude of [`SampleRange::depth`]: 125 weighted terms of it and their squares, after
/// scaling by the largest, stay far from overflow.
const DEPTH_LIMIT: f64 = 1e30;

/// Highest sample below `bound`, or the lowest of all samples if `bound` is not above it.
pub(super) fn highest_below<T: Ordered>(bound: f64) -> f64 {
    let first = first_position::<T>(|p| T::at(p).to_f64() >= bound);
    T::at(first.map_or(T::ENDS.1, |p| (p - 1).max(T::ENDS.0))).to_f64()
}

/// First position where a monotone predicate (false ... false true ... true) holds.
fn first_position<T: Ordered>(holds: impl Fn(i128) -> bool) -> Option<i128> {
    let (mut low, mut high) = T::ENDS;
    if !holds(high) {
        return None;
    }
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    Some(low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::SelectionKind;

    fn select(lo: f64, hi: f64) -> Selection {
        Selection { kind: SelectionKind::Range, lo, hi }
    }

    #[test]
    fn thresholds_are_exactly_those_of_the_definition() {
        let hu = Rescale { slope: 1.0, intercept: -1024.0 };
        for (lo, want) in [(500.0, 1524), (-1024.0, 0), (499.5, 1524), (500.000_001, 1525)] {
            let r = SampleRange::<u16>::of_selection(&select(lo, f64::INFINITY), hu).unwrap();
            assert_eq!((r.lo, r.hi), (want, u16::MAX), "{lo}");
        }
        assert_eq!(SampleRange::<u8>::of_selection(&select(256.0, 1e9), Rescale::IDENTITY), None);
        let falling = Rescale { slope: -2.0, intercept: 10.0 };
        let r = SampleRange::<i8>::of_selection(&select(0.0, 6.0), falling).unwrap();
        assert_eq!((r.lo, r.hi), (2, 5));
        let r = SampleRange::<f32>::of_selection(&select(0.1, f64::INFINITY), Rescale::IDENTITY).unwrap();
        assert!(f64::from(r.lo) >= 0.1 && f64::from(r.lo.next_down()) < 0.1);
        assert!(r.is_open_above() && r.contains(f32::INFINITY) && !r.contains(f32::NAN));
    }

    #[test]
    fn the_sample_below_a_bound_is_the_next_one_down() {
        assert_eq!(highest_below::<u8>(3.0), 2.0);
        assert_eq!(highest_below::<i16>(-2.5), -3.0);
        assert_eq!(highest_below::<u8>(0.0), 0.0);
        assert_eq!(highest_below::<u8>(1e9), 255.0);
        assert_eq!(highest_below::<f32>(1.0), f64::from(1.0_f32.next_down()));
        assert_eq!(highest_below::<f64>(0.0), -f64::from_bits(1));
    }

    #[test]
    fn depth_is_signed_finite_and_never_nan() {
        let iso = SampleRange { lo: 5.0_f64, hi: f64::INFINITY };
        assert_eq!(iso.depth(7.0), 2.0);
        assert_eq!(iso.depth(f64::NAN), 0.0);
        assert_eq!(iso.depth(f64::INFINITY), 1e30);
        assert_eq!(iso.depth(f64::NEG_INFINITY), -1e30);
        let band = SampleRange { lo: 10_i16, hi: 20 };
        assert_eq!((band.depth(12), band.depth(19), band.depth(25), band.depth(5)), (2.0, 1.0, -5.0, -5.0));
    }
}
