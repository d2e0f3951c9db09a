"""What a build and an import add to the process."""

import os
import subprocess
import sys

import numpy as np

#: Voxels along a side; 1024 with INFOBYTE_LONG.
SIDE = 1024 if os.environ.get("INFOBYTE_LONG") else 320

#: Builds a memory map within 8 MiB; prints what the peak of the process grew by, in KiB.
BUILD = """
import sys, numpy, infobyte
def peak(): return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1])
side = int(sys.argv[1])
array = numpy.memmap("a.raw", "u2", "r", shape=(side, side, side))
numpy.memmap("small.raw", "u2", "w+", shape=(16, 16, 16))[4:12, 4:12, 4:12] = 900
infobyte.build(numpy.memmap("small.raw", "u2", "r", shape=(16, 16, 16)), "small.oct", iso=500, memory="8MiB", threads=2, progress=False)
before = peak()
model = infobyte.build(array, "a.oct", iso=500, memory="8MiB", threads=2, progress=False)
print(peak() - before, len(model))
"""


def test_a_memory_map_is_built_within_6_mib():
    middle = (SIDE - 1) / 2
    axis = (np.arange(SIDE, dtype=np.float32) - middle) / middle
    flat = axis[:, None] ** 2 + axis**2
    with open("a.raw", "wb") as file:
        for z in axis:
            file.write(np.maximum(0, 1000 * (1.4 - flat - z * z)).astype("u2").tobytes())
    done = subprocess.run([sys.executable, "-c", BUILD, str(SIDE)], capture_output=True, text=True, check=True)
    grown, voxels = map(int, done.stdout.split())
    assert voxels > 2 * SIDE**2 and grown <= 6 << 10, f"{grown} KiB"
    print(f"{SIDE}: {grown} KiB")


IMPORT = """
import time
began = time.process_time()
import numpy
def rss(): return int(next(line for line in open("/proc/self/status") if line.startswith("VmRSS")).split()[1])
before, middle = rss(), time.process_time()
import infobyte
print(rss() - before, time.process_time() - middle, middle - began)
"""


def test_the_import_is_small_and_quick():
    """At most 6 MB beyond numpy, and 10 ms, or an eighth of numpy's time where the machine is busy; the best of five."""
    runs = [subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True) for _ in range(5)]
    kib, seconds, numpys = zip(*(map(float, run.stdout.split()) for run in runs))
    assert min(kib) * 1024 <= 6e6 and min(seconds) <= max(0.010, min(numpys) / 8), (kib, seconds, numpys)
