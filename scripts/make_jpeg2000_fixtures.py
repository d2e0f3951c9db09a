#!/usr/bin/env python3
"""Writes the codestreams tests/it/common/codec/vectors/*.j2c.

Needs numpy, imagecodecs (OpenJPH, and OpenJPEG to compare) and OpenJPEG's opj_compress. The images are
formulas, so that the tests know every sample of the lossless ones.
"""

import random
import struct
import subprocess
import tempfile
from pathlib import Path

import imagecodecs
import numpy


def formula(width, height, levels, offset=0):
    y, x = numpy.mgrid[0:height, 0:width].astype(numpy.int64)
    return (x * x * 37 + y * 91 + x * y * 13) % levels + offset


def openjpeg(planes, bits, signed, *options):
    """Encodes planes (component, row, column) of up to 16 bits."""
    count, height, width = planes.shape
    with tempfile.TemporaryDirectory() as folder:
        raw, out = Path(folder, "in.raw"), Path(folder, "out.j2k")
        planes.astype((">i" if signed else ">u") + ("1" if bits <= 8 else "2")).tofile(raw)
        shape = f"{width},{height},{count},{bits},{'s' if signed else 'u'}"
        subprocess.run(["opj_compress", "-i", raw, "-o", out, "-F", shape, *options], check=True, capture_output=True)
        return without_comment(out.read_bytes())


def without_comment(stream):
    at = stream.find(b"\xff\x64")
    if at < 0:
        return stream
    (length,) = struct.unpack(">H", stream[at + 2 : at + 4])
    return stream[:at] + stream[at + 2 + length :]


def high_throughput_passes(width, height, seed, flags=0x40):
    """One high-throughput code-block of three passes, not transformed: OpenJPH writes the cleanup pass, as
    the low sub-band of an image twice as large; the other two are random bytes, which are always a code."""
    image = formula(2 * width, 2 * height, 256).astype(numpy.uint8)
    plain = imagecodecs.htj2k_encode(image, reversible=True, resolutions=1)
    body = plain[plain.index(b"\xff\x93") + 2 : plain.rindex(b"\xff\xd9")]

    class Header:
        at = 0
        left = 0
        now = 0

        def bit(self):
            if self.left == 0:
                self.left = 7 if self.now == 0xFF else 8
                self.now = body[self.at]
                self.at += 1
            self.left -= 1
            return self.now >> self.left & 1

    header = Header()
    assert header.bit() and header.bit()
    zero_planes = 0
    while not header.bit():
        zero_planes += 1
    assert header.bit() == 0
    length_bits = 3
    while header.bit():
        length_bits += 1
    length = 0
    for _ in range(length_bits):
        length = length << 1 | header.bit()
    cleanup = body[header.at + (header.now == 0xFF) :][:length]
    assert len(cleanup) == length

    generator = random.Random(seed)
    rest = bytes(generator.randrange(255) for _ in range(width * height // 4 + 1))
    length_bits = max(len(cleanup), len(rest)).bit_length()
    bits = [1, 1] + [0] * zero_planes + [1] + [1, 1, 0, 0] + [1] * (length_bits - 3) + [0]
    bits += [len(cleanup) >> i & 1 for i in reversed(range(length_bits))]
    bits += [len(rest) >> i & 1 for i in reversed(range(length_bits + 1))]
    packed, count, now = bytearray(), 8, 0
    for bit in bits:
        count -= 1
        now |= bit << count
        if count == 0:
            packed.append(now)
            count, now = (7 if now == 0xFF else 8), 0
    if count < 8 and not (count == 7 and packed and packed[-1] == 0xFF):
        packed.append(now)
    if packed[-1] == 0xFF:
        packed.append(0)
    packets = bytes(packed) + cleanup + rest

    head = bytearray(without_comment(plain[: plain.index(b"\xff\x90")]))
    head[8:16] = head[24:32] = struct.pack(">II", width, height)
    at = head.index(b"\xff\x52")
    head[at + 9], head[at + 12] = 0, flags
    # One bit plane more than the cleanup pass leaves, for the two passes to refine.
    at = head.index(b"\xff\x5c")
    head[at:] = struct.pack(">HHBB", 0xFF5C, 4, head[at + 4], head[at + 5] + (1 << 3))
    return bytes(head) + struct.pack(">HHHIBB", 0xFF90, 10, 0, 14 + len(packets), 0, 1) + b"\xff\x93" + packets + b"\xff\xd9"


def keep(name, content):
    Path(__file__).parent.parent.joinpath("tests/it/common/codec/vectors", name).write_bytes(content)


def main():
    everything = openjpeg(
        formula(9, 7, 250, -100)[None], 12, True,
        "-n", "2", "-t", "6,7", "-d", "3,1", "-p", "RPCL", "-M", "63", "-r", "4,1", "-b", "4,8", "-c", "[8,8],[4,4]", "-EPH",
    )
    keep("everything.j2c", everything)
    y, x = numpy.mgrid[0:9, 0:9]
    smooth = numpy.stack([20 * x + 5 * y, 200 - 10 * x, 7 * x + 13 * y])
    keep("irreversible.j2c", openjpeg(smooth, 8, False, "-I", "-mct", "1", "-n", "4", "-r", "1"))
    quads = formula(9, 7, 65536).astype(numpy.uint16)
    keep("high-throughput.j2c", without_comment(imagecodecs.htj2k_encode(quads, reversible=True)))
    passes = high_throughput_passes(11, 9, 3)
    keep("three-passes.j2c", passes)
    # As OpenJPEG decodes it.
    keep("three-passes.samples", imagecodecs.jpeg2k_decode(passes).astype(numpy.uint8).tobytes())


if __name__ == "__main__":
    main()
