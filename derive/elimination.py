"""From a plant's own states to the output-feedback form (11), or the term that stands in the way.

`eliminate` takes ``s' = f(s) + g(s) u``, ``y = h(s)`` and gives ``phi``, ``b``, ``sigma`` of (11) and the
transformation, both ways. Physics that is linear beside y goes by `observer_form`, other by `peeling`. In the
new coordinates u is multiplied by ``L_g x_i``, and each must be a parameter times one common function of y,
which is sigma. It is scaled so that ``sigma(0) = 1`` where its value there is a number other than 0, and else
left as written; only the product ``b sigma`` matters.

Where no transformation is found, the term at fault is found by leaving terms of the rates out: those that are
not a sum of states and functions of y are put back one at a time, until the transformation fails.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.dependence import settled
from pmjoint_derive.model import OutsideClassError
from pmjoint_derive.observer_form import Form, UnobservableError, observer_form
from pmjoint_derive.peeling import StuckError, peeled_form
from pmjoint_derive.physics import Physics, U, Y, split, terms_of

_RATES, _OUTPUT = "system.rates", "system.output"
_REMEDY = "leave it to the key disturbance, which the plant alone has, or measure another output"
_OF_INPUT = "measure that state as the output, or redefine the input as the whole product"


@dataclass(frozen=True)
class Elimination:
    """The output-feedback form of some physics.

    Attributes:
        form: the transformation, and phi.
        b: ``b_m ... b_0``.
        sigma: of y.
    """

    form: Form
    b: tuple[sp.Expr, ...]
    sigma: sp.Expr


def eliminate(states: tuple[sp.Symbol, ...], rates: tuple[sp.Expr, ...], output: sp.Expr) -> Elimination:
    """Transform a plant's own rates to output-feedback form.

    Args:
        states: n symbols.
        rates: n functions of states, u and parameters.
        output: y, a function of states and parameters.

    Raises:
        OutsideClassError: there is no such form, or none is found; naming the term.
    """
    physics = split(states, rates, output)
    try:
        form = _form(physics)
    except UnobservableError as hidden:
        raise _unobservable(physics, hidden) from None
    except StuckError as stuck:
        raise _blocked(physics, rates, stuck) from None
    b, sigma = _input(form.gain)
    return Elimination(form, b, sigma)


def _form(physics: Physics) -> Form:
    return observer_form(physics) or peeled_form(physics)


def _unobservable(physics: Physics, hidden: UnobservableError) -> OutsideClassError:
    names = ", ".join(map(str, hidden.states))
    remedy = f"leave {names} out of the states, or measure another output"
    if len(hidden.states) > 1:
        remedy = "use what acts on the output, such as their difference, as one state, or measure another"
    what = f"{names} cannot be told from the output {physics.output} and its derivatives"
    return OutsideClassError(_OUTPUT, what, remedy)


def _input(gain: tuple[sp.Expr, ...]) -> tuple[tuple[sp.Expr, ...], sp.Expr]:
    """``b_m ... b_0`` and sigma, from what multiplies u in each coordinate."""
    acting = list(gain)
    while acting and settled(acting[0], acting[0].free_symbols) == 0:
        del acting[0]
    if not acting:
        raise OutsideClassError(_RATES, "u does not reach the output", "write u in a rate that reaches it")
    leading = sp.factor(acting[0]) if acting[0].has(Y) else acting[0]
    constant, sigma = leading.as_independent(Y, as_Add=False)
    ratios = [sp.Integer(1)]
    for value in acting[1:]:
        ratio = settled(sp.cancel(value / leading), (Y,))
        if Y in ratio.free_symbols:
            raise OutsideClassError(
                _RATES,
                f"u acts by way of two functions of the output, {leading} and {value}",
                "write u with one common function of the output; the rest belongs to the key disturbance",
            )
        ratios.append(sp.factor(ratio))
    at_zero = sigma.subs(Y, 0)
    if at_zero.is_number and at_zero.is_finite and at_zero != 0:
        constant, sigma = constant * at_zero, sigma / at_zero
    return tuple(ratio * constant for ratio in ratios), sigma


def _blocked(physics: Physics, rates: tuple[sp.Expr, ...], stuck: StuckError) -> OutsideClassError:
    """Name the term of the rates that stands in the way."""
    place = _culprit(physics, rates)
    if place is None:
        return OutsideClassError(_RATES, stuck.what, _REMEDY)
    i, term = place
    return OutsideClassError(
        f"{_RATES}, entry {i + 1}",
        f"the term {term} {_fault(physics, term, stuck)}",
        _OF_INPUT if U in term.free_symbols else _REMEDY,
    )


def _fault(physics: Physics, term: sp.Expr, stuck: StuckError) -> str:
    """What is wrong with a term, in words."""
    hidden = [state for state in physics.hidden if state in term.free_symbols]
    names = " and ".join(map(str, hidden))
    are = "is" if len(hidden) == 1 else "are"
    if U in term.free_symbols and hidden:
        return f"multiplies u by {names}, which {are} not measured"
    if len(hidden) > 1:
        return f"is a product of {names}, which are not measured"
    if not hidden or "antiderivative" in stuck.what:
        return f"has no place in the form: {stuck.what}"
    if settled(sp.diff(term, hidden[0], 2), physics.states) != 0:
        return f"is not linear in {names}, which is not measured"
    return f"multiplies {names}, which is not measured, by a function of the output"


def _culprit(physics: Physics, rates: tuple[sp.Expr, ...]) -> tuple[int, sp.Expr] | None:
    """The first term that fails once it is there, or the only one without which all goes well."""
    parts = [terms_of(rate, physics.states) for rate in rates]
    doubtful = [(i, term) for i, terms in enumerate(parts) for term in terms if not _plain(term, physics)]
    kept = [[term for term in terms if _plain(term, physics)] for terms in parts]
    if _passes(physics, kept):
        for i, term in doubtful:
            kept[i].append(term)
            if not _passes(physics, kept):
                return i, term
    for i, term in doubtful:
        without = [[entry for entry in terms if entry is not term or j != i] for j, terms in enumerate(parts)]
        if _passes(physics, without):
            return i, term
    return doubtful[0] if doubtful else None


def _passes(physics: Physics, parts: Iterable[Iterable[sp.Expr]]) -> bool:
    try:
        _form(split(physics.states, tuple(sp.Add(*terms) for terms in parts), physics.output))
    except (StuckError, UnobservableError):
        return False
    return True


def _plain(term: sp.Expr, physics: Physics) -> bool:
    """Whether a term is a state times parameters, or a function of the output and u."""
    moving = term.free_symbols & {*physics.states, U}
    if not moving & set(physics.hidden):
        return True
    return len(moving) == 1 and not settled(sp.diff(term, *moving), physics.states).free_symbols & moving
