"""The examples of README, reference and notebook are right to a strict checker of types, and the names it knows are those
of the library."""

import doctest
import pathlib
import re
import subprocess
import sys
import typing

import numpy as np
import pytest
from test_reference import TOP, notebook_cells

import infobyte
from infobyte import _types

#: What examples take for granted.
GIVEN = """
import numpy as np
import infobyte
from infobyte import distributed
ball = np.zeros((48, 48, 48), np.float32)
array = ball
origins = directions = np.zeros((4, 3))
model = infobyte.open("ball.oct")
"""

#: What calls return, and what is refused: an ignored line without an error is one.
TYPES = """
from collections.abc import Iterator
from typing import Any, assert_type
from numpy.typing import NDArray
assert_type(model.render(64, view="iso"), NDArray[np.uint8])
assert_type(model.render(64, layers=["depth"]), dict[str, NDArray[Any]])
assert_type(model.turntable(2, 16, shading="flat"), Iterator[NDArray[np.uint8]])
assert_type(model.turntable(2, 16, output="a.gif"), None)
assert_type(model.first_hits([0, 0, 0], [0, 0, 1]).is_hit, NDArray[np.bool_])
infobyte.build(ball, "a.oct", channels=["normal", "value"], progress=lambda stage, done, total: None)
infobyte.build(ball, "a.oct", surface="skins")  # type: ignore[arg-type]
model.render(64, view="above")  # type: ignore[call-overload]
model.png(64, layers=["depth"])  # type: ignore[call-arg]
model.png(64, projection="isometric")  # type: ignore[arg-type]
assert_type(model.to_mesh(only=["liver", 5], triangles=100), infobyte.Mesh)
model.export("a.stl", only=["1..4"], smooth=0.2)
model.to_mesh(only=5)
model.to_mesh(only=0.5)  # type: ignore[arg-type]
model.export("a.stl", "step")  # type: ignore[arg-type]
infobyte.thickness(model, by="sphere")  # type: ignore[arg-type]
"""


def examples() -> dict[str, str]:
    """Programs by name."""
    reference = (TOP / "docs/PYTHON.md").read_text()
    blocks = re.findall(r"^```python\n(import infobyte\n.*?)^```", (TOP / "README.md").read_text() + reference, re.M | re.S)
    blocks += ["\n".join(cell for cell in notebook_cells())]
    for text in re.findall(r"^```pycon\n(.*?)^```", reference, re.M | re.S):
        blocks.append("".join(example.source for example in doctest.DocTestParser().get_examples(text)))
    return {f"example_{number}.py": GIVEN + block for number, block in enumerate(blocks)} | {"types.py": GIVEN + TYPES}


def test_a_strict_checker_accepts_every_example(tmp_path):
    pytest.importorskip("mypy", reason="skipped: mypy is not installed")
    programs = examples()
    assert len(programs) > 20
    for name, text in programs.items():
        (tmp_path / f"of_{name}").write_text(text)
    command = [sys.executable, "-m", "mypy", "--strict", f"--cache-dir={tmp_path / 'cache'}", *(f"of_{name}" for name in programs)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_names_of_options_are_those_of_the_library(model, ball):
    def each(of):
        return typing.get_args(of)

    for name, of in [("view", _types.View), ("projection", _types.Projection), ("shading", _types.Shading), ("samples", _types.Samples)]:
        for value in each(of):
            assert model.render(4, **{name: value}).shape == (4, 4, 4)
    assert set(model.render(4, layers=each(_types.Layer))) == {"color", *each(_types.Layer)}
    for form in each(_types.Form):
        assert model.export(f"out.{form}", form)
    for name, of in [("gradient", _types.Gradient), ("connectivity", _types.Connectivity), ("downsample", _types.Downsample), ("close", _types.Close)]:
        for value in each(of):
            infobyte.build(ball, "out.oct", iso=0, surface="skin", progress=False, **{name: value})
    ball.tofile("ball.raw")
    samples = dict(iso=0, dims=(48, 48, 48), dtype="f32")
    for name, of, source, options in [
        ("unit", _types.Unit, "out.stl", dict(grid=16)), ("up", _types.Up, "out.stl", dict(grid=16)),
        ("gaps", _types.Gaps, "ball.raw", samples), ("axes", _types.Axes, ball, dict(iso=0)),
    ]:  # fmt: skip
        for value in each(of):
            infobyte.build(source, "out.oct", progress=False, **options, **{name: value})
    for preset in each(_types.Preset):
        infobyte.build((150 * ball).astype("i2"), "out.oct", preset=preset, progress=False)


def test_only_what_is_public_is_listed():
    assert set(dir(infobyte)) == {*infobyte.__all__, "__version__"}
    listed = {name for name in dir(infobyte.Model) if not name.startswith("_")}
    assert listed <= set(re.findall(r"(?:`Model|\*\*`)\.(\w+)`", (TOP / "docs/PYTHON.md").read_text()))
