#!/usr/bin/env python3
"""Twelve pictures by `oct` and twelve by pyvista, side by side without a name, for a blind comparison.

blind_pictures.py OCT DATA OUT [--smooth] [--grey] [--seed N]   (numpy, pillow, pyvista, simpleitk, trimesh)

`oct` gets the file and nothing else (headerless voxels their size); pyvista its defaults, with --smooth also
interpolated normals; both the same threshold, size and view, over white. --grey hides what a colour gives away. Writes
OUT/01.png to 12.png in the order and with the sides of the seed; OUT/key.tsv says which is which.
"""
import argparse
import json
import os
import random
import subprocess
from pathlib import Path

import numpy as np
import pyvista as pv
import SimpleITK
import trimesh
from PIL import Image

SIDE = 768
FRONT, ISO = (0, 1, 0), (-0.55, 0.75, -0.38)


class Maker:
    """Runs `oct` in a folder of its own."""

    def __init__(self, oct_program, data, folder):
        self.oct, self.data, self.folder = str(oct_program), data, folder

    def run(self, *arguments):
        done = subprocess.run([self.oct, *map(str, arguments)], check=True, capture_output=True, text=True,
                              cwd=self.folder)
        return json.loads(done.stdout) if "--json" in arguments else None

    def model(self, name, *inputs):
        """Builds `name`.oct and returns what is known of it."""
        self.run("build", *inputs, "-o", f"{name}.oct", "--quiet")
        return self.run("info", f"{name}.oct", "--json")

    def picture(self, model, *more):
        self.run("render", model, "-o", "ours.png", "--size", f"{SIDE}x{SIDE}", *more)
        return Image.open(self.folder / "ours.png").convert("RGBA")


def white(picture):
    sheet = Image.new("RGBA", picture.size, "white")
    sheet.alpha_composite(picture)
    return sheet.convert("RGB")


def contour(samples, iso, affine):
    """pyvista's surface of samples[z, y, x], its points by the affine (index to mm)."""
    grid = pv.ImageData(dimensions=samples.shape[::-1])
    grid.point_data["v"] = samples.ravel()
    mesh = grid.contour([iso])
    mesh.points = mesh.points @ affine[:, :3].T + affine[:, 3]
    mesh.clear_data()
    return mesh


def of_volume(info, samples):
    return contour(samples, info["range"]["lo"], np.array(info["affine"]))


def of_scan(info, path):
    """The same of a file or a DICOM folder, by its own reader and geometry."""
    if path.is_dir():
        reader = SimpleITK.ImageSeriesReader()
        reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(path)))
        image = reader.Execute()
    else:
        image = SimpleITK.ReadImage(str(path))
    turn = np.array(image.GetDirection()).reshape(3, 3) * image.GetSpacing()
    affine = np.hstack([turn, np.array(image.GetOrigin())[:, None]])
    return contour(SimpleITK.GetArrayFromImage(image).astype(float), info["range"]["lo"], affine)


def solids():
    """The tree of figure 7 by its distance, on 256^3 samples."""
    at = np.linspace(-21, 21, 256)
    z, y, x = np.meshgrid(at, at, at, indexing="ij")
    body = np.maximum(np.max(np.abs([x, y, z]), 0) - 20, np.sqrt(x * x + y * y + z * z) - 26)
    for a, b in ((x, y), (x, z), (y, z)):
        body = np.maximum(body, 10 - np.hypot(a, b))
    step = at[1] - at[0]
    affine = np.hstack([np.eye(3) * step, np.full((3, 1), at[0])])
    return contour(-body, 0, affine)


