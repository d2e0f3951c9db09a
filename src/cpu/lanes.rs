//! The vector arithmetic of kernels, and its portable form.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{Avx2, Kernel, Vbmi2};

/// Lanes of singles: the 4 x 4 cells of a plane, or two rows of a tile.
pub(crate) const SINGLES: usize = 16;

/// Lanes of doubles and of 64-bit integers: one row of a tile.
pub(crate) const DOUBLES: usize = 8;

/// Lanes of 32-bit sums.
pub(crate) const OCTET: usize = 8;

/// 2^52.
pub(super) const WHOLE: f64 = (1_u64 << 52) as f64;

/// Methods of one expression, inlined into every kernel.
macro_rules! inlined {
    ($(fn $name:ident($self:ident $(, $argument:ident: $t:ty)*) -> $out:ty { $body:expr })*) => {$(
        #[inline(always)]
        fn $name($self $(, $argument: $t)*) -> $out {
            $body
        }
    )*};
}

/// Arithmetic that wraps for integers.
pub(crate) trait Ring: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}
impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>> Ring for T {}

/// Truth values side by side.
pub(crate) trait Truths:
    Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// Lane i as bit i.
    fn bits(self) -> u32;
}

/// A term of a sum of products with small factors.
pub(crate) trait Term: Ring {
    /// Times a factor.
    fn times(self, tap: i8) -> Self;
}

impl Term for f32 {
    inlined! { fn times(self, tap: i8) -> Self { self * Self::from(tap) } }
}

/// Eight terms side by side.
pub(crate) trait Octet: Term {
    /// A term.
    type Number: bytemuck::Pod;
    /// Terms to memory.
    fn store(self) -> [Self::Number; OCTET];
    /// Terms as singles, rounded once.
    fn to_f32(self) -> [f32; OCTET];
}

/// A machine's vectors. The value itself is the proof that the machine has the instructions.
pub(crate) trait Lanes: Copy {
    /// Eight singles.
    type S: Octet<Number = f32>;
    /// Eight 32-bit integers, which wrap.
    type N: Octet<Number = i32>;
    /// Sixteen singles.
    type F: Ring;
    /// Truth of sixteen comparisons.
    type FTruths: Truths;
    /// Eight doubles.
    type D: Ring + Div<Output = Self::D>;
    /// Eight 64-bit integers; `*` needs a right side in `0..2^32` and wraps.
    type I: Ring;
    /// Truth of eight comparisons.
    type Truths: Truths;

    /// The same single in every lane.
    fn f(self, x: f32) -> Self::F;
    /// Singles from memory.
    fn f_load(self, x: &[f32; SINGLES]) -> Self::F;
    /// Singles to memory.
    fn f_store(self, x: Self::F, to: &mut [f32; SINGLES]);
    /// Absolute values.
    fn f_abs(self, x: Self::F) -> Self::F;
    /// `a <= b`
    fn f_le(self, a: Self::F, b: Self::F) -> Self::FTruths;

    /// The same double in every lane.
    fn d(self, x: f64) -> Self::D;
    /// Doubles from memory.
    fn d_load(self, x: &[f64; DOUBLES]) -> Self::D;
    /// Doubles to memory.
    fn d_store(self, x: Self::D, to: &mut [f64; DOUBLES]);
    /// Absolute values.
    fn d_abs(self, x: Self::D) -> Self::D;
    /// `magnitude`, not negative, with the sign of `sign`.
    fn d_with_sign(self, magnitude: Self::D, sign: Self::D) -> Self::D;
    /// `a < b`
    fn d_lt(self, a: Self::D, b: Self::D) -> Self::Truths;
    /// `a <= b`
    fn d_le(self, a: Self::D, b: Self::D) -> Self::Truths;
    /// `a == b`
    fn d_eq(self, a: Self::D, b: Self::D) -> Self::Truths;
    /// `a` where true, else `b`.
    fn d_choose(self, which: Self::Truths, a: Self::D, b: Self::D) -> Self::D;
    /// The bits of a double as an integer.
    fn d_bits(self, x: Self::D) -> Self::I;

    /// The same integer in every lane.
    fn i(self, x: i64) -> Self::I;
    /// `a > b`
    fn i_gt(self, a: Self::I, b: Self::I) -> Self::Truths;
    /// Exponent field of doubles that are not negative.
    fn exponent_field(self, x: Self::D) -> Self::I;
    /// The doubles whose exponent field is `field`, in `1..=2046`, and whose fraction is 0.
    fn power(self, field: Self::I) -> Self::D;

    /// Bits of integers from bit `shift` on, as doubles; `mask` is below 2^52.
    fn d_field(self, from: &[u64; DOUBLES], shift: u32, mask: u64) -> Self::D;

    /// Bits of integers from bit `shift` on, as singles; `mask` is below 2^24.
    fn f_field(self, from: &[u32; SINGLES], shift: u32, mask: u32) -> Self::F;

    /// Eight singles from memory.
    fn s_load(self, x: &[f32; OCTET]) -> Self::S;
    /// Eight integers from memory.
    fn n_load(self, x: &[i32; OCTET]) -> Self::N;

    /// The proof of AVX2, in forms that have it.
    #[inline(always)]
    fn avx2(self) -> Option<Avx2> {
        None
    }

    /// The proof of VBMI2, in the form that has it.
    #[inline(always)]
    fn vbmi2(self) -> Option<Vbmi2> {
        None
    }

    /// Calls a kernel compiled for the same form by itself: for rare work.
    fn call<K: Kernel>(self, kernel: K) -> K::Output;
}

/// Any machine.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

/// Lanes as an array, with arithmetic lane by lane.
#[derive(Clone, Copy)]
pub(crate) struct Array<T, const N: usize>([T; N]);

