"""V of a design with estimates along runs: with what bounds its rate, and against its exact rate.

column        the run's own V is that of the plant's true values                       P by SciPy
bound         V <= V_0 exp(-f h) + (Y/f) (1 - exp(-f h)) from row to row; f = 0 where nothing pulls the
              estimates, and then V grows by Y h at most
decrease      without disturbance and leakage, V never grows, through saturation too
rate          and falls by just what (I) says, integrated from row to row:

    V' = -sum c_i w_i z_i^2 - sum e_i (w_i s_i z_i)^2 - (sum w_i s_i z_i) epsilon_2 - sum |epsilon|^2/e_i

with ``s_1 = -1`` and ``s_i = d alpha_{i-1}/dy``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.gates.invariants import Finding, judge, quiet_evaluator, quiet_model
from pmjoint_codegen.check.inputs.quiet import start_away
from pmjoint_codegen.check.oracles import truth
from pmjoint_codegen.check.result import GateResult, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, default_run, exact_run
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_derive import Model
from pmjoint_derive.closed_loop import output_disturbance

Array = npt.NDArray[np.float64]

ROUNDOFF: Final = 2.0**-53
WINDOW: Final = 2.0  # s in which the rate is integrated; transients and saturation are early
PER_POLE: Final = 200  # rows in the shortest time constant of the filters and of the errors
MOST_ROWS: Final = 200_000
QUADRATURE: Final = 1e-6  # of V(0): error of Simpson's rule on these rows, where switches leave kinks


def check(subject: Subject) -> GateResult:
    """Judge V along the model's own run, and along one without disturbance and leakage."""
    model, evaluator = subject.model, subject.compiled or subject.interpreted
    reason = no_claim(model, evaluator.manifest)
    if reason:
        return not_run(reason)
    run = default_run(evaluator)
    if run.status != Status.DONE:
        return failed(f"the run ended early: {run.message}")
    quiet, quiet_one = quiet_evaluator(subject), quiet_model(subject)
    still = quiet_run(quiet, quiet_one)
    if still.status != Status.DONE:
        return failed(f"the run without disturbance ended early: {still.message}")
    disturbs_y = output_disturbance(subject.derivation.design) != 0
    findings = [
        *column(run, model),
        bound(run, model, _largest_disturbance(subject, evaluator, run), disturbs_y=disturbs_y),
        decrease(still, quiet_one),
        rate(quiet, quiet_one),
    ]
    V = truth.energy(still, quiet_one)
    note = (
        f"without disturbance and leakage V goes from {V.total[0]:.8g} (V_z {V.errors[0]:.8g}, "
        f"V_Theta {V.estimates[0]:.8g}, V_epsilon {V.estimation[0]:.8g}) to {V.total[-1]:.5g}, "
        f"with {len(still.switches)} switches of saturation"
    )
    return judge(findings, note)


def no_claim(model: Model, manifest: Manifest) -> str:
    """Why V of a model means nothing, or nothing.

    Args:
        model: the model.
        manifest: has the values of its parameters.
    """
    adaptation = model.adaptation
    assert adaptation is not None
    values = {item.name: item.value for item in manifest.parameters}
    if adaptation.least_squares is not None:
        return "least squares has no V that decreases; the gate proof has the rate of V_z"
    beyond = truth.outside(model, values)
    if beyond:
        return f"V has no meaning: the true value of {', '.join(beyond)} is outside its range"
    true = truth.true_theta(model, values)
    stuck = [
        entry.name
        for entry in adaptation.unknown
        if not values[entry.gamma.name] > 0 and values[entry.guess_symbol.name] != true[entry.place]
    ]
    if stuck:
        return f"V does not decrease: {', '.join(stuck)} is wrong and has the gain 0"
    return ""


def quiet_run(
    evaluator: Evaluator, model: Model, horizon: float | None = None, output_step: float | None = None
) -> Run:
    """A run without leakage, whose guesses that are never corrected are right.

    Args:
        evaluator: of the loop without disturbance.
        model: of it.
        horizon: another one than the model's, s.
        output_step: likewise, s.
    """
    manifest = evaluator.manifest
    values = {item.name: item.value for item in manifest.parameters}
    settings = {name: 0.0 for name in values if name in ("leakage", "rho_leakage")}
    settings |= truth.frozen_truth(model, values)
    made = make_settings(
        manifest,
        parameters=manifest.written(settings),
        x0=start_away(model, manifest),
        horizon=horizon,
        output_step=output_step,
        controller="continuous",
    )
    return exact_run(evaluator, made)


