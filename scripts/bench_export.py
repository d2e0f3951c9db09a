#!/usr/bin/env python3
"""Exports within an error or to a number: triangles, distance, seconds and memory, and meshoptimizer on the whole mesh.

usage: scripts/bench_export.py OCT MODEL.oct.. [--bounds 0.05,0.1,0.2] [--triangles 50000,200000]
       needs numpy, Open3D, trimesh and meshoptimizer; bounds are in voxels of the finest spacing

Distances are measured both ways by Open3D, of all corners and a million points spread over the triangles, in voxels.
meshoptimizer's own error is lowered until its mesh is as near as ours in the same measure; to a number, its mesh has as many.
"""

import argparse
import json
import pathlib
import resource
import subprocess
import tempfile
import time

import meshoptimizer
import numpy as np
import open3d
import trimesh

POINTS = 1_000_000


def run(*command):
    """The report of a command, and its CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([str(word) for word in command] + ["--json"], capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = json.loads(done.stdout)
    return report, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def read(path):
    """Corners and triangles of a PLY that `oct` wrote."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    counts = [int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element")]
    floats = 6 if b"property float nx" in head else 3
    colors = 3 if b"property uchar red" in head else 0
    corner = np.dtype([("at", "<f4", 3), ("rest", "u1", 4 * (floats - 3) + colors)])
    corners = np.frombuffer(body, corner, counts[0])["at"]
    faces = np.frombuffer(body, [("corners", "u1"), ("of", "<u4", 3)], counts[1], counts[0] * corner.itemsize)["of"]
    return np.ascontiguousarray(corners), np.ascontiguousarray(faces)


def scene(corners, faces):
    """A mesh that knows distances."""
    made = open3d.t.geometry.RaycastingScene()
    made.add_triangles(open3d.core.Tensor(corners), open3d.core.Tensor(faces))
    return made


def spread(corners, faces):
    """All corners, and points spread evenly over the triangles."""
    random = np.random.default_rng(1)
    a, b, c = (corners[faces[:, k]].astype(float) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    of = random.choice(len(faces), POINTS, p=area / area.sum())
    v, w = random.random((2, POINTS, 1))
    v, w = np.where(v + w > 1, 1 - v, v), np.where(v + w > 1, 1 - w, w)
    within = a[of] + v * (b - a)[of] + w * (c - a)[of]
    return np.concatenate([corners, within.astype(np.float32)])


def apart(one, other):
    """How far two meshes are from each other at most, in mm."""
    pairs = ((one, other), (other, one))
    return max(scene(*to).compute_distance(open3d.core.Tensor(spread(*of))).numpy().max() for of, to in pairs)


def whole(fine, least):
    """meshoptimizer on the whole mesh, as near."""
    corners, faces = fine
    indices, few = faces.ravel(), np.empty(faces.size, np.uint32)
    scale = (corners.max(axis=0) - corners.min(axis=0)).max()
    error = least
    while True:
        start = time.perf_counter()
        count = meshoptimizer.simplify(few, indices, corners, target_index_count=0, target_error=float(error / scale))
        seconds = time.perf_counter() - start
        made = few[:count].reshape(-1, 3).copy()
        if apart(fine, (corners, made)) <= least:
            return f"1/{len(faces) / len(made):.2f}, {seconds:.2f} s"
        if error < least / 8:
            return f"1/{len(faces) / len(made):.2f} and still farther"
        error *= 0.8


def compare(oct, model, bounds, counts, folder):
    """Rows of a model."""
    voxel = min(run(oct, "info", model)[0]["spacing_mm"])
    report, seconds = run(oct, "export", model, "-o", folder / "fine.ply")
    fine = read(folder / "fine.ply")
    print(f"{model.name}: {len(fine[1])} triangles, {seconds:.2f} CPU s, {report['peak_rss_bytes'] / 2**20:.1f} MiB")
    few_triangles = np.empty(fine[1].size, np.uint32)
    for option, value in [("--error", bound) for bound in bounds] + [("--triangles", count) for count in counts]:
        report, seconds = run(oct, "export", model, "-o", folder / "few.ply", option, value)
        few = read(folder / "few.ply")
        mesh = trimesh.Trimesh(few[0], few[1], process=False)
        most = apart(fine, few)
        closed = "closed" if mesh.is_watertight and mesh.is_winding_consistent else "OPEN"
        if option == "--error":
            other = whole(fine, most)
        else:
            corners, faces = fine
            kept = meshoptimizer.simplify(
                few_triangles, faces.ravel(), corners, target_index_count=3 * value, target_error=1e30
            )
            other = f"{apart(fine, (corners, few_triangles[:kept].reshape(-1, 3).copy())) / voxel:.4f} voxel"
        print(
            f"  {option} {value}: 1/{len(fine[1]) / len(few[1]):.2f}, {closed}, {most / voxel:.4f} voxel,"
            f" {report['wall_s']:.2f} s, {seconds:.2f} CPU s, {report['peak_rss_bytes'] / 2**20:.1f} MiB |"
            f" meshoptimizer {other}",
            flush=True,
        )


def main():
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("oct", type=pathlib.Path)
    parser.add_argument("models", type=pathlib.Path, nargs="+")
    parser.add_argument("--bounds", default="0.05,0.1,0.2")
    parser.add_argument("--triangles", default="")
    args = parser.parse_args()
    bounds = [float(bound) for bound in args.bounds.split(",") if bound]
    counts = [int(count) for count in args.triangles.split(",") if count]
    for model in args.models:
        with tempfile.TemporaryDirectory() as folder:
            compare(args.oct.resolve(), model, bounds, counts, pathlib.Path(folder))


if __name__ == "__main__":
    main()
