//! x86-64 machines: AVX2 with vectors of two registers, AVX-512 VBMI2 with one.
//!
//! SAFETY (every block here): a value of [`Avx2`] or [`Vbmi2`] is made only after its features were detected on this
//! machine, and every other type here is made from such a value. Loads and stores go through references to whole
//! arrays; no other memory is accessed.
#![allow(unsafe_code)]

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use bytemuck::cast;

use super::lanes::WHOLE;
use super::{DOUBLES, Kernel, Lanes, OCTET, Octet, SINGLES, Term, Truths};

/// Proof of AVX2, bit manipulation and population count.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(());

/// Proof of [`Avx2`]'s instructions and of AVX-512 F, DQ, BW, VL, VBMI and VBMI2.
#[derive(Clone, Copy)]
pub(crate) struct Vbmi2(());

/// Detection of features, and kernels compiled with them.
macro_rules! form {
    ($proof:ident, $with:ident, $enabled:literal, $($feature:tt)*) => {
        impl $proof {
            /// The proof, if this machine has the instructions.
            #[inline]
            pub(crate) fn detect() -> Option<Self> {
                ($(is_x86_feature_detected!($feature))&&*).then_some(Self(()))
            }

            /// Runs a kernel compiled with these instructions.
            #[inline]
            pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
                // SAFETY: `self` proves every feature that is enabled.
                unsafe { $with(self, kernel) }
            }
        }

        /// # Safety
        /// The machine must have the features named.
        #[target_feature(enable = $enabled)]
        unsafe fn $with<K: Kernel>(proof: $proof, kernel: K) -> K::Output {
            kernel.run(proof)
        }
    };
}
form!(
    Avx2, with_avx2, "avx2,bmi1,bmi2,lzcnt,popcnt",
    "avx2" "bmi1" "bmi2" "lzcnt" "popcnt"
);
form!(
    Vbmi2, with_vbmi2, "avx512f,avx512dq,avx512bw,avx512vl,avx512vbmi,avx512vbmi2,avx2,bmi1,bmi2,lzcnt,popcnt",
    "avx512f" "avx512dq" "avx512bw" "avx512vl" "avx512vbmi" "avx512vbmi2" "avx2" "bmi1" "bmi2" "lzcnt" "popcnt"
);

/// Bit 7 of 32 bytes, byte i giving bit i: the one instruction that portable code does not compile to.
#[inline(always)]
pub(crate) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    // SAFETY: see the top of this file.
    unsafe { _mm256_movemask_epi8(cast(bytes)).cast_unsigned() }
}

/// The low bits, in order, at the places that a mask names.
#[inline(always)]
pub(crate) fn deposit(_: Avx2, bits: u64, mask: u64) -> u64 {
    // SAFETY: see the top of this file.
    unsafe { _pdep_u64(bits, mask) }
}

/// Hints that a place will be read soon.
#[inline(always)]
pub(crate) fn prefetch<T: ?Sized>(place: &T) {
    // SAFETY: every x86-64 machine has SSE; nothing is read, and any address is allowed.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(place).cast()) }
}

/// Integers of 8 or 16 bits.
pub(crate) trait Narrow: bytemuck::Pod + Into<i32> {
    /// Eight as 32-bit integers: one instruction.
    fn widen(avx2: Avx2, narrow: &[Self; OCTET]) -> [i32; OCTET];
}

macro_rules! narrow {
    ($($t:ty => $convert:ident),*) => {$(
        impl Narrow for $t {
            #[inline(always)]
            fn widen(_: Avx2, narrow: &[Self; OCTET]) -> [i32; OCTET] {
                let mut low = [<$t>::MIN; 16 / size_of::<$t>()];
                low[..OCTET].copy_from_slice(narrow);
                // SAFETY: see the top of this file.
                cast(unsafe { $convert(cast(low)) })
            }
        }
    )*};
}
narrow!(
    u8 => _mm256_cvtepu8_epi32, i8 => _mm256_cvtepi8_epi32, u16 => _mm256_cvtepu16_epi32, i16 => _mm256_cvtepi16_epi32
);