def _largest_disturbance(subject: Subject, evaluator: Evaluator, run: Run) -> float:
    """|D| along the run, what frozen guesses take wrong included; or the file's bound, if it is greater."""
    limits = evaluator.call("actuation", run.settings.p)[0].reshape(-1, 4)
    w = np.clip(limits[:, 0] + limits[:, 1] * run["v"][:, np.newaxis], limits[:, 2], limits[:, 3])
    x = run.states[:, : run.manifest.nx]
    D = evaluator.call("disturbance", run.t[:, np.newaxis], x, w, run.settings.p)[0]
    return max(float(np.max(np.linalg.norm(D, axis=1))), subject.model.disturbance_bound or 0.0)


def column(run: Run, model: Model) -> list[Finding]:
    """The run's own V, if it has one, against V of the true values."""
    if "V" not in {item.name for item in run.manifest.signals}:
        return []
    V = truth.energy(run, model).total
    gap = np.abs(run["V"] - V) / (1 + V)
    return [("column V is V of the true values", _largest(gap), ACCURACY)]


def bound(run: Run, model: Model, D_max: float, *, disturbs_y: bool) -> Finding:
    """V of every row against the bound from the previous row, as their largest quotient."""
    f, Y = truth.decay(model, run.settings.parameters, D_max, disturbs_y=disturbs_y)
    V, h = truth.energy(run, model).total, np.diff(run.t)
    gained = Y * h if f == 0 else Y / f * -np.expm1(-f * h)
    allowed = V[:-1] * np.exp(-f * h) + gained + ACCURACY * (1 + V[:-1])
    return f"V / what -f V + Y allows, f = {f:.3g}, Y = {Y:.4g}", _largest(V[1:] / allowed), 1.0


def decrease(run: Run, model: Model) -> Finding:
    """Largest growth of V from row to row, relative to 1 + V."""
    V = truth.energy(run, model).total
    growth = np.diff(V) / (1 + V[:-1])
    return "V does not grow without disturbance and leakage", max(0.0, _largest(growth)), ACCURACY


def rate(evaluator: Evaluator, model: Model) -> Finding:
    """How far V is from what (I) says along a run of closely spaced rows, relative to V(0)."""
    manifest = evaluator.manifest
    values = {item.name: item.value for item in manifest.parameters}
    speeds = [*np.abs(np.linalg.eigvals(truth.filter_matrix(manifest.n, values)))]
    speeds += [values[f"c{i}"] for i in range(1, manifest.rho + 1)]
    horizon = min(WINDOW, manifest.simulation.horizon)
    step = max(1 / (PER_POLE * float(max(speeds))), horizon / MOST_ROWS)
    return fall(evaluator, quiet_run(evaluator, model, horizon, step), model)


def fall(evaluator: Evaluator, run: Run, model: Model) -> Finding:
    """How far V of a run is from its start and the integral of its rate by (I), relative to V(0)."""
    V, slope = truth.energy(run, model).total, rates(evaluator, run, model)
    gap = np.abs(V - V[0] - _integral(run.t, slope)) / max(V[0], 1.0)
    return "V falls as (I) says", _largest(gap), QUADRATURE


def rates(evaluator: Evaluator, run: Run, model: Model) -> Array:
    """V' by (I) at every row, shape (rows,)."""
    manifest, values = run.manifest, run.settings.parameters
    rho, p = manifest.rho, np.broadcast_to(run.settings.p, (len(run.t), len(run.settings.p)))
    y_r = evaluator.call("reference", run.t[:, np.newaxis], p)[0]
    s = run.states[:, manifest.nx :]
    dalpha = evaluator.call("partials", run["y"][:, np.newaxis], s, y_r, p)[0]
    places = {name: i for i, name in enumerate(manifest.partials)}
    epsilon, weights = truth.estimation_errors(run, model), truth.weights(values, rho)
    total, unknown = np.zeros(len(run.t)), np.zeros(len(run.t))
    for i in range(1, rho + 1):
        z, name = run[f"z{i}"], f"dalpha{i - 1}_dy"
        slope = np.full(len(z), -1.0) if i == 1 else np.zeros(len(z))
        if i > 1 and name in places:
            slope = dalpha[:, places[name]]
        moved = weights[i - 1] * slope * z
        total -= values[f"c{i}"] * weights[i - 1] * z**2 + values[f"e{i}"] * moved**2
        total -= np.sum(epsilon**2, axis=1) / values[f"e{i}"]
        unknown += moved
    return total - unknown * (epsilon[:, 1] if manifest.n > 1 else 0.0)


def _integral(t: Array, values: Array) -> Array:
    """The integral from the start to every row, by Simpson's rule."""
    from scipy.integrate import cumulative_simpson  # slow to import

    found: Array = cumulative_simpson(values, x=t, initial=0.0)
    return found


def _largest(values: Array) -> float:
    """The largest of some numbers; infinite if one is none."""
    return float(np.max(np.where(np.isnan(values), np.inf, values)))
