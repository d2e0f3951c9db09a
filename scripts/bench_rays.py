#!/usr/bin/env python3
"""Rays per second of every form of the traversal, with a peer beside it, in one run. Asserts no time; the
program does assert that all forms hit the same. Standard library only.

    scripts/bench_rays.py MODEL.oct...                     finished models
    scripts/bench_rays.py --demo 256,512                   synthetic heads, built first
    scripts/bench_rays.py MODEL.oct --peer "PROGRAM MESH.ply 1024"

--peer runs any program after the models, once for each time the option is given, and prints what it prints:
for a fair comparison one that casts rays at a mesh of the same surface with the same camera (described in
benches/rays.rs). Other options go to the bench: --size, --rounds, --threads, --random, --ways.
"""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("models", nargs="*", metavar="MODEL.oct")
    args.add_argument("--demo", metavar="N,...", help="sides of synthetic heads to build and measure")
    args.add_argument("--peer", action="append", default=[], metavar="COMMAND")
    args.add_argument("--oct", help="program that builds the heads (default: the release build)")
    args, others = args.parse_known_args()
    if not args.models and not args.demo:
        raise SystemExit("give a MODEL.oct, or --demo N")
    here = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    with tempfile.TemporaryDirectory(prefix="oct-rays-") as folder:
        models = [os.path.abspath(model) for model in args.models]
        for side in args.demo.split(",") if args.demo else []:
            model = os.path.join(folder, f"head-{side}.oct")
            subprocess.run(
                [measure.find_oct(args.oct), "demo", "-o", model, "--size", side, "--quiet"], check=True
            )
            models.append(model)
        bench = ["cargo", "bench", "--locked", "--quiet", "--bench", "rays", "--", *models, *others]
        done = subprocess.run(bench, cwd=here, check=False)
        if done.returncode != 0:
            raise SystemExit(done.returncode)
    for peer in args.peer:
        print(f"peer: {peer}", flush=True)
        subprocess.run(shlex.split(peer), check=True)


if __name__ == "__main__":
    main()
