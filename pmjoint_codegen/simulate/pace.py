"""Whether the law is too fast for the clock of a sampled controller, and what to do about it.

The rates of the z-dynamics are those of ``z_1' = -(c_1 + e_1) z_1 + b_m z_2``,
``z_2' = -c_2 z_2 - (b_m/kappa^2) z_1 + z_3`` and so on: the damping e_i s_i^2 from step 2 on, which depends
on the state, is left out. There is a warning where T times the largest magnitude of their eigenvalues, of
``b_m/kappa`` or of a pole of the filters exceeds `LIMIT`. Of 1000 designs drawn for the shipped models other
than the paper's, with T from 1 to 20 ms, 165 were lost, none of them below 0.44; some lived up to 1.8. The
limit was chosen from these draws, so many designs that it warns of run well.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import INPUT_SCALE, evaluate, filter_gains

LIMIT = 0.42
COUPLING = "b_m/input_scale"


def too_fast(manifest: Manifest, values: Mapping[str, float], sample_time: float) -> str | None:
    """One line that names the fastest rate and the remedy, or None where the clock is fast enough.

    Args:
        manifest: the model.
        values: every parameter by name, as the kernels take it.
        sample_time: T, s.
    """
    b_m, kappa = leading(manifest, values), values[INPUT_SCALE]
    rates = {
        COUPLING: abs(b_m) / kappa if manifest.rho > 1 else 0.0,
        "the fastest rate of the errors z": _fastest(_errors(manifest, values, b_m)),
        "the fastest pole of the filters": float(
            np.abs(np.roots([1.0, *(values[name] for name in filter_gains(manifest.n))])).max()
        ),
    }
    name, rate = max(rates.items(), key=lambda item: item[1] if np.isfinite(item[1]) else np.inf)
    if rate * sample_time <= LIMIT:
        return None
    best = f"a sample time of at most {LIMIT / rate:.2g} s"
    coupled = rates[COUPLING] >= 0.9 * rate
    if coupled:  # the errors are then as fast because of it
        name, rate = COUPLING, rates[COUPLING]
    remedy = f'[design] input_scale = "auto", which is {abs(b_m):.4g},' if coupled else "slower gains,"
    return (
        f"{name} is {rate:.3g} 1/s, {rate * sample_time:.2g} over a sample time of {sample_time:g} s, where "
        f"more than {LIMIT:g} may be unstable; use {remedy} or {best}"
    )


def leading(manifest: Manifest, values: Mapping[str, float]) -> float:
    """b_m at these values."""
    (rule,) = (rule for rule in manifest.rules if rule.name in ("b_m", "b_m ... b_0"))
    columns = {name: np.array([value]) for name, value in values.items()}
    return float(np.asarray(evaluate(rule.trees[0], columns), dtype=np.float64).reshape(-1)[0])


def _errors(manifest: Manifest, values: Mapping[str, float], b_m: float) -> np.ndarray:
    """The matrix of the z-dynamics, rho x rho."""
    rho, kappa = manifest.rho, values[INPUT_SCALE]
    matrix = np.diag([-values[f"c{i}"] for i in range(1, rho + 1)])
    matrix[0, 0] -= values["e1"]
    for i in range(1, rho):
        matrix[i - 1, i], matrix[i, i - 1] = (b_m, -b_m / kappa**2) if i == 1 else (1.0, -1.0)
    return matrix


def _fastest(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max()) if np.all(np.isfinite(matrix)) else np.inf
