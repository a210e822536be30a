"""Properties of every trajectory by theory: invariants of the closed loop.

errors        y - y_r = z_1 + r_1 at every instant                          to the rounding of four operations
estimation    without disturbance, x - x_hat = exp(A0 t) (x - x_hat)(0)     as epsilon' = A0 epsilon
              with an extended-state observer, 0 - f_hat is one entry more
limits        without disturbance, z(t) does not depend on u_max            z' does not contain u, but has
                                                                            y where d alpha_i / dy moves
no saturation with u_max out of reach, r = 0                                bit for bit
              from a matched start, r = exp(Ar t) r(0)

Of a design with estimates r is chi. Its estimation error is that with the true values of what is estimated,
its z depends on the limit through the estimates, and with a moving estimate of b_m only chi_2, chi_3, ...
decay linearly. Estimates with a range stay inside it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.chain import LAG
from pmjoint_codegen.check.inputs.quiet import quiet_document, start_away
from pmjoint_codegen.check.oracles import truth
from pmjoint_codegen.check.oracles.truth import frozen_truth
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, default_run
from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.identity import Document
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.estimates import estimate_columns, range_of
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.values import BRAKING, MATCHED
from pmjoint_derive import Derivation, Model
from pmjoint_derive.signals import partial_name

Array = npt.NDArray[np.float64]

OUT_OF_REACH = 1e9  # times the model's u_max
ROUNDOFF = 2.0**-53

Finding = tuple[str, float, float]  # what, figure, bound


def check(subject: Subject) -> GateResult:
    """Run the model with and without its disturbance and its limit, and check the runs against theory."""
    done = default_run(subject.compiled or subject.interpreted)
    sums = [errors_add_up(done)] if compensator_states(done.manifest) else []
    bare = subject.model.adaptation is None and errors_are_alone(subject.derivation)
    quiet = quiet_findings(quiet_evaluator(subject), bare=bare, model=quiet_model(subject))
    return judge([*sums, *estimates_stay(done), *quiet])


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
    document, zeros = _quiet_document(subject), ("0",) * subject.manifest.n
    source = Source(subject.file, document, kind, disturbance=zeros, environment=subject.environment)
    return evaluator_of(source, subject.notify)


def quiet_model(subject: Subject) -> Model:
    """The model whose evaluator `quiet_evaluator` gives."""
    document = _quiet_document(subject)
    if document is subject.document:
        return subject.model
    from pmjoint_codegen.modelfile import model_of  # slow to import

    return model_of(document, str(subject.file))


def _quiet_document(subject: Subject) -> Document:
    """The model file, or where its disturbance cannot be replaced, that of its design's plant."""
    document = subject.document
    if "joint" in document or LAG in subject.manifest.chain:
        return quiet_document(subject.derivation, subject.manifest, document)
    return document


def errors_add_up(run: Run) -> Finding:
    """``e = z_1 + r_1``: both sides from the same numbers, e by one subtraction and z_1 by two."""
    r1 = _names(run.manifest)[0]
    sizes = np.abs(run["y"]) + np.abs(run["y_r"]) + np.abs(run[r1]) + np.abs(run["z1"])
    error = np.abs(run["e"] - (run["z1"] + run[r1]))
    bound = 4 * ROUNDOFF * sizes
    worst = int(np.argmax(error - bound))
    return f"e = z1 + {r1}", float(error[worst]), float(bound[worst])


def estimates_stay(run: Run) -> list[Finding]:
    """``low < estimate < high`` of every estimate with a range, as its place from -1 to 1."""
    values, manifest = run.settings.parameters, run.manifest
    found = []
    for item in estimate_columns(manifest):
        ends = range_of(item.name, values)
        if ends is not None:
            low, high = ends
            beyond = np.maximum(low - run[item.name], run[item.name] - high)
            place = float(1 + 2 * np.max(beyond) / (high - low))
            found.append((f"{item.name} in its range", place, 1 - ROUNDOFF))
    return found


