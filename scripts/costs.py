#!/usr/bin/env python3
"""What memory costs beside the buffers that code asks for: measures the figures of src/budget/costs.rs, cleaning and batches again
and prints each beside the one that stands there. Standard library only; Linux.

    scripts/costs.py [--oct PATH] [--runs 12] [code] [spreads] [workers] [cleaning] [batch]

All parts run if none is named. `code` watches RssFile of builds through every reader that can be fed from
here, of cleaning, ranges and Otsu's threshold, while they hold most. `spreads` repeats one job: its plan differs by what was held
when it began, its refusal by what opening took. `workers` and `cleaning` compare what is anonymous in builds
that differ in one thing. `batch` compares batches of small volumes. A measured figure above the stated one
is marked, and the exit code is 1: raise the constant, then run tests/it/memory.rs and scripts/memory.py.

Figures of allocations alone are counted in tests, one by one:

    cargo test --release --test it -- --nocapture budget:: catalogue_memory::
"""

import argparse
import bz2
import gzip
import json
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import zlib

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402

TOP = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
KIB = 1 << 10


def stated():
    """Constants of costs.rs, cleaning and batches by name, in bytes, for an optimised program."""
    text = ""
    for path in ("budget/costs.rs", "clean/mod.rs", "jobs/batch/mod.rs"):
        with open(os.path.join(TOP, "src", path), encoding="utf-8") as source:
            text += source.read()
    found = {}
    for name, value in re.findall(r"^(?:pub )?const (\w+): u(?:64|size) = ((?:if|\d)[^;]+);", text, re.MULTILINE):
        value = value.split("else {")[-1].strip(" }") if "else" in value else value
        found[name] = eval(value, {"__builtins__": {}})  # a number, or a shift of one  # noqa: S307
    return found


class Watched:
    """One run: what was resident while it ran, its exit code and its JSON object."""

    def __init__(self, command):
        self.seen = []  # (RssAnon, RssFile), in bytes, as often as they could be read
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            process = subprocess.Popen([str(c) for c in command], stdin=subprocess.DEVNULL, stdout=out, stderr=err)
            while process.poll() is None:
                self.look(process.pid)
            self.code = process.returncode
            out.seek(0)
            err.seek(0)
            stdout, self.stderr = out.read().decode("utf-8", "replace"), err.read().decode("utf-8", "replace")
        try:
            self.json = json.loads(stdout)
        except ValueError:
            self.json = {}

    def look(self, pid):
        """Reads what is resident now."""
        try:
            with open(f"/proc/{pid}/status", encoding="ascii", errors="replace") as status:
                kib = {key: int(rest.split()[0]) for key, _, rest in (line.partition(":") for line in status)
                       if key in ("RssFile", "RssAnon")}
            self.seen.append((kib["RssAnon"] * KIB, kib["RssFile"] * KIB))
        except (OSError, ValueError, IndexError, KeyError):
            return

    @property
    def anon(self):
        """Largest RssAnon."""
        return max(anon for anon, _ in self.seen)

    @property
    def file(self):
        """Largest RssFile while the job held what weighs: starting up and opening have no buffers beside them."""
        return max(file for anon, file in self.seen if anon >= 0.75 * self.anon)


class Lab:
    """The program, a folder of inputs, and the table of results."""

    def __init__(self, oct_path, folder, runs):
        self.oct, self.folder, self.runs = oct_path, folder, runs
        self.stated, self.rows, self.over = stated(), [], 0

    def at(self, *parts):
        return os.path.join(self.folder, *parts)

    def build(self, source, *extra, memory="64MiB", threads=1, ok=(0,)):
        """One build, watched."""
        surface = [] if "--surface" in extra else ["--surface", "skin"]
        done = Watched([self.oct, "build", source, "-o", self.at("m.oct"), "--memory", memory, "--threads", threads,
                        "--json", *surface, *extra])
        if done.code not in ok:
            raise SystemExit(f"{source} {extra}: exit {done.code}: {done.stderr.strip()}")
        return done

    def tell(self, name, measured, how):
        """One line of the table."""
        most = self.stated[name]
        mark = "" if measured <= most else "ABOVE"
        self.over += bool(mark)
        self.rows.append([name, f"{most / KIB:.0f}", f"{measured / KIB:.0f}", mark, how])


