//! A small colour image as CharLS encodes it; its files are written by scripts/make_jpegls_vectors.py.

/// The image: 9 columns, 5 rows, 3 components of 8 bits.
pub(super) fn pixels() -> Vec<i32> {
    let mut pixels = Vec::new();
    for y in 0..5 {
        for x in 0..9 {
            let green = if x > 2 && x < 8 { 200 } else { 10 * y };
            pixels.extend([x * 7 + y * 3, green, (x * x * 5 + y * 31) % 256]);
        }
    }
    pixels
}

/// A scan for each component.
pub(super) const BY_PLANE: &[u8] = include_bytes!("vectors/by-plane.jls");

/// Line by line.
pub(super) const BY_LINE: &[u8] = include_bytes!("vectors/by-line.jls");

/// Sample by sample.
pub(super) const BY_SAMPLE: &[u8] = include_bytes!("vectors/by-sample.jls");

/// Sample by sample, with differences up to 3.
pub(super) const BY_SAMPLE_NEAR: &[u8] = include_bytes!("vectors/by-sample-near.jls");

/// What CharLS decodes from it.
pub(super) const BY_SAMPLE_NEAR_PIXELS: &[u8; 135] = include_bytes!("vectors/by-sample-near.samples");