/// Bits moved from place i to place `i ^ flip`: bytes by one shuffle, bits within them by two of nibbles.
#[inline(always)]
pub(crate) fn mirror_bits(_: Avx2, bits: u64, flip: u32) -> u64 {
    let flip = flip as usize;
    let (bytes, [of_low, of_high]) = (&FLIP_BYTES[flip >> 3 & 7], &FLIP_NIBBLES[flip & 7]);
    // SAFETY: see the top of this file.
    unsafe {
        let bits = _mm_shuffle_epi8(_mm_cvtsi64_si128(bits.cast_signed()), cast(*bytes));
        let nibble = _mm_set1_epi8(15);
        let low = _mm_shuffle_epi8(cast(*of_low), _mm_and_si128(bits, nibble));
        let high = _mm_shuffle_epi8(cast(*of_high), _mm_and_si128(_mm_srli_epi64::<4>(bits), nibble));
        _mm_cvtsi128_si64(_mm_or_si128(low, high)).cast_unsigned()
    }
}

/// Source of each byte, for each exclusive-or of a byte's place in eight.
const FLIP_BYTES: [[u8; 16]; 8] = {
    let mut from = [[0; 16]; 8];
    let mut at = 0;
    while at < 128 {
        #[expect(clippy::cast_possible_truncation, reason = "below 128")]
        let place = at as u8;
        from[at / 16][at % 16] = (place % 8) ^ (place / 16);
        at += 1;
    }
    from
};

/// Bytes of each low and each high nibble, for each exclusive-or of a bit's place in eight.
const FLIP_NIBBLES: [[[u8; 16]; 2]; 8] = {
    let mut to = [[[0; 16]; 2]; 8];
    let mut at = 0;
    while at < 8 * 2 * 16 * 4 {
        let (flip, high, nibble, bit) = (at / 128, at / 64 % 2, at / 4 % 16, at % 4);
        if nibble >> bit & 1 == 1 {
            to[flip][high][nibble] |= 1 << ((bit + 4 * high) ^ flip);
        }
        at += 1;
    }
    to
};

/// The vectors of eight 32-bit numbers, the same in both forms, and the calls of kernels.
macro_rules! octets_and_calls {
    () => {
        type S = S1;
        type N = N1;

        #[inline(always)]
        fn s_load(self, x: &[f32; OCTET]) -> S1 {
            S1(cast(*x))
        }
        #[inline(always)]
        fn n_load(self, x: &[i32; OCTET]) -> N1 {
            N1(cast(*x))
        }
        #[inline(always)]
        fn avx2(self) -> Option<Avx2> {
            Some(Avx2(()))
        }
        #[inline(always)]
        fn call<K: Kernel>(self, kernel: K) -> K::Output {
            self.run(kernel)
        }
    };
}

/// An expression of each of two registers. Not a closure: intrinsics in closures are inlined too late, if at
/// all.
macro_rules! both {
    ($x:ident in $of:expr => $e:expr) => {{
        let [$x, second] = $of.0;
        let first = $e;
        let $x = second;
        [first, $e]
    }};
}

/// Methods of one expression of intrinsics, inlined into every kernel.
macro_rules! inlined {
    ($(fn $name:ident($self:ident $(, $argument:ident: $t:ty)*) -> $out:ty { $body:expr })*) => {$(
        #[inline(always)]
        #[allow(clippy::macro_metavars_in_unsafe, reason = "the expressions stand in this file only")]
        fn $name($self $(, $argument: $t)*) -> $out {
            // SAFETY: see the top of this file; loads and stores are of whole arrays.
            unsafe { $body }
        }
    )*};
}

