#!/usr/bin/env python3
"""Measuring against its targets (docs/MEASURING.md), as ratios: above 1 is better than the target. Asserts nothing.

    scripts/bench_measure.py                    target/release/oct at 256^3
    OCT=path/to/oct scripts/bench_measure.py 512

Needs numpy. Open3D and trimesh are run beside it on the model's own mesh where they are installed, one thread each. Times are
CPU seconds, medians of rounds in turns.
"""

import json
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
    ratio = found / target if is_more_better else target / found if found else float("inf")
    print(f"{name:<58} {found:>10.4g} {target:>8.4g} {ratio:>8.2f}")


def skipped(name, package):
    print(f"{name:<58} skipped: no {package}")


def body_errors(folder):
    """RMS of deviations of three bodies grown by 2.3 voxels, over samples of their distances."""
    n = 128
    grid = np.stack(np.meshgrid(*[np.arange(n, dtype=float)] * 3, indexing="ij"), -1)
    c = np.array([n * 0.5 + 0.13, n * 0.5 - 0.29, n * 0.5 + 0.41])

    def ball(p):
        return np.linalg.norm(p - c, axis=-1) - 0.38 * n

    def torus(p):
        q = p - c
        return np.hypot(np.hypot(q[..., 0], q[..., 1]) - 0.27 * n, q[..., 2]) - 0.12 * n

    def box(p):
        over = np.abs(p - c) - np.array([0.3, 0.23, 0.18]) * n
        return np.linalg.norm(np.maximum(over, 0), axis=-1) + np.minimum(over.max(-1), 0)

    for body, target in ((ball, 0.010), (torus, 0.012), (box, 0.006)):
        models = []
        for by in (0.0, 2.3):
            raw, model = folder / "m.raw", folder / f"{by}.oct"
            np.ascontiguousarray((by - body(grid)).transpose(2, 1, 0)).astype("<f4").tofile(raw)
            oct_("build", raw, "-o", model, "--dims", f"{n}x{n}x{n}", "--dtype", "f32", "--iso", 0)
            models.append(model)
        table = folder / "m.csv"
        oct_("compare", *models, "--radius", 6, "--csv", table)
        rows = np.genfromtxt(table, delimiter=",", skip_header=1)
        rows = rows[np.isfinite(rows[:, 3]) & (rows[:, 5] > 0)]
        error = rows[:, 3] - (body(rows[:, :3]) - 2.3)
        row(f"{body.__name__} to grown {body.__name__}: RMS, voxels", np.sqrt(np.average(error**2, weights=rows[:, 5])), target, False)
    report, _ = oct_("compare", models[0], models[0])
    print(f"{'same model twice: greatest deviation':<58} {report['hausdorff']['to_nominal']:>10.4g} {0:>8}")


def open3d_seconds(mesh, points):
    """CPU seconds of Open3D's signed distances, with its tree."""
    import open3d

    shape = open3d.t.geometry.TriangleMesh.from_legacy(open3d.io.read_triangle_mesh(str(mesh)))
    start = time.process_time()
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(shape)
    built = time.process_time()
    scene.compute_signed_distance(open3d.core.Tensor(points.astype(np.float32)), nthreads=1)
    return time.process_time() - built, built - start


def speed(folder, n):
    """Cells a CPU second, memory, and the peers on the same points."""
    model, noisy = folder / "a.oct", folder / "b.oct"
    source = f"synthetic:gyroid@{n}?noise=0.02"
    plain, sure = turns(
        lambda: oct_("build", source, "-o", model, "--threads", 1),
        lambda: oct_("build", source, "-o", noisy, "--threads", 1, "--uncertainty"),
    )
    row("build with --uncertainty, times without", sure[1] / plain[1], 1.10, False)
    table = folder / "a.csv"
    moved = lambda by: oct_("compare", model, model, "--move", f"{by},0,0", "--threads", 1, "--radius", 10)
    (near, seconds), (far, _) = turns(lambda: moved(0.3), lambda: moved(3))
    row(f"gyroid {n}^3 moved by .3: million cells a CPU second", near["cells"] / seconds / 1e6, 2)
    for by, report in ((0.3, near), (3, far)):
        row(f"gyroid {n}^3 moved by {by}: peak MiB", report["peak_rss_bytes"] / 2**20, 8, False)
    oct_("compare", model, model, "--move", "0.3,0,0", "--csv", table, "--threads", 1)
    points = np.genfromtxt(table, delimiter=",", skip_header=1, usecols=(0, 1, 2))
    mesh = folder / "a.ply"
    oct_("export", model, "-o", mesh)
    name = f"gyroid {n}^3 moved by .3: times as fast as Open3D"
    try:
        asked, built = open3d_seconds(mesh, points)
        row(name + ", signed distance", asked / seconds, 3 if n <= 256 else 8)
        row(name + ", with its tree", (asked + built) / seconds, 3 if n <= 256 else 8)
    except ImportError:
        skipped(name, "open3d")
    for by, target in (("ray", 3), ("ball", 1)):
        report, taken = oct_("thickness", model, "--by", by, "--threads", 1, *(["--max", 8] if by == "ball" else []))
        row(f"thickness by {by}: million cells a CPU second", report["cells"] / taken / 1e6, target)
    try:
        import trimesh

        shape = trimesh.load_mesh(mesh)
        start = time.process_time()
        trimesh.proximity.thickness(shape, points[:3000], method="ray")
        row("thickness by ray: times as fast as trimesh", (time.process_time() - start) / 3000 * near["cells"] / seconds, 1)
    except ImportError:
        skipped("thickness by ray: times as fast as trimesh", "trimesh")


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    print(f"{'':<58} {'found':>10} {'target':>8} {'ratio':>8}")
    with tempfile.TemporaryDirectory() as folder:
        body_errors(Path(folder))
        speed(Path(folder), n)


main()
