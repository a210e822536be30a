"""Units in FMPy: their states, their clocks, their parameters, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp


def test_a_state_continues_the_same_run_here_and_elsewhere(seen: dict[str, Any]) -> None:
    for part in ("controller", "plant"):
        states = seen[part]["states"]
        assert states["on"] == states["again"] == states["elsewhere"]
        assert states["on"] != seen[part].get("first")


def test_reset_starts_anew(seen: dict[str, Any]) -> None:
    assert seen["controller"]["reset"] == seen["controller"]["first"]


def test_a_gain_acts_at_the_next_sample_and_leaves_the_states(seen: dict[str, Any]) -> None:
    plain, changed, always = seen["controller"]["gain"]
    assert changed[1:] == plain[1:]  # filters do not depend on c1
    assert changed == always
    assert changed[0] != plain[0]


def test_a_long_step_takes_every_sample_in_it(seen: dict[str, Any]) -> None:
    long, short = seen["controller"]["long"]
    assert long == short


def test_half_a_step_takes_a_sample_only_where_one_is_due(seen: dict[str, Any]) -> None:
    first, second, third, fourth = seen["controller"]["half"]
    assert first == second != third == fourth


def test_nonsense_is_refused(seen: dict[str, Any]) -> None:
    refused = {**seen["controller"]["refused"], **seen["plant"]["refused"]}
    assert [what for what, is_refused in refused.items() if not is_refused] == []


def test_start_values_are_there_before_the_first_step(seen: dict[str, Any]) -> None:
    assert seen["plant"]["start"] == [0.7, 0.7, -0.2, 10.0]  # u = 12 is beyond the limit


def test_the_plant_follows_an_independent_integration(seen: dict[str, Any]) -> None:
    """(11) and (37) written by hand, with scipy's method of order 8.

    Every step of the plant's unit commits at most 1e-12. The equations pass an error on by no more than
    ``exp(sqrt(d1) t)``, which is 9.4 for d1 = 5 and t = 1, and a unit second takes less than 100 steps.
    """

    def x_dot(d1: float, added: float) -> Any:
        return lambda t, x: [x[1], d1 * x[0] + 2.0 * 10.0 + 0.1 * np.sin(x[1]) * np.cos(t) + added]

    def after(x: Any, begin: float, end: float, d1: float = 0.2, added: float = 0.0) -> Any:
        made = solve_ivp(x_dot(d1, added), (begin, end), x, "DOP853", rtol=2.3e-14, atol=1e-15)
        return made.y[:, -1]

    plant, bound = seen["plant"], 100 * 9.4 * 1e-12
    half, whole = after([0.7, -0.2], 0.0, 0.5), after([0.7, -0.2], 0.0, 1.0)
    for name in ("coarse", "fine"):
        assert np.max(np.abs(whole - plant[name])) <= bound, name
    tuned = after(half, 0.5, 1.0, 5.0, 0.25)
    assert np.max(np.abs(tuned - plant["tuned"])) <= bound
    assert np.max(np.abs(tuned - whole)) > 0.1
