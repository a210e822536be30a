"""The building blocks of a model file's schema: tables with fixed keys, and value types."""

from __future__ import annotations

import math
from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field


def _as_text(value: object) -> object:
    """Take a bare number for an expression: ``sigma = 1``."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _printable(text: str) -> str:
    """Refuse line ends and control characters: these texts go into comments, tables and terminals."""
    if not text.isprintable():
        raise ValueError
    return text


def _positive(value: object) -> float:
    """Take a finite number greater than 0."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 < value < math.inf:
        raise ValueError
    return float(value)


def _scale(value: object) -> float | str:
    """Take a positive number or ``auto``."""
    return "auto" if value == "auto" else _positive(value)


def _poles(value: object) -> Poles:
    """Take one number, or a list of numbers and of pairs ``[re, im]``."""
    if not isinstance(value, tuple):
        return _positive(value)
    return tuple(_pair(entry) if isinstance(entry, tuple) else _positive(entry) for entry in value)


def _pair(value: tuple[object, ...]) -> tuple[float, float]:
    re, im = value  # ValueError if it is not two
    return _positive(re), _positive(im)


LARGEST_ORDER = 9  # of a plant: beyond it, names such as Xi111 would be ambiguous

Expression = Annotated[str, BeforeValidator(_as_text)]
Expressions = tuple[Expression, ...]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Numbers = tuple[Number, ...]
Poles: TypeAlias = "float | tuple[float | tuple[float, float], ...]"
PolesEntry = Annotated[Any, AfterValidator(_poles)]
InputScale = Annotated[Any, AfterValidator(_scale)]
Range = Annotated[tuple[Number, Number], Field(description="a list of two finite numbers, least y first")]
Line = Annotated[str, Field(max_length=400), AfterValidator(_printable)]
Unit = Annotated[str, Field(max_length=60), AfterValidator(_printable)]


class Table(BaseModel):
    """A table of a model file: no unknown keys, no silent conversions, no change once it is read."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class ParameterSpec(Table):
    """One line of ``[parameters]``."""

    value: Number = Field(description="a finite number")
    unit: Unit = Field(default="1", description='text such as "rad/s", 60 characters at most')
    about: Line = Field(default="", description="one line of text, 400 characters at most")
