"""The nonlinear transformation to output-feedback form, read off the input-output equation.

At u = 0 the states follow from ``y, y', ..., y^(n-1)``, one at a time, wherever a derivative is affine in a
state that is not known yet. Then ``y^(n) = F(y, y', ..., y^(n-1))``, while the form wanted demands

    y^(n) = d^(n-1)/dt^(n-1) phi_1(y) + ... + d/dt phi_(n-1)(y) + phi_n(y) .

The first term alone holds ``y^(n-1)``, with the factor ``phi_1'(y)``. So that factor of F must be a function
of y alone; phi_1 is its antiderivative, its term is taken off, and the next factor is ``phi_2'``. A product
of derivatives that is left belongs to no term: then there is no such transformation with ``x_1 = y``. The
coordinates are ``x_1 = y``, ``x_{i+1} = x_i' - phi_i(y)`` at u = 0. See A. J. Krener, A. Isidori, Systems and
Control Letters 3 (1983) 47; D. Bestle, M. Zeitz, International Journal of Control 38 (1983) 419.
"""

from __future__ import annotations

import sympy as sp
from sympy.integrals.manualintegrate import manualintegrate

from pmjoint_derive.dependence import settled
from pmjoint_derive.observer_form import Form, UnobservableError, coordinates, tidied
from pmjoint_derive.physics import Physics, Y, lie

# what a kernel computes: an antiderivative of other functions is of no use
_COMPUTED = (sp.sin, sp.cos, sp.tan, sp.exp, sp.log, sp.tanh, sp.atan, sp.sinh, sp.cosh)


class StuckError(Exception):
    """The physics has no such transformation, or none that is found.

    Attributes:
        what: why, in one line.
    """

    def __init__(self, what: str) -> None:
        """Store the reason."""
        super().__init__(what)
        self.what = what


def peeled_form(physics: Physics) -> Form:
    """Transform physics by way of its input-output equation.

    Raises:
        StuckError: with what stands in the way.
        UnobservableError: a state does not reach the output.
    """
    order = len(physics.states)
    jets = tuple(sp.Symbol(f"y^({k})", real=True) for k in range(order))
    phi = _peeled(_highest(physics, jets), jets)
    forward = [physics.output]
    for known in phi[:-1]:
        rate = physics.along(forward[-1]) - known.xreplace({Y: physics.output})
        forward.append(tidied(rate, physics.states))
    x = coordinates(order)
    back: dict[sp.Symbol, sp.Expr] = {}
    for form, state in zip(forward, x, strict=True):
        _solve(form, state, physics.states, back)
    back = {state: tidied(back[state], x) for state in physics.states}
    gain = tuple(_of_output(physics.driven(form).xreplace(back), x) for form in forward)
    return Form(tuple(forward), back, phi, gain)


def _highest(physics: Physics, jets: tuple[sp.Symbol, ...]) -> sp.Expr:
    """F: the n-th derivative of y in terms of y and the lower ones."""
    known: dict[sp.Symbol, sp.Expr] = {}
    form = physics.output
    for jet in jets:
        _solve(form, jet, physics.states, known)
        form = physics.along(form)
    return form.xreplace(known)


def _solve(
    form: sp.Expr, value: sp.Symbol, states: tuple[sp.Symbol, ...], known: dict[sp.Symbol, sp.Expr]
) -> None:
    """Solve ``form = value`` for a state that is not known yet and that the form holds affinely."""
    unknown = [state for state in states if state not in known]
    form = settled(form.xreplace(known), unknown)
    present = [state for state in unknown if state in form.free_symbols]
    if not present:
        raise UnobservableError(unknown)
    slopes = {state: settled(sp.diff(form, state), unknown) for state in present}
    affine = [state for state in present if not slopes[state].free_symbols & set(unknown)]
    if not affine:
        raise StuckError(f"{', '.join(map(str, present))} cannot be told from y and its derivatives")
    state = min(affine, key=lambda item: len(slopes[item].free_symbols))
    found = (value - form.xreplace({state: sp.Integer(0)})) / slopes[state]
    for name, entry in known.items():
        known[name] = entry.xreplace({state: found})
    known[state] = found


def _peeled(highest: sp.Expr, jets: tuple[sp.Symbol, ...]) -> tuple[sp.Expr, ...]:
    """``phi_1 ... phi_n`` as functions of y, from F."""
    output, higher = jets[0], jets[1:]
    phi: list[sp.Expr] = []
    rest = sp.expand(highest)
    for jet in reversed(higher):
        factor = _free_of(sp.diff(rest, jet), higher)
        phi.append(_antiderivative(factor, output))
        term = phi[-1]
        for _ in range(jets.index(jet)):
            term = lie(term, jets[:-1], jets[1:])
        rest = settled(rest - term, higher)
    phi.append(_free_of(rest, higher))
    return tuple(tidied(item, (output,)).xreplace({output: Y}) for item in phi)


def _free_of(value: sp.Expr, higher: tuple[sp.Symbol, ...]) -> sp.Expr:
    """A function of y alone, without the derivatives that only seem to be in it."""
    found = settled(value, higher)
    if found.free_symbols & set(higher):
        raise StuckError("a product of states that are not measured remains in the input-output equation")
    return found


def _of_output(value: sp.Expr, x: tuple[sp.Symbol, ...]) -> sp.Expr:
    """What multiplies u, as a function of y."""
    output, *hidden = x
    found = settled(value, hidden)
    if found.free_symbols & set(hidden):
        raise StuckError("what multiplies u depends on a state that is not measured")
    return tidied(found.xreplace({output: Y}), (Y,))


def _antiderivative(factor: sp.Expr, output: sp.Symbol) -> sp.Expr:
    """An antiderivative in closed form, real on the whole line; parameters count as nonzero."""
    plain = {s: sp.Dummy(s.name, real=True, nonzero=True) for s in factor.free_symbols if s != output}
    written = sp.expand(factor.xreplace(plain))
    found = sum((_integrated(term, output) for term in sp.Add.make_args(written)), sp.Integer(0))
    if found.has(sp.nan):
        raise StuckError(f"{factor.xreplace({output: Y})} has no antiderivative that can be written down")
    new = [part for part in found.atoms(sp.log) if not part.args[0].is_positive and not written.has(part)]
    real = {part: sp.log(part.args[0] ** 2) / 2 for part in new}
    return found.xreplace(real).xreplace({dummy: symbol for symbol, dummy in plain.items()})


def _integrated(term: sp.Expr, output: sp.Symbol) -> sp.Expr:
    """An antiderivative of one summand; nan where none can be written down."""
    constant, rest = term.as_independent(output, as_Add=False)
    base, power = rest.as_base_exp()
    if isinstance(base, sp.tanh) and power.is_Integer and power > 1:
        slope = sp.diff(base.args[0], output)
        if output not in slope.free_symbols:  # SymPy's own way leads to logarithms that cancel
            lower = _integrated(base ** (power - 2), output)
            return constant * (lower - base ** (power - 1) / (slope * (power - 1)))
    found = manualintegrate(rest, output)
    if found.has(sp.Integral) and rest.is_rational_function(output):
        found = sp.integrate(rest, output)
    functions = [part for part in found.atoms(sp.Function) if not isinstance(part, _COMPUTED)]
    if found.has(sp.Integral, sp.Piecewise, sp.RootSum, sp.I) or functions:
        return sp.nan
    return constant * found
