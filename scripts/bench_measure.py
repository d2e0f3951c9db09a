#!/usr/bin/env python3
"""Measuring against its targets (docs/MEASURING.md), as ratios: above 1 is better than the target. Asserts nothing.

    scripts/bench_measure.py                     with a noisy gyroid of 256^3, target/release/oct
    OCT=path/to/oct scripts/bench_measure.py 512
    scripts/bench_measure.py --volume 256 FILE   u16 samples, 256^3 of them, inside from 500, in place of the gyroid
    scripts/bench_measure.py --rows pores        of bodies, sides, bunny, speed, same_bytes, thickness, pores, intervals

Needs numpy; `bunny` needs INFOBYTE_DATA. Open3D and trimesh are run on the model's own mesh where they are
installed, one thread each. Times are CPU seconds, medians of rounds in turns. 256 takes some six minutes.
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
from types import SimpleNamespace

import numpy as np

OCT = os.environ.get("OCT", "target/release/oct")
ROUNDS = 3
# Report entries, apart from times, that threads and budgets may change.
MEASURED = ("peak_rss_bytes", "threads", "memory_budget_bytes", "memory_plan_bytes", "tile_columns")
# Where a body lies from the middle of its volume: in general position.
OFF = np.array([0.13, -0.29, 0.41])
# Standard deviations of a blur of half a voxel with the voxel itself, and of the part of it that needs no sums.
BLUR, EDGE = math.sqrt(0.25 + 1 / 12), 0.4
STEPS = np.linspace(-8, 8, 4001)
INTEGRAL = np.array([(1 + math.erf(x / math.sqrt(2))) / 2 for x in STEPS])


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
    """Prints a figure and its target; a target of 0 is met (1) or not (0)."""
    over, under = (found, target) if is_more_better else (target, found)
    ratio = over / under if under else 999 if over else 1
    print(f"{name:<88} {found:>10.4g} {target:>8.4g} {min(ratio, 999):>8.2f}", flush=True)


def skipped(name, what):
    """Prints that a figure is not measured."""
    print(f"{name:<88} skipped: no {what}", flush=True)


# Bodies: distances of places from the middle, below 0 inside.
length = lambda p: np.sqrt(np.einsum("...i,...i", p, p))
ball = lambda radius: lambda p: length(p) - radius
cylinder = lambda radius: lambda p: np.hypot(p[..., 0], p[..., 1]) - radius
torus = lambda ring, tube: lambda p: np.hypot(cylinder(ring)(p), p[..., 2]) - tube
out_of = lambda over: length(np.maximum(over, 0)) + np.minimum(over.max(-1), 0)
box = lambda *half: lambda p: out_of(np.abs(p) - half)
wall = lambda middle, thick: lambda p: np.abs(middle(p)) - thick / 2
plate = lambda thick: wall(lambda p: p[..., 2], thick)
turned = lambda body: lambda p: body(p @ turn_about(np.zeros(3), 40)[:, :3])


def gyroid_sheet(p, period=64, level=0.6):
    """Both sides of a gyroid, to first order: exact at the surface."""
    (sx, sy, sz), (cx, cy, cz) = (np.moveaxis(way(p * (2 * np.pi / period)), -1, 0) for way in (np.sin, np.cos))
    slope = np.sqrt((cx * cy - sz * sx) ** 2 + (cy * cz - sx * sy) ** 2 + (cz * cx - sy * sz) ** 2)
    return (np.abs(sx * cy + sy * cz + sz * cx) - level) / np.maximum(slope, 0.3) * period / (2 * np.pi)


def three_bodies(n):
    """Names, bodies and greatest errors in a volume of n^3."""
    yield "ball", ball(0.38 * n), 0.010
    yield "torus", torus(0.27 * n, 0.12 * n), 0.012
    yield "box", box(0.3 * n, 0.23 * n, 0.18 * n), 0.006


def turn_about(middle, degrees):
    """A turn through a place about an axis in general position, as three rows of four."""
    cross = np.cross(np.eye(3), np.array([1, 2, 3]) / math.sqrt(14))
    angle = math.radians(degrees)
    turn = np.eye(3) - math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return np.column_stack((turn, middle - turn @ middle))


def samples(n, slices=1):
    """Places of the samples of a volume about the middle of its body, as z, y, x, coordinate."""
    z, y, x = np.meshgrid(np.arange(round(n / slices)) * slices, np.arange(n), np.arange(n), indexing="ij")
    return np.stack((x, y, z), -1) - (n / 2 + OFF)


def taps(slices):
    """Places and weights along an axis of a blur, and of the mean over a slice that is thicker than a voxel."""
    count = round(slices / 0.6) if slices > 1 else 1
    step = slices / count if slices > 1 else 0.6
    normal = np.exp(-((step * np.arange(-2, 3)) ** 2) / 2 / (BLUR**2 - EDGE**2))
    weights = np.convolve(normal / normal.sum(), np.full(count, 1 / count))
    return list(zip(step * (np.arange(len(weights)) - (len(weights) - 1) / 2), weights))


def scanned(body, at, slices=1):
    """The part of a body in each sample, as a scanner sees it: blurred, and averaged over the voxel."""
    distance = body(at)
    near = np.abs(distance) < 2.2 + slices / 2
    value, places = np.where(near, 0, distance < 0).astype(float), at[near]
    # Where the surface bends, the part of the blur that is taken along the distance moves it, too.
    bend = sum(body(places + step) for step in 0.25 * np.concatenate((np.eye(3), -np.eye(3))))
    shift = 8 * EDGE * (bend - 6 * distance[near])
    shift[np.abs(shift) > 0.35 * EDGE] = 0  # at a ridge of the distances
    total = 0
    for (x, wx), (y, wy), (z, wz) in itertools.product(taps(1), taps(1), taps(slices)):
        if (weight := wx * wy * wz) > 1e-4:
            total += weight
            value[near] += weight * np.interp(-body(places + (x, y, z)) / EDGE - shift, STEPS, INTEGRAL)
    value[near] /= total
    return value


def scanned_ball(radius, at, blur):
    """The same of a ball with a blur, in closed form."""
    away = np.maximum(length(at), 1e-9)
    low, high = (radius - away) / blur, (radius + away) / blur
    between = np.interp(low, STEPS, INTEGRAL) + np.interp(high, STEPS, INTEGRAL) - 1
    return between - blur / (away * math.sqrt(2 * math.pi)) * (np.exp(-(low**2) / 2) - np.exp(-(high**2) / 2))


def model_of(folder, name, values, *options, spacing="1x1x1"):
    """A model of samples given as z, y, x, above 0 inside."""
    raw, model = folder / "m.raw", folder / f"{name}.oct"
    values.astype("<f4").tofile(raw)
    shape = ["--dims", "x".join(map(str, values.shape[::-1])), "--dtype", "f32", "--spacing", spacing]
    oct_("build", raw, "-o", model, "--iso", 0, *shape, *options)
    return model


def measured(folder, *words):
    """The report of a command, and rows of its table: x, y, z, value, u95, area; NaN where nothing stands."""
    report, _ = oct_(*words, "--csv", folder / "m.csv")
    text = (folder / "m.csv").read_text().split("\n", 1)[1].replace(",,", ",nan,").replace(",,", ",nan,")
    rows = np.fromstring(text.replace("\n", ","), sep=",").reshape(-1, 6)
    return report, rows[rows[:, 5] > 0]


def compared(folder, *words):
    """The report of a comparison, and the rows that have a deviation."""
    report, rows = measured(folder, "compare", *words)
    return report, rows[np.isfinite(rows[:, 3])]


def rms(errors, rows):
    """Root mean square of errors, weighted by the areas of their rows."""
    return math.sqrt(np.average(errors**2, weights=rows[:, 5]))


def bodies(folder, _source):
    """Deviations of three bodies grown by 2.3 voxels, over samples of their distances; a fit of one."""
    n = 128
    for name, body, target in three_bodies(n):
        plain, grown = (model_of(folder, by, by - body(samples(n))) for by in (0, 2.3))
        _, rows = compared(folder, plain, grown, "--radius", 6)
        errors = rows[:, 3] - (body(rows[:, :3] - n / 2 - OFF) - 2.3)
        row(f"{name} to grown {name}: RMS, voxels", rms(errors, rows), target, False)
        _, rows = compared(folder, plain, plain)
        row(f"{name} to itself: cells that are not at 0", np.count_nonzero(rows[:, 3]), 0, False)
        if name == "ball":
            _, free = left_over(folder, plain, plain, turn_about(n / 2 + OFF, 10))
            row("ball turned by 10 degrees: rotations named free", sum("rotation" in one for one in free), 3)
    _, rows = compared(folder, grown, plain, "--radius", 6)
    row("grown box to box: cells on the wrong side", np.count_nonzero(rows[:, 3] <= 0), 0, False)


def sides(folder, source):
    """Sides of random points, which are the cells of a volume of noise, and of a noisy volume's own."""
    n, count, points, wrong = 64, 72, 0, 0
    for seed, (_, body, _) in enumerate(three_bodies(n)):
        random = np.random.default_rng(seed).random((count,) * 3) - 0.5
        noise = model_of(folder, "noise", random, spacing="x".join([str(n / count)] * 3))
        _, rows = compared(folder, noise, model_of(folder, "m", -body(samples(n))), "--radius", 2 * n, "--angle", 180)
        truth = body(rows[:, :3] - n / 2 - OFF)
        far = np.abs(truth) > 0.6
        points, wrong = points + far.sum(), wrong + np.sum((rows[:, 3] > 0)[far] != (truth > 0)[far])
    row(f"{points / 1e6:.2f} million random points beyond .6 voxel: wrong sides", wrong, 0, False)
    name = f"{source.name} moved by .3, beyond .2 voxel: % on the wrong side"
    if not source.file or source.n > 512:
        return skipped(name, "volume of at most 512^3 given")
    _, rows = compared(folder, source.model, source.model, "--move", "0.3,0,0", "--angle", 180)
    rows = rows[np.abs(rows[:, 3]) > 0.2]
    low = np.clip(rows[:, :3].astype(int), 0, source.n - 2)
    part, value = rows[:, :3] - low, 0.0
    volume = np.memmap(source.file, "<u2", "r", shape=(source.n,) * 3)
    for corner in itertools.product((0, 1), repeat=3):
        weight = np.prod(np.where(corner, part, 1 - part), axis=1)
        value += weight * volume[tuple((low + corner).T[::-1])]
    row(name, 100 * np.mean((rows[:, 3] > 0) != (value < 500)), 0.1, False)


