#!/usr/bin/env python3
"""Are the normals and edges of pictures as good as VTK's? One table, for `oct` and VTK by the same rays and measures.

accept_pictures.py OCT [CTHEAD_FOLDER]   (numpy, vtk and pillow)

Bodies of 128 samples a side have a true normal; the CT head has VTK's own, and the gradient smoothed over 5^3 samples
says where it is smooth. Two parallel views; a pixel counts where both programs hit within .2 voxel of each other.
A speck is more than 15 degrees from the median of the 8 pixels a voxel away, where all of these lie on one smooth
patch. PSNR is that of a picture of 384^2 against 64 rays a pixel (plain light, over black).
"""
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

PIXELS = 640
VIEWS = [np.array(v) / np.linalg.norm(v) for v in ([0.5, -0.8, 0.33], [-0.7, -0.5, 0.5])]
#: Degrees by which true normals around a pixel of a smooth patch differ at most: by 8 VTK has the 17 to 19 specks of
#: the CT head that the first study of pictures found.
SMOOTH = 8
#: A parallel camera shows what one of this angle sees at the middle.
FOV = 35.0


def axes(towards):
    """Right and up of a camera that looks along -towards, z up."""
    right = np.cross(-towards, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(right, -towards)


def implicit(name):
    """Distance-like function of points from the middle, in mm: below 0 within."""
    if name == "torus":
        return lambda x, y, z: np.hypot(np.hypot(x, y) - 36, z) - 14
    if name == "box":
        turn = np.linalg.qr(np.array([[1, .3, -.2], [-.4, 1, .35], [.15, -.3, 1.0]]))[0]

        def box(x, y, z):
            a = [abs(turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z) - h for i, h in enumerate((38, 30, 34))]
            return np.maximum(np.maximum(a[0], a[1]), a[2])
        return box
    if name == "dented":
        w = 2 * math.pi / 24
        return lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 46 + 1.5 * np.sin(w * x) * np.sin(w * y) * np.sin(w * z)
    return lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 48


def volume(name, spacing, noise):
    """u16 samples: 1000 - 500 erf(d), with the thick slices' mean, from the implicit function; and its middle."""
    n = [128, 128, int(128 / spacing[2])]
    f, middle = implicit(name), [(n[a] - 1) * spacing[a] / 2 for a in range(3)]
    x, y = (np.arange(n[a]) * spacing[a] - middle[a] for a in range(2))
    erf, slices = np.vectorize(math.erf), []
    steps = int(spacing[2])
    for k in range(n[2]):
        subs = [k * spacing[2] - middle[2] + (i + .5) / steps * spacing[2] - spacing[2] / 2 for i in range(steps)]
        d = [np.clip(f(x[None, :], y[:, None], z), -4, 4) for z in subs]
        near = [np.where(abs(v) < 3.9, erf(v), np.sign(v)) for v in d]
        slices.append(1000 - 500 * np.mean(near, axis=0))
    samples = np.array(slices) + np.random.default_rng(1).normal(0, 1000 * noise, (n[2], n[1], n[0]))
    return np.clip(np.round(samples), 0, 65535).astype("<u2"), middle


def true_normal(name, points, middle):
    """Unit gradients of the implicit function, by differences."""
    f, q = implicit(name), points - middle
    h = 1e-4
    g = np.stack([f(*(q + h * e).T) - f(*(q - h * e).T) for e in np.eye(3)], -1)
    return g / np.linalg.norm(g, axis=-1, keepdims=True)


def rays(towards, middle, reach):
    """Origins of all pixels, row by row, in the plane through the middle."""
    right, up = axes(towards)
    at = (2 * (np.arange(PIXELS) + .5) / PIXELS - 1) * reach
    return middle + at[None, :, None] * right + -at[:, None, None] * up


def ours(oct_program, model, towards, middle, reach, folder):
    """Depths along the ray from its plane through the middle, and normals."""
    away = reach / math.tan(math.radians(FOV / 2))
    triple = lambda v: ",".join(f"{c:.9f}" for c in v)
    files = [str(folder / name) for name in ("p.png", "d.png", "n.png")]
    report = json.loads(subprocess.run(
        [oct_program, "render", str(model), "-o", files[0], "--depth", files[1], "--normals", files[2], "--json",
         "--size", f"{PIXELS}x{PIXELS}", "--eye", triple(middle + away * towards), "--look-at", triple(middle)],
        check=True, capture_output=True, text=True).stdout)
    grey = np.array(Image.open(files[1])).astype(float)
    near, far = report["depth_near_mm"], report["depth_far_mm"]
    depth = np.where(grey > 0, near + (grey - 1) / 65534 * (far - near) - away, np.nan)
    normal = (np.array(Image.open(files[2])).astype(float)[..., :3] - 128) / 127
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return depth, normal / np.where(length > 0, length, 1)


def vtk_mesh(samples, spacing, iso):
    """FlyingEdges with the gradients' normals."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D
    image = vtkImageData()
    image.SetDimensions(*samples.shape[::-1])
    image.SetSpacing(*spacing)
    image.GetPointData().SetScalars(numpy_to_vtk(samples.ravel(), deep=1))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, iso)
    edges.ComputeNormalsOn()
    edges.Update()
    return edges.GetOutput()


def theirs(mesh, towards, middle, reach):
    """The same of VTK's mesh: the first triangle on each ray, its points' normals mixed."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    points = vtk_to_numpy(mesh.GetPoints().GetData()).astype(float)
    normals = vtk_to_numpy(mesh.GetPointData().GetNormals()).astype(float)
    triangles = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    right, up = axes(towards)
    scale = PIXELS / (2 * reach)
    flat = np.stack([(points - middle) @ right * scale + PIXELS / 2, PIXELS / 2 - (points - middle) @ up * scale], -1)
    deep = (middle - points) @ towards
    depth, normal = np.full((PIXELS, PIXELS), np.inf), np.zeros((PIXELS, PIXELS, 3))
    corners = flat[triangles]
    low = np.maximum(np.ceil(corners.min(1) - .5).astype(int), 0)
    high = np.minimum(np.floor(corners.max(1) - .5).astype(int), PIXELS - 1)
    size = (high - low + 1).clip(0)
    # All triangles at once, for each place in the box around them.
    for dx in range(size[:, 0].max(initial=0)):
        for dy in range(size[:, 1].max(initial=0)):
            some = np.nonzero((size[:, 0] > dx) & (size[:, 1] > dy))[0]
            x, y = low[some, 0] + dx, low[some, 1] + dy
            a, b, c = (corners[some, i] for i in range(3))
            p = np.stack([x + .5, y + .5], -1)
            cross = lambda u, v: u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
            area = cross(b - a, c - a)
            with np.errstate(all="ignore"):
                w = np.stack([cross(b - p, c - p), cross(c - p, a - p), cross(a - p, b - p)], -1) / area[:, None]
            within = (w >= 0).all(-1) & np.isfinite(w).all(-1)
            some, x, y, w = some[within], x[within], y[within], w[within]
            z = (w * deep[triangles[some]]).sum(-1)
            order = np.argsort(-z)
            some, x, y, w, z = some[order], x[order], y[order], w[order], z[order]
            nearer = z < depth[y, x]
            some, x, y, w, z = some[nearer], x[nearer], y[nearer], w[nearer], z[nearer]
            depth[y, x] = z
            normal[y, x] = (w[..., None] * normals[triangles[some]]).sum(1)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(np.isfinite(depth), depth, np.nan), normal / np.where(length > 0, length, 1)


def angle(a, b):
    return np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1)))


