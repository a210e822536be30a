"""The exported C in closed loop against `simulate --controller sampled`, over the model's own run.

The plant is integrated as `simulate` does it, once with the kernels' law and once with the exported
controller in the loop. The two differ by rounding errors alone. What these may become is derived: each sample
adds at most its own error bounds, of the exported statements, of the kernels' instructions and of the plant's
step; and the loop's linearised sampled map, differentiated exactly along the run, carries each of them to
every later sample. The bound at a sample is the sum of their magnitudes there. It is of first order: what it
leaves out is the square of a difference of some 1e-12.

Where a kink of the plant, a quantised reading or a clock makes the map discontinuous, no such bound exists
and the gate does not run; the gate `export` judges every single sample of such a model too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from pmjoint_codegen.check.gates.exported import SAMPLES, begin, load, local_errors
from pmjoint_codegen.check.oracles.driven import DrivenRun, drive
from pmjoint_codegen.check.oracles.error_bound import walk
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.check.oracles.rounding import ROUNDOFF
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.export.bounds import Bounded, relative
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.export.twin import bounded_arithmetic
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.loops.chain import is_looped
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.samples import Recorded, run_settings
from pmjoint_codegen.values import MATCHED, STARTS

STRIDE: Final = 20  # samples from one compared instant to the next
_FINER: Final = 4  # pieces of a hold for each step that the run takes in it, where it takes several
_MAP: Final = 1e-6  # largest miss of the map that is differentiated, relative to max(1, |x|)
_SECOND_ORDER: Final = 1.0 + 2.0**-10


@dataclass(frozen=True)
class Sensitivity:
    """The linearised sampled map along a run: deviations of X = (x, s) from one sample to the next.

    Attributes:
        dX: shape (rows - 1, nX, nX).
        dv: of the next X in an error of v, shape (rows - 1, nX).
        dw: of the next X in errors of w, shape (rows - 1, nX, nw).
        v_X: of v in X, shape (rows, nX).
    """

    dX: Array
    dv: Array
    dw: Array
    v_X: Array


def check(subject: Subject) -> GateResult:
    """Run the loop with the exported controller from both starts, and compare."""
    if subject.compiler is None or subject.compiled is None:
        return not_run("no C compiler")
    if not subject.derivation.design.exact_hold:
        return not_run(f'law = "{subject.model.design}" is not exported')
    if why := _without_bound(subject.manifest):
        return not_run(
            f"{why}: rounding errors have no first-order bound; the gate export judges each sample"
        )
    return judge(load(subject, subject.compiler), subject.compiled, subject.tapes)


def judge(
    loaded: Exported, evaluator: Evaluator, tapes: Mapping[str, Tape], samples: int = SAMPLES
) -> GateResult:
    """Compare the closed loop with a loaded controller with runs of the kernels.

    Args:
        loaded: the controller.
        evaluator: of the kernels.
        tapes: their instructions.
        samples: of a run, at most.
    """
    worst, difference, apart, room, instants = 0.0, None, 0.0, 0.0, 0
    for start in STARTS:
        recorded = begin(loaded, evaluator, start, samples)
        if isinstance(recorded, str):
            return failed(recorded)
        driven = drive(loaded, evaluator, run_settings(evaluator.manifest, start, samples))
        if isinstance(driven, str):
            return failed(f"{start} start: {driven}")
        if driven.steps != recorded.steps:
            return failed(f"{driven.steps} steps of the plant, {recorded.steps} in the run, {start} start")
        bounds = bounds_of(loaded, recorded, tapes, evaluator.manifest, matched=start == MATCHED)
        if isinstance(bounds, str):
            return failed(f"{start} start: {bounds}")
        ratio, found = _compared(loaded, evaluator.manifest, driven, recorded, bounds, start)
        instants += len(bounds)
        largest = float(np.max(np.abs(recorded.x[:, 0])))
        apart = max(apart, float(np.max(np.abs(driven.x[:, 0] - recorded.x[:, 0]))) / largest)
        room = max(room, float(np.max(bounds[:, 0])) / largest)
        if ratio >= worst:
            worst, difference = ratio, found
    told = f"y stays within {apart:.2g} of its largest magnitude in the loop; its bound is {room:.2g}"
    detail = f"largest difference of the closed loop / derived bound, at {instants} samples"
    if worst > 1.0:
        return failed(detail, worst, 1.0, difference, findings=(told,))
    return passed(detail, worst, 1.0, told)


def _without_bound(manifest: Manifest) -> str:
    """Why a model's loop has no first-order bound, or nothing."""
    if manifest.kinks:
        return "the plant has kinks"
    return "the loop has a sensor, an actuator or a clock of its own" if is_looped(manifest) else ""


