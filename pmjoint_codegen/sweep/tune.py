"""Gains that make a stated objective small over perturbed plants, found by differential evolution.

The objective of a set of gains is a weighted sum of metrics, each averaged over the plants and divided by
what the gains of the model file give, so that weights compare and 1 is "as before". A plant on which the
joint is lost, or v passes its limit, costs more than any that keeps the rules, and the more the further it is
    from keeping them: the search finds its way back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.kernels.batch import BatchLibrary
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.status import Status
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.metrics import Column
from pmjoint_codegen.sweep.request import Request

OBJECTIVES: Final = {
    "ise": Column.ISE,
    "max_abs_e": Column.MAX_ABS_E,
    "settling_s": Column.SETTLING_S,
    "saturated_s": Column.SATURATED_S,
    "max_abs_v": Column.MAX_ABS_V,
}
BROKEN: Final = 1e3  # cost of a plant that breaks a rule, in multiples of "as before"
FLOOR: Final = 1e-9  # below it a metric of the model file's gains is no measure


@dataclass(frozen=True)
class Goal:
    """What is to be found.

    Attributes:
        bounds: gain -> lowest and highest value, both positive.
        weights: metric -> weight, positive.
        limit: on the largest |v| over all plants; infinite for none.
        plants: perturbed values by name, shape (plants,); entry 0 is the model file's.
    """

    bounds: Mapping[str, tuple[float, float]]
    weights: Mapping[str, float]
    limit: float
    plants: Mapping[str, Array]


@dataclass(frozen=True)
class Tuned:
    """What was found.

    Attributes:
        gains: by name.
        cost: of the gains found; those of the model file cost the sum of the weights, if they keep the rules.
        cost_before: of the gains of the model file.
        before: metric -> mean over the plants.
        after: likewise.
        peak_before: largest |v| over the plants.
        peak_after: likewise.
        runs: closed-loop runs that it took.
    """

    gains: Mapping[str, float]
    cost: float
    cost_before: float
    before: Mapping[str, float]
    after: Mapping[str, float]
    peak_before: float
    peak_after: float
    runs: int


def check_goal(manifest: Manifest, goal: Goal) -> None:
    """Check names and ranges.

    Raises:
        UsageError: for the first that is unknown or impossible.
    """
    gains = [item.name for item in manifest.parameters if item.kind == "gain"]
    if not goal.bounds:
        raise UsageError(
            "nothing is free", where="tune", remedy=f"give --bound c1=2:40; gains: {', '.join(gains)}"
        )
    for name, (low, high) in goal.bounds.items():
        if name not in gains:
            raise UsageError(
                f"{manifest.name} has no gain {name!r}", where="--bound", remedy=f"gains: {', '.join(gains)}"
            )
        if not 0 < low < high < math.inf:
            raise UsageError(
                f"{name} from {low:g} to {high:g}", where="--bound", remedy="allowed: 0 < LOW < HIGH"
            )
    for name, weight in goal.weights.items():
        if name not in OBJECTIVES or not 0 < weight < math.inf:
            raise UsageError(
                f"{name}={weight:g}",
                where="--weight",
                remedy=f"a positive weight for {', '.join(OBJECTIVES)}",
            )
    if not goal.limit > 0:
        raise UsageError(f"is {goal.limit:g}", where="--limit-v", remedy="allowed: a number greater than 0")


def tune(
    library: BatchLibrary,
    request: Request,
    goal: Goal,
    *,
    seed: int,
    generations: int,
    tell: Callable[[float], None],
) -> Tuned:
    """Search for gains.

    Args:
        library: of the model.
        request: settings of every run; its plan is not used.
        goal: what is to be found.
        seed: of the search.
        generations: of differential evolution.
        tell: told the fraction done.

    Raises:
        SimulationError: the gains of the model file lose the joint on every plant, so there is nothing to
            compare with.
    """
    from scipy.optimize import differential_evolution

    search = _Search(library, request, goal)
    logs = [(math.log(low), math.log(high)) for low, high in goal.bounds.values()]
    own = dict(zip(library.manifest.parameter_names, request.p, strict=True))
    start = [
        min(max(math.log(own[name]), low), high) for name, (low, high) in zip(goal.bounds, logs, strict=True)
    ]
    done = 0

    def generation(*_: Any, **__: Any) -> None:
        nonlocal done
        done += 1
        tell(min(done / generations, 1.0))

    found = differential_evolution(
        lambda x: search.costs(np.exp(x.T if x.ndim > 1 else x[np.newaxis])),
        logs,
        x0=start,
        seed=np.random.default_rng(seed),
        maxiter=generations,
        tol=1e-4,
        polish=False,
        vectorized=True,
        updating="deferred",
        callback=generation,
    )
    return search.account(np.exp(np.asarray(found.x, dtype=np.float64)))


class _Search:
    """The objective, with what it is measured against."""

    def __init__(self, library: BatchLibrary, request: Request, goal: Goal) -> None:
        self.library, self.request, self.goal = library, request, goal
        self.runs = 0
        own = dict(zip(library.manifest.parameter_names, request.p, strict=True))
        self.own = np.array([own[name] for name in goal.bounds])
        table = self._tables(self.own[np.newaxis])[0]
        good = table[:, Column.STATUS] == Status.DONE
        if not np.any(good):
            raise SimulationError(
                "the gains of the model file lose the joint on every plant", where=request.model
            )
        self.scale = {name: max(self._mean(table[good], name), FLOOR) for name in goal.weights}

    def _tables(self, gains: Array) -> Array:
        """Metrics of every set of gains on every plant, shape (sets, plants, columns)."""
        plants = len(next(iter(self.goal.plants.values())))
        columns = {name: np.repeat(gains[:, i], plants) for i, name in enumerate(self.goal.bounds)}
        columns |= {name: np.tile(values, len(gains)) for name, values in self.goal.plants.items()}
        self.runs += len(gains) * plants
        return simulate_chunk(self.library, self.request, columns).table.reshape(len(gains), plants, -1)

    def costs(self, gains: Array) -> Array:
        """Cost of every set of gains, shape (sets,)."""
        return np.array([self._cost(table) for table in self._tables(gains)])

    def _cost(self, table: Array) -> float:
        lost = table[:, Column.STATUS] != Status.DONE
        if np.any(lost):
            reached = np.nan_to_num(table[lost, Column.T_END]) / self.request.horizon
            return 2 * BROKEN * (1.0 + float(np.mean(lost)) + float(np.mean(1.0 - reached)))
        excess = float(np.max(table[:, Column.MAX_ABS_V])) / self.goal.limit - 1.0
        if excess > 0:
            return BROKEN * (1.0 + min(excess, 1.0))
        return sum(
            weight * self._mean(table, name) / self.scale[name] for name, weight in self.goal.weights.items()
        )

    def _mean(self, table: Array, name: str) -> float:
        values = table[:, OBJECTIVES[name]]
        return float(np.mean(np.nan_to_num(values)))  # an initial error of 0 has settled

    def account(self, gains: Array) -> Tuned:
        """Compare gains with those of the model file."""
        before, after = self._tables(np.stack([self.own, gains]))
        return Tuned(
            gains=dict(zip(self.goal.bounds, gains.tolist(), strict=True)),
            cost=self._cost(after),
            cost_before=self._cost(before),
            before={name: self._mean(before, name) for name in OBJECTIVES},
            after={name: self._mean(after, name) for name in OBJECTIVES},
            peak_before=float(np.max(before[:, Column.MAX_ABS_V])),
            peak_after=float(np.max(after[:, Column.MAX_ABS_V])),
            runs=self.runs,
        )


def perturbed(own: Mapping[str, float], drawn: Mapping[str, Array]) -> dict[str, Array]:
    """The plants of a goal: the model's own, then the draws; without draws the model's own alone."""
    if not drawn:
        name = next(iter(own))
        return {name: np.array([own[name]])}
    return {name: np.concatenate([[own[name]], values]) for name, values in drawn.items()}


def with_gains(text: str, gains: Mapping[str, float], design: Mapping[str, Sequence[float]]) -> str:
    """A model file's text with other gains in ``[design]``, all else as it was, comments too.

    Args:
        text: of the model file.
        gains: new values by name, ``c1`` for the first entry of ``c``.
        design: the lists of gains in the model file.

    Raises:
        UsageError: a list does not stand on one line of its own.
    """
    lines, section = text.splitlines(), ""
    wanted = {key: _changed(key, values, gains) for key, values in design.items()}
    for number, line in enumerate(lines):
        if line.startswith("["):
            section = line.split("#")[0].strip()
        key = line.split("=")[0].strip()
        if section == "[design]" and key in wanted and line.count("[") == line.count("]") == 1:
            comment = line[line.index("]") + 1 :]
            lines[number] = f"{line[: line.index('[')]}[{', '.join(map(repr, wanted.pop(key)))}]{comment}"
    if wanted:
        raise UsageError(f"{', '.join(wanted)} must stand on one line of [design]", where="model file")
    return "\n".join(lines) + "\n"


def _changed(key: str, values: Sequence[float], gains: Mapping[str, float]) -> list[float]:
    return [gains.get(f"{key}{i}", value) for i, value in enumerate(values, start=1)]
