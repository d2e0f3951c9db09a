"""Models built by the workers of Dask `distributed`: one in parts that are merged into the bytes of one build, or many.

The package `distributed` is imported when a build begins. There is no network code here: parts are files in a folder
that all workers see, and futures hold their paths.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from . import _errors
from ._check import checked
from ._errors import UsageError
from ._model import Model, loads
from ._progress import bar

if TYPE_CHECKING:
    from ._types import Path, Progress

__all__ = ["build", "batch"]

#: What exit codes of `oct` mean; all else (a full disk, a signal) may pass.
_FINAL = {2: "usage", 3: "input", 4: "budget"}
#: What `oct batch` says where some volumes failed.
_SOME_FAILED = 8


@checked
def build(
    source: Path | Sequence[Path],
    output: Path,
    *,
    parts: int,
    client: Any = None,
    job: Path | None = None,
    memory: int | str = "16MiB",
    threads: int = 1,
    retries: int = 5,
    progress: Progress = None,
    **options: Any,
) -> Model:
    """Builds files into the model `output`, part by part on the workers of a Dask cluster.

    The bytes are those of `oct build`, whatever the number of parts and workers.

    - `source`: a path or a list of paths, which all workers see under the same names.
    - `parts`: how many; the grid is cut at multiples of 128 voxels along z, then along y.
    - `client`: a `distributed.Client`; the current one by default. Clusters may grow and shrink meanwhile.
    - `job`: folder of the plan and the parts, which all workers see; `output` with `.parts` added by default, which is
      removed at the end. Parts that are there from a build that was stopped are not built again.
    - `memory`: of each part, a process of its own, in bytes or as `'16MiB'`; `threads`: of each part.
    - `retries`: how often a part is built again after a full disk, a signal or the loss of its worker. The scheduler
      gives a part up after the loss of `distributed.scheduler.allowed-failures` workers, which counts as one try.
    - `progress`: as that of `infobyte.build`, a step for each part. Ctrl-C and exceptions in it cancel what waits.
    - `options`: those of `oct plan`, by their names: `iso=300`, `range=(100, 200)`, `surface='skin'`, `roi='0..9,0..9,0..9'`,
      `fill_cavities=True`. `None` and `False` leave an option out.

    Returns the open model. Raises as `infobyte.build`, and `OSError` for a part that failed too often; the old file
    `output` is untouched then, and the parts that are done stay in `job`.

    >>> from infobyte import distributed
    >>> model = distributed.build('scan.nrrd', 'scan.oct', parts=64, iso=300)   # doctest: +SKIP
    """
    target = os.path.abspath(os.fspath(output))
    folder = target + ".parts" if job is None else os.path.abspath(os.fspath(job))
    planned = _run("plan", *_paths(source), *_flags(options), f"--parts={parts}", f"--out={folder}")
    plan, stages = itemgetter("plan", "stages")(_made(planned))
    means = [f"--memory={memory}", f"--threads={threads}"]
    with bar(progress) as told:
        # What has to be known of the whole volume comes first: every stage ends in one file for all parts.
        for stage in stages:
            named = f"--stage={stage}"
            calls = [(_run, "part", plan, str(number), named, *means) for number in range(parts)]
            _do(client, calls, retries, stage, told)
            _made(_run("merge", plan, named))
        _do(client, [(_run, "part", plan, str(number), *means) for number in range(parts)], retries, "parts", told)
        report = _made(_run("merge", plan, f"--output={target}"))
        if job is None:
            shutil.rmtree(folder)
    import json

    return Model._built(target, json.dumps(report))


@checked
def batch(
    source: Path | Sequence[Path],
    out: Path,
    *,
    client: Any = None,
    bundle: int = 20,
    memory: int | str = "64MiB",
    threads: int = 1,
    retries: int = 5,
    progress: Progress = None,
    **options: Any,
) -> dict[str, Any]:
    """Converts every volume below some folders on the workers of a Dask cluster, as `oct batch` does on one machine.

    - `source`: a folder or a list of them, `out`: the folder of the models; all workers see them under the same names.
    - `bundle`: volumes of one task, which ends before that at 1 GiB of input.
    - `client`, `retries`, `progress`: as in `build`; a step for each bundle.
    - `memory`, `threads`: of each task, a process of its own.
    - `options`: those of `oct batch`, by their names: `preset='bone'`, `modality=['CT']`, `thumbnails=0`.

    Workers make models, thumbnails and records; then one `oct batch` goes over the same folders, which finds by these
    records what is done, does what is left, and writes contact sheet and reports. So they are those of a second
    `oct batch`: what workers have made is `skipped`, as it is there. The names are those of one machine.

    Returns the report. Volumes that fail are not errors; they are in the report. A batch that was stopped goes on.

    >>> from infobyte import distributed
    >>> report = distributed.batch('studies/', 'models/', preset='bone')   # doctest: +SKIP
    """
    inputs, folder = _paths(source), os.path.abspath(os.fspath(out))
    looked_for = {name: options[name] for name in ("all_volumes", "follow_links", "gaps", "grid", "voxel") if name in options}
    found = _made(_run("scan", *inputs, *_flags(looked_for)))
    shelf = os.path.join(folder, ".bundles")
    os.makedirs(shelf, exist_ok=True)
    key = os.path.join(folder, ".oct-key")
    # The number that hides times of change in records; theirs have to be those of the last run.
    if not os.path.exists(key):
        with open(key + ".new", "w") as file:
            file.write(os.urandom(16).hex() + "\n")
        os.replace(key + ".new", key)
    flags = [*_flags({name: value for name, value in options.items() if name != "series"}), f"--memory={memory}", f"--threads={threads}"]
    series = options.get("series") or []
    series = series.split(",") if isinstance(series, str) else series

    def is_wanted(item: dict[str, Any]) -> bool:
        return item["usable"] and (not series or any(item["name"] == one or item["name"].startswith(one + "-") for one in series))

    bundles = _bundles([item for item in found["items"] if is_wanted(item)], bundle)
    calls = []
    for volumes in bundles:
        paths = sorted({volume["input"] for volume in volumes})
        names = [volume["name"] for volume in volumes]
        calls.append((_bundle, folder, names, ["batch", *paths, f"--series={','.join(names)}", "--jobs=1", *flags]))
    with bar(progress) as told:
        _do(client, calls, retries, "bundles", told)
    # A program whose worker was lost may still be at work in a folder of its own.
    shutil.rmtree(shelf, ignore_errors=True)
    return _made(_run("batch", *inputs, f"--out={folder}", *_flags(options), f"--memory={memory}"))


def _bundles(volumes: list[dict[str, Any]], most: int) -> list[list[dict[str, Any]]]:
    """Volumes in their order, so many together, or less where they are large."""
    bundles: list[list[dict[str, Any]]] = []
    size = 0
    for volume in volumes:
        if not bundles or len(bundles[-1]) == most or size + volume["input_bytes"] > 1 << 30:
            bundles.append([])
            size = 0
        bundles[-1].append(volume)
        size += volume["input_bytes"]
    return bundles


def _bundle(out: str, names: list[str], arguments: list[str]) -> tuple[int, str]:
    """On a worker: converts a bundle in a folder of its own, and moves what was made to the rest, records last."""
    own = tempfile.mkdtemp(dir=os.path.join(out, ".bundles"))
    try:
        shutil.copy(os.path.join(out, ".oct-key"), own)
        for name in names:
            # What is there already is not made again, if it is of the same files and options.
            for file in _files(name):
                with contextlib.suppress(OSError):
                    os.link(os.path.join(out, file), os.path.join(own, file))
        code, answer = _run(*arguments, f"--out={own}")
        if code not in (0, _SOME_FAILED):
            return code, answer
        made = [name.removesuffix(".oct.json") for name in os.listdir(own) if name.endswith(".oct.json")]
        for file in (file for name in made for file in _files(name)):
            with contextlib.suppress(FileNotFoundError):
                os.replace(os.path.join(own, file), os.path.join(out, file))
        return 0, ""
    except OSError as cause:
        return -1, str(cause)
    finally:
        shutil.rmtree(own, ignore_errors=True)


def _files(name: str) -> list[str]:
    """Model, thumbnail and record of a volume."""
    return [name + suffix for suffix in (".oct", ".png", ".oct.json")]


def _do(client: Any, calls: list[tuple[Any, ...]], retries: int, stage: str, told: Any) -> None:
    """Has the workers do all calls, and those again that may pass."""
    from distributed import as_completed, get_client
    from distributed.scheduler import KilledWorker

    client = get_client() if client is None else client

    def submit(number: int) -> Any:
        do, *arguments = calls[number]
        return client.submit(do, *arguments, key=f"oct-{stage}-{number}-{os.urandom(6).hex()}", pure=False)

    waiting = {submit(number): number for number in range(len(calls))}
    tries = dict.fromkeys(range(len(calls)), 0)
    done = 0
    try:
        if told is not None:
            told(stage, 0, len(calls))
        results = as_completed(waiting)
        for future in results:
            number = waiting.pop(future)
            try:
                code, answer = future.result()
            except KilledWorker as lost:
                code, answer = -1, str(lost)
            if code == 0:
                done += 1
                if told is not None:
                    told(stage, done, len(calls))
                continue
            if code in _FINAL or tries[number] == retries:
                _made((code, answer))
            tries[number] += 1
            again = submit(number)
            waiting[again] = number
            results.add(again)
    finally:
        client.cancel(list(waiting))


def _paths(source: Path | Sequence[Path]) -> list[str]:
    paths = [source] if isinstance(source, str | os.PathLike) else list(source)
    return [os.path.abspath(os.fspath(path)) for path in paths]


def _program() -> str:
    own = shutil.which("oct", path=sysconfig.get_path("scripts"))
    found = os.environ.get("INFOBYTE_OCT") or own or shutil.which("oct")
    if found is None:
        raise UsageError("the program oct is not installed with this package; install the wheel, or name it in INFOBYTE_OCT")
    return found


def _run(*arguments: str) -> tuple[int, str]:
    quiet = [] if arguments[0] == "scan" else ["--quiet"]
    done = subprocess.run([_program(), *arguments, "--json", *quiet], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    return done.returncode, done.stdout if done.returncode in (0, _SOME_FAILED) else done.stderr.strip().removeprefix("oct: ")


def _made(result: tuple[int, str]) -> dict[str, Any]:
    """The report of a call, or the exception for what went wrong."""
    code, answer = result
    if code in (0, _SOME_FAILED):
        return loads(answer)
    sentence = answer or f"oct ended with the code {code}"
    raise _errors.make(_FINAL.get(code, "system"), sentence)


def _flags(options: dict[str, Any]) -> list[str]:
    """Options as the command line has them."""
    flags = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            flags.append(flag)
        elif name == "range" and not isinstance(value, str):
            low, high = value
            flags.append(f"{flag}={low}..{high}")
        elif isinstance(value, list | tuple):
            between = "x" if name in ("dims", "spacing") else ","
            flags.append(f"{flag}={between.join(map(str, value))}")
        else:
            flags.append(f"{flag}={value}")
    return flags
