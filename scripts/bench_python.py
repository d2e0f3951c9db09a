#!/usr/bin/env python3
"""The Python package against its peers, in one run: rays against Open3D (Embree) on the model's own mesh, meshes against
VTK's flying edges, builds against the command; the import, and rays that must not miss. Asserts no time.

    scripts/bench_python.py            everything at 256^3 and 512^3; some minutes, 3 GB
    scripts/bench_python.py 256 rays   one side, one part: rays, misses, mesh, build, import

Needs numpy and the built package; what else is missing is said. Times are medians of rounds in turns.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import infobyte

ROUNDS = 7
RAYS = 1 << 20
PARTS = ("import", "build", "mesh", "rays", "misses")


def gyroid(side):
    """A volume whose surface has some 2.0 M triangles at 256^3: z, y, x, 16-bit, the surface at 1000."""
    wave = [np.float32(2 * np.pi / (side / 3.25)) * np.arange(side, dtype=np.float32)] * 3
    z, y, x = np.meshgrid(*wave, indexing="ij", sparse=True)
    value = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return np.ascontiguousarray((1000 + 300 * value).astype(np.int16))


def turns(ways, rounds=ROUNDS):
    """Median and range of wall seconds of each way, and what it gave last; the ways in turns."""
    taken, given = {name: [] for name in ways}, {}
    for _ in range(rounds):
        for name, way in ways.items():
            start = time.perf_counter()
            given[name] = way()
            taken[name].append(time.perf_counter() - start)
    for name, all_ in taken.items():
        print(f"  {name:28} {statistics.median(all_):7.4f} s ({min(all_):.4f} to {max(all_):.4f})")
    return {name: statistics.median(all_) for name, all_ in taken.items()}, given


def rays(side, folder):
    volume = gyroid(side)
    model = infobyte.build(volume, f"{folder}/rays.oct", iso=1000, progress=False)
    mesh = model.to_mesh()
    low, high = mesh.vertices.min(0).astype(float), mesh.vertices.max(0).astype(float)
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    # Picture order: a square camera, rows from the top, from a corner.
    n = int(RAYS**0.5)
    look = np.array([-0.6, 0.7, 0.4])
    look /= np.linalg.norm(look)
    right = np.cross(look, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, look)
    across = (np.arange(n) + 0.5) / n - 0.5
    directions = look + 0.6 * (across[None, :, None] * right - across[:, None, None] * up)
    directions = (directions / np.linalg.norm(directions, axis=2, keepdims=True)).reshape(-1, 3)
    origins = np.broadcast_to(middle - 1.2 * size * look, directions.shape)
    picture = (np.ascontiguousarray(origins), np.ascontiguousarray(directions))
    # Random: between points of the sphere around the body and points of its box.
    random = np.random.default_rng(7)
    start = random.normal(size=(RAYS, 3))
    start = middle + 0.6 * size * start / np.linalg.norm(start, axis=1, keepdims=True)
    goal = low + random.random((RAYS, 3)) * (high - low)
    scattered = (start, (goal - start) / np.linalg.norm(goal - start, axis=1, keepdims=True))
    print(f"rays, {side}^3, {len(mesh.faces)} triangles, {RAYS} rays, one thread", flush=True)
    try:
        import open3d as o3d
    except ImportError:
        o3d = None
        print("  without open3d, which is not installed")
    if o3d:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        began = time.perf_counter()
        scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
        scene.count_intersections(o3d.core.Tensor(np.zeros((1, 6), np.float32)))
        print(f"  open3d's structure: {time.perf_counter() - began:.2f} s")
    for name, (starts, ways) in {"picture order": picture, "random": scattered}.items():
        pairs = {"infobyte.first_hits": lambda starts=starts, ways=ways: model.first_hits(starts, ways, threads=1)}
        if o3d:
            one = o3d.core.Tensor(np.hstack([starts, ways]).astype(np.float32))
            pairs["open3d.cast_rays"] = lambda one=one: scene.cast_rays(one, nthreads=1)
        print(f" {name}")
        took, given = turns(pairs)
        hits = given["infobyte.first_hits"].t
        hit = np.isfinite(hits)
        line = f"  {RAYS / took['infobyte.first_hits'] / 1e6:.2f} M/s, {hit.mean():.3f} hit"
        if o3d:
            theirs = given["open3d.cast_rays"]["t_hit"].numpy()
            both = hit & np.isfinite(theirs)
            away = np.abs(hits[both] - theirs[both])
            line += f"; {took['open3d.cast_rays'] / took['infobyte.first_hits']:.2f} x open3d's"
            line += f" ({RAYS / took['open3d.cast_rays'] / 1e6:.2f} M/s); {(hit != np.isfinite(theirs)).sum()} differ"
            line += f", hits {np.median(away):.4f} voxel apart at the median"
        print(line, flush=True)
        if name == "picture order":
            seen = given["infobyte.first_hits"]
    # From what the picture shows, the light of the sky: by the cosine, a voxel off the surface.
    at, normal = seen.position[seen.is_hit], seen.normal[seen.is_hit]
    around = random.normal(size=at.shape)
    ways = normal + around / np.linalg.norm(around, axis=1, keepdims=True)
    starts = at + normal
    pairs = {"infobyte.any_hit": lambda: model.any_hit(starts, ways, threads=1)}
    if o3d:
        one = o3d.core.Tensor(np.hstack([starts, ways]).astype(np.float32))
        pairs["open3d.test_occlusions"] = lambda: scene.test_occlusions(one, nthreads=1)
    print(" ambient")
    took, given = turns(pairs)
    met = given["infobyte.any_hit"]
    line = f"  {len(at) / took['infobyte.any_hit'] / 1e6:.2f} M/s, {met.mean():.3f} hit"
    if o3d:
        line += f"; {took['open3d.test_occlusions'] / took['infobyte.any_hit']:.2f} x open3d's"
        line += f"; {(met != given['open3d.test_occlusions'].numpy()).sum()} differ"
    print(line, flush=True)


def misses(side, folder):
    volume = gyroid(side)
    model = infobyte.build(volume, f"{folder}/misses.oct", iso=1000, progress=False)
    inside = np.flatnonzero(volume > 1000)
    random = np.random.default_rng(11)
    count = 4_000_000
    goals = np.unravel_index(inside[random.integers(len(inside), size=count)], volume.shape)
    goals = np.stack(goals[::-1], axis=1).astype(float)
    ways = random.normal(size=(count, 3))
    # A third along axes, a third along small whole numbers.
    ways[: count // 3] = np.eye(3)[random.integers(3, size=count // 3)] * random.choice([-1, 1], (count // 3, 1))
    whole = random.integers(-3, 4, size=(count // 3, 3)).astype(float)
    whole[np.all(whole == 0, axis=1)] = 1
    ways[count // 3 : 2 * (count // 3)] = whole
    far = 4 * side / np.linalg.norm(ways, axis=1, keepdims=True)
    hits = model.first_hits(goals - far * ways, far * ways)
    # The surface is met before the sample or at it.
    missed = int((~(hits.t <= 1 + 1e-9)).sum())
    print(f"misses, {side}^3: {missed} of {count} rays from outside to middles of inside voxels", flush=True)


def mesh(side, folder):
    volume = gyroid(side)
    model = infobyte.build(volume, f"{folder}/mesh.oct", iso=1000, progress=False)
    ways = {
        "to_mesh": model.to_mesh,
        "array to mesh": lambda: infobyte.build(volume, f"{folder}/mesh2.oct", iso=1000, progress=False).to_mesh(),
    }
    try:
        import vtk
        from vtk.util import numpy_support

        image = vtk.vtkImageData()
        image.SetDimensions(*reversed(volume.shape))
        image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(volume.ravel()))

        def edges():
            edges = vtk.vtkFlyingEdges3D()
            edges.SetInputData(image)
            edges.SetValue(0, 1000)
            edges.ComputeNormalsOn()
            edges.ComputeGradientsOff()
            edges.ComputeScalarsOff()
            edges.Update()
            return edges.GetOutput()

        ways = {"vtkFlyingEdges3D": edges, **ways}
    except ImportError:
        print("  without vtk, which is not installed")
    print(f"mesh, {side}^3", flush=True)
    took, given = turns(ways)
    faces = given["to_mesh"].faces
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.uint64)
    _, count = np.unique(sides[:, 0] << np.uint64(32) | sides[:, 1], return_counts=True)
    print(f"  {len(faces)} triangles; edges of one triangle {(count == 1).sum()}, of more than two {(count > 2).sum()}")
    if "vtkFlyingEdges3D" in took:
        theirs = took["vtkFlyingEdges3D"]
        print(f"  {took['to_mesh'] / theirs:.2f} x, from the array {took['array to mesh'] / theirs:.2f} x", flush=True)


def build(side, folder):
    volume = gyroid(side)
    raw = f"{folder}/build.raw"
    volume.tofile(raw)
    oct_ = os.path.join(os.path.dirname(sys.executable), "oct")
    oct_ = os.environ.get("OCT_BINARY", oct_)
    command = [oct_, "build", raw, "--dims", f"{side}x{side}x{side}", "--dtype", "i16", "--iso", "1000"]
    command += ["-o", f"{folder}/c.oct", "--quiet", "--memory", "64MiB"]

    def ours(array):
        return infobyte.build(array, f"{folder}/p.oct", iso=1000, memory="64MiB", progress=False)

    def theirs():
        if os.path.exists(f"{folder}/c.oct"):
            os.remove(f"{folder}/c.oct")
        subprocess.run(command, check=True)

    fortran = np.asfortranarray(volume)
    ways = {"oct build": theirs, "build": lambda: ours(volume), "build, Fortran order": lambda: ours(fortran)}
    print(f"build, {side}^3", flush=True)
    took, _ = turns(ways)
    print(f"  {took['build'] / took['oct build']:.2f} x the command's; Fortran", end=" ")
    print(f"{took['build, Fortran order'] / took['build']:.2f} x C order", flush=True)
    print(f"  sections that differ: {differing(f'{folder}/p.oct', f'{folder}/c.oct')}")


def differing(*paths):
    """Tags of the sections whose content differs, by the tables of the files (SPEC 3)."""
    tables = []
    for path in paths:
        with open(path, "rb") as file:
            head = file.read(64)
            entries = [file.read(48) for _ in range(int.from_bytes(head[14:16], "little"))]
        tables.append({entry[:4].decode(): entry[44:] for entry in entries})
    return [tag for tag in sorted({*tables[0], *tables[1]}) if tables[0].get(tag) != tables[1].get(tag)]


def import_(_side, _folder):
    code = (
        "import time,numpy;r=lambda:int(open('/proc/self/statm').read().split()[1])*4;m=r();"
        "t=time.perf_counter();import infobyte;print(time.perf_counter()-t,(r()-m)/1024)"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, check=True) for _ in range(15)]
    times, sizes = zip(*(map(float, run.stdout.split()) for run in runs))
    print(f"import beyond numpy: {statistics.median(times) * 1e3:.1f} ms ({min(times) * 1e3:.1f} to", end=" ")
    print(f"{max(times) * 1e3:.1f}), {statistics.median(sizes):.1f} MiB", flush=True)


def main():
    sides = [int(word) for word in sys.argv[1:] if word.isdigit()] or [256, 512]
    parts = [word for word in sys.argv[1:] if not word.isdigit()] or PARTS
    if unknown := set(parts) - set(PARTS):
        raise SystemExit(f"{', '.join(unknown)}: parts are {', '.join(PARTS)}")
    with tempfile.TemporaryDirectory(prefix="infobyte-bench-") as folder:
        for part in parts:
            for side in sides[:1] if part == "import" else sides:
                {"import": import_, "build": build, "mesh": mesh, "rays": rays, "misses": misses}[part](side, folder)


if __name__ == "__main__":
    main()