def quiet_findings(evaluator: Evaluator, *, bare: bool = True, model: Model | None = None) -> list[Finding]:
    """Invariants of the loop without disturbance.

    Args:
        evaluator: of that loop.
        bare: whether z depends on nothing else, see `errors_are_alone`.
        model: of that loop; needed if it has an adaptive controller.
    """
    manifest = evaluator.manifest
    values = {item.name: item.value for item in manifest.parameters}
    limits = {name: values[name] for name in manifest.limit_parameters}
    known, x0 = dict[str, float](), None
    if model is not None and model.adaptation is not None:
        known, x0 = frozen_truth(model, values), start_away(model, manifest)
    run, wider, free = (
        default_run(evaluator, known | _wider(limits, factor), x0=x0) for factor in (1.0, 2.0, OUT_OF_REACH)
    )
    found = [undriven(evaluator, free)] if compensator_states(manifest) else []
    found += estimates_stay(run)
    done = run.status == wider.status == Status.DONE
    if bare and done and run.settings.parameters["compensator"] == 1:
        z = [np.column_stack([one[f"z{i + 1}"] for i in range(manifest.rho)]) for one in (run, wider, free)]
        scale = float(max(1.0, np.max(np.abs(z[0]))))
        gap = max(float(np.max(np.abs(z[0] - other))) for other in z[1:])
        found.append(("z does not depend on u_max", gap / scale, ACCURACY))
    gap = estimation_gap(evaluator, run, model)
    return [*found, ("x - x_hat = exp(A0 t) (x - x_hat)(0)", gap, ACCURACY)]


def undriven(evaluator: Evaluator, run: Run) -> Finding:
    """What (23) does where nothing is clipped: it stays at 0, or decays from its matched start.

    With braking r_1 is no linear function, and r_2 alone decays as the last entry of its hold's matrix says.
    Of chi_1' = b_hat chi_2 - ck_1 chi_1 only the others are linear, unless there are none.
    """
    r, what = _block(run, "r"), _names(run.manifest)[0].removesuffix("1")
    if run.settings.start != MATCHED:
        return f"u_max out of reach gives {what} = 0", float(np.max(np.abs(r))), 0.0
    if "Theta" in run.manifest.blocks:
        ck = [run.settings.parameters[f"ck{i}"] for i in range(1, r.shape[1] + 1)]
        Ar = np.diag(-np.array(ck)) + np.eye(len(ck), k=1)
        first = 1 if len(ck) > 1 else 0
        Ar, r = Ar[first:, first:], r[:, first:]
    else:
        (Ar,) = evaluator.call("compensator_matrix", run.settings.p)
    if BRAKING in run.settings.parameters:
        Ar, r = Ar[-1:], r[:, -1:]
    Ar = Ar.reshape(r.shape[1], r.shape[1])
    gap = float(np.max(np.abs(r - _decayed(Ar, r[0], run.t))))
    claim = f"u_max out of reach gives {what} = exp(Ar t) {what}(0)"
    return claim, gap / max(1.0, float(np.max(np.abs(r)))), ACCURACY


def _wider(limits: Mapping[str, float], factor: float) -> dict[str, float]:
    """Limits of u further away: one times the factor, two that may be 0 by multiples of their distance."""
    if len(limits) == 1:
        return {name: limit * factor for name, limit in limits.items()}
    (lower, least), (upper, most) = limits.items()
    more = (factor - 1.0) * (most - least)
    return {lower: least - more, upper: most + more}


def estimation_gap(evaluator: Evaluator, run: Run, model: Model | None = None) -> float:
    """Largest distance of the estimation error from its exact solution, relative to the state's size."""
    epsilon, observed = estimation_errors(run), _block(run, "xi")
    if model is not None and model.adaptation is not None:
        epsilon = truth.estimation_errors(run, model)
    if observed.shape[1] > run.manifest.n:  # of an observer whose last state is a disturbance, here 0
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


def _names(manifest: Manifest) -> tuple[str, ...]:
    """Names of the compensator's states: r1, r2, ... or chi1, chi2, ..."""
    return tuple(item.name for item in manifest.states[slice(*manifest.blocks["r"])])


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
