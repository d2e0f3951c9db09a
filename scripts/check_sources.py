#!/usr/bin/env python3
"""Compares what `oct` reads from real data with an independent reading by public libraries.

For every item of the data folder (the table of its README.md): dims, spacing, the eight corners in LPS mm
(within 0.001 mm, by voxel index), the range of values, and the skin voxel by voxel at the program's own
threshold. The readings use pydicom with its decoders, nibabel, pynrrd and numpy, and nothing of the program.
Items that should be refused are listed with the sentence and exit code. Prints a Markdown table.

Exit codes: 0 all as expected; 1 something differs; 2 the script could not run.
Needs Python 3.10 and scripts/requirements-check.txt.

usage: check_sources.py OCT DATA [--work DIR] [--only TEXT] [--refused-ok] [--memory 64MiB]
"""
import argparse
import re
import sys
import tempfile
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pydicom
from pydicom.pixels import apply_modality_lut

import check_lib as lib

warnings.filterwarnings("ignore")
CORNER_MM = 1e-3


@dataclass
class Volume:
    """An independent reading: physical values [z, y, x], and voxel index to LPS mm (3 x 4)."""

    values: np.ndarray
    affine: np.ndarray
    unpadded: tuple = None  # (min, max) before padding was replaced, if there was any
    notes: list = field(default_factory=list)

    @property
    def dims(self):
        return list(self.values.shape[::-1])

    @property
    def spacing(self):
        return np.linalg.norm(self.affine[:, :3], axis=0)


# --- DICOM ------------------------------------------------------------------------------------------------