def left_over(folder, actual, nominal, place):
    """What a fit of a part to itself leaves: RMS in mm from where its cells are, and the directions that are free."""
    words = ["--fit", "--place", ",".join(map(repr, place.ravel().tolist()))]
    report, rows = compared(folder, actual, nominal, *words)
    matrix = np.array(report["placement"]["matrix"])
    before = (rows[:, :3] - matrix[:, 3]) @ matrix[:, :3]
    return rms(length(rows[:, :3] - before), rows), report["placement"]["free"]


def bunny(folder, _source):
    """The bunny against the distances of its triangles, and what fits leave of its turns."""
    mesh = Path(os.environ.get("INFOBYTE_DATA", ""), "mesh", "bunny-closed.off")
    if not mesh.is_file():
        return skipped("bunny to its mesh, fits", "folder INFOBYTE_DATA with mesh/bunny-closed.off")
    model, name = folder / "bunny.oct", "bunny to its mesh, moved by .3: {} of the error, voxels"
    built, _ = oct_("build", mesh, "-o", model, "--grid", 256, "--surface", "cells")
    voxel, dims = built["spacing_mm"][0], built["dims"]
    report, rows = compared(folder, model, mesh, "--move", f"{0.3 * voxel},0,0")
    row("bunny to its mesh: voxels of the mesh's grid in one of the model's", voxel / report["nominal_grid_mm"], 2)
    try:
        errors = np.abs(rows[:, 3] - open3d_scene(mesh)[0](rows[:, :3])[0]) / voxel
        row(name.format("RMS"), rms(errors, rows), 0.008, False)
        order = np.argsort(errors)
        last = np.searchsorted(np.cumsum(rows[order, 5]), 0.99 * rows[:, 5].sum())
        row(name.format("p99"), errors[order][last], 0.035, False)
    except ImportError as error:
        skipped(name.format("RMS"), error.name)
    # Two scans of it: its mask, blurred by some half a voxel, with noise.
    oct_("export", model, "-o", folder / "bunny.nii")
    mask = np.fromfile(folder / "bunny.nii", np.uint8, offset=352).reshape(dims[::-1]).astype(np.float32)
    for axis in range(3):
        mask += (np.roll(mask, 1, axis) + np.roll(mask, -1, axis) - 2 * mask) / 6
    noise = (np.random.default_rng(seed).standard_normal(mask.shape, np.float32) for seed in (1, 2))
    scans = [model_of(folder, f"scan{i}", mask - 0.5 + 0.025 * one) for i, one in enumerate(noise)]
    middle = rows[:, :3].mean(0)
    for degrees in (5, 15, 30):
        left, _ = left_over(folder, model, model, turn_about(middle, degrees))
        row(f"bunny turned by {degrees} degrees and fitted: RMS left, voxels", left / voxel, 0.001, False)
        left, _ = left_over(folder, *scans, turn_about(np.array(dims) / 2, degrees))
        row(f"two scans of it with 2.5 % noise, {degrees} degrees: RMS left, voxels", left, 0.005, False)


