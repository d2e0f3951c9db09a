//! What portable code of the builder does not reach: one check for many reads.
#![allow(unsafe_code)]

pub(super) use crate::cpu::{Isa, Kernel, dispatch, movemask};

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
    let mut rows = [[R::zeroed(); N]; K];
    for (row, samples) in rows.iter_mut().enumerate() {
        // SAFETY: row < K, so start + row * stride + N <= start + (K - 1) * stride + N <= plane.len() by the
        // check above, and any bytes are a value of a Pod type.
        *samples = unsafe { plane.as_ptr().add(start + row * stride).cast::<[R; N]>().read_unaligned() };
    }
    rows
}