/// Operators of a vector type by the intrinsics of its registers.
macro_rules! operators {
    ($t:ident, $registers:tt, $($trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $trait for $t {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: see the top of this file.
                unsafe { operators!($registers $intrinsic self other) }
            }
        }
    )*};
    (two $intrinsic:ident $a:ident $b:ident) => {
        Self([$intrinsic($a.0[0], $b.0[0]), $intrinsic($a.0[1], $b.0[1])])
    };
    (one $intrinsic:ident $a:ident $b:ident) => {
        Self($intrinsic($a.0, $b.0))
    };
}

/// Low 64 bits of a * b for b in 0..2^32, in four lanes.
///
/// # Safety
/// The machine must have AVX2.
#[inline(always)]
unsafe fn times_u32(a: __m256i, b: __m256i) -> __m256i {
    // SAFETY: the caller guarantees AVX2.
    unsafe {
        let high = _mm256_slli_epi64::<32>(_mm256_mul_epu32(_mm256_srli_epi64::<32>(a), b));
        _mm256_add_epi64(_mm256_mul_epu32(a, b), high)
    }
}

/// Low 64 bits of a * b for b in 0..2^32, in eight lanes.
///
/// # Safety
/// The machine must have AVX-512 F.
#[inline(always)]
unsafe fn times_u32_wide(a: __m512i, b: __m512i) -> __m512i {
    // SAFETY: the caller guarantees AVX-512 F.
    unsafe {
        let high = _mm512_slli_epi64::<32>(_mm512_mul_epu32(_mm512_srli_epi64::<32>(a), b));
        _mm512_add_epi64(_mm512_mul_epu32(a, b), high)
    }
}

/// Eight singles.
#[derive(Clone, Copy)]
pub(crate) struct S1(__m256);
/// Eight 32-bit integers.
#[derive(Clone, Copy)]
pub(crate) struct N1(__m256i);

operators!(S1, one, Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps);
operators!(N1, one, Add add _mm256_add_epi32, Sub sub _mm256_sub_epi32, Mul mul _mm256_mullo_epi32);

/// Vectors of eight as terms.
macro_rules! octet {
    ($octet:ident of $t:ty, $every:ident, $to_f32:ident) => {
        impl Term for $octet {
            inlined! { fn times(self, tap: i8) -> Self { self * Self($every(tap.into())) } }
        }

        impl Octet for $octet {
            type Number = $t;
            #[inline(always)]
            fn store(self) -> [$t; OCTET] {
                cast(self.0)
            }
            inlined! {
                fn to_f32(self) -> [f32; OCTET] { cast($to_f32(self.0)) }
            }
        }
    };
}
octet!(S1 of f32, _mm256_set1_ps, _mm256_castps_si256);
octet!(N1 of i32, _mm256_set1_epi32, _mm256_cvtepi32_ps);

/// Sixteen singles in two registers.
#[derive(Clone, Copy)]
pub(crate) struct F2([__m256; 2]);
/// Eight doubles in two registers.
#[derive(Clone, Copy)]
pub(crate) struct D2([__m256d; 2]);
/// Eight integers in two registers.
#[derive(Clone, Copy)]
pub(crate) struct I2([__m256i; 2]);
/// Truth of sixteen comparisons of singles: all bits of a lane, or none.
#[derive(Clone, Copy)]
pub(crate) struct FTruths2([__m256; 2]);
/// Truth of eight comparisons of doubles or integers.
#[derive(Clone, Copy)]
pub(crate) struct Truths2([__m256d; 2]);

operators!(F2, two, Add add _mm256_add_ps, Sub sub _mm256_sub_ps, Mul mul _mm256_mul_ps);
operators!(D2, two, Add add _mm256_add_pd, Sub sub _mm256_sub_pd, Mul mul _mm256_mul_pd, Div div _mm256_div_pd);
operators!(I2, two, Add add _mm256_add_epi64, Sub sub _mm256_sub_epi64, Mul mul times_u32);
operators!(FTruths2, two, BitAnd bitand _mm256_and_ps, BitOr bitor _mm256_or_ps);
operators!(Truths2, two, BitAnd bitand _mm256_and_pd, BitOr bitor _mm256_or_pd);

