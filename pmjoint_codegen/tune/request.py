"""All that the result of a tuning depends on, checked, as one record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal, Unpack

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.chain import SAMPLE_TIME
from pmjoint_codegen.errors import UsageError, did_you_mean
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.settings import CommandOptions, RunOptions
from pmjoint_codegen.sweep.chunks import fill_in
from pmjoint_codegen.sweep.plan import SATURATION, Plan, Sample, read_sample
from pmjoint_codegen.sweep.request import Request as Runs
from pmjoint_codegen.sweep.request import check_clock, varied_names
from pmjoint_codegen.sweep.request import make_request as make_runs
from pmjoint_codegen.sweep.validity import valid_rows
from pmjoint_codegen.tune.gains import Space, make_space
from pmjoint_codegen.tune.objective import Objective, read_objective

Over = Literal["worst", "mean"]

DEFAULT_PLANTS: Final = 16
MOST_PLANTS: Final = 10_000
MOST_RUNS: Final = 5_000_000  # of one generation: what is in memory at once
MAX_STEPS: Final = 200_000  # of one run: gains that need more are too stiff to be worthwhile


@dataclass(frozen=True)
class Request:
    """A tuning, as asked for.

    Attributes:
        space: gains that are searched.
        objective: what is minimised.
        over: plants: the worst one counts, or their mean.
        max_v: limit of |v| on every plant, in v's unit; None for none.
        drawn: the plants besides the model's own.
        runs: settings of every run.
        seed: of the draws and of the search.
        generations: of the search, at most.
        population: designs in a generation, for each coordinate.
        own: the model's value of every parameter that can be perturbed, in the model file's units.
    """

    space: Space
    objective: Objective
    over: Over
    max_v: float | None
    drawn: Plan
    runs: Runs
    seed: int
    generations: int
    population: int
    own: Mapping[str, float]

    __repr__ = brief

    @cached_property
    def plants(self) -> Mapping[str, Array]:
        """Perturbed values by name, shape (plants,): first the model's own, then the draws."""
        return {name: np.concatenate([[self.own[name]], values]) for name, values in self.drawn.drawn.items()}

    @property
    def count(self) -> int:
        """Number of plants."""
        return 1 + (self.drawn.draws if self.drawn.samples else 0)

    @property
    def most_designs(self) -> int:
        """Number of designs that are tried at most."""
        return (self.generations + 1) * self.members

    @property
    def members(self) -> int:
        """Designs in a generation; differential evolution needs five."""
        return max(5, self.population * self.space.size)


class TuneOptions(CommandOptions, total=False):
    """Keywords of a tuning, besides those of its runs; see `make_request`."""

    gains: tuple[str, ...]
    objective: str
    over: str
    max_v: float | None
    perturb: tuple[str, ...]
    plants: int | None
    seed: int
    generations: int
    population: int


