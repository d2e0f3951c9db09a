#!/usr/bin/env python3
"""Measuring against its targets (docs/MEASURING.md), as ratios: above 1 is better than the target. Asserts nothing.

    scripts/bench_measure.py                     a noisy gyroid of 256^3, target/release/oct
    OCT=path/to/oct scripts/bench_measure.py 512
    scripts/bench_measure.py --volume 256 FILE   u16 samples, 256^3 of them, inside from 500, in place of the gyroid
    scripts/bench_measure.py --rows fit,pores    some rows: sides, mesh, speed, bytes, fit, thickness, pores, intervals, bodies

Needs numpy. Open3D and trimesh are run beside it on the model's own mesh where they are installed, one thread each; the bunny
needs Open3D and INFOBYTE_DATA. Times are CPU seconds, medians of rounds in turns; 256 takes some five minutes. Bodies are
sampled as a scanner would: blurred by half a voxel and averaged over each voxel.
"""

import argparse
import itertools
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

OCT = os.environ.get("OCT", "target/release/oct")
ROUNDS = 3

# What differs from run to run in a report.
MEASURED = ("peak_rss_bytes", "threads", "memory_budget_bytes", "memory_plan_bytes", "tile_columns", "stages_s")

# Where bodies lie from the middle of their volume: in general position.
OFF = np.array([0.13, -0.29, 0.41])


def oct_(*words):
    """The report of a command, and the CPU seconds that it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run([OCT, *map(str, words), "--json"], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run.returncode not in (0, 6, 7):
        sys.exit(run.stderr)
    return json.loads(run.stdout), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def turns(*ways):
    """Median CPU seconds of each way, in turns, and the last report of each."""
    taken = [[way() for way in ways] for _ in range(ROUNDS)]
    return [(runs[-1][0], statistics.median(seconds for _, seconds in runs)) for runs in zip(*taken)]


def row(name, found, target, is_more_better=True):
    """Prints a figure, its target and their ratio; a target of 0 is met or not."""
    ratio = found / target if is_more_better else target / found if found and target else float("inf") if target else float(not found)
    print(f"{name:<76} {found:>10.4g} {target:>8.4g} {ratio:>8.2f}", flush=True)


def skipped(name, what):
    print(f"{name:<76} skipped: no {what}", flush=True)


def length(p):
    return np.sqrt(np.einsum("...i,...i", p, p))


# Bodies: distances of places from the middle, below 0 inside.


def ball(radius):
    return lambda p: length(p) - radius


def torus(ring, tube):
    return lambda p: np.hypot(np.hypot(p[..., 0], p[..., 1]) - ring, p[..., 2]) - tube


def box(*half):
    def distance(p):
        over = np.abs(p) - half
        return length(np.maximum(over, 0)) + np.minimum(over.max(-1), 0)

    return distance


def samples(n, slices=1.0):
    """Places of the samples of a cube about the middle of a body, as z, y, x, coordinate."""
    z, y, x = np.meshgrid(np.arange(round(n / slices)) * slices, np.arange(n), np.arange(n), indexing="ij")
    return np.stack((x, y, z), -1) - (n / 2 + OFF)


def model_of(folder, name, values, *options, spacing="1x1x1"):
    """A model of samples given as z, y, x, above 0 inside."""
    raw, model = folder / "m.raw", folder / f"{name}.oct"
    values.astype("<f4").tofile(raw)
    dims = "x".join(map(str, values.shape[::-1]))
    oct_("build", raw, "-o", model, "--dims", dims, "--dtype", "f32", "--iso", 0, "--spacing", spacing, *options)
    return model


def table_of(path):
    """Rows of a table of cells: x, y, z, value, u95, area; NaN where nothing stands."""
    text = path.read_text().split("\n", 1)[1]
    for _ in range(2):
        text = text.replace(",,", ",nan,")
    return np.fromstring(text.replace("\n", ","), sep=",").reshape(-1, 6)


def compared(folder, *words):
    """The report of a comparison, and its rows that have a deviation and an area."""
    report, _ = oct_("compare", *words, "--csv", folder / "m.csv")
    rows = table_of(folder / "m.csv")
    return report, rows[np.isfinite(rows[:, 3]) & (rows[:, 5] > 0)]


def rms(errors, areas):
    return math.sqrt(np.average(errors**2, weights=areas))


def bodies(folder, _source):
    """RMS of deviations of three bodies grown by 2.3 voxels, over samples of their distances."""
    n = 128
    at = samples(n)
    for name, body, target in (
        ("ball", ball(0.38 * n), 0.010),
        ("torus", torus(0.27 * n, 0.12 * n), 0.012),
        ("box", box(0.3 * n, 0.23 * n, 0.18 * n), 0.006),
    ):
        depth = -body(at)
        plain, grown = (model_of(folder, by, depth + by) for by in (0, 2.3))
        _, rows = compared(folder, plain, grown, "--radius", 6)
        errors = rows[:, 3] - (body(rows[:, :3] - n / 2 - OFF) - 2.3)
        row(f"{name} to grown {name}: RMS, voxels", rms(errors, rows[:, 5]), target, False)
        _, rows = compared(folder, plain, plain)
        row(f"{name} to itself: cells that are not at 0", np.count_nonzero(rows[:, 3]), 0, False)
    _, rows = compared(folder, grown, plain, "--radius", 6)
    row("grown box to box: cells on the wrong side", np.count_nonzero(rows[:, 3] <= 0), 0, False)


def sides(folder, source):
    """Sides of random points, which are the cells of a volume of noise, and of a noisy volume's own."""
    n, count, points, wrong = 64, 72, 0, 0
    at, spacing = samples(n), "x".join([str(n / count)] * 3)
    for seed, body in enumerate((ball(0.38 * n), torus(0.27 * n, 0.12 * n), box(0.3 * n, 0.23 * n, 0.18 * n))):
        random = np.random.default_rng(seed).random((count,) * 3) - 0.5
        noise, model = model_of(folder, "noise", random, spacing=spacing), model_of(folder, "body", -body(at))
        _, rows = compared(folder, noise, model, "--radius", 2 * n, "--angle", 180)
        truth = body(rows[:, :3] - n / 2 - OFF)
        rows, truth = rows[np.abs(truth) > 0.6], truth[np.abs(truth) > 0.6]
        points, wrong = points + len(truth), wrong + np.count_nonzero((rows[:, 3] > 0) != (truth > 0))
    row(f"{points / 1e6:.2f} million random points about them, beyond .6 voxel: wrong sides", wrong, 0, False)
    name = f"{source.name} moved by .3, beyond .2 voxel: % on the wrong side"
    if not source.file or source.n > 512:
        return skipped(name, "--volume of at most 512")
    model = source.model(folder)
    _, rows = compared(folder, model, model, "--move", "0.3,0,0", "--angle", 180)
    rows = rows[np.abs(rows[:, 3]) > 0.2]
    low = np.clip(rows[:, :3].astype(int), 0, source.n - 2)
    part, value = rows[:, :3] - low, 0.0
    volume = np.memmap(source.file, "<u2", "r", shape=(source.n,) * 3)
    for corner in itertools.product((0, 1), repeat=3):
        weight = np.prod(np.where(corner, part, 1 - part), axis=1)
        value += weight * volume[tuple((low + corner).T[::-1])]
    row(name, 100 * np.mean((rows[:, 3] > 0) != (value < source.iso)), 0.1, False)


