#!/usr/bin/env python3
"""Writes small synthetic studies with known truth, in every form that `oct` should read.

One physical object (an asymmetric union of two ellipsoids and a box in mm, in values like HU, with a little
noise) is written as DICOM, NRRD, NIfTI, MetaImage, TIFF, PNG, .npy and raw, with the odd cases that users have:
tilt, oblique axes, gaps, duplicates, several volumes, padding, wide and signed pixels, missing headers. Spacing
and origin are binary fractions, so that formats with singles and with decimal text state them exactly.

OUT/truth.json says for each study what a right reading gives: dims, affine (voxel index to LPS mm), range, skin
count at a threshold, or why it must be refused. Studies with the same `same` must give the same structure and
normals byte for byte. OUT/truth/*.npy hold the physical values [z, y, x]. check_studies.py compares.

Needs Python 3.10 and scripts/requirements-check.txt. About 55 MB.

usage: make_studies.py OUT [--seed N]
"""
import argparse
import bz2
import gzip
import json
import shutil
import sys
import zlib
from pathlib import Path

import imagecodecs
import nibabel
import numpy as np
import SimpleITK
import tifffile

import check_lib as lib
import study_mosaic
from study_dicom import DicomStudies

DIMS = (48, 40, 36)
SPACING = (0.75, 0.875, 1.5)
ORIGIN = (-21.0, -17.5, 30.0)
ISO = 200.0


def base_object(seed):
    """Values [z, y, x] in -1000..1500, i16, and no symmetry under any flip or swap of axes."""
    z, y, x = np.meshgrid(*[np.arange(n) * s for n, s in zip(DIMS[::-1], SPACING[::-1])], indexing="ij")

    def ball(centre, radii):
        return sum(((a - c) / r) ** 2 for a, c, r in zip((x, y, z), centre, radii)) ** 0.5 - 1.0

    def box(low, high):
        gaps = [np.maximum(lo - a, a - hi) for a, lo, hi in zip((x, y, z), low, high)]
        return np.maximum.reduce(gaps) / 4.0

    field = np.minimum.reduce([ball((15, 15, 20), (10, 9, 14)), ball((25, 22, 38), (6, 8, 9)),
                               box((22.0, 4.0, 6.0), (33.0, 13.0, 17.0))])
    values = np.clip(200.0 - 1500.0 * field, -1000.0, 1400.0)
    noise = np.random.default_rng(seed).integers(-40, 41, values.shape)
    return np.clip(np.rint(values) + noise, -1000, 1500).astype(np.int16)


class Studies:
    """Collects the files and what is true of them."""

    def __init__(self, out, seed):
        self.out, self.seed, self.entries, self.saved = out, seed, [], {}
        self.rng = np.random.default_rng(seed + 1)
        self.base = base_object(seed)
        self.affine = np.column_stack([np.diag(SPACING), ORIGIN])
        self.unit = np.column_stack([np.eye(3), np.zeros(3)])

    def path(self, name):
        """A place for a file or folder of a study."""
        path = self.out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def folder(self, name):
        path = self.out / name
        path.mkdir(parents=True, exist_ok=True)
        return path

    def save(self, values):
        key = (values.shape, values.dtype.str, values.tobytes())
        if key not in self.saved:
            name = f"truth/values-{len(self.saved):02d}.npy"
            np.save(self.path(name), values)
            self.saved[key] = name
        return self.saved[key]

    def add(self, name, values=None, affine=None, *, expect="converts", same=None, iso=ISO, options=(), reason="",
            origin=True, others=(), tolerance=1e-3, note="", lossy=0.0, geometry_only=False,
            warn=""):
        """Records the truth of the study at `name` (a file or folder below OUT).

        same: studies with equal names give equal bytes; None if there is nothing to compare with.
        lossy: part of the skin that may differ. geometry_only: values are not compared.
        warn: what a warning must match if it converts.
        affine None: any. origin False: only the axes count. others: further volumes that may be taken instead.
        """
        entry = {"name": name, "path": name.split("#")[0], "expect": expect, "options": list(options), "iso": iso,
                 "same": same, "reason": reason, "note": note, "lossy": lossy,
                 "warn": warn}
        if values is not None:
            volumes = [(values, affine), *others]
            entry["volumes"] = [{
                "dims": list(v.shape[::-1]), "affine": None if a is None else np.asarray(a).tolist(),
                "origin": origin, "tolerance_mm": tolerance, "min": float(np.nanmin(v)), "max": float(np.nanmax(v)),
                "skin": int(lib.skin(lib.select(v, iso, None)).sum()), "values": None if geometry_only else self.save(v),
            } for v, a in volumes]
        self.entries.append(entry)


# --- NRRD -------------------------------------------------------------------------------------------------

NRRD_TYPES = {"i2": "short", "u2": "ushort", "u1": "uchar", "i4": "int", "f4": "float", "f8": "double", "i1": "int8"}


