#!/usr/bin/env python3
"""Writes tests/it/common/codec/jpegls_vectors.rs: a small colour image as CharLS encodes it in each interleave mode.

Needs numpy and pyjpegls (bindings of CharLS): python3 scripts/make_jpegls_vectors.py > tests/it/common/codec/jpegls_vectors.rs
"""
import jpeg_ls
import numpy as np

ROWS, COLUMNS = 5, 9


def image():
    """A ramp, runs of one value, and steps; the same formula is in jpegls_vectors.rs."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    red = x * 7 + y * 3
    green = np.where((x > 2) & (x < 8), 200, 10 * y)
    blue = (x * x * 5 + y * 31) % 256
    return np.stack([red, green, blue], -1).astype(np.uint8)


def encode(pixels, near, mode):
    # CharLS wants planes in mode 0, and pixels in the two others.
    order = pixels.transpose(2, 0, 1) if mode == 0 else pixels
    source = np.ascontiguousarray(order).tobytes()
    return bytes(jpeg_ls.encode_buffer(source, ROWS, COLUMNS, 3, 8, near, mode))


def constant(name, doc, kind, values):
    print(f"\n/// {doc}\n#[rustfmt::skip]\npub(super) const {name}: &[{kind}] = &[")
    values = list(values)
    for start in range(0, len(values), 20):
        print("    " + ", ".join(str(v) for v in values[start : start + 20]) + ",")
    print("];")


print('''//! A small colour image as CharLS encodes it; written by scripts/make_jpegls_vectors.py.

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
}''')
constant("BY_PLANE", "A scan for each component.", "u8", encode(image(), 0, 0))
constant("BY_LINE", "Line by line.", "u8", encode(image(), 0, 1))
constant("BY_SAMPLE", "Sample by sample.", "u8", encode(image(), 0, 2))
near = encode(image(), 3, 2)
constant("BY_SAMPLE_NEAR", "Sample by sample, with differences up to 3.", "u8", near)
decoded, _ = jpeg_ls.decode_buffer(near)
constant("BY_SAMPLE_NEAR_PIXELS", "What CharLS decodes from it.", "i32", decoded)
