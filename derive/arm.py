"""Moment arms: how a muscle's length follows the joint's angle.

By virtual work the torque of a muscle on the joint is its force times ``r(theta) = -dl/dtheta``, so a moment
arm fixes the contraction too: ``eps = eps0 +- (integral of r from 0 to theta) / l0``, with the sign of the
side on which the muscle pulls. For the pulley of (3), r is constant and the integral is r theta.
"""

from __future__ import annotations

import sympy as sp
from sympy.integrals.manualintegrate import manualintegrate

from pmjoint_derive.model import OutsideClassError
from pmjoint_derive.muscle import ANGLE

_KNOWN = (sp.sin, sp.cos, sp.tan, sp.exp, sp.log, sp.sinh, sp.cosh, sp.tanh, sp.atan, sp.Abs)  # as in a file
_DIGITS = 30
_PLACES = (sp.Rational(3, 7), sp.Rational(-5, 11), sp.Rational(2, 13))  # where the integral is tested


def travel(arm: sp.Expr, key: str) -> sp.Expr:
    """Integral of a moment arm from 0 to theta, in closed form.

    The rules of calculus by hand are tried and no others: they answer at once, while general algorithms may
    run for minutes.

    Args:
        arm: in m, a smooth function of theta and parameters.
        key: its place in the model file, for the message.

    Raises:
        OutsideClassError: where they find no closed form that holds for all parameters other than 0.
    """
    if ANGLE not in arm.free_symbols:
        return arm * ANGLE
    parameters = sorted(arm.free_symbols - {ANGLE}, key=str)
    generic = {symbol: sp.Symbol(symbol.name, real=True, nonzero=True) for symbol in parameters}
    found = manualintegrate(arm.xreplace(generic), ANGLE).doit(integrals=False)
    found = found.xreplace({value: symbol for symbol, value in generic.items()})
    if not _is_written(found) or not _is_integral(found, arm, parameters):
        raise OutsideClassError(
            key,
            f"the integral of {arm} over theta, which the contraction needs, is not known in closed form",
            "give an arm whose integral is, such as a polynomial of theta",
        )
    return found - found.xreplace({ANGLE: sp.Integer(0)})


def _is_written(found: sp.Expr) -> bool:
    """Whether a model file could hold it: no cases, no special functions, nothing complex."""
    if found.has(sp.Integral, sp.Piecewise, sp.I):
        return False
    return all(isinstance(part, _KNOWN) for part in found.atoms(sp.Function))


def _is_integral(found: sp.Expr, arm: sp.Expr, parameters: list[sp.Symbol]) -> bool:
    """Whether the derivative is the arm, at a few places where both have a real value.

    The parameters take distinct fixed values there: an identity holds for any.
    """
    difference = sp.diff(found, ANGLE) - arm
    values = {symbol: 1 + sp.Rational(i, 5) for i, symbol in enumerate(parameters)}
    errors = [abs(difference.evalf(_DIGITS, subs={**values, ANGLE: place})) for place in _PLACES]
    numbers = [error for error in errors if error.is_number and error.is_finite]
    return bool(numbers) and all(error < sp.Float(10) ** (-_DIGITS // 2) for error in numbers)
