//! Running hot loops with AVX2 where the machine has it.
//!
//! Kernels are written once as portable `#[inline(always)]` code; [`with_avx2`] instantiates them a
//! second time inside a function with the target feature. Both give the same bits: floats are never
//! contracted or reassociated, and integers are exact.
#![allow(unsafe_code)]

/// Proof that this machine has AVX2, bit manipulation and population count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

#[cfg(target_arch = "x86_64")]
impl Avx2 {
    /// The proof, if this machine has the instructions.
    #[inline]
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt"))
        .then_some(Self(()))
    }
}

/// The instruction set that a kernel is compiled for.
pub(crate) trait Isa: Copy {
    /// The proof of AVX2, in instances compiled with it.
    fn avx2(self) -> Option<Avx2>;
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Isa for Portable {
    #[inline(always)]
    fn avx2(self) -> Option<Avx2> {
        None
    }
}

impl Isa for Avx2 {
    #[inline(always)]
    fn avx2(self) -> Option<Self> {
        Some(self)
    }
}

/// A kernel that can be compiled for more than one instruction set.
pub(crate) trait Kernel {
    type Output;
    /// The work; must be `#[inline(always)]` all the way down.
    fn run(self, isa: impl Isa) -> Self::Output;
}

/// Runs `kernel` with the best instruction set of this machine.
#[inline]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        // SAFETY: `avx2` proves every feature that `with_avx2` enables.
        return unsafe { with_avx2(avx2, kernel) };
    }
    kernel.run(Portable)
}

/// The kernel compiled with AVX2, bit manipulation and population count.
///
/// # Safety
/// The machine must have the features named.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn with_avx2<K: Kernel>(avx2: Avx2, kernel: K) -> K::Output {
    kernel.run(avx2)
}

/// Bits 7 of 32 bytes, byte i giving bit i: the one instruction that portable code does not reach.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    use std::arch::x86_64::{__m256i, _mm256_movemask_epi8};
    let v: __m256i = bytemuck::cast(bytes);
    // SAFETY: the first argument proves that this machine has AVX2; no memory is accessed.
    unsafe { _mm256_movemask_epi8(v).cast_unsigned() }
}

/// Portable stand-in, never called: other machines give no such proof.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    bytes.iter().enumerate().fold(0, |m, (i, b)| m | u32::from(b >> 7) << i)
}