def open3d_scene(mesh):
    """A function of points that gives signed distances and the CPU seconds that they and the tree took."""
    import open3d

    shape = open3d.t.geometry.TriangleMesh.from_legacy(open3d.io.read_triangle_mesh(str(mesh)))
    start = time.process_time()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(shape)
    built = time.process_time() - start

    def distances(points):
        points, start = open3d.core.Tensor(points.astype(np.float32)), time.process_time()
        return scene.compute_signed_distance(points, nthreads=1).numpy(), time.process_time() - start

    return distances, built


def speed(folder, source):
    """Cells a CPU second, memory, and the peers on the same points."""
    build = lambda *how: oct_("build", *source.words, "-o", folder / "built.oct", "--threads", 1, *how)
    (_, plain), (_, sure) = turns(build, lambda: build("--uncertainty"))
    row(f"{source.name}: build with --uncertainty, times without", sure / plain, 1.10, False)
    model, mesh, is_small = source.model, folder / "m.ply", source.n <= 512
    moved = lambda by: oct_("compare", model, model, "--move", f"{by},0,0", "--threads", 1, "--radius", 10)
    ways, name = [lambda: moved(0.3), lambda: moved(3)], f"{source.name} moved by"
    peer = f"{name} .3: times as fast as Open3D's signed distance"
    try:
        if is_small:
            oct_("export", model, "-o", mesh)
            _, rows = compared(folder, model, model, "--move", "0.3,0,0")
            distances, built = open3d_scene(mesh)
            ways.append(lambda: distances(rows[:, :3]))
    except ImportError as error:
        skipped(peer, error.name)
    (near, seconds), (far, _), *others = turns(*ways)
    row(f"{name} .3: million cells a CPU second", near["cells"] / seconds / 1e6, 2)
    row(f"{name} .3: peak MiB", near["peak_rss_bytes"] / 2**20, 8, False)
    row(f"{name} 3: peak MiB", far["peak_rss_bytes"] / 2**20, 8, False)
    for _, asked in others:
        row(peer, asked / seconds, 3 if source.n <= 256 else 8)
        row(f"{peer} and its tree", (asked + built) / seconds, 3 if source.n <= 256 else 8)
    for by, target, how in (("ball", 1, ["--max", 8]), ("ray", 3, [])):
        [(report, taken)] = turns(lambda: oct_("thickness", model, "--by", by, "--threads", 1, *how))
        row(f"{source.name}, thickness by {by}: million cells a CPU second", report["cells"] / taken / 1e6, target)
    try:
        if is_small:
            import trimesh

            shape, start = trimesh.load_mesh(mesh), time.process_time()
            trimesh.proximity.thickness(shape, rows[:3000, :3], method="ray")
            peer = (time.process_time() - start) / 3000
            row("thickness by ray: times as fast as trimesh", peer * report["cells"] / taken, 1)
    except ImportError as error:
        skipped("thickness by ray: times as fast as trimesh", error.name)


