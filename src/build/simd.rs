//! The only place of the builder with `unsafe`: running a kernel with AVX2 where the machine has it.
//!
//! Kernels are written once as portable `#[inline(always)]` code; [`with_avx2`] instantiates them a
//! second time inside a function with the target feature. Both give the same bits: floats are never
//! contracted or reassociated, and integers are exact.
#![allow(unsafe_code)]

/// A kernel that can be compiled for more than one instruction set.
pub(super) trait Kernel {
    /// What it returns.
    type Output;
    /// The work; must be `#[inline(always)]` all the way down.
    fn run<const AVX2: bool>(self) -> Self::Output;
}

/// Runs `kernel` with the best instruction set of this machine.
#[inline]
pub(super) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
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

/// Bits 7 of 32 bytes, byte i giving bit i: the one instruction that portable code does not reach.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn movemask(bytes: [u8; 32]) -> u32 {
    use std::arch::x86_64::{__m256i, _mm256_movemask_epi8};
    let v: __m256i = bytemuck::cast(bytes);
    // SAFETY: only kernels instantiated with AVX2 = true call this, and they run on such a machine.
    unsafe { _mm256_movemask_epi8(v).cast_unsigned() }
}

/// Portable stand-in, never called: other machines have no `AVX2 = true` instances.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(super) fn movemask(bytes: [u8; 32]) -> u32 {
    bytes.iter().enumerate().fold(0, |m, (i, b)| m | u32::from(b >> 7) << i)
}

/// Rows `start`, `start + stride` ... `start + 4 stride` of a plane, `N` samples each, with one check for
/// all of them instead of one each.
///
/// # Panics
/// If the last row does not end within the plane.
#[inline(always)]
pub(super) fn five_rows<R: bytemuck::Pod, const N: usize>(
    plane: &[R],
    start: usize,
    stride: usize,
) -> [[R; N]; 5] {
    let most = plane.len().wrapping_sub(N);
    assert!(plane.len() >= N && start <= most && stride <= (most - start) / 4, "a window leaves its plane");
    std::array::from_fn(|row| {
        // SAFETY: row <= 4, so start + row * stride + N <= start + 4 * stride + N <= plane.len() by the
        // check above, and any bytes are a value of a Pod type.
        unsafe { plane.as_ptr().add(start + row * stride).cast::<[R; N]>().read_unaligned() }
    })
}