def bunny(folder):
    """The bunny's mesh and its model of 256 voxels, or none."""
    mesh = Path(os.environ.get("INFOBYTE_DATA", ""), "mesh", "bunny-closed.off")
    if not mesh.is_file():
        return None
    model = folder / "bunny.oct"
    report, _ = oct_("build", mesh, "-o", model, "--grid", 256, "--surface", "cells")
    return mesh, model, report["spacing_mm"][0], report["dims"]


def mesh(folder, _source):
    """Deviations of the bunny's model from its mesh, beside the distances of its triangles."""
    name = "bunny to its mesh, moved by .3: {} of the error, voxels"
    if not (found := bunny(folder)):
        return skipped(name.format("RMS"), "folder INFOBYTE_DATA with mesh/bunny-closed.off")
    triangles, model, voxel, _ = found
    try:
        scene, _ = open3d_scene(triangles)
    except ImportError as error:
        return skipped(name.format("RMS"), error.name)
    report, rows = compared(folder, model, triangles, "--move", f"{0.3 * voxel},0,0")
    row("bunny to its mesh: voxels of the mesh's grid in one of the model's", voxel / report["nominal_grid_mm"], 2)
    errors = np.abs(rows[:, 3] - scene_seconds(scene, rows[:, :3])[0]) / voxel
    row(name.format("RMS"), rms(errors, rows[:, 5]), 0.008, False)
    order = np.argsort(errors)
    part = np.cumsum(rows[order, 5]) / rows[:, 5].sum()
    row(name.format("p99"), errors[order][np.searchsorted(part, 0.99)], 0.035, False)


