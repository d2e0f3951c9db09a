//! Samples of the ring of slices as lanes of sums: the arithmetic of the gradient kernels.
//!
//! Integers are summed as 32-bit integers, exactly; singles are rounded after every operation, in one order. So every
//! form gives the same bits.
#![allow(unsafe_code)]

use crate::cpu::{Lanes, Narrow, OCTET, Octet};
use bytemuck::Zeroable as _;

/// A sample as it stands in the ring of slices.
pub(super) trait RingSample: bytemuck::Pod + PartialEq {
    /// One sum, as stored between the passes.
    type Number: bytemuck::Pod;
    /// Eight sums.
    type Sums<L: Lanes>: Octet<Number = Self::Number>;
    /// Eight sums from memory.
    fn load<L: Lanes>(lanes: L, sums: &[Self::Number; OCTET]) -> Self::Sums<L>;
    /// Widens eight samples; exact.
    fn widen<L: Lanes>(lanes: L, samples: &[Self; OCTET]) -> Self::Sums<L>;
}

macro_rules! integer_samples {
    ($($t:ty)*) => {$(
        impl RingSample for $t {
            type Number = i32;
            type Sums<L: Lanes> = L::N;
            #[inline(always)]
            fn load<L: Lanes>(lanes: L, sums: &[i32; OCTET]) -> L::N {
                lanes.n_load(sums)
            }
            #[inline(always)]
            fn widen<L: Lanes>(lanes: L, samples: &[Self; OCTET]) -> L::N {
                lanes.n_load(&match lanes.avx2() {
                    Some(avx2) => Narrow::widen(avx2, samples),
                    None => samples.map(i32::from),
                })
            }
        }
    )*};
}
integer_samples!(u8 i8 u16 i16);

impl RingSample for f32 {
    type Number = Self;
    type Sums<L: Lanes> = L::S;
    #[inline(always)]
    fn load<L: Lanes>(lanes: L, sums: &[Self; OCTET]) -> L::S {
        lanes.s_load(sums)
    }
    #[inline(always)]
    fn widen<L: Lanes>(lanes: L, samples: &[Self; OCTET]) -> L::S {
        lanes.s_load(samples)
    }
}

/// Eight sums from `from` on, then from the next one on, `K` times.
#[inline(always)]
pub(super) fn shifted<R: RingSample, L: Lanes, const K: usize>(
    lanes: L,
    sums: &[R::Number],
    from: usize,
) -> [R::Sums<L>; K] {
    let mut terms = [zero::<R, L>(lanes); K];
    for (i, term) in terms.iter_mut().enumerate() {
        let mut eight = [R::Number::zeroed(); OCTET];
        eight.copy_from_slice(&sums[from + i..from + i + OCTET]);
        *term = R::load(lanes, &eight);
    }
    terms
}

/// Eight zeros.
#[inline(always)]
pub(super) fn zero<R: RingSample, L: Lanes>(lanes: L) -> R::Sums<L> {
    R::load(lanes, &[R::Number::zeroed(); OCTET])
}

/// `K` rows of a plane, at least two, from `start` on and `stride` apart, `N` samples each, with one check for all rows.
///
/// # Panics
/// If the last row does not end within the plane.
#[inline(always)]
pub(super) fn rows_of<R: bytemuck::Pod, const N: usize, const K: usize>(
    plane: &[R],
    start: usize,
    stride: usize,
) -> [[R; N]; K] {
    let most = plane.len().wrapping_sub(N);
    assert!(
        plane.len() >= N && start <= most && stride <= (most - start) / (K - 1),
        "a window leaves its plane"
    );
    let mut rows = [[R::zeroed(); N]; K];
    for (row, samples) in rows.iter_mut().enumerate() {
        // SAFETY: row < K, so start + row * stride + N <= start + (K - 1) * stride + N <= plane.len() by the
        // check above, and any bytes are a value of a Pod type.
        *samples = unsafe { plane.as_ptr().add(start + row * stride).cast::<[R; N]>().read_unaligned() };
    }
    rows
}
