#!/usr/bin/env python3
"""Times `oct build` against `cat` of the same file, in one run and in turns, because only ratios
survive a noisy machine. Asserts no time. Standard library only.

    scripts/bench.py FILE --dims NXxNYxNZ --dtype u16 --iso 500     any raw volume
    scripts/bench.py --demo 512                                     the synthetic head, written first

The file is read once beforehand, so the page cache is warm if memory allows. Every round runs `cat` and
then each setting once; medians over the rounds are printed, with the stage times of the median run.
"""

import argparse
import os
import statistics
import sys
import tempfile

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402


def cat(path):
    """Wall seconds of reading the file and throwing it away."""
    # Through sh: `cat FILE > /dev/null`, as a user would type it.
    done = measure.run(["/bin/sh", "-c", 'exec cat "$0" > /dev/null', path])
    if done.code != 0:
        raise SystemExit(done.message())
    return done.wall_s


def demo(oct_path, side, folder):
    """Writes the synthetic head as raw samples; returns path and build options."""
    path = os.path.join(folder, f"head-{side}.raw")
    measure.write_demo(oct_path, side, path)
    return path, ["--dims", f"{side}x{side}x{side}", "--dtype", "i16", f"--iso={measure.DEMO_ISO}"]


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("file", nargs="?", help="raw volume")
    args.add_argument("--dims", help="NXxNYxNZ")
    args.add_argument("--dtype", default="u16")
    args.add_argument("--iso", default="500")
    args.add_argument("--demo", type=int, metavar="N", help="use the synthetic head, N cubed, instead of a file")
    args.add_argument("--surface", default="skin", help="skin (the default, as the figures are), or cells")
    args.add_argument("--oct", help="program to time (default: the release build)")
    args.add_argument("--budgets", default="8MiB,1GiB")
    args.add_argument("--threads", default="1,2")
    args.add_argument("--rounds", type=int, default=5)
    args.add_argument("--scratch", help="folder for the models and scratch files (default: a temporary one)")
    args = args.parse_args()
    if not args.demo and not (args.file and args.dims):
        raise SystemExit("give a raw FILE with --dims, or --demo N")
    oct_path = measure.find_oct(args.oct)

    with tempfile.TemporaryDirectory(prefix="oct-bench-", dir=args.scratch) as folder:
        if args.demo:
            path, options = demo(oct_path, args.demo, folder)
        else:
            path, options = args.file, ["--dims", args.dims, "--dtype", args.dtype, f"--iso={args.iso}"]
        out = os.path.join(folder, "model.oct")
        settings = [(b, t) for t in args.threads.split(",") for b in args.budgets.split(",")]
        cats, runs = [], {setting: [] for setting in settings}
        cat(path)
        for _ in range(args.rounds):
            cats.append(cat(path))
            for budget, threads in settings:
                done = measure.run([oct_path, "build", path, "-o", out, *options, "--surface", args.surface, "--memory", budget,
                                    "--threads", threads, "--scratch", folder, "--json"])
                if done.code != 0:
                    raise SystemExit(f"build at {budget}, {threads} threads failed ({done.code}): {done.message()}")
                runs[budget, threads].append(done)
        bytes_read = os.path.getsize(path)

    floor = statistics.median(cats)
    print(f"{os.path.basename(path)}: {bytes_read / 1e9:.3f} GB; {args.rounds} rounds; {os.cpu_count()} processors")
    print(f"cat FILE > /dev/null: median {floor:.3f} s, range {min(cats):.3f} to {max(cats):.3f} s\n")
    rows, medians = [], {}
    for (budget, threads), done in runs.items():
        walls = [d.wall_s for d in done]
        middle = sorted(done, key=lambda d: d.wall_s)[len(done) // 2]
        medians[budget, threads] = middle.wall_s
        stage = lambda key: f"{middle.json[key]:.3f}" if isinstance(middle.json.get(key), (int, float)) else "-"
        rows.append([f"{budget}, {threads} threads", f"{middle.wall_s:.3f}", f"{min(walls):.3f}", f"{max(walls):.3f}",
                     f"{middle.wall_s / floor:.2f}", stage("read_s"), stage("build_s"), stage("write_s"),
                     f"{max(d.worst_bytes() for d in done) / (1 << 20):.2f}"])
    measure.table(["oct build", "wall s", "min", "max", "x cat", "read s", "build s", "write s", "peak MiB"], rows)
    budgets = args.budgets.split(",")
    for threads in args.threads.split(","):
        ratio = medians[budgets[0], threads] / medians[budgets[-1], threads]
        print(f"cost of the cap, {threads} threads: {budgets[0]} takes {ratio:.2f} times as long as {budgets[-1]}")
    facts = next(iter(runs.values()))[-1].json
    for key in ("skin_voxels", "nodes", "bytes", "bytes_per_skin_voxel", "scratch_bytes"):
        print(f"{key}: {facts.get(key, '-')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
