//! Eight lanes of sums: the arithmetic of the gradient kernel, portable and with AVX2.
//!
//! Both forms do the same operations in the same order: integers are exact, singles are rounded after
//! every operation (nothing is fused), so they agree bit by bit.
#![allow(unsafe_code)]

use crate::cpu::Avx2;
use bytemuck::Zeroable as _;

pub(super) const LANES: usize = 8;

/// What sums are made of: one, or eight side by side.
pub(super) trait Term: Copy {
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn times(self, tap: i8) -> Self;
}

impl Term for f32 {
    fn plus(self, other: Self) -> Self {
        self + other
    }
    fn minus(self, other: Self) -> Self {
        self - other
    }
    fn times(self, tap: i8) -> Self {
        self * Self::from(tap)
    }
}

/// Eight sums side by side.
pub(super) trait Lanes: Term {
    /// One sum, as it is kept between the passes.
    type Sum: bytemuck::Pod;
    /// The proof needed to make lanes: nothing, or that the machine has the instructions.
    type Proof: Copy;
    fn zero(proof: Self::Proof) -> Self;
    fn load(proof: Self::Proof, sums: &[Self::Sum; LANES]) -> Self;
    fn store(self) -> [Self::Sum; LANES];
    fn to_f32(self) -> [f32; LANES];
}

/// Eight sums from `from` on, then from the next one on, `K` times.
#[inline(always)]
pub(super) fn shifted<L: Lanes, const K: usize>(proof: L::Proof, sums: &[L::Sum], from: usize) -> [L; K] {
    let mut terms = [L::zero(proof); K];
    for (i, term) in terms.iter_mut().enumerate() {
        let mut lanes = [L::Sum::zeroed(); LANES];
        lanes.copy_from_slice(&sums[from + i..from + i + LANES]);
        *term = L::load(proof, &lanes);
    }
    terms
}

/// A sample as it stands in the ring of slices.
pub(super) trait RingSample: bytemuck::Pod + PartialEq {
    /// Lanes for any machine.
    type Portable: Lanes<Proof = ()>;
    /// Lanes for a machine with AVX2, with the same sums.
    type Fast: Lanes<Proof = FastProof>;
    /// Widens eight samples; exact.
    fn widen(samples: &[Self; LANES]) -> Self::Portable;
    /// The same with AVX2.
    fn widen_fast(avx2: Avx2, samples: &[Self; LANES]) -> Self::Fast;
}

impl Term for [i32; LANES] {
    fn plus(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_add(other[i]))
    }
    fn minus(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].wrapping_sub(other[i]))
    }
    fn times(self, tap: i8) -> Self {
        self.map(|v| v.wrapping_mul(i32::from(tap)))
    }
}

impl Lanes for [i32; LANES] {
    type Sum = i32;
    type Proof = ();
    fn zero((): ()) -> Self {
        [0; LANES]
    }
    fn load((): (), sums: &[i32; LANES]) -> Self {
        *sums
    }
    fn store(self) -> [i32; LANES] {
        self
    }
    #[expect(clippy::cast_precision_loss, reason = "one rounding, the only one")]
    fn to_f32(self) -> [f32; LANES] {
        self.map(|v| v as f32)
    }
}

impl Term for [f32; LANES] {
    fn plus(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] + other[i])
    }
    fn minus(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] - other[i])
    }
    fn times(self, tap: i8) -> Self {
        self.map(|v| v * f32::from(tap))
    }
}

impl Lanes for [f32; LANES] {
    type Sum = f32;
    type Proof = ();
    fn zero((): ()) -> Self {
        [0.0; LANES]
    }
    fn load((): (), sums: &[f32; LANES]) -> Self {
        *sums
    }
    fn store(self) -> [f32; LANES] {
        self
    }
    fn to_f32(self) -> [f32; LANES] {
        self
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) type FastProof = Avx2;
#[cfg(not(target_arch = "x86_64"))]
pub(super) type FastProof = ();

#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn fast_proof(avx2: Avx2) -> FastProof {
    avx2
}
#[cfg(not(target_arch = "x86_64"))]
pub(super) fn fast_proof(_: Avx2) -> FastProof {}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::{FastF32, FastI32};
#[cfg(not(target_arch = "x86_64"))]
pub(super) type FastI32 = [i32; LANES];
#[cfg(not(target_arch = "x86_64"))]
pub(super) type FastF32 = [f32; LANES];

