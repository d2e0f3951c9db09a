#!/usr/bin/env python3
"""Models of larger leaves and decimated meshes of the same surface, at equal distance from it: bytes and seconds.

usage: scripts/decimated.py OCT [--side 192] [--mesh FILE.off] [--raw FILE NXxNYxNZ TYPE ISO]
       needs numpy, VTK, fast-simplification and meshoptimizer; some 10 minutes

The surface is that of the cells, as `oct export` writes it. A model's figure is its own: root of the mean square of how far
crossings of the cells' edges are from its leaves. A mesh is decimated by quadrics until the vertices of the full one, which
lie on those edges' cells, are as far from it; it is counted at 36 B a vertex (three floats, two triangles of three
indices). A row says how far the mesh is at most: nothing bounds that.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import fast_simplification
import meshoptimizer
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

BOUNDS = [0.05, 0.1, 0.2, 0.5]
STEPS = 7


def bodies(side):
    """Signed distances, above 0 inside, of the bodies of the notes on larger leaves."""
    axis = np.arange(side) - (side - 1) / 2
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
    length = np.sqrt(x * x + y * y + z * z)
    turned = [0.8 * x + 0.6 * y, 0.48 * x - 0.64 * y + 0.6 * z, 0.36 * x - 0.48 * y - 0.8 * z]
    wave = np.sin(0.19 * x) + np.sin(0.23 * y + 1) + np.sin(0.17 * z + 2)
    return {
        "ball": 0.4 * side - length,
        "torus": 0.12 * side - np.hypot(np.hypot(x, y) - 0.3 * side, z),
        "box": 0.25 * side - np.maximum.reduce([abs(c) + 0 * length for c in turned]),
        "noise": 0.33 * side - length + 1.5 * wave,
    }


def run(*command):
    """What a command of the program says."""
    done = subprocess.run([str(c) for c in command] + ["--json", "--force"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def read_ply(path):
    """Points and triangles of a binary PLY file of three floats and three indices."""
    reader = vtk.vtkPLYReader()
    reader.SetFileName(str(path))
    reader.Update()
    mesh = reader.GetOutput()
    points = vtk.util.numpy_support.vtk_to_numpy(mesh.GetPoints().GetData())
    faces = vtk.util.numpy_support.vtk_to_numpy(mesh.GetPolys().GetConnectivityArray())
    return np.ascontiguousarray(points, np.float32), np.ascontiguousarray(faces.reshape(-1, 3), np.int64)


def distances(points, faces, of):
    """How far points are from a mesh."""
    mesh, cells = vtk.vtkPolyData(), vtk.vtkCellArray()
    data = vtk.vtkPoints()
    data.SetData(numpy_to_vtk(np.ascontiguousarray(points, np.float64)))
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, np.int64).ravel()))
    mesh.SetPoints(data)
    mesh.SetPolys(cells)
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    near, cell, sub, square = [0.0] * 3, vtk.reference(0), vtk.reference(0), vtk.reference(0.0)
    found = np.empty(len(of))
    for i, point in enumerate(of):
        locator.FindClosestPoint(point, near, cell, sub, square)
        found[i] = float(square) ** 0.5
    return found


def by_fast_simplification(points, faces, part):
    """A mesh without this part of its triangles."""
    return fast_simplification.simplify(points, faces.astype(np.int32), float(part))


def by_meshoptimizer(points, faces, part):
    """The same."""
    indices = faces.astype(np.uint32).ravel()
    few = np.empty_like(indices)
    target = int((1 - part) * len(faces)) * 3
    count = meshoptimizer.simplify(few, indices, points, target_index_count=target, target_error=1.0)
    used, triangles = np.unique(few[:count], return_inverse=True)
    return points[used], triangles.reshape(-1, 3)


def decimated(simplify, points, faces, spacing, rms):
    """The smallest mesh that is as near: vertices, farthest distance, seconds; None where the finest step is not."""
    sample = points[np.random.default_rng(1).choice(len(points), min(len(points), 30000), replace=False)]
    low, high, best = 0.0, 0.9995, None
    for _ in range(STEPS):
        part = 1 - np.sqrt((1 - low) * (1 - high))
        started = time.perf_counter()
        few, triangles = simplify(points, faces, part)
        seconds = time.perf_counter() - started
        far = distances(few, triangles, sample) / spacing
        if np.sqrt((far**2).mean()) <= rms:
            low, best = part, (len(few), far.max(), seconds)
        else:
            high = part
    return best


def compare(oct, name, source, folder):
    """The rows of a body."""
    fine, mesh = folder / "fine.oct", folder / "fine.ply"
    built = run(oct, "build", *source, "-o", fine, "--threads", 1)
    run(oct, "export", fine, "-o", mesh)
    points, faces = read_ply(mesh)
    spacing = min(built["spacing_mm"])
    for bound in BOUNDS:
        model = run(oct, "build", *source, "-o", folder / "few.oct", "--error", bound, "--threads", 1)
        found, parts = model["larger_leaves"], model["channel_bytes"]
        own = model["bytes"] - parts.get("normal_lod", 0)
        text = f"{name:8} {bound:4} rms {found['rms']:.3f} max {found['most']:.2f} {own / 1000:8.0f} kB"
        text += f" {model['wall_s'] - built['wall_s']:6.2f} s more than {built['wall_s']:.2f}"
        for other, simplify in (("fast-simplification", by_fast_simplification), ("meshoptimizer", by_meshoptimizer)):
            best = decimated(simplify, points, faces, spacing, found["rms"])
            if best:
                vertices, most, seconds = best
                text += f" | {other} {36 * vertices / 1000:.0f} kB max {most:.2f} {seconds:.2f} s"
        print(text, flush=True)


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("oct", type=pathlib.Path)
    parser.add_argument("--side", type=int, default=192)
    parser.add_argument("--mesh")
    parser.add_argument("--raw", nargs=4, metavar=("FILE", "DIMS", "TYPE", "ISO"))
    args = parser.parse_args()
    args.oct = args.oct.resolve()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for name, field in bodies(args.side).items():
            field.astype("<f4").tofile(folder / "body.raw")
            dims = "x".join([str(args.side)] * 3)
            compare(args.oct, name, [folder / "body.raw", "--dims", dims, "--dtype", "f32", "--iso", 0], folder)
        if args.mesh:
            compare(args.oct, "mesh", [args.mesh, "--grid", 512], folder)
        if args.raw:
            path, dims, dtype, iso = args.raw
            compare(args.oct, "raw", [path, "--dims", dims, "--dtype", dtype, "--iso", iso], folder)


if __name__ == "__main__":
    main()
