"""Conditions of the plant class on a model's numbers: finite, b_m and sigma not 0, stable zero dynamics.

Checked at the file's parameter values and initial state; `pmjoint_codegen.values` checks gains and limits.
"""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.points import NotFiniteError, Point, value_at
from pmjoint_codegen.modelfile.zeros import find_zero
from pmjoint_codegen.values import is_hurwitz, roots_text
from pmjoint_derive import Model, Plant, real_symbol


def check_model(model: Model, where: str, table: str) -> None:
    """Check a model at its initial state.

    Args:
        model: input of the derivation.
        where: file at the start of a message.
        table: that describes the plant: ``plant``, ``joint`` or ``system``.

    Raises:
        ModelError: an expression without finite value, ``b_m = 0``, ``sigma = 0``, unstable zero dynamics.
    """
    values: dict[sp.Symbol, float] = {item.symbol: item.value for item in model.parameters}
    for constant in model.constants:
        key = f"{where}: {table}, coefficient {constant.name}"
        values[constant.symbol] = _finite(constant.expression, values, key)
    b = [_finite(entry, values, f"{where}: {key}") for key, entry in _input(model, table)]
    _check_input(b, table, where)
    start = values | _initial_point(model, values)
    for reported in model.reported:
        key = f"{where}: {table}, {reported.name}"
        start[reported.symbol] = _finite(reported.expression, start, key)
    for key, expression in _entries(model.plant, "system" if table == "system" else "plant"):
        _finite(expression, start, f"{where}: {key}")
    _check_reference(model, start, f"{where}: simulation.reference")
    if value_at(model.plant.sigma, start) == 0:
        raise ModelError(
            "sigma is 0 at the initial state, so no input acts there",
            where=f"{where}: {_sigma_key(table)}",
            remedy="allowed: a function of y that is never 0",
        )
    _check_range(model, values, where, _sigma_key(table))


def _sigma_key(table: str) -> str:
    return "system.rates, factor of u" if table == "system" else "plant.sigma"


def _check_range(model: Model, values: Point, where: str, key: str) -> None:
    """Check that sigma is not 0 anywhere in the design's range."""
    if model.y_range is None:
        return
    low, high = model.y_range
    place = find_zero(model.plant.sigma, real_symbol("y"), values, low, high)
    if place is not None:
        raise ModelError(
            f"sigma vanishes, or is not finite, near y = {place:.6g}, within the range {low:g} to {high:g}",
            where=f"{where}: {key}",
            remedy="allowed: a sigma that is never 0 there, or a smaller range",
        )


def _check_reference(model: Model, start: Point, where: str) -> None:
    """Check Assumption 1 on the reference at the start of a run: the law needs its derivatives up to rho.

    A Taylor step needs all of them, and a power that is not whole has not all of them where its base is 0.
    """
    if model.segment:  # data are checked as they are read
        return
    t = real_symbol("t")
    for order in range(model.plant.rho + 1):
        value = sp.diff(model.reference, t, order)
        _finite(value, start, f"{where}, derivative {order}" if order else where)
    for power in sorted(model.reference.atoms(sp.Pow), key=str):
        if t in power.base.free_symbols and not power.exp.is_Integer and not value_at(power.base, start):
            raise ModelError(
                f"{quoted(str(power))} has derivatives that are not finite at t = 0; a Taylor step needs all",
                where=where,
                remedy="allowed: whole powers of what is 0 there",
            )


def _initial_point(model: Model, values: Point) -> dict[sp.Symbol, float]:
    """The start of a run: t = 0, x from x0, y = x1, no input yet."""
    x0 = model.simulation.x0
    if model.start is None:
        states = {real_symbol(f"x{i}"): value for i, value in enumerate(x0, start=1)}
    else:
        given = {item.symbol: 0.0 for item in model.start.variables}
        given |= dict(zip(given, x0, strict=False))
        point = {**values, **given}
        states = {state: value_at(form, point) for state, form in model.start.states.items()}
    at_rest = {item.symbol: 0.0 for item in model.actuator}
    return states | at_rest | {real_symbol("y"): states[real_symbol("x1")], real_symbol("t"): 0.0}


def _entries(plant: Plant, table: str) -> Iterable[tuple[str, sp.Expr]]:
    """Every expression of a plant with its key."""
    columns = {"phi": plant.phi, "theta": plant.theta, "b": plant.b, "disturbance": plant.disturbance}
    columns |= {f"Phi, entry {i}": row for i, row in enumerate(plant.Phi, start=1)}
    for key, column in columns.items():
        yield from ((f"{table}.{key}, entry {i}", entry) for i, entry in enumerate(column, start=1))
    yield f"{table}.sigma", plant.sigma


def _finite(expression: sp.Expr, point: Point, where: str) -> float:
    """Give an expression's value; refuse one that has none."""
    try:
        return value_at(expression, point)
    except NotFiniteError:
        raise ModelError(
            f"{quoted(str(expression))} has no finite real value at the given parameters, t = 0 and x = x0",
            where=where,
            remedy="check divisions, roots and logarithms",
        ) from None


def _input(model: Model, table: str) -> Iterable[tuple[str, sp.Expr]]:
    """The input coefficients ``b_m ... b_0``, each with its key; a joint has (8) for them."""
    yield from ((f"{table}.b, entry {i}", entry) for i, entry in enumerate(model.plant.b, start=1))


def _check_input(b: list[float], table: str, where: str) -> None:
    """Check the input polynomial ``b_m s^m + ... + b_0``."""
    if b[0] == 0 and table == "joint":
        raise ModelError(
            "b0, the input gain at theta = 0, is 0 at the given parameters, so no input acts",
            where=f"{where}: joint",
            remedy="allowed: muscles with another gain there; of (2), C1*eps0**2 + C2*eps0 + C3 other than 0",
        )
    own = table == "system"
    if b[0] == 0:
        raise ModelError(
            "b_m is 0 at the given parameters, so no input acts",
            where=f"{where}: system" if own else f"{where}: plant.b, entry 1",
            remedy="allowed: a value other than 0; without that entry, the relative degree is higher by 1",
        )
    if not is_hurwitz(b):
        raise ModelError(
            f"the zero dynamics are unstable: b_m s^m + ... + b_0 has the roots {roots_text(b)}",
            where=f"{where}: system" if own else f"{where}: plant.b",
            remedy="allowed: roots with negative real parts only" + "; measure another output" * own,
        )
