"""How far a job is, shown or reported."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._types import Progress

    Told = Callable[[str, int, int], object] | None


@contextlib.contextmanager
def bar(progress: Progress) -> Iterator[Told]:
    """The function that is told how far a job is, or `None`."""
    if callable(progress):
        yield progress
        return
    bars = _tqdm() if progress or (progress is None and _is_shown()) else None
    if bars is None:
        yield _lines() if progress else None
        return
    shown = bars(total=1, leave=False)
    try:

        def tell(stage: str, done: int, total: int) -> None:
            if shown.desc != f"{stage}: ":
                shown.reset(total=total)
                shown.set_description(stage)
            shown.update(done - shown.n)

        yield tell
    finally:
        shown.close()


def _lines() -> Callable[[str, int, int], None]:
    """Writes a line for each stage and tenth of it."""
    last: tuple[str, int] | None = None

    def tell(stage: str, done: int, total: int) -> None:
        nonlocal last
        tenth = stage, 10 * done // max(total, 1)
        if tenth != last:
            print(f"{stage}: {10 * tenth[1]} %", file=sys.stderr, flush=True)
            last = tenth

    return tell


def _is_shown() -> bool:
    kernel = sys.modules.get("IPython")
    shell = kernel.get_ipython() if kernel else None
    return sys.stderr.isatty() or type(shell).__name__ == "ZMQInteractiveShell"


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return tqdm
