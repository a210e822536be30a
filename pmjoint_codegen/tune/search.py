"""Differential evolution over designs: SciPy's, a whole generation in one call of the batch library."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.tune.cost import BEYOND, BROKEN, LOST, CostFunction
from pmjoint_codegen.tune.gains import Space

SPREAD: Final = 1e-4  # of the costs in a generation, relative, at which the search ends
NEAR: Final = 0.01  # of the distance between two bounds: counts as at a bound

Tell = Callable[[int], None]


@dataclass(frozen=True)
class Found:
    """The result of a search.

    Attributes:
        gains: name -> value.
        cost: the objective over all plants.
        before: cost of the model's own gains; from `BEYOND` on, they violate the limit or a plant diverges.
        designs: number of designs tried.
        generations: number of generations.
        settled: whether the search ended because all designs had become alike.
        edges: coordinates that ended at a bound; beyond it there may be better designs.
    """

    gains: Mapping[str, float]
    cost: float
    before: float
    designs: int
    generations: int
    settled: bool
    edges: tuple[str, ...]


def search(costing: CostFunction, tell: Tell = lambda designs: None) -> Found:
    """Search for the gains of least cost; the same seed finds the same gains.

    Args:
        costing: evaluates designs.
        tell: called with the number of designs tried.

    Raises:
        UsageError: no design in the bounds satisfies the limit, or none is better than the model.
    """
    request, tried = costing.request, 0
    space = request.space
    present = own_gains(costing)
    before = float(costing({name: np.array([value]) for name, value in present.items()})[0])

    def costs(points: Array) -> Array:
        nonlocal tried
        columns = points.reshape(space.size, -1)
        result = costing(space.decode(columns.T))
        tried += columns.shape[1]
        tell(tried)
        return result

    found = _evolve(costs, costing)
    gains = {name: float(value[0]) for name, value in space.decode(found.x[np.newaxis, :]).items()}
    best = float(found.fun)
    _check(best, before, tried, costing)
    settled = bool(found.success)
    return Found(gains, best, before, tried, int(found.nit), settled, _edges(space, found.x))


def _edges(space: Space, point: Array) -> tuple[str, ...]:
    """Coordinates within `NEAR` of the way from one bound to the other."""
    low, high = space.limits.T
    place = (point - low) / (high - low)
    near = (place < NEAR) | (place > 1 - NEAR)
    return tuple(bound.name for bound, at in zip(space.bounds, near, strict=True) if at)


def own_gains(costing: CostFunction) -> dict[str, float]:
    """The model's values of the gains that are searched."""
    values = {item.name: float(item.value) for item in costing.library.manifest.settable}
    return {name: values[name] for name in costing.request.space.gains}


def _evolve(costs: Callable[[Array], Array], costing: CostFunction) -> Any:
    from scipy.optimize import differential_evolution

    request, limits = costing.request, costing.request.space.limits
    generator = np.random.default_rng(request.seed)
    first = _first(limits, request.space.start, request.members, generator)
    return differential_evolution(
        costs,
        limits,
        init=first,
        maxiter=request.generations,
        tol=SPREAD,
        mutation=(0.4, 0.9),
        recombination=0.9,
        polish=False,
        updating="deferred",
        vectorized=True,
        seed=generator,
    )


def _first(limits: Array, start: Array, members: int, generator: np.random.Generator) -> Array:
    """The first generation: the model's own design, and a Latin hypercube; shape (members, size)."""
    from scipy.stats import qmc

    u = np.asarray(qmc.LatinHypercube(len(limits), seed=generator).random(members), dtype=np.float64)
    points = limits[:, 0] + u * (limits[:, 1] - limits[:, 0])
    points[0] = start
    return points


def _check(best: float, before: float, tried: int, costing: CostFunction) -> None:
    if best >= BEYOND:
        lacking, remedy = _shortfall(best, costing)
        raise UsageError(f"none of {tried} designs {lacking}", where="tune", remedy=remedy)
    if best >= before:
        raise UsageError(
            f"none of {tried} designs is better than the model's own",
            where="tune",
            remedy="wider bounds (--gain NAME=LOW:HIGH) or more --generations",
        )


def _shortfall(best: float, costing: CostFunction) -> tuple[str, str]:
    """What even the best design lacks, by the tier of its cost, and what may help."""
    remedy = "wider bounds (--gain NAME=LOW:HIGH), more --generations, or weaker requirements"
    if best >= BROKEN:
        return "satisfies the rules of the design (finite gains, a Hurwitz A0)", remedy
    if best >= LOST:
        return "reaches the horizon on all plants", remedy
    if best > BEYOND:
        return f"keeps |v| <= {costing.request.max_v:g}", remedy
    return f"has an objective below {BEYOND:g}", "give smaller weights in --objective"
