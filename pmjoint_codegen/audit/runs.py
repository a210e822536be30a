"""Closed-loop runs that the claims are tested with: the paper's law on its plant, by the generated kernels.

Outside a strip the plant escapes whatever u does: with ``w = x_1 + x_2/sqrt(d_1)``, (11) gives ``w' =
sqrt(d_1) (w + (b_0 u + d)/d_1)``, so ``|w| > (b_0 u_M + D_max)/d_1`` grows for ever. That is how a run is
called diverging here: by a certificate, not by a large number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings

Notify = Callable[[str], None]

HORIZON = 80.0  # s: exp(sqrt(0.2) 80) > 1e15, so a state one part in 1e12 off the boundary has left it
STOP = 1e4  # |X_i| that ends a run: a hundred times the strip, and rounding is still far below z
TAIL = 0.5  # the last half of a run, where transients are over
PAPER_ANGLES = (60.0, 80.0)  # rad: on either side of the boundary with the compensator
CLIPPED_ANGLES = (
    99.0,
    100.5,
)  # rad: the same, clipped; no halving meets the equilibrium at 100


@dataclass(frozen=True)
class ExperimentRunner:
    """Runs of the paper's model.

    Attributes:
        notify: called with what takes time.
    """

    notify: Notify = field(default=lambda line: None)

    def example(self) -> ClosedLoop:
        """The example of Section V, with the y_r that the model file assumes."""
        return ClosedLoop.load("paper", notify=self.notify)

    def adaptive(self, disturbed: bool) -> ClosedLoop:
        """The example with guesses in place of b_0 and d_1, with the disturbance (37) or none."""
        disturbance = None if disturbed else ("0", "0")
        return ClosedLoop.load("paper-adaptive", disturbance=disturbance, notify=self.notify)

    def at_rest(self, disturbed: bool) -> ClosedLoop:
        """The same loop with y_r = 0, with the disturbance (37) or none."""
        return ClosedLoop.load(
            "paper", reference="0", disturbance=None if disturbed else ("0", "0"), notify=self.notify
        )


@dataclass(frozen=True)
class Bracket:
    """Neighbouring initial angles, one from which the law keeps x bounded and one from which it diverges.

    Attributes:
        bounded: rad.
        diverging: rad.
        beyond: the run from ``diverging``.
    """

    bounded: float
    diverging: float
    beyond: Run


def go(
    loop: ClosedLoop, x1: float | None = None, horizon: float | None = None, compensator: bool | None = None
) -> Run:
    """One run, from (x1, 0) or the model's x0; a run that diverges is a result, too."""
    x0 = None if x1 is None else (x1, 0.0)
    step = None if horizon is None else 0.1
    settings = make_settings(loop.manifest, x0=x0, horizon=horizon, output_step=step, compensator=compensator)
    return run(loop.evaluator, replace(settings, divergence=STOP))


def limit(loop: ClosedLoop, disturbance_bound: float) -> float:
    """``(b_0 u_M + D_max)/d_1`` in rad: beyond it no input holds the joint, however d helps."""
    values = {item.name: item.value for item in loop.manifest.parameters}
    return (values["b0"] * values["u_max"] + disturbance_bound) / values["d1"]


def diverges(done: Run, bound: float) -> bool:
    """Whether a run has passed the point of no return."""
    w = done["x1"] + done["x2"] / np.sqrt(done.settings.parameters["d1"])
    return bool(np.max(np.abs(w)) > bound)


def bracket(
    loop: ClosedLoop, low: float, high: float, steps: int, bound: float, compensator: bool = True
) -> Bracket:
    """Bisect between an initial angle from which x stays bounded and one from which it diverges.

    Args:
        loop: with y_r = 0.
        low: rad, bounded.
        high: rad, diverging.
        steps: halvings.
        bound: point of no return, rad.
        compensator: False: plain clipping.

    Raises:
        ArithmeticError: the first two angles are not on either side.
    """

    def fate(x1: float) -> tuple[Run, bool]:
        done = go(loop, x1, HORIZON, compensator)
        return done, diverges(done, bound)

    beyond, gone = fate(high)
    if fate(low)[1] or not gone:
        raise ArithmeticError(f"x1(0) = {low} and {high} are not on either side of the boundary")
    for _ in range(steps):
        middle = 0.5 * (low + high)
        done, gone = fate(middle)
        low, high, beyond = (low, middle, done) if gone else (middle, high, beyond)
    return Bracket(low, high, beyond)


@dataclass(frozen=True)
class Experiments:
    """All runs of an audit.

    Attributes:
        with_compensator, without: the example of Section V, y_r as the model file assumes.
        undisturbed, disturbed: brackets of the paper's law, y_r = 0, without disturbance and with (37).
        clipped: bracket of the same law with r = 0, undisturbed.
        strip: ``b_0 u_M/d_1`` in rad, beyond which no input holds the joint.
        sure_strip: the same where the worst disturbance pushes.
        adapted: the example with estimates in place of b_0 and d_1.
        frozen: the same with its guesses kept.
        quiet: with estimates, undisturbed.
    """

    with_compensator: Run
    without: Run
    undisturbed: Bracket
    disturbed: Bracket
    clipped: Bracket
    strip: float
    sure_strip: float
    adapted: Run
    frozen: Run
    quiet: Run


def experiments(runner: ExperimentRunner, disturbance_bound: float, steps: int = 10) -> Experiments:
    """Make all runs.

    Args:
        runner: with the kernels.
        disturbance_bound: D_max of (9).
        steps: halvings of every bracket.
    """
    example, quiet, disturbed = runner.example(), runner.at_rest(False), runner.at_rest(True)
    learning = runner.adaptive(True)
    gains = [name for name in learning.manifest.parameter_names if name.startswith("gamma_")]
    strip = limit(quiet, 0.0)
    beyond = limit(quiet, disturbance_bound)
    return Experiments(
        with_compensator=go(example, compensator=True),
        without=go(example, compensator=False),
        undisturbed=bracket(quiet, *PAPER_ANGLES, steps, strip),
        disturbed=bracket(disturbed, *PAPER_ANGLES, steps, beyond),
        clipped=bracket(quiet, *CLIPPED_ANGLES, steps, strip, compensator=False),
        strip=strip,
        sure_strip=limit(quiet, -disturbance_bound),
        adapted=learning.simulate(),
        frozen=learning.simulate(parameters=dict.fromkeys(gains, 0.0)),
        quiet=runner.adaptive(False).simulate(),
    )


def error_norm(done: Run) -> float:
    """Largest |z| over the last half of a run."""
    return float(np.max(np.hypot(done["z1"], done["z2"])[_late(done)]))


def late_peak(done: Run, column: str) -> float:
    """Largest magnitude of a column over the last half of a run."""
    return float(np.max(np.abs(done[column])[_late(done)]))


def peak(done: Run, column: str) -> float:
    """Largest magnitude of a column at the output instants."""
    return float(np.max(np.abs(done[column])))


def _late(done: Run) -> npt.NDArray[np.bool_]:
    """The rows of a run's last half."""
    late: npt.NDArray[np.bool_] = done.t >= TAIL * done.t[-1]
    return late