def same_bytes(folder, _source):
    """Models, tables and reports at some numbers of threads and budgets of memory: how many differ from the first."""
    volume, model = "synthetic:gyroid@96?noise=0.02", folder / "m.oct"
    out, table = folder / "out.oct", folder / "out.csv"
    oct_("build", volume, "-o", model, "--uncertainty")
    budgets = [["--memory", size] for size in ("8MiB", "16MiB", "64MiB", "1GiB")]
    moved = ["--move", "0.3,0,0", "--csv", table]
    for name, caps, words in (
        ("build with --uncertainty", budgets, ["build", volume, "--uncertainty"]),
        ("comparison of volumes", budgets, ["compare", volume, volume + ",seed=2", *moved]),
        ("comparison of models, fitted", [[]], ["compare", model, model, "--fit", *moved]),
        ("thickness by ray", [[]], ["thickness", model, "--csv", table]),
        ("thickness by ball", [[]], ["thickness", model, "--by", "ball", "--max", 8, "--csv", table]),
    ):
        made = []
        for threads, cap in itertools.product((1, 2, 5), caps):
            report, _ = oct_(*words, "-o", out, "--threads", threads, *cap)
            left = [item for item in report.items() if not item[0].endswith("_s") and item[0] not in MEASURED]
            made.append((left, out.read_bytes(), table in words and table.read_bytes()))
        kind = "1, 2, 5 threads" + (" in 8 MiB to 1 GiB" if cap else "")
        row(f"{name}, {kind}: other bytes", sum(one != made[0] for one in made), 0, False)


