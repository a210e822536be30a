"""Narrow features drawn at random, 1 ms to 1 s wide, anywhere: every loop against small steps.

Pulses and windows of reference and disturbance, bumps of phi and of the disturbance over the angle, friction
and bumps over the velocity, kinks over time and over the angle, at rest and in motion; holds of 5 and 10 ms.
Place, width and height are parameters, so that few models serve all examples. ``PMJOINT_EXAMPLES`` asks for
another number of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.check.subject import load_subject
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.guard import HOLD_RATIOS, Discs
from pmjoint_codegen.provision import provide
from pmjoint_codegen.simulate import fixed
from pmjoint_codegen.simulate import run as simulate_run

from .drawn_features import (
    EXAMPLES,
    FILE,
    MODELS,
    Drawn,
    Model,
    allowed,
    compare,
    critical,
    drawn,
    expected,
    in_every_loop,
    in_lanes,
    parameters_of,
    single,
)
from .small_steps import Array, Equations, Feature


@pytest.fixture(scope="session")
def models(tmp_path_factory: pytest.TempPathFactory, cache: Any) -> Callable[[str], Model]:
    """Give a model by name, made when it is first asked for."""
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    made: dict[str, Model] = {}

    def model(name: str) -> Model:
        if name in made:
            return made[name]
        file = tmp_path_factory.mktemp("drawn") / "drawn.toml"
        reference, phi, disturbance = MODELS[name]
        named = parameters_of(name)
        lines = [f'{one} = {{ value = 1.0, unit = "1", about = "of a feature" }}' for one in named]
        text = FILE.format(parameters="\n".join(lines), phi=phi, disturbance=disturbance, reference=reference)
        file.write_text(text, encoding="utf-8")
        provided = provide(file, environment=os.environ, notify=lambda line: None, lanes=True)
        subject = load_subject(file, os.environ, lambda line: None)
        sources = batch.batch_sources(provided.folder)
        made[name] = Model(
            ClosedLoop.load(file, "compiled", notify=lambda line: None),
            ClosedLoop.load(file, "interpreted", notify=lambda line: None),
            batch.load(sources, provided.manifest, usable_levels(os.environ), compiler, cache),
            Equations(replace(subject, folder=provided.folder)),
        )
        return made[name]

    return model


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize("name", MODELS)
def test_single_runs_and_lanes_see_what_is_narrow(
    models: Callable[[str], Model], name: str, controller: str
) -> None:
    model = models(name)
    examples = EXAMPLES if controller == "continuous" else max(2, EXAMPLES // 2)

    @settings(max_examples=examples)
    @given(drawn(name))
    def holds(example: Drawn) -> None:
        compare(model, example, controller, in_every_loop(model, example, controller))

    holds()


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize("name", MODELS)
def test_interpreted_runs_see_what_is_narrow(
    models: Callable[[str], Model], name: str, controller: str
) -> None:
    model = models(name)

    @settings(max_examples=max(2, EXAMPLES // 10))
    @given(drawn(name))
    def holds(example: Drawn) -> None:
        compare(model, example, controller, {"interpreted": single(model.interpreted, example, controller)})

    holds()


NO_DISCS = Discs((0.0,), (0.0,))


def drawn_by_hand(name: str, swing: float, x0: tuple[float, float], period: float, **given: float) -> Drawn:
    """An example whose other features have no height."""
    quiet = {one: 0.0 if one.endswith("h") else 1.0 for one in parameters_of(name)}
    over = "t" if name.endswith("time") else "x2" if name == "velocity" else "x1"
    features = tuple(
        Feature(over, given.get(f"{one}t", given.get(f"{one}x", 0.0)), given[f"{one}w"])
        for one in "fgkq"
        if f"{one}w" in given
    )
    return Drawn({**quiet, **given, "swing": swing}, x0, features, period)


def times_allowed(model: Model, example: Drawn, controller: str) -> dict[str, Callable[[], float]]:
    """How far a run is off, as a multiple of what is allowed, for every way to make it; the word is inf."""
    right = expected(model, example, controller, np.array(example.x0))
    bound = allowed(model, example, right)

    def off(found: Array | None) -> float:
        return math.inf if found is None else float(np.max(np.abs(found - right) / bound))

    return {
        "compiled": lambda: off(single(model.compiled, example, controller)),
        "interpreted": lambda: off(single(model.interpreted, example, controller)),
        # Lanes beside it may need the longer way, which looks at more points.
        "lanes": lambda: off(in_lanes(model, example, controller, (example.x0, example.x0))),
    }


def test_loops_without_a_guard_are_caught(
    models: Callable[[str], Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pulse of 2 ms of the disturbance, at rest; discs of radius 0 hold nothing that could miss."""
    example = drawn_by_hand("time", 0.0, (0.0, 0.0), 0.005, fh=5.0, ft=1.2371, fw=0.002)
    off = times_allowed(models("time"), example, "continuous")
    assert max(run() for run in off.values()) <= 1.0
    monkeypatch.setattr(simulate_run, "SHARED", lambda settings: (object(),))  # nothing prepared earlier
    for module in (fixed, batch):
        monkeypatch.setattr(module, "discs", lambda rule, tolerance: NO_DISCS)
    found = {way: run() for way, run in off.items()}
    assert min(found.values()) > 1.0 and max(found.values()) < math.inf


