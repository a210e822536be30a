"""The Lyapunov function V along the default run against (35).

From row to row, h apart, ``V <= V_0 exp(-f h) + (Y/f) (1 - exp(-f h))``: (35), integrated.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.check.gates.invariants import estimation_errors
from pmjoint_codegen.check.gates.proof import design_values
from pmjoint_codegen.check.oracles.certificate import Certificate, certify
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, default_run
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run

Array = npt.NDArray[np.float64]

ROUNDOFF = 2.0**-53


def check(subject: Subject) -> GateResult:
    """Check V along the default run against (35) with the model's bound of the disturbance, or the run's."""
    if not subject.derivation.design.certifies:
        return not_run("the law comes without a certificate")
    if not subject.model.gains.compensator:
        return not_run("the certificate is that of the loop with compensator")
    evaluator, stated = subject.compiled or subject.interpreted, subject.model.disturbance_bound
    run = default_run(evaluator)
    if run.status != Status.DONE:
        return failed(f"the run ended early: {run.message}")
    largest = float(np.max(np.linalg.norm(disturbances(evaluator, run), axis=1)))
    if stated is not None and largest > stated * (1 + 4 * ROUNDOFF):
        return failed("the disturbance exceeds the model's disturbance_bound", largest, stated)
    bound = largest if stated is None else stated
    return decrease(run, certify(subject.derivation, design_values(subject.derivation), bound))


def disturbances(evaluator: Evaluator, run: Run) -> Array:
    """D of (12) along a run, shape (rows, n)."""
    limits = evaluator.call("actuation", run.settings.p)[0].reshape(-1, 4)
    w = np.clip(limits[:, 0] + limits[:, 1] * run["v"][:, np.newaxis], limits[:, 2], limits[:, 3])
    x = run.states[:, : run.manifest.nx]
    return evaluator.call("disturbance", run.t[:, np.newaxis], x, w, run.settings.p)[0]


def decrease(run: Run, certificate: Certificate) -> GateResult:
    """Check V of every row against the bound of (35) from the previous row.

    Args:
        run: the run.
        certificate: f, Y and P.
    """
    V = energy(run, certificate)
    falling = np.exp(-certificate.f * np.diff(run.t))
    allowed = V[:-1] * falling + (certificate.Y or 0.0) / certificate.f * (1 - falling)
    allowed += ACCURACY * (1 + V[:-1])  # the accuracy of the trajectory itself
    ratio = V[1:] / allowed
    ratio[_begins_anew(run)] = 0.0
    row = int(np.argmax(ratio))
    detail = f"largest V / what (35) allows, row to row; V goes from {V[0]:.4g} to {V[-1]:.3g}"
    if ratio[row] <= 1:
        return passed(detail, float(ratio[row]), 1)
    point, values = f"t={float(run.t[row + 1])!r} s", (repr(float(allowed[row])), repr(float(V[row + 1])))
    return failed(detail, float(ratio[row]), 1, Difference("run", "V", point, *values, "", ""))


def _begins_anew(run: Run) -> npt.NDArray[np.bool_]:
    """Which rows follow a break point of a reference without a filter: where that jumps, V begins anew."""
    reference = run.settings.reference
    if reference is None or reference.command.filter is not None:
        return np.zeros(len(run.t) - 1, dtype=bool)
    return np.asarray(np.diff(reference.places(run.t)) > 0)


def energy(run: Run, certificate: Certificate) -> Array:
    """V (30) at every row, shape (rows,)."""
    columns = {f"z{i}": run[f"z{i}"] for i in range(1, run.manifest.rho + 1)}
    columns |= {f"epsilon{i}": column for i, column in enumerate(estimation_errors(run).T, start=1)}
    V = sp.lambdify(list(columns), certificate.V, "numpy")
    return np.asarray(V(*columns.values()), dtype=np.float64)