def thickness(folder, _source):
    """Thickness of walls, away from the rims at the border of the volume."""
    n, lost = 128, 0
    for name, body, thick, target in (
        ("plate of 6", plate(6), 6, 0.035),
        ("turned plate of 6", turned(plate(6)), 6, 0.035),
        ("shell of 42 to 50", wall(ball(46), 8), 8, 0.035),
        ("turned tube of 30 to 36", turned(wall(cylinder(33), 6)), 6, 0.035),
        ("plate of 2", plate(2), 2, 0.03),
        ("turned plate of 2", turned(plate(2)), 2, 0.03),
        ("shell of 45 to 47", wall(ball(46), 2), 2, 0.03),
    ):
        model = model_of(folder, "m", scanned(body, samples(n)) - 0.5)
        for by in ("ray", "ball"):
            _, rows = measured(folder, "thickness", model, "--by", by)
            rows = rows[(np.abs(rows[:, :3] - n / 2) < n / 2 - 12).all(1)]
            known = rows[np.isfinite(rows[:, 3])]
            lost += len(rows) - len(known) if by == "ray" else 0
            row(f"{name}, thickness by {by}: RMS, voxels", rms(known[:, 3] - thick, known), target, False)
    row("all of these: rays that find nothing", lost, 0, False)


def pores(folder, _source):
    """Volumes of 188 balls of 1 to 10 voxels in a ball of 140 across, none nearer than 3 voxels to another."""
    n, random, radii, holes = 160, np.random.default_rng(4), np.geomspace(10, 1, 188), []
    for radius in radii:
        place = np.full(3, 70.0)
        while length(place) + radius > 66 or any(length(place - c) < radius + r + 3 for c, r in holes):
            place = random.uniform(-70, 70, 3)
        holes.append((place, radius))
    at = samples(n)
    for name, blur in (("blur of .5", 0.5), ("and the voxel", BLUR)):
        value = scanned_ball(70, at, blur)
        for place, radius in holes:
            low = np.floor(place - radius - 4 + n / 2 + OFF).astype(int)[::-1]
            window = tuple(slice(c, c + 2 * math.ceil(radius) + 10) for c in low)
            value[window] -= scanned_ball(radius, at[window] - place, blur)
        oct_("pores", model_of(folder, "m", value - 0.5), "--csv", folder / "m.csv")
        table = np.genfromtxt(folder / "m.csv", delimiter=",", names=True)
        found = np.stack([table[axis] for axis in "xyz"], -1) - (n / 2 + OFF)
        away = np.array([length(found - place) for place, _ in holes])
        errors = 100 * np.abs(table["volume_mm3"][away.argmin(1)] / (4 / 3 * np.pi * radii**3) - 1)
        for low, high in ((3, 10), (3, 6), (6, 10)):
            mean = errors[(radii >= low) & (radii <= high)].mean()
            row(f"pores with radii of {low} to {high} voxels, {name}: mean error of the volume, %", mean, 4, False)
        near = away.min(1) < np.maximum(1, radii / 4)
        row(f"pores with radii of 1 to 10 voxels, {name}: found", np.sum(near), len(holes))


