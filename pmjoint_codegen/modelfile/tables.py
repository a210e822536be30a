"""The building blocks of a model file's schema: tables with fixed keys, and value types."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field


def _as_text(value: object) -> object:
    """Take a bare number for an expression: ``sigma = 1``."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _printable(text: str) -> str:
    """Refuse line ends and control characters: these texts go into comments, tables and terminals."""
    if not text.isprintable():
        raise ValueError
    return text


Expression = Annotated[str, BeforeValidator(_as_text)]
Expressions = tuple[Expression, ...]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Numbers = tuple[Number, ...]
InputScale = Annotated[Literal["auto"] | Positive, Field(union_mode="left_to_right")]
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
