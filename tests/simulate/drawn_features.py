"""Models with drawn narrow features, and what their runs must agree with."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from hypothesis import assume, event
from hypothesis import strategies as st

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE, make_settings

from .small_steps import Array, Equations, Feature, SlidingError

EXAMPLES = int(os.environ.get("PMJOINT_EXAMPLES", "25"))
HORIZON, STEP, PERIODS = 2.0, 0.01, (0.005, 0.01)  # s
BOUND = max(2e-8, 100 * DEFAULT_TOLERANCE)
NUDGE, CRITICAL = 1e-9, 100.0  # of x(0); a start is critical that multiplies it by more

PULSE = "{0}h*exp(-((t-{0}t)/{0}w)**2)"
WINDOW = "{0}h*(tanh((t-{0}t)/{0}w) - tanh((t-{0}t-{0}d)/{0}w))"
BUMP = "{0}h*exp(-(({1}-{0}x)/{0}w)**2)"

# name -> reference, phi_2, what is added to the disturbance; parameters are named after the feature
MODELS = {
    "time": (
        f"{PULSE.format('a')} + {WINDOW.format('b')}",
        "0",
        f"{PULSE.format('f')} + {WINDOW.format('g')}",
    ),
    "angle": (PULSE.format("a"), BUMP.format("f", "y"), BUMP.format("g", "x1")),
    "velocity": (
        PULSE.format("a"),
        "0",
        f"-fh*tanh((x2-fx)/fw) + {BUMP.format('g', 'x2')}",
    ),
    "kinks over time": (
        "0",
        "0",
        "fh*sign(t-ft) + gh*abs(t-gt) + kh*min(max((t-kt)/kw, 0), 1) + qh*sign(exp(-((t-qt)/qw)**2) - 0.5)",
    ),
    "kinks over the angle": (
        PULSE.format("a"),
        "0",
        "fh*sign(x1-fx) + gh*abs(x1-gx) + kh*min(max((x1-kx)/kw, 0), 1)",
    ),
    # Coulomb's friction, its rise towards rest, more at rest itself; a pulse that may tear it off
    "stick": (
        "0",
        "0",
        f"-(fh + gh*exp(-(x2/gw)**2) + kh*(1 - sign(x2)**2))*sign(x2) + {PULSE.format('q')}",
    ),
}
FILE = """schema = 1
name = "drawn"
title = "Narrow features whose place, width and height are parameters"
source = "the paper's example"
[parameters]
d1 = {{ value = 0.2, unit = "1/s^2", about = "stiffness" }}
b0 = {{ value = 2.0, unit = "rad/(s^2 V)", about = "input gain" }}
u_max = {{ value = 10.0, unit = "V", about = "limit" }}
swing = {{ value = 1.0, unit = "rad", about = "amplitude of the motion" }}
{parameters}
[plant]
order = 2
phi = ["0", "{phi}"]
Phi = [["0"], ["y"]]
theta = ["d1"]
b = ["b0"]
sigma = "1"
disturbance = ["0", "0.1*swing*sin(x2)*cos(t) + {disturbance}"]
disturbance_bound = 1
[actuator]
limit = "u_max"
[design]
c = [15, 15]
e = [0.1, 0.1]
ck = [1, 1]
k = [6, 8]
compensator = true
[simulation]
reference = "swing*sin(t) + {reference}"
x0 = [1.0, 0.0]
horizon = 2.0
output_step = 0.01
sample_time = 0.005
"""


@dataclass(frozen=True)
class Model:
    """One model, for every way to run it.

    Attributes:
        compiled: single runs in C.
        interpreted: single runs in Python.
        lanes: many runs at once.
        equations: for small steps.
    """

    compiled: ClosedLoop
    interpreted: ClosedLoop
    lanes: BatchLibrary
    equations: Equations


@dataclass(frozen=True)
class Drawn:
    """One example.

    Attributes:
        parameters: place, width and height of every feature, amplitude of the reference.
        x0: initial plant states.
        features: what the small steps are told.
        period: sample time, s.
        rest: what friction can hold at rest, rad/s^2; None where nothing does.
    """

    parameters: Mapping[str, float]
    x0: tuple[float, float]
    features: tuple[Feature, ...]
    period: float = PERIODS[0]
    rest: float | None = None


def parameters_of(name: str) -> list[str]:
    """The parameters that a model's features bring."""
    text = " ".join(MODELS[name])
    return [
        f"{one}{kind}" for one in "abfgkq" for kind in "htxwd" if f"{one}{kind}" in text.replace("tanh", "")
    ]


WIDTHS = st.floats(-3.0, 0.0).map(lambda power: 10.0**power)
SIGNS = st.sampled_from([-1.0, 1.0])


@st.composite
def drawn(draw: st.DrawFn, name: str) -> Drawn:
    """Draw what a model's features are, of at most what the actuator can hold against."""
    values: dict[str, float] = {}
    features: list[Feature] = []
    at_rest = draw(st.booleans())
    for one in sorted({parameter[0] for parameter in parameters_of(name)}):
        kinds = [parameter[1] for parameter in parameters_of(name) if parameter[0] == one]
        width = draw(WIDTHS)
        place = draw(st.floats(0.05, 1.9)) if "t" in kinds else draw(st.floats(-1.0, 1.0))
        if one in "ab":  # a reference's: up to 200 rad/s^2 by its second derivative, up to 0.5 rad
            height = min(0.5, draw(st.floats(0.1, 100.0)) * width**2)
        else:
            height = draw(st.floats(0.1, 5.0))
        if one == "f" and name == "angle":  # the law knows phi, and takes its slope
            height = min(height, 100.0 * width)
        # Friction slows: a force that pushes multiplies what it starts from by exp(h/w t).
        slows = (one == "f" and name == "velocity") or (one in "fgk" and name == "stick")
        sign = 1.0 if slows else draw(SIGNS)
        height = min(height, 0.5 * width / 0.1) if one == "g" and name == "stick" else height
        own = {"h": sign * height, "t": place, "x": place, "w": width, "d": draw(st.floats(0.01, 1.0))}
        values |= {f"{one}{kind}": own[kind] for kind in kinds}
        if "w" in kinds:
            over = "t" if "t" in kinds else "x2" if name in ("velocity", "stick") else "x1"
            features += [
                Feature(over, place + away, width) for away in ([0.0, own["d"]] if "d" in kinds else [0.0])
            ]
    moving = st.floats(-2.0, 2.0)
    x0 = (0.0, 0.0) if at_rest else (draw(moving), draw(moving))
    swing = 0.0 if at_rest else 1.0
    rest = sum(values[f"{one}h"] for one in "fgk") if name == "stick" else None
    return Drawn({**values, "swing": swing}, x0, tuple(features), draw(st.sampled_from(PERIODS)), rest)


