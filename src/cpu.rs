//! Running hot loops with AVX2 where the machine has it.
//!
//! Kernels are written once as portable `#[inline(always)]` code; [`with_avx2`] instantiates them a
//! second time inside a function with the target feature. Both give the same bits: floats are never
//! contracted or reassociated, and integers are exact.
#![allow(unsafe_code)]

/// A kernel that can be compiled for more than one instruction set.
pub(crate) trait Kernel {
    /// What it returns.
    type Output;
    /// The work; must be `#[inline(always)]` all the way down.
    fn run<const AVX2: bool>(self) -> Self::Output;
}

/// Runs `kernel` with the best instruction set of this machine.
#[inline]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
    {
        // SAFETY: every feature that `with_avx2` enables was just detected on this machine.
        return unsafe { with_avx2(kernel) };
    }
    kernel.run::<false>()
}

/// The kernel compiled with AVX2, bit manipulation and population count.
///
/// # Safety
/// The machine must have the features named.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<true>()
}
