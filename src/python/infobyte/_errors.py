"""Exceptions. What the system refused is also an `OSError` of its kind, such as `FileNotFoundError`."""

from __future__ import annotations

import os


class InfobyteError(Exception):
    """The base of every exception of this package."""


class UsageError(InfobyteError, ValueError):
    """The call makes no sense, whatever the input. One for an argument that is not as annotated is a `TypeError`, too."""


class ArgumentError(UsageError, TypeError):
    """An argument is not as annotated."""

    __module__ = "infobyte"


class InputError(InfobyteError, ValueError):
    """The input cannot be used: it is damaged, empty, changed while it was in use, or of another kind."""


class BudgetError(InfobyteError, MemoryError):
    """`memory` is too small. `minimum_bytes` is the least that works, in bytes, or `None` if that is not known."""

    minimum_bytes: int | None = None


_SYSTEM: dict[type, type] = {}


def _system(base: type) -> type:
    """The class that is both an `InfobyteError` and `base`, a kind of `OSError`."""
    if base not in _SYSTEM:
        plain = {"__str__": lambda self: self.strerror, "__module__": "infobyte", "__doc__": base.__doc__}
        _SYSTEM[base] = type(base.__name__, (InfobyteError, base), plain)
    return _SYSTEM[base]


def make(
    kind: str,
    sentence: str,
    errno: int | None = None,
    path: str | os.PathLike[str] | None = None,
    minimum_bytes: int | None = None,
) -> Exception:
    """The exception of an error of the native module."""
    if kind == "budget":
        error = BudgetError(sentence)
        error.minimum_bytes = minimum_bytes
        return error
    if kind == "system" or (kind == "input" and errno is not None):
        number = errno or 0
        cls = _system(type(OSError(number, sentence)))
        return cls(number, sentence, None if path is None else os.fspath(path))
    return {"usage": UsageError, "input": InputError}.get(kind, InfobyteError)(sentence)