def expected(model: Model, example: Drawn, controller: str, x0: Array) -> Array:
    """States and v at the output instants, by small steps."""
    parameters = make_settings(model.compiled.manifest, parameters=example.parameters).parameters
    if controller == "continuous":
        return model.equations.continuous(parameters, example.features, x0, instants(), example.rest)
    count = round(HORIZON / example.period)
    features, period = example.features, example.period
    rows = model.equations.sampled(parameters, features, x0, count, period, example.rest)
    return rows[:: round(STEP / example.period)]


def instants() -> Array:
    return np.arange(round(HORIZON / STEP) + 1, dtype=np.float64) * STEP


def allowed(model: Model, example: Drawn, right: Array) -> Array:
    """What each entry may be off by, shape of `right`: v follows from the states, and multiplies."""
    settings = make_settings(model.compiled.manifest, parameters=example.parameters)
    place = [item.name for item in model.compiled.manifest.signals].index("v")
    t, states = instants()[:, np.newaxis], right[:, :-1]
    bound = np.empty_like(right)
    bound[:, :-1] = BOUND * (1.0 + np.max(np.abs(states), axis=0))

    def v(X: Array) -> Array:
        found: Array = model.compiled.evaluator.call("signals", t, X, settings.p)[0][:, place]
        return found

    steps = 1e-6 * np.eye(states.shape[1])
    slopes = np.array([v(states + step) - v(states - step) for step in steps]).T / 2e-6
    bound[:, -1] = np.sum(np.abs(slopes) * bound[:, :-1], axis=1)
    return bound


def single(loop: ClosedLoop, example: Drawn, controller: str) -> Array | None:
    """One run, or None where it ends in a word."""
    try:
        run = loop.simulate(
            parameters=example.parameters,
            x0=example.x0,
            horizon=HORIZON,
            output_step=STEP,
            controller=controller,
            sample_time=example.period,
        )
    except SimulationError as error:
        event(f"ends with a word: {error}")
        return None
    return np.column_stack([run.states, run["v"]])


OTHERS = ((0.3, -0.4), (0.0, 0.0))


def in_lanes(
    model: Model, example: Drawn, controller: str, others: tuple[tuple[float, float], ...] = OTHERS
) -> Array | None:
    """The same run in a lane beside others, which start from other states."""
    manifest = model.lanes.manifest
    p = make_settings(manifest, parameters=example.parameters).p
    x0 = np.zeros((3, manifest.nX))
    x0[:, :2] = others[0], example.x0, others[1]
    sampled = controller == "sampled"
    period = example.period if sampled else 0.0
    hold = hold_matrices(model.compiled.evaluator, p, period)[np.newaxis] if sampled else np.empty((0, 0))
    runs = Runs(x0, np.tile(p, (3, 1)), HORIZON, DEFAULT_TOLERANCE, period, hold, instants(), 1e4, 10_000_000)
    outcome = model.lanes.simulate(runs)
    if outcome.metrics[1, Column.STATUS] != Status.DONE:
        return None
    found: Array = outcome.trajectories[1]
    return found[:, : manifest.nX + 1]


def in_every_loop(model: Model, example: Drawn, controller: str) -> dict[str, Array | None]:
    """One run in C and in a lane."""
    return {
        "compiled": single(model.compiled, example, controller),
        "lanes": in_lanes(model, example, controller),
    }


def critical(model: Model, example: Drawn, controller: str, right: Array) -> bool:
    """Whether a start next to it ends elsewhere: then no integrator can be held to the bound."""
    try:
        nudged = expected(model, example, controller, np.array(example.x0) + NUDGE)
    except SlidingError:  # that one is stuck
        return True
    moved = np.max(np.abs(nudged - right)[:, :-1] / (1.0 + np.max(np.abs(right[:, :-1]), axis=0)))
    return not moved <= CRITICAL * NUDGE


def compare(model: Model, example: Drawn, controller: str, found: Mapping[str, Array | None]) -> None:
    """Hold runs against small steps."""
    if all(rows is None for rows in found.values()):
        return
    try:
        right = expected(model, example, controller, np.array(example.x0))
    except SlidingError:
        assume(False)
    bound = allowed(model, example, right)
    for name, rows in found.items():
        if rows is None:
            continue
        off = np.where(np.isnan(rows), math.inf, np.abs(rows - right) / bound)
        if np.max(off) > 1.0:
            assume(not critical(model, example, controller, right))
            row, column = np.unravel_index(np.argmax(off), off.shape)
            raise AssertionError(
                f"{name}: column {column} at t = {instants()[row]:g} s is {rows[row, column]!r}; "
                f"right: {right[row, column]!r}, off by {off[row, column]:.3g} times what is allowed"
            )
