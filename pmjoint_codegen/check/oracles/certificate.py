"""The certificate's numbers (33)-(35) for a model's gains: decay rate of V, ultimate error bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.poles import poles_text
from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.certificate import greatest_weight, least_rate, residual
from pmjoint_derive.closed_loop import output_disturbance
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.lyapunov import error_function, lyapunov_function
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix

Array = npt.NDArray[np.float64]

MOST_POINTS = 4_000_000  # of a quadrature, 32 n MB


@dataclass(frozen=True)
class Certificate:
    """Constants of (33)-(35), with ``1/(4 e_2)`` where (34) prints ``1/(4 e_1)`` twice.

    Attributes:
        P: solution of ``P A0 + A0' P = -2 I``, n x n, s.
        V: (30) at these gains, in z_i and epsilon_i.
        poles: eigenvalues of A0, 1/s.
        f_minus: smallest of c_i and 1/(4 e_i).
        f_plus: largest of 1/2 and lambda_max(P)/(2 e_i).
        f: their quotient; V decays at least like exp(-f t), 1/s.
        Y: sum of |P|^2 D_max^2 / (2 e_i), or of (2 |P|^2 + 1) D_max^2 / (2 e_i) for a model that disturbs y'
            itself; None without a bound of the disturbance.
        z_bound: ultimate bound sqrt(2 Y / f) of |z|, and so of |z_1|; with an input scale kappa, of
            ``|(z_1, kappa z_2, ..., kappa z_rho)|``, and z_sharp likewise.
        eta: the unknown part of y', by name: epsilon_2, D_1 or their sum.
        z_sharp: ultimate bound of |z| through eta only; D acts on epsilon_2 through exp(A0 t).
        z1_sharp: ultimate bound of |z_1| from ``z_1' = -(c_1 + e_1) z_1 + b_m z_2 + eta``.
    """

    P: Array
    V: sp.Expr
    poles: npt.NDArray[np.complexfloating[Any, Any]]
    f_minus: float
    f_plus: float
    f: float
    Y: float | None
    z_bound: float | None
    eta: str
    z_sharp: float | None
    z1_sharp: float | None

    def lines(self) -> tuple[str, ...]:
        """The constants, for people."""
        rounded = [[float(f"{entry:.5g}") for entry in row] for row in self.P]
        lines = (
            f"poles of A0 {poles_text(self.poles, 4)}; P = {rounded}",
            f"f- = {self.f_minus:.5g}, f+ = {self.f_plus:.5g}, f = {self.f:.4g} 1/s",
        )
        if self.Y is None:
            return (*lines, "no disturbance_bound in the model, hence no Y and no ultimate bound")
        return (
            *lines,
            f"Y = {self.Y:.4g}; ultimately |z|, |z1| <= sqrt(2Y/f) = {self.z_bound:.3g}",
            f"sharper, through {self.eta} alone: |z| <= {self.z_sharp:.3g}, |z1| <= {self.z1_sharp:.3g}",
        )

    def unbounded(self) -> tuple[str, ...]:
        """Names of the constants that are not finite: the gains cause overflow."""
        constants = {
            name: getattr(self, name)
            for name in ("P", "poles", "f_minus", "f_plus", "f", "Y", "z_bound", "z_sharp", "z1_sharp")
        }
        return tuple(
            name for name, value in constants.items() if value is not None and not np.all(np.isfinite(value))
        )


def certify(derivation: Derivation, values: Mapping[str, float], bound: float | None) -> Certificate:
    """Evaluate the certificate of the derivation.

    Args:
        derivation: the design.
        values: every parameter and gain by name.
        bound: D_max of the disturbance, or None if it is unknown.
    """
    s = derivation.signals
    A0, P = (numeric(matrix, values) for matrix in (filter_matrix(s), lyapunov_matrix(s)))
    c, e = ([values[symbol.name] for symbol in symbols] for symbols in (s.c, s.e))
    largest = float(np.linalg.eigvalsh(P)[-1])
    scale = values[s.input_scale.name]
    given = dict(zip((*s.e, s.input_scale), (*e, scale), strict=True))
    V = lyapunov_function(s, error_function(s, sp.Matrix(P))).subs(given)
    lambda_P, D_max = real_symbol("lambda_P"), real_symbol("D_max")
    constants = least_rate(s), greatest_weight(s, lambda_P), residual(derivation, lambda_P, D_max)
    known = {**values, "lambda_P": largest, "D_max": bound or 0.0}
    f_minus, f_plus, Y = numeric(sp.Matrix([constants]), known)[0].tolist()
    f, poles = f_minus / f_plus, np.linalg.eigvals(A0 + 0j)
    disturbed = output_disturbance(derivation.design) != 0
    name = " + ".join(["epsilon_2"] * (len(A0) > 1) + ["D_1"] * disturbed) or "nothing"
    if bound is None:
        return Certificate(P, V, poles, f_minus, f_plus, f, None, None, name, None, None)
    eta = (estimation_gain(A0) + disturbed) * bound
    z = eta * float(np.sqrt(sum(1 / (4 * gain) for gain in e) / min(c)))
    b_m = abs(float(numeric(sp.Matrix([[derivation.equations.expand(derivation.plant.b[0])]]), values)[0, 0]))
    drive = b_m / scale * z if derivation.plant.rho > 1 else 0.0
    z1 = min(z, (drive + eta) / (c[0] + e[0]))
    return Certificate(P, V, poles, f_minus, f_plus, f, Y, float(np.sqrt(2 * Y / f)), name, z, z1)


def numeric(matrix: sp.MatrixBase, values: Mapping[str, float]) -> Array:
    """A matrix of expressions at values of its symbols, by name."""
    at = {symbol: values[symbol.name] for symbol in matrix.free_symbols}
    return np.array(matrix.subs(at).evalf(17).tolist(), dtype=np.float64)


def estimation_gain(A0: Array) -> float:
    """``int_0^inf |row 2 of exp(A0 t)| dt``: the largest epsilon_2 from a disturbance of unit size, s.

    Simpson's rule; the integrand is analytic, as no row of exp(A0 t) vanishes. The grid is 1/100 of the
    fastest time constant among the poles that have not decayed by exp(-40). Infinite if that takes more
    than `MOST_POINTS`, as for oscillations of a damping ratio below 0.001. n = 1 has no epsilon_2.
    """
    from scipy.integrate import simpson  # slow to import

    if len(A0) == 1:
        return 0.0
    poles = np.linalg.eigvals(A0)
    ends = 40 / np.abs(poles.real)
    row, begin, total = np.eye(len(A0))[1:2], 0.0, 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # `Certificate.unbounded` names what is not finite
        for end in np.unique(ends):
            fastest = float(np.abs(poles[ends >= end]).max())
            points = 100 * fastest * (end - begin)
            if not points <= MOST_POINTS:
                return np.inf
            count = max(2, int(points))
            rows = _powers(row, A0 * ((end - begin) / count), count)
            total += float(simpson(np.linalg.norm(rows, axis=1), dx=(end - begin) / count))
            row, begin = rows[-1:], end
    return total


def _powers(row: Array, A: Array, count: int) -> Array:
    """``row exp(A k)`` for k = 0, 1, ..., count; shape (count + 1, n)."""
    from scipy.linalg import expm  # slow to import

    transition = expm(A)
    while len(row) <= count:  # doubled in each pass
        row = np.concatenate([row, row @ transition])
        transition = transition @ transition
    return row[: count + 1]