# Far from the hold's start in widths, so that the coefficients there are 0 beside what lies ahead.
IN_HOLDS = {
    "a pulse of 1 ms at rest": (
        "time",
        drawn_by_hand("time", 0.0, (0.0, 0.0), 0.01, fh=5.0, ft=1.2389, fw=0.001),
    ),
    "a pulse of 1 ms in motion": (
        "time",
        drawn_by_hand("time", 1.0, (1.0, 0.0), 0.01, fh=-3.0, ft=0.7392, fw=0.001),
    ),
    "friction": ("velocity", drawn_by_hand("velocity", 0.0, (1.5, 0.15), 0.01, fh=0.1, fx=0.0, fw=0.003)),
    "a bump of the velocity": (
        "velocity",
        drawn_by_hand("velocity", 0.0, (1.5, 0.15), 0.01, gh=5.0, gx=0.0, gw=0.003),
    ),
    "a bump of the angle": (
        "angle",
        drawn_by_hand("angle", 0.0, (0.4, 2.0), 0.01, gh=5.0, gx=0.4165, gw=0.002),
    ),
    "kinks of a pulse": (
        "kinks over time",
        drawn_by_hand("kinks over time", 1.0, (1.0, 0.0), 0.01, qh=3.0, qt=0.7389, qw=0.001),
    ),
}

# Lanes look at points inside more of these holds than single runs do, whatever a guard says.
BLIND_LANES = ("a pulse of 1 ms at rest", "a bump of the velocity")


@pytest.mark.parametrize("what", IN_HOLDS)
def test_holds_without_a_guard_are_caught(
    models: Callable[[str], Model], monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    """What is narrower than a hold and lies inside: discs of radius 0 hold nothing that could miss."""
    name, example = IN_HOLDS[what]
    off = times_allowed(models(name), example, "sampled")
    assert max(run() for run in off.values()) <= 1.0
    monkeypatch.setattr(simulate_run, "SHARED", lambda settings: (object(),))  # nothing prepared earlier
    for module in (fixed, batch):
        monkeypatch.setattr(module, "discs", lambda rule, tolerance: NO_DISCS)
        monkeypatch.setattr(module, "hold_factors", lambda zeros: [0.0] * len(HOLD_RATIOS))
        monkeypatch.setattr(module, "HOLD_RATIOS", (0.0,) * len(HOLD_RATIOS))
    found = {way: run() for way, run in off.items() if way != "lanes" or what in BLIND_LANES}
    assert min(found.values()) > 1.0 and max(found.values()) < math.inf


def test_a_start_beside_one_that_is_stuck_is_critical(models: Callable[[str], Model]) -> None:
    """A kink stands one billionth from the start, as far as the start that it is compared with."""
    name = "kinks over the angle"
    given = {"fh": -4.4, "fx": 1e-9, "gh": 5.0, "gx": 0.85, "kh": -2.5, "kx": 0.0, "kw": 1.0}
    example = drawn_by_hand(name, 0.0, (0.0, 0.0), 0.005, **given)
    model = models(name)
    assert critical(model, example, "sampled", expected(model, example, "sampled", np.zeros(2)))
