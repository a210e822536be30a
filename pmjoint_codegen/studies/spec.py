"""What a study varies, as Python writes it, in the words of the command line: one reader for both.

A number becomes the shortest text that reads back as the same number.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from pmjoint_codegen.errors import UsageError

Grid = Mapping[str, Any] | Sequence[str] | str
Samples = Mapping[str, str] | Sequence[str] | str
Gains = Mapping[str, tuple[float, float] | None] | Sequence[str] | str


def grid_texts(grid: Grid | None) -> tuple[str, ...]:
    """``--grid`` of a sweep, one text for each axis.

    Args:
        grid: ``{"x1": [0, 1, 2], "c1": "5:25:21", "saturation": ["clip", "compensator"]}``, values or a text
            by name; or texts as on the command line, ``"c1=5:25:21"``.

    Raises:
        UsageError: values that are not numbers, or no values.
    """
    if not isinstance(grid, Mapping):
        return _texts(grid, "grid")
    return tuple(f"{name}={_values(name, values)}" for name, values in grid.items())


def sample_texts(samples: Samples | None, where: str) -> tuple[str, ...]:
    """``--sample`` of a sweep and ``--perturb`` of a tuning, one text for each name.

    Args:
        samples: ``{"b0": "normal(2, 0.2)"}``; or texts as on the command line, ``"b0~normal(2,0.2)"``.
        where: name of the keyword, for a message.

    Raises:
        UsageError: something other than texts.
    """
    if not isinstance(samples, Mapping):
        return _texts(samples, where)
    return tuple(f"{name}~{_text(law, f'{where}, {name}')}" for name, law in samples.items())


def gain_texts(gains: Gains | None) -> tuple[str, ...]:
    """``--gain`` of a tuning, one text for each name.

    Args:
        gains: ``{"c": (2, 60), "e1": None}``, bounds by name; or texts, ``"c=2:60"``.

    Raises:
        UsageError: bounds that are not two numbers.
    """
    if not isinstance(gains, Mapping):
        return _texts(gains, "gains")
    return tuple(name if ends is None else f"{name}={_bounds(name, ends)}" for name, ends in gains.items())


def _texts(given: Sequence[str] | str | None, where: str) -> tuple[str, ...]:
    if given is None:
        return ()
    items: Iterable[object] = (given,) if isinstance(given, str) else given
    return tuple(_text(item, where) for item in items)


def _text(given: object, where: str) -> str:
    if not isinstance(given, str):
        raise UsageError(f"is {given!r}", where=where, remedy="allowed: a text, as on the command line")
    return given


def _values(name: str, given: object) -> str:
    if isinstance(given, str):
        return given
    items = np.atleast_1d(np.asarray(given, dtype=object)).tolist()
    return ",".join(item if isinstance(item, str) else _number(f"grid, {name}", item) for item in items)


def _number(where: str, value: object) -> str:
    try:
        return repr(float(value))  # type: ignore[arg-type]  # what float() refuses is refused below
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            f"is {value!r}", where=where, remedy='allowed: numbers, or a text such as "5:25:21"'
        ) from None


def _bounds(name: str, ends: object) -> str:
    where = f"gains, {name}"
    if not isinstance(ends, Sequence | np.ndarray) or isinstance(ends, str) or len(ends) != 2:
        raise UsageError(f"is {ends!r}", where=where, remedy="allowed: (LOW, HIGH), or None for the default")
    return f"{_number(where, ends[0])}:{_number(where, ends[1])}"
