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

# Standard deviation of the blur of half a voxel and of the voxel itself, the part of it that is exact, and its integral.
BLUR, EDGE = math.sqrt(0.25 + 1 / 12), 0.4
STEPS = np.linspace(-8, 8, 4001)
INTEGRAL = np.array([(1 + math.erf(x / math.sqrt(2))) / 2 for x in STEPS])

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
    print(f"{name:<76} {found:>10.4g} {target:>8.4g} {min(ratio, 999):>8.2f}", flush=True)


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


def plate(thick):
    return lambda p: np.abs(p[..., 2]) - thick / 2


def shell(low, high):
    return lambda p: np.abs(length(p) - (low + high) / 2) - (high - low) / 2


def tube(low, high):
    return lambda p: np.abs(np.hypot(p[..., 0], p[..., 1]) - (low + high) / 2) - (high - low) / 2


def cylinder(radius):
    return lambda p: np.hypot(p[..., 0], p[..., 1]) - radius


def gyroid_sheet(period, thick):
    """To first order: exact at the surface."""

    def distance(p):
        (sx, sy, sz), (cx, cy, cz) = (np.moveaxis(way(p * (2 * np.pi / period)), -1, 0) for way in (np.sin, np.cos))
        value = sx * cy + sy * cz + sz * cx
        slope = np.sqrt((cx * cy - sz * sx) ** 2 + (cy * cz - sx * sy) ** 2 + (cz * cx - sy * sz) ** 2)
        return (np.abs(value) - np.pi * thick / period * 1.5) / np.maximum(slope, 0.3) * period / (2 * np.pi)

    return distance


def turn_about(middle, degrees):
    """A turn about an axis in general position through a place, as three rows of four."""
    axis = np.array([1, 2, 3]) / math.sqrt(14)
    cross = np.cross(np.eye(3), axis)
    angle = math.radians(degrees)
    turn = np.eye(3) - math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return np.column_stack((turn, middle - turn @ middle))


def turned(body):
    turn = turn_about(np.zeros(3), 40)[:, :3]
    return lambda p: body(p @ turn)


def taps(slices):
    """Places and weights along an axis of a blur, and of the mean over a slice that is thicker than a voxel."""
    count = round(slices / 0.6) if slices > 1 else 1
    step = slices / count if slices > 1 else 0.6
    normal = np.exp(-((step * np.arange(-2, 3)) ** 2) / 2 / (BLUR**2 - EDGE**2))
    weights = np.convolve(normal / normal.sum(), np.full(count, 1 / count))
    return list(zip(step * (np.arange(len(weights)) - (len(weights) - 1) / 2), weights))


def scanned(body, at, slices=1.0):
    """The part of a body in each sample, as a scanner sees it: blurred, and averaged over the voxel."""
    distance = body(at)
    value = (distance < 0).astype(float)
    near = np.abs(distance) < 3 + slices / 2
    places, value[near] = at[near], 0
    # Where the surface bends, the part of the blur that is taken along the distance moves it, too.
    steps = 0.5 * np.concatenate((np.eye(3), -np.eye(3)))
    bend = np.clip((sum(body(places + step) for step in steps) - 6 * distance[near]) * 2, -0.35, 0.35)
    for (x, wx), (y, wy), (z, wz) in itertools.product(taps(1), taps(1), taps(slices)):
        if (weight := wx * wy * wz) > 1e-5:
            value[near] += weight * np.interp(-body(places + (x, y, z)) / EDGE - EDGE * bend, STEPS, INTEGRAL)
    return value


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


def same_bytes(folder, _source):
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
        row(f"{name}, {of} budgets and numbers of threads: other bytes", count, 0, False)


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


def scanned_ball(radius, at):
    """The same of a ball, in closed form."""
    away = np.maximum(length(at), 1e-9)
    low, high = (radius - away) / BLUR, (radius + away) / BLUR
    between = np.interp(low, STEPS, INTEGRAL) + np.interp(high, STEPS, INTEGRAL) - 1
    return between - BLUR / (away * math.sqrt(2 * math.pi)) * (np.exp(-(low**2) / 2) - np.exp(-(high**2) / 2))


def thickness(folder, _source):
    """RMS of thickness on walls, away from the rims at the border of the volume."""
    n, lost = 128, 0
    at = samples(n)
    for name, body, thick, target in (
        ("plate of 6", plate(6), 6, 0.035),
        ("turned plate of 6", turned(plate(6)), 6, 0.035),
        ("shell of 42 to 50", shell(42, 50), 8, 0.035),
        ("turned tube of 30 to 36", turned(tube(30, 36)), 6, 0.035),
        ("plate of 2", plate(2), 2, 0.03),
        ("turned plate of 2", turned(plate(2)), 2, 0.03),
        ("shell of 2", shell(45, 47), 2, 0.03),
    ):
        model = model_of(folder, "m", scanned(body, at) - 0.5)
        for by in ("ray", "ball"):
            oct_("thickness", model, "--by", by, "--csv", folder / "m.csv")
            rows = table_of(folder / "m.csv")
            rows = rows[((rows[:, :3] > 12) & (rows[:, :3] < n - 13)).all(1) & (rows[:, 5] > 0)]
            known = np.isfinite(rows[:, 3])
            lost += np.count_nonzero(~known) if by == "ray" else 0
            row(f"{name}, thickness by {by}: RMS, voxels", rms(rows[known, 3] - thick, rows[known, 5]), target, False)
    row("all of them: rays that find nothing", lost, 0, False)