def theirs(add, towards, ours, smooth, eye=None):
    """pyvista's picture: what `add` puts in, seen along `towards` by a parallel camera as wide as ours."""
    plotter = pv.Plotter(off_screen=True, window_size=(SIDE, SIDE))
    add(plotter, {"smooth_shading": True} if smooth else {})
    plotter.show(auto_close=False)
    if eye:
        plotter.camera.position, plotter.camera.focal_point = eye
        plotter.camera.up, plotter.camera.view_angle = (0, 0, 1), 35
        plotter.camera.clipping_range = (1, 1e4)
        plotter.render()
        return Image.fromarray(plotter.screenshot(return_img=True)).convert("RGB")
    along = np.array(towards, float) / np.linalg.norm(towards)
    middle, size = np.array(plotter.center), plotter.length
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point, camera.position, camera.up = middle, middle - along * 2 * size, (0, 0, 1)
    camera.parallel_scale = size / 2
    plotter.reset_camera_clipping_range()

    def shown():
        plotter.render()
        picture = np.array(plotter.screenshot(return_img=True))[..., :3]
        rows, columns = np.nonzero((picture < 250).any(-1))
        return picture, (columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2, np.ptp(columns), np.ptp(rows)
    cover = np.array(ours)[..., 3] > 128
    rows, columns = np.nonzero(cover)
    for _ in range(3):
        picture, x, y, wide, high = shown()
        pixel = 2 * camera.parallel_scale / SIDE
        right = np.cross(along, [0, 0, 1])
        right /= np.linalg.norm(right)
        shift = (right * (x - (columns.min() + columns.max()) / 2)
                 - np.cross(right, along) * (y - (rows.min() + rows.max()) / 2)) * pixel
        camera.focal_point, camera.position = np.array(camera.focal_point) + shift, np.array(camera.position) + shift
        camera.parallel_scale *= max(wide / np.ptp(columns), high / np.ptp(rows))
    return Image.fromarray(shown()[0])


def textured(folder):
    """A ball with the world's map, as glTF."""
    ball = trimesh.creation.uv_sphere(radius=1, count=[64, 128])
    n = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    # Longitude would jump within the last column: the faces across it stay, seen from behind.
    uv = np.stack([(np.arctan2(n[:, 1], n[:, 0]) / (2 * np.pi)) % 1, np.arcsin(n[:, 2].clip(-1, 1)) / np.pi + .5], -1)
    picture = Image.open(Path(pv.examples.__file__).parent / "2k_earth_daymap.jpg").resize((1024, 512))
    ball.visual = trimesh.visual.TextureVisuals(uv=uv, image=picture)
    # glTF has y up.
    ball.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    ball.export(folder / "earth.glb")
    return folder / "earth.glb"


def subjects(maker, smooth):
    """Name, our picture, theirs."""
    data, folder = maker.data, maker.folder
    one = lambda mesh: lambda plotter, look: plotter.add_mesh(mesh, **look)

    def both(name, model, mesh, view=FRONT, *more):
        ours = maker.picture(model, *more)
        return name, white(ours), theirs(one(mesh), view, ours, smooth)
    slices = sorted((data / "raw-cthead").glob("CThead.*"), key=lambda path: int(path.suffix[1:]))
    info = maker.model("cthead", *slices, "--dims", "256x256x113", "--dtype", "i16be", "--spacing", "1x1x2")
    head = np.stack([np.fromfile(path, ">i2").reshape(256, 256) for path in slices]).astype(float)
    yield both("CT head", "cthead.oct", of_volume(info, head))
    for name, path in (("CT, 5 mm slices", "ct-philips-28"), ("iguana", "nifti-iguana/Iguana.nii.gz"),
                       ("MR, 4.8 mm slices", "mr-sag-35")):
        yield both(name, "scan.oct", of_scan(maker.model("scan", data / path), data / path))
    chest = data / "raw-lidc-u8/lidc2_256x256x133_u8.raw"
    info = maker.model("chest", chest, "--dims", "256x256x133", "--dtype", "u8", "--spacing", "1.40625x1.40625x2.5")
    yield both("chest, 8 bits", "chest.oct", of_volume(info, np.fromfile(chest, "u1").reshape(133, 256, 256) * 1.0))
    for name, path in (("bunny", "bunny-closed.off"), ("mechanical part", "featuretype-closed.stl")):
        maker.model("mesh", data / "mesh" / path)
        shape = pv.wrap(trimesh.load(data / "mesh" / path))
        shape.clear_data()
        yield both(name, "mesh.oct", shape)
    earth = textured(folder)
    maker.model("earth", earth)
    ours = maker.picture("earth.oct")

    def world(plotter, _):
        plotter.import_gltf(str(earth))
        for actor in plotter.renderer.actors.values():
            actor.RotateX(90)
    yield "textured glTF", white(ours), theirs(world, FRONT, ours, smooth)
    yield both("tree of solids", "solids.oct", solids(), ISO, "--view", "iso")
    maker.run("demo", "--size", "256", "--write-raw", "head.raw")
    head = np.fromfile(folder / "head.raw", "<i2").reshape(256, 256, 256).astype(float)
    affine = np.array(maker.run("info", "skull.oct", "--json")["affine"])
    skull, skin = contour(head, 400, affine), contour(head, -400, affine)
    yield both("figure 9: skull", "skull.oct", skull, ISO, "--view", "iso")
    ours = maker.picture("cut.toml")

    def cut(plotter, look):
        plotter.add_mesh(skin.clip("x", origin=(0, 0, 0)), color="tan", **look)
        plotter.add_mesh(skull, color="ivory", **look)
    yield "a cut", white(ours), theirs(cut, ISO, ours, smooth)
    ours = maker.picture("scene.toml")

    def scene(plotter, look):
        plotter.set_background("#8aa4b8")
        plotter.add_mesh(pv.ParametricTorus(ringradius=30, crosssectionradius=9).translate((-44, 4, 12)), color="silver",
                         **look)
        at = np.linspace(-25, 25, 256)
        z, y, x = np.meshgrid(at, at, at, indexing="ij")
        hollow = np.maximum(np.sqrt(x * x + y * y + z * z) - 24,
                            16 - np.sqrt((x - 14) ** 2 + (y + 18) ** 2 + (z - 14) ** 2))
        affine = np.hstack([np.eye(3) * (at[1] - at[0]), np.full((3, 1), at[0])])
        plotter.add_mesh(contour(-hollow, 0, affine).translate((34, 0, 27)), color="#c04030", **look)
        plotter.add_mesh(pv.Box((-100, 100, -80, 80, -3, 3)), color="#b0b8b0", **look)
    yield "a scene", white(ours), theirs(scene, None, ours, smooth, eye=((30, -260, 120), (0, 0, 14)))


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("oct", "data", "out"):
        args.add_argument(name, type=lambda text: Path(text).resolve())
    args.add_argument("--smooth", action="store_true")
    args.add_argument("--grey", action="store_true")
    args.add_argument("--seed", type=int, default=1)
    args = args.parse_args()
    folder = args.out / "made"
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([Path(__file__).with_name("gallery.sh"), folder], check=True, stdout=subprocess.DEVNULL,
                   env={**os.environ, "OCT": str(args.oct), "SIDE": str(SIDE)})
    pairs = list(subjects(Maker(args.oct, args.data, folder), args.smooth))
    chance = random.Random(args.seed)
    chance.shuffle(pairs)
    with open(args.out / "key.tsv", "w", encoding="utf-8") as key:
        for number, (name, ours, others) in enumerate(pairs, 1):
            left = chance.random() < .5
            sheet = Image.new("RGB", (2 * SIDE + 16, SIDE), "white")
            sheet.paste(ours if left else others, (0, 0))
            sheet.paste(others if left else ours, (SIDE + 16, 0))
            (sheet.convert("L") if args.grey else sheet).save(args.out / f"{number:02}.png")
            key.write(f"{number:02}\t{name}\t{'oct' if left else 'pyvista'}\t{'pyvista' if left else 'oct'}\n")


if __name__ == "__main__":
    main()
