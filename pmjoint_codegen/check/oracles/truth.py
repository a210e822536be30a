"""What an adaptive controller does not know: the true Theta, the estimation error with it, and V.

All of it is computed from the model's plant and a run's states. V and the matrix P in it are restated here,
not taken from the derivation: P comes from SciPy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.simulate.run import Run
from pmjoint_derive import Model
from pmjoint_derive.adaptation import Adaptation, Entry

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Energy:
    """V of the adaptive design along a run, and its parts.

    Attributes:
        errors: ``sum w_i z_i^2/2``, shape (rows,).
        estimates: the distance of the estimates from the truth, weighted with the inverse of their gains.
        estimation: ``sum epsilon' P epsilon/(2 e_i)``.
    """

    errors: Array
    estimates: Array
    estimation: Array

    @property
    def total(self) -> Array:
        """V, shape (rows,)."""
        return self.errors + self.estimates + self.estimation


def true_theta(model: Model, values: Mapping[str, float]) -> Array:
    """``(b_m, ..., b_0, theta)`` of the plant, shape (p,).

    Args:
        model: the model.
        values: parameters by name.
    """
    constants = {item.symbol: item.expression for item in model.constants}
    found = []
    for entry in (*model.plant.b, *model.plant.theta):
        value = sp.sympify(entry)
        while value.free_symbols & constants.keys():
            value = value.xreplace(constants)
        at = {symbol: values[symbol.name] for symbol in value.free_symbols}
        found.append(float(value.subs(at)))
    return np.array(found)


def frozen_truth(model: Model, values: Mapping[str, float]) -> dict[str, float]:
    """True values for the guesses that are never corrected, by the name of the parameter: then D has no part.

    Args:
        model: the model.
        values: parameters by name.
    """
    if model.adaptation is None:
        return {}
    true = true_theta(model, values)
    return {
        entry.guess_symbol.name: float(true[entry.place])
        for entry in model.adaptation.entries
        if not entry.unknown
    }


def outside(model: Model, values: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the unknown entries whose true value is not inside their range."""
    true = true_theta(model, values)
    adaptation = model.adaptation
    assert adaptation is not None
    ranges = ((entry, _range(entry, values)) for entry in adaptation.unknown)
    return tuple(
        entry.name for entry, ends in ranges if ends is not None and not ends[0] < true[entry.place] < ends[1]
    )


def estimation_errors(run: Run, model: Model) -> Array:
    """Estimation error with the true values of what is estimated, shape (rows, n).

    Filters are those of the columns; their sum is formed here, since x_hat of a run has the estimates. An
    extended-state observer has no filters: its own states estimate x, with whatever values it was run with.

    Args:
        run: the run.
        model: what it is a run of.
    """
    manifest, values = run.manifest, run.settings.parameters
    n = manifest.n
    x, xi, lambda_ = (run.states[:, slice(*manifest.blocks[name])] for name in ("x", "xi", "lambda"))
    if lambda_.shape[1] == 0:
        return np.asarray(x[:, :n] - xi[:, :n], dtype=np.float64)
    Theta = true_theta(model, values)
    if model.adaptation is not None:
        for entry in model.adaptation.entries:
            if not entry.unknown:
                Theta[entry.place] = values[entry.guess_symbol.name]
    b = Theta[: manifest.m + 1]
    Xi = run.states[:, slice(*manifest.blocks["Xi"])].reshape(len(run.t), n, manifest.p)
    x_hat = xi + Xi @ Theta[manifest.m + 1 :]
    A0 = filter_matrix(manifest.n, values)
    driven = lambda_
    for coefficient in b[::-1]:  # v_0 = lambda, v_j = A0 v_{j-1}
        x_hat = x_hat + coefficient * driven
        driven = driven @ A0.T
    return np.asarray(x[:, :n] - x_hat, dtype=np.float64)


def filter_matrix(n: int, values: Mapping[str, float]) -> Array:
    """``A0 = A - k e_1'``, restated; values hold k1 ... kn."""
    A0 = np.eye(n, k=1)
    A0[:, 0] -= [values[f"k{i}"] for i in range(1, n + 1)]
    return A0


def lyapunov_solution(A0: Array) -> Array:
    """P of ``P A0 + A0' P = -2 I``, by SciPy."""
    from scipy.linalg import solve_continuous_lyapunov  # slow to import

    found: Array = solve_continuous_lyapunov(A0.T, -2.0 * np.eye(len(A0)))
    return found


