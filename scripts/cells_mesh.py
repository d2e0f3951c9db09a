#!/usr/bin/env python3
"""Cells against marching-cubes meshes of the same samples, cast by the very same rays, at 192^3.

usage: scripts/cells_mesh.py [SIDE]      needs VTK and numpy; some 5 minutes on 2 cores

The test `cells_accuracy` writes samples and rays, this program makes the meshes (VTK's flying edges, whose
triangles are those of marching cubes) and casts them in double precision, and the test compares both with the
true surface. It fails, and says where, if cells miss a bound.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

TOP = pathlib.Path(__file__).resolve().parent.parent


def bar(done, total, what, started):
    """One line on the terminal: how far, and how long."""
    full = 30 * done // total
    line = f"\r[{'#' * full}{'.' * (30 - full)}] {done}/{total} {time.time() - started:4.0f} s {what:24}"
    print(line, end="" if done < total else "\n", file=sys.stderr, flush=True)


def compare(folder, side):
    """Runs the test; it writes what is missing, or prints its table."""
    env = dict(os.environ, INFOBYTE_CELLS_MESH=str(folder), INFOBYTE_CELLS_SIDE=str(side))
    command = ["cargo", "test", "--locked", "--test", "it"]
    return subprocess.run(
        command + ["--", "--nocapture", "cells_are_as_true_as_a_mesh"], cwd=TOP, env=env, capture_output=True, text=True, check=False
    )


def mesh_of(samples, thick, iso):
    """Triangles of the surface at a threshold."""
    slices, side, _ = samples.shape
    image = vtk.vtkImageData()
    image.SetDimensions(side, side, slices)
    image.SetSpacing(1, 1, thick)
    image.SetOrigin(0, 0, (thick - 1) / 2)
    # As doubles, so that points are not rounded to the type of the samples.
    image.GetPointData().SetScalars(numpy_to_vtk(samples.astype(np.float64).ravel()))
    edges = vtk.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, iso)
    edges.ComputeNormalsOff()
    edges.Update()
    return edges.GetOutput()


def cast(mesh, rays, far):
    """Parameter and outward normal of the first triangle on each ray; NaN for none."""
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
    triangles = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    t, x, at, sub, cell = vtk.mutable(0.0), [0.0] * 3, [0.0] * 3, vtk.mutable(0), vtk.mutable(0)
    hits = np.full(len(rays), -1, np.int64)
    ends = rays[:, :3] + far * rays[:, 3:]
    for i, (eye, end) in enumerate(zip(rays[:, :3].tolist(), ends.tolist())):
        if locator.IntersectWithLine(eye, end, 1e-7, t, x, at, sub, cell):
            hits[i] = cell.get()
    a, b, c = (points[triangles[hits, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    eye, direction = rays[:, :3], rays[:, 3:]
    along = np.einsum("ij,ij->i", normal, direction)
    result = np.empty((len(rays), 4))
    result[:, 0] = np.einsum("ij,ij->i", normal, a - eye) / along
    # Rays come from outside.
    result[:, 1:] = np.where((along > 0)[:, None], -normal, normal)
    result[hits < 0] = np.nan
    return result


def main():
    """Samples and rays, meshes, comparison."""
    side = int(sys.argv[1]) if len(sys.argv) > 1 else 192
    started = time.time()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        bar(0, 8, "samples and rays", started)
        first = compare(folder, side)
        facts = sorted(folder.glob("*.facts"))
        if not facts:
            sys.exit(f"the test wrote no samples:\n{first.stdout}{first.stderr}")
        for done, path in enumerate(facts):
            bar(1 + done, 8, f"mesh of {path.stem}", started)
            n, slices, thick, iso = map(float, path.read_text().split())
            shape = int(slices), int(n), int(n)
            samples = np.fromfile(path.with_suffix(".samples"), "<u2").reshape(shape)
            rays = np.fromfile(path.with_suffix(".rays"), "<f8").reshape(-1, 6)
            mesh = mesh_of(samples, thick, iso)
            counts = np.array([mesh.GetNumberOfPoints(), mesh.GetNumberOfPolys()], np.float64)
            hits = cast(mesh, rays, 6 * n)
            path.with_suffix(".hits").write_bytes(hits.tobytes() + counts.tobytes())
        bar(7, 8, "comparing", started)
        last = compare(folder, side)
        bar(8, 8, "", started)
        print("\n".join(line for line in last.stdout.splitlines() if " cells " in line or " mesh " in line))
        if last.returncode != 0:
            sys.exit("\n".join(line for line in (last.stdout + last.stderr).splitlines() if "at most" in line))


if __name__ == "__main__":
    main()
