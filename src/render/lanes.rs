//! The vector arithmetic of the traversal: what a kernel may ask of a machine, and the portable answer.
//!
//! One kernel is written over [`Lanes`]; `lanes_x86` has the instances for AVX2 and AVX-512. Every form does
//! the same operations in the same order, each rounded once (nothing is fused), so all give the same bits.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::pairs::{self, CELLS, Compared, Lines, Planes};

/// Lanes of singles: the 4 x 4 cells of a plane, or two rows of a tile.
pub(crate) const SINGLES: usize = 16;

/// Lanes of doubles and of 64-bit integers: one row of a tile.
pub(crate) const DOUBLES: usize = 8;

/// 2^52.
pub(crate) const WHOLE: f64 = (1_u64 << 52) as f64;

/// The pairs of axes (a, b), a < b, whose planes a box is projected onto.
pub(crate) const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];

/// An array of an expression of 0, 1 and 2: axes, or pairs of axes. Not a closure: a closure over vectors is
/// inlined too late, if at all, and then calls a function for every instruction.
macro_rules! each3 {
    ($i:ident => $e:expr) => {
        [
            {
                const $i: usize = 0;
                $e
            },
            {
                const $i: usize = 1;
                $e
            },
            {
                const $i: usize = 2;
                $e
            },
        ]
    };
}
pub(crate) use each3;

/// The larger of two numbers, without the rules of [`f64::max`] for NaN.
#[inline(always)]
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The smaller of two numbers, as [`larger`].
#[inline(always)]
pub(crate) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Methods of one expression, inlined into every kernel.
macro_rules! inlined {
    ($(fn $name:ident($self:ident $(, $argument:ident: $t:ty)*) -> $out:ty { $body:expr })*) => {$(
        #[inline(always)]
        fn $name($self $(, $argument: $t)*) -> $out {
            $body
        }
    )*};
}

/// Arithmetic that wraps where it is of integers.
pub(crate) trait Ring: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}
impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>> Ring for T {}

/// Truth values side by side.
pub(crate) trait Truths:
    Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self>
{
    /// Lane i as bit i.
    fn bits(self) -> u32;
}

/// A machine's vectors. The value itself is the proof that the machine has the instructions.
pub(crate) trait Lanes: Copy {
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
    /// Without the sign.
    fn f_abs(self, x: Self::F) -> Self::F;
    /// `a <= b`
    fn f_le(self, a: Self::F, b: Self::F) -> Self::FTruths;

    /// The same double in every lane.
    fn d(self, x: f64) -> Self::D;
    /// Doubles from memory.
    fn d_load(self, x: &[f64; DOUBLES]) -> Self::D;
    /// Doubles to memory.
    fn d_store(self, x: Self::D, to: &mut [f64; DOUBLES]);
    /// Without the sign.
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

    /// Sixteen truths of a plane's cells, in Morton order over the pair's two axes, repeated along the
    /// third: 64 truths in Morton order.
    #[inline(always)]
    fn extrude(self, pair: usize, plane: u32) -> u64 {
        extrude(pair, plane)
    }

    /// Spreads the infobytes of a node's children, lowest byte first, to the octants that `infobyte` names.
    #[inline(always)]
    fn spread_children(self, infobyte: u8, children: u64) -> u64 {
        spread_children(infobyte, children)
    }

    /// The boxes of a brick moved from place i to place `i ^ flip`.
    #[inline(always)]
    fn mirror_brick(self, boxes: u64, flip: u32) -> u64 {
        super::occupancy::mirrored(boxes, flip)
    }

    /// Bits of integers from bit `shift` on, as doubles; `mask` is below 2^52.
    fn d_field(self, from: &[u64; DOUBLES], shift: u32, mask: u64) -> Self::D;

    /// Is it worth while to list the pairs of a brick, and to compare them sixteen at a time?
    const COMPARES_PAIRS: bool = false;

    /// Do the rays of a tile walk together? Otherwise each goes alone, with the same hit.
    const WALKS_TOGETHER: bool = true;

    /// See [`pairs::list`].
    #[inline(always)]
    fn list(self, boxes: u64, places: &mut [u8; pairs::LISTED]) {
        pairs::list(boxes, places);
    }

    /// See [`pairs::planes`].
    #[inline(always)]
    fn planes(self, codes: &[[u8; 2]; CELLS], offsets: &[u8; CELLS], stored: u64, flip: u32) -> Planes {
        pairs::planes(codes, offsets, stored, flip)
    }

    /// See [`pairs::compare`].
    #[inline(always)]
    fn compare(
        self,
        planes: &Planes,
        lines: &Lines<'_>,
        places: &[u8; SINGLES],
        rays: &[u8; SINGLES],
    ) -> Compared {
        pairs::compare(planes, lines, places, rays)
    }

    /// Hints that the first of these bytes will be read.
    #[inline(always)]
    fn prefetch(self, bytes: &[u8]) {
        let _ = bytes;
    }
}