impl Not for FTruths2 {
    type Output = Self;
    inlined! {
        fn not(self) -> Self { Self(both!(x in self => _mm256_xor_ps(x, _mm256_castsi256_ps(_mm256_set1_epi64x(-1))))) }
    }
}

impl Not for Truths2 {
    type Output = Self;
    inlined! {
        fn not(self) -> Self { Self(both!(x in self => _mm256_xor_pd(x, _mm256_castsi256_pd(_mm256_set1_epi64x(-1))))) }
    }
}

impl Truths for FTruths2 {
    inlined! {
        fn bits(self) -> u32 {
            {
                let [low, high] = both!(x in self => _mm256_movemask_ps(x).cast_unsigned());
                low | high << 8
            }
        }
    }
}

impl Truths for Truths2 {
    inlined! {
        fn bits(self) -> u32 {
            {
                let [low, high] = both!(x in self => _mm256_movemask_pd(x).cast_unsigned());
                low | high << 4
            }
        }
    }
}

impl Lanes for Avx2 {
    type F = F2;
    type FTruths = FTruths2;
    type D = D2;
    type I = I2;
    type Truths = Truths2;

    inlined! {
        fn f(self, x: f32) -> F2 { F2([_mm256_set1_ps(x); 2]) }
        fn f_load(self, x: &[f32; SINGLES]) -> F2 {
            F2([_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x.as_ptr().add(8))])
        }
        fn f_store(self, x: F2, to: &mut [f32; SINGLES]) -> () {
            {
                let p = to.as_mut_ptr();
                _mm256_storeu_ps(p, x.0[0]);
                _mm256_storeu_ps(p.add(8), x.0[1]);
            }
        }
        fn f_abs(self, x: F2) -> F2 { F2(both!(x in x => _mm256_andnot_ps(_mm256_set1_ps(-0.0), x))) }
        fn f_le(self, a: F2, b: F2) -> FTruths2 {
            FTruths2([_mm256_cmp_ps::<_CMP_LE_OQ>(a.0[0], b.0[0]), _mm256_cmp_ps::<_CMP_LE_OQ>(a.0[1], b.0[1])])
        }

