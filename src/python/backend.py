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
        command = ["cargo", "rustc", "--locked", "--profile", "wheel", "--bin", "oct", *arguments]
        # Small where speed does not show: the program itself, which reads its arguments and calls the library.
        subprocess.run([*command, "--", "-C", "opt-level=s"], cwd=TOP, check=True)
        target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", TOP / "target"))
        triple = [arguments[arguments.index("--target") + 1]] if "--target" in arguments else []
        built = target.joinpath(*triple, "wheel", "oct")
    shutil.copy(built, PROGRAM)


def squeeze(wheel: pathlib.Path) -> None:
    """Compresses a wheel again, by zopfli: 7 % smaller than maturin leaves it, in three minutes."""
    import zipfile
    from zopfli.zlib import compress

    class Compressor:
        def __init__(self, *_):
            self.parts = []

        def compress(self, part):
            self.parts.append(part)
            return b""

        def flush(self):
            # Without the head and the checksum of zlib.
            return compress(b"".join(self.parts), blocksplittingmax=0)[2:-4]

    # The module has no other place for a compressor.
    zipfile._get_compressor = Compressor
    smaller = wheel.with_suffix(".tmp")
    with zipfile.ZipFile(wheel) as given, zipfile.ZipFile(smaller, "w") as made:
        for member in given.infolist():
            made.writestr(member, given.read(member))
    smaller.replace(wheel)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    build_program()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    build_program()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


if __name__ == "__main__":
    import sys

    if sys.argv[1:2] == ["--squeeze"]:
        squeeze(pathlib.Path(sys.argv[2]))
    else:
        build_program(*sys.argv[1:])
