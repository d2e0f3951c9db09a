//! Instructions that portable code of the builder does not reach: one instruction, and one check for many reads.
#![allow(unsafe_code)]

use crate::cpu::Avx2;
pub(super) use crate::cpu::{Isa, Kernel, dispatch};

/// Bits 7 of 32 bytes, byte i giving bit i: the one instruction that portable code does not reach.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    use std::arch::x86_64::{__m256i, _mm256_movemask_epi8};
    let v: __m256i = bytemuck::cast(bytes);
    // SAFETY: the first argument proves that this machine has AVX2; no memory is accessed.
    unsafe { _mm256_movemask_epi8(v).cast_unsigned() }
}

/// Portable stand-in, never called: other machines give no such proof.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(super) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    bytes.iter().enumerate().fold(0, |m, (i, b)| m | u32::from(b >> 7) << i)
}

/// [`rows_of`] with five rows.
///
/// # Panics
/// If the last row does not end within the plane.
#[inline(always)]
pub(super) fn five_rows<R: bytemuck::Pod, const N: usize>(
    plane: &[R],
    start: usize,
    stride: usize,
) -> [[R; N]; 5] {
    rows_of(plane, start, stride)
}

/// `K` rows of a plane, at least two, from `start` on and `stride` apart, `N` samples each, with one check for
/// all of them instead of one each.
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
    std::array::from_fn(|row| {
        // SAFETY: row < K, so start + row * stride + N <= start + (K - 1) * stride + N <= plane.len() by the
        // check above, and any bytes are a value of a Pod type.
        unsafe { plane.as_ptr().add(start + row * stride).cast::<[R; N]>().read_unaligned() }
    })
}
