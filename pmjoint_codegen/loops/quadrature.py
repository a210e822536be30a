"""Gauss-Legendre rules on (0, 1), for the integral of e^2 over one step of the dense output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Rule:
    """Nodes and weights; exact for polynomials of degree ``2 len(nodes) - 1``.

    Attributes:
        nodes: on (0, 1), ascending.
        weights: positive, adding up to 1.
    """

    nodes: tuple[float, ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the rule's moments up to its degree."""
        for degree in range(2 * len(self.nodes)):
            moment = sum(w * x**degree for x, w in zip(self.nodes, self.weights, strict=True))
            if abs(moment - 1 / (degree + 1)) > 1e-15:
                raise ValueError(f"the rule with {len(self.nodes)} nodes integrates x^{degree} to {moment}")


# Ten nodes: the upper five mirror the lower five, with the same weights.
_LOWER: Final = (
    0.01304673574141414,
    0.06746831665550775,
    0.1602952158504878,
    0.2833023029353764,
    0.4255628305091844,
)
_WEIGHTS: Final = (
    0.03333567215434407,
    0.0747256745752903,
    0.10954318125799102,
    0.13463335965499817,
    0.14776211235737644,
)
_LONG: Final = Rule((*_LOWER, *(1.0 - x for x in reversed(_LOWER))), (*_WEIGHTS, *reversed(_WEIGHTS)))
_LANES: Final = Rule(
    (0.04691007703066802, 0.23076534494715845, 0.5, 0.7692346550528415, 0.953089922969332),
    (0.11846344252809454, 0.23931433524968324, 0.28444444444444444, 0.23931433524968324, 0.11846344252809454),
)
_SHORT: Final = Rule(
    (0.11270166537925831, 0.5, 0.8872983346207417),
    (0.2777777777777778, 0.4444444444444444, 0.2777777777777778),
)


def long_steps() -> Rule:
    """Ten nodes, for the long steps of the continuous loop: exact to degree 19."""
    return _LONG


def lane_steps() -> Rule:
    """Five nodes, for the steps of the continuous lanes: exact to degree 9."""
    return _LANES


def short_steps() -> Rule:
    """Three nodes, for the short holds of the sampled loop: exact to degree 5."""
    return _SHORT


def short_integral(c: list[float], size: float) -> float:
    """Integral of e^2 over a hold that is one step, by three Gauss nodes.

    Args:
        c: Taylor coefficients of e.
        size: of the step, s.
    """
    a, power, total = [c[0]], size, 0.0
    for coefficient in c[1:]:
        a.append(coefficient * power)
        power = power * size
    rule = short_steps()
    for node, weight in zip(rule.nodes, rule.weights, strict=True):
        e = a[-1]
        for coefficient in a[-2::-1]:
            e = e * node + coefficient
        total = total + e * e * weight
    return size * total