NATIVE = {"1.2.840.10008.1.2", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2", "1.2.840.10008.1.2.1.99"}


def stored_frames(ds):
    """Stored values as frames x rows x columns; high bits that are no part of the value removed."""
    if "FloatPixelData" in ds or "DoubleFloatPixelData" in ds:
        array = ds.pixel_array
        return array.reshape(-1, ds.Rows, ds.Columns)
    palette = ds.get("PhotometricInterpretation") == "PALETTE COLOR" and ds.get("Modality") != "SEG"
    if palette or ds.get("SamplesPerPixel", 1) != 1:
        colours = pydicom.pixels.apply_color_lut(ds.pixel_array, ds) if palette else ds.pixel_array
        if ds.get("PhotometricInterpretation") not in ("PALETTE COLOR", "RGB"):
            raise ValueError("colour")
        # Luminance of ITU-R BT.601, rounded half up.
        weighted = (colours[..., :3].astype(np.int64) * [299, 587, 114]).sum(axis=-1)
        return ((weighted + 500) // 1000).reshape(-1, ds.Rows, ds.Columns)
    bits, used = ds.BitsAllocated, ds.BitsStored
    native = ds.file_meta.TransferSyntaxUID in NATIVE and bits in (16, 32)
    if native:  # as they lie in the file: pydicom has views of its own on unused bits
        order = "<" if ds.original_encoding[1] else ">"
        pixels = ds.Rows * ds.Columns * int(ds.get("NumberOfFrames") or 1)
        array = np.frombuffer(ds.PixelData, f"{order}{'iu'[1 - ds.PixelRepresentation]}{bits // 8}", pixels)
    else:
        array = ds.pixel_array
    array = array.reshape(-1, ds.Rows, ds.Columns)
    if native and used < bits:
        shift = ds.HighBit + 1 - used
        wide = (array.astype(np.int64) >> shift) & ((1 << used) - 1)
        if ds.PixelRepresentation:
            wide -= (wide >> (used - 1)) << used
        array = wide
    return array


def group(ds, frame, name, attribute):
    """An attribute of a frame: per-frame groups, else shared ones, else the dataset itself."""
    for outer, at in (("PerFrameFunctionalGroupsSequence", frame), ("SharedFunctionalGroupsSequence", 0)):
        items = ds.get(outer) or []
        if at < len(items):
            inner = items[at].get(name) or []
            if inner and inner[0].get(attribute) is not None:
                return inner[0].get(attribute)
    value = ds.get(attribute)
    return value if value not in ("", None) else None


def replace_padding(ds, stored, slope, intercept):
    """Pixel Padding becomes the stored value nearest to -1000 HU in CT and to 0 elsewhere."""
    value = ds.get("PixelPaddingValue")
    if value is None or "FloatPixelData" in ds:
        return stored, False
    limit = ds.get("PixelPaddingRangeLimit")
    limit = value if limit is None else limit
    # Explicit signedness may contradict the pixels' own; take the bit pattern, as the pixels do.
    wrap = (lambda v: (v + 2**15) % 2**16 - 2**15) if ds.PixelRepresentation else (lambda v: v % 2**16)
    lo, hi = sorted((wrap(value), wrap(limit)))
    mask = (stored >= lo) & (stored <= hi)
    if not mask.any():
        return stored, False
    used = ds.BitsStored
    ends = (-(2 ** (used - 1)), 2 ** (used - 1) - 1) if ds.PixelRepresentation else (0, 2**used - 1)
    background = -1000.0 if ds.get("Modality") == "CT" else 0.0
    nearest = int(np.clip(np.round((background - intercept) / slope), *ends))
    return np.where(mask, nearest, stored), True


#: What numbers the frames of nuclear medicine, apart from the slice.
VECTORS = ("EnergyWindowVector", "DetectorVector", "PhaseVector", "RotationVector", "RRIntervalVector",
           "TimeSlotVector", "AngularViewVector", "TimeSliceVector")


@dataclass
class Frame:
    """One image with its place."""

    values: np.ndarray
    raw_range: tuple
    padded: bool
    position: object
    axes: object
    spacing: object
    thickness: object
    kind: tuple
    order: float
    instance: str
    split: tuple
    dimensions: tuple
    sparse: bool


def frames_of(path):
    """All images of a file; empty if it has none."""
    ds = pydicom.dcmread(path, force=True)
    if not any(k in ds for k in ("PixelData", "FloatPixelData", "DoubleFloatPixelData")):
        return []
    if "TransferSyntaxUID" not in ds.file_meta:
        ds.file_meta.TransferSyntaxUID = (pydicom.uid.ImplicitVRLittleEndian if ds.original_encoding[0]
                                          else pydicom.uid.ExplicitVRLittleEndian)
    stored = stored_frames(ds)
    result = []
    offsets = ds.get("GridFrameOffsetVector")
    for i, image in enumerate(stored):
        slope = group(ds, i, "PixelValueTransformationSequence", "RescaleSlope")
        intercept = group(ds, i, "PixelValueTransformationSequence", "RescaleIntercept")
        slope, intercept = float(1 if slope is None else slope), float(0 if intercept is None else intercept)
        if ds.get("DoseGridScaling") is not None:
            slope, intercept = float(ds.DoseGridScaling), 0.0
        mended, padded = replace_padding(ds, image, slope, intercept)
        if "ModalityLUTSequence" in ds:
            values = np.asarray(apply_modality_lut(mended, ds), float)
        else:
            values = mended.astype(float) * slope + intercept
        ends = sorted((slope * float(image.min()) + intercept, slope * float(image.max()) + intercept))
        position = group(ds, i, "PlanePositionSequence", "ImagePositionPatient")
        axes = group(ds, i, "PlaneOrientationSequence", "ImageOrientationPatient")
        spacing = group(ds, i, "PixelMeasuresSequence", "PixelSpacing")
        if offsets is not None and position is not None and axes is not None:
            n = np.cross(np.array(axes[:3], float), np.array(axes[3:], float))
            position = np.array(position, float) + n * (float(offsets[i]) - float(offsets[0]))
        vectors = tuple(int(np.atleast_1d(ds[name].value)[i]) for name in VECTORS if name in ds)
        if "SliceVector" in ds and "DetectorInformationSequence" in ds:
            place = ds.DetectorInformationSequence[0]
            axes = place.ImageOrientationPatient
            away = (int(ds.SliceVector[i]) - int(ds.SliceVector[0])) * float(ds.SpacingBetweenSlices)
            position = np.array(place.ImagePositionPatient, float) + away * np.cross(axes[:3], axes[3:])
        segment = group(ds, i, "SegmentIdentificationSequence", "ReferencedSegmentNumber")
        dimensions = group(ds, i, "FrameContentSequence", "DimensionIndexValues")
        thickness = (group(ds, i, "PixelMeasuresSequence", "SpacingBetweenSlices")
                     or group(ds, i, "PixelMeasuresSequence", "SliceThickness"))
        kind = (str(ds.get("SeriesInstanceUID")), image.shape,
                tuple(np.round(np.array(axes, float), 4)) if axes is not None else None,
                str(ds.get("ImageType")), str(ds.get("EchoTime")), segment, vectors)
        result.append(Frame(values, tuple(ends), padded,
                            None if position is None else np.array(position, float),
                            None if axes is None else np.array(axes, float),
                            [1.0, 1.0] if spacing is None else [float(v) for v in spacing],
                            float(thickness) if thickness else 1.0, kind, float(ds.get("InstanceNumber") or 0) + i,
                            f"{ds.get('SOPInstanceUID', path)}/{i}",
                            (str(ds.get("AcquisitionNumber")), str(ds.get("TemporalPositionIdentifier"))),
                            tuple(np.atleast_1d([] if dimensions is None else dimensions)),
                            ds.get("Modality") == "SEG"))
    return result


def read_mosaic(path):
    """A Siemens mosaic as nibabel reads it, its axes right-handed."""
    from nibabel.nicom.dicomwrappers import wrapper_from_file  # says that it is experimental

    picture = wrapper_from_file(path)
    if not picture.is_mosaic:
        raise ValueError("no private header of a mosaic")
    values = np.moveaxis(picture.get_data(), 2, 0)
    affine = np.asarray(picture.affine, float)[:3, [1, 0, 2, 3]]
    if np.linalg.det(affine[:, :3]) < 0:
        affine[:, 3] += (len(values) - 1) * affine[:, 2]
        affine[:, 2] *= -1
        values = values[::-1]
    return Volume(np.ascontiguousarray(values), affine)


def repeats(frames):
    """Does a position occur more than once?"""
    places = {None if f.position is None else tuple(f.position) for f in frames}
    return None not in places and len(places) < len(frames)


def by_dimension(frames):
    """Frames by the first dimension index that leaves no position twice; as they are if there is none."""
    for k in range(min(len(f.dimensions) for f in frames)):
        parts = {}
        for frame in frames:
            parts.setdefault(frame.dimensions[k], []).append(frame)
        if not any(map(repeats, parts.values())):
            return [parts[value] for value in sorted(parts)]
    return [frames]


def with_empty_slices(frames, normal):
    """Values of a segmentation in order of position, slices without a frame empty."""
    along = np.array([f.position @ normal for f in frames])
    places = np.rint((along - along[0]) / np.diff(along).min()).astype(int)
    values = np.zeros((places[-1] + 1, *frames[0].values.shape))
    values[places] = [f.values for f in frames]
    return values


def read_dicom(paths):
    """Every volume in the files, the largest first."""
    parts, seen, volumes = {}, set(), []
    for path in paths:
        if "MOSAIC" in (pydicom.dcmread(path, force=True, stop_before_pixels=True).get("ImageType") or []):
            volumes.append(read_mosaic(path))
            continue
        for frame in frames_of(path):
            if frame.instance not in seen:
                parts.setdefault(frame.kind, []).append(frame)
            seen.add(frame.instance)
    for kind, frames in list(parts.items()):
        if repeats(frames):  # several volumes: by acquisition and phase
            del parts[kind]
            for frame in frames:
                parts.setdefault((*kind, frame.split), []).append(frame)
    volumes = []
    parts = [part for frames in parts.values() for part in (by_dimension(frames) if repeats(frames) else [frames])]
    for frames in parts:
        dy, dx = frames[0].spacing
        placed = all(f.position is not None for f in frames) and frames[0].axes is not None
        notes = []
        if placed:
            row, column = frames[0].axes[:3], frames[0].axes[3:]
            normal = np.cross(row, column)
            frames.sort(key=lambda f: f.position @ normal)
            first, last = frames[0].position, frames[-1].position
            values = np.stack([f.values for f in frames])
            if frames[0].sparse and len(frames) > 2:
                values = with_empty_slices(frames, normal)
            step = (last - first) / (len(values) - 1) if len(frames) > 1 else normal * frames[0].thickness
            affine = np.column_stack([row * dx, column * dy, step, first])
        else:
            frames.sort(key=lambda f: f.order)
            values = np.stack([f.values for f in frames])
            affine = np.column_stack([np.diag([dx, dy, frames[0].thickness]), np.zeros(3)])
            notes.append("no positions")
        raw = None
        if any(f.padded for f in frames):
            raw = (min(f.raw_range[0] for f in frames), max(f.raw_range[1] for f in frames))
        volumes.append(Volume(values, affine, raw, notes))
    return sorted(volumes, key=lambda v: -v.values.size)


# --- other formats ----------------------------------------------------------------------------------------


def read_nifti(path):
    image = nibabel.load(path)
    data = np.asanyarray(image.dataobj)
    unit = {"meter": 1000.0, "micron": 0.001}.get(image.header.get_xyzt_units()[0], 1.0)
    affine = lib.FLIP_XY @ (np.asarray(image.affine, float)[:3] * unit)
    volumes = data.T if data.ndim == 4 else data.T[None]
    return [Volume(np.ascontiguousarray(v), affine) for v in volumes]


def read_nrrd(path):
    data, header = nrrd.read(str(path), index_order="C")
    if "space directions" not in header:
        return [Volume(data, np.column_stack([np.diag(header["spacings"]), np.zeros(3)]))]
    affine = np.column_stack([np.array(header["space directions"]).T, header["space origin"]]).astype(float)
    # Signs of the space's axes against left, posterior, superior; a space without a name is taken as LPS.
    name = header.get("space", "left-posterior-superior").lower()
    letters = "".join(w[0] for w in name.split("-")) if "-" in name else name
    signs = [1.0 if a == b else -1.0 for a, b in zip(letters, "lps")]
    return [Volume(data, np.diag(signs) @ affine)]


def read_raw(paths, dims, dtype, spacing):
    data = np.concatenate([np.fromfile(p, dtype) for p in paths]).reshape(dims[::-1])
    return [Volume(data.astype(dtype.lstrip("<>")), np.column_stack([np.diag(spacing), np.zeros(3)]))]


# --- what is expected -------------------------------------------------------------------------------------


@dataclass
class Item:
    """One row of the table: how to read it, and what `oct` should do with it."""

    path: str
    expect: str  # converts | refused | either (converted rightly, or refused with the reason)
    reason: str = ""  # words of which the refusal should hold one, as a regular expression
    lossy: bool = False
    raw: tuple = None  # dims, numpy dtype, spacing, options
    why: str = ""
    like: str = ""  # the item that holds the same volume, where the reference cannot read this one


RAW_HEAD = ((256, 256, 113), ">i2", (1.0, 1.0, 2.0), "256x256x113 i16be 1x1x2")
RAW_LIDC = ((256, 256, 133), "u1", (1.40625, 1.40625, 2.5), "256x256x133 u8 1.40625x1.40625x2.5")
NOT_A_VOLUME = r"mesh|not DICOM|not a volume|no volume|nothing .* volume"
NO_IMAGE = r"no (usable )?image|no pixel|without pixels|not DICOM|transfer syntax|cut short|truncated|ends early|are left"
COLOUR = r"colou?r|palette|RGB|PALETTE|samples"
UNEVEN = r"uneven|gap|missing"

ITEMS = [
    Item("ct-ge-tilt-irregular", "refused", UNEVEN, why="gaps of 1, 4 and 7 mm"),
    Item("ct-philips-28", "converts"),
    Item("ct-short/tilt-4", "converts"),
    Item("ct-short/same-position-4", "refused", r"one position|same position", why="all slices at one position"),
    Item("ct-short/uneven-5-5-10mm", "refused", UNEVEN, why="gaps of 5, 5 and 10 mm"),
    Item("ct-short/tilt-missing-slice", "refused", UNEVEN, why="a slice is missing"),
    Item("mr-sag-35", "converts"),
    Item("mr-mixed-folder", "converts", why="four series: the largest"),
    Item("mr-mag-phase-4", "converts", r"repeat|several|two|magnitude|phase", why="two volumes: one of them"),
    Item("mr-encodings/explicit-le", "converts"),
    Item("mr-encodings/j2k-lossless", "converts"),
    Item("mr-encodings/jpeg-lossless", "converts"),
    Item("mr-encodings/jpeg-ls", "converts"),
    Item("mr-encodings/rle", "converts"),
    Item("mr-encodings/implicit-le", "converts"),
    Item("multiframe/ct-enhanced-2f.dcm", "converts"),
    Item("multiframe/mr-xa30-t1-96f.dcm", "converts"),
    Item("multiframe/emri-10f.dcm", "converts"),
    Item("multiframe/emri-10f-rle.dcm", "converts"),
    Item("multiframe/emri-10f-bigendian.dcm", "converts"),
    Item("multiframe/emri-10f-jpegls.dcm", "converts"),
    Item("multiframe/ct-2f-fragmented-no-bot-jpeg12.dcm", "converts", lossy=True),
    Item("raw-cthead", "converts", raw=RAW_HEAD),
    Item("raw-lidc-u8/lidc2_256x256x133_u8.raw", "converts", raw=RAW_LIDC),
    Item("nrrd-brain/brain1_image.nrrd", "converts"),
    Item("nrrd-bad-gzip/I.nrrd", "refused", r"gzip|ends|cut|trunc|damaged|short", why="the gzip stream stops early"),
    Item("nifti-ct-i32/example_ct.nii.gz", "converts"),
    Item("nifti-ct-oblique/CT_pitch.nii.gz", "converts"),
    Item("nifti-iguana/Iguana.nii.gz", "converts"),
    *[Item(f"mesh/{n}", "refused", NOT_A_VOLUME, why="a mesh") for n in
      ("bunny-open.ply", "bunny-closed.off", "teapot-open.obj", "nefertiti-closed.obj", "featuretype-closed.stl")],
    *[Item(f"dicom-ct-15-syntaxes/{n}.dcm", "converts") for n in
      ("implicit-le", "explicit-le", "explicit-be", "deflated", "rle", "jpeg-lossless-57", "jpeg-lossless-70",
       "jpegls-80", "jpegls-lossy-81", "j2k-90")],
    Item("dicom-ct-15-syntaxes/j2k-lossy-91.dcm", "converts", lossy=True),
    Item("dicom-ct-15-syntaxes/jpeg-baseline-50.dcm", "converts", lossy=True),
    Item("dicom-ct-15-syntaxes/jpeg-extended-51.dcm", "converts", lossy=True),
    *[Item(f"dicom-ct-15-syntaxes/jpeg-{n}.dcm", "either", r"JPEG|compress|syntax|progressive|spectral", lossy=True,
           why="a retired syntax") for n in ("spectral-53", "progressive-55")],
    Item("dicom-odd/cr-mono1-no-preamble.dcm", "converts"),
    Item("dicom-odd/signed16-full-range.dcm", "converts"),
    Item("dicom-odd/truncated-pixels.dcm", "refused", r"short|trunc|ends|bytes|cut", why="62 bytes short"),
    Item("dicom-odd/padded-pixels.dcm", "converts"),
    Item("dicom-odd/no-meta-header.dcm", "either", NO_IMAGE, why="a stray byte before the first element"),
    Item("dicom-odd/meta-missing-syntax.dcm", "refused", NO_IMAGE, why="no image, no syntax"),
    Item("dicom-odd/bad-frame-count.dcm", "either", r"frame", why="NumberOfFrames is 1A"),
    Item("dicom-odd/rgb-odd-length.dcm", "either", COLOUR, why="colour"),
    Item("dicom-odd/seg-1bit.dcm", "either", r"\bbits?\b", why="1 bit a pixel"),
    Item("dicom-odd/j2k-sign-mismatch.dcm", "converts"),
    Item("dicom-odd/jpegls-near-16.dcm", "converts"),
    Item("dicom-odd/palette-colour.dcm", "either", COLOUR, why="colour"),
    Item("dicom-odd/rtplan-truncated-no-image.dcm", "refused", NO_IMAGE, why="not an image"),
    Item("dicom-odd/dicomdir", "refused", NO_IMAGE, why="a DICOMDIR"),
    Item("dicom-odd/deflated-8bit.dcm", "converts"),
    Item("dicom-odd/j2k-cut-short-no-pixels.dcm", "either", NO_IMAGE + r"|end of the pixel data",
         why="cut short behind its last frame", like="multiframe/emri-10f.dcm"),
    Item("dicom-odd/modality-lut.dcm", "either", r"LUT|look-?up", why="a modality LUT"),
    Item("dicom-odd/float-pixels.dcm", "either", r"[Ff]loat", why="Float Pixel Data"),
    Item("dicom-odd/explicit-un-j2k.dcm", "converts"),
    Item("dicom-odd/bad-sequence-jpeg-lossless.dcm", "converts"),
    Item("dicom-odd/htj2k-rgb.dcm", "either", COLOUR + r"|HTJ2K|High-Throughput|syntax", why="colour, HTJ2K"),
    Item("dicom-odd/no-pixel-spacing.dcm", "either", COLOUR, why="colour palette, no spacing"),
    Item("ct-j2k-2", "converts", lossy=True),
]


def natural(path):
    return [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", path.name)]


def read_item(item, path):
    """Volumes of an item, or an exception: what the reference reader says."""
    files = sorted((p for p in path.iterdir() if p.is_file()), key=natural) if path.is_dir() else [path]
    if item.raw:
        return read_raw(files, *item.raw[:3])
    name = path.name
    if name.endswith((".nii", ".nii.gz")):
        return read_nifti(path)
    if name.endswith((".nrrd", ".nhdr")):
        return read_nrrd(path)
    volumes = read_dicom(files)
    if not volumes:
        raise ValueError("no image")
    return volumes


# --- comparing --------------------------------------------------------------------------------------------


@dataclass
class Row:
    """What the table says of an item."""

    item: str
    dims: str = ""
    spacing: str = ""
    values: str = ""
    corner: str = ""
    skins: str = ""
    verdict: str = ""
    state: str = "ok"  # ok | refused (due to convert) | wrong


def show(number):
    return f"{number:.6g}"


def judge(item, volume, facts, run, args, path, model_path, options):
    """Compares a converted item with one reading; returns a Row."""
    row, bad, notes = Row(item.path), [], list(volume.notes)
    row.dims = "x".join(map(str, facts["dims"]))
    row.spacing = "x".join(show(v) for v in facts["spacing_mm"])
    low, high = float(np.nanmin(volume.values)), float(np.nanmax(volume.values))
    row.values = f"{show(low)}..{show(high)}"
    if volume.unpadded and volume.unpadded != (low, high):
        row.values += f" ({show(volume.unpadded[0])}..{show(volume.unpadded[1])} with padding)"
    if facts["dims"] != volume.dims:
        row.verdict, row.state = f"WRONG: dims, reference {volume.dims}", "wrong"
        return row
    # A lone slice has no neighbour: its thickness is a convention, and no corner depends on it.
    axes = 3 if volume.dims[2] > 1 else 2
    if not np.allclose(facts["spacing_mm"][:axes], volume.spacing[:axes], rtol=1e-6, atol=1e-6):
        bad.append(f"spacing, reference {'x'.join(show(v) for v in volume.spacing)}")
    due, got = lib.corners(volume.affine, volume.dims), lib.corners(facts["affine"], volume.dims)
    error = float(np.linalg.norm(due - got, axis=1).max())
    row.corner = f"{error:.1e}"
    values = volume.values
    if error > CORNER_MM:
        for reverse, turned in lib.flips(volume.affine, volume.dims):
            if np.abs(lib.corners(turned, volume.dims) - got).max() <= CORNER_MM:
                values = values[tuple(slice(None, None, -1 if r else 1) for r in reverse[::-1])]
                named = "".join(a for a, r in zip("xyz", reverse) if r)
                said = re.search(r"flip|revers|opposite", " ".join(run.json.get("warnings", [])))
                (notes if said else bad).append(f"corners agree as a set only: {named} reversed")
                break
        else:
            bad.append("corners")
    lo, hi = facts["range"]["lo"], facts["range"]["hi"]
    model = lib.Model(model_path)
    count, differ, worst, step = lib.compare_skin(model, values, -np.inf if lo is None else lo, hi)
    row.skins = f"{facts['skin_voxels']} / {count}"
    if item.lossy:
        share = differ / max(count, 1)
        notes.append(f"lossy: {100 * share:.2f} % of the skin differs")
        if share > 0.05:
            bad.append("skin, even for a lossy syntax")
        if worst is not None and worst > 2 * abs(facts["rescale"][0]):
            bad.append(f"values off by {worst:g}, more than 2 steps of the reference decoder's")
    else:
        if facts["skin_voxels"] != count or differ:
            bad.append(f"skin: {differ} voxels differ")
        elif worst is not None:
            bad += lib.judge_values(worst, step, facts["dtype"], values)
        bad += lib.probe_range(args.oct, path, model_path, values, options, args.memory)
    row.state = "wrong" if bad else "ok"
    row.verdict = "; ".join((["WRONG: " + ", ".join(bad)] if bad else ["ok"]) + notes)
    return row


def check(item, args, work):
    """One row for one item."""
    path = args.data / item.path
    if not path.exists():
        return Row(item.path, verdict="missing from the data folder", state="wrong")
    options = []
    if item.raw:
        dims, dtype, spacing = item.raw[3].split()
        options = ["--dims", dims, "--dtype", dtype, "--spacing", spacing]
    model = work / "item.oct"
    run = lib.build(args.oct, path, model, "--channels", "normal,value", *options, memory=args.memory)
    if run.crashed:
        return Row(item.path, verdict=f"CRASH, exit {run.code}: {run.sentence[:200]}", state="wrong")
    if not run.ok:
        sentence = run.sentence.replace(str(args.data), "DATA").replace("|", "\\|")
        text = f"exit {run.code}: {sentence}"
        if item.expect == "converts":
            return Row(item.path, verdict=f"REFUSED, should convert; {text}", state="refused")
        # The path may hold such words, too.
        words = run.sentence.replace(str(path), "")
        codes = (2, 3) if item.path.startswith("mesh/") else (3,)
        if run.code not in codes or not re.search(item.reason, words):
            return Row(item.path, verdict=f"refused, but not because: {item.why}; {text}", state="refused")
        return Row(item.path, verdict=f"ok, refused ({item.why}); {text}")
    if item.expect == "refused":
        return Row(item.path, verdict=f"WRONG: converted, should be refused ({item.why})", state="wrong")
    shown = lib.info(args.oct, model)
    if not shown.ok:
        return Row(item.path, verdict=f"WRONG: info fails: {shown.sentence[:200]}", state="wrong")
    if shown.json["dims"] != run.json["dims"] or shown.json["skin_voxels"] != run.json["skin_voxels"]:
        return Row(item.path, verdict="WRONG: build and info disagree", state="wrong")
    try:
        volumes = read_item(item, args.data / item.like if item.like else path)
    except Exception as error:  # the reference cannot judge: say so instead of passing it
        return Row(item.path, "x".join(map(str, shown.json["dims"])),
                   verdict=f"converted; unjudged, the reference says: {str(error)[:120]}")
    keep = model.with_name("keep.oct")
    model.replace(keep)
    fitting = [v for v in volumes if v.dims == shown.json["dims"]] or volumes[:1]
    rows = [judge(item, v, shown.json, run, args, path, keep_copy(keep, model), options) for v in fitting]
    best = next((r for r in rows if r.state == "ok"), rows[0])
    if len(volumes) > 1:
        best.verdict += f"; {len(volumes)} volumes in the input"
        if shown.json["dims"] != volumes[0].dims:
            best.verdict, best.state = "WRONG: not the largest volume; " + best.verdict, "wrong"
    return best


def keep_copy(source, target):
    target.write_bytes(source.read_bytes())
    return target


def uncovered(data):
    """Rows of the data folder's README that no item covers."""
    readme = data / "README.md"
    named = re.findall(r"^\| `([^`]+)`", readme.read_text(), re.M) if readme.exists() else []
    paths = [i.path for i in ITEMS]
    tidy = [n.split(" ")[0].rstrip("/") for n in named]
    return [n for n in tidy if not any(p == n or n.startswith(p + "/") or p.startswith(n + "/") for p in paths)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("oct", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("--work", type=Path, help="folder for models; a temporary one by default")
    parser.add_argument("--only", default="", help="only items whose path holds this text")
    parser.add_argument("--refused-ok", action="store_true", help="exit 0 when items are refused that should convert")
    parser.add_argument("--memory", default="64MiB")
    args = parser.parse_args()
    if not args.oct.is_file() or not args.data.is_dir():
        parser.error("OCT must be the program and DATA a folder")
    with tempfile.TemporaryDirectory() as temporary:
        work = args.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        print("| item | dims | spacing mm | values | corners off by mm | skin: program / numpy | verdict |")
        print("|---|---|---|---|---|---|---|")
        rows = []
        for item in ITEMS:
            if args.only in item.path:
                rows.append(check(item, args, work))
                r = rows[-1]
                print(f"| {r.item} | {r.dims} | {r.spacing} | {r.values} | {r.corner} | {r.skins} | {r.verdict} |",
                      flush=True)
    count = {s: sum(r.state == s for r in rows) for s in ("ok", "refused", "wrong")}
    left = uncovered(args.data)
    print(f"\n{count['ok']} as expected, {count['refused']} refused that should convert (or for another reason), "
          f"{count['wrong']} wrong.")
    if left:
        print("In the data folder's README but not checked: " + ", ".join(left))
    return int(bool(count["wrong"] or left or (count["refused"] and not args.refused_ok)))


if __name__ == "__main__":
    sys.exit(main())
