"""Volumes, meshes and solids as surface octrees in fixed memory, shown by exact rays.

>>> z, y, x = np.ogrid[-23.5:24, -23.5:24, -23.5:24]
>>> ball = (20 - np.sqrt(z**2 + y**2 + x**2)).astype('f4')    # 48 x 48 x 48, above 0 inside
>>> model = infobyte.build(ball, 'ball.oct', iso=0)       # a numpy array, or a path
>>> picture = model.render(64, view='iso')                # H x W x 4; a notebook shows `model` itself
>>> hits = model.first_hits([0, 23.5, 23.5], [1, 0, 0])   # exact rays, in mm
>>> mesh = model.to_mesh()                                # closed triangles

The examples below use this `ball` and its `model`.

Arrays are indexed z, y, x; `spacing` follows their axes. Coordinates that come out are x, y, z in LPS mm: x to the left
hand of a patient, y to the back, z to the head. Without a place, voxels are of 1 mm and the middle of the first is 0, 0, 0.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from . import _infobyte
from ._build import build
from ._check import checked
from ._compare import _path, compare, pores, thickness
from ._errors import BudgetError, InfobyteError, InputError, UsageError
from ._model import Hits, Mesh, Model, Nearest, _threads
from ._model import loads as _loads
from ._progress import bar

if TYPE_CHECKING:
    from ._types import Path, Progress

__version__ = _infobyte.__version__
__all__ = [
    "BudgetError", "Hits", "InfobyteError", "InputError", "Mesh", "Model", "Nearest", "UsageError", "build",
    "compare", "open", "pack", "pores", "render_scene", "thickness", "unpack", "verify",
]  # fmt: skip

for _public in (BudgetError, Hits, InfobyteError, InputError, Mesh, Model, Nearest, UsageError, build, compare, pores, thickness):
    _public.__module__ = "infobyte"
del _public


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


@checked
def open(path: Path, *, mmap: bool = True) -> Model:
    """Opens a model, `.oct`, packed or not. Costs some microseconds whatever its size; a packed one is unpacked first.

    `mmap=False` reads the whole file, so that the model does not depend on it any more.

    Raises `InputError` for a file that is not a model, or damaged; `OSError` of its kind if it cannot be read.

    >>> infobyte.open('ball.oct').shape
    (48, 48, 48)
    """
    return Model(path, mmap=mmap)


@checked
def pack(model: Model | Path, output: Path, *, progress: Progress = False) -> dict[str, Any]:
    """Writes a model in its smallest form, for archives; the keys of `oct pack`. `progress` as in `build`.

    >>> report = infobyte.pack('ball.oct', 'small.oct')
    >>> report['bytes'] < report['bytes_in']
    True
    """
    with bar(progress) as told:
        return _loads(_infobyte.repack(_path(model), os.fspath(output), True, told))


@checked
def unpack(model: Model | Path, output: Path, *, progress: Progress = False) -> dict[str, Any]:
    """Writes the mapped form of a packed model, byte for byte what it was made from; the keys of `oct unpack`."""
    with bar(progress) as told:
        return _loads(_infobyte.repack(_path(model), os.fspath(output), False, told))


@checked
def verify(model: Model | Path) -> dict[str, Any]:
    """Checks every byte of a model; the keys of `oct verify`. Raises `InputError` with the first rule that is broken.

    >>> infobyte.verify('ball.oct')['ok']
    True
    """
    return _loads(_infobyte.verify(_path(model)))


@checked
def render_scene(
    scene: Path,
    output: Path,
    *,
    size: tuple[int, int] | None = None,
    threads: int | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """Makes the picture of a scene, a `.toml` file of models, lights and materials, into a PNG.

    `size`: (width, height) in pixels, instead of the scene's. Returns the keys of `oct render`.

    Raises `InputError` with the line of what is wrong in the scene.
    """
    sides = None if size is None else [int(side) for side in size]
    with bar(progress) as told:
        return _loads(_infobyte.render_scene(os.fspath(scene), os.fspath(output), sides, _threads(threads), told))