def nrrd_header(array, affine, encoding, *, endian="little", space="left-posterior-superior", data=(), extra=(),
                newline="\n", kinds=True):
    """Header text; the array is [z, y, x] (or [z, y, x, list])."""
    flip = {"left-posterior-superior": (1, 1), "right-anterior-superior": (-1, -1), "RAS": (-1, -1), "LPS": (1, 1),
            "left-anterior-superior": (1, -1), "LAS": (1, -1)}[space]
    turned = np.diag([*flip, 1.0]) @ affine
    vector = lambda v: "(" + ",".join(repr(float(c)) for c in v) + ")"
    directions = [vector(turned[:, a]) for a in range(3)]
    sizes = list(array.shape[::-1])
    names = ["domain"] * 3
    if len(sizes) == 4:
        directions, names = ["none", *directions], ["list", *names]
    lines = ["NRRD0005", "# made for tests", f"type: {NRRD_TYPES[array.dtype.str[1:]]}", f"dimension: {len(sizes)}",
             f"space: {space}", "sizes: " + " ".join(map(str, sizes)),
             "space directions: " + " ".join(directions)]
    lines += ["kinds: " + " ".join(names)] if kinds else []
    lines += [f"endian: {endian}"] if array.dtype.itemsize > 1 else []
    lines += [f"encoding: {encoding}", "space origin: " + vector(turned[:, 3]), "patient:=nobody", *extra, *data]
    return newline.join(lines) + newline