def bytes_(folder, _source):
    """Outputs at several numbers of threads and budgets of memory: how many differ from the first."""
    model, out, table = folder / "m.oct", folder / "out.oct", folder / "out.csv"
    volume = "synthetic:gyroid@96?noise=0.02"
    oct_("build", volume, "-o", model, "--uncertainty")

    def different(*words, budgets=(), outputs=(out, table)):
        made = []
        for threads, budget in itertools.product((1, 2, 5), budgets or [None]):
            how = ["--threads", threads, *(["--memory", budget] if budget else [])]
            report, _ = oct_(*words, *how, "-o", out, *(["--csv", table] if table in outputs else []))
            left = {key: value for key, value in report.items() if not key.endswith("_s") and key not in MEASURED}
            made.append((left, [path.read_bytes() for path in outputs]))
        return sum(one != made[0] for one in made), len(made)

    budgets = ("8MiB", "16MiB", "64MiB", "1GiB")
    for name, words, how in (
        ("build with --uncertainty", ["build", volume, "--uncertainty"], {"budgets": budgets, "outputs": (out,)}),
        ("comparison of volumes", ["compare", volume, volume + ",seed=2", "--move", "0.3,0,0"], {"budgets": budgets}),
        ("comparison of models, fitted", ["compare", model, model, "--move", "0.3,0,0", "--fit"], {}),
        ("thickness by ray", ["thickness", model], {}),
        ("thickness by ball", ["thickness", model, "--by", "ball", "--max", 8], {}),
    ):
        count, of = different(*words, **how)
        row(f"{name}: {of} budgets and threads that give other bytes", count, 0, False)


def turn_about(middle, degrees):
    """A turn about an axis in general position through a place, as three rows of four."""
    axis = np.array([1, 2, 3]) / math.sqrt(14)
    cross = np.cross(np.eye(3), axis)
    angle = math.radians(degrees)
    turn = np.eye(3) - math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return np.column_stack((turn, middle - turn @ middle))


def left_over(folder, actual, nominal, place):
    """What a fit of one part to itself leaves: RMS in mm from where each cell would lie, and the directions that are free."""
    words = ["--fit", "--place", ",".join(map(repr, place.ravel().tolist()))]
    report, rows = compared(folder, actual, nominal, *words)
    matrix = np.array(report["placement"]["matrix"])
    fitted = rows[:, :3]
    true = (fitted - matrix[:, 3]) @ matrix[:, :3]
    return rms(length(fitted - true), rows[:, 5]), report["placement"]["free"]


def fit(folder, _source):
    """What fits leave of a turn; a ball's rotation is free."""
    if found := bunny(folder):
        _, model, voxel, dims = found
        report, rows = compared(folder, model, model)
        middle = rows[:, :3].mean(0)
        for degrees in (5, 15, 30):
            left, _ = left_over(folder, model, model, turn_about(middle, degrees))
            row(f"bunny turned by {degrees} degrees: voxels left, RMS", left / voxel, 0.001, False)
        # Two scans of it: its mask, blurred by some half a voxel, with noise.
        oct_("export", model, "-o", folder / "bunny.nii")
        mask = np.fromfile(folder / "bunny.nii", np.uint8, offset=352).reshape(dims[::-1]).astype(np.float32)
        for axis in range(3):
            mask += (np.roll(mask, 1, axis) + np.roll(mask, -1, axis) - 2 * mask) / 6
        scans = []
        for seed in (1, 2):
            noise = np.random.default_rng(seed).standard_normal(mask.shape, np.float32)
            scans.append(model_of(folder, f"scan{seed}", mask - 0.5 + 0.025 * noise))
        for degrees in (5, 15, 30):
            left, _ = left_over(folder, *scans, turn_about(np.array(dims) / 2, degrees))
            row(f"two scans of it with 2.5 % noise, {degrees} degrees: voxels left, RMS", left, 0.005, False)
    else:
        skipped("bunny turned", "folder INFOBYTE_DATA with mesh/bunny-closed.off")
    model = model_of(folder, "m", -ball(24)(samples(64)))
    _, free = left_over(folder, model, model, turn_about(32 + OFF, 10))
    row("ball turned by 10 degrees: rotations named free", sum("rotation" in name for name in free), 3)


