"""What `build` takes: every kind of source as files, as an array with its place, as slabs, or as triangles."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from ._errors import UsageError

#: Types of samples that are read in place.
NATIVE = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "f4": "f32", "f8": "f64"}

#: From x, y, z in the axes of RAS to those of LPS.
RAS_TO_LPS = np.diag([-1.0, -1.0, 1.0])


class Placed:
    """Samples with the axes z, y, x, their place, and what turns a sample into a physical value.

    `affine` is 3 x 4 and maps an index (x, y, z) to LPS mm; `None` if the source does not state it.
    """

    def __init__(self, samples: Any, affine: Any = None, rescale: tuple[float, float] | None = None):
        self.samples, self.affine, self.rescale = samples, affine, rescale


class Triangles:
    """Corners, N x 3, and the numbers of the corners of each triangle, M x 3."""

    def __init__(self, vertices: Any, faces: Any):
        self.vertices = np.asarray(vertices, dtype=np.float32)
        self.faces = np.asarray(faces)
        if self.vertices.ndim != 2 or self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise UsageError("a mesh has vertices of N x 3 and faces of M x 3")

    def write_stl(self, file: Any) -> None:
        """Writes a binary STL."""
        file.write(bytes(80) + len(self.faces).to_bytes(4, "little"))
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("none", "<u2")])
        for part in range(0, len(self.faces), 1 << 16):
            faces = self.faces[part : part + (1 << 16)]
            records = np.zeros(len(faces), record)
            records["corners"] = self.vertices[faces]
            file.write(records.tobytes())


def _affine(matrix: Any, spacing: Any, origin: Any) -> np.ndarray:
    """3 x 4: columns of directions (axes x, y, z of the array) times spacing, and the first voxel's place."""
    columns = np.asarray(matrix, float).reshape(3, 3) * np.asarray(spacing, float)
    return np.column_stack([columns, np.asarray(origin, float)])


def paths_of(source: Any) -> list[str] | None:
    """The paths, if the source is one or several."""
    if isinstance(source, (str, os.PathLike)):
        return [os.fspath(source)]
    is_list = isinstance(source, (list, tuple)) and source
    if is_list and all(isinstance(part, (str, os.PathLike)) for part in source):
        return [os.fspath(part) for part in source]
    return None


def recognised(source: Any) -> Placed | Triangles | None:
    """What objects of other packages hold; nothing of these packages is imported."""
    package = type(source).__module__.partition(".")[0]
    if package == "SimpleITK":
        return _simpleitk(source)
    if package == "itk":
        return _itk(source)
    if package == "xarray":
        return _xarray(source)
    if hasattr(source, "dataobj") and hasattr(source, "affine"):
        return _nibabel(source)
    if hasattr(source, "GetDimensions") and hasattr(source, "active_scalars"):
        return _pyvista_grid(source)
    if hasattr(source, "regular_faces"):
        source = source if source.is_all_triangles else source.triangulate()
        return Triangles(source.points, source.regular_faces)
    if hasattr(source, "vertices") and (hasattr(source, "faces") or hasattr(source, "triangles")):
        return Triangles(source.vertices, source.faces if hasattr(source, "faces") else source.triangles)
    return None


def _simpleitk(image: Any) -> Placed:
    import SimpleITK

    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise UsageError("an image needs three dimensions, and one sample for each voxel")
    affine = _affine(image.GetDirection(), image.GetSpacing(), image.GetOrigin())
    return Placed(SimpleITK.GetArrayViewFromImage(image), affine)


def _itk(image: Any) -> Placed:
    import itk

    samples = itk.array_view_from_image(image)
    if samples.ndim != 3:
        raise UsageError("an image needs three dimensions, and one sample for each voxel")
    direction = np.asarray(itk.array_from_matrix(image.GetDirection()))
    return Placed(samples, _affine(direction, list(image.GetSpacing()), list(image.GetOrigin())))


def _nibabel(image: Any) -> Placed:
    proxy, rescale = image.dataobj, None
    if hasattr(proxy, "get_unscaled"):
        samples = proxy.get_unscaled()
        slope, intercept = float(proxy.slope), float(proxy.inter)
        rescale = None if (slope, intercept) == (1.0, 0.0) else (slope, intercept)
    else:
        samples = np.asarray(proxy)
    while samples.ndim > 3 and samples.shape[-1] == 1:
        samples = samples[..., 0]
    if samples.ndim != 3:
        raise UsageError(f"an image of {samples.ndim} dimensions is not a volume; choose one of its volumes, as with slicer[..., 0]")
    affine = None if image.affine is None else RAS_TO_LPS @ np.asarray(image.affine, float)[:3]
    return Placed(samples.transpose(2, 1, 0), affine, rescale)


def _xarray(array: Any) -> Placed:
    names = [str(name).lower() for name in array.dims]
    if len(names) == 3 and sorted(names) == ["x", "y", "z"]:
        array = array.transpose(*(array.dims[names.index(axis)] for axis in "zyx"))
    steps, first = [], []
    for name in array.dims:
        along = array.coords[name].values if name in array.coords else np.arange(2)
        if along.dtype.kind not in "iuf" or len(along) < 2:
            along = np.arange(2)
        step = np.diff(along)
        if not np.allclose(step, step[0]) or step[0] == 0:
            raise UsageError(f"the coordinates along {name} are not evenly spaced")
        steps.append(float(step.mean()))
        first.append(float(along[0]))
    return Placed(array.data, _affine(np.eye(3), steps[::-1], first[::-1]) if len(steps) == 3 else None)


