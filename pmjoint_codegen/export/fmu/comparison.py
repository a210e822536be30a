"""What the units must follow: ``simulate --controller sampled``, and how closely.

Both sides integrate the same plant under the same held u, each with a bounded local error. Let L be the local
error of one sample, relative to max(1, |value|). The loop passes each error on to later samples. Runs from a
start that is displaced a little, one state at a time, show how. Their responses, summed over samples and
states, are the gain. Two integrations then differ by at most ``gain (L_1 + L_2)``, to first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import sympy as sp

if TYPE_CHECKING:
    from pmjoint_derive import Derivation

TOLERANCE: Final = 1e-12  # of both integrations, per sample
_MOST: Final = 2000  # samples
_MOVED: Final = 1e-6  # displacement of a state, relative to max(1, its largest magnitude)
_COLUMNS: Final = ("y", "v")
_OF_SAMPLES: Final = ("delay", "delay_samples", "jitter", "noise")  # not in the plant's unit


@dataclass(frozen=True)
class Expected:
    """A run to follow.

    Attributes:
        reference: y_r and its derivatives at each sample.
        columns: y and v at each sample.
        bounds: of the differences.
    """

    reference: list[list[float]]
    columns: Mapping[str, Any]
    bounds: Mapping[str, float]

    @property
    def samples(self) -> int:
        """How many there are."""
        return len(self.reference)

    def differences(self, found: Mapping[str, Sequence[float]]) -> dict[str, float]:
        """The largest difference in each column; NaN where one is not finite."""
        return {
            name: float(np.max(np.abs(np.asarray(found[name]) - self.columns[name]))) for name in _COLUMNS
        }


def not_compared(derivation: Derivation) -> str:
    """Why the units of a model are not compared with a run of it, or nothing."""
    model = derivation.model
    if model.segment:
        return "its reference is data"
    values = {item.symbol: item.value for item in model.parameters}
    acting = [key for key in _OF_SAMPLES if key in model.chain and values[model.chain[key]] != 0]
    if acting:
        return f"{' and '.join(acting)} belong to the tool that connects the units"
    rates = (*derivation.plant.disturbance, *(extra.rate for extra in model.extras))
    if any(rate.has(sp.sign) for rate in rates):
        return "friction that sticks is integrated in another way there"
    return ""


def expected_of(derivation: Derivation, model_file: Path, start: Sequence[sp.Symbol]) -> Expected:
    """Run a model, and again from displaced starts.

    Args:
        derivation: of the model.
        model_file: its file.
        start: what x0 consists of.
    """
    from pmjoint_codegen.closed_loop import ClosedLoop

    run = derivation.model.simulation
    T, samples = run.sample_time, min(_MOST, round(run.horizon / run.sample_time))
    loop = ClosedLoop.load(model_file)
    x0 = np.zeros(len(start))
    x0[: len(run.x0)] = run.x0

    def columns(first: Any, names: Sequence[str]) -> dict[str, Any]:
        found = loop.simulate(
            controller="sampled",
            horizon=samples * T,
            output_step=T,
            tolerance=TOLERANCE,
            x0=first.tolist(),
        )
        return {name: np.asarray(found[name])[:samples] for name in names}

    states = [symbol.name for symbol in start]
    nominal = columns(x0, [*_COLUMNS, *states])
    gains = dict.fromkeys(_COLUMNS, 0.0)
    for place, state in enumerate(states):
        size = max(1.0, float(np.max(np.abs(nominal[state]))))
        moved = x0.copy()
        moved[place] += _MOVED * size
        found = columns(moved, _COLUMNS)
        for name in _COLUMNS:
            gains[name] += float(np.sum(np.abs(found[name] - nominal[name]))) / _MOVED
    bounds = {name: gain * 2 * TOLERANCE for name, gain in gains.items()}
    return Expected(reference_of(derivation, samples), {name: nominal[name] for name in _COLUMNS}, bounds)


def reference_of(derivation: Derivation, samples: int) -> list[list[float]]:
    """y_r and its derivatives at each sample of the model's clock."""
    d, s = derivation, derivation.signals
    numbers = {item.symbol: sp.Float(item.value) for item in d.model.parameters}
    values = [d.equations.expand(d.equations[y_r.name].expression, keep=frozenset({s.t})) for y_r in s.y_r]
    functions = [sp.lambdify([s.t], value.xreplace(numbers), "math") for value in values]
    T = d.model.simulation.sample_time
    return [[float(function(k * T)) for function in functions] for k in range(samples)]
