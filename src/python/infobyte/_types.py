"""Types of options, for checkers, editors, and `_check`."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypedDict

Path = str | os.PathLike[str]
Progress = Callable[[str, int, int], object] | bool | None

# Pictures
Axis = Literal["x", "y", "z"]
Colors = Literal["auto", "diverging", "sequential"]
Label = str | int
Layer = Literal["depth", "position", "normals", "ids"]
Opacity = Mapping[str, float] | Mapping[int, float] | Mapping[Label, float]
Projection = Literal["parallel", "perspective"]
Samples = Literal["auto", 1, 4, 16, 64]
Shading = Literal["plain", "soft", "ao", "stored", "blended", "flat"]
View = Literal["front", "back", "left", "right", "top", "bottom", "iso"]

# Builds
Axes = Literal["zyx", "xyz"]
Channel = Literal["normal", "value", "color", "material", "offset"]
Close = Literal[0, 1, 2]
Connectivity = Literal[6, 26]
Downsample = Literal[2, 4]
Fill = Literal["winding", "parity", "surface"]
Gaps = Literal["error", "fill", "keep"]
Gradient = Literal["central", "sobel", "isotropic5", "modified", "label5", "auto"]
Preset = Literal["bone", "compact-bone", "teeth", "metal", "skin", "muscle", "fat", "lung"]
Surface = Literal["cells", "skin"]
Unit = Literal["um", "mm", "cm", "m", "in"]
Up = Literal["z", "y"]

# Measurements and exports
Form = Literal["stl", "ply", "obj", "glb", "3mf", "points", "nrrd", "nii", "nii.gz", "html", "linked"]
Way = Literal["ray", "ball"]


class Picture(TypedDict, total=False):
    """Options of `Model.render` besides `size` and `layers`."""

    view: View | None
    eye: Sequence[float] | None
    look_at: Sequence[float] | None
    up: Sequence[float] | None
    turned: float | None
    projection: Projection
    fov: float | None
    zoom: float
    color: Sequence[int] | None
    shading: Shading | None
    colors: Colors | None
    range: tuple[float, float] | None
    blended: bool
    samples: Samples
    ao_rays: int | None
    lod: bool
    smooth_edges: bool
    annotate: bool
    title: str | bool
    legend: bool
    clip: Mapping[Axis, tuple[float | None, float | None]] | None
    only: Label | Sequence[Label] | None
    hide: Label | Sequence[Label]
    opacity: Opacity | None
    section: tuple[Axis, float] | None
    background: Sequence[int] | None
    threads: int | None
