"""Margins of a loop at an operating point: equilibrium, open-loop matrices, crossings.

The loop is cut at the plant's input. L = C (s I - A)^-1 B is what comes back there, negated, so 1 + L = 0 is
the closed loop. Crossings are eigenvalues: no grid of frequencies can miss one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import UsageError

Array = npt.NDArray[np.float64]
Function = Callable[[Array], Array]

_STEPS = (1e-2, 1e-3, 1e-4, 1e-5)  # of differences, relative to max(1, |value|)
_SMOOTH = 1e-2  # change of a slope across the point, relative to the slopes, that a kink exceeds
_CLOSE = 1e-4  # disagreement of differences, relative to the slopes
_SOLVED = 1e-6  # last step of the solution, relative to max(1, |value|)


@dataclass(frozen=True)
class Margins:
    """How far a stable loop, cut at the plant's input, is from instability.

    Attributes:
        gain_margin: smallest factor above 1 on L at which the loop oscillates; inf if there is none.
        lower_gain_margin: largest such factor below 1; 0 if there is none.
        phase_margin: smallest rotation of L, either way, at which the loop oscillates, deg; inf if |L| is
            never 1.
        delay_margin: smallest delay at the plant's input at which the loop oscillates, s; inf likewise. The
            controller does not know of it.
        gain_crossovers: where |L| = 1, rad/s, ascending.
        phase_crossovers: where L is real and negative, rad/s, ascending.
        x: the plant's states at the operating point.
        u: the input there, in the kernels' unit.
        y_r: the constant reference, in the kernels' unit.
    """

    gain_margin: float
    lower_gain_margin: float
    phase_margin: float
    delay_margin: float
    gain_crossovers: tuple[float, ...]
    phase_crossovers: tuple[float, ...]
    x: tuple[float, ...]
    u: float
    y_r: float

    def __repr__(self) -> str:
        """The margins and where they hold, in two lines."""
        point = ", ".join(f"{value:.6g}" for value in self.x)
        return (
            f"<Margins: gain {self.lower_gain_margin:.6g} to {self.gain_margin:.6g}, "
            f"phase {self.phase_margin:.6g} deg, delay {self.delay_margin:.6g} s\n"
            f"  at y_r = {self.y_r:.6g}, x = ({point}), u = {self.u:.6g}>"
        )


def jacobian(function: Function, z: Array) -> Array:
    """Derivatives by extrapolated central differences of the steps that agree best.

    Raises:
        UsageError: the function has a kink or a jump at z.
    """
    middle = function(z)
    return np.column_stack([_column(function, z, middle, i) for i in range(len(z))])


def _column(function: Function, z: Array, middle: Array, i: int) -> Array:
    unit, scale = np.eye(len(z))[i], max(1.0, abs(float(z[i])))

    def sides(h: float) -> tuple[Array, Array]:
        return function(z + h * unit), function(z - h * unit)

    def slope(h: float) -> Array:
        above, below = sides(h)
        return (above - below) / (2.0 * h)

    found = [(4.0 * slope(h * scale / 2.0) - slope(h * scale)) / 3.0 for h in _STEPS]
    gaps = [float(np.max(np.abs(b - a))) for a, b in pairwise(found)]
    gaps = [gap if np.isfinite(gap) else np.inf for gap in gaps]
    best = int(np.argmin(gaps))
    column, size = found[best + 1], max(1e-9, float(np.max(np.abs(found[best + 1]))))
    h = _STEPS[-1] * scale
    above, below = sides(h)
    bend = float(np.max(np.abs(above - 2.0 * middle + below))) / h
    if not (gaps[best] <= _CLOSE * size and bend <= _SMOOTH * max(1.0, size)):
        raise UsageError(
            "the loop has a kink or a jump at the operating point, so it has no linearisation there",
            where="margins",
            remedy="ask for another y_r, or leave out friction or dead zone",
        )
    return column


def equilibrium(function: Function, guess: Array) -> Array:
    """Where a function is 0, by its derivatives.

    Raises:
        UsageError: no such point was found, or the function is not smooth there.
    """
    from scipy.optimize import root

    result = root(function, guess, method="hybr", options={"xtol": 1e-12})
    found: Array = np.asarray(result.x, np.float64)
    try:
        for _ in range(3):
            step = np.linalg.solve(jacobian(function, found), function(found))
            found = found - step
        if np.all(np.abs(step) <= _SOLVED * np.maximum(1.0, np.abs(found))):
            return found
    except np.linalg.LinAlgError:
        pass  # as without an equilibrium: its equations do not determine a point
    except UsageError:
        if result.success:  # else a kink of a point that is no equilibrium says nothing
            raise
    raise UsageError(
        "the loop has no equilibrium that could be found for this constant reference",
        where="margins",
        remedy="ask for a y_r that the plant can hold at rest",
    )


def response(A: Array, B: Array, C: Array, omega: float) -> complex:
    """L(j omega)."""
    return complex((C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B))[0, 0])


def crossings(candidates: npt.NDArray[np.complex128], value: Callable[[float], float]) -> list[float]:
    """Zeros of a function near those candidates that are close to the positive imaginary axis."""
    from scipy.optimize import brentq

    found: list[float] = []
    for omega in sorted(float(s.imag) for s in candidates if np.isfinite(s) and abs(s.real) < 1e-3 * s.imag):
        low, high = omega * (1.0 - 1e-3), omega * (1.0 + 1e-3)
        if value(low) * value(high) < 0.0:
            at = float(brentq(value, low, high, xtol=1e-14 * omega, rtol=1e-14))
            if not found or at > found[-1] * (1.0 + 1e-9):
                found.append(at)
    return found


def margins_of(A: Array, B: Array, C: Array, x: Array, u: float, y_r: float) -> Margins:
    """Margins of L = C (s I - A)^-1 B.

    |L| = 1 at eigenvalues of a Hamiltonian matrix; L(s) = L(-s) at zeros of a pencil.

    Args:
        A: shape (n, n).
        B: shape (n, 1).
        C: shape (1, n).
        x: the plant's states, for the record.
        u: its input.
        y_r: the reference.

    Raises:
        UsageError: the closed loop is unstable, so that it has no margins.
    """
    from scipy.linalg import eig, eigvals

    n = len(A)
    if max(np.linalg.eigvals(A - B @ C).real) >= 0.0:
        raise UsageError(
            "the closed loop is unstable at this operating point, so it has no margins",
            where="margins",
            remedy="choose other gains or another y_r",
        )

    def at(omega: float) -> complex:
        return response(A, B, C, omega)

    hamiltonian = np.block([[A, B @ B.T], [-C.T @ C, -A.T]])
    gains = crossings(eigvals(hamiltonian), lambda w: float(np.log(abs(at(w)))))
    zero, none = np.zeros((n, n)), np.zeros((1, 1))
    pencil = np.block([[A, zero, B], [zero, -A, B], [C, C, none]])
    mass = np.diag([*np.ones(2 * n), 0.0])
    real = crossings(eig(pencil, mass, right=False), lambda w: at(w).imag / abs(at(w)))
    if np.linalg.cond(A) < 1e14:
        real = [0.0, *real]
    phases = [w for w in real if at(w).real < 0.0]
    factors = [1.0 / abs(at(w)) for w in phases]
    turns = [(np.angle(at(w)) + np.pi) % (2.0 * np.pi) for w in gains]
    return Margins(
        gain_margin=min((g for g in factors if g > 1.0), default=np.inf),
        lower_gain_margin=max((g for g in factors if g <= 1.0), default=0.0),
        phase_margin=float(np.degrees(min((min(a, 2.0 * np.pi - a) for a in turns), default=np.inf))),
        delay_margin=float(min((a / w for a, w in zip(turns, gains, strict=True)), default=np.inf)),
        gain_crossovers=tuple(gains),
        phase_crossovers=tuple(phases),
        x=tuple(x.tolist()),
        u=u,
        y_r=y_r,
    )