#[cfg(target_arch = "x86_64")]
mod avx2 {
    // SAFETY (every block here): a value of these types is made only with the proof that this machine has
    // AVX2, in this module or by `widen_fast`; no memory is accessed.
    use crate::builder::lanes::{LANES, Lanes, Term};
    use crate::cpu::Avx2;
    use bytemuck::cast;
    use std::arch::x86_64::*;

    /// Eight lanes of a type, the instructions of their operations, and their conversion.
    macro_rules! fast_lanes {
        ($name:ident($vector:ty) of $lane:ty, $plus:ident, $minus:ident, $times:ident, $every:ident, $to_f32:ident) => {
            #[derive(Clone, Copy)]
            pub(in crate::builder) struct $name(pub(super) $vector);

            impl Term for $name {
                #[inline(always)]
                fn plus(self, other: Self) -> Self {
                    // SAFETY: see the top of this module.
                    Self(unsafe { $plus(self.0, other.0) })
                }
                #[inline(always)]
                fn minus(self, other: Self) -> Self {
                    // SAFETY: see the top of this module.
                    Self(unsafe { $minus(self.0, other.0) })
                }
                #[inline(always)]
                fn times(self, tap: i8) -> Self {
                    // SAFETY: see the top of this module.
                    Self(unsafe { $times(self.0, $every(<$lane>::from(tap))) })
                }
            }

            impl Lanes for $name {
                type Sum = $lane;
                type Proof = Avx2;
                #[inline(always)]
                fn zero(_: Avx2) -> Self {
                    Self(cast([<$lane>::default(); LANES]))
                }
                #[inline(always)]
                fn load(_: Avx2, sums: &[$lane; LANES]) -> Self {
                    Self(cast(*sums))
                }
                #[inline(always)]
                fn store(self) -> [$lane; LANES] {
                    cast(self.0)
                }
                #[inline(always)]
                fn to_f32(self) -> [f32; LANES] {
                    // SAFETY: see the top of this module.
                    cast(unsafe { $to_f32(self.0) })
                }
            }
        };
    }
    fast_lanes!(
        FastI32(__m256i) of i32, _mm256_add_epi32, _mm256_sub_epi32, _mm256_mullo_epi32, _mm256_set1_epi32,
        _mm256_cvtepi32_ps
    );
    fast_lanes!(
        FastF32(__m256) of f32, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_set1_ps, _mm256_castps_si256
    );
}

/// Widening with one instruction where there is one.
macro_rules! integer_sample {
    ($($t:ty => $convert:ident),*) => {$(
        impl RingSample for $t {
            type Portable = [i32; LANES];
            type Fast = FastI32;
            #[inline(always)]
            fn widen(samples: &[Self; LANES]) -> [i32; LANES] {
                samples.map(i32::from)
            }
            #[inline(always)]
            fn widen_fast(_: Avx2, samples: &[Self; LANES]) -> FastI32 {
                #[cfg(target_arch = "x86_64")]
                {
                    let mut low = [<$t>::MIN; 16 / size_of::<$t>()];
                    low[..LANES].copy_from_slice(samples);
                    // SAFETY: the first argument proves that this machine has AVX2; no memory is accessed.
                    FastI32(unsafe { std::arch::x86_64::$convert(bytemuck::cast(low)) })
                }
                #[cfg(not(target_arch = "x86_64"))]
                Self::widen(samples)
            }
        }
    )*};
}
integer_sample!(
    u8 => _mm256_cvtepu8_epi32,
    i8 => _mm256_cvtepi8_epi32,
    u16 => _mm256_cvtepu16_epi32,
    i16 => _mm256_cvtepi16_epi32
);

impl RingSample for f32 {
    type Portable = [f32; LANES];
    type Fast = FastF32;
    #[inline(always)]
    fn widen(samples: &[Self; LANES]) -> [f32; LANES] {
        *samples
    }
    #[inline(always)]
    fn widen_fast(avx2: Avx2, samples: &[Self; LANES]) -> FastF32 {
        FastF32::load(fast_proof(avx2), samples)
    }
}
