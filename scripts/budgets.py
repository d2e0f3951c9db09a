#!/usr/bin/env python3
"""Is the smallest budget that a refusal names true? For inputs of every kind: the build with it works, a build with
256 KiB less than the least that works is the most it is off, and peaks stay below 6, 8, 16 and 64 MiB.
Standard library and GNU time only.

    scripts/budgets.py [--oct PATH] [--only TEXT] [--keep FOLDER] [--verbose]

Volumes, meshes in six formats and trees are made here; INFOBYTE_DATA, if set, names a folder of real ones.
Exit 1 if a figure is false. What is refused for another reason than memory is left out, and counted.
"""

import argparse
import itertools
import json
import math
import os
import re
import struct
import sys
import tempfile
import zlib

sys.dont_write_bytecode = True  # before measure: no __pycache__ in the working tree
import measure  # noqa: E402
import memory  # noqa: E402

KIB, STEP = 1024, 64 * 1024
SLACK = 256 * KIB  # how far a named budget may lie above the least that works
CAPS = ("6MiB", "8MiB", "16MiB", "64MiB")


def volumes(folder):
    """Raw volumes of every type, several shapes, and what may be done to them."""
    small = [["--iso", None], []]
    more = [["--surface", "cells", "--iso", None], ["--channels", "normal,value", "--iso", None],
            ["--keep-largest", "1", "--iso", None], ["--close", "2", "--iso", None], ["--fill-cavities", "--iso", None],
            ["--downsample", "2", "--iso", None], ["--gradient", "auto", "--iso", None], ["--threads", "1"]]
    for kind, dims, dtype in itertools.chain(
            ((k, (64, 60, 50), d) for k in ("ball", "noise") for d in ("u8", "i16", "u16", "f32", "f64be")),
            ((k, d, "u16") for k in ("ball",) for d in ((700, 64, 20), (2048, 96, 8), (9, 9, 300)))):
        path = os.path.join(folder, f"{kind}-{'x'.join(map(str, dims))}-{dtype}.raw")
        memory.write_volume(path, kind, dims, dtype)
        for extra in small + (more if dtype in ("u16", "f32") else []):
            extra = [str(memory.iso(dtype)) if part is None else part for part in extra]
            yield [path, "--dims", "x".join(map(str, dims)), "--dtype", dtype, *extra]


