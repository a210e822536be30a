"""From a table of a model file, or a Python object, to a `Command`; every refusal is one line."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import PmjointError, UsageError, did_you_mean, quoted
from pmjoint_codegen.reference.columns import factor, read_table
from pmjoint_codegen.reference.command import KINDS, Command

Array = npt.NDArray[np.float64]

MOST_POINTS: Final = 10_000_000
_COMMON: Final = ("unit", "filter")
_OF_FILE: Final = ("time", "column")
_CORNERS: Final = ("low", "high", "start", "rise", "hold", "fall", "rest", "repeat")
_TIMES: Final = ("rise", "hold", "fall", "rest")


def read_command(spec: Mapping[str, Any], *, folder: Path, unit: str, where: str) -> Command:
    """Read a reference that is a table of a model file.

    One of its keys says what it is: ``steps``, ``ramps`` or ``table``, each ``[[t, y], ...]``; ``trapezoid``,
    a table of ``low``, ``high``, ``start``, ``rise``, ``hold``, ``fall``, ``rest``, ``repeat``; or ``file``,
    with ``time`` and ``column``. ``unit`` and ``filter`` are optional.

    Args:
        spec: the table.
        folder: for relative file names.
        unit: of y.
        where: the place in messages.

    Raises:
        UsageError: for anything else, or numbers that are not finite or times that do not ascend.
    """
    kinds = [key for key in KINDS if key in spec]
    if len(kinds) != 1:
        found = f"has {' and '.join(kinds)}" if kinds else "has none of the keys that say what it is"
        raise UsageError(found, where=where, remedy=f"allowed: one of {', '.join(KINDS)}")
    kind = kinds[0]
    allowed = (kind, *_COMMON, *(_OF_FILE if kind == "file" else ()))
    _check_keys(spec, allowed, where)
    a = None if spec.get("filter") is None else _positive(spec["filter"], f"{where}.filter")
    origin: dict[str, Any] = {}
    if kind == "file":
        t, y, origin = _from_file(spec, folder, where)
    elif kind == "trapezoid":
        t, y = _corners(spec[kind], f"{where}.trapezoid")
    else:
        t, y = _points(spec[kind], f"{where}.{kind}")
    given = spec.get("unit")
    if given is not None:
        if not isinstance(given, str):
            raise UsageError(
                f"is {quoted(given)}", where=f"{where}.unit", remedy='allowed: text such as "deg"'
            )
        y = y * factor(given, unit, f"{where}.unit")
        origin["unit"] = given
    return Command(kind, tuple(t.tolist()), tuple(y.tolist()), a, origin)


def command_of(given: object, *, instants: Callable[[], Array], unit: str) -> Command:
    """Read a reference given in Python.

    Args:
        given: a table as in a model file, whose points may be arrays; (t, y); an array, shape (points, 2), of
            both, or shape (points,), one value at every output instant; or a function of t, taken at the
            output instants.
        instants: gives the output instants of the run, s.
        unit: of y.

    Raises:
        UsageError: for anything else, as `read_command`.
    """
    where = "reference"
    if isinstance(given, Command):
        return given
    if isinstance(given, Mapping):
        plain = {
            key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in given.items()
        }
        return read_command(plain, folder=Path(), unit=unit, where=where)
    if callable(given):
        times = instants()
        t, y = _checked(times, _numbers([given(t) for t in times.tolist()], where), where)
        return Command("table", tuple(t.tolist()), tuple(y.tolist()), None, {"function": _name(given)})
    if isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1:
        t, y = _checked(_numbers(given[0], where), _numbers(given[1], where), where)
    else:
        values = _numbers(given, where)
        if values.ndim == 1:
            t, y = _checked(instants(), values, where)
        else:
            t, y = _points(values, where)
    return Command("table", tuple(t.tolist()), tuple(y.tolist()), None, {})


def _name(function: object) -> str:
    return str(getattr(function, "__name__", type(function).__name__))


def _check_keys(spec: Mapping[str, Any], allowed: Sequence[str], where: str) -> None:
    for key in spec:
        if key not in allowed:
            hint = did_you_mean(str(key), allowed, str)
            raise UsageError(
                f"has no key {quoted(key)}", where=where, remedy=f"{hint}allowed: {', '.join(allowed)}"
            )


def _positive(value: object, where: str) -> float:
    number = _number(value, where)
    if not number > 0:
        raise UsageError(f"is {number:g}", where=where, remedy="allowed: a number greater than 0, in 1/s")
    return number


def _number(value: object, where: str) -> float:
    good = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not good or not math.isfinite(value):  # type: ignore[arg-type]
        raise UsageError(f"is {quoted(value)}", where=where, remedy="allowed: a finite number")
    return float(value)  # type: ignore[arg-type]


def _numbers(values: object, where: str) -> Array:
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if not found.size or found.ndim > 2:
        raise UsageError(
            f"is {quoted(values)}",
            where=where,
            remedy="allowed: numbers, as (t, y), an array of both, a function of t, or a table such as"
            ' {"steps": [[0, 0], [1, 0.5]], "filter": 10}',
        )
    return found


def _points(values: object, where: str) -> tuple[Array, Array]:
    """Points ``[[t, y], ...]``."""
    try:
        table = np.array([[float(t), float(y)] for t, y in values])  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        table = np.empty((0, 2))
    if not len(table):
        raise UsageError(f"is {quoted(values)}", where=where, remedy="allowed: [[t, y], ...], t ascending")
    return _checked(table[:, 0], table[:, 1], where)


def _checked(t: Array, y: Array, where: str) -> tuple[Array, Array]:
    if t.shape != y.shape or t.ndim != 1:
        raise UsageError(
            f"has {t.size} times and {y.size} values", where=where, remedy="allowed: one value for each time"
        )
    if len(t) > MOST_POINTS:
        raise UsageError(f"has {len(t)} points", where=where, remedy=f"allowed: at most {MOST_POINTS}")
    good = np.isfinite(t) & np.isfinite(y)
    if not np.all(good):
        at = int(np.argmin(good))
        raise UsageError(
            f"point {at + 1} is ({t[at]:g}, {y[at]:g})", where=where, remedy="allowed: finite numbers"
        )
    if np.any(np.diff(t) <= 0):
        at = int(np.argmax(np.diff(t) <= 0)) + 1
        raise UsageError(
            f"point {at + 1}: t = {t[at]:g} does not follow {t[at - 1]:g}",
            where=where,
            remedy="allowed: ascending times",
        )
    return t, y


def _corners(spec: object, where: str) -> tuple[Array, Array]:
    """The corners of trapezoids: rise from low to high, hold, fall, rest, and the same again."""
    if not isinstance(spec, Mapping):
        raise UsageError(
            f"is {quoted(spec)}",
            where=where,
            remedy="allowed: a table such as { high = 0.5, rise = 1, hold = 2 }",
        )
    _check_keys(spec, _CORNERS, where)
    for key in ("high", "rise"):
        if key not in spec:
            raise UsageError(f"has no {key}", where=where, remedy="allowed: high in y's unit, rise in s")
    values = {key: _number(spec.get(key, 0.0), f"{where}.{key}") for key in _CORNERS if key != "repeat"}
    values["fall"] = values["fall"] if "fall" in spec else values["rise"]
    repeat = spec.get("repeat", 1)
    if not isinstance(repeat, int) or isinstance(repeat, bool) or not 1 <= repeat <= MOST_POINTS // 4:
        raise UsageError(
            f"is {quoted(repeat)}", where=f"{where}.repeat", remedy="allowed: a whole number from 1"
        )
    for key in _TIMES:
        if values[key] < 0 or (values[key] == 0 and key in ("rise", "fall")):
            raise UsageError(
                f"is {values[key]:g}", where=f"{where}.{key}", remedy="allowed: seconds greater than 0"
            )
    low, high = values["low"], values["high"]
    lengths = np.array([values[key] for key in _TIMES])
    ends = np.cumsum(np.tile(lengths, repeat)[:-1])
    t = values["start"] + np.concatenate([[0.0], ends])
    y = np.tile([low, high, high, low], repeat)
    keep = np.concatenate([[True], np.diff(t) > 0])  # without a hold or a rest, two corners are one
    return _checked(t[keep], y[keep], where)


def _from_file(spec: Mapping[str, Any], folder: Path, where: str) -> tuple[Array, Array, dict[str, Any]]:
    name = spec["file"]
    for key in ("file", *_OF_FILE):
        if key in spec and not (isinstance(spec[key], str) and spec[key]):
            raise UsageError(f"is {quoted(spec[key])}", where=f"{where}.{key}", remedy="allowed: a name")
    try:
        table = read_table(folder / name)
        time = spec.get("time", table.names[0])
        column = spec.get("column", next((item for item in table.names if item != time), time))
        t, y = table.instants(time), table.numbers(column)
    except PmjointError as error:
        raise type(error)(error.what, where=f"{where}: {error.where}", remedy=error.remedy) from None
    _checked(t, y, where)
    return t, y, {"file": Path(name).name, "time": time, "column": column, "file_sha256": table.sha256}