/// Truths as bits.
#[derive(Clone, Copy)]
pub(crate) struct Bits(u32);

impl<T: Copy, const N: usize> Array<T, N> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn truths(self, other: Self, f: impl Fn(T, T) -> bool) -> Bits {
        Bits((0..N).fold(0, |bits, i| bits | u32::from(f(self.0[i], other.0[i])) << i))
    }
}

macro_rules! arithmetic {
    ($t:ty, $n:expr, $($trait:ident $method:ident $f:expr),*) => {$(
        impl $trait for Array<$t, $n> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, $f)
            }
        }
    )*};
}
arithmetic!(f32, SINGLES, Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b);
arithmetic!(f32, OCTET, Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b);
arithmetic!(i32, OCTET, Add add i32::wrapping_add, Sub sub i32::wrapping_sub, Mul mul i32::wrapping_mul);
arithmetic!(f64, DOUBLES, Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b, Div div |a, b| a / b);
arithmetic!(i64, DOUBLES, Add add i64::wrapping_add, Sub sub i64::wrapping_sub, Mul mul i64::wrapping_mul);

/// Arrays of eight as terms.
macro_rules! octet {
    ($t:ty, $x:ident => $to_f32:expr) => {
        impl Term for Array<$t, OCTET> {
            inlined! { fn times(self, tap: i8) -> Self { self * Self([<$t>::from(tap); OCTET]) } }
        }

        impl Octet for Array<$t, OCTET> {
            type Number = $t;
            inlined! {
                fn store(self) -> [$t; OCTET] { self.0 }
                fn to_f32(self) -> [f32; OCTET] { self.0.map(|$x| $to_f32) }
            }
        }
    };
}
octet!(f32, x => x);
octet!(i32, x => {
    #[expect(clippy::cast_precision_loss, reason = "one rounding, the only one")]
    let single = x as f32;
    single
});

impl BitAnd for Bits {
    type Output = Self;
    inlined! { fn bitand(self, other: Self) -> Self { Self(self.0 & other.0) } }
}

impl BitOr for Bits {
    type Output = Self;
    inlined! { fn bitor(self, other: Self) -> Self { Self(self.0 | other.0) } }
}

impl Not for Bits {
    type Output = Self;
    inlined! { fn not(self) -> Self { Self(!self.0) } }
}

impl Truths for Bits {
    inlined! { fn bits(self) -> u32 { self.0 } }
}

impl Lanes for Portable {
    type F = Array<f32, SINGLES>;
    type FTruths = Bits;
    type D = Array<f64, DOUBLES>;
    type I = Array<i64, DOUBLES>;
    type Truths = Bits;
    type S = Array<f32, OCTET>;
    type N = Array<i32, OCTET>;

    inlined! {
        fn f(self, x: f32) -> Self::F { Array([x; SINGLES]) }
        fn f_load(self, x: &[f32; SINGLES]) -> Self::F { Array(*x) }
        fn f_store(self, x: Self::F, to: &mut [f32; SINGLES]) -> () { *to = x.0 }
        fn f_abs(self, x: Self::F) -> Self::F { Array(x.0.map(f32::abs)) }
        fn f_le(self, a: Self::F, b: Self::F) -> Bits { a.truths(b, |a, b| a <= b) }

        fn d(self, x: f64) -> Self::D { Array([x; DOUBLES]) }
        fn d_load(self, x: &[f64; DOUBLES]) -> Self::D { Array(*x) }
        fn d_store(self, x: Self::D, to: &mut [f64; DOUBLES]) -> () { *to = x.0 }
        fn d_abs(self, x: Self::D) -> Self::D { Array(x.0.map(f64::abs)) }
        fn d_with_sign(self, magnitude: Self::D, sign: Self::D) -> Self::D { magnitude.zip(sign, f64::copysign) }
        fn d_lt(self, a: Self::D, b: Self::D) -> Bits { a.truths(b, |a, b| a < b) }
        fn d_le(self, a: Self::D, b: Self::D) -> Bits { a.truths(b, |a, b| a <= b) }
        fn d_eq(self, a: Self::D, b: Self::D) -> Bits { a.truths(b, |a, b| a == b) }
        fn d_choose(self, which: Bits, a: Self::D, b: Self::D) -> Self::D {
            Array(std::array::from_fn(|i| if which.0 >> i & 1 == 1 { a.0[i] } else { b.0[i] }))
        }
        fn d_bits(self, x: Self::D) -> Self::I { Array(x.0.map(|x| x.to_bits().cast_signed())) }
        fn d_field(self, from: &[u64; DOUBLES], shift: u32, mask: u64) -> Self::D {
            // Below 2^52 a whole number is in the low bits of its sum with 2^52.
            Array(from.map(|x| f64::from_bits((x >> shift & mask) | WHOLE.to_bits()) - WHOLE))
        }

        fn f_field(self, from: &[u32; SINGLES], shift: u32, mask: u32) -> Self::F {
            #[expect(clippy::cast_precision_loss, reason = "below 2^24")]
            Array(from.map(|x| (x >> shift & mask) as f32))
        }

        fn i(self, x: i64) -> Self::I { Array([x; DOUBLES]) }
        fn i_gt(self, a: Self::I, b: Self::I) -> Bits { a.truths(b, |a, b| a > b) }
        fn exponent_field(self, x: Self::D) -> Self::I { Array(x.0.map(|x| (x.to_bits() >> 52).cast_signed())) }
        fn power(self, field: Self::I) -> Self::D { Array(field.0.map(|x| f64::from_bits(x.cast_unsigned() << 52))) }

        fn s_load(self, x: &[f32; OCTET]) -> Self::S { Array(*x) }
        fn n_load(self, x: &[i32; OCTET]) -> Self::N { Array(*x) }
    }

    #[inline(never)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
}