/// Where four cells of a pair's plane stand in Morton order of space: `LOW` of the cells (a, b) in 0..2
/// squared, `HIGH` of the quarters of the plane.
const LOW: [[u64; 4]; 3] = [[0, 1, 2, 3], [0, 1, 4, 5], [0, 2, 4, 6]];
const HIGH: [[u32; 4]; 3] = [[0, 8, 16, 24], [0, 8, 32, 40], [0, 16, 32, 48]];

/// Factor that repeats a plane's bits along the axis that is not of the pair.
pub(crate) const REPEAT: [u64; 3] =
    [(1 + (1 << 4)) * (1 + (1 << 32)), (1 + (1 << 2)) * (1 + (1 << 16)), (1 + (1 << 1)) * (1 + (1 << 8))];

/// The bits of 64 that a plane's sixteen come from: those with 0 along the other axis.
#[cfg(any(target_arch = "x86_64", test))]
pub(crate) const PLANE: [u64; 3] = [plane_bits(0), plane_bits(1), plane_bits(2)];

#[cfg(any(target_arch = "x86_64", test))]
const fn plane_bits(pair: usize) -> u64 {
    let (mut bits, mut cell) = (0, 0);
    while cell < 16 {
        bits |= 1 << (LOW[pair][cell % 4] + HIGH[pair][cell / 4] as u64);
        cell += 1;
    }
    bits
}

/// All sixteen values of four cells, spread.
const LOW_SPREAD: [[u64; 16]; 3] = {
    let mut spread = [[0; 16]; 3];
    let mut at = 0;
    while at < 3 * 16 * 4 {
        let (pair, value, cell) = (at / 64, at / 4 % 16, at % 4);
        spread[pair][value] |= (value as u64 >> cell & 1) << LOW[pair][cell];
        at += 1;
    }
    spread
};

/// Portable [`Lanes::extrude`].
pub(crate) fn extrude(pair: usize, plane: u32) -> u64 {
    let spread = &LOW_SPREAD[pair];
    let quarter = |q: usize| spread[(plane >> (4 * q) & 15) as usize] << HIGH[pair][q];
    (quarter(0) | quarter(1) | quarter(2) | quarter(3)).wrapping_mul(REPEAT[pair])
}

/// Portable [`Lanes::spread_children`].
pub(crate) fn spread_children(infobyte: u8, children: u64) -> u64 {
    let (mut spread, mut rest) = (0, children);
    for octant in 0..8 {
        if infobyte >> octant & 1 == 1 {
            spread |= (rest & 0xff) << (8 * octant);
            rest >>= 8;
        }
    }
    spread
}

/// Any machine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

/// Lanes as an array, with arithmetic lane by lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Array<T, const N: usize>([T; N]);

/// Truths as bits.
#[derive(Clone, Copy, Debug)]
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
arithmetic!(f64, DOUBLES, Add add |a, b| a + b, Sub sub |a, b| a - b, Mul mul |a, b| a * b, Div div |a, b| a / b);
arithmetic!(i64, DOUBLES, Add add i64::wrapping_add, Sub sub i64::wrapping_sub, Mul mul i64::wrapping_mul);

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
    // On x86-64 only machines before AVX2 run this form, and the walk was a twenty-fifth of the program.
    const WALKS_TOGETHER: bool = cfg!(not(target_arch = "x86_64"));

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
            // Below 2^52 a whole number stands in the low bits of 2^52 plus it.
            Array(from.map(|x| f64::from_bits((x >> shift & mask) | WHOLE.to_bits()) - WHOLE))
        }

        fn i(self, x: i64) -> Self::I { Array([x; DOUBLES]) }
        fn i_gt(self, a: Self::I, b: Self::I) -> Bits { a.truths(b, |a, b| a > b) }
        fn exponent_field(self, x: Self::D) -> Self::I { Array(x.0.map(|x| (x.to_bits() >> 52).cast_signed())) }
        fn power(self, field: Self::I) -> Self::D { Array(field.0.map(|x| f64::from_bits(x.cast_unsigned() << 52))) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_of_cells_is_repeated_along_the_third_axis() {
        for (pair, (a, b)) in PAIRS.into_iter().enumerate() {
            for bit in 0..16 {
                let plane = 1_u32 << bit;
                let of = |i: u32| (bit >> i & 1) | (bit >> (2 + i) & 1) << 1;
                let mut want = 0;
                for v in 0..64_u32 {
                    let at = |axis: usize| (v >> axis & 1) | (v >> (3 + axis) & 1) << 1;
                    if at(a) == of(0) && at(b) == of(1) {
                        want |= 1_u64 << v;
                    }
                }
                assert_eq!(extrude(pair, plane), want, "{pair} {bit}");
            }
            assert_eq!(extrude(pair, 0xffff), u64::MAX);
            assert_eq!(PLANE[pair].wrapping_mul(REPEAT[pair]), u64::MAX);
        }
    }
}
