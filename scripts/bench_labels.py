#!/usr/bin/env python3
"""Times surfaces of all labels of a map: `oct build` and `oct export`, pyvista's `contour_labels` and zmesh, in turns.

    scripts/bench_labels.py                 100 balls in 256^3, and a body of 117 parts in 256^3 and 512^3

Each runs in a process of its own. CPU seconds are user and system: of `oct` from start to file, of a peer from the array in
memory to its meshes. Medians of the rounds. Needs numpy and SciPy; peers that are not installed are named so.
"""

import argparse
import os
import statistics
import sys
import tempfile

sys.dont_write_bytecode = True
import measure  # noqa: E402

PEERS = {
    "zmesh": "m = zmesh.Mesher((1, 1, 1)); m.mesh(v); n = sum(len(m.get(i).faces) for i in m.ids())",
    "contour_labels": "n = image.contour_labels(smoothing=False).n_cells",
    "contour_labels, smoothed": "n = image.contour_labels(smoothing=True).n_cells",
}
SCRIPT = """import time
import numpy as np
import {module}
v = np.fromfile({path!r}, np.uint8).reshape(({side},) * 3)
if {module!r} == "pyvista":
    image = pyvista.ImageData(dimensions=({side},) * 3)
    image["l"] = v.ravel()
    image.set_active_scalars("l")
start = time.process_time()
{text}
print(time.process_time() - start)
"""


def balls(side, count=100):
    """Balls of 5 to 20 voxels anywhere; later ones lie over earlier ones."""
    import numpy as np

    random, volume = np.random.default_rng(1), np.zeros((side,) * 3, np.uint8)
    for label in range(1, count + 1):
        radius, middle = random.uniform(5, 20), random.uniform(24, side - 24, 3)
        low = np.floor(middle - radius).astype(int)
        grid = np.indices((int(2 * radius) + 3,) * 3).reshape(3, -1).T + low
        inside = grid[((grid - middle) ** 2).sum(1) < radius**2]
        volume[tuple(inside.T)] = label
    return volume


def body(side, parts=117):
    """Parts with curved walls that fill a ball, each the points that are nearest to its own seed."""
    import numpy as np
    from scipy.spatial import cKDTree

    random = np.random.default_rng(3)
    seeds = random.uniform(-1, 1, (400, 3))
    tree = cKDTree(seeds[(seeds**2).sum(1) < 0.8][:parts])
    volume = np.zeros((side,) * 3, np.uint8)
    for z in range(side):
        place = np.stack(np.meshgrid([z], range(side), range(side), indexing="ij"), -1).reshape(-1, 3)
        place = (place + 0.5) / side * 2 - 1
        inside = (place**2).sum(1) < 0.9
        bent = place[inside] + 0.03 * np.sin(14 * place[inside][:, [1, 2, 0]])
        volume[z].reshape(-1)[inside] = tree.query(bent)[1] + 1
    return volume


def timed(command):
    """CPU seconds, as it says itself or of the whole process, and peak MiB of a command; `None` where it fails."""
    before = os.times()
    done = measure.run(command)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    said = done.stdout.strip()
    if done.code != 0:
        return None
    return (float(said) if said.replace(".", "", 1).isdigit() else cpu), done.peak_bytes / 2**20


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--oct", help="program to time (default: the release build)")
    args.add_argument("--rounds", type=int, default=3)
    args.add_argument("--only", help="a part of a volume's name")
    args = args.parse_args()
    oct_path = measure.find_oct(args.oct)
    volumes = [("balls 256", balls, 256), ("body 256", body, 256), ("body 512", body, 512)]
    for name, make, side in volumes:
        if args.only and args.only not in name:
            continue
        with tempfile.TemporaryDirectory(prefix="oct-labels-") as folder:
            path, model = os.path.join(folder, "v.raw"), os.path.join(folder, "m.oct")
            make(side).tofile(path)
            raw = [path, "--dims", f"{side}x{side}x{side}", "--dtype", "u8"]
            one = ["--threads", "1", "--force"]
            commands = {
                "build, threshold, skin": [oct_path, "build", *raw, "--iso", "1", "--surface", "skin", "-o", model, *one],
                "build, labels, 16 MiB": [oct_path, "build", *raw, "--labels", "all", "--memory", "16MiB", "-o", model, *one],
                "export to PLY": [oct_path, "export", model, "-o", os.path.join(folder, "m.ply"), "--force"],
            }
            for peer, text in PEERS.items():
                module = "pyvista" if "image" in text else "zmesh"
                script = SCRIPT.format(path=path, side=side, module=module, text=text)
                commands[peer] = [sys.executable, "-c", script]
            found = {what: [] for what in commands}
            for _ in range(args.rounds):
                for what, command in commands.items():
                    one_run = timed(command)
                    if one_run:
                        found[what].append(one_run)
            print(f"{name}: CPU s (of each round), peak MiB")
            for what, runs in found.items():
                if not runs:
                    print(f"  {what:26} not there")
                    continue
                cpu = ", ".join(f"{run[0]:.2f}" for run in sorted(runs))
                print(f"  {what:26} {statistics.median(run[0] for run in runs):6.2f} ({cpu}) {max(run[1] for run in runs):7.0f}")


if __name__ == "__main__":
    main()