def samples(dims, seed=5):
    """A noisy ball, i16, as bytes."""
    nx, ny, nz = dims
    rng = random.Random(seed)
    noise = [rng.randint(-90, 90) for _ in range(4 * nx)]
    out = bytearray()
    for z in range(nz):
        for y in range(ny):
            rest = 0.81 - (2 * y / ny - 1) ** 2 - (2 * z / nz - 1) ** 2
            half = int(nx / 2 * rest ** 0.5) if rest > 0 else 0
            at = rng.randrange(3 * nx)
            row = [(300 if abs(x - nx // 2) < half else -1000) + noise[at + x] for x in range(nx)]
            out += struct.pack(f"<{nx}h", *row)
    return bytes(out)


def nifti(dims, voxels):
    """A NIfTI-1 file."""
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *dims, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 4, 16)
    struct.pack_into("<8f", head, 76, 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into("<f", head, 108, 352)
    head[344:348] = b"n+1\0"
    return bytes(head) + voxels


def png(width, height, row_bytes):
    """A grey PNG of 8 bits."""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    rows = b"".join(b"\0" + row_bytes[y * width:(y + 1) * width] for y in range(height))
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def write_inputs(lab):
    """One volume in many formats: name, and the options that it needs."""
    dims = (256, 256, 48)
    voxels = samples(dims)
    size = "x".join(map(str, dims))
    head = f"type: short\ndimension: 3\nsizes: {size.replace('x', ' ')}\nendian: little\nencoding: "
    npy = str({"descr": "<i2", "fortran_order": False, "shape": dims[::-1]}).ljust(117) + "\n"
    files = {
        "v.raw": voxels,
        "v.nii": nifti(dims, voxels),
        "v.nii.gz": gzip.compress(nifti(dims, voxels), 1),
        "v.nrrd": f"NRRD0004\n{head}raw\n\n".encode() + voxels,
        "b.nrrd": f"NRRD0004\n{head}bzip2\n\n".encode() + bz2.compress(voxels, 9),
        "v.npy": b"\x93NUMPY\x01\x00" + struct.pack("<H", len(npy)) + npy.encode() + voxels,
    }
    for name, content in files.items():
        with open(lab.at(name), "wb") as out:
            out.write(content)
    os.mkdir(lab.at("png"))
    grey = bytes(v & 255 for v in voxels[1::2])
    for z in range(dims[2]):
        with open(lab.at("png", f"{z:03}.png"), "wb") as out:
            out.write(png(dims[0], dims[1], grey[z * dims[0] * dims[1]:(z + 1) * dims[0] * dims[1]]))
    raw = ("v.raw", "--dims", size, "--dtype", "i16")
    return raw, [raw] + [(name,) for name in files if name != "v.raw"] + [("png",)]


def code(lab, raw, inputs):
    """RssFile over readers and stages, optimised code."""
    jobs = [(name, *extra, "--otsu") for name, *extra in inputs]
    jobs += [(*raw, *more) for more in (
        ("--iso=-300",), ("--range=100..350",), ("--iso=-300", "--channels", "normal,value"),
        ("--iso=-300", "--keep-largest", "1", "--close", "2", "--fill-cavities"))]
    most, which = 0, ""
    for name, *extra in jobs:
        for threads in (1, 2):
            seen = max(lab.build(lab.at(name), *extra, threads=threads).file for _ in range(3))
            if seen > most:
                most, which = seen, f"{name} {' '.join(extra[-2:])}"
    lab.tell("CODE_BYTES", most, f"largest RssFile, {which}")


def spreads(lab, raw):
    """The same job again and again."""
    source, extra = lab.at(raw[0]), (*raw[1:], "--iso=-300")
    plans = [lab.build(source, *extra).json["memory_plan_bytes"] for _ in range(lab.runs)]
    lab.tell("HELD_SPREAD", max(plans) - min(plans), f"plans of {lab.runs} equal builds")
    refused = [measure.run([lab.oct, "build", source, "-o", lab.at("m.oct"), "--surface", "skin", *extra, "--memory", "1MiB"]).peak_bytes
               for _ in range(lab.runs)]
    lab.tell("OPENING_SPREAD", max(refused) - min(refused), f"peaks of {lab.runs} refused builds")


def workers(lab, raw):
    """Anonymous memory by the number of threads, less what the plan reserves for buffers."""
    rng = random.Random(7)
    with open(lab.at("noise.raw"), "wb") as out:
        out.write(bytes(rng.choice((20, 180)) for _ in range(256 * 256 * 48)))
    source = lab.at("noise.raw")
    extra = ("--dims", raw[2], "--dtype", "u8", "--iso", "100", "--channels", "normal,value")
    one, two = ([lab.build(source, *extra, threads=n) for _ in range(lab.runs)] for n in (1, 2))
    anon = max(b.anon for b in two) - min(a.anon for a in one)
    plan = min(b.json["memory_plan_bytes"] for b in two) - max(a.json["memory_plan_bytes"] for a in one)
    lab.tell("WORKER_OVERHEAD", anon - (plan - lab.stated["WORKER_OVERHEAD"]), "second thread on noise, less its buffers")


def cleaning(lab, raw):
    """What the build finds resident after cleaning, beyond what it finds without."""
    source, extra = lab.at(raw[0]), (*raw[1:], "--iso=-300")
    plain = min(lab.build(source, *extra).json["memory_plan_bytes"] for _ in range(lab.runs))
    most = 0
    for how in (("--keep-largest", "1"), ("--close", "2"), ("--fill-cavities",)):
        done = [lab.build(source, *extra, *how, threads=2) for _ in range(3)]
        seen = [d.json["memory_plan_bytes"] for d in done if d.json["threads"] == 1]
        seen += [lab.build(source, *extra, *how).json["memory_plan_bytes"] for _ in range(3)]
        most = max([most, *seen])
    # A reading thread of the cleaned volume holds bits of some rows: 32 KiB and a row twice.
    lab.tell("CLEANING_LEFT_OVER", most - plain - 33 * KIB, "plan of a cleaned build, less a plain one")


def batch(lab):
    """Batches of small volumes, one job and four at a time."""
    os.mkdir(lab.at("many"))
    dims = (64, 64, 32)
    for n in range(24):
        with open(lab.at("many", f"{n}.nii.gz"), "wb") as out:
            out.write(gzip.compress(nifti(dims, samples(dims, n)), 1))
    seen = {}
    for jobs in (1, 4):
        runs = []
        for run in range(3):
            out = lab.at(f"out-{jobs}-{run}")
            runs.append(Watched([lab.oct, "batch", lab.at("many"), "--out", out, "--iso=-300", "--jobs", jobs,
                                 "--threads", jobs, "--memory", "64MiB", "--thumbnails", "64", "--json"]))
            if runs[-1].code != 0:
                raise SystemExit(f"batch: exit {runs[-1].code}: {runs[-1].stderr.strip()}")
        seen[jobs] = max(r.file for r in runs), max(r.anon for r in runs)
    lab.tell("BATCH_CODE", max(0, seen[4][0] - lab.stated["CODE_BYTES"]), "RssFile of four jobs, less that of a stage")
    each = (seen[4][1] - seen[1][1]) // 3
    lab.tell("JOB_OVERHEAD", max(0, each - lab.stated["MIN_JOB"]), "RssAnon of a job more, less the least build")


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("parts", nargs="*", help="code, spreads, workers, cleaning, batch")
    args.add_argument("--oct", help="program to measure (default: the release build)")
    args.add_argument("--runs", type=int, default=12, help="how often a job is repeated for its spread")
    args = args.parse_args()
    parts = args.parts or ["code", "spreads", "workers", "cleaning", "batch"]
    with tempfile.TemporaryDirectory(prefix="oct-costs-") as folder:
        lab = Lab(measure.find_oct(args.oct), folder, args.runs)
        raw, inputs = write_inputs(lab)
        for part in parts:
            {"code": lambda: code(lab, raw, inputs), "spreads": lambda: spreads(lab, raw),
             "workers": lambda: workers(lab, raw), "cleaning": lambda: cleaning(lab, raw),
             "batch": lambda: batch(lab)}[part]()
    measure.table(["figure, KiB", "stated", "measured", "", "how"], lab.rows)
    return 1 if lab.over else 0


if __name__ == "__main__":
    sys.exit(main())