        fn d(self, x: f64) -> D2 { D2([_mm256_set1_pd(x); 2]) }
        fn d_load(self, x: &[f64; DOUBLES]) -> D2 {
            D2([_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x.as_ptr().add(4))])
        }
        fn d_store(self, x: D2, to: &mut [f64; DOUBLES]) -> () {
            {
                let p = to.as_mut_ptr();
                _mm256_storeu_pd(p, x.0[0]);
                _mm256_storeu_pd(p.add(4), x.0[1]);
            }
        }
        fn d_abs(self, x: D2) -> D2 { D2(both!(x in x => _mm256_andnot_pd(_mm256_set1_pd(-0.0), x))) }
        fn d_with_sign(self, magnitude: D2, sign: D2) -> D2 {
            D2([
                _mm256_or_pd(magnitude.0[0], _mm256_and_pd(_mm256_set1_pd(-0.0), sign.0[0])),
                _mm256_or_pd(magnitude.0[1], _mm256_and_pd(_mm256_set1_pd(-0.0), sign.0[1])),
            ])
        }
        fn d_lt(self, a: D2, b: D2) -> Truths2 {
            Truths2([_mm256_cmp_pd::<_CMP_LT_OQ>(a.0[0], b.0[0]), _mm256_cmp_pd::<_CMP_LT_OQ>(a.0[1], b.0[1])])
        }
        fn d_le(self, a: D2, b: D2) -> Truths2 {
            Truths2([_mm256_cmp_pd::<_CMP_LE_OQ>(a.0[0], b.0[0]), _mm256_cmp_pd::<_CMP_LE_OQ>(a.0[1], b.0[1])])
        }
        fn d_eq(self, a: D2, b: D2) -> Truths2 {
            Truths2([_mm256_cmp_pd::<_CMP_EQ_OQ>(a.0[0], b.0[0]), _mm256_cmp_pd::<_CMP_EQ_OQ>(a.0[1], b.0[1])])
        }
        fn d_choose(self, which: Truths2, a: D2, b: D2) -> D2 {
            D2([_mm256_blendv_pd(b.0[0], a.0[0], which.0[0]), _mm256_blendv_pd(b.0[1], a.0[1], which.0[1])])
        }
        fn d_bits(self, x: D2) -> I2 { I2(both!(x in x => _mm256_castpd_si256(x))) }
        fn d_field(self, from: &[u64; DOUBLES], shift: u32, mask: u64) -> D2 {
            {
                let p = from.as_ptr().cast::<__m256i>();
                let shift = _mm_cvtsi32_si128(shift.cast_signed());
                let mask = _mm256_set1_epi64x(mask.cast_signed());
                let whole = _mm256_set1_pd(WHOLE);
                let halves = I2([_mm256_loadu_si256(p), _mm256_loadu_si256(p.add(1))]);
                D2(both!(x in halves => {
                    let field = _mm256_castsi256_pd(_mm256_and_si256(_mm256_srl_epi64(x, shift), mask));
                    _mm256_sub_pd(_mm256_or_pd(field, whole), whole)
                }))
            }
        }

        fn f_field(self, from: &[u32; SINGLES], shift: u32, mask: u32) -> F2 {
            {
                let p = from.as_ptr().cast::<__m256i>();
                let shift = _mm_cvtsi32_si128(shift.cast_signed());
                let mask = _mm256_set1_epi32(mask.cast_signed());
                let halves = I2([_mm256_loadu_si256(p), _mm256_loadu_si256(p.add(1))]);
                F2(both!(x in halves => _mm256_cvtepi32_ps(_mm256_and_si256(_mm256_srl_epi32(x, shift), mask))))
            }
        }

        fn i(self, x: i64) -> I2 { I2([_mm256_set1_epi64x(x); 2]) }
        fn i_gt(self, a: I2, b: I2) -> Truths2 {
            Truths2([
                _mm256_castsi256_pd(_mm256_cmpgt_epi64(a.0[0], b.0[0])),
                _mm256_castsi256_pd(_mm256_cmpgt_epi64(a.0[1], b.0[1])),
            ])
        }
        fn exponent_field(self, x: D2) -> I2 {
            I2(both!(x in x => _mm256_srli_epi64::<52>(_mm256_castpd_si256(x))))
        }
        fn power(self, field: I2) -> D2 {
            D2(both!(x in field => _mm256_castsi256_pd(_mm256_slli_epi64::<52>(x))))
        }
    }
    octets_and_calls!();
}

/// Sixteen singles.
#[derive(Clone, Copy)]
pub(crate) struct F1(__m512);
/// Eight doubles.
#[derive(Clone, Copy)]
pub(crate) struct D1(__m512d);
/// Eight integers.
#[derive(Clone, Copy)]
pub(crate) struct I1(__m512i);

operators!(F1, one, Add add _mm512_add_ps, Sub sub _mm512_sub_ps, Mul mul _mm512_mul_ps);
operators!(D1, one, Add add _mm512_add_pd, Sub sub _mm512_sub_pd, Mul mul _mm512_mul_pd, Div div _mm512_div_pd);
operators!(I1, one, Add add _mm512_add_epi64, Sub sub _mm512_sub_epi64, Mul mul times_u32_wide);

impl Truths for __mmask16 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

impl Truths for __mmask8 {
    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self)
    }
}