def medians(values, step):
    """Of the 8 pixels so far away, of each component."""
    around = [np.roll(values, (dy * step, dx * step), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy]
    return around, np.median(np.stack(around), 0)


def specks(normal, depth, smooth, step, counted):
    """Of 10,000 pixels on smooth patches. `smooth` has the normals that say so."""
    around, middle = medians(normal, step)
    depths, _ = medians(depth, step)
    flat = counted & (np.max([abs(d - depth) for d in depths], 0) < 2.0)
    near, _ = medians(smooth, step)
    flat &= np.max([angle(n, smooth) for n in near], 0) < SMOOTH
    flat[:step] = flat[-step:] = False
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True).clip(1e-9)
    return 1e4 * (flat & (angle(normal, middle) > 15)).sum() / max(flat.sum(), 1)


def smoothed_gradients(samples, spacing):
    """Outward unit normals by the gradient of the 5^3 means, as a function of points in mm."""
    from scipy.ndimage import map_coordinates, uniform_filter
    mean = uniform_filter(samples.astype(np.float32), 5)
    parts = [-np.gradient(mean, axis=2 - a) / spacing[a] for a in range(3)]

    def at(points):
        index = [points[..., a] / spacing[a] for a in (2, 1, 0)]
        g = np.stack([map_coordinates(part, index, order=1, mode="nearest") for part in parts], -1)
        return g / np.linalg.norm(g, axis=-1, keepdims=True).clip(1e-9)
    return at


