"""Guards: the kernels' bounds on a step's error against the derivation in the complex plane.

A guard bounds the nonlinear part N of every rate and value on a disc: ``|N(z) - N(c)| <= rest``. With F = L
+ N and L linear, ``F(c + d) + F(c - d) - 2 F(c)`` depends on N only and is at most ``2 rest``. It is computed
at sixty digits from the SymPy expressions, at points on the rims of the discs, without CasADi or the rules of
balls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from pmjoint_codegen.check.inputs.points import describe_point
from pmjoint_codegen.check.oracles.precise import Numbers
from pmjoint_codegen.check.oracles.reference import Array, Reference, reference_of
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.emit.loop_table import loop_rows
from pmjoint_codegen.emit.table import Guard
from pmjoint_codegen.manifest import Function

SEED = 20260117
ROUNDOFF = 2.0**-53
POINTS = 2  # of each kind
RIMS = 4  # complex points for each
LIMIT = 1.0 + 1e-9  # of a swing over its bound: the bound's own rounding, at gains that multiply it


def check(subject: Subject) -> GateResult:
    """Search for a point that violates a guard's bound."""
    evaluator = subject.compiled or subject.interpreted
    random = np.random.default_rng(SEED)
    worst, values, first = 0.0, 0, None
    for guard in (row for row in loop_rows(subject.table) if isinstance(row, Guard)):
        function = subject.manifest.function(guard.name)
        reference = reference_of(subject.derivation, subject.table[guard.of])
        found = subject.points(function, POINTS, SEED)
        for batch in found:
            (bounds,) = evaluator.call(guard.name, *batch.arguments)
            for row, bound in enumerate(bounds):
                point = [array[row] for array in batch.arguments]
                swings = _swings(reference, point, random)
                finite = np.isfinite(bound)
                values += int(finite.sum())
                # Not `swings > 0`: a swing that is nan bounds nothing, and must not count as zero.
                judged, ratios = finite & ~(swings <= 0.0), np.zeros(len(bound))
                np.divide(swings, np.maximum(bound, 1e-300), out=ratios, where=judged)
                entry = int(np.argmax(ratios))
                worst = float(np.maximum(worst, ratios[entry]))
                if not ratios[entry] <= LIMIT and first is None:
                    first = _difference(function, reference, batch.arguments, row, entry, swings, bound)
    detail = f"largest swing/bound of {values} bounds on complex discs"
    return failed(detail, worst, LIMIT, first) if first else passed(detail, worst, LIMIT)


def _swings(reference: Reference, point: list[Array], random: np.random.Generator) -> Array:
    """Half the largest ``|F(c + d) + F(c - d) - 2 F(c)|`` found on the rims, less the bound's own rounding.

    That is relative to F: the bound of ``cos`` about 0 is ``cosh(radius) - 1``, rounded at 1.
    """
    numbers = Numbers()
    *centre, R, P = point
    exact = {
        symbol: numbers.exactly(float(value))
        for symbols, array in zip(reference.inputs, centre, strict=True)
        for symbol, value in zip(symbols, array, strict=True)
    }
    moving = [*reference.inputs[0], *reference.inputs[1]]
    radii = [*R.tolist(), *P.tolist()]
    middle = reference.program.run(numbers, exact)
    largest = np.zeros(len(middle))
    for angles in random.uniform(0.0, 2 * np.pi, (RIMS, len(radii))):
        swing = {
            symbol: numbers.context.mpf(radius) * numbers.context.expj(angle)
            for symbol, radius, angle in zip(moving, radii, angles.tolist(), strict=True)
        }
        sides = [_at(reference, numbers, exact, swing, sign) for sign in (1, -1)]
        found = [abs(a + b - 2 * c) / 2 for a, b, c in zip(*sides, middle, strict=True)]
        noise = [(abs(a) + abs(b) + abs(c)) * ROUNDOFF for a, b, c in zip(*sides, middle, strict=True)]
        swings = [float(value - error) for value, error in zip(found, noise, strict=True)]
        largest = np.maximum(largest, swings)
    return largest


def _at(
    reference: Reference,
    numbers: Numbers,
    centre: dict[sp.Symbol, Any],
    swing: dict[sp.Symbol, Any],
    sign: int,
) -> list[Any]:
    moved = {symbol: centre[symbol] + sign * by for symbol, by in swing.items()}
    return reference.program.run(numbers, centre | moved)


def _difference(
    function: Function,
    reference: Reference,
    arguments: tuple[Array, ...],
    row: int,
    entry: int,
    swings: Array,
    bound: Array,
) -> Difference:
    names = [name for names in reference.entries for name in names]
    return Difference(
        function.name,
        names[entry],
        describe_point(function, arguments, row),
        f"at least {swings[entry]:.6g}",
        f"{bound[entry]:.6g}",
        f"{swings[entry] - bound[entry]:.3g}",
        "0",
    )
