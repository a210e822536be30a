"""Numbers with which the loops prove that a step follows the right-hand side throughout.

Between the points at which a step's polynomials are compared with the right-hand side, Cauchy's estimate on a
disc larger than the step bounds their error: `GuardRule`, docs/theory.md. A larger disc has a smaller
factor, but the nonlinear part on it is larger; so a few are tried.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from pmjoint_codegen.manifest import GuardRule

# A disc's factor, as multiples of the tolerance: the usual one first, then smaller discs for nearby
# singularities, larger ones for slow growth multiplied by high gains.
TARGETS: Final = (1.0, 1e3, 1e-2, 1e-7)
NODES_AWAY: Final = 0.2  # the factor falls as if all zeros lay about here
SMALLEST_RATIO: Final = 1.1
# Discs for holds, which are short compared with the plant's dynamics: no point of comparison is needed. The
# first also serves for a window over many holds.
HOLD_RATIOS: Final = (32.0, 12.0, 6.0)


@dataclass(frozen=True)
class Discs:
    """Discs around a step's start.

    Attributes:
        ratios: their radii, as multiples of the step.
        factors: bound on the step's error, as a multiple of the nonlinear part on the disc.
    """

    ratios: tuple[float, ...]
    factors: tuple[float, ...]


def discs(rule: GuardRule, tolerance: float) -> Discs:
    """The discs to try, in turn, for a local error.

    The last is no larger than the step: with |F - F(0)| <= r on it no term of F of order 1 to N - 1 exceeds
    r, so the error in F's nonlinear part is at most N r. The linear part is largest at the step's
    end, where the two are compared together: 2 N r in all.
    """
    ratios = [_ratio(rule, target * tolerance) for target in TARGETS]
    factors = [factor(rule, ratio) for ratio in ratios]
    return Discs((*ratios, 1.0), (*factors, 2.0 * rule.order))


def factor(rule: GuardRule, ratio: float) -> float:
    """``W / (s^N prod_j (s - n_j)) s/(s - 1)`` for a disc of s > 1 steps."""
    product = math.pow(ratio, rule.order) * (ratio - 1.0)
    for node in rule.inside:
        product *= ratio - node
    return rule.remainder / product * ratio / (ratio - 1.0)


def _ratio(rule: GuardRule, target: float) -> float:
    """A ratio whose factor is about `target`; any above 1 is valid, as its own factor is used with it."""
    degree = rule.order + len(rule.inside) + 1
    return max(math.pow(rule.remainder / target, 1.0 / degree) + NODES_AWAY, SMALLEST_RATIO)


def hold_factors(zeros: int) -> list[float]:
    """``s^-N s/(s - 1)`` for each of `HOLD_RATIOS`: a hold's error without points of comparison.

    Its defect has an N-fold zero at its start; N is the order for rates, one more for values.
    """
    return [math.pow(ratio, -zeros) * ratio / (ratio - 1.0) for ratio in HOLD_RATIOS]
