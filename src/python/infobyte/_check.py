"""Arguments, which are as their annotations say, or refused by name in one sentence."""

from __future__ import annotations

import functools
import math
import operator
import os
import types
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal, TypeVar, Union, Unpack, get_args, get_origin

import numpy as np

from . import _types
from ._errors import ArgumentError, UsageError

F = TypeVar("F", bound=Callable[..., Any])

#: Words for one value of a type, and for several.
_WORDS: dict[Any, tuple[str, str]] = {
    bool: ("True or False", "True or False"), int: ("a whole number", "whole numbers"), float: ("a number", "numbers"),
    str: ("text", "texts"), os.PathLike[str]: ("a path", "paths"), np.ndarray: ("an array of numbers", "arrays"),
    Any: ("anything", "anything"),
}  # fmt: skip
_EXAMPLES = {
    "background": "(255, 255, 255)", "channels": "['normal', 'value']", "clip": "{'z': (None, 40)}", "color": "(255, 128, 0)",
    "index": "{'t': 12}", "names": "{1: 'liver'}", "opacity": "{'liver': 0.3}", "range": "(100, 300)",
    "roi": "[(0, 40), (0, 512), (0, 512)]", "section": "('z', 40)", "visible_from": "['outside']",
}  # fmt: skip
#: Arguments that may be infinite, and lists of three numbers.
_LIMITS = ("range", "t_max")
_THREE = ("background", "color", "dims", "eye", "look_at", "origin", "up")


def checked(function: F) -> F:
    """The function, which refuses arguments that are not as annotated."""

    @functools.wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        kinds = _kinds(function)
        for name, value in [*zip(function.__code__.co_varnames, given), *named.items()]:
            is_right = name not in kinds or _fits(value, kinds[name], name in _LIMITS)
            if not is_right or (name in _THREE and _is_list(value) and len(value) != 3):
                raise _wrong(name, value, kinds[name])
        return function(*given, **named)

    return call  # type: ignore[return-value]


@functools.cache
def _kinds(function: Any) -> dict[str, Any]:
    """Types of the arguments by name, those of a picture among them."""
    names = {**function.__globals__, **vars(_types), "ArrayLike": np.ndarray, "NamedView": _types.View, "Unpack": Unpack}
    kinds = {name: eval(text, names) for name, text in function.__annotations__.items() if name != "return"}
    options = kinds.pop("options", None)
    return kinds | (get_args(options)[0].__annotations__ if get_origin(options) is Unpack else {})


def _fits(value: Any, kind: Any, is_limit: bool) -> bool:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any or kind is type(None):
        return kind is Any or value is None
    if kind in (int, float, np.ndarray):
        return _is_number(value, kind, is_limit)
    if origin in (Union, types.UnionType):
        return any(_fits(value, part, is_limit) for part in parts)
    if origin is Literal:
        return isinstance(value, str | int | np.integer) and not isinstance(value, bool) and value in parts
    if origin is tuple:
        return _is_list(value) and len(value) == len(parts) and all(_fits(*of, is_limit) for of in zip(value, parts))
    if origin is Sequence:
        return _is_list(value) and all(_fits(part, parts[0], is_limit) for part in value)
    if origin is Mapping:
        items = value.items() if hasattr(value, "items") else [(None, None)]
        return all(_fits(key, parts[0], False) and _fits(part, parts[1], is_limit) for key, part in items)
    return callable(value) if origin is Callable else isinstance(value, (bool, np.bool_) if kind is bool else origin or kind)


def _is_number(value: Any, kind: Any, is_limit: bool) -> bool:
    """True for a number, at least 0 if it is whole, or an array of numbers; text and truth values are none."""
    try:
        if kind is np.ndarray:
            return np.asarray(value if hasattr(value, "dtype") else np.asarray(value, float)).dtype.kind in "iufb"
        number = operator.index(value) if kind is int else float(value)
        is_plain = np.ndim(value) == 0 and not isinstance(value, str | bool)
        return is_plain and (math.isfinite(number) or is_limit and number == number) and (kind is float or number >= 0)
    except (TypeError, ValueError, OverflowError):
        return False


def _is_list(value: Any) -> bool:
    return isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)


def _wrong(name: str, value: Any, kind: Any) -> Exception:
    text, said = repr(value), _said(kind, 0)
    if name in _THREE:
        said = said.replace("a list of", "three")
    if isinstance(value, float) and not math.isfinite(value):
        said = said.replace("a number", "a finite number")
    if "-" in text:
        said = said.replace("whole", "non-negative whole")
    text = f"{name}={text if len(text) <= 80 else text[:77] + '...'} is not"
    if isinstance(value, np.ndarray) and value.ndim:
        text = f"{name} is an array of shape {value.shape}, not"
    return ArgumentError(f"{text} {said}" + (f"; give for example {_EXAMPLES[name]}" if name in _EXAMPLES else ""))


def _said(kind: Any, many: int) -> str:
    """The words for one value of a type, or for several."""
    origin, parts = get_origin(kind), [part for part in get_args(kind) if part is not type(None)]
    if kind in _WORDS:
        return _WORDS[kind][many]
    if origin in (Union, types.UnionType, Literal):
        words = [repr(part) if origin is Literal else _said(part, many) for part in parts if part is not str or os.PathLike[str] not in parts]
        *others, last = dict.fromkeys(words)
        return f"{', '.join(others)} or {last}" if others else last
    if origin is tuple:
        of = _said(parts[0], 1) if parts[0] == parts[1] else " and ".join(_said(part, 0) for part in parts)
        return f"{('a pair', 'pairs')[many]} of {of}"
    if origin is Sequence:
        return f"a list of {_said(parts[0], 1)}"
    if origin is Mapping:
        by = f" by {_said(parts[0], 0)}" if get_origin(parts[0]) is Literal else ""
        return f"a dict of {_said(parts[1], 1)}{by}"
    return "a function" if origin is Callable else f"a {kind.__name__}"


def dumps(asked: dict[str, Any]) -> str:
    """Options as JSON, with numbers of any type."""
    import json  # 2 ms, for those who need it

    try:
        return json.dumps(asked, allow_nan=False, default=lambda value: value.tolist() if hasattr(value, "tolist") else float(value))
    except ValueError:
        raise UsageError("an option is infinite or not a number; give finite numbers") from None