def make_request(
    manifest: Manifest,
    *,
    gains: tuple[str, ...] = (),
    objective: str = "ise",
    over: str = "worst",
    max_v: float | None = None,
    perturb: tuple[str, ...] = (),
    plants: int | None = None,
    seed: int = 0,
    generations: int = 60,
    population: int = 8,
    **asked: Unpack[RunOptions],
) -> Request:
    """Complete a tuning from the model's defaults and check it.

    Args:
        manifest: the model.
        gains: as `make_space` takes them.
        objective: as `read_objective` takes it.
        over: ``worst`` or ``mean``.
        max_v: limit of |v|.
        perturb: ``NAME~LAW(A,B)``, a parameter of the plant, unknown to the controller, or an initial
            state.
        plants: number of draws.
        seed: not negative.
        generations: at least 1.
        population: at least 1.
        asked: settings of every run; see `ClosedLoop.simulate`.

    Raises:
        UsageError: for the first setting that is unknown or out of range.
    """
    space = make_space(manifest, gains)
    drawn = _drawn(manifest, space, perturb, plants, seed)
    runs = make_runs(manifest, Plan(()), **asked)
    check_clock(drawn, runs.controller)
    if max_v is not None and not 0 < max_v < math.inf:
        raise UsageError(f"is {max_v:g}", where="--max-v", remedy="allowed: a number greater than 0")
    if min(generations, population) < 1:
        raise UsageError(
            f"are {generations} and {population}",
            where="--generations and --population",
            remedy="allowed: whole numbers from 1",
        )
    values = manifest.written(dict(zip(manifest.parameter_names, runs.p, strict=False)))
    request = Request(
        space=space,
        objective=read_objective(objective),
        over="mean" if over == "mean" else "worst",
        max_v=max_v,
        drawn=drawn,
        runs=replace(runs, max_steps=MAX_STEPS),
        seed=seed,
        generations=generations,
        population=population,
        own={
            SAMPLE_TIME: runs.sample_time,
            **dict(zip(manifest.start.names, runs.x0, strict=True)),
            **values,
        },
    )
    if request.members * request.count > MOST_RUNS:
        raise UsageError(
            f"asks for {request.members} designs on {request.count} plants in a generation",
            where="--population and --plants",
            remedy=f"allowed: at most {MOST_RUNS} runs",
        )
    _check_plants(manifest, request)
    return request


def _check_plants(manifest: Manifest, request: Request) -> None:
    """Refuse draws with which no design could be simulated, whatever its gains."""
    if not request.plants:
        return
    x0, p = fill_in(manifest, request.runs, request.plants)
    bad = int(np.sum(~valid_rows(manifest, p, x0[:, : manifest.nx])))
    if bad:
        raise UsageError(
            f"draws {bad} plants that break a rule of the design, such as a limit of u that is not positive",
            where="--perturb",
            remedy="narrower laws, or uniform and loguniform instead of normal",
        )


def _drawn(manifest: Manifest, space: Space, perturb: tuple[str, ...], plants: int | None, seed: int) -> Plan:
    samples = tuple(_of_plant(manifest, _sample(text)) for text in perturb)
    if plants is not None and not samples:
        raise UsageError(
            "is the number of plants that --perturb draws",
            where="--plants",
            remedy="give --perturb 'b0~uniform(1.6,2.4)'",
        )
    count = DEFAULT_PLANTS if plants is None else plants
    if not 1 <= count <= MOST_PLANTS or seed < 0:
        raise UsageError(
            f"are {count} and {seed}",
            where="--plants and --seed",
            remedy=f"allowed: 1 to {MOST_PLANTS}, a seed from 0",
        )
    names = [sample.name for sample in samples]
    for name in names:
        _check_perturbed(manifest, space, name, names)
    return Plan((), samples, count if samples else 1, seed)


def _sample(text: str) -> Sample:
    try:
        return read_sample(text)
    except UsageError as error:
        raise UsageError(error.what, where="--perturb", remedy=error.remedy) from None


def _of_plant(manifest: Manifest, sample: Sample) -> Sample:
    """The draw of the plant's own value if the controller uses the parameter too: the controller's stays."""
    own = {name: own for own, name in manifest.own.items()}
    return replace(sample, name=own.get(sample.name, sample.name))


def _check_perturbed(manifest: Manifest, space: Space, name: str, names: list[str]) -> None:
    chosen = {SATURATION, *manifest.parameter_names}
    known = [item for item in varied_names(manifest) if item not in chosen]
    known += [item.name for item in manifest.parameters if item.kind in ("plant", "own")]
    if name not in known:
        hint = did_you_mean(name, known, str)
        raise UsageError(
            f"{manifest.name} has no {name!r} to perturb",
            where="--perturb",
            remedy=f"{hint}names: {', '.join(known)}",
        )
    if names.count(name) > 1 or name in space.gains:
        raise UsageError(f"{name} is given twice", where="--perturb", remedy="give each name once")
