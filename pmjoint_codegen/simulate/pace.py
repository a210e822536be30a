"""Whether the law is too fast for the clock of a sampled controller, and what to do about it.

The rates of the z-dynamics are those of ``z_1' = -(c_1 + e_1) z_1 + b_m z_2``,
``z_2' = -c_2 z_2 - (b_m/kappa^2) z_1 + z_3`` and so on: the damping e_i s_i^2 from step 2 on, which depends
on the state, is left out. There is a warning where T times the largest magnitude of their eigenvalues, of
``b_m/kappa`` or of a pole of the filters exceeds `LIMIT`. Of 1000 designs drawn for the shipped models other
than the paper's, with T from 1 to 20 ms, 165 were lost, none of them below 0.44; some lived up to 1.8. The
limit was chosen from these draws, so many designs that it warns of run well.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping

import numpy as np

from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import (
    INPUT_SCALE,
    OBSERVER,
    Numbers,
    Rule,
    evaluate,
    filter_gains,
    positive_gains,
)

LIMIT = 0.42
COUPLING = "b_m/input_scale"


Columns = Mapping[str, Numbers]  # every parameter by name, shape (runs,)


def too_fast(manifest: Manifest, values: Mapping[str, float], sample_time: float) -> str | None:
    """One line that names the fastest rate and the remedy, or None where the clock is fast enough.

    Args:
        manifest: the model.
        values: every parameter by name, as the kernels take it.
        sample_time: T, s.
    """
    columns = {name: np.array([value]) for name, value in values.items()}
    found = {name: float(rate[0]) for name, rate in _rates(manifest, columns).items()}
    name, rate = max(found.items(), key=lambda item: item[1])
    if rate * sample_time <= LIMIT:
        return None
    best = f"a sample time of at most {LIMIT / rate:.2g} s"
    coupled = found.get(COUPLING, 0.0) >= 0.9 * rate
    if coupled:  # the errors are then as fast because of it
        name, rate = COUPLING, found[COUPLING]
    b_m = abs(leading(manifest, values))
    remedy = f'[design] input_scale = "auto", which is {b_m:.4g},' if coupled else "slower gains,"
    return (
        f"{name} is {rate:.3g} 1/s, {rate * sample_time:.2g} over a sample time of {sample_time:g} s, where "
        f"more than {LIMIT:g} may be unstable; use {remedy} or {best}"
    )


def paces(manifest: Manifest, columns: Columns, sample_times: Numbers) -> Numbers:
    """The fastest rate over the sample time of every run, to be compared with `LIMIT`; shape (runs,)."""
    return np.asarray(np.max(list(_rates(manifest, columns).values()), axis=0) * sample_times)


def deciding(manifest: Manifest) -> frozenset[str]:
    """Names of the parameters on which the rates depend."""
    gains = [name for name in positive_gains(manifest.rho) if name[0] == "c" and name[1:].isdigit()]
    others = {"e1", INPUT_SCALE, OBSERVER, *filter_gains(manifest.n)} & {*manifest.parameter_names}
    return frozenset({*gains} | others | _leading(manifest).names)


def leading(manifest: Manifest, values: Mapping[str, float]) -> float:
    """b_m at these values, every parameter by name."""
    return float(_b_m(manifest, {name: np.array([value]) for name, value in values.items()})[0])


def leading_terms(manifest: Manifest) -> ast.expr:
    """The syntax of b_m, an expression of parameters."""
    return _leading(manifest).trees[0]


def _b_m(manifest: Manifest, columns: Columns) -> Numbers:
    """b_m of every run, shape (runs,)."""
    found = np.asarray(evaluate(leading_terms(manifest), columns), dtype=np.float64)
    return np.broadcast_to(found, columns[INPUT_SCALE].shape)


def _leading(manifest: Manifest) -> Rule:
    (rule,) = (rule for rule in manifest.rules if rule.name in ("b_m", "b_m ... b_0"))
    return rule


def _rates(manifest: Manifest, columns: Columns) -> dict[str, Numbers]:
    """The rates that a clock must follow, 1/s, by name, each of shape (runs,); infinite where not finite."""
    if OBSERVER in columns:  # the law's poles are at -c_i
        poles = np.max([columns[f"c{i + 1}"] for i in range(manifest.rho)], axis=0)
        return {"the fastest pole of the law": poles, "the observer": columns[OBSERVER]}
    b_m, kappa = _b_m(manifest, columns), columns[INPUT_SCALE]
    with np.errstate(all="ignore"):
        coupling = np.abs(b_m) / kappa if manifest.rho > 1 else np.zeros_like(kappa)
        rates = {
            COUPLING: coupling,
            "the fastest rate of the errors z": _fastest(_errors(manifest, columns, b_m)),
            "the fastest pole of the filters": _fastest(_filters(manifest, columns)),
        }
    return {name: np.where(np.isfinite(rate), rate, np.inf) for name, rate in rates.items()}


def _errors(manifest: Manifest, columns: Columns, b_m: Numbers) -> Numbers:
    """The matrices of the z-dynamics, shape (runs, rho, rho)."""
    rho, kappa = manifest.rho, columns[INPUT_SCALE]
    matrix = np.zeros((len(kappa), rho, rho))
    for i in range(rho):
        matrix[:, i, i] = -columns[f"c{i + 1}"]
    matrix[:, 0, 0] -= columns["e1"]
    for i in range(1, rho):
        matrix[:, i - 1, i], matrix[:, i, i - 1] = (b_m, -b_m / kappa**2) if i == 1 else (1.0, -1.0)
    return matrix


def _filters(manifest: Manifest, columns: Columns) -> Numbers:
    """A0 of (14), shape (runs, n, n)."""
    n = manifest.n
    matrix = np.tile(np.eye(n, k=1), (len(columns[INPUT_SCALE]), 1, 1))
    for i, name in enumerate(filter_gains(n)):
        matrix[:, i, 0] = -columns[name]
    return matrix


def _fastest(matrices: Numbers) -> Numbers:
    """The largest magnitude of the eigenvalues of each matrix; infinite where an entry is not finite."""
    good = np.all(np.isfinite(matrices), axis=(1, 2))
    found = np.full(len(matrices), np.inf)
    if good.any():
        found[good] = np.abs(np.linalg.eigvals(matrices[good])).max(axis=1)
    return found
