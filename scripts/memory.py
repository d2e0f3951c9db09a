#!/usr/bin/env python3
"""Does `oct build` keep its memory cap? Runs a matrix of sample types, budgets and threads over volumes
made here and compares the peak resident size of the whole process with --memory. Standard library only.

    scripts/memory.py [--oct PATH] [--side 192] [--budgets 8MiB,64MiB] [--threads 1,2]
                      [--demo 512] [--cgroup]

Three volumes: `ball` (a noisy ball, CT-like), `noise` (every second voxel inside: all skin, the worst
case for records and scratch) and `wide` (large slices, which do not fit a small budget whole). For each,
the file must also be the same at every budget and thread count. --demo N adds the synthetic head as
`oct demo --write-raw` writes it; with --only-demo nothing else runs. (`oct demo` itself shows a picture
after its build, so the peak of that process is not the build's.) With --cgroup (root, Linux) each build
runs in a memory control group of its own, limited to the cap plus 1 MiB; there the page cache counts
too, so only the kernel's verdict matters, not the time.

Exit 1 on any breach of a cap, any failed build, or differing files. A build that refuses its budget
(exit 4) is shown as refused; it is a failure only with --no-refusals or if nothing was built at all.
"""

import argparse
import array
import hashlib
import os
import random
import sys
import tempfile

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402

CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f", "f64": "d"}
# Air and body of every type, and the noise's half-width.
LEVELS = {"u8": (20, 180, 15), "i8": (-100, 60, 15), "i16": (-1000, 300, 90), "f32": (-1.0, 0.3, 0.09)}
CGROUP_V1 = "/sys/fs/cgroup/memory"
CGROUP_V2 = "/sys/fs/cgroup"


def split_type(dtype):
    """Type without byte order, and whether it is big-endian."""
    return dtype.removesuffix("le").removesuffix("be"), dtype.endswith("be")


def levels(stem):
    """Air, body and noise of a type."""
    if stem in ("f32", "f64"):
        return LEVELS["f32"]
    if stem in LEVELS:
        return LEVELS[stem]
    return LEVELS["i16"] if stem.startswith("i") else (100, 1100, 90)


def iso(dtype):
    """Half way between air and body."""
    low, high, _ = levels(split_type(dtype)[0])
    return (low + high) / 2


def write_volume(path, kind, dims, dtype):
    """Writes one raw volume, the same at every call; rows are cut from prepared strips of noise."""
    stem, big = split_type(dtype)
    low, high, half = levels(stem)
    rng = random.Random(f"{kind} {dims} {stem}")
    nx, ny, nz = dims
    real = stem.startswith("f")

    def strip(level):
        draw = (lambda: rng.uniform(-half, half)) if real else (lambda: rng.randint(-half, half))
        values = array.array(CODES[stem], (level + draw() for _ in range(4 * nx)))
        if big:
            values.byteswap()
        return values

    if kind == "noise":
        values = array.array(CODES[stem], (rng.choice((low, high)) for _ in range(64 * nx)))
        if big:
            values.byteswap()
        mixed = values
    air, body = strip(low), strip(high)
    with open(path, "wb") as out:
        for z in range(nz):
            rows = array.array(CODES[stem])
            for y in range(ny):
                if kind == "noise":
                    at = rng.randrange(63 * nx)
                    rows += mixed[at:at + nx]
                    continue
                inside = 0.81 - (2 * y / ny - 1) ** 2 - (2 * z / nz - 1) ** 2
                half_row = int(nx / 2 * inside ** 0.5) if inside > 0 else 0
                edge = nx // 2 - half_row
                at = rng.randrange(2 * nx)
                rows += air[at:at + edge] + body[at:at + 2 * half_row] + air[at:at + nx - edge - 2 * half_row]
            out.write(rows.tobytes())


class Group:
    """A memory control group for one run, limited to so many bytes; removed at the end."""

    def __init__(self, limit_bytes):
        second = os.path.exists(os.path.join(CGROUP_V2, "cgroup.controllers"))
        root = CGROUP_V2 if second else CGROUP_V1
        self.path = os.path.join(root, f"oct-memory-{os.getpid()}")
        knob = os.path.join(self.path, "memory.max" if second else "memory.limit_in_bytes")
        try:
            os.mkdir(self.path)
            with open(knob, "w", encoding="ascii") as limit:
                limit.write(str(limit_bytes))
        except OSError as cause:
            if os.path.isdir(self.path):
                os.rmdir(self.path)
            raise SystemExit(f"{knob}: {cause.strerror}; --cgroup needs root and a writable memory controller")
        self.procs = os.path.join(self.path, "cgroup.procs")

    def __enter__(self):
        return self.procs

    def __exit__(self, *_):
        os.rmdir(self.path)


