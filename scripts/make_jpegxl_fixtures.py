#!/usr/bin/env python3
"""Makes the codestreams in tests/support/jpegxl.rs, and prints them as Rust arrays.

Needs numpy and imagecodecs (libjxl, libjpeg-turbo). Lossless images are formulas, so that the tests know
every sample; of the lossy ones libjxl's own decoding is printed beside them.
"""

import imagecodecs
import numpy


def formula(width, height, levels):
    y, x = numpy.mgrid[0:height, 0:width].astype(numpy.int64)
    return (x * x * 37 + y * 91 + x * y * 13) % levels


def smooth(width, height, most):
    """Three channels of slow waves."""
    y, x = numpy.mgrid[0:height, 0:width]
    waves = [numpy.sin(x / 5) + numpy.cos(y / 7), numpy.sin((x + y) / 6), numpy.cos((x - 2 * y) / 9)]
    return numpy.stack([(wave / 5 + 0.5) * most for wave in waves], -1)


def show(name, stream, note):
    print(f"\n/// {note}\n#[rustfmt::skip]\npub(crate) const {name}: &[u8] = &[")
    for start in range(0, len(stream), 20):
        print("    " + " ".join(f"0x{byte:02X}," for byte in stream[start : start + 20]))
    print("];")


def show_samples(name, samples, note):
    flat = [int(sample) for sample in samples.flatten()]
    print(f"\n/// {note}\n#[rustfmt::skip]\npub(crate) const {name}: &[i32] = &[")
    for start in range(0, len(flat), 20):
        print("    " + " ".join(f"{sample}," for sample in flat[start : start + 20]))
    print("];")


def main():
    encode, decode = imagecodecs.jpegxl_encode, imagecodecs.jpegxl_decode
    print("//! JPEG XL streams made by `scripts/make_jpegxl_fixtures.py`.")
    print('#![allow(dead_code, reason = "each test file uses its own part")]')

    eight = formula(9, 7, 256).astype(numpy.uint8)
    show("EIGHT", encode(eight, lossless=True), "9 by 7, 8 bits, lossless.")
    show("BOXED", encode(eight, lossless=True, usecontainer=True), "The same in a file.")
    twelve = formula(9, 7, 4096).astype(numpy.uint16)
    show("TWELVE", encode(twelve, lossless=True, bitspersample=12), "9 by 7, 12 bits, lossless.")
    show("TWELVE_IN_16", encode(twelve, lossless=True), "The same samples as 16 bits.")
    sixteen = formula(9, 7, 65536).astype(numpy.uint16)
    show("SIXTEEN", encode(sixteen, lossless=True), "9 by 7, 16 bits, lossless.")
    colour = numpy.stack([formula(9, 7, levels) for levels in (256, 251, 241)], -1).astype(numpy.uint8)
    show("COLOUR", encode(colour, lossless=True), "9 by 7, three times 8 bits, lossless: levels 256, 251, 241.")
    y, x = numpy.mgrid[0:280, 0:300]
    show("GROUPS", encode((x + 3 * y).astype(numpy.uint16), lossless=True, effort=7), "300 by 280, 16 bits, lossless: x + 3 y.")

    grey = smooth(24, 20, 65535)[..., 0].astype(numpy.uint16)
    near = encode(grey, distance=1.0)
    show("NEAR_GREY", near, "24 by 20, 16 bits, lossy.")
    show_samples("NEAR_GREY_SAMPLES", decode(near), "As libjxl decodes it.")
    near = encode(smooth(12, 10, 255).astype(numpy.uint8), distance=1.0)
    show("NEAR_COLOUR", near, "12 by 10, three times 8 bits, lossy.")
    show_samples("NEAR_COLOUR_SAMPLES", decode(near), "As libjxl decodes it.")

    for name, image in (("GREY", smooth(24, 20, 255)[..., 0]), ("COLOUR", smooth(24, 20, 255))):
        jpeg = imagecodecs.jpeg8_encode(image.astype(numpy.uint8), level=90, subsampling="422" if name == "COLOUR" else None)
        show(f"JPEG_{name}", jpeg, "24 by 20, baseline JPEG" + (" 4:2:2." if name == "COLOUR" else "."))
        show(f"RECOMPRESSED_{name}", imagecodecs.jpegxl_encode_jpeg(jpeg), "The same as JPEG XL.")

    alpha = numpy.stack([eight, 255 - eight], -1)
    show("ALPHA", encode(alpha, lossless=True), "9 by 7, grey and alpha.")
    show("FLOATS", encode((eight / 256).astype(numpy.float32), lossless=True), "9 by 7, floating-point.")


if __name__ == "__main__":
    main()
