"""The runs of a sweep: the product of its grid axes, and at every grid point the same random draws."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.values import BRAKING, CLIP, COMPENSATOR

Law = Literal["uniform", "normal", "loguniform", "integers"]
Method = Literal["latin-hypercube", "sobol"]

SATURATION: Final = "saturation"  # an axis of words
CODES: Final = MappingProxyType({CLIP: 0.0, COMPENSATOR: 1.0, BRAKING: 2.0})  # in the dataset
DRAW: Final = "draw"  # dimension of the sampled runs
MAX_RUNS: Final = 100_000_000  # 9 bytes per run while quantiles are computed: 0.9 GB
MAX_AXIS: Final = 1_000_000  # values of one axis, held as numbers and as the text of request.json
MAX_DRAWN: Final = 20_000_000  # draws times names: 25 bytes each
MAX_SEED: Final = 2**63 - 1  # the largest that every format of the dataset can hold
_SAMPLE: Final = re.compile(r"\s*(\w+)\s*~\s*(\w+)\s*\(([^,()]+),([^,()]+)\)\s*")


@dataclass(frozen=True)
class Axis:
    """One grid axis.

    Attributes:
        name: of a parameter, gain or initial state.
        values: along the axis, in the order given.
    """

    name: str
    values: tuple[float, ...]

    __repr__ = brief


@dataclass(frozen=True)
class Sample:
    """One sampled value.

    Attributes:
        name: of a parameter, gain or initial state.
        law: distribution.
        first: lower end, or the mean of a normal one.
        second: upper end, or the standard deviation of a normal one. Whole numbers include both ends.
    """

    name: str
    law: Law
    first: float
    second: float

    def quantile(self, u: Array) -> Array:
        """Values at the probabilities u, shape (draws,)."""
        from scipy.special import ndtri

        if self.law == "normal":
            return np.asarray(self.first + self.second * ndtri(u), dtype=np.float64)
        if self.law == "integers":
            drawn = np.floor(self.first + (self.second - self.first + 1.0) * u)
            return np.asarray(np.minimum(drawn, self.second), dtype=np.float64)
        if self.law == "loguniform":
            low, high = math.log(self.first), math.log(self.second)
            return np.asarray(np.exp(low + (high - low) * u), dtype=np.float64)
        return np.asarray(self.first + (self.second - self.first) * u, dtype=np.float64)


@dataclass(frozen=True)
class Plan:
    """All runs, numbered row-major over the axes, the draws varying fastest.

    Attributes:
        axes: grid.
        samples: sampled values.
        draws: number of draws at every grid point; 1 without samples.
        seed: of the draws.
        method: how they fill the space.
    """

    axes: tuple[Axis, ...]
    samples: tuple[Sample, ...] = ()
    draws: int = 1
    seed: int = 0
    method: Method = "latin-hypercube"

    __repr__ = brief

    @property
    def names(self) -> tuple[str, ...]:
        """The varied names: the axes', then the samples'."""
        return (*(axis.name for axis in self.axes), *(sample.name for sample in self.samples))

    @property
    def dimensions(self) -> dict[str, int]:
        """Name and length of every dimension of the result."""
        lengths = {axis.name: len(axis.values) for axis in self.axes}
        return {**lengths, DRAW: self.draws} if self.samples else lengths

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.dimensions.values())

    @property
    def saturation(self) -> str | None:
        """``braking`` if an axis needs kernels of a braking compensator, which do all kinds; else None."""
        codes = (axis.values for axis in self.axes if axis.name == SATURATION)
        return BRAKING if any(CODES[BRAKING] in values for values in codes) else None

    @cached_property
    def grid(self) -> Mapping[str, Array]:
        """Values along the axes by name."""
        return {axis.name: np.array(axis.values) for axis in self.axes}

    @cached_property
    def drawn(self) -> Mapping[str, Array]:
        """Sampled values by name, shape (draws,)."""
        if not self.samples:
            return {}
        u = _unit_draws(self.method, len(self.samples), self.draws, self.seed)
        return {sample.name: sample.quantile(u[:, i]) for i, sample in enumerate(self.samples)}

    def columns(self, start: int, stop: int) -> dict[str, Array]:
        """Values of every varied name in the runs start..stop-1, shape (stop - start,)."""
        return self.at(np.arange(start, stop))

    def at(self, runs: npt.NDArray[np.int64]) -> dict[str, Array]:
        """Values of every varied name in some runs, each of the shape of `runs`."""
        if not self.dimensions:
            return {}
        places = np.unravel_index(runs, tuple(self.dimensions.values()))
        by_name = dict(zip(self.dimensions, places, strict=True))
        grid = {name: values[by_name[name]] for name, values in self.grid.items()}
        return grid | {name: values[by_name[DRAW]] for name, values in self.drawn.items()}


def make_plan(
    grid: tuple[str, ...], sample: tuple[str, ...], draws: int | None, seed: int, method: str
) -> Plan:
    """Read the options of a sweep.

    Args:
        grid: ``NAME=FIRST:LAST:COUNT`` or ``NAME=A,B,C``.
        sample: ``NAME~LAW(A,B)``.
        draws: number of draws; needed with samples, and only with them.
        seed: not negative.
        method: ``latin-hypercube`` or ``sobol``.

    Raises:
        UsageError: an option that cannot be parsed, a name given twice, or too many runs.
    """
    if method not in get_args(Method):
        raise UsageError(f"is {method!r}", where="--method", remedy=f"allowed: {', '.join(get_args(Method))}")
    plan = Plan(
        axes=tuple(read_axis(text) for text in grid),
        samples=tuple(read_sample(text) for text in sample),
        draws=draws or 1,
        seed=seed,
        method="sobol" if method == "sobol" else "latin-hypercube",
    )
    names = list(plan.names)
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise UsageError(
            f"{twice} is varied twice", where="sweep", remedy="give each name one --grid or one --sample"
        )
    if not names:
        raise UsageError(
            "nothing is varied",
            where="sweep",
            remedy="give --grid c1=5:25:21, or --sample 'c1~uniform(5,25)'",
        )
    if bool(plan.samples) != (draws is not None):
        raise UsageError(
            "belong together", where="--sample and --runs", remedy="--runs is the number of draws of --sample"
        )
    if (draws is not None and draws < 1) or plan.runs > MAX_RUNS:
        runs = plan.runs if draws is None or draws > 0 else draws
        raise UsageError(f"asks for {runs} runs", where="sweep", remedy=f"allowed: 1 to {MAX_RUNS}")
    if plan.draws * len(plan.samples) > MAX_DRAWN:
        raise UsageError(
            f"is {plan.draws}, of {len(plan.samples)} names",
            where="--runs",
            remedy=f"at most {MAX_DRAWN // len(plan.samples)} draws fit; a --grid multiplies them",
        )
    if not 0 <= seed <= MAX_SEED:
        raise UsageError(f"is {seed}", where="--seed", remedy=f"allowed: 0 to {MAX_SEED}")
    return plan


def read_axis(text: str) -> Axis:
    """Read ``NAME=FIRST:LAST:COUNT`` or ``NAME=A,B,C``.

    Raises:
        UsageError: for anything else.
    """
    name, sign, rest = text.partition("=")
    parts = rest.split(":")
    try:
        if len(parts) == 3:
            count = int(parts[2])
            if count < 1:
                raise ValueError
            _check_length(text, count)
            values = _spaced(float(parts[0]), float(parts[1]), count)
        elif name.strip() == SATURATION:
            values = tuple(_code(part.strip()) for part in rest.split(","))
        else:
            values = tuple(float(part) for part in rest.split(","))
    except ValueError:
        values = ()
    if not sign or not name.strip() or not values or not all(map(math.isfinite, values)):
        raise UsageError(
            f"is {text!r}",
            where="--grid",
            remedy="allowed: NAME=FIRST:LAST:COUNT or NAME=A,B,C, such as c1=5:25:21",
        )
    if len(set(values)) < len(values):
        raise UsageError(
            f"is {text!r}, which has a value twice", where="--grid", remedy="give each value of an axis once"
        )
    return Axis(name.strip(), values)


def _code(word: str) -> float:
    if word not in CODES:
        raise UsageError(
            f"is {word!r}",
            where=f"--grid {SATURATION}",
            remedy=f"allowed: {', '.join(CODES)}, such as {SATURATION}=compensator,braking",
        )
    return CODES[word]


def _check_length(text: str, count: int) -> None:
    """Refuse an axis that would take gigabytes, before it is computed."""
    if count > MAX_AXIS:
        raise UsageError(
            f"is {text!r}",
            where="--grid",
            remedy=f"at most {MAX_AXIS} values fit on an axis; axes multiply, and --sample draws more",
        )


def _spaced(first: float, last: float, count: int) -> tuple[float, ...]:
    """Evenly spaced values; ends whose difference would overflow are halved first, which is exact there."""
    if not (math.isfinite(first) and math.isfinite(last)):
        return (math.nan,)  # refused with all other non-finite values
    scale = 1.0 if math.isfinite(last - first) else 2.0
    return tuple((scale * np.linspace(first / scale, last / scale, count)).tolist())


def read_sample(text: str) -> Sample:
    """Read ``NAME~LAW(A,B)``.

    Raises:
        UsageError: for anything else, and for numbers that define no distribution.
    """
    match = _SAMPLE.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        sample = Sample(match[1], _law(match[2]), float(match[3]), float(match[4]))
    except ValueError:
        raise UsageError(
            f"is {text!r}",
            where="--sample",
            remedy="allowed: NAME~normal(MEAN,SD), NAME~uniform(LOW,HIGH), NAME~loguniform(LOW,HIGH), "
            "NAME~integers(LOW,HIGH)",
        ) from None
    good = sample.second > 0 if sample.law == "normal" else sample.second > sample.first
    finite = all(map(math.isfinite, (sample.first, sample.second, sample.second - sample.first)))
    if sample.law == "integers":
        good = (
            good and sample.first == math.floor(sample.first) and sample.second == math.floor(sample.second)
        )
    if not (good and finite) or (sample.law == "loguniform" and sample.first <= 0):
        raise UsageError(
            f"is {text!r}",
            where="--sample",
            remedy="a normal needs SD > 0, the others LOW < HIGH, loguniform LOW > 0, integers whole numbers",
        )
    return sample


def _law(name: str) -> Law:
    for law in get_args(Law):
        if law == name:
            return law  # type: ignore[no-any-return]  # get_args is untyped
    raise ValueError(name)


def _unit_draws(method: Method, size: int, draws: int, seed: int) -> Array:
    """Points of the unit cube, shape (draws, size), inside it."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # Sobol's balance holds for powers of two; other numbers are the user's choice
        kind = qmc.Sobol if method == "sobol" else qmc.LatinHypercube
        u = kind(size, seed=generator).random(draws)
    return np.clip(np.asarray(u, dtype=np.float64), 2.0**-53, 1.0 - 2.0**-53)