def measure(oct_program, samples, spacing, iso, normal_at, folder):
    """Mean error, share over 15 degrees and specks of both, and the percentiles of the angle between them."""
    raw, model = folder / "v.raw", folder / "v.oct"
    samples.tofile(raw)
    dims, steps = "x".join(map(str, samples.shape[::-1])), "x".join(map(str, spacing))
    subprocess.run([oct_program, "build", str(raw), "-o", str(model), "--dims", dims, "--dtype", "u16", "--quiet",
                    "--spacing", steps, "--iso", str(iso), "--surface", "cells"], check=True)
    middle = np.array([(n - 1) * d / 2 for n, d in zip(samples.shape[::-1], spacing)])
    reach = np.linalg.norm(middle) * .75
    mesh, all_angles, found = vtk_mesh(samples, spacing, iso), [], {"oct": [], "VTK": []}
    for towards in VIEWS:
        pictures = {"oct": ours(oct_program, model, towards, middle, reach, folder),
                    "VTK": theirs(mesh, towards, middle, reach)}
        depth = pictures["oct"][0]
        both = abs(depth - pictures["VTK"][0]) < .2 * min(spacing)
        points = rays(towards, middle, reach) - np.nan_to_num(depth)[..., None] * towards
        truth = normal_at(points)
        all_angles.append(angle(pictures["oct"][1], pictures["VTK"][1])[both])
        step = max(1, round(min(spacing) * PIXELS / (2 * reach)))
        for name, (own, normal) in pictures.items():
            error = angle(normal, truth)[both]
            found[name].append((error.mean(), 100 * (error > 15).mean(),
                                specks(normal, np.nan_to_num(own, nan=1e9), truth, step, both)))
    return np.percentile(np.concatenate(all_angles), [50, 90]), {k: np.mean(v, 0) for k, v in found.items()}


def psnr(oct_program, model, folder, side=384, rays_a_side=8):
    """Of the default samples against 64 rays a pixel, and rays a pixel."""
    def light(size, samples):
        picture = folder / "s.png"
        report = json.loads(subprocess.run(
            [oct_program, "render", str(model), "-o", str(picture), "--size", f"{size}x{size}", "--samples", samples,
             "--shading", "plain", "--view", "left", "--json"], check=True, capture_output=True, text=True).stdout)
        rgba = np.array(Image.open(picture)).astype(float) / 255
        linear = np.where(rgba[..., :3] <= .04045, rgba[..., :3] / 12.92, ((rgba[..., :3] + .055) / 1.055) ** 2.4)
        return linear * rgba[..., 3:], report["rays"] / size ** 2

    def code(linear):
        return np.where(linear <= .0031308, 12.92 * linear, 1.055 * linear.clip(0) ** (1 / 2.4) - .055)
    own, cost = light(side, "auto")
    fine = light(side * rays_a_side, "1")[0].reshape(side, rays_a_side, side, rays_a_side, 3).mean((1, 3))
    return 10 * math.log10(1 / ((code(own) - code(fine)) ** 2).mean()), cost


def main():
    oct_program, heads = sys.argv[1], sys.argv[2:]
    print("| body | to VTK p50 / p90 | oct: error, > 15 deg, specks | VTK: error, > 15 deg, specks |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder, smooth = Path(name), None

        def row(title, samples, spacing, iso, normal_at):
            (p50, p90), found = measure(oct_program, samples, spacing, iso, normal_at, folder)
            known = normal_at is not smooth
            cells = [(f"{e:.2f}, {far:.2f} %, " if known else "") + f"{spots:.1f}"
                     for e, far, spots in (found["oct"], found["VTK"])]
            print(f"| {title} | {p50:.2f} / {p90:.2f} | {cells[0]} | {cells[1]} |", flush=True)
        for title, body, spacing, noise in (
                ("ball", "ball", (1, 1, 1), 0), ("ball, 2.5 % noise", "ball", (1, 1, 1), .025),
                ("torus", "torus", (1, 1, 1), 0), ("torus, slices of 6", "torus", (1, 1, 6), 0),
                ("dented, slices of 2, 5 % noise", "dented", (1, 1, 2), .05), ("box", "box", (1, 1, 1), 0)):
            samples, middle = volume(body, spacing, noise)
            row(title, samples, spacing, 1000, lambda points: true_normal(
                body, points.reshape(-1, 3), np.array(middle)).reshape(points.shape))
        if heads:
            slices = sorted(Path(heads[0]).glob("CThead.*"), key=lambda path: int(path.suffix[1:]))
            samples = np.stack([np.fromfile(path, ">i2").reshape(256, 256) for path in slices]).astype("<u2")
            smooth = smoothed_gradients(samples, (1, 1, 2))
            for iso in (1200, 1500):
                row(f"CT head, {iso}", samples, (1, 1, 2), iso, smooth)
                print(f"  PSNR {'%.1f dB at %.2f rays a pixel' % psnr(oct_program, folder / 'v.oct', folder)}", flush=True)


if __name__ == "__main__":
    main()