def intervals(folder, _source):
    """Least parts of 95 % intervals that hold the truth: of bodies that they were fitted to, and of two others."""
    n, usual, others = 128, (0.2, 1, 2.5, 5, 10), (0.5, 3, 8)  # noises in % of the step
    fitted = {"ball of 50": ball(50), "torus of 36 and 15": torus(36, 15), "turned box": turned(box(40, 30, 24))}
    fitted |= {"gyroid sheet": gyroid_sheet, "turned plate of 4": turned(plate(4))}
    held_out = {"turned cylinder of 30": turned(cylinder(30)), "ball of 33.7": ball(33.7)}
    cases = [(one, usual, thick, 0) for one in fitted.items() for thick in (1, 3)]
    cases += [(one, (2.5,), 1, 0.392) for one in fitted.items()]
    cases += [(one, others, thick, 0) for one in held_out.items() for thick in (1, 2, 5)]
    for (name, body), noises, thick, mixed in cases:
        parts = []
        value = scanned(body, samples(n, thick), thick)
        for seed, noise in enumerate(noises):
            random = np.random.default_rng(seed).standard_normal(value.shape)
            for axis in range(3):
                random = random + mixed * (np.roll(random, 1, axis) + np.roll(random, -1, axis))
            values = 1000 * (value - 0.5 + noise / 100 * random / math.sqrt(1 + 2 * mixed**2) ** 3)
            model = model_of(folder, "m", values, "--uncertainty", spacing=f"1x1x{thick}")
            # Of a model and itself, each has the interval over the root of 2; sharp edges have none.
            _, rows = compared(folder, model, model)
            rows = rows[np.isfinite(rows[:, 4])]
            parts.append(100 * np.mean(np.abs(body(rows[:, :3] - n / 2 - OFF)) <= rows[:, 4] / math.sqrt(2)))
        kind = f"noise {' '.join(map(str, noises))} %" + (", correlated by .6" if mixed else "")
        row(f"{name}, slices {thick} x, {kind}: intervals that hold, %", min(parts), 92)


ROWS = {way.__name__: way for way in (bodies, sides, bunny, speed, same_bytes, thickness, pores, intervals)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", nargs="?", type=int, default=256)
    parser.add_argument("--volume", nargs=2, metavar=("N", "FILE"))
    parser.add_argument("--rows", default=",".join(ROWS))
    args = parser.parse_args()
    n, file = (int(args.volume[0]), args.volume[1]) if args.volume else (args.n, None)
    raw = [file, "--dims", f"{n}x{n}x{n}", "--dtype", "u16", "--iso", 500]
    words = raw if file else [f"synthetic:gyroid@{n}?noise=0.02"]
    print(f"{'':<88} {'found':>10} {'target':>8} {'ratio':>8}")
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)
        oct_("build", *words, "-o", folder / "source.oct")
        name = f"{'volume' if file else 'gyroid'} {n}^3"
        source = SimpleNamespace(n=n, file=file, words=words, name=name, model=folder / "source.oct")
        for way in args.rows.split(","):
            ROWS[way](folder, source)


main()
