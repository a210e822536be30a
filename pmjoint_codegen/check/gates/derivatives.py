"""Derivatives: emitted partial derivatives against algorithmic differentiation of emitted virtual controls.

SymPy differentiated the expressions; CasADi differentiates its own instruction list of ``law``. The two share
no code. Both sides have a running error bound, and must differ by at most the sum of the two. A derivative
that the manifest does not name must be zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.inputs.points import describe_point
from pmjoint_codegen.check.oracles.error_bound import walk
from pmjoint_codegen.check.oracles.rounding import Bounded
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.emit.tape import tapes_of
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import Tape

Array = npt.NDArray[np.float64]

SEED = 20200530
POINTS = 200  # of each kind
ROUNDOFF = 2.0**-53
OPERATIONS = 16  # a slope and its product, to be on the safe side


def check(subject: Subject) -> GateResult:
    """Compare every partial derivative of every virtual control."""
    if subject.compiled is None:
        return not_run("no C compiler")
    if subject.manifest.rho == 1:
        return passed("a plant of relative degree one has no virtual controls", 0, 0)
    function = subject.manifest.function("partials")
    found = subject.points(function, POINTS, SEED)
    arguments = tuple(
        np.concatenate(arrays) for arrays in zip(*(batch.arguments for batch in found), strict=True)
    )
    (results,) = subject.compiled.call("partials", *arguments)
    return compare(subject, arguments, results)


def compare(subject: Subject, arguments: Sequence[Array], results: Array) -> GateResult:
    """Check the results of ``partials`` against derivatives of ``law``.

    Args:
        subject: the model.
        arguments: of ``partials``, shape (points, size) each.
        results: of ``partials``, shape (points, number of partials).
    """
    (jacobian,) = walk(jacobian_tape(subject.tapes["law"]), arguments)
    (emitted,) = walk(subject.tapes["partials"], arguments)
    names = all_names(subject)
    places = {name: i for i, name in enumerate(subject.manifest.partials)}
    stray = sorted(set(places) - set(names))
    if stray:
        return failed(f"model.json names derivatives that do not exist: {', '.join(stray)}")
    worst, first = 0.0, None
    by_state = _slopes(subject, arguments)
    for column, name in enumerate(names):
        mine = _along(_column(results, emitted, places.get(name)), by_state[column % len(by_state)])
        error, bound = np.abs(mine.value - jacobian.value[:, column]), mine.error + jacobian.error[:, column]
        ratio = np.divide(error, bound, out=np.where(error > 0, np.inf, 0.0), where=bound > 0)
        ratio = np.where(np.isfinite(jacobian.error[:, column]), ratio, 0.0)  # where `law` itself overflows
        row = int(np.argmax(ratio))
        worst = max(worst, float(ratio[row]))
        if not ratio[row] <= 1 and first is None:
            point = describe_point(subject.manifest.function("partials"), tuple(arguments), row)
            expected, found = repr(float(jacobian.value[row, column])), repr(float(mine.value[row]))
            first = Difference(
                "partials", name, point, expected, found, f"{error[row]:.3g}", f"{bound[row]:.3g}"
            )
    counts = f"{len(names)} derivatives, {len(places)} of them not zero, at {len(results)} points"
    detail = f"largest difference/bound of {counts}"
    return failed(detail, worst, 1, first) if first else passed(detail, worst, 1)


def jacobian_tape(law: Tape) -> Tape:
    """Derivatives of ``alpha`` by y, s and y_r, row by row, as a separate instruction list."""
    function = rebuild(law)
    inputs = [ca.SX.sym(function.name_in(i), function.size1_in(i)) for i in range(function.n_in())]
    alpha = function.call(inputs, True, False)[function.index_out("alpha")]
    by = ca.vertcat(*(inputs[function.index_in(label)] for label in ("y", "s", "y_r")))
    rows = ca.densify(ca.vec(ca.jacobian(alpha, by).T))
    (tape,) = tapes_of([ca.Function("law_jacobian", inputs, [rows])])
    return tape


def all_names(subject: Subject) -> list[str]:
    """Names of every conceivable partial derivative, in the order of :func:`jacobian_tape`."""
    s = subject.derivation.signals
    return [f"d{alpha.name}_d{by.name}" for alpha in s.alpha for by in s.measurable]


def _slopes(subject: Subject, arguments: Sequence[Array]) -> list[Array | None]:
    """What each measurable moves by with its state: None of one that is a state itself.

    The states of estimates with a range are their logits, ``ln(q/(1 - q))`` with q the place in the range,
    less those of their guesses; by these the tape of `law` is differentiated.
    """
    manifest, s = subject.manifest, subject.derivation.signals
    labels = [label for label, _ in manifest.function("partials").inputs]
    state, p = (arguments[labels.index(label)] for label in ("s", "p"))
    values = dict(zip(manifest.parameter_names, p.T, strict=False))  # a segment's follow
    found: list[Array | None] = [None]
    for place, (symbol, measured) in enumerate(zip(s.controller_state, s.had, strict=True)):
        if symbol == measured:
            found.append(None)
            continue
        name = measured.name.removesuffix("_hat")
        low, high, guess = (values[f"{name}_{which}"] for which in ("low", "high", "guess"))
        q = 1 / (1 + (high - guess) / (guess - low) * np.exp(-state[:, place]))
        found.append((high - low) * q * (1 - q))
    return [*found, *(None for _ in s.y_r)]


def _along(derivative: Bounded, slope: Array | None) -> Bounded:
    """A derivative by a measurable as one by its state."""
    if slope is None:
        return derivative
    value = derivative.value * slope
    return Bounded(value, derivative.error * np.abs(slope) + OPERATIONS * ROUNDOFF * np.abs(value))


def _column(results: Array, emitted: Bounded, place: int | None) -> Bounded:
    if place is None:
        return Bounded(np.zeros(len(results)), np.zeros(len(results)))
    return Bounded(results[:, place], emitted.error[:, place])