def digest(path):
    """Short hash of a file."""
    whole = hashlib.sha256()
    with open(path, "rb") as data:
        while block := data.read(1 << 20):
            whole.update(block)
    return whole.hexdigest()[:16]


def build(oct_path, raw, out, volume, budget, threads, cgroup):
    """One build under one budget."""
    kind, dims, dtype = volume
    level = measure.DEMO_ISO if kind == "demo" else iso(dtype)
    command = [oct_path, "build", raw, "-o", out, "--dims", "x".join(map(str, dims)), "--dtype", dtype,
               "--surface", "skin", f"--iso={level}", "--memory", budget, "--threads", threads, "--json"]
    if not cgroup:
        return measure.run(command)
    with Group(measure.size_bytes(budget) + (1 << 20)) as procs:
        return measure.run(command, procs)


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--oct", help="program to test (default: the release build)")
    args.add_argument("--side", type=int, default=192, help="edge of the cubes in voxels")
    args.add_argument("--wide", type=int, default=2048, help="edge of the wide slices; 0 leaves them out")
    args.add_argument("--dtypes", default="u8,i16,u16be,f32,f64")
    args.add_argument("--budgets", default="8MiB,16MiB,64MiB")
    args.add_argument("--threads", default="1,2")
    args.add_argument("--demo", type=int, metavar="N", help="also build the synthetic head, N cubed")
    args.add_argument("--only-demo", action="store_true", help="with --demo: nothing but that")
    args.add_argument("--no-refusals", action="store_true", help="every build has to fit its budget")
    args.add_argument("--cgroup", action="store_true", help="run in a memory control group of cap + 1 MiB")
    args = args.parse_args()
    oct_path = measure.find_oct(args.oct)

    cube = (args.side,) * 3
    volumes = [("demo", (args.demo,) * 3, "i16")] if args.demo else []
    if not args.only_demo:
        volumes += [("ball", cube, dtype) for dtype in args.dtypes.split(",")] + [("noise", cube, "u8")]
    if args.wide and not args.only_demo:
        volumes.append(("wide", (args.wide, args.wide, 12), "u16"))
    rows, failures, built = [], [], 0
    with tempfile.TemporaryDirectory(prefix="oct-memory-") as folder:
        raw, out = os.path.join(folder, "volume.raw"), os.path.join(folder, "model.oct")
        for kind, dims, dtype in volumes:
            if kind == "demo":
                measure.write_demo(oct_path, dims[0], raw)
            else:
                write_volume(raw, kind, dims, dtype)
            hashes = set()
            for budget in args.budgets.split(","):
                for threads in args.threads.split(","):
                    done = build(oct_path, raw, out, (kind, dims, dtype), budget, threads, args.cgroup)
                    cap, worst = measure.size_bytes(budget), done.worst_bytes()
                    verdict = "ok"
                    if worst > cap:
                        verdict = "BREACH"
                    elif done.code == 4:
                        verdict = "refused"
                    elif done.code != 0:
                        verdict = f"FAILED ({done.code})"
                    elif done.own_peak_bytes() == 0:
                        verdict = "NO OWN FIGURE"
                    if done.code == 0:
                        built += 1
                        hashes.add(digest(out))
                        os.remove(out)
                    name = f"{kind} {'x'.join(map(str, dims))} {dtype}, {budget}, {threads} threads"
                    if verdict != "ok" and (verdict != "refused" or args.no_refusals):
                        failures.append(f"{name}: {verdict} {done.message()}")
                    mib = lambda b: f"{b / (1 << 20):.2f}" if b else "-"
                    rows.append([f"{kind} {dims[0]}^2x{dims[2]}", dtype, budget, threads,
                                 mib(int(done.json.get("memory_plan_bytes", 0) or 0)), mib(done.own_peak_bytes()),
                                 mib(done.peak_bytes), f"{100 * worst / cap:.0f} %", f"{done.wall_s:.2f}", verdict])
            if len(hashes) > 1:
                failures.append(f"{kind} {dtype}: {len(hashes)} different files for the same input")
    print(f"Peak resident size in MiB; outside figure by {done.how}"
          + (", in a control group of cap + 1 MiB" if args.cgroup else ""))
    measure.table(["volume", "type", "cap", "threads", "plan", "own", "outside", "of cap", "wall s", ""], rows)
    if not built:
        failures.append("nothing was built")
    for failure in failures:
        print(f"FAIL {failure}", file=sys.stderr)
    print(f"{built} built, {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