def pores(folder, _source):
    """Volumes of 188 balls of 1 to 10 voxels in a ball of 140 across, none nearer than 3 voxels to another."""
    n, random, holes = 160, np.random.default_rng(4), []
    for radius in np.geomspace(10, 1, 188):
        while True:
            place = random.uniform(-70, 70, 3)
            gaps = [length(place - other) - radius - more for other, more in holes]
            if length(place) + radius < 66 and min(gaps, default=9) > 3:
                break
        holes.append((place, radius))
    at = samples(n)
    value = scanned_ball(70, at)
    for place, radius in holes:
        low = np.floor(place - radius - 4 + n / 2 + OFF).astype(int)[::-1]
        window = tuple(slice(c, c + 2 * math.ceil(radius) + 10) for c in low)
        value[window] -= scanned_ball(radius, at[window] - place)
    report, _ = oct_("pores", model_of(folder, "m", value - 0.5), "--csv", folder / "m.csv")
    found = np.genfromtxt(folder / "m.csv", delimiter=",", names=True)
    errors, missed = [], 0
    for place, radius in holes:
        away = length(np.stack([found[axis] for axis in "xyz"], -1) - (n / 2 + OFF) - place)
        missed += away.min() > max(1, radius / 4)
        errors.append(100 * (found["volume_mm3"][away.argmin()] / (4 / 3 * np.pi * radius**3) - 1))
    radii, errors = np.array([radius for _, radius in holes]), np.array(errors)
    for low, high in ((3, 10), (3, 6), (6, 10)):
        mean = errors[(radii >= low) & (radii <= high)].mean()
        row(f"pores with radii of {low} to {high} voxels: % that their volume is off, mean", abs(mean), 4, False)
    row("pores with radii of 1 to 10 voxels: found", report["pores"] - missed, len(holes))


def covered(folder, body, slices, noises, correlated=False, seed=0):
    """Least part of the cells, in %, whose 95 % interval holds the truth, over noises in % of the step."""
    n, held = 128, []
    value = scanned(body, samples(n, slices), slices)
    for number, noise in enumerate(noises):
        random = np.random.default_rng((seed, number)).standard_normal(value.shape)
        for axis in range(3) if correlated else ():
            # Neighbours are alike by .6.
            random = (random + 0.392 * (np.roll(random, 1, axis) + np.roll(random, -1, axis))) / math.sqrt(1 + 2 * 0.392**2)
        values = 1000 * (value - 0.5 + noise / 100 * random)
        model = model_of(folder, "m", values, "--uncertainty", spacing=f"1x1x{slices}")
        # Beside itself both parts are the same: each has the interval over the root of 2.
        _, rows = compared(folder, model, model)
        rows = rows[np.isfinite(rows[:, 4])]
        off = body(rows[:, :3] - n / 2 - OFF)
        held.append(100 * np.mean(np.abs(off) <= rows[:, 4] / math.sqrt(2)))
    return min(held)


def intervals(folder, _source):
    """How many of the 95 % intervals hold the truth: five bodies that a part of them was fitted to, and two others."""
    usual, others = (0.2, 1, 2.5, 5, 10), (0.5, 3, 8)
    bodies = {
        "ball of 50": ball(50),
        "torus of 36 and 15": torus(36, 15),
        "turned box": turned(box(40, 30, 24)),
        "gyroid sheet": gyroid_sheet(64, 8),
        "turned plate of 4": turned(plate(4)),
    }
    held_out = {"turned cylinder of 30": turned(cylinder(30)), "ball of 33.7": ball(33.7)}
    for some, noises, slices in ((bodies, usual, (1, 3)), (held_out, others, (1, 2, 5))):
        for (name, body), thick in itertools.product(some.items(), slices):
            least = covered(folder, body, thick, noises)
            row(f"{name}, slices {thick} x, {len(noises)} noises: least % of intervals that hold", least, 92)
    for name, body in bodies.items():
        least = covered(folder, body, 1, (2.5,), True)
        row(f"{name}, noise of 2.5 % alike by .6: % of intervals that hold", least, 92)


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


ROWS = {"bodies": bodies, "sides": sides, "mesh": mesh, "speed": speed, "bytes": same_bytes, "fit": fit, "thickness": thickness, "pores": pores, "intervals": intervals}


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
