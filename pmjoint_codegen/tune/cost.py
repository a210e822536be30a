"""One number per design: its objective over all plants, or how far it is from having one.

The numbers lie in tiers, so that a comparison is always correct: designs within the limit of v by their
objective, then those beyond it by how far, then those with a diverging plant by how early, then designs that
break a rule. All are finite.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.metrics import INVALID
from pmjoint_codegen.tune.request import Request

BEYOND: Final = 1e12  # cost from which on v passes its limit; no objective is larger
LOST: Final = 1e14  # ... a run does not reach the horizon
BROKEN: Final = 1e16  # ... the design breaks a rule, such as a Hurwitz A0


@dataclass(frozen=True)
class CostFunction:
    """Evaluates designs.

    Attributes:
        library: of the model.
        request: what is minimised, over which plants.
        threads: to simulate with; the result does not depend on it.
    """

    library: BatchLibrary
    request: Request
    threads: int = 1

    __repr__ = brief

    def metrics(self, gains: Mapping[str, Array]) -> Array:
        """Every design on every plant.

        Args:
            gains: name -> shape (designs,).

        Returns:
            Shape (designs, plants, columns), columns as in `sweep.metrics.Column`.
        """
        designs = len(next(iter(gains.values())))
        columns = cross(gains, self.request.plants)
        parts = np.array_split(np.arange(designs * self.request.count), self.threads)
        tasks = [{name: values[part] for name, values in columns.items()} for part in parts if len(part)]
        tables = _together(lambda task: simulate_chunk(self.library, self.request.runs, task).table, tasks)
        return np.concatenate(tables).reshape(designs, self.request.count, -1)

    def __call__(self, gains: Mapping[str, Array]) -> Array:
        """Cost of every design, shape (designs,), finite."""
        return cost(self.metrics(gains), self.request)


def cross(gains: Mapping[str, Array], plants: Mapping[str, Array]) -> dict[str, Array]:
    """Every design with every plant, the plants varying fastest: name -> shape (designs plants,)."""
    designs = len(next(iter(gains.values())))
    count = len(next(iter(plants.values()), np.empty(1)))
    repeated = {name: np.repeat(values, count) for name, values in gains.items()}
    return repeated | {name: np.tile(values, designs) for name, values in plants.items()}


def cost(metrics: Array, request: Request) -> Array:
    """Cost from metrics.

    Args:
        metrics: shape (designs, plants, columns).
        request: what is minimised.

    Returns:
        Shape (designs,), finite.

    Raises:
        UsageError: the objective is undefined on a plant, as settling where the error starts at 0.
    """
    status = metrics[..., Column.STATUS]
    done = status == Status.DONE
    values = request.objective(metrics)
    if np.any(done & np.isnan(values)):
        raise UsageError(
            "has no settling time: the error starts at 0",
            where=f"--objective {request.objective.text}",
            remedy="omit settling_s, or start elsewhere with --x0",
        )
    kept = np.where(done & (values < BEYOND), values, BEYOND)
    result = np.asarray(np.max(kept, axis=1) if request.over == "worst" else np.mean(kept, axis=1))
    if request.max_v is not None:
        peak = np.max(np.where(done, metrics[..., Column.MAX_ABS_V], 0.0), axis=1)
        excess = np.log10(np.maximum(peak / request.max_v, 1))
        result = np.where(peak > request.max_v, BEYOND * (1 + np.minimum(excess, 90)), result)
    missed = np.where(done, 0.0, 2 - np.nan_to_num(metrics[..., Column.T_END]) / request.runs.horizon)
    result = np.where(np.any(~done, axis=1), LOST * (1 + np.mean(missed, axis=1)), result)
    broken: Array = np.where(np.any(status == INVALID, axis=1), BROKEN, result)
    return broken


def _together(
    work: Callable[[Mapping[str, Array]], Array], tasks: Sequence[Mapping[str, Array]]
) -> list[Array]:
    if len(tasks) == 1:
        return [work(tasks[0])]
    with ThreadPoolExecutor(len(tasks)) as pool:
        return list(pool.map(work, tasks))