class Source:
    """The large volume: a file, or a noisy gyroid."""

    def __init__(self, n, file):
        self.n, self.file, self.iso = n, file, 500
        self.name = f"{'volume' if file else 'gyroid'} {n}^3"
        shape = ["--dims", "x".join([str(n)] * 3), "--dtype", "u16", "--iso", self.iso]
        self.words = [file, *shape] if file else [f"synthetic:gyroid@{n}?noise=0.02"]

    def model(self, folder):
        """Its model, built once."""
        path = folder / "source.oct"
        if not path.exists():
            oct_("build", *self.words, "-o", path)
        return path


def open3d_scene(mesh):
    """Open3D's scene of a mesh, and the CPU seconds of its tree."""
    import open3d

    shape = open3d.t.geometry.TriangleMesh.from_legacy(open3d.io.read_triangle_mesh(str(mesh)))
    start = time.process_time()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(shape)
    return scene, time.process_time() - start


def scene_seconds(scene, points):
    """Signed distances of points, above 0 outside, and the CPU seconds that they take."""
    import open3d

    points = open3d.core.Tensor(points.astype(np.float32))
    start = time.process_time()
    found = scene.compute_signed_distance(points, nthreads=1)
    return found.numpy(), time.process_time() - start


def speed(folder, source):
    """Cells a CPU second, memory, and the peers on the same points."""
    model, sure = source.model(folder), folder / "sure.oct"
    ways = (["-o", folder / "plain.oct"], ["-o", sure, "--uncertainty"])
    plain, uncertain = turns(*(lambda way=way: oct_("build", *source.words, "--threads", 1, *way) for way in ways))
    row(f"{source.name}: build with --uncertainty, times without", uncertain[1] / plain[1], 1.10, False)
    moved = lambda by: oct_("compare", model, model, "--move", f"{by},0,0", "--threads", 1, "--radius", 10)
    name = f"{source.name} moved by .3: times as fast as Open3D's signed distance"
    ways = [lambda: moved(0.3), lambda: moved(3)]
    try:
        if source.n > 512:
            raise ImportError(name="mesh of more than 512^3")
        mesh, (_, points) = folder / "m.ply", compared(folder, model, model, "--move", "0.3,0,0")
        oct_("export", model, "-o", mesh)
        scene, built = open3d_scene(mesh)
        ways.append(lambda: scene_seconds(scene, points[:, :3]))
    except ImportError as error:
        skipped(name, error.name)
    (near, seconds), (far, _), *peer = turns(*ways)
    row(f"{source.name} moved by .3: million cells a CPU second", near["cells"] / seconds / 1e6, 2)
    for by, report in ((0.3, near), (3, far)):
        row(f"{source.name} moved by {by}: peak MiB", report["peak_rss_bytes"] / 2**20, 8, False)
    for _, asked in peer:
        row(name, asked / seconds, 3 if source.n <= 256 else 8)
        row(name + ", with its tree", (asked + built) / seconds, 3 if source.n <= 256 else 8)
    reports = {}
    for by, target in (("ray", 3), ("ball", 1)):
        words = ["thickness", model, "--by", by, "--threads", 1, *(["--max", 8] if by == "ball" else [])]
        [(report, taken)] = turns(lambda: oct_(*words))
        reports[by] = report["cells"] / taken
        row(f"{source.name}, thickness by {by}: million cells a CPU second", reports[by] / 1e6, target)
    try:
        import trimesh

        shape = trimesh.load_mesh(mesh)
        start = time.process_time()
        trimesh.proximity.thickness(shape, points[:3000, :3], method="ray")
        row("thickness by ray: times as fast as trimesh", (time.process_time() - start) / 3000 * reports["ray"], 1)
    except ImportError as error:
        skipped("thickness by ray: times as fast as trimesh", error.name)


ROWS = {"bodies": bodies, "sides": sides, "mesh": mesh, "speed": speed, "bytes": bytes_, "fit": fit}


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("n", nargs="?", type=int, default=256)
    args.add_argument("--volume", nargs=2, metavar=("N", "FILE"))
    args.add_argument("--rows", default=",".join(ROWS))
    args = args.parse_args()
    n, file = args.volume or (args.n, None)
    source = Source(int(n), file)
    print(f"{'':<76} {'found':>10} {'target':>8} {'ratio':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.rows.split(","):
            ROWS[name](Path(folder), source)


main()
