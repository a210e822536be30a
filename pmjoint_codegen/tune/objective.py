"""The objective: a weighted sum of metrics, read from a small language of numbers, names, ``+ - * / ( )``."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pmjoint_codegen.errors import UsageError, quoted
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.metrics import REPORTED

_LONGEST: Final = 200  # characters: such a sum has five terms
_CONSTANT: Final = ""  # key of the part of a linear form that multiplies no metric

Form = Mapping[str, float]


@dataclass(frozen=True)
class Objective:
    """The quantity to minimise.

    Attributes:
        text: as given.
        weights: (metric, weight > 0), in the metrics' units.
    """

    text: str
    weights: tuple[tuple[str, float], ...]

    def __call__(self, metrics: Array) -> Array:
        """The objective of some runs, shape (...), from their metrics, shape (..., columns).

        NaN where a metric is undefined. A run that has not settled counts with its horizon: the search needs
        a number.
        """
        total = np.zeros(metrics.shape[:-1])
        for name, weight in self.weights:
            total += weight * metrics[..., REPORTED[name]]
        return total


def read_objective(text: str) -> Objective:
    """Read an objective.

    Args:
        text: linear in metrics, each with a positive weight, such as ``ise + 0.01*max_abs_v``.

    Raises:
        UsageError: for anything else.
    """
    try:
        if len(text) > _LONGEST:
            raise ValueError(f"is longer than {_LONGEST} characters")
        form = _form(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError, ZeroDivisionError, OverflowError):
        raise _refused(text, "cannot be read") from None
    except ValueError as error:
        raise _refused(text, str(error)) from None
    weights = tuple((name, form[name]) for name in REPORTED if name in form)
    if form.get(_CONSTANT) or not weights:
        raise _refused(text, "is not a sum of metrics only")
    if not all(0 < weight < math.inf for _, weight in weights):
        raise _refused(text, "rewards a metric for being large")
    return Objective(text.strip(), weights)


def _refused(text: str, what: str) -> UsageError:
    return UsageError(
        f"{quoted(text)} {what}",
        where="--objective",
        remedy=f"allowed: a sum of {', '.join(REPORTED)} with positive weights, such as ise + 0.01*max_abs_v",
    )


def _form(node: ast.expr) -> Form:
    """The linear form of an expression: metric -> weight."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return {_CONSTANT: float(number)}
        case ast.Name(id=name) if name in REPORTED:
            return {name: 1.0}
        case ast.Name(id=name):
            raise ValueError(f"names {name!r}, which is not a metric")
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return _scaled(_form(inner), -1.0)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _sum(_form(left), _form(right))
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            return _sum(_form(left), _scaled(_form(right), -1.0))
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _product(_form(left), _form(right))
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _scaled(_form(left), 1.0 / _number(_form(right)))
    raise ValueError("is not a weighted sum")


def _sum(one: Form, other: Form) -> Form:
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in {**one, **other}}


def _scaled(form: Form, factor: float) -> Form:
    return {name: factor * weight for name, weight in form.items()}


def _product(one: Form, other: Form) -> Form:
    return _scaled(other, _number(one)) if set(one) == {_CONSTANT} else _scaled(one, _number(other))


def _number(form: Form) -> float:
    if set(form) != {_CONSTANT}:
        raise ValueError("is not linear")
    return form[_CONSTANT]
