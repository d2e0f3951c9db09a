"""A ball as an array, and a model of it."""

import os

import numpy as np
import pytest

import infobyte


def ball_of(side: int, radius: float | None = None) -> np.ndarray:
    """Distance to a sphere in voxels, float32, above 0 inside."""
    middle = (side - 1) / 2
    axis = np.arange(side, dtype=np.float32) - middle
    away = np.sqrt(axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2)
    return ((side * 0.4 if radius is None else radius) - away).astype(np.float32)


def bumps_of(shape: tuple[int, int, int], dtype="i2") -> np.ndarray:
    """An array without a symmetry, whose axes cannot be mixed up unnoticed; inside is 500 and more."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    field = 1 - ((x / 0.8) ** 2 + ((y - 0.1) / 0.6) ** 2 + ((z + 0.2) / 0.7) ** 2) + 0.2 * np.sin(5 * x) * np.cos(3 * z)
    return np.clip(field * 400 + 500, 0, 1000).astype(dtype)


@pytest.fixture
def ball() -> np.ndarray:
    return ball_of(48, 20)


@pytest.fixture
def model(ball, tmp_path) -> infobyte.Model:
    return infobyte.build(ball, tmp_path / "model.oct", iso=0, spacing=0.5, surface="cells", progress=False)


@pytest.fixture
def bumps() -> np.ndarray:
    return bumps_of((30, 41, 53))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def content(path: os.PathLike) -> str:
    """The checksum of all sections but the rank directory and META: what a model is, apart from where it is from."""
    info = infobyte.open(path).info
    sections = {name: info[name] for name in ("dims", "skin_voxels", "nodes", "channel_bytes", "range")}
    model = infobyte.open(path)
    whole = [model.voxels().tobytes(), model.normals().tobytes(), np.round(model.centers(), 9).tobytes()]
    return repr(sections) + str([hash(part) for part in whole])


@pytest.fixture
def oct():
    """Runs the program of the wheel."""
    import shutil
    import subprocess
    import sysconfig

    program = shutil.which("oct", path=sysconfig.get_path("scripts"))
    if program is None:
        pytest.skip("the package was installed without its program")

    def run(*arguments, expect=0):
        done = subprocess.run([program, *arguments, "--json"], capture_output=True, text=True)
        assert done.returncode == expect, done.stderr
        return done

    return run