def energy(run: Run, model: Model) -> Energy:
    """V along a run of an adaptive controller with tuning functions; NaN where a true value is out of range.

    Args:
        run: the run.
        model: what it is a run of.
    """
    adaptation = model.adaptation
    assert adaptation is not None and adaptation.least_squares is None
    values, rho = run.settings.parameters, run.manifest.rho
    z = np.column_stack([run[f"z{i}"] for i in range(1, rho + 1)])
    epsilon = estimation_errors(run, model)
    P = lyapunov_solution(filter_matrix(run.manifest.n, values))
    weight = sum(1 / (2 * values[f"e{i}"]) for i in range(1, rho + 1))
    return Energy(
        z**2 @ weights(values, rho) / 2,
        _of_estimates(run, model, adaptation),
        weight * np.einsum("ri,ij,rj->r", epsilon, P, epsilon),
    )


def weights(values: Mapping[str, float], rho: int) -> Array:
    """1, then kappa^2, of the errors in V, shape (rho,)."""
    return np.array([1.0, *[values["input_scale"] ** 2] * (rho - 1)])


def _of_estimates(run: Run, model: Model, adaptation: Adaptation) -> Array:
    values = run.settings.parameters
    true, total = true_theta(model, values), np.zeros(len(run.t))
    for entry in adaptation.unknown:
        gain = values[entry.gamma.name]
        if gain > 0:
            hat = run[entry.estimate.name]
            total = total + _distance(hat, float(true[entry.place]), _range(entry, values)) / gain
    if adaptation.inverse is not None and values["gamma_rho"] > 0:
        off = 1 / true[0] - run["rho_hat"]
        total = total + abs(float(true[0])) * off**2 / (2 * values["gamma_rho"])
    return np.asarray(total, dtype=np.float64)


def _distance(hat: Array, true: float, ends: tuple[float, float] | None) -> Array:
    """Half the square, or with a range the divergence whose gain vanishes at its ends."""
    if ends is None:
        return np.asarray((true - hat) ** 2 / 2, dtype=np.float64)
    low, high = ends
    with np.errstate(invalid="ignore"):
        below = (true - low) * np.log((true - low) / (hat - low))
        above = (high - true) * np.log((high - true) / (high - hat))
    return np.asarray((high - low) / 4 * (below + above), dtype=np.float64)


def _range(entry: Entry, values: Mapping[str, float]) -> tuple[float, float] | None:
    if entry.range is None:
        return None
    low, high = entry.ends
    return values[low.name], values[high.name]


def decay(
    model: Model, values: Mapping[str, float], D_max: float, *, disturbs_y: bool
) -> tuple[float, float]:
    """Rate and residual, f and Y, of ``V' <= -f V + Y``; f is 0 where not every estimate is pulled.

    Without leakage, or with a gain that vanishes at the ends of a range, the estimates' part of V has no rate
    of its own.

    Args:
        model: the model.
        values: parameters by name.
        D_max: bound of the disturbance.
        disturbs_y: whether D_1 is not 0.
    """
    adaptation, rho = model.adaptation, len(model.gains.c)
    assert adaptation is not None
    P = lyapunov_solution(filter_matrix(len(model.gains.k), values))
    largest = float(np.linalg.eigvalsh(P)[-1])
    E = sum(1 / (2 * values[f"e{i}"]) for i in range(1, rho + 1))
    Y = E * D_max**2 * (2 * largest**2 + 1 if disturbs_y else largest**2)
    rates = [2 * values[f"c{i}"] for i in range(1, rho + 1)] + [1 / (2 * largest)]
    true, leakage = true_theta(model, values), values["leakage"]
    for entry in adaptation.unknown:
        gain = values[entry.gamma.name]
        if gain > 0:
            rates.append(leakage * gain if entry.range is None else 0.0)
            Y += leakage / 2 * (float(true[entry.place]) - values[entry.prior_symbol.name]) ** 2
    if adaptation.inverse is not None and values["gamma_rho"] > 0:
        pull = values["rho_leakage"]
        rates.append(pull * values["gamma_rho"])
        Y += abs(float(true[0])) * pull / 2 * (1 / float(true[0]) - values["rho_prior"]) ** 2
    return min(rates), Y
