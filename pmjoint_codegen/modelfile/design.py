"""The design of a model file in numbers: what its keys come to at the file's parameters.

``bandwidth`` w, in 1/s, stands for gains that the file leaves out, by one rule:

* c_i = w, and all n poles of the filters at -w;
* e_1 = 0.1, and e_i = 0.05 w (b_m/kappa)^2/S_i^2 from step 2 on, with S_2 = w and S_{i+1} = w S_i + k_i: the
  size of s_i = d alpha_{i-1}/dy of a chain of integrators with b_m = 1. So the damping against the
  estimation error is a twentieth of w, whatever the order and the unit of u;
* ck_i = w/5 and, where no pole of the plant without input is unstable, at least 1.75 times the geometric
  mean of its poles (for n = 2: sqrt(-d1)): there a compensator that forgets faster loses no start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.points import NotFiniteError, Point, value_at
from pmjoint_codegen.modelfile.schema import DesignSpec, ModelSpec
from pmjoint_codegen.modelfile.tables import Poles
from pmjoint_codegen.values import ADRC, BRAKING, MATCHED, from_si, to_si
from pmjoint_derive import Gains, Parameter, Plant, real_symbol
from pmjoint_derive.units import Measures

SHARE = 0.05  # of w: the damping e_i s_i^2 against the estimation error
FIRST = 0.1  # e_1, 1/s
FORGETTING = 0.2  # ck/w
MARGINAL = 1e-6  # real part over size of a pole that counts as one on the imaginary axis
OF_PLANT = 1.75  # ck over the plant's own rate

DEFAULT_BRAKING: Final = 0.5  # of the limit: the reference needs the rest


def gains_of(
    spec: ModelSpec,
    physics: Mapping[str, Any],
    parameters: tuple[Parameter, ...],
    measures: Measures,
    where: str,
) -> Gains:
    """The gains as numbers.

    Args:
        spec: a validated model file.
        physics: ``plant`` and, for a joint, ``constants`` of the model.
        parameters: of the model, with their values.
        measures: units of y and u; the file's input_scale is that of SI units.
        where: file at the start of a message.

    Raises:
        ModelError: ``input_scale = "auto"`` or ``bandwidth`` where b_m has no finite value other than 0.
    """
    design, plant = spec.design, physics["plant"]
    if design.law == ADRC:
        assert design.c and design.observer  # `validate` demands them
        matched = design.start == MATCHED
        return Gains(design.c, (), (), (), compensator=False, matched=matched, observer=design.observer)
    scale = to_si(1.0 if design.input_scale == "auto" else float(design.input_scale), measures.input_scale)
    k = design.k or (polynomial(design.poles, plant.order) if design.poles is not None else None)
    brakes = design.saturation == BRAKING and plant.rho == 2  # for one state, it is (23)
    braking = (DEFAULT_BRAKING if design.braking is None else design.braking) if brakes else None
    others: dict[str, Any] = {
        "compensator": design.compensated,
        "matched": design.start == MATCHED,
        "braking": braking,
    }
    if design.input_scale != "auto" and design.bandwidth is None:
        assert design.c and design.e and design.ck and k  # `validate` demands them
        return Gains(design.c, design.e, design.ck, k, input_scale=scale, **others)
    point = _point(physics, parameters)
    b_m = _size(plant, point)
    if not b_m and spec.joint is not None:  # the checks of a joint name the constant at fault
        ones = (1.0,) * plant.rho
        given = (design.c or ones, design.e or ones, design.ck or ones, k or polynomial(1.0, plant.order))
        return Gains(*given, **others)
    if not b_m:
        raise _unscaled(design, where)
    if design.input_scale == "auto":
        scale = b_m
    w = design.bandwidth
    if w is None:
        assert design.c and design.e and design.ck and k
        return Gains(design.c, design.e, design.ck, k, input_scale=scale, **others)
    k = k or polynomial(w, plant.order)
    start = point | _output_at_start(physics, point, spec.simulation.x0)
    return Gains(
        design.c or (w,) * plant.rho,
        design.e or _against_estimation(w, plant.rho, k, b_m / scale),
        design.ck or (_rounded(max(FORGETTING * w, OF_PLANT * own_rate(plant, start))),) * plant.rho,
        k,
        input_scale=scale,
        **others,
    )


def chosen(design: DesignSpec, gains: Gains, measures: Measures) -> tuple[str, ...]:
    """What keys that stand for gains came to: one line, or none where the file gives every gain."""
    made = {
        kind: values for kind, values in gains.by_kind.items() if values and getattr(design, kind) is None
    }
    parts = [f"{kind} = {list(values)}" for kind, values in made.items()]
    if design.input_scale == "auto":
        parts.append(f"input_scale = {from_si(gains.input_scale, measures.input_scale):.6g}")
    keys = {"bandwidth": design.bandwidth, "poles": design.poles}
    given = [f"{key} {value}" for key, value in keys.items() if value is not None]
    source = f"of {', '.join(given)}" if given else "of the model"
    return (f"design {source}: {', '.join(parts)}",) if parts else ()


def polynomial(poles: Poles, n: int) -> tuple[float, ...]:
    """K of the filters: ``s^n + k_1 s^(n-1) + ... + k_n`` has these poles, computed exactly, rounded once.

    Args:
        poles: p > 0 for the pole -p, ``(re, im)`` for the pair -re +- i im; one number for all n.
        n: order.
    """
    entries = (poles,) * n if isinstance(poles, float) else poles
    result = [Fraction(1)]
    for entry in entries:
        if isinstance(entry, tuple):
            re, im = (Fraction(repr(part)) for part in entry)
            factor = [Fraction(1), 2 * re, re * re + im * im]
        else:
            factor = [Fraction(1), Fraction(repr(entry))]
        result = _product(result, factor)
    return tuple(float(value) for value in result[1:])


def own_rate(plant: Plant, point: Point) -> float:
    """Geometric mean of the poles of the plant at the initial y, 1/s; 0 where one of them is unstable."""
    y = real_symbol("y")
    try:
        slopes = [value_at(sp.diff(entry, y), point) for entry in plant.drift]
    except NotFiniteError:
        return 0.0
    roots = np.roots([1.0, *(-slope for slope in slopes)])
    unstable = roots.size and roots.real.max() > MARGINAL * np.abs(roots).max()
    return 0.0 if unstable else float(abs(slopes[-1]) ** (1 / plant.order))


def _product(a: Sequence[Fraction], b: Sequence[Fraction]) -> list[Fraction]:
    result = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, left in enumerate(a):
        for j, right in enumerate(b):
            result[i + j] += left * right
    return result


def _against_estimation(w: float, rho: int, k: Sequence[float], b: float) -> tuple[float, ...]:
    """E of the rule; b is ``|b_m|/kappa``."""
    gains, size = [FIRST], w
    for i in range(2, rho + 1):
        gains.append(_rounded(SHARE * w * (b / size) ** 2))
        size = w * size + k[i - 1]
    return tuple(gains)


def _rounded(value: float) -> float:
    """Three digits: a rule of thumb has no more."""
    return float(f"{value:.3g}")


def _point(physics: Mapping[str, Any], parameters: tuple[Parameter, ...]) -> dict[sp.Symbol, float]:
    """The values of the parameters and of a joint's coefficients."""
    point: dict[sp.Symbol, float] = {item.symbol: item.value for item in parameters}
    for constant in physics.get("constants", ()):
        try:
            point[constant.symbol] = value_at(constant.expression, point)
        except (NotFiniteError, KeyError):  # `check_model` names it
            continue
    return point


def _output_at_start(physics: Mapping[str, Any], point: Point, x0: Sequence[float]) -> dict[sp.Symbol, float]:
    """Y where a run starts: the first state, or what the physical states make of it."""
    start, y = physics.get("start"), real_symbol("y")
    if not x0 or start is None:
        return {y: x0[0]} if x0 else {}
    given = dict.fromkeys((item.symbol for item in start.variables), 0.0)
    given |= dict(zip(given, x0, strict=False))
    return {y: value_at(start.states[real_symbol("x1")], {**point, **given})}


def _size(plant: Plant, point: Point) -> float:
    """|b_m| at the file's values; 0 where it is not finite, too."""
    try:
        return abs(value_at(plant.b[0], point))
    except (NotFiniteError, KeyError):
        return 0.0


def _unscaled(design: DesignSpec, where: str) -> ModelError:
    key = "input_scale" if design.input_scale == "auto" else "bandwidth"
    return ModelError(
        "b_m is 0 or not finite at the given parameters, so it follows from nothing",
        where=f"{where}: design.{key}",
        remedy="allowed: parameters for which b_m is a number other than 0",
    )