def png(width, height, interlaced=False, color=2):
    """A picture without a filter, grey or in colours."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    depth = 3 if color == 2 else 1

    def rows(x0, y0, dx, dy):
        columns, lines = len(range(x0, width, dx)), range(y0, height, dy)
        return b"".join(b"\0" + bytes((x * 7 + y * 3) % 251 for x in range(columns * depth)) for y in lines if columns)
    seven = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]
    data = b"".join(rows(*p) for p in (seven if interlaced else [(0, 0, 1, 1)]))
    head = struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, interlaced)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data, 1)) + chunk(b"IEND", b"")


def surface(rings, open_rings=0, holes=0):
    """A ball of triangles; without some rings at its top, and some faces, it is open."""
    points = [(0.0, 0.0, 10.0)]
    for i in range(1, rings):
        for j in range(2 * rings):
            a, b = math.pi * i / rings, math.pi * j / rings
            points.append((10 * math.sin(a) * math.cos(b), 10 * math.sin(a) * math.sin(b), 10 * math.cos(a)))
    points.append((0.0, 0.0, -10.0))
    n, last = 2 * rings, len(points) - 1
    at = lambda i, j: 1 + (i - 1) * n + j % n
    faces = [] if open_rings else [(0, at(1, j), at(1, j + 1)) for j in range(n)]
    for i in range(1 + open_rings, rings - 1):
        for j in range(n):
            faces += [(at(i, j), at(i + 1, j), at(i + 1, j + 1)), (at(i, j), at(i + 1, j + 1), at(i, j + 1))]
    faces += [(last, at(rings - 1, j + 1), at(rings - 1, j)) for j in range(n)]
    return points, [face for k, face in enumerate(faces) if not holes or k % holes]


def mesh(path, points, faces, colors=False, texture=None):
    """Writes a mesh in the format of the suffix."""
    suffix = path.rsplit(".", 1)[1]
    if suffix == "stl":
        body = b"".join(struct.pack("<12fH", 0, 0, 0, *sum((points[k] for k in f), ()), 0) for f in faces)
        data = b"\0" * 80 + struct.pack("<I", len(faces)) + body
    elif suffix == "ply":
        extra = "property uchar red\nproperty uchar green\nproperty uchar blue\n" if colors else ""
        head = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\n"
                f"property float y\nproperty float z\n{extra}element face {len(faces)}\n"
                "property list uchar int vertex_indices\nend_header\n").encode()
        color = b"\x80\x40\x20" if colors else b""
        data = head + b"".join(struct.pack("<3f", *p) + color for p in points)
        data += b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    elif suffix == "off":
        lines = [f"OFF\n{len(points)} {len(faces)} 0"] + ["%g %g %g" % p for p in points]
        data = "\n".join(lines + ["3 %d %d %d" % f for f in faces] + [""]).encode()
    elif suffix == "obj":
        lines = ["v %g %g %g" % p + (" 0.5 0.2 0.1" if colors else "") for p in points]
        if texture:
            name = os.path.basename(path)
            with open(path + ".mtl", "w", encoding="ascii") as out:
                out.write(f"newmtl m\nmap_Kd {os.path.basename(texture)}\n")
            lines = [f"mtllib {name}.mtl", *lines, "usemtl m", "vt 0 0", "vt 1 0", "vt 0 1"]
            lines += ["f %d/1 %d/2 %d/3" % tuple(k + 1 for k in f) for f in faces]
        else:
            lines += ["f %d %d %d" % tuple(k + 1 for k in f) for f in faces]
        data = "\n".join(lines + [""]).encode()
    elif suffix == "glb":
        binary = b"".join(struct.pack("<3f", *p) for p in points) + b"".join(struct.pack("<3I", *f) for f in faces)
        split = 12 * len(points)
        views = [{"buffer": 0, "byteOffset": 0, "byteLength": split},
                 {"buffer": 0, "byteOffset": split, "byteLength": 12 * len(faces)}]
        described = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(binary)}], "bufferViews": views,
                     "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
                                   {"bufferView": 1, "componentType": 5125, "count": 3 * len(faces), "type": "SCALAR"}],
                     "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
                     "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}
        text = json.dumps(described).encode()
        text += b" " * (-len(text) % 4)
        data = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(binary), len(text), b"JSON") + text
        data += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    else:
        raise ValueError(suffix)
    with open(path, "wb") as out:
        out.write(data)
    return path


def meshes(folder):
    """Balls, closed and open, small and large, in every format; with colours, textures, and other rules."""
    shapes = {"closed": (40, 0, 0), "open": (40, 4, 0), "holes": (60, 0, 9), "large": (200, 0, 0), "wide": (120, 60, 0)}
    for (name, of), suffix in itertools.product(shapes.items(), ("stl", "ply", "off", "obj", "glb")):
        path = mesh(os.path.join(folder, f"{name}.{suffix}"), *surface(*of))
        for extra in ([["--grid", "64"], ["--grid", "256"]] if suffix in ("ply", "obj", "glb") else [["--grid", "96"]]):
            yield [path, *extra]
    for suffix in ("ply", "obj"):
        path = mesh(os.path.join(folder, f"colored.{suffix}"), *surface(40), colors=True)
        yield from ([path, "--grid", n] for n in ("64", "300"))
    for name, extra in (("closed", ["--surface", "cells"]), ("open", ["--surface", "cells"]), ("closed", ["--keep-thin"]),
                        ("open", ["--fill", "surface"]), ("open", ["--fill", "parity"]), ("closed", ["--channels", "normal"]),
                        ("holes", ["--channels", "normal,material"]), ("closed", ["--threads", "1"])):
        yield from ([os.path.join(folder, f"{name}.{s}"), "--grid", "100", *extra] for s in ("stl", "obj"))
    for width, interlaced in ((64, False), (600, False), (300, True), (1500, True)):
        texture = os.path.join(folder, f"t{width}{interlaced}.png")
        with open(texture, "wb") as out:
            out.write(png(width, width, interlaced))
        path = mesh(os.path.join(folder, f"textured{width}{interlaced}.obj"), *surface(30), texture=texture)
        yield [path, "--grid", "80"]


def tree(count, depth=0, faces=0):
    """A tree of spheres in a row, in so many nested places, and a polyhedron of about so many faces."""
    ball = "multmatrix([[1,0,0,%d],[0,1,0,%d],[0,0,1,0],[0,0,0,1]]) { sphere(r = 1.2); }\n"
    text = "union() {\n" + "".join(ball % (k % 37, k // 37) for k in range(count)) + "}\n"
    nested = "multmatrix([[1,0,0,0.00001],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {\n"
    text = nested * depth + text + "}\n" * depth
    if faces:
        points, triangles = surface(max(4, int((faces / 4) ** 0.5)))
        text += f"polyhedron(points = {[list(p) for p in points]}, faces = {[list(t) for t in triangles]});\n"
    return text


def trees(folder):
    """Trees of many leaves, deep ones, large polyhedra, and some with files."""
    for count, depth, faces in ((1, 0, 0), (40, 0, 0), (1000, 0, 0), (9000, 0, 0), (3, 2000, 0), (3, 30000, 0),
                                (3, 100000, 0), (1, 0, 500), (1, 0, 8000), (1, 0, 40000), (500, 500, 2000)):
        path = os.path.join(folder, f"tree-{count}-{depth}-{faces}.csg")
        with open(path, "w", encoding="ascii") as out:
            out.write(tree(count, depth, faces))
        yield from ([path, "--grid", n, *extra] for n, extra in (("48", []), ("200", []), ("64", ["--surface", "cells"])))
    path = os.path.join(folder, "imports.csg")
    with open(path, "w", encoding="ascii") as out:
        out.write('difference() { import(file = "closed.stl"); multmatrix([[1,0,0,6],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) '
                  '{ import(file = "large.ply"); } }\n')
    yield from ([path, "--grid", n] for n in ("64", "200"))


def real(data):
    """What lies in a folder of real data: series, files of volumes, meshes."""
    meshes_of = ("stl", "ply", "obj", "off", "gltf", "glb", "3mf")
    for folder, _, names in sorted(os.walk(data)):
        series = [n for n in names if n.endswith(".dcm") or "." not in n or n.split(".")[-1].isdigit()]
        if len(series) > 1 and "raw" not in os.path.basename(folder):
            yield [folder]
        for name in sorted(names):
            path = os.path.join(folder, name)
            if name.lower().rsplit(".", 1)[-1] in meshes_of:
                yield [path, "--grid", "64"]
            elif name.endswith((".nrrd", ".nii.gz", ".nii", ".mha")) or (name.endswith(".dcm") and len(series) < 40):
                yield [path]


class Builds:
    """Builds of one input under several caps."""

    def __init__(self, oct_path, arguments, out):
        surface = [] if "--surface" in arguments else ["--surface", "skin"]
        self.command = [oct_path, "build", *arguments, *surface, "-o", out, "--json", "--quiet"]

    def run(self, cap):
        """A build: its exit code, its peak, and the cap that a refusal names."""
        cap = cap if isinstance(cap, str) else f"{cap // KIB}KiB"
        done = measure.run([*self.command, "--memory", cap])
        named = re.search(r"(?:smallest that works is|raise) --memory (?:to )?([0-9.]+ ?[KMG]iB)", done.message())
        return done, measure.size_bytes(named.group(1).replace(" ", "")) if named and done.code == 4 else None

    def least(self, works):
        """The least cap that works, found by halving from one that does; in steps of 64 KiB."""
        low, high = 4 << 20, works
        while high - low > STEP:
            middle = (low + high) // 2 // STEP * STEP
            low, high = (low, middle) if self.run(middle)[0].code == 0 else (middle, high)
        return high


def judge(builds):
    """What is false about one input, its row of the table, and whether it was built at all."""
    done, named = builds.run("5MiB")
    wrong = []
    if done.code == 0:
        return wrong, "5MiB works", 0
    if done.code != 4:
        return wrong, None, 0
    if named is None:
        return ["the refusal names no budget: " + done.message()], "none", 0
    first, told = named, 1
    done, again = builds.run(named)
    while again is not None and told < 6:
        told, named = told + 1, again
        done, again = builds.run(named)
    if told > 1:
        wrong.append(f"{first // KIB} KiB was named, {named // KIB} KiB at the {told}th time")
    if done.code not in (0, 3):
        wrong.append(f"{named // KIB} KiB does not work: {done.message()}")
    if done.code != 0:
        return wrong, None if done.code == 3 else f"{named // KIB}", 0
    least = builds.least(named)
    if first - least > SLACK:
        wrong.append(f"{first // KIB} KiB was named, {least // KIB} KiB works")
    for cap in (*CAPS, f"{named // KIB}KiB"):
        run, _ = builds.run(cap)
        if run.worst_bytes() > measure.size_bytes(cap):
            wrong.append(f"peak {run.worst_bytes() // KIB} KiB under {cap}, exit {run.code}")
    return wrong, f"{first // KIB} / {least // KIB}", first - least


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--oct", default="target/release/oct")
    parser.add_argument("--only", default="", help="only inputs whose arguments have this text")
    parser.add_argument("--keep", help="make the inputs in this folder, and leave them there")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    if not measure.has_gnu_time():
        raise SystemExit("GNU time is needed: Python's own peak counts into what it starts")
    temporary = tempfile.TemporaryDirectory()
    folder = args.keep or temporary.name
    os.makedirs(folder, exist_ok=True)
    data = os.environ.get("INFOBYTE_DATA")
    kinds = {"volumes": volumes(folder), "meshes": meshes(folder), "trees": trees(folder),
             "real": real(data) if data else ()}
    rows, failed = [], 0
    for kind, inputs in kinds.items():
        judged, false, refused, most = 0, 0, 0, 0
        for arguments in inputs:
            shown = " ".join(os.path.relpath(a, folder) if os.path.isabs(a) and not data else a for a in arguments)
            if args.only not in shown:
                continue
            wrong, figure, over = judge(Builds(os.path.abspath(args.oct), arguments, os.path.join(temporary.name, "o.oct")))
            judged, refused = judged + (figure is not None), refused + (figure is None)
            false, most = false + bool(wrong), max(most, over)
            if wrong or args.verbose:
                print(f"{shown}: {figure}", *(f"\n    {w}" for w in wrong), flush=True)
        rows.append([kind, judged, false, most // KIB, refused])
        failed += false
    measure.table(["kind", "inputs", "false", "most above, KiB", "refused otherwise"], rows)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
