//! Sizes, threads and codes of pictures, and the kinds of their rays.

pub use super::choices::Traversal;
use super::{RenderError, RenderFault};

/// Stack of a worker; nothing here recurses.
const WORKER_STACK_BYTES: usize = 4 << 20;

/// Longest side and most pixels of a picture.
const MAX_SIDE: u32 = 32_768;
const MAX_PIXELS: u64 = 1 << 28;

/// Checks a picture's size.
///
/// # Errors
/// [`RenderError`] for a size of zero or too many pixels.
pub(crate) fn check_size(width: u32, height: u32) -> Result<(), RenderError> {
    let pixels = u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
        return Err(RenderFault::Size { width, height, most_side: MAX_SIDE, most_pixels: MAX_PIXELS }.into());
    }
    Ok(())
}

/// A private pool of this many workers with small stacks; the process-wide pool is never used.
///
/// # Errors
/// [`RenderError`] when the system does not start this many threads.
pub(crate) fn pool(threads: usize) -> Result<rayon::ThreadPool, RenderError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.max(1))
        .stack_size(WORKER_STACK_BYTES)
        .build()
        .map_err(|cause| RenderFault::Threads { threads, cause: std::io::Error::other(cause) }.into())
}

/// Grey of a depth in a depth image of this range.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
pub(crate) fn depth_code((near, far): (f64, f64), depth: f32) -> u16 {
    let scale = if far > near { 65_534.0 / (far - near) } else { 0.0 };
    1 + ((f64::from(depth) - near) * scale + 0.5).clamp(0.0, 65_534.0) as u16
}

/// Colour of a component of a normal in a normal image.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
pub(crate) fn normal_code(component: f64) -> u8 {
    (128.5 + component * 127.0).clamp(1.0, 255.0) as u8
}
