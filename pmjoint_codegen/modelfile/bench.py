"""``[actuator]`` and ``[sensor]``: their keys, and the parameters that numbers in them become."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

from pydantic import BeforeValidator, Field

from pmjoint_codegen.chain import LAG, LIMIT, LINKS, LOWER, UPPER, Link
from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.tables import ParameterSpec, Table

if TYPE_CHECKING:
    from pmjoint_codegen.modelfile.schema import ModelSpec

_NUMBER = "the name of a parameter, or a number"


def _as_text(value: object) -> object:
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Setting = Annotated[str, BeforeValidator(_as_text)]


class ActuatorSpec(Table):
    """``[actuator]``: ``limit``, or ``lower`` and ``upper``; then what a real valve adds."""

    limit: Setting | None = Field(default=None, description=_NUMBER)
    lower: Setting | None = Field(default=None, description=_NUMBER)
    upper: Setting | None = Field(default=None, description=_NUMBER)
    rate: Setting | None = Field(default=None, description=_NUMBER)
    dead_zone: Setting | None = Field(default=None, description=_NUMBER)
    lag: Setting | None = Field(default=None, description=_NUMBER)
    delay: Setting | None = Field(default=None, description=_NUMBER)


class SensorSpec(Table):
    """``[sensor]``: from y to what the controller reads."""

    resolution: Setting | None = Field(default=None, description=_NUMBER)
    noise: Setting | None = Field(default=None, description=_NUMBER)
    seed: Setting | None = Field(default=None, description=_NUMBER)
    filter: Setting | None = Field(default=None, description=_NUMBER)


def stated(spec: ModelSpec) -> dict[Link, str]:
    """The keys that a file gives, with their text, in the order of `LINKS`."""
    found = ((link, getattr(getattr(spec, link.table), link.key)) for link in LINKS)
    return {link: text.strip() for link, text in found if text is not None}


def chain_numbers(spec: ModelSpec) -> dict[str, ParameterSpec]:
    """The parameters that numbers become: a key -> its line, as ``[parameters]`` would have it."""
    units = {"u": spec.units.u, "y": spec.units.y}
    return {
        link.key: ParameterSpec(value=number, unit=_unit(link.unit, units), about=link.about)
        for link, text in stated(spec).items()
        if (number := _number(text)) is not None
    }


def chain_names(spec: ModelSpec) -> dict[str, str]:
    """Key -> name of the parameter that it stands for."""
    return {link.key: link.key if _number(text) is not None else text for link, text in stated(spec).items()}


def check_bench(spec: ModelSpec, names: Iterable[str], where: str) -> None:
    """Check which keys a file gives, and that the names in them are parameters.

    Args:
        spec: the file.
        names: of ``[joint]`` and ``[parameters]``.
        where: file at the start of a message.

    Raises:
        ModelError: for the first key at fault.
    """
    given, known = stated(spec), list(names)
    keys = {link.key for link in given}
    numbers = chain_numbers(spec)
    for link, text in given.items():
        place = f"{where}: {link.table}.{link.key}"
        if link.key in numbers and link.key in known:
            raise ModelError(
                f"is a number, and a parameter is called {link.key} too",
                where=place,
                remedy=f'write {link.key} = "{link.key}", or give the parameter another name',
            )
        if link.key not in numbers and text not in known:
            allowed = f"allowed: {', '.join(known)}, or a number" if known else "declare it in [parameters]"
            raise ModelError(
                f"no parameter is called {quoted(text)}",
                where=place,
                remedy=allowed,
            )
    _check_limits(keys, where)
    _check_readings(keys, known, where)
    if LAG in keys and spec.joint is not None:
        raise ModelError(
            "is not simulated with [joint], whose pressures have a lag of their own",
            where=f"{where}: actuator.{LAG}",
            remedy="give joint.tau",
        )
    if {"noise", "jitter"} & keys and "seed" not in keys:
        raise ModelError(
            "is missing, though noise or jitter is given",
            where=f"{where}: sensor.seed",
            remedy="give seed = 1",
        )


def _check_readings(keys: set[str], known: Iterable[str], where: str) -> None:
    """A sensor's reading and what its filter makes of it have names of their own."""
    read = {"resolution", "noise", "filter"} & keys
    for name in sorted({*(("y_m",) if read else ()), *(("y_f",) if "filter" in keys else ())} & {*known}):
        raise ModelError(
            "already names what the sensor reads",
            where=f"{where}: parameters.{name}",
            remedy="choose another name",
        )


def _check_limits(keys: set[str], where: str) -> None:
    both = {LOWER, UPPER} & keys
    if LIMIT in keys and both:
        raise ModelError(
            f"{LIMIT} and {min(both)} are both given",
            where=f"{where}: actuator",
            remedy="allowed: limit, or lower and upper",
        )
    if LIMIT not in keys and len(both) < 2:
        missing = LIMIT if not both else UPPER if LOWER in both else LOWER
        raise ModelError(
            "is missing", where=f"{where}: actuator.{missing}", remedy="allowed: limit, or lower and upper"
        )


def _number(text: str) -> float | None:
    with suppress(ValueError):
        number = float(text)
        return number if math.isfinite(number) else None  # inf and nan are no parameter's name either
    return None


def _unit(pattern: str, units: Mapping[str, str]) -> str:
    first, slash, rest = pattern.partition("/")
    base = units.get(first, first)
    wrapped = f"({base})" if slash and not base.isalnum() else base
    return f"{wrapped}{slash}{rest}"
