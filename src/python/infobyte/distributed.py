"""Models built by the workers of Dask `distributed`, in parts that are merged into the bytes of one build.

The package `distributed` is imported when a build begins. There is no network code here: parts are files in a folder
that all workers see, and futures hold their paths.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from . import _errors
from ._build import _bar
from ._errors import UsageError
from ._model import Model, loads

if TYPE_CHECKING:
    from ._build import Path, Progress

__all__ = ["build"]

#: What exit codes of `oct` mean; all else (a full disk, a signal) may pass.
_FINAL = {2: "usage", 3: "input", 4: "budget"}


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
    from distributed import as_completed, get_client
    from distributed.scheduler import KilledWorker

    client = get_client() if client is None else client
    target = os.path.abspath(os.fspath(output))
    folder = target + ".parts" if job is None else os.path.abspath(os.fspath(job))
    paths = [source] if isinstance(source, str | os.PathLike) else list(source)
    inputs = [os.path.abspath(os.fspath(path)) for path in paths]
    planned = _run("plan", *inputs, *_flags(options), f"--parts={parts}", f"--out={folder}")
    plan = _made(planned)["plan"]
    with _bar(progress) as told:
        settings = (plan, str(memory), threads)

        def submit(number: int) -> Any:
            return client.submit(_part, number, *settings, key=f"oct-{os.path.basename(folder)}-{number}-{os.urandom(4).hex()}")

        waiting = {submit(number): number for number in range(parts)}
        tries = dict.fromkeys(range(parts), 0)
        done = 0
        try:
            if told is not None:
                told("parts", 0, parts)
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
                        told("parts", done, parts)
                    continue
                if code in _FINAL or tries[number] == retries:
                    _made((code, answer))
                tries[number] += 1
                again = submit(number)
                waiting[again] = number
                results.add(again)
        finally:
            client.cancel(list(waiting))
        report = _made(_run("merge", plan, f"--output={target}"))
        if job is None:
            shutil.rmtree(folder)
    import json

    return Model._built(target, json.dumps(report))


def _part(number: int, plan: str, memory: str, threads: int) -> tuple[int, str]:
    """On a worker: builds a part, unless it is there; its exit code and its report, or the reason."""
    return _run("part", plan, str(number), f"--memory={memory}", f"--threads={threads}")


def _program() -> str:
    own = shutil.which("oct", path=sysconfig.get_path("scripts"))
    found = os.environ.get("INFOBYTE_OCT") or own or shutil.which("oct")
    if found is None:
        raise UsageError("the program oct is not installed with this package; install the wheel, or name it in INFOBYTE_OCT")
    return found


def _run(*arguments: str) -> tuple[int, str]:
    done = subprocess.run([_program(), *arguments, "--json", "--quiet"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    return done.returncode, done.stdout if done.returncode == 0 else done.stderr.strip().removeprefix("oct: ")


def _made(result: tuple[int, str]) -> dict[str, Any]:
    """The report of a call, or the exception for what went wrong."""
    code, answer = result
    if code == 0:
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