def _compared(
    loaded: Exported, manifest: Manifest, driven: DrivenRun, recorded: Recorded, bounds: Array, start: str
) -> tuple[float, Difference | None]:
    """The largest difference relative to its bound, and where it is."""
    names = [*(item.name for item in manifest.states), "v", "u"]
    found = np.column_stack([driven.x, driven.s, driven.v, driven.u])[::STRIDE]
    expected = np.column_stack([recorded.x, recorded.s, recorded.v, recorded.u])[::STRIDE]
    error = np.abs(found - expected)
    ratio = relative(error, bounds)
    row, column = (int(i) for i in np.unravel_index(np.argmax(ratio), ratio.shape))
    place = f"{start} start, sample {row * STRIDE}"
    figures = (repr(float(expected[row, column])), repr(float(found[row, column])))
    sizes = (f"{error[row, column]:.3g}", f"{bounds[row, column]:.3g}")
    name = f"closed loop of {loaded.export.identity.prefix}"
    return float(ratio[row, column]), Difference(name, names[column], place, *figures, *sizes)


def bounds_of(
    loaded: Exported, recorded: Recorded, tapes: Mapping[str, Tape], manifest: Manifest, *, matched: bool
) -> Array | str:
    """Bounds on x, s, v and u at every `STRIDE`-th sample; or why there are none.

    Args:
        loaded: the controller.
        recorded: the run along which errors are carried.
        tapes: the kernels' instructions.
        manifest: the model.
        matched: whether the run starts matched.

    Returns:
        Shape (instants, nX + 2).
    """
    rows = len(recorded.v) - 1
    T = manifest.simulation.sample_time
    pieces = 1 if recorded.steps <= rows else _FINER * -(-recorded.steps // rows)
    found = sensitivity(tapes, recorded, T, manifest, pieces)
    if isinstance(found, str):
        return found
    s_error, v_error = local_errors(loaded.export, recorded, tapes, matched=matched)
    w_error = 4.0 * ROUNDOFF * np.abs(recorded.w[:rows])
    w_error[:, 0] = 0.0  # u: both sides clip v to the same limits
    x_error = 2.0 * pieces * plant_error(tapes["plant_taylor"], recorded, T, manifest)
    local = np.hstack([x_error, s_error])
    local = local + np.abs(found.dv) * v_error[:rows, np.newaxis]
    local = local + np.einsum("kij,kj->ki", np.abs(found.dw), w_error)
    first = np.zeros(local.shape[1])
    if matched:
        first[recorded.x.shape[1] :] = start_error(loaded, recorded, tapes)
    X, v = carried(found, local, first)
    u = v + v_error[::STRIDE]
    return np.column_stack([X, u, u]) * _SECOND_ORDER


def sensitivity(
    tapes: Mapping[str, Tape], recorded: Recorded, T: float, manifest: Manifest, pieces: int
) -> Sensitivity | str:
    """Differentiate the sampled map at every sample of a run; or say where it is not the run's own."""
    step = _map(tapes, T, manifest, pieces)
    n, rows = manifest.nX, len(recorded.v)
    X = np.hstack([recorded.x, recorded.s])
    h = np.tile(recorded.hold, (rows, 1))
    given = [recorded.t[:, np.newaxis], X, recorded.y_r, h, recorded.p]
    following, *found = (np.asarray(item.full()) for item in step.map(rows)(*(item.T for item in given)))
    miss = np.abs(following.T[:-1] - X[1:]) / np.maximum(1.0, np.abs(X[1:]))
    if not np.max(miss) <= _MAP:
        place = np.unravel_index(np.argmax(miss), miss.shape)
        return f"the differentiated map misses {manifest.states[place[1]].name} by {np.max(miss):.2g}"
    full, v_X = (item.reshape(len(item), rows, -1).swapaxes(0, 1) for item in found)
    return Sensitivity(full[:-1, :, :n], full[:-1, :, n], full[:-1, :, n + 1 :], v_X[:, 0])


def _map(tapes: Mapping[str, Tape], T: float, manifest: Manifest, pieces: int) -> ca.Function:
    """X at the next sample, its derivatives in (X, error of v, errors of w), and those of v in X.

    The same instructions as in the run: the law, the limits, the update, and the plant's Taylor polynomial of
    the order of a short hold, over each piece of it.
    """
    law, update, actuation, plant = (
        rebuild(tapes[name]) for name in ("law", "sampled_update", "actuation", "plant_taylor")
    )
    nx, n = manifest.nx, manifest.nX
    t, X = ca.SX.sym("t"), ca.SX.sym("X", n)
    y_r, p = (ca.SX.sym(name, law.size1_in(name)) for name in ("y_r", "p"))
    h = ca.SX.sym("h", update.size1_in("h"))
    limits = ca.reshape(actuation(p), 4, -1)
    dv, dw = ca.SX.sym("dv"), ca.SX.sym("dw", limits.size2())
    v = law(X[0], X[nx:], y_r, p)[2]
    told = limits[0, :] + limits[1, :] * (v + dv)
    w = ca.fmin(ca.fmax(told, limits[2, :]), limits[3, :]).T
    s_next = update(X[0], X[nx:], y_r, w[0] + dw[0], v + dv, h, p)
    x, size = X[:nx], T / pieces
    channels = nx + 1 + len(manifest.kinks)
    for piece in range(pieces):
        c = ca.reshape(plant(t + piece * size, x, w + dw, p), channels, -1)[:nx, : manifest.hold_order + 1]
        x = ca.mtimes(c, ca.DM([size**k for k in range(c.size2())]))
    following = ca.vertcat(x, s_next)
    moved = ca.vertcat(X, dv, dw)
    derivatives = [ca.densify(ca.jacobian(following, moved)), ca.densify(ca.jacobian(v, X))]
    still = [ca.substitute(item, ca.vertcat(dv, dw), 0.0) for item in (ca.densify(following), *derivatives)]
    return ca.Function("sampled_map", [t, X, y_r, h, p], still)


def plant_error(tape: Tape, recorded: Recorded, T: float, manifest: Manifest) -> Array:
    """Bound on the rounding errors of x over each hold, one step of it: shape (rows - 1, nx)."""
    rows, channels = len(recorded.v) - 1, manifest.nx + 1 + len(manifest.kinks)
    given = [recorded.t[:rows, np.newaxis], recorded.x[:rows], recorded.w[:rows], recorded.p[:rows]]
    (c,) = walk(tape, given, literal_roundings=4 + manifest.plant_order)
    value, error = (item.reshape(rows, -1, channels)[:, :, : manifest.nx] for item in (c.value, c.error))
    powers = T ** np.arange(value.shape[1])[:, np.newaxis]
    rounded = 2.0 * value.shape[1] * ROUNDOFF * np.abs(value)  # Horner's rule, Higham 5.1
    return np.asarray(np.sum((error + rounded) * powers, axis=1))


def start_error(loaded: Exported, recorded: Recorded, tapes: Mapping[str, Tape]) -> Array:
    """Bound on the difference of the matched starts, shape (ns,)."""
    (kernel,) = walk(tapes["start"], [recorded.y[:1, np.newaxis], recorded.y_r[:1], recorded.p[:1]])
    program = loaded.export.program
    twin = twin_of(program, bounded_arithmetic(DOUBLE), DOUBLE, matched=True)
    twin.reset(Bounded(float(recorded.y[0]), 0.0), [Bounded(float(item), 0.0) for item in recorded.y_r[0]])
    own: list[Any] = [twin.values[symbol].error for symbol in program.states]
    return np.asarray(kernel.error[0] + np.array(own, dtype=np.float64))


def carried(found: Sensitivity, local: Array, first: Array) -> tuple[Array, Array]:
    """What errors of single samples may become: bounds on X and on v at every `STRIDE`-th sample.

    Deviations obey ``d[k+1] = dX[k] d[k] + local[k]``. Backwards through the run, each compared quantity's
    sensitivity to the present deviation is kept, so that no error is ever bounded more than once.

    Args:
        found: the map.
        local: bounds on each sample's own errors, shape (rows - 1, nX).
        first: bounds on the deviation at the start, shape (nX,).
    """
    rows, n = local.shape[0] + 1, local.shape[1]
    instants = np.arange(0, rows, STRIDE)
    weights = np.zeros((len(instants), n + 1, n))
    total = np.zeros((len(instants), n + 1))
    for k in range(rows - 1, -1, -1):
        since = -(-k // STRIDE)  # the first compared instant at or after k
        if k % STRIDE == 0:
            weights[since, :n] = np.eye(n)
            weights[since, n] = found.v_X[k]
        if k == 0:
            total += np.abs(weights) @ first
            break
        later = weights[since:]
        total[since:] += np.abs(later) @ local[k - 1]
        weights[since:] = later @ found.dX[k - 1]
    return total[:, :n], total[:, n]
