"""A sampled run as its controller sees it: one row a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.run import run
from pmjoint_codegen.simulate.settings import Settings, make_settings


@dataclass(frozen=True)
class Recorded:
    """A sampled run, one row a sample.

    Attributes:
        s: the controller's states, shape (rows, states).
        reading: what the sensor reads, shape (rows,).
        y: the same behind the filter, if there is one.
        y_r: the reference and its derivatives at the controller's clock, shape (rows, rho + 1).
        v, u, command: shape (rows,).
        z: errors, shape (rows, rho).
        x_hat: estimate, shape (rows, n).
        p: parameters of the kernels, with the segment of the reference, shape (rows, parameters).
        hold: matrices of the exact hold.
        t: instants, shape (rows,).
        x: states of the plant, shape (rows, nx).
        w: what the actuator delivers for v, without a chain, shape (rows, nw).
        steps: of the plant's integration.
    """

    s: Array
    reading: Array
    y: Array
    y_r: Array
    v: Array
    u: Array
    command: Array
    z: Array
    x_hat: Array
    p: Array
    hold: Array
    t: Array
    x: Array
    w: Array
    steps: int

    __repr__ = brief


def record(evaluator: Evaluator, start: str, samples: int) -> Recorded | str:
    """The model's sampled run, a row a sample; or why there is none.

    Every sample is on time: lateness is the clock's, which the exported controller does not have.
    """
    manifest = evaluator.manifest
    settings = run_settings(manifest, start, samples)
    done = run(evaluator, settings)
    if done.status != Status.DONE and len(done.t) < 2:
        return f"the sampled run ended at once: {done.message}"
    names = {item.name for item in manifest.signals}
    reading = done["y_m"] if "y_m" in names else done["y"]
    p = _parameters(settings, done.t)
    return Recorded(
        s=done.states[:, manifest.nx :],
        reading=reading,
        y=done["y_f"] if "y_f" in names else reading,
        y_r=evaluator.call("reference", done.t[:, np.newaxis], p)[0],
        v=done["v"],
        u=done["u"],
        command=done["u_command"] if "u_command" in names else done["u"],
        z=np.column_stack([done[f"z{i}"] for i in range(1, manifest.rho + 1)]),
        x_hat=np.column_stack([done[f"x_hat{i}"] for i in range(1, manifest.n + 1)]),
        p=p,
        hold=hold_matrices(evaluator, settings.p, settings.sample_time),
        t=done.t,
        x=done.states[:, : manifest.nx],
        w=_delivered(evaluator, done["v"], p),
        steps=done.steps,
    )


def run_settings(manifest: Manifest, start: str, samples: int) -> Settings:
    """Settings of the model's sampled run, of at most some samples; the clock is on time."""
    late = {manifest.chain["jitter"]: 0.0} if "jitter" in manifest.chain else {}
    T = manifest.simulation.sample_time
    horizon = min(manifest.simulation.horizon, samples * T)
    return make_settings(
        manifest, parameters=late, horizon=horizon, output_step=T, controller="sampled", start=start
    )


def _delivered(evaluator: Evaluator, v: Array, p: Array) -> Array:
    """W for each v: within the limits of every channel."""
    (limits,) = evaluator.call("actuation", p)
    offset, slope, lower, upper = np.moveaxis(limits.reshape(len(v), -1, 4), 2, 0)
    return np.clip(offset + slope * v[:, np.newaxis], lower, upper)


def _parameters(settings: Settings, t: Array) -> Array:
    """The kernels' parameters at each instant, with the segment of a reference that is data."""
    p = np.tile(settings.p, (len(t), 1))
    if settings.reference is not None:
        rows = settings.reference.rows[settings.reference.places(t)]
        p[:, -rows.shape[1] :] = rows
    return p
