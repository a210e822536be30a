"""What the exported controller does with measured u, with NaN and infinities, and with bad parameters."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported

BAD_INPUT, BAD_MEASURED_U, BAD_V, BAD_PARAMETER = 1, 2, 4, 8
Load = Callable[..., Exported]
Y_R = np.array([0.3, 0.1, -0.2])


def ran(loaded: Exported, count: int) -> None:
    """Start anew and take some samples."""
    assert loaded.init(0.5, Y_R) == 0
    for k in range(count):
        assert loaded.step(0.5 + 0.01 * k, Y_R) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("entry", range(4))
def test_a_bad_input_holds_u_and_the_filters_go_on_with_the_last_sound_one(
    bad: float, entry: int, load: Load
) -> None:
    loaded = load("paper")
    ran(loaded, 3)
    u, v = loaded.output.u, loaded.output.v
    reading = np.array([0.7, *Y_R])
    reading[entry] = bad
    assert loaded.step(reading[0], reading[1:]) == BAD_INPUT
    assert (loaded.output.u, loaded.output.v, loaded.output.flags) == (u, v, BAD_INPUT)
    held = loaded.states
    ran(loaded, 3)
    loaded.step(0.52, Y_R)  # the same y as at the last sound sample
    assert np.array_equal(held, loaded.states)
    assert np.all(np.isfinite(held))


def test_after_a_bad_sample_the_controller_is_as_if_y_and_u_had_been_held(load: Load) -> None:
    loaded = load("paper")
    ran(loaded, 2)
    assert loaded.step(math.nan, Y_R) == BAD_INPUT
    assert loaded.step(0.6, Y_R) == 0
    found = loaded.output.v
    ran(loaded, 2)
    held_v, held_u = loaded.state.v, loaded.state.u
    loaded.step(0.51, Y_R)
    loaded.state.v, loaded.state.u = held_v, held_u
    loaded.step(0.6, Y_R)
    assert loaded.output.v == found


def test_a_bad_first_sample_leaves_the_actuator_at_rest(load: Load) -> None:
    loaded = load("paper")
    assert loaded.init(math.nan, Y_R) == 0
    assert loaded.step(math.nan, Y_R) == BAD_INPUT
    assert (loaded.output.u, loaded.output.command, loaded.state.ready) == (0.0, 0.0, 0)
    assert loaded.step(0.5, Y_R) == 0
    found = loaded.output.v
    loaded.init(0.5, Y_R)
    loaded.step(0.5, Y_R)
    assert loaded.output.v == found


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_bad_measured_u_is_replaced_by_the_controllers_own(bad: float, load: Load) -> None:
    loaded = load("paper")
    ran(loaded, 3)
    assert loaded.step(0.6, Y_R, measured_u=bad) == BAD_MEASURED_U
    found = loaded.output.v
    ran(loaded, 3)
    loaded.step(0.6, Y_R)
    assert loaded.output.v == found


def test_a_measured_u_acts_in_place_of_the_controllers_own(load: Load) -> None:
    loaded = load("paper")
    ran(loaded, 3)
    own = loaded.output.u
    loaded.step(0.6, Y_R, measured_u=own)
    same = loaded.output.v
    ran(loaded, 3)
    loaded.step(0.6, Y_R)
    assert loaded.output.v == same
    ran(loaded, 3)
    loaded.step(0.6, Y_R, measured_u=own + 1.0)
    assert loaded.output.v != same


def test_an_overflow_of_the_law_holds_u(load: Load) -> None:
    loaded = load("paper")
    ran(loaded, 3)
    u = loaded.output.u
    assert loaded.step(1e308, Y_R) & BAD_V
    assert loaded.output.u == u


@pytest.mark.parametrize(
    ("name", "value"), [("sample_time", 0.0), ("sample_time", math.nan), ("b0", 0.0), ("k1", math.inf)]
)
def test_parameters_without_meaning_are_refused(name: str, value: float, load: Load) -> None:
    loaded = load("paper")
    setattr(loaded.params, name, value)
    assert loaded.init(0.5, Y_R) == BAD_PARAMETER


def test_reset_is_init_without_its_computation(load: Load) -> None:
    loaded = load("paper")
    loaded.params.matched = 1
    ran(loaded, 1)
    first = loaded.states
    ran(loaded, 5)
    loaded.give(0.5, Y_R)
    loaded.call("reset", loaded.constants, loaded.state, loaded.input)
    loaded.step(0.5, Y_R)
    assert np.array_equal(loaded.states, first)
    assert loaded.output.z1 == 0.0 and abs(loaded.output.z2) < 1e-15 * abs(first).max()
    loaded.params.matched = 0


def test_limits_rate_and_dead_zone_shape_the_command(load: Load) -> None:
    loaded = load("chain")
    p = loaded.params
    loaded.init(0.0, Y_R)
    before, seen = 0.0, set()
    for k in range(60):
        loaded.step(2.0 * math.sin(0.2 * k), Y_R)
        out = loaded.output
        assert p.lower <= out.command <= p.upper
        assert abs(out.command - before) <= p.rate * p.sample_time * (1 + 1e-15)
        assert out.u == out.command - max(-p.dead_zone, min(out.command, p.dead_zone))
        before = out.command
        seen.add(out.command)
    assert {p.lower, p.upper} <= seen


def test_the_sensors_filter_starts_at_the_first_reading(load: Load) -> None:
    loaded = load("chain")
    loaded.init(0.7, Y_R)
    loaded.step(0.7, Y_R)
    assert loaded.state.y == 0.7
    loaded.step(0.9, Y_R)
    gain = -math.expm1(-loaded.params.filter * loaded.params.sample_time)
    assert loaded.state.y == 0.7 + gain * (0.9 - 0.7)


def test_identity_is_reported(load: Load) -> None:
    loaded = load("paper")
    assert loaded.ffi.string(loaded.call("model_hash")) == b"0" * 64
    assert loaded.ffi.string(loaded.call("version")) == b"test"
