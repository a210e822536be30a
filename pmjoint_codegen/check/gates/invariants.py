"""Properties of every trajectory by theory: invariants of the closed loop.

errors        y - y_r = z_1 + r_1 at every instant                          to the rounding of four operations
estimation    without disturbance, x - x_hat = exp(A0 t) (x - x_hat)(0)     as epsilon' = A0 epsilon
              with an extended-state observer, 0 - f_hat is one entry more
limits        without disturbance, z(t) does not depend on u_max            z' does not contain u, but has
                                                                            y where d alpha_i / dy moves
no saturation with u_max out of reach, r = 0                                bit for bit
              from a matched start, r = exp(Ar t) r(0)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.chain import LAG
from pmjoint_codegen.check.inputs.quiet import quiet_document
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, default_run
from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.values import BRAKING, MATCHED
from pmjoint_derive import Derivation
from pmjoint_derive.signals import partial_name

Array = npt.NDArray[np.float64]

OUT_OF_REACH = 1e9  # times the model's u_max
ROUNDOFF = 2.0**-53

Finding = tuple[str, float, float]  # what, figure, bound


def check(subject: Subject) -> GateResult:
    """Run the model with and without its disturbance and its limit, and check the runs against theory."""
    found = default_run(subject.compiled or subject.interpreted)
    findings = [errors_add_up(found)] if compensator_states(found.manifest) else []
    quiet = quiet_evaluator(subject)
    return judge([*findings, *quiet_findings(quiet, bare=errors_are_alone(subject.derivation))])


def errors_are_alone(derivation: Derivation) -> bool:
    """Whether nothing but z moves in the rates (27), (28): every ``d alpha_i / dy`` is constant."""
    s = derivation.signals
    slopes = (partial_name(alpha, s.y) for alpha in s.alpha)
    known = (derivation.expanded(name) for name in slopes if name in derivation.equations)
    return all(not slope.free_symbols & set(s.measurable) for slope in known)


def quiet_evaluator(subject: Subject) -> Evaluator:
    """The same closed loop without disturbance, derived into the cache.

    The plant of a joint, or behind a lag, is then that of the design.

    Raises:
        PmjointError: it cannot be derived or built.
    """
    kind = "compiled" if subject.compiler else "interpreted"
    document, zeros = subject.document, ("0",) * subject.manifest.n
    if "joint" in document or LAG in subject.manifest.chain:
        document = quiet_document(subject.derivation, subject.manifest, document)
    source = Source(subject.file, document, kind, disturbance=zeros, environment=subject.environment)
    return evaluator_of(source, subject.notify)


def errors_add_up(run: Run) -> Finding:
    """``e = z_1 + r_1``: both sides from the same numbers, e by one subtraction and z_1 by two."""
    sizes = np.abs(run["y"]) + np.abs(run["y_r"]) + np.abs(run["r1"]) + np.abs(run["z1"])
    error = np.abs(run["e"] - (run["z1"] + run["r1"]))
    bound = 4 * ROUNDOFF * sizes
    worst = int(np.argmax(error - bound))
    return "e = z1 + r1", float(error[worst]), float(bound[worst])


def quiet_findings(evaluator: Evaluator, *, bare: bool = True) -> list[Finding]:
    """Invariants of the loop without disturbance.

    Args:
        evaluator: of that loop.
        bare: whether z depends on nothing else, see `errors_are_alone`.
    """
    manifest = evaluator.manifest
    values = {item.name: item.value for item in manifest.parameters}
    limits = {name: values[name] for name in manifest.limit_parameters}
    run, wider, free = (default_run(evaluator, _wider(limits, factor)) for factor in (1.0, 2.0, OUT_OF_REACH))
    found = [undriven(evaluator, free)] if compensator_states(manifest) else []
    done = run.status == wider.status == Status.DONE
    if bare and done and run.settings.parameters["compensator"] == 1:
        z = [np.column_stack([one[f"z{i + 1}"] for i in range(manifest.rho)]) for one in (run, wider, free)]
        scale = float(max(1.0, np.max(np.abs(z[0]))))
        gap = max(float(np.max(np.abs(z[0] - other))) for other in z[1:])
        found.append(("z does not depend on u_max", gap / scale, ACCURACY))
    return [*found, ("x - x_hat = exp(A0 t) (x - x_hat)(0)", estimation_gap(evaluator, run), ACCURACY)]


def undriven(evaluator: Evaluator, run: Run) -> Finding:
    """What (23) does where nothing is clipped: it stays at 0, or decays from its matched start.

    With braking r_1 is no linear function, and r_2 alone decays as the last entry of its hold's matrix says.
    """
    r = _block(run, "r")
    if run.settings.start != MATCHED:
        return "u_max out of reach gives r = 0", float(np.max(np.abs(r))), 0.0
    (Ar,) = evaluator.call("compensator_matrix", run.settings.p)
    if BRAKING in run.settings.parameters:
        Ar, r = Ar[-1:], r[:, -1:]
    Ar = Ar.reshape(r.shape[1], r.shape[1])
    gap = float(np.max(np.abs(r - _decayed(Ar, r[0], run.t))))
    return "u_max out of reach gives r = exp(Ar t) r(0)", gap / max(1.0, float(np.max(np.abs(r)))), ACCURACY


def _wider(limits: Mapping[str, float], factor: float) -> dict[str, float]:
    """Limits of u further away: one times the factor, two that may be 0 by multiples of their distance."""
    if len(limits) == 1:
        return {name: limit * factor for name, limit in limits.items()}
    (lower, least), (upper, most) = limits.items()
    more = (factor - 1.0) * (most - least)
    return {lower: least - more, upper: most + more}


def estimation_gap(evaluator: Evaluator, run: Run) -> float:
    """Largest distance of the estimation error from its exact solution, relative to the state's size."""
    epsilon, observed = estimation_errors(run), _block(run, "xi")
    if (
        observed.shape[1] > run.manifest.n
    ):  # of an observer whose last state is a disturbance, which is 0 here
        epsilon = np.column_stack([epsilon, -observed[:, -1]])
    size = epsilon.shape[1]
    A0 = evaluator.call("filter_matrix", run.settings.p)[0].reshape(size, size)
    exact = _decayed(A0, epsilon[0], run.t)
    scale = max(1.0, float(np.max(np.abs(run.states[:, : run.manifest.nx]))))
    return float(np.max(np.abs(epsilon - exact))) / scale


