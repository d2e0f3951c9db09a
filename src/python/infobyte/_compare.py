"""Measurements: deviations of one surface from another, thickness, pores and bodies."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _infobyte
from ._check import checked, dumps
from ._errors import UsageError
from ._model import Model, _threads, bytes_of, loads
from ._progress import bar

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ._types import Path, Progress, Way


@checked
def compare(
    actual: Model | Path,
    nominal: Model | Path,
    *,
    output: Path | None = None,
    csv: Path | None = None,
    table: bool = False,
    radius: float | None = None,
    tolerance: float | tuple[float, float] | None = None,
    angle: float = 90.0,
    placement: ArrayLike | None = None,
    fit: bool = False,
    threshold_sigma: float | None = None,
    both_ways: bool = False,
    worst: int = 10,
    iso: float | None = None,
    memory: int | str = "64MiB",
    threads: int | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """How far the surface of `actual` lies from that of `nominal`; the keys of `oct compare`.

    Both are models, or paths of anything that `build` reads; a mesh as `nominal` is built on a grid twice as fine as that
    of `actual`. Deviations are in mm, positive outside the nominal. `tolerance`: the greatest size of a deviation that
    conforms, or the least and the greatest deviation. `placement`: 4 x 4 or 3 x 4, from the millimetres of `actual` to those
    of `nominal`; `fit` aligns it from there. `radius`: the farthest counterpart, a twentieth of the nominal's diagonal by
    default. `threshold_sigma`: standard deviation of the threshold of `actual`, in its values. `output`: a model with the deviations as values; `csv`: a table of all cells. `table=True` adds this table
    under `table`, as a structured array, which `pandas.DataFrame` takes. Costs a microsecond or two a cell.

    Raises `InputError` for a skin of voxels, several labels, axes that are not at right angles, and larger leaves (`error`) of
    `actual`: to see what they cost, give that model as `nominal`. `UsageError` for a placement that scales or shears.

    >>> report = infobyte.compare('ball.oct', 'ball.oct', tolerance=0.1, table=True)
    >>> report['tolerance']['verdict'], report['deviation']['max'], report['table'].dtype.names[3]
    ('conforms', 0.0, 'deviation_mm')
    """
    matrix = np.eye(4) if placement is None else np.asarray(placement, np.float64)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise UsageError("placement has three rows of four numbers, or four")
    limits = None if tolerance is None else [-tolerance, tolerance] if np.ndim(tolerance) == 0 else list(tolerance)
    asked = {
        "radius_mm": radius, "tolerance_mm": limits, "angle_deg": float(angle), "placement": matrix[:3].tolist(), "fit": bool(fit),
        "threshold_sigma": threshold_sigma, "both_ways": bool(both_ways), "worst": worst, "iso": iso, "threads": _threads(threads),
        "memory_bytes": bytes_of(memory),
    }  # fmt: skip
    files = tuple(_path(of) for of in (actual, nominal))
    return _measured(lambda *rest: _infobyte.compare(files, *rest), output, csv, table, asked, progress)


@checked
def thickness(
    model: Model | Path,
    *,
    by: Way = "ray",
    max: float | None = None,
    thin: float | None = None,
    output: Path | None = None,
    csv: Path | None = None,
    table: bool = False,
    threads: int | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """How thick the walls of a model of cells are, in mm; the keys of `oct thickness`.

    `by`: `ray`, the way to the other side against the normal, or `ball`, the largest ball within that touches the place.
    `max`: the greatest thickness that is looked for. `thin`: places that are thinner are listed. `output`: the model with its
    thickness as values; `csv`: a table of all cells. `table=True` adds this table under `table`, as a structured array,
    which `pandas.DataFrame` takes. Costs microseconds a cell, for balls as many as they are voxels wide.

    Raises `InputError` for a skin of voxels, several labels, or axes that are not at right angles; `UsageError` for an unknown way.

    >>> report = infobyte.thickness('ball.oct', thin=2, table=True)
    >>> report['none']['cells'], report['table'].dtype.names[3]
    (0, 'thickness_mm')
    """
    asked = {"by": by, "max_mm": max, "thin_mm": thin, "threads": _threads(threads)}
    return _measured(lambda *rest: _infobyte.thickness(_path(model), *rest), output, csv, table, asked, progress)


def _path(of: Model | Path) -> str:
    return of.path if isinstance(of, Model) else os.fspath(of)


def _measured(job: Any, output: Any, csv: Any, table: bool, asked: dict[str, Any], progress: Progress) -> dict[str, Any]:
    """The report of a job that writes a model and a table of cells."""
    import tempfile  # takes as long as all else

    with tempfile.TemporaryDirectory() as folder, bar(progress) as told:
        listed = os.path.join(folder, "cells.csv") if table and csv is None else csv
        written = [None if path is None else os.fspath(path) for path in (output, listed)]
        report = loads(job(*written, dumps(asked), told))
        if table:
            report["table"] = np.atleast_1d(np.genfromtxt(written[1], delimiter=",", names=True))
    return report


_PORES = (
    [("id", "i8"), ("label", "i4"), ("volume_mm3", "f8"), ("area_mm2", "f8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]
    + [(f"{axis}_{end}", "f8") for end in ("min", "max") for axis in "xyz"]
    + [("equivalent_diameter_mm", "f8"), ("sphericity", "f8"), ("samples", "i8"), ("below_resolution", "?")]
)


@checked
def pores(
    model: Model | Path,
    *,
    bodies: bool = False,
    least: int = 1,
    gap: bool = False,
    csv: Path | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """The pores that a model of cells encloses, or its separate bodies; the keys of `oct pores`.

    `table` is a structured array with a row for each, which `pandas.DataFrame` takes; its label is -1 where there is none.
    `least`: voxels of the smallest one that is listed. `gap`: adds the distance of each pore from the outer surface, in mm, NaN
    where there is none. `csv`: a file for the table. Costs one pass over the model, and for gaps a search for each cell of a pore.

    Raises `InputError` or `UsageError` for a model that is a skin of voxels, or keeps only what can be seen, and for gaps of
    bodies, labels, larger leaves or axes that are not at right angles.

    >>> report = infobyte.pores('ball.oct', bodies=True)
    >>> report['bodies'], report['table']['sphericity'].round(1).tolist()
    (1, [1.0])
    """
    import tempfile

    with tempfile.TemporaryDirectory() as folder, bar(progress) as told:
        listed = os.path.join(folder, "pores.csv") if csv is None else os.fspath(csv)
        report = loads(_infobyte.pores(_path(model), listed, (bool(bodies), int(least), bool(gap)), told))
        columns = np.dtype(_PORES + [("gap_mm", "f8")] * bool(gap))
        rows = np.empty(0, columns)
        if report["bodies" if bodies else "pores"]:
            rows = np.genfromtxt(listed, columns, delimiter=",", skip_header=1, filling_values={1: -1})
    report["table"] = np.atleast_1d(rows)
    return report
