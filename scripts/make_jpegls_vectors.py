#!/usr/bin/env python3
"""Writes tests/it/common/codec/vectors/*.jls: a small colour image as CharLS encodes it in each interleave mode.

Needs numpy and pyjpegls (bindings of CharLS).
"""
from pathlib import Path

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


def keep(name, content):
    Path(__file__).parent.parent.joinpath("tests/it/common/codec/vectors", name).write_bytes(bytes(content))


keep("by-plane.jls", encode(image(), 0, 0))
keep("by-line.jls", encode(image(), 0, 1))
keep("by-sample.jls", encode(image(), 0, 2))
near = encode(image(), 3, 2)
keep("by-sample-near.jls", near)
keep("by-sample-near.samples", jpeg_ls.decode_buffer(near)[0])
