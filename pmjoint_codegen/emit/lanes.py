"""The functions that a sweep evaluates on many trajectories at once, composed from the table's rows.

Continuous: ``taylor_lanes``, coefficients of X, of v, of the tracking error e = y - y_r and of kinks. Its
order is lower than in single runs: a sweep asks for 1e-6 where a single run asks for 1e-10. See
docs/sweep.md for the measurement. ``guard_lanes`` and ``rates_lanes`` check a step. Sampled:
``sample_lanes``, the kernel of a single run, and ``plant_lanes``, the plant's coefficients of the same
order alone, for holds longer than one step, with ``plant_guard_lanes``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain

import casadi as ca

from pmjoint_codegen.emit.guard import bent
from pmjoint_codegen.emit.sampling import sampled_sizes, symbols_of
from pmjoint_codegen.emit.vocabulary import Vocabulary
from pmjoint_codegen.loops.quadrature import lane_steps

LANE_ORDER = 12  # continuous: least time per run from 1e-5 to 1e-8


def lane_sizes(words: Vocabulary, functions: Mapping[str, ca.Function]) -> dict[str, int | str]:
    """The constants of ``lanes.h``: sizes of all vectors, the two orders, and what is not linear."""
    sizes: dict[str, int | str] = {
        **sampled_sizes(words, functions),
        "PMJ_NM": len(words.h) // 2,
        "PMJ_NR": functions["reference"].size1_out(0),
        "PMJ_ORDER": LANE_ORDER,
        **({"PMJ_HOLDS": 1} if "holds" in functions else {}),
    }
    for name, guard in (("LOOP", "guard"), ("PLANT", "plant_guard")):
        guards = [functions[one] for one in (guard, f"{guard}_held") if one in functions]
        both = [sorted({*chain(*places)}) for places in zip(*map(bent, guards), strict=True)]
        for what, places in zip(("STATES", "RESTS"), both, strict=True):
            sizes[f"PMJ_{name}_BENT_{what}"] = len(places)
            sizes[f"PMJ_{name}_BENT_{what}_LIST"] = f"{{{', '.join(map(str, places or [0]))}}}"
    return sizes


def matrices(name: str, *parts: ca.Function) -> ca.Function:
    """The filters' and the compensator's matrix in one vector, each row by row."""
    (p,) = symbols_of(parts[0])
    both = [part(p) for part in parts]
    return ca.Function(name, [p], [ca.densify(ca.vertcat(*both))], ["p"], ["matrices"])


def arrive(name: str, loop: ca.Function) -> ca.Function:
    """The end of a step of ``taylor_lanes``, and its metrics, as straight lines.

    X there and its slopes, both by Horner, and the values of the other channels; v and e as
    ``sum_k a_k s^k`` over s in [0, 1]; the mean of e^2, by five Gauss nodes: their error is small by
    the tolerance (below 1e-9 of it).
    """
    order, states = LANE_ORDER, loop.size1_in("X")
    channels = sum(loop.size1_out(i) for i in range(loop.n_out()))
    c, h = ca.SX.sym("c", (order + 1) * channels), ca.SX.sym("h")
    values, slopes = [], []
    for i in range(channels):
        value, slope = c[order * channels + i], ca.SX(0)
        for k in range(order - 1, -1, -1):
            slope = slope * h + value
            value = value * h + c[k * channels + i]
        values.append(value)
        slopes.append(slope)
    powers = [ca.SX(1)]
    for _ in range(order):
        powers.append(powers[-1] * h)
    v, e = ([c[k * channels + i] * powers[k] for k in range(order + 1)] for i in (states, states + 1))
    results = [values[:states], slopes[:states], values[states:], v, e, [_mean_square(e)]]
    names = ["X", "slope", "ends", "v", "e", "square"]
    return ca.Function(name, [c, h], [ca.vertcat(*entries) for entries in results], ["c", "h"], names)


def _mean_square(a: list[ca.SX]) -> ca.SX:
    """Integral over s in [0, 1] of the square of ``sum_k a_k s^k``, by Gauss and Legendre."""
    rule = lane_steps()
    total = ca.SX(0)
    for node, weight in zip(rule.nodes, rule.weights, strict=True):
        value = a[-1]
        for entry in reversed(a[:-1]):
            value = value * node + entry
        total += value * value * weight
    return total


def bernstein(name: str) -> ca.Function:
    """Bernstein coefficients on [0, 1] of ``sum_k a_k s^k``: their extremes bound the polynomial, closely."""
    order = LANE_ORDER
    a = ca.SX.sym("a", order + 1)
    b = [a[k] * (1 / math.comb(order, k)) for k in range(order + 1)]
    for level in range(1, order + 1):
        for j in range(order, level - 1, -1):
            b[j] = b[j] + b[j - 1]
    return ca.Function(name, [a], [ca.vertcat(*b)], ["a"], ["b"])


def control(name: str, reference: ca.Function, law: ca.Function) -> ca.Function:
    """V of (29) from a measured y, and the reference that it is for."""
    t, y, s, p = (
        ca.SX.sym(label, law.size1_in(label) if label != "t" else 1) for label in ("t", "y", "s", "p")
    )
    y_r = reference(t, p)
    results = [law(y, s, y_r, p)[2], ca.densify(y_r)]
    return ca.Function(name, [t, y, s, p], results, ["t", "y", "s", "p"], ["v", "y_r"])


def stacked(name: str, function: ca.Function) -> ca.Function:
    """All results in one, in order: the reference for the channels of a Taylor kernel."""
    inputs = symbols_of(function)
    return ca.Function(
        name, inputs, [ca.densify(ca.vertcat(*function.call(inputs)))], function.name_in(), ["rates"]
    )


def same(name: str, function: ca.Function) -> ca.Function:
    """A function of single runs, for lanes."""
    inputs = symbols_of(function)
    return ca.Function(name, inputs, function.call(inputs), function.name_in(), function.name_out())