def nrrd_studies(s):
    base, affine = s.base, s.affine
    raw = base.astype("<i2").tobytes()

    def attached(name, header, body, **truth):
        s.path(name).write_bytes(header.encode() + b"\n" + body)
        s.add(name, truth.pop("values", base.astype(float)), truth.pop("affine", affine),
              **{"same": "base", **truth})

    attached("nrrd/raw.nrrd", nrrd_header(base, affine, "raw"), raw)
    attached("nrrd/gzip.nrrd", nrrd_header(base, affine, "gzip"), gzip.compress(raw))
    attached("nrrd/gz-two-members.nrrd", nrrd_header(base, affine, "gz"),
             gzip.compress(raw[:50000]) + gzip.compress(raw[50000:]), note="several gzip members in a row are legal")
    attached("nrrd/bzip2.nrrd", nrrd_header(base, affine, "bzip2"), bz2.compress(raw), expect="either",
             reason="bz")
    attached("nrrd/ascii.nrrd", nrrd_header(base, affine, "ascii"),
             "\n".join(" ".join(map(str, r)) for r in base.reshape(-1, DIMS[0])).encode(), expect="either",
             reason="ascii|text|encoding")
    attached("nrrd/hex.nrrd", nrrd_header(base, affine, "hex"), raw.hex().encode(), expect="either",
             reason="hex|encoding")
    attached("nrrd/big-endian.nrrd", nrrd_header(base, affine, "raw", endian="big"), base.astype(">i2").tobytes())
    attached("nrrd/big-endian-gzip.nrrd", nrrd_header(base, affine, "gzip", endian="big"),
             gzip.compress(base.astype(">i2").tobytes()))
    attached("nrrd/crlf.nrrd", nrrd_header(base, affine, "raw", newline="\r\n").rstrip("\n").rstrip("\r") + "\r\n\r",
             raw, note="lines end in CR LF, the empty one too")
    for space in ("RAS", "right-anterior-superior", "LPS", "left-anterior-superior", "LAS"):
        attached(f"nrrd/space-{space}.nrrd", nrrd_header(base, affine, "gzip", space=space), gzip.compress(raw))
    attached("nrrd/byte-skip.nrrd", nrrd_header(base, affine, "raw", extra=["byte skip: 17"]), b"x" * 17 + raw)
    attached("nrrd/byte-skip-minus-1.nrrd", nrrd_header(base, affine, "raw", extra=["byte skip: -1"]),
             b"x" * 999 + raw)
    attached("nrrd/line-skip.nrrd", nrrd_header(base, affine, "raw", extra=["line skip: 2"]), b"one\ntwo\n" + raw)
    attached("nrrd/no-kinds.nrrd", nrrd_header(base, affine, "raw", kinds=False), raw)
    for kind in ("i4", "f4", "f8"):
        wide = base.astype("<" + kind)
        attached(f"nrrd/{kind}.nrrd", nrrd_header(wide, affine, "raw"), wide.tobytes())
    oblique = s.oblique()
    attached("nrrd/oblique.nrrd", nrrd_header(base, oblique, "gzip"), gzip.compress(raw), affine=oblique,
             same="base", note="the frame of the normals is the box, so bytes equal the straight ones")
    negative = s.affine.copy()
    negative[:, 1] *= -1
    attached("nrrd/left-handed.nrrd", nrrd_header(base, negative, "raw"), raw, affine=negative)
    header = nrrd_header(base, affine, "raw").replace("space: left-posterior-superior\n", "space dimension: 3\n")
    attached("nrrd/no-space.nrrd", header, raw, affine=None, note="directions without a named space")
    header = "\n".join(["NRRD0001", "type: short", "dimension: 3", "sizes: 48 40 36", "spacings: 0.75 0.875 1.5",
                        "endian: little", "encoding: raw"]) + "\n"
    attached("nrrd/spacings-only.nrrd", header, raw, origin=False)
    header = nrrd_header(base, affine, "raw").replace("sizes: 48 40 36", "sizes: 48 40 37")
    attached("nrrd/x-short.nrrd", header, raw, expect="refused", reason="short|bytes|ends|needed")
    attached("nrrd/x-gzip-cut.nrrd", nrrd_header(base, affine, "gzip"), gzip.compress(raw)[:-500], expect="refused",
             reason="gzip|ends|cut|short|damaged")
    listed = np.stack([base, base[::-1] // 2], axis=-1).astype("<i2")
    attached("nrrd/list-axis-4d.nrrd", nrrd_header(listed, affine, "raw"), listed.tobytes(), expect="either",
             reason="axis|axes|dimension|list|4", others=[((base[::-1] // 2).astype(float), affine)], same=None)

    def detached(name, header, files, **truth):
        s.path(name).write_text(header)
        for file, body in files.items():
            s.path("nrrd/" + file).write_bytes(body)
        s.add(name, base.astype(float), affine, same="base", **truth)

    detached("nrrd/detached.nhdr", nrrd_header(base, affine, "raw", data=["data file: detached.bin"]),
             {"detached.bin": raw})
    detached("nrrd/detached-gz.nhdr", nrrd_header(base, affine, "gzip", data=["datafile: detached.bin.gz"]),
             {"detached.bin.gz": gzip.compress(raw)})
    slices = [base[z].astype("<i2").tobytes() for z in range(DIMS[2])]
    names = [f"list-{z * 7 % 36:02d}.bin" for z in range(DIMS[2])]
    detached("nrrd/list.nhdr", nrrd_header(base, affine, "raw", data=["data file: LIST", *names]),
             dict(zip(names, slices)), note="the order of the list, not of the names, counts")
    detached("nrrd/pattern.nhdr", nrrd_header(base, affine, "raw", data=["data file: pattern-%03d.bin 1 36 1"]),
             {f"pattern-{z + 1:03d}.bin": slices[z] for z in range(DIMS[2])})
    detached("nrrd/pattern-down.nhdr", nrrd_header(base, affine, "raw", data=["data file: down-%d.bin 108 3 -3"]),
             {f"down-{108 - 3 * z}.bin": slices[z] for z in range(DIMS[2])})
    detached("nrrd/x-missing-data.nhdr", nrrd_header(base, affine, "raw", data=["data file: nowhere.bin"]), {},
             expect="refused", reason="nowhere|cannot be read|exist")


# --- NIfTI ------------------------------------------------------------------------------------------------


def nifti_studies(s):
    base = s.base
    ras = np.vstack([lib.FLIP_XY @ s.affine, [0, 0, 0, 1]])

    def image(array, affine=ras, kind=nibabel.Nifti1Image, sform=2, qform=1, units="mm"):
        made = kind(np.ascontiguousarray(array).T if array.ndim == 3 else array, affine, dtype=array.dtype)
        made.header.set_xyzt_units(units)
        made.set_sform(affine if sform else None, sform)
        made.set_qform(affine if qform else None, qform)
        return made

    def write(name, made, values=None, affine=s.affine, patch=(), **truth):
        nibabel.save(made, s.path(name))
        if patch:
            data = bytearray(s.path(name).read_bytes())
            for at, new in patch:
                data[at:at + len(new)] = new
            s.path(name).write_bytes(data)
        s.add(name, base.astype(float) if values is None else values, affine, **{"same": "base", **truth})

    single = lambda v: np.array(v, "<f4").tobytes()
    two = nibabel.Nifti2Image
    write("nifti/one.nii", image(base))
    write("nifti/one-gz.nii.gz", image(base))
    write("nifti/two.nii", image(base, kind=two))
    write("nifti/two-gz.nii.gz", image(base, kind=two))
    write("nifti/pair.hdr", image(base, kind=nibabel.Nifti1Pair))
    write("nifti/pair2.hdr", image(base, kind=nibabel.Nifti2Pair))
    s.add("nifti/pair.img", base.astype(float), s.affine, same="base", expect="either", reason="hdr|header")
    s.add("nifti/x-lonely.img", expect="refused", reason="hdr|header|not DICOM|NIfTI")
    s.path("nifti/x-lonely.img").write_bytes(base.tobytes())
    for kind, name in ((nibabel.Nifti1Image, "big-endian.nii"), (two, "two-big-endian.nii"),
                       (nibabel.Nifti1Image, "big-endian-gz.nii.gz")):
        made = image(base.astype(">i2"), kind=kind)
        header = made.header.as_byteswapped(">")
        write("nifti/" + name, kind(made.dataobj, ras, header, dtype=">i2"))
    write("nifti/qform-only.nii", image(base, sform=0))
    write("nifti/sform-only.nii", image(base, qform=0))
    write("nifti/no-form.nii", image(base, sform=0, qform=0), affine=None, note="neither form: spacing alone is known")
    oblique = s.oblique()
    turned = np.vstack([lib.FLIP_XY @ oblique, [0, 0, 0, 1]])
    write("nifti/oblique-sform.nii", image(base, turned, qform=0), affine=oblique, same=None,
          note="singles: spacing is not exact, so bytes need not be equal")
    write("nifti/oblique-qform.nii", image(base, turned, sform=0), affine=oblique)
    flipped = s.affine.copy()
    flipped[:, 0] *= -1
    write("nifti/qfac-minus.nii", image(base, np.vstack([lib.FLIP_XY @ flipped, [0, 0, 0, 1]]), sform=0),
          affine=flipped, note="left-handed by qfac = -1")
    sheared = s.sheared()
    write("nifti/sheared-sform.nii", image(base, np.vstack([lib.FLIP_XY @ sheared, [0, 0, 0, 1]]), qform=0),
          affine=sheared, same="tilt")
    micron = ras * np.array([1000.0] * 3 + [1.0])[:, None]
    micron[3] = [0, 0, 0, 1]
    write("nifti/micron.nii", image(base, micron, units="micron"), note="lengths stated in micrometres")
    write("nifti/unit-unknown.nii", image(base, units="unknown"))
    half = (base.astype(int) + 1024).astype(np.int16)
    scaled = half * 0.5 - 512.0
    write("nifti/scl-slope.nii", image(half), scaled, patch=[(112, single(0.5)), (116, single(-512.0))], iso=100.0)
    write("nifti/scl-slope-0.nii", image(base), patch=[(112, single(0.0)), (116, single(77.0))],
          note="a slope of 0 means no scaling, the offset included")
    write("nifti/scl-slope-nan.nii", image(base), patch=[(112, single(np.nan)), (116, single(np.nan))])
    write("nifti/scl-negative.nii", image((-base).astype(np.int16)), patch=[(112, single(-1.0)), (116, single(0.0))],
          same="structure:base")
    for kind in ("u1", "u2", "i4", "f4", "f8"):
        array = np.clip(base // 10 + 100, 0, 255) if kind == "u1" else base.astype(int) + (2000 if kind == "u2" else 0)
        array = array.astype(kind)
        iso = {"u1": 120.0, "u2": 2200.0}.get(kind, ISO)
        write(f"nifti/type-{kind}.nii.gz", image(array), array.astype(float), iso=iso,
              same=None if kind == "u1" else "base")
    holes = base.astype("<f4")
    holes[:3] = np.nan
    write("nifti/nan.nii", image(holes), holes.astype(float), same=None)
    shifted = base.astype(np.uint16) if base.min() >= 0 else (base.astype(int) + 40000).astype(np.uint16)
    write("nifti/u16-above-32767.nii", image(shifted), shifted.astype(float), iso=ISO + 40000)
    extended = image(base)
    extended.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"x" * 500))
    write("nifti/extension.nii", extended, note="the voxels begin after an extension")
    four = np.stack([base.T, base.T], -1)
    write("nifti/four-1.nii", image(four[..., :1]))
    four[..., 1] //= 2
    write("nifti/four-2.nii.gz", image(four), expect="either", reason="4|volumes|dimension|time|four",
          others=[((base // 2).astype(float), s.affine)], same=None)
    write("nifti/x-short.nii", image(base), patch=[(46, np.array(40, "<i2").tobytes())], expect="refused",
          reason="short|bytes|ends|needed")
    write("nifti/x-dims-negative.nii", image(base), patch=[(42, np.array(-48, "<i2").tobytes())], expect="refused",
          reason="dim|size")
    write("nifti/x-complex.nii", image(base.astype(np.complex64)), expect="refused", reason="complex|type",
          note="complex numbers")
    cut = s.path("nifti/one-gz.nii.gz").read_bytes()
    s.path("nifti/x-gz-cut.nii.gz").write_bytes(cut[:-3000])
    s.add("nifti/x-gz-cut.nii.gz", expect="refused", reason="gzip|ends|cut|short|damaged")


# --- MetaImage --------------------------------------------------------------------------------------------


def meta_header(array, affine, data, *, msb="False", extra=(), origin="Offset", compressed=None):
    spacing = np.linalg.norm(affine[:, :3], axis=0)
    axes = (affine[:, :3] / spacing).T  # one row for each index axis
    number = lambda v: " ".join(repr(float(c)) for c in np.ravel(v))
    kind = {"i2": "MET_SHORT", "u2": "MET_USHORT", "u1": "MET_UCHAR", "f4": "MET_FLOAT", "i4": "MET_INT"}
    lines = ["ObjectType = Image", f"NDims = {array.ndim}", "BinaryData = True", f"BinaryDataByteOrderMSB = {msb}",
             f"CompressedData = {compressed is not None}"]
    lines += [f"CompressedDataSize = {compressed}"] if compressed else []
    lines += [f"TransformMatrix = {number(axes)}", f"{origin} = {number(affine[:, 3])}",
              "CenterOfRotation = 11 12 13", "AnatomicalOrientation = RAI", f"ElementSpacing = {number(spacing)}",
              "DimSize = " + " ".join(map(str, array.shape[::-1])), *extra,
              f"ElementType = {kind[array.dtype.str[1:]]}", f"ElementDataFile = {data}"]
    return ("\n".join(lines) + "\n").encode()


def meta_studies(s):
    base, affine = s.base, s.affine
    raw = base.astype("<i2").tobytes()

    def write(name, header, body=b"", files=None, values=None, at=affine, **truth):
        s.path(name).write_bytes(header + body)
        for file, content in (files or {}).items():
            s.path("meta/" + file).write_bytes(content)
        s.add(name, base.astype(float) if values is None else values, at, **{"same": "base", **truth})

    write("meta/local.mha", meta_header(base, affine, "LOCAL"), raw)
    write("meta/detached.mhd", meta_header(base, affine, "detached.raw"), files={"detached.raw": raw})
    packed = zlib.compress(raw)
    write("meta/zlib.mha", meta_header(base, affine, "LOCAL", compressed=len(packed)), packed)
    write("meta/zlib-no-size.mha", meta_header(base, affine, "LOCAL", compressed=0).replace(
        b"CompressedDataSize = 0\n", b""), packed, expect="either", reason="CompressedDataSize",
          note="SimpleITK refuses it")
    write("meta/zlib.mhd", meta_header(base, affine, "zlib.zraw", compressed=len(packed)), files={"zlib.zraw": packed})
    big = base.astype(">i2").tobytes()
    write("meta/msb.mha", meta_header(base, affine, "LOCAL", msb="True"), big)
    write("meta/msb-synonym.mhd", meta_header(base, affine, "msb.raw", msb="True").replace(
        b"BinaryDataByteOrderMSB", b"ElementByteOrderMSB"), files={"msb.raw": big})
    for word in ("Position", "Origin"):
        write(f"meta/{word.lower()}.mha", meta_header(base, affine, "LOCAL", origin=word), raw)
    slices = [base[z].astype("<i2").tobytes() for z in range(DIMS[2])]
    names = [f"list-{z * 7 % 36:02d}.raw" for z in range(DIMS[2])]
    write("meta/list.mhd", meta_header(base, affine, "LIST"), ("\n".join(names) + "\n").encode(),
          files=dict(zip(names, slices)))
    write("meta/list-2d.mhd", meta_header(base, affine, "LIST 2D"), ("\n".join(names) + "\n").encode())
    write("meta/pattern.mhd", meta_header(base, affine, "pattern%03d.raw 1 36 1"),
          files={f"pattern{z + 1:03d}.raw": slices[z] for z in range(DIMS[2])})
    write("meta/header-size.mhd", meta_header(base, affine, "skip.raw", extra=["HeaderSize = 100"]),
          files={"skip.raw": b"h" * 100 + raw})
    write("meta/header-size-auto.mhd", meta_header(base, affine, "auto.raw", extra=["HeaderSize = -1"]),
          files={"auto.raw": b"h" * 77 + raw})
    oblique = s.oblique()
    write("meta/oblique.mha", meta_header(base, oblique, "LOCAL"), raw, at=oblique)
    image = SimpleITK.GetImageFromArray(base)
    spacing = np.linalg.norm(oblique[:, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetOrigin(oblique[:, 3].tolist())
    image.SetDirection((oblique[:, :3] / spacing).ravel().tolist())
    for name, squeeze in (("itk.mha", False), ("itk-zlib.mha", True), ("itk.mhd", False), ("itk-zlib.mhd", True)):
        SimpleITK.WriteImage(image, str(s.path("meta/" + name)), squeeze)
        s.add("meta/" + name, base.astype(float), oblique, same="base", note="written by SimpleITK, oblique")
    SimpleITK.WriteImage(image, str(s.path("nrrd/itk.nrrd")), True)
    s.add("nrrd/itk.nrrd", base.astype(float), oblique, same="base", note="written by SimpleITK, oblique")
    SimpleITK.WriteImage(image, str(s.path("nifti/itk.nii.gz")), True)
    s.add("nifti/itk.nii.gz", base.astype(float), oblique, same=None, note="written by SimpleITK, oblique")
    for kind in ("f4", "i4", "u2"):
        array = (base.astype(int) + (2000 if kind == "u2" else 0)).astype("<" + kind)
        write(f"meta/{kind}.mha", meta_header(array, affine, "LOCAL"), array.tobytes(), values=array.astype(float),
              iso=ISO + 2000 if kind == "u2" else ISO)
    write("meta/channels.mha", meta_header(base, affine, "LOCAL", extra=["ElementNumberOfChannels = 2"]),
          np.stack([base, base], -1).astype("<i2").tobytes(), expect="either", reason="channel|component")
    write("meta/x-short.mha", meta_header(base, affine, "LOCAL"), raw[:-1000], expect="refused",
          reason="short|bytes|ends|needed")
    write("meta/x-zlib-cut.mha", meta_header(base, affine, "LOCAL", compressed=len(packed)), packed[:-800],
          expect="refused", reason="zlib|ends|cut|short|damaged|bytes")


# --- TIFF, PNG, .npy, raw -----------------------------------------------------------------------------------


def plain_studies(s):
    """Formats without geometry: voxels of 1 mm, compared with a raw file of the same numbers."""
    base = s.base
    lifted = (base.astype(int) + 1024).astype(np.uint16)
    small = np.clip(base // 10 + 100, 0, 255).astype(np.uint8)
    forms = {"u1": (small, 120.0, "unit8"), "u2": (lifted, ISO + 1024, "unit"), "i2": (base, ISO, "unit"),
             "f4": (base.astype(np.float32), ISO, "unit"), "i4": (base.astype(np.int32), ISO, "unit"),
             "u4": (lifted.astype(np.uint32), ISO + 1024, "unit"), "f8": (base.astype(np.float64), ISO, "unit"),
             "i1": ((small.astype(int) - 128).astype(np.int8), -8.0, "unit8")}
    words = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "f4": "f32", "f8": "f64"}

    for kind, (array, iso, same) in forms.items():
        for order, letter in (("le", "<"), ("be", ">")):
            name = f"raw/{words[kind]}{order}.raw"
            s.path(name).write_bytes(array.astype(letter + kind).tobytes())
            options = ["--dims", "48x40x36", "--dtype", words[kind] + order]
            s.add(name, array.astype(float), s.unit, same=same, iso=iso, options=options)
    options = ["--dims", "48x40x36", "--dtype", "i16le", "--spacing", "0.75x0.875x1.5"]
    s.path("raw/skip.raw").write_bytes(b"h" * 123 + base.astype("<i2").tobytes())
    at_zero = np.column_stack([np.diag(SPACING), np.zeros(3)])
    s.add("raw/skip.raw", base.astype(float), at_zero, same="base", options=[*options, "--skip", "123"])
    folder = s.folder("raw/slices")
    for z in range(DIMS[2]):
        (folder / f"s{z + 1}.bin").write_bytes(base[z].astype("<i2").tobytes())
    s.add("raw/slices", base.astype(float), at_zero, same="base", options=options)
    s.add("raw/i16le.raw#short", expect="refused", reason="bytes", options=["--dims", "48x40x37", "--dtype", "i16le"])
    for suffix, text in (("json", json.dumps({"dims": DIMS, "dtype": "i16le", "spacing_mm": SPACING})),
                         ("toml", f'dims = {list(DIMS)}\ndtype = "i16le"\nspacing_mm = {list(SPACING)}\n')):
        name = f"raw/sidecar-{suffix}.raw"
        s.path(name).write_bytes(base.astype("<i2").tobytes())
        s.path(name + "." + suffix).write_text(text)
        s.path(f"raw/sidecar-{suffix}.{suffix}").write_text(text)
        s.add(name, base.astype(float), at_zero, same="base", expect="either", reason="--dims",
              note="side-cars are batch's; keys are a guess until they are documented")

    # .npy: axes are [z, y, x] whatever the order in memory.
    for kind, (array, iso, same) in forms.items():
        np.save(s.path(f"npy/{words[kind]}.npy"), array)
        s.add(f"npy/{words[kind]}.npy", array.astype(float), s.unit, same=same, iso=iso)
    for name, array in (("fortran", np.asfortranarray(base)), ("big-endian", base.astype(">i2")),
                        ("fortran-big-endian", np.asfortranarray(base.astype(">f4")))):
        np.save(s.path(f"npy/{name}.npy"), array)
        s.add(f"npy/{name}.npy", base.astype(float), s.unit, same="unit")
    with s.path("npy/version-2.npy").open("wb") as file:
        np.lib.format.write_array(file, base, version=(2, 0))
    s.add("npy/version-2.npy", base.astype(float), s.unit, same="unit")
    for name, array, reason in (("x-4d", np.stack([base, base]), "dim|axes|shape"), ("x-2d", base[len(base) // 2], "dim|axes|shape"),
                                ("x-complex", base.astype(np.complex64), "type|complex"),
                                ("x-record", np.zeros((3, 4, 5), [("a", "<i2")]), "type|record|structured")):
        np.save(s.path(f"npy/{name}.npy"), array)
        truth = (base[len(base) // 2][None].astype(float), None) if name == "x-2d" else (None, None)
        s.add(f"npy/{name}.npy", *truth, expect="either" if name == "x-2d" else "refused", reason=reason)
    data = s.path("npy/i16.npy").read_bytes()
    s.path("npy/x-short.npy").write_bytes(data[:-100])
    s.add("npy/x-short.npy", expect="refused", reason="short|bytes|ends|needed")
    for kind, array in (("int64", base.astype(np.int64)), ("float16", base.astype(np.float16)), ("bool", base > 0)):
        np.save(s.path(f"npy/{kind}.npy"), array)
        s.add(f"npy/{kind}.npy", array.astype(float), s.unit, same="unit" if kind == "int64" else None, expect="either",
              iso=1.0 if kind == "bool" else ISO, reason="type")

    def tiff(name, kind, truth=None, **options):
        array, iso, same = forms[kind]
        tifffile.imwrite(s.path(name), array, metadata=options.pop("metadata", None), photometric=options.pop(
            "photometric", "minisblack"), **options)
        s.add(name, array.astype(float), s.unit, **{"same": same, "iso": iso, **(truth or {})})

    for kind in ("u1", "u2", "i2", "f4", "u4", "i4"):
        tiff(f"tiff/{words[kind]}.tif", kind)
    tiff("tiff/f64.tif", "f8", {"expect": "either", "reason": "type|bits|sample|64"})
    tiff("tiff/strips.tif", "u2", rowsperstrip=7)
    tiff("tiff/tiles.tif", "u2", tile=(16, 16))
    tiff("tiff/tiles-f32.tif", "f4", tile=(32, 16), compression="zlib")
    tiff("tiff/big-endian.tif", "u2", byteorder=">")
    tiff("tiff/big-endian-f32.tif", "f4", byteorder=">", compression="zlib", rowsperstrip=11)
    tiff("tiff/bigtiff.tif", "u2", bigtiff=True)
    tiff("tiff/bigtiff-big-endian.tif", "i2", bigtiff=True, byteorder=">", tile=(16, 32))
    for name, code in (("deflate", "zlib"), ("lzw", "lzw"), ("packbits", "packbits")):
        tiff(f"tiff/{name}-u8.tif", "u1", compression=code, rowsperstrip=13)
        tiff(f"tiff/{name}-u16.tif", "u2", compression=code, rowsperstrip=13)
    tiff("tiff/deflate-predictor.tif", "u2", compression="zlib", predictor=2)
    tiff("tiff/lzw-predictor-tiles.tif", "u2", compression="lzw", predictor=2, tile=(16, 16))
    tiff("tiff/float-predictor.tif", "f4", {"expect": "either", "reason": "predictor"}, compression="zlib", predictor=3)
    tiff("tiff/zstd.tif", "u2", {"expect": "either", "reason": "compress|zstd"}, compression="zstd")
    tiff("tiff/min-is-white.tif", "u1", {"expect": "either", "reason": "white|photometric"}, photometric="miniswhite")
    array = forms["u2"][0]
    tifffile.imwrite(s.path("tiff/imagej.tif"), array, imagej=True, metadata={"axes": "ZYX"})
    s.add("tiff/imagej.tif", array.astype(float), s.unit, same="unit", iso=ISO + 1024)
    tifffile.imwrite(s.path("tiff/imagej-one-ifd.tif"), array, imagej=True, truncate=True, metadata={"axes": "ZYX"})
    s.add("tiff/imagej-one-ifd.tif", array.astype(float), s.unit, same="unit", iso=ISO + 1024,
          note="36 slices in a row behind one directory, as ImageJ writes over 4 GiB")
    tifffile.imwrite(s.path("tiff/imagej-spacing.tif"), array, imagej=True, resolution=(1 / 0.75, 1 / 0.875),
                     metadata={"axes": "ZYX", "spacing": 1.5, "unit": "mm"})
    s.add("tiff/imagej-spacing.tif", array.astype(float), s.unit, iso=ISO + 1024, others=[
        (array.astype(float), at_zero)], note="spacing in ImageJ's words; 1 mm is fair, too")
    tifffile.imwrite(s.path("tiff/imagej-channels.tif"), np.stack([array, array[::-1]], 1), imagej=True,
                     metadata={"axes": "ZCYX"})
    s.add("tiff/imagej-channels.tif", expect="refused", reason="channel|hyperstack|several",
          note="two channels interleaved are no volume")
    tifffile.imwrite(s.path("tiff/x-rgb.tif"), np.stack([small] * 3, -1), photometric="rgb", metadata=None)
    s.add("tiff/x-rgb.tif", small.astype(float), s.unit, expect="either", reason="colou?r|RGB|samples", iso=120.0)
    data = s.path("tiff/u16.tif").read_bytes()
    s.path("tiff/x-cut.tif").write_bytes(data[:len(data) // 2])
    s.add("tiff/x-cut.tif", expect="refused", reason="short|ends|cut|damaged|bytes|page")
    with tifffile.TiffWriter(s.path("tiff/x-mixed-sizes.tif")) as writer:
        writer.write(array[0], metadata=None)
        writer.write(array[1, :30], metadata=None)
    s.add("tiff/x-mixed-sizes.tif", expect="refused", reason="size|differ|page")
    for kind in ("u1", "u2", "f4"):
        array, iso, same = forms[kind]
        folder = s.folder(f"tiff/folder-{words[kind]}")
        for z in range(DIMS[2]):
            tifffile.imwrite(folder / f"slice_{z + 1}.tif", array[z], metadata=None, photometric="minisblack")
        s.add(f"tiff/folder-{words[kind]}", array.astype(float), s.unit, same=same, iso=iso,
              note="names sort wrongly as text")
    for kind in ("u1", "u2"):
        array, iso, same = forms[kind]
        folder = s.folder(f"png/folder-{words[kind]}")
        for z in range(DIMS[2]):
            (folder / f"img{z + 1}.png").write_bytes(imagecodecs.png_encode(np.ascontiguousarray(array[z])))
        s.add(f"png/folder-{words[kind]}", array.astype(float), s.unit, same=same, iso=iso,
              note="names sort wrongly as text")
    folder = s.folder("png/with-notes")
    for z in range(DIMS[2]):
        (folder / f"img{z + 1}.png").write_bytes(imagecodecs.png_encode(np.ascontiguousarray(small[z])))
    (folder / "notes.txt").write_text("scanned on Monday\n")
    s.add("png/with-notes", small.astype(float), s.unit, same="unit8", iso=120.0, note="a text file beside the slices")
    folder = s.folder("png/x-mixed-sizes")
    for z, part in enumerate((small[0], small[1, :20], small[2])):
        (folder / f"img{z}.png").write_bytes(imagecodecs.png_encode(np.ascontiguousarray(part)))
    s.add("png/x-mixed-sizes", expect="refused", reason="size|differ")
    folder = s.folder("png/x-damaged")
    for z in range(3):
        body = imagecodecs.png_encode(np.ascontiguousarray(small[z]))
        (folder / f"img{z}.png").write_bytes(body[:len(body) // 2] if z == 1 else body)
    s.add("png/x-damaged", expect="refused", reason="damaged|ends|cut|short|PNG|png")
    folder = s.folder("png/x-rgb")
    for z in range(3):
        (folder / f"img{z}.png").write_bytes(imagecodecs.png_encode(np.stack([small[z]] * 3, -1)))
    s.add("png/x-rgb", small[:3].astype(float), s.unit, expect="either", reason="colou?r|RGB|samples", iso=120.0)


def oblique(self):
    """Axes turned by angles that no flip undoes; spacing and origin as the base's."""
    a, b, c = 0.3, -0.2, 0.5
    turn = lambda i, j, t: np.array([[np.cos(t) if p == q and p in (i, j) else 1.0 if p == q else
                                      -np.sin(t) if (p, q) == (i, j) else np.sin(t) if (p, q) == (j, i) else 0.0
                                      for q in range(3)] for p in range(3)])
    axes = turn(0, 1, a) @ turn(0, 2, b) @ turn(1, 2, c)
    return np.column_stack([axes * np.array(SPACING), ORIGIN])


def sheared(self):
    """A tilted gantry: every slice 0.375 mm further along y."""
    affine = self.affine.copy()
    affine[1, 2] = 0.375
    return affine


Studies.oblique, Studies.sheared = oblique, sheared


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.out.exists() and any(args.out.iterdir()):
        if not (args.out / "truth.json").exists():
            parser.error(f"{args.out} holds other files; name an empty or new folder")
        shutil.rmtree(args.out)
    args.out.mkdir(parents=True, exist_ok=True)
    studies = Studies(args.out, args.seed)
    plain_studies(studies)
    dicom = DicomStudies(studies, ISO)
    dicom.write()
    study_mosaic.write(dicom)
    nrrd_studies(studies)
    nifti_studies(studies)
    meta_studies(studies)
    (args.out / "truth.json").write_text(json.dumps({"seed": args.seed, "studies": studies.entries}, indent=1))
    print(f"{len(studies.entries)} studies in {args.out}")


if __name__ == "__main__":
    sys.exit(main())