def _decayed(A: Array, start: Array, t: Array) -> Array:
    """``exp(A t) start`` at some instants, shape (instants, size)."""
    poles, vectors = np.linalg.eig(A + 0j)
    if np.linalg.cond(vectors) > 1e6:  # coinciding poles: step by step, each a small power series
        return _stepped(A, start, t)
    weights = np.linalg.solve(vectors, start)
    return np.real((np.exp(np.outer(t, poles)) * weights) @ vectors.T)


def _stepped(A0: Array, start: Array, t: Array) -> Array:
    rows, halvings = [start], 12
    for step in np.diff(t):
        term = total = np.eye(len(A0))
        for k in range(1, 20):
            term = term @ (A0 * step / 2**halvings) / k
            total = total + term
        for _ in range(halvings):
            total = total @ total
        rows.append(total @ rows[-1])
    return np.array(rows)


def estimation_errors(run: Run) -> Array:
    """``x - x_hat``, shape (rows, n)."""
    columns = range(1, run.manifest.n + 1)
    return np.column_stack([run[f"x{i}"] - run[f"x_hat{i}"] for i in columns])


def _block(run: Run, name: str) -> Array:
    first, last = run.manifest.blocks[name]
    return run.states[:, first:last]


def judge(findings: list[Finding], *notes: str) -> GateResult:
    """One result from several findings, showing the worst."""
    broken = [item for item in findings if not item[1] <= item[2]]
    lines = (*(f"{what}: {figure:.2e}, bound {bound:.2e}" for what, figure, bound in findings), *notes)
    if broken:
        what, figure, bound = broken[0]
        difference = Difference("run", what, "", "", "", f"{figure:.3g}", f"{bound:.3g}")
        return failed(what, figure, bound, difference, lines)
    what, figure, bound = max(findings, key=lambda item: item[1] / item[2] if item[2] > 0 else 0.0)
    return passed(f"{what}, and {len(findings) - 1} more", figure, bound, *lines)
