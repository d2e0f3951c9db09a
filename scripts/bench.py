#!/usr/bin/env python3
"""Times the command in one run and in turns, so that ratios survive a noisy machine. Asserts no time. Standard library only.

    scripts/bench.py                          the synthetic head at 512^3 and 1024^3, written first; 3 GB, some 15 minutes
    scripts/bench.py --sides 256 --rounds 3   smaller and shorter
    scripts/bench.py --volume 1024 FILE       u16 samples, 1024^3 of them, inside from 500, in place of the head
    scripts/bench.py --rows rays,pack         some rows: build, picture, rays, leaves, thumbnail, pack, mesh, sparse
    scripts/bench.py --form AVX2              a form of the kernels; without it the best that the machine has

Each row gives the least of the rounds, their spread, and its ratio to the row before it that is named as its reference.
`mesh` needs INFOBYTE_DATA; `sparse` builds a file of 8192^3 bytes, most of them holes, in 8 MiB, and is left out unless it is
named. Every form of the traversal beside the oracle: `cargo bench --bench rays`. Peers: bench_python.py (Open3D's Embree, VTK), bench_labels.py, bench_export.py, bench_measure.py.
"""

import argparse
import datetime
import os
import resource
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402

ROWS = ("build", "picture", "rays", "leaves", "thumbnail", "pack", "mesh", "sparse")
VIEWS = ("front", "left", "top", "iso")


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder, self.oct, self.table = args, folder, measure.find_oct(args.oct), []

    def path(self, name):
        return os.path.join(self.folder, name)

    def turns(self, ways, unit="CPU s"):
        """Rows of `ways`: name -> (reference's name or None, command, or a function that gives a figure and a remark)."""
        taken = {name: [] for name in ways}
        for _ in range(self.args.rounds):
            for name, (_, way) in ways.items():
                taken[name].append(way() if callable(way) else self.cpu(way))
        least = {name: min(all_) for name, all_ in taken.items()}
        for name, (reference, _) in ways.items():
            figure, remark = least[name]
            ratio = f"{figure / least[reference][0]:.2f} x {reference}" if reference else ""
            spread = 100 * (max(taken[name])[0] / figure - 1)
            self.table.append([name, f"{figure:.4g} {unit}", f"{spread:.0f} %", ratio, remark])
            print("  ".join(self.table[-1]), flush=True)

    def run(self, words):
        """The command's JSON, its CPU seconds, and its peak memory; refuses to go on after a failure."""
        words = words if words[0].startswith("/") else [self.oct, *words]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = measure.run(words)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.code != 0:
            raise SystemExit(f"{' '.join(words)} failed ({done.code}): {done.message()}")
        return done, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def cpu(self, words):
        done, seconds = self.run(words)
        return seconds, f"{done.wall_s:.3f} s, {done.worst_bytes() / (1 << 20):.1f} MiB"

    def stated(self, key, words):
        """A figure that the command's JSON states."""
        return lambda: (self.run([*words, "--json"])[0].json[key] * 1e3, "")

    def build(self, source, out, *options):
        return ["build", *source, "-o", out, "--force", "--quiet", "--json", "--scratch", self.folder, *options]

    def model(self, side, surface):
        """A model of the volume, built once."""
        out = self.path(f"{side}-{surface}.oct")
        if not os.path.exists(out):
            error = ["--error", "0.1"] if surface == "leaves" else ["--surface", surface]
            self.run(self.build(self.volume(side), out, *error))
        return out

    def volume(self, side):
        """Path and options of the volume of that side."""
        if path := dict(self.args.volume).get(str(side)):
            return [path, "--dims", "x".join([str(side)] * 3), "--dtype", "u16", "--iso", "500"]
        path = self.path(f"head-{side}.raw")
        if not os.path.exists(path):
            measure.write_demo(self.oct, side, path)
        return [path, "--dims", "x".join([str(side)] * 3), "--dtype", "i16", f"--iso={measure.DEMO_ISO}"]

    def row_build(self, side):
        source, out = self.volume(side), self.path("built.oct")
        ways = {f"cat, {side}": (None, ["/bin/sh", "-c", 'exec cat "$0" > /dev/null', source[0]])}
        for surface in ("skin", "cells"):
            for memory in ("8MiB", "1GiB"):
                name = f"build {surface}, {side}, {memory}"
                reference = f"cat, {side}" if surface == "skin" else f"build skin, {side}, {memory}"
                options = ["--surface", surface, "--memory", memory, "--threads", str(self.args.threads)]
                ways[name] = (reference, self.build(source, out, *options))
        self.turns(ways)

    def row_picture(self, side):
        skin, cells = self.model(side, "skin"), self.model(side, "cells")
        ways = {}
        for size in (1024, 320):
            for name, model in (("skin", skin), ("cells", cells)):
                words = ["render", model, "-o", self.path("p.png"), "--force", "--threads", "1", "--size", str(size)]
                reference = f"picture of skin, {side}, {size}^2" if name == "cells" else None
                ways[f"picture of {name}, {side}, {size}^2"] = (reference, self.stated("wall_s", words))
        self.turns(ways, "ms")

    def row_rays(self, side):
        ways = {}
        for view in VIEWS:
            for surface in ("skin", "cells"):
                words = ["render", self.model(side, surface), "-o", self.path("p.png"), "--force", "--threads", "1", "--size"]
                words += ["1024", "--view", view, "--samples", "1", "--shading", "plain"]
                reference = f"rays of skin, {side}, {view}" if surface == "cells" else None
                ways[f"rays of {surface}, {side}, {view}"] = (reference, self.stated("trace_s", words))
        self.turns(ways, "ms")

    def row_leaves(self, side):
        ways = {}
        for surface in ("cells", "leaves"):
            words = ["render", self.model(side, surface), "-o", self.path("p.png"), "--force", "--threads", "1", "--size"]
            words += ["1024", "--view", "iso", "--samples", "1", "--shading", "plain"]
            reference = f"rays of cells, {side}" if surface == "leaves" else None
            name = "rays of larger leaves" if surface == "leaves" else "rays of cells"
            ways[f"{name}, {side}"] = (reference, self.stated("trace_s", words))
        self.turns(ways, "ms")

    def row_thumbnail(self, side):
        def wall(surface):
            words = ["thumbnail", self.model(side, surface), "-o", self.path("t.png"), "--force"]

            def way():
                done, _ = self.run(words)
                return done.wall_s * 1e3, f"{done.worst_bytes() / (1 << 20):.1f} MiB"

            return way

        self.turns({f"thumbnail of {s}, {side}, whole process": (None, wall(s)) for s in ("skin", "cells")}, "ms")

    def row_pack(self, side):
        ways = {}
        for surface in ("skin", "cells"):
            model, packed = self.model(side, surface), self.path(f"{side}-{surface}.packed.oct")
            ways[f"pack {surface}, {side}"] = (None, ["pack", model, "-o", packed, "--force"])
            ways[f"unpack {surface}, {side}"] = (None, ["unpack", packed, "-o", self.path("u.oct"), "--force"])
        self.turns(ways)

    def row_mesh(self, _side):
        data = os.environ.get("INFOBYTE_DATA")
        bunny = data and os.path.join(data, "mesh", "bunny-closed.off")
        if not bunny or not os.path.exists(bunny):
            print("mesh: skipped: INFOBYTE_DATA names no folder with mesh/bunny-closed.off")
            return
        out = self.path("bunny.oct")
        self.turns({f"bunny to {s}, 1024": (None, self.build([bunny], out, "--grid", "1024", "--surface", s)) for s in ("skin", "cells")})

    def row_sparse(self, _side):
        """The volume of 1024^3 as bytes, in the middle of a file of 8192^3 that is made of holes."""
        source, side, inner = self.volume(1024), 8192, 1024
        low = (side - inner) // 2
        kind, iso = source[source.index("--dtype") + 1], int(source[-1].removeprefix("--iso="))
        path = self.path("sparse.raw")
        with open(source[0], "rb") as samples, open(path, "wb") as sparse:
            sparse.truncate(side**3)
            for z in range(inner):
                for y in range(inner):
                    row = memoryview(samples.read(2 * inner)).cast("h" if kind == "i16" else "H")
                    inside = bytes(value >= iso for value in row)
                    if any(inside):
                        sparse.seek(((z + low) * side + y + low) * side + low)
                        sparse.write(inside)
        words = self.build([path], self.path("sparse.oct"), "--dims", "x".join([str(side)] * 3), "--dtype", "u8", "--iso", "1")
        self.args.rounds = 1
        self.turns({"build skin, 8192, sparse": (None, [*words, "--surface", "skin", "--memory", "8MiB", "--threads", "1"])})
        os.remove(path)


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--sides", default="512,1024")
    args.add_argument("--volume", nargs=2, metavar=("N", "FILE"), action="append", default=[])
    args.add_argument("--rows", default=",".join(ROWS[:-1]))
    args.add_argument("--form", help="portable, AVX2 or AVX-512 VBMI2")
    args.add_argument("--oct", help="program to time (default: the release build)")
    args.add_argument("--threads", type=int, default=2, help="of builds")
    args.add_argument("--rounds", type=int, default=9)
    args.add_argument("--scratch", help="folder for models and scratch files (default: a temporary one)")
    args = args.parse_args()
    rows = args.rows.split(",")
    if unknown := set(rows) - set(ROWS):
        raise SystemExit(f"{', '.join(unknown)}: rows are {', '.join(ROWS)}")
    if args.form:
        os.environ["INFOBYTE_FORM"] = args.form
    with tempfile.TemporaryDirectory(prefix="oct-bench-", dir=args.scratch) as folder:
        bench = Bench(args, folder)
        for row in rows:
            for side in [0] if row in ("mesh", "sparse") else map(int, args.sides.split(",")):
                getattr(bench, f"row_{row}")(side)
    with open("/proc/cpuinfo", encoding="ascii", errors="replace") as info:
        name = next((line.split(":")[1].strip() for line in info if line.startswith("model name")), "unknown")
    print(f"\n{datetime.date.today()}, {name}, {os.cpu_count()} processors, {args.form or 'best form'}, {args.rounds} rounds\n")
    measure.table(["row", "least", "spread", "ratio", "wall, peak"], bench.table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
