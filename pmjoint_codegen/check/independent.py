"""An independent solver: heyoka, with located events, on the derivation's own expressions.

It shares nothing with what it checks but the symbolic derivation: no CasADi, no C of ours, no Taylor
recurrence, no event search of ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy as sp

from pmjoint_codegen.check.golden import Switches, Trajectory, compare, default_run, trajectory_of
from pmjoint_codegen.check.program import compile_program
from pmjoint_codegen.check.result import GateResult, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.errors import installing
from pmjoint_codegen.simulate.modes import Actuator, make_actuator
from pmjoint_codegen.simulate.status import Status

NAME = "trajectory.independent"


class Expressions:
    """heyoka's expressions as an algebra for a program of named equations."""

    def __init__(self, heyoka: Any) -> None:
        self._heyoka = heyoka

    def constant(self, value: sp.Expr) -> Any:
        """The nearest double."""
        return self._heyoka.expression(
            float(sp.Rational(value).p / sp.Rational(value).q if value.is_Rational else value)
        )

    def add(self, a: Any, b: Any) -> Any:
        """Sum."""
        return a + b

    def multiply(self, a: Any, b: Any) -> Any:
        """Product."""
        return a * b

    def power(self, a: Any, exponent: sp.Rational) -> Any:
        """Power."""
        return a ** float(exponent)

    def apply(self, function: str, *arguments: Any) -> Any:
        """A named function."""
        return getattr(self._heyoka, function)(*arguments)


def check(subject: Subject) -> GateResult:
    """Integrate the default run a second time, with heyoka, and compare."""
    try:
        import heyoka
    except ImportError:
        return not_run(NAME, f"no heyoka; {installing('heyoka')}")
    done = default_run(subject.compiled or subject.interpreted)
    if done.status != Status.DONE:
        return failed(NAME, f"the run ended early: {done.message}")
    found = trajectory_of(done)
    actuator = make_actuator(subject.interpreted.call("actuation", done.settings.p)[0])
    expected = integrate(heyoka, subject, found, done.settings.parameters, actuator)
    return compare(NAME, expected, found, "heyoka")


def integrate(
    heyoka: Any, subject: Subject, like: Trajectory, parameters: Mapping[str, float], actuator: Actuator
) -> Trajectory:
    """The closed loop by heyoka, at the instants of another trajectory and from its first row.

    Args:
        heyoka: the module.
        subject: the model.
        like: gives instants and initial state.
        parameters: value of every parameter and gain.
        actuator: which values of v are thresholds, and what lies between them.
    """
    kernel, v = subject.table["closed_loop"], subject.derivation.signals.v
    symbols = [symbol for _, block in kernel.inputs for symbol in block]
    rates = [sp.sympify(entry) for _, entries in kernel.outputs for entry in entries]
    program = compile_program([*rates, v], symbols, subject.derivation.equations, kernel.given)
    state = [name for name in like.names if name != "v"]
    known: dict[sp.Symbol, Any] = {
        symbol: heyoka.expression(symbol.name) for symbol in symbols if symbol.name in state
    }
    known |= {
        symbol: heyoka.expression(parameters[symbol.name]) for symbol in symbols if symbol.name in parameters
    }
    known |= {symbol: heyoka.par[i] for i, symbol in enumerate(dict(kernel.inputs)["g"])}
    known[subject.derivation.signals.t] = heyoka.time
    *right, control = program.run(Expressions(heyoka), known)
    system = [(heyoka.expression(name), rate) for name, rate in zip(state, right, strict=True)]
    values, switches = _propagate(heyoka, system, control, actuator, like)
    function = heyoka.cfunc([control], vars=[heyoka.expression(name) for name in state])
    controls = np.asarray(function(np.ascontiguousarray(values.T), time=like.t))
    return Trajectory(like.names, like.t, np.column_stack([values, controls[0]]), switches)


def _propagate(
    heyoka: Any, system: list[Any], v: Any, actuator: Actuator, like: Trajectory
) -> tuple[Any, Switches]:
    """Integrate, changing the actuator's mode where v crosses a threshold."""
    labels: list[tuple[float, int]] = []

    def crossing(place: int) -> Any:
        def changed(solver: Any, direction: int) -> bool:
            mode = place + 1 if direction > 0 else place
            solver.pars[:] = actuator.modes[mode]
            labels.append((float(solver.time), actuator.labels[mode]))
            return True

        return heyoka.t_event(v - float(actuator.thresholds[place]), callback=changed)

    first = like.values[0]
    mode = int(np.searchsorted(actuator.thresholds, first[-1]))
    events = [crossing(place) for place in range(len(actuator.thresholds))]
    start, pars = list(first[:-1]), list(actuator.modes[mode])
    solver = heyoka.taylor_adaptive(system, start, pars=pars, t_events=events, time=float(like.t[0]))
    outcome = solver.propagate_grid(np.ascontiguousarray(like.t))
    before = [actuator.labels[mode], *(label for _, label in labels)]
    switches = [found for found, earlier in zip(labels, before, strict=False) if found[1] != earlier]
    return np.asarray(outcome[-1]), tuple(switches)
