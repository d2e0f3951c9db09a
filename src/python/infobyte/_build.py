"""Building models."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _infobyte, _sources
from ._check import checked, dumps
from ._errors import UsageError
from ._model import Model, bytes_of
from ._progress import bar

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ._types import (
        Axes, Channel, Close, Connectivity, Downsample, Fill, Gaps, Gradient, Path, Preset, Progress, Surface, Unit, Up
    )  # fmt: skip

#: Millimetres of a unit.
UNITS = {"um": 0.001, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}


@checked
def build(
    source: Any,
    output: Path,
    *,
    iso: float | None = None,
    range: tuple[float, float] | None = None,
    preset: Preset | None = None,
    labels: str | int | Sequence[int | str] | None = None,
    names: Path | Mapping[int, str] | None = None,
    keep_names: bool = False,
    smooth: float | None = None,
    each: Path | None = None,
    surface: Surface | None = None,
    error: float | str | None = None,
    uncertainty: bool = False,
    spacing: float | Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    affine: ArrayLike | None = None,
    axes: Axes = "zyx",
    memory: int | str = "64MiB",
    threads: int | None = None,
    channels: Sequence[Channel] | None = None,
    gradient: Gradient | None = None,
    connectivity: Connectivity | None = None,
    visible_from: Sequence[str | Sequence[float]] = (),
    lod: bool = True,
    roi: Sequence[tuple[int, int]] | None = None,
    downsample: Downsample | None = None,
    close: Close = 0,
    fill_cavities: bool = False,
    keep_largest: int | None = None,
    drop_below: int | str | None = None,
    component_connectivity: Connectivity | None = None,
    grid: int | None = None,
    voxel: float | None = None,
    margin: int = 1,
    unit: Unit = "mm",
    up: Up = "z",
    fill: Fill | None = None,
    keep_thin: bool = False,
    volume: int | None = None,
    index: Mapping[str, int] | None = None,
    gaps: Gaps = "error",
    follow_links: bool = False,
    orientation: str | None = None,
    dims: Sequence[int] | None = None,
    dtype: str | None = None,
    skip: int | None = None,
    scratch: Path | None = None,
    force: bool = False,
    progress: Progress = None,
) -> Model:
    """Builds the surface octree of a volume, a mesh or a tree of solids into the file `output`, which is replaced.

    A name of another kind of file, such as `scan.nii.gz`, is refused without `force`.

    `source` is one of
    - a path or a list of paths, of any format of `oct build`: DICOM, NIfTI, NRRD, MetaImage, TIFF, raw, STL, PLY, OBJ,
      OFF, glTF, 3MF, `.csg`, ...;
    - a numpy array of three dimensions, read in place whatever its strides. A contiguous memory map is read from its
      file. Types besides 8 to 32 bit integers and 32 and 64 bit floats are converted through a scratch file;
    - what has `shape`, `dtype` and slices, such as arrays of dask, zarr and h5py, or an iterator of slices or slabs:
      written to a scratch file first, slab by slab, or held in memory where half of `memory` suffices;
    - an image of SimpleITK, ITK or nibabel, an array of xarray, a grid of pyvista, with its place;
    - a mesh of trimesh, pyvista or Open3D, in mm; `grid` or `voxel` says how fine.

    What is inside
    - `iso`: values of it and more, in physical units; `range`: values from the first to the second, both included;
      `preset`: a tissue by its range in HU (`bone`, `skin`, ...). Otherwise Otsu's threshold.
    - `labels`: of a label map, `'all'`, numbers, names, or text such as `'1,5,7..20,liver'`: each with its surface, walls between neighbours
      included. `names`: their names by number, `'totalsegmentator'`, `'freesurfer'`, or the path of a table as `oct build --names` takes it: CSV or TSV
      with columns `label`, `name` and, where colours are given, `color` (`#rrggbb`). `keep_names`: as the flag.
      `smooth`: how far walls may move from the midpoint of the samples they separate, 0 to 0.5 voxel. Labels are stored as cells.
    - `each`: a folder for a model of each label, too, named by the label; `report['each']` lists them. Neighbours
      share their walls. Files of these names are replaced.
    - `surface`: `'cells'`, the surface between samples, true to a few hundredths of a voxel; or `'skin'`, voxels. By default
      cells, but skin for what only that has: other channels, `gradient`, thin walls.
    - `error`: joins cells into larger leaves that lie at most so far from the surface, in voxels (`0.1`) or as `'0.05mm'`.
    - `uncertainty`: measures the noise of a volume, and keeps one byte a cell, so that `compare` states how sure it is.

    Place
    - `spacing`: distance of samples in mm, one number or three **in the order of the array's axes** (z, y, x); for paths
      x, y, z. `origin`: place of the first sample, x, y, z in LPS mm. `affine`: 3 x 4 or 4 x 4, from an index (x, y, z) to
      LPS mm, instead of both. They come before what the source states.
    - `axes`: `'zyx'` (an array is indexed `[z, y, x]`), or `'xyz'`.

    Means
    - `memory`: what the build may add to the process, in bytes or as `'8MiB'`. `threads`: all cores by default.
      `scratch`: folder of the scratch files; that of `output` by default.
    - `progress`: called as `progress(stage, done, total)` from the calling thread, when a stage begins and every 50 ms; an
      exception in it stops the build, as Ctrl-C does, and leaves nothing behind, unless the whole model has just got its
      name. `True` shows a bar of tqdm, or lines on the standard
      error stream where that is not installed; `None` shows the bar alone, on a terminal or in a notebook; `False` nothing.

    Stored
    - `channels` (`'normal'`, `'value'`, `'color'`, `'material'`), `gradient`, `connectivity`, `visible_from`
      (`'outside'`, names of views, or points in mm), `lod`: as the flags of `oct build`.

    Cleaning
    - `roi`: (start, end) for each axis of the array (z, y, x); `downsample`, `close`, `fill_cavities`, `keep_largest`,
      `drop_below` (voxels, or `'5%'`), `component_connectivity`: as the flags.

    Meshes and trees
    - `grid`: voxels along the longest side; or `voxel`: their edge in mm. `margin`, `unit`, `fill`, `keep_thin`; `origin`
      with `voxel` and `dims` gives the grid in full. `up`: `'y'` for meshes whose y axis is up.

    Files
    - `volume`, `gaps`, `follow_links`, `orientation`; `index` of OME-Zarr and Zarr: `{'t': 12, 'c': 0}`; `dims` (x, y, z), `dtype` and `skip` of headerless files.

    Returns the open model; its `report` has the figures of the build.

    Raises `UsageError` for options that make no sense, `InputError` for a source that cannot be used, `BudgetError` with
    `minimum_bytes` if `memory` is too small, and `OSError` of its kind for what the system refuses. An old file `output` is
    untouched then.

    >>> model = infobyte.build(ball, 'ball.oct', iso=0, spacing=0.5)
    >>> model.shape
    (48, 48, 48)
    """
    if sum(given is not None for given in (iso, range, preset, labels)) > 1:
        raise UsageError("iso, range, preset and labels exclude each other; give one")
    if names is not None and labels is None:
        raise UsageError("names are of labels; give labels, too")
    if each is not None and labels is None:
        raise UsageError("each is of labels; give labels, too")
    if smooth is not None and labels is None:
        raise UsageError("smooth is for labels; give labels, too")
    if labels is not None and not isinstance(labels, str):
        labels = ",".join(str(label if isinstance(label, str) else int(label)) for label in np.atleast_1d(labels))
    asked = {
        "build": _given(
            threshold=_threshold(iso, range),
            labels=labels, smooth=smooth, surface=surface, error=None if error is None else str(error),
            uncertainty=bool(uncertainty),
            channels=None if channels is None else list(channels), gradient=gradient,
            connectivity=_text(connectivity), lod=bool(lod), memory={"share": bytes_of(memory)}, threads=threads,
            scratch=None if scratch is None else os.fspath(scratch),
        ),
        "clean": _given(
            roi=_roi(roi, axes), preset=preset, downsample=downsample, close=close, fill_cavities=bool(fill_cavities),
            keep_largest=keep_largest, drop_below=_text(drop_below), connectivity=_text(component_connectivity),
        ),
        "grid": _given(unit_mm=UNITS[unit], up=up, fill=fill, keep_thin=bool(keep_thin), follow_links=bool(follow_links)),
        "open": _given(
            gaps=gaps, volume=volume, index=[(axis, int(place)) for axis, place in (index or {}).items()],
            follow_links=bool(follow_links), keep_names=bool(keep_names), placement=_given(orientation=orientation),
        ),
        "raw": None, "visible_from": [_place(place) for place in visible_from], "names": None,
        "each": None if each is None else os.fspath(each), "affine": None, "rescale": None,
    }  # fmt: skip
    if hasattr(names, "items"):
        asked["build"]["label_names"] = [{"number": int(number), "name": name} for number, name in sorted(names.items())]
    elif names is not None:
        asked["names"] = os.fspath(names)
    if volume is not None and index:
        raise UsageError("volume and index exclude each other; give one")

    def on_disk() -> dict[str, Any]:
        """The options of files, with how fine the grid of a mesh is and how headerless samples lie."""
        asked["grid"] |= _given(grid=_grid(grid, voxel, margin, origin, dims))
        asked["raw"] = _raw(dims, dtype, skip, origin)
        return asked

    target = os.fspath(output)
    if not force:
        _infobyte.check_name(target)
    with bar(progress) as told:
        paths = _sources.paths_of(source)
        if paths is not None:
            if affine is not None:
                raise UsageError("files state their place; give spacing and orientation instead of affine")
            if spacing is not None:
                asked["open"]["placement"]["spacing_mm"] = _three(spacing)
            report = _infobyte.build_files(paths, target, dumps(on_disk()), told)
        else:
            of_files = {
                "grid": grid, "voxel": voxel, "dims": dims, "dtype": dtype, "skip": skip, "fill": fill, "volume": volume, "index": index,
                "orientation": orientation, "keep_thin": keep_thin, "follow_links": follow_links, "gaps": gaps != "error",
                "up": up != "z", "unit": unit != "mm", "margin": margin != 1,
            }  # fmt: skip
            given = [name for name, value in of_files.items() if value is not None and value is not False]
            report = _build_object(source, target, asked, on_disk, (spacing, origin, affine, axes), given, told)
    return Model._built(target, report)


def _given(**options: Any) -> dict[str, Any]:
    """The options that are not left out."""
    return {name: value for name, value in options.items() if value is not None}


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def _threshold(iso: float | None, range: tuple[float, float] | None) -> dict[str, Any] | None:
    if range is None:
        return None if iso is None else {"iso": iso}
    low, high = (float(end) for end in range)
    if not low <= high:
        raise UsageError(f"the range {low}..{high} is empty; give the lower value first")
    end = sys.float_info.max
    return {"range": [max(low, -end), min(high, end)]}


def _roi(roi: Sequence[tuple[int, int]] | None, axes: str) -> list[dict[str, int]] | None:
    if roi is None:
        return None
    ranges = [{"start": int(start), "end": int(end)} for start, end in _turned(roi, axes)]
    if any(part["start"] >= part["end"] for part in ranges):
        raise UsageError("roi is not a box; give (start, end) for each axis, start below end")
    return ranges


def _refuse_outside(asked: dict[str, Any], sides: Sequence[int]) -> None:
    for axis, side, part in zip("xyz", sides, asked["clean"].get("roi", ())):
        if part["end"] > side:
            raise UsageError(
                f"roi ends at {part['end']} along {axis}, where the array has {side} samples; give (start, end) in the order of its axes"
            )


def _grid(grid: int | None, voxel: float | None, margin: int, origin: Any, dims: Any) -> dict[str, Any] | None:
    """How fine the grid of a mesh or a tree is, if that is given."""
    if grid is not None and voxel is not None:
        raise UsageError("grid and voxel are both given; choose one")
    if origin is not None:
        if voxel is None or dims is None:
            raise UsageError("origin needs voxel and dims")
        place = [float(at) for at in origin]
        return {"exact": {"edge_mm": voxel, "origin_mm": place, "dims": [int(side) for side in dims]}}
    if grid is not None:
        if not 1 <= grid <= 16384:
            raise UsageError(f"grid={grid} is not a number of voxels; choose 1 to 16384")
        return {"side": {"voxels": grid, "margin": margin}}
    return None if voxel is None or dims is not None else {"voxel": {"edge_mm": voxel, "margin": margin}}


def _raw(dims: Any, dtype: str | None, skip: int | None, origin: Any) -> dict[str, Any] | None:
    """The layout of headerless files, if it is given."""
    if dims is not None and dtype is not None:
        return {"dims": [int(side) for side in dims], "dtype": dtype, "skip": skip or 0}
    if dtype is None and (skip is None and dims is None or dims is not None and origin is not None):
        return None
    raise UsageError("headerless files need dims and dtype")


def _build_object(source: Any, target: str, asked: dict[str, Any], on_disk: Callable[[], Any], place: Any, of_files: list[str], told: Any) -> str:
    known = _sources.recognised(source)
    spacing, origin, affine, axes = place
    if isinstance(known, _sources.Triangles):
        import tempfile

        with tempfile.NamedTemporaryFile(suffix=".stl", dir=_folder(asked, target)) as file:
            known.write_stl(file)
            file.flush()
            return _infobyte.build_files([file.name], target, dumps(on_disk()), told)
    if of_files:
        raise UsageError(f"{of_files[0]} is for files and meshes; leave it out for samples in memory")
    samples, stated = source, None
    if known is not None:
        samples, stated, axes = known.samples, known.affine, "zyx"
        asked["rescale"] = None if known.rescale is None else list(known.rescale)
    asked["affine"] = _placement(spacing, origin, affine, stated, axes).tolist()
    if asked["build"].get("labels") is not None and _sources.is_masked(samples):
        samples = samples.filled(0)
    if isinstance(samples, np.ndarray) and _sources.is_in_place(samples):
        array = _sources.three_axes(samples, axes)
        if array.size == 0:
            raise UsageError("the array is empty")
        layout = list(array.shape[::-1]), _sources.NATIVE[_sources.kept_type(array.dtype).str[1:]]
        _refuse_outside(asked, layout[0])
        stored = _sources.mapped_file(array)
        if stored is not None:
            return _infobyte.build_stored(stored, layout, target, dumps(asked), told)
        return _infobyte.build_array(*_sources.flat(array), layout, target, dumps(asked), told)
    return _build_slabs(samples, target, asked, axes, told)


def _build_slabs(source: Any, target: str, asked: dict[str, Any], axes: str, told: Any) -> str:
    """Builds what comes slab by slab: from memory where half of it suffices, else from a scratch file without a name."""
    import tempfile

    if all(hasattr(source, name) for name in ("shape", "dtype", "__getitem__")):
        shape, dtype, parts = _sources.slabs(source, axes, asked["build"]["memory"]["share"] // 2)
    elif isinstance(source, Iterable):
        if axes != "zyx":
            raise UsageError("slices come along the first axis; axes='xyz' is for whole arrays")
        shape, dtype, parts = None, None, _slices(source)
    else:
        raise UsageError(f"{type(source).__name__} is not a source; see the documentation of infobyte.build")
    with contextlib.ExitStack() as stack:
        # Pages that are not filled are not held. A build needs some MiB besides.
        memory = asked["build"]["memory"]["share"]
        share = max(memory // 4, min(memory // 2, memory - (6 << 20)))
        whole = 1 << 30 if shape is None else math.prod(shape) * _sources.kept_type(dtype).itemsize
        room, used = np.empty(min(share, whole), np.uint8), 0
        side, depth, file = None, 0, None
        for part in parts:
            if side is None:
                side = part.shape[1:]
                dtype = _sources.kept_type(part.dtype if dtype is None else dtype)
            if part.shape[1:] != side:
                raise UsageError(f"slice {depth} is of {part.shape[1:]}, those before it of {side}")
            if part.dtype.kind == "f" and dtype.kind != "f":
                raise UsageError(f"slice {depth} holds floats or masked samples, those before it whole numbers; convert all of them")
            samples = np.ascontiguousarray(part, dtype)
            if file is None and used + samples.nbytes > len(room):
                file = stack.enter_context(tempfile.TemporaryFile(dir=_folder(asked, target)))
                file.write(room[:used])
                room = None
            if file is None:
                room[used : used + samples.nbytes] = samples.reshape(-1).view(np.uint8)
                used += samples.nbytes
            else:
                file.write(samples.data)
            depth += len(part)
            if told is not None:
                told("unroll", depth, depth if shape is None else shape[0])
        if side is None or 0 in (depth, *side):
            raise UsageError("there are no slices")
        layout = [side[1], side[0], depth], _sources.NATIVE[dtype.str[1:]]
        _refuse_outside(asked, layout[0])
        if file is None:
            array = room[:used].view(dtype).reshape(depth, *side)
            asked["build"]["memory"]["share"] -= used
            return _infobyte.build_array(*_sources.flat(array), layout, target, dumps(asked), told)
        file.flush()
        # Read through the descriptor: the file has no name.
        return _infobyte.build_stored((f"/proc/self/fd/{file.fileno()}", 0), layout, target, dumps(asked), told)


def _slices(source: Iterable[Any]) -> Iterator[np.ndarray]:
    for part in source:
        array = _sources.filled(part)
        if array.ndim not in (2, 3):
            raise UsageError(f"a slice has two dimensions, a slab three, not {array.ndim}")
        yield array[None] if array.ndim == 2 else array


def _folder(asked: dict[str, Any], target: str) -> str:
    return asked["build"].get("scratch") or os.path.dirname(os.path.abspath(target))


def _three(value: Any) -> list[float]:
    numbers = np.broadcast_to(np.asarray(value, float), 3) if np.ndim(value) == 0 else np.asarray(value, float)
    if numbers.shape != (3,) or not (np.isfinite(numbers).all() and (numbers > 0).all()):
        raise UsageError(f"spacing={value!r} is not one distance in mm, or three, each above 0")
    return [float(number) for number in numbers]


def _turned(value: Sequence[Any], axes: str) -> list[Any]:
    """What is in the order of an array's axes, as x, y, z."""
    parts = list(value)
    if len(parts) != 3:
        raise UsageError("roi and spacing have a part for each of three axes")
    return parts[::-1] if axes == "zyx" else parts


def _placement(spacing: Any, origin: Any, affine: Any, stated: Any, axes: str) -> np.ndarray:
    if affine is not None:
        if spacing is not None or origin is not None:
            raise UsageError("affine says where the voxels are; leave out spacing and origin")
        matrix = np.asarray(affine, float)
        if matrix.shape not in ((3, 4), (4, 4)) or not np.isfinite(matrix).all():
            raise UsageError("an affine has 3 x 4 or 4 x 4 finite numbers")
        if np.linalg.matrix_rank(matrix[:3, :3]) < 3:
            raise UsageError("the three columns of the affine lie in a plane; voxels need a volume")
        return matrix[:3]
    if stated is None:
        stated = np.eye(3, 4)
    placed = np.array(stated, float)
    if spacing is not None:
        lengths = np.linalg.norm(placed[:, :3], axis=0)
        placed[:, :3] *= np.array(_turned(_three(spacing), axes)) / lengths
    if origin is not None:
        placed[:, 3] = [float(at) for at in origin]
    return placed


def _place(value: Any) -> str:
    return value if isinstance(value, str) else ",".join(repr(float(at)) for at in value)
