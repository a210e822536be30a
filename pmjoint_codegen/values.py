"""What numbers a design may have, whether they stand in a model file or are set for one run.

The rules are the assumptions of the design: positive gains (23), (25), (29), a Hurwitz filter matrix
``A0 = A - k e1'`` (14), a positive actuator limit (10) and an input coefficient ``b_m`` other than zero (11).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from pmjoint_codegen.errors import ModelError, PmjointError

COMPENSATOR = "compensator"  # the switch between (23) and plain clipping
OWN_SUFFIX = "_plant"  # of the simulated plant's own value of a parameter that the controller uses too
_POSITIVE_GAINS = ("c", "e", "ck")


def check_values(
    values: Mapping[str, float],
    *,
    n: int,
    rho: int,
    limit: str,
    leading: str | None,
    where: str,
    error: type[PmjointError] = ModelError,
    key: Callable[[str], str] = str,
) -> None:
    """Check the value of every parameter, gain and switch of a design.

    Args:
        values: name -> number: plant parameters, ``c1..``, ``e1..``, ``ck1..``, ``k1..``, ``compensator``.
        n: order of the plant.
        rho: relative degree.
        limit: name of the parameter that limits the actuator.
        leading: name of the parameter that is b_m; None where b_m is an expression, which the caller checks.
        where: file or option that a message begins with.
        error: kind of error to raise: `ModelError` for a file, `UsageError` for a command.
        key: turns a name into what the reader knows it by, such as ``design.c, entry 1``.

    Raises:
        PmjointError: of the kind `error`, for the first rule that a value breaks.
    """

    def refuse(name: str, what: str, allowed: str) -> PmjointError:
        return error(
            what, where=f"{where}: {key(name)}" if where else key(name), remedy=f"allowed: {allowed}"
        )

    for name, value in values.items():
        if not math.isfinite(value):
            raise refuse(name, f"is {value}", "a finite number")
    for name in (*gain_names(_POSITIVE_GAINS, rho), limit):
        if not values[name] > 0:
            raise refuse(name, f"is {values[name]:g}", "a number greater than 0")
    if leading is not None and values[leading] == 0:
        raise refuse(leading, "is 0, so b_m = 0 and no input acts", "a number other than 0")
    if values[COMPENSATOR] not in (0, 1):
        raise refuse(COMPENSATOR, f"is {values[COMPENSATOR]:g}", "1 (on) or 0 (off)")
    gains = [values[name] for name in gain_names(("k",), n)]
    if not is_hurwitz([1.0, *gains]):
        raise refuse(
            "k", f"leaves A0 = A - k e1' unstable, eigenvalues {roots_text([1.0, *gains])}", _hurwitz_rule(n)
        )


def of_plant(values: Mapping[str, float], name: str) -> float:
    """What the simulated plant has for a parameter, whatever the controller believes."""
    return values.get(f"{name}{OWN_SUFFIX}", values[name])


def gain_names(kinds: Iterable[str], count: int) -> tuple[str, ...]:
    """Names ``c1 ... cN`` of gains, kind by kind."""
    return tuple(f"{kind}{i}" for kind in kinds for i in range(1, count + 1))


def is_hurwitz(coefficients: Sequence[float]) -> bool:
    """Whether all roots of a polynomial, highest power first, lie in the open left half plane.

    Routh's criterion in exact integer arithmetic, so that no rounding decides near the imaginary axis.
    """
    exact = _integers(coefficients)
    if exact[0] == 0:
        return False
    if exact[0] < 0:
        exact = [-entry for entry in exact]
    upper, lower = exact[0::2], exact[1::2]
    while lower:
        if lower[0] <= 0:
            return False
        padded = [*lower[1:], *[0] * (len(upper) - len(lower))]
        row = [lower[0] * a - upper[0] * b for a, b in zip(upper[1:], padded, strict=True)]
        divisor = math.gcd(*row) or 1  # positive, so it changes no sign; keeps the integers short
        upper, lower = lower, [entry // divisor for entry in row]
    return True


def _integers(values: Sequence[float]) -> list[int]:
    """Scale floats, which are dyadic fractions, to integers of the same ratios."""
    ratios = [float(value).as_integer_ratio() for value in values]
    scale = max(denominator for _, denominator in ratios)  # powers of two: the largest is a multiple of each
    return [numerator * (scale // denominator) for numerator, denominator in ratios]


def roots_text(coefficients: Sequence[float]) -> str:
    """Show the roots of a polynomial, highest power first, to six digits."""
    with np.errstate(all="ignore"):
        try:
            roots = np.sort_complex(np.roots(np.asarray(coefficients, dtype=float)))
        except np.linalg.LinAlgError:  # coefficients near the largest float
            return "beyond what floating point can tell"
    shown = [complex(root) + 0 for root in roots]  # + 0 drops the sign of a negative zero
    return ", ".join(f"{root:.6g}" if root.imag else f"{root.real:.6g}" for root in shown)


def _hurwitz_rule(n: int) -> str:
    rule = {1: "k1 > 0", 2: "k1 > 0 and k2 > 0", 3: "k1 > 0, k3 > 0 and k1 k2 > k3"}
    return rule.get(n, "gains for which every eigenvalue has a negative real part")