impl Lanes for Vbmi2 {
    type F = F1;
    type FTruths = __mmask16;
    type D = D1;
    type I = I1;
    type Truths = __mmask8;

    inlined! {
        fn f(self, x: f32) -> F1 { F1(_mm512_set1_ps(x)) }
        fn f_load(self, x: &[f32; SINGLES]) -> F1 { F1(_mm512_loadu_ps(x.as_ptr())) }
        fn f_store(self, x: F1, to: &mut [f32; SINGLES]) -> () { _mm512_storeu_ps(to.as_mut_ptr(), x.0) }
        fn f_abs(self, x: F1) -> F1 { F1(_mm512_abs_ps(x.0)) }
        fn f_le(self, a: F1, b: F1) -> __mmask16 { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a.0, b.0) }

        fn d(self, x: f64) -> D1 { D1(_mm512_set1_pd(x)) }
        fn d_load(self, x: &[f64; DOUBLES]) -> D1 { D1(_mm512_loadu_pd(x.as_ptr())) }
        fn d_store(self, x: D1, to: &mut [f64; DOUBLES]) -> () { _mm512_storeu_pd(to.as_mut_ptr(), x.0) }
        fn d_abs(self, x: D1) -> D1 { D1(_mm512_abs_pd(x.0)) }
        fn d_with_sign(self, magnitude: D1, sign: D1) -> D1 {
            D1(_mm512_or_pd(magnitude.0, _mm512_and_pd(_mm512_set1_pd(-0.0), sign.0)))
        }
        fn d_lt(self, a: D1, b: D1) -> __mmask8 { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a.0, b.0) }
        fn d_le(self, a: D1, b: D1) -> __mmask8 { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(a.0, b.0) }
        fn d_eq(self, a: D1, b: D1) -> __mmask8 { _mm512_cmp_pd_mask::<_CMP_EQ_OQ>(a.0, b.0) }
        fn d_choose(self, which: __mmask8, a: D1, b: D1) -> D1 { D1(_mm512_mask_blend_pd(which, b.0, a.0)) }
        fn d_bits(self, x: D1) -> I1 { I1(_mm512_castpd_si512(x.0)) }
        fn d_field(self, from: &[u64; DOUBLES], shift: u32, mask: u64) -> D1 {
            {
                let x = _mm512_loadu_si512(from.as_ptr().cast());
                let shifted = _mm512_srl_epi64(x, _mm_cvtsi32_si128(shift.cast_signed()));
                let field = _mm512_and_si512(shifted, _mm512_set1_epi64(mask.cast_signed()));
                let whole = _mm512_set1_pd(WHOLE);
                D1(_mm512_sub_pd(_mm512_or_pd(_mm512_castsi512_pd(field), whole), whole))
            }
        }

        fn f_field(self, from: &[u32; SINGLES], shift: u32, mask: u32) -> F1 {
            {
                let x = _mm512_srl_epi32(_mm512_loadu_si512(from.as_ptr().cast()), _mm_cvtsi32_si128(shift.cast_signed()));
                F1(_mm512_cvtepi32_ps(_mm512_and_si512(x, _mm512_set1_epi32(mask.cast_signed()))))
            }
        }

        fn i(self, x: i64) -> I1 { I1(_mm512_set1_epi64(x)) }
        fn i_gt(self, a: I1, b: I1) -> __mmask8 { _mm512_cmpgt_epi64_mask(a.0, b.0) }
        fn exponent_field(self, x: D1) -> I1 { I1(_mm512_srli_epi64::<52>(_mm512_castpd_si512(x.0))) }
        fn power(self, field: I1) -> D1 { D1(_mm512_castsi512_pd(_mm512_slli_epi64::<52>(field.0))) }
    }
    octets_and_calls!();

    #[inline(always)]
    fn vbmi2(self) -> Option<Self> {
        Some(self)
    }
}