def _pyvista_grid(grid: Any) -> Placed:
    scalars = grid.active_scalars
    if scalars is None or scalars.ndim != 1:
        raise UsageError("the grid has no active scalars, or several for each point")
    sides, origin = np.array(grid.dimensions), np.array(grid.origin, float)
    direction = np.asarray(getattr(grid, "direction_matrix", np.eye(3)), float)
    if len(scalars) != sides.prod():
        # Scalars of cells are at their middles.
        sides, origin = np.maximum(sides - 1, 1), origin + direction @ (np.array(grid.spacing) / 2)
    samples = np.asarray(scalars).reshape(tuple(sides[::-1]))
    return Placed(samples, _affine(direction, grid.spacing, origin))


def refuse_flat(dimensions: int, axes: str) -> None:
    if dimensions != 3:
        slice_of = "array[None]" if axes == "zyx" else "array[..., None]"
        way = f"a single slice as {slice_of}" if dimensions < 3 else "one volume or channel as array[0] or array[..., 0]"
        raise UsageError(f"an array of {dimensions} dimensions is not a volume; it needs three, {way}")


def three_axes(samples: Any, axes: str) -> Any:
    """An array with the axes z, y, x, without a copy."""
    refuse_flat(samples.ndim, axes)
    return samples.transpose(2, 1, 0) if axes == "xyz" else samples


def kept_type(dtype: np.dtype) -> np.dtype:
    """The type in which samples of a type are built: itself, or one that holds its values."""
    if dtype.kind == "b":
        return np.dtype("u1")
    if dtype.kind not in "iuf":
        raise UsageError(f"samples of type {dtype} cannot be built; whole numbers and floats can")
    native = dtype.newbyteorder("=")
    if native.str[1:] in NATIVE:
        return native
    return np.dtype("f4") if native.itemsize < 4 else np.dtype("f8")


def is_in_place(array: np.ndarray) -> bool:
    """Can the samples be read where they are?"""
    return not is_masked(array) and (array.dtype.kind == "b" or kept_type(array.dtype) == array.dtype)


def is_masked(array: Any) -> bool:
    """Is any sample masked?"""
    return isinstance(array, np.ma.MaskedArray) and bool(np.ma.is_masked(array))


def filled_type(array: Any) -> np.dtype:
    """The type in which samples are built; that of a masked array holds NaN."""
    kept = kept_type(np.dtype(array.dtype))
    if not isinstance(array, np.ma.MaskedArray) or kept.kind == "f":
        return kept
    return np.dtype("f4") if kept.itemsize <= 2 else np.dtype("f8")


def filled(array: Any) -> np.ndarray:
    """An array in which masked samples are NaN, and so outside."""
    if not isinstance(array, np.ma.MaskedArray):
        return np.asarray(array)
    return array.astype(filled_type(array)).filled(np.nan)


def flat(array: np.ndarray) -> tuple[np.ndarray, tuple[int, list[int]]]:
    """The bytes that an array lies in, the byte of its first sample, and its strides along x, y, z in bytes."""
    array = np.asarray(array)
    back = tuple(slice(None, None, -1 if stride < 0 else 1) for stride in array.strides)
    low = array[back]
    first = sum((side - 1) * -stride for side, stride in zip(array.shape, array.strides) if stride < 0)
    reach = sum((side - 1) * stride for side, stride in zip(low.shape, low.strides)) + array.itemsize
    one = low[:1, :1, :1].reshape(1).view(np.uint8)
    held = np.lib.stride_tricks.as_strided(one, (reach,), (1,), writeable=False)
    return held, (first, [int(stride) for stride in array.strides[::-1]])


def mapped_file(array: np.ndarray) -> tuple[str, int] | None:
    """The file that a contiguous array is mapped from, and the byte where it begins there.

    Read by position it does not count as memory of the process. A private mapping may differ from its file.
    """
    import mmap

    base = array
    while getattr(base, "base", None) is not None:
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    if not isinstance(base, mmap.mmap) or not array.flags.c_contiguous or not sys.platform.startswith("linux"):
        return None
    start = array.__array_interface__["data"][0]
    with open("/proc/self/maps") as maps:
        for line in maps:
            where, mode, offset, _, inode, *name = line.rstrip("\n").split(None, 5)
            low, high = (int(end, 16) for end in where.split("-"))
            if low <= start < high:
                path = name[0] if name else ""
                try:
                    is_it = mode[3] == "s" and start + array.nbytes <= high and os.stat(path).st_ino == int(inode)
                except OSError:
                    is_it = False
                return (path, int(offset, 16) + start - low) if is_it else None
    return None


def slabs(source: Any, axes: str, most_bytes: int) -> tuple[tuple[int, int, int], np.dtype, Iterator[np.ndarray]]:
    """Shape, type and slabs from front to back of what has `shape`, `dtype` and slices, such as a dask array."""
    shape = tuple(int(side) for side in source.shape)
    refuse_flat(len(shape), axes)
    dtype = filled_type(source)
    along = 0 if axes == "zyx" else 2
    chunk = getattr(source, "chunks", None) or (1, 1, 1)
    height = chunk[along] if isinstance(chunk[along], int) else max(chunk[along])
    slice_bytes = max(1, int(np.prod(shape)) // max(1, shape[along]) * dtype.itemsize)
    height = max(1, min(height, most_bytes // slice_bytes))

    def parts() -> Iterator[np.ndarray]:
        for start in range(0, shape[along], height):
            part = slice(start, min(start + height, shape[along]))
            yield filled(source[part] if along == 0 else source[:, :, part])

    z, y, x = shape if axes == "zyx" else shape[::-1]
    return (z, y, x), dtype, (three_axes(part, axes) for part in parts())
