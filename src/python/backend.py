"""Builds the package: the program `oct`, which maturin cannot build with a module, then the wheel around both."""

import os
import pathlib
import shutil
import subprocess

import maturin
from maturin import (  # noqa: F401
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
)

TOP = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = TOP / "src/python/infobyte.data/scripts/oct"
# Maturin insists on the folder, for source distributions, too.
PROGRAM.parent.mkdir(parents=True, exist_ok=True)


def build_program(*arguments: str) -> None:
    """Puts the native `oct` where maturin takes scripts from: in Python it could not keep its memory cap.

    `INFOBYTE_OCT` names one that is built already.
    """
    built = os.environ.get("INFOBYTE_OCT")
    if not built:
        command = ["cargo", "build", "--locked", "--profile", "wheel", "--bin", "oct", *arguments]
        subprocess.run(command, cwd=TOP, check=True)
        target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", TOP / "target"))
        triple = [arguments[arguments.index("--target") + 1]] if "--target" in arguments else []
        built = target.joinpath(*triple, "wheel", "oct")
    shutil.copy(built, PROGRAM)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    build_program()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    build_program()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


if __name__ == "__main__":
    import sys

    build_program(*sys.argv[1:])
