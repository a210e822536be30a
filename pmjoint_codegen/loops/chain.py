"""Sensor, actuator and clock of a sampled run: the readable twin of ``loops/c/pmjoint_chain.h``.

At its sample k, at ``t_k = k T`` or up to ``jitter`` later, the controller reads
``y_m = round((y + noise)/resolution) resolution`` and filters it,
``y_f += (1 - exp(-filter T)) (y_m - y_f)``, from the first reading: the exact hold of a first-order filter
whose input is y_m since the sample. Its law takes y_f and its own clock, k T. The command is v, with the dead
zone added, no further than ``rate T`` from the last one, within the limits. It acts from sample
``k + delay_samples`` on, ``delay`` later.

Random numbers are a function of (seed, sample, draw) alone: SplitMix64, and Marsaglia's polar method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from typing import Any, Final

import numpy as np

from pmjoint_codegen.chain import looped
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.modes import Actuator, Valve, make_actuator
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import OWN_SUFFIX

MEASURED, FILTERED, U, COMMAND, CLOCK, NEXT, ACTING = range(7)  # entries of what is held; w follows
_WORD: Final = (1 << 64) - 1
_LN2: Final = 0.69314718055994531


@dataclass(frozen=True)
class Chain:
    """One run's numbers, as ``pmj_chain`` has them.

    Attributes:
        zone: width of the dead zone that the controller adds, in u's unit.
        own: the valve's own.
        lower: limit of the command.
        upper: limit of the command.
        reach: greatest change of the command from sample to sample.
        delay: s.
        samples: samples until a command acts.
        jitter: s.
        resolution: of y; 0: none.
        noise: standard deviation, in y's unit.
        seed: of noise and jitter.
        gain: of the filter; 1: none.
        period: T, s.
    """

    zone: float
    own: float
    lower: float
    upper: float
    reach: float
    delay: float
    samples: float
    jitter: float
    resolution: float
    noise: float
    seed: float
    gain: float
    period: float

    @property
    def history(self) -> int:
        """How many commands wait at most, or act."""
        return math.ceil((self.delay + self.jitter) / self.period) + int(self.samples) + 3

    def vector(self) -> Array:
        """The numbers in order, shape (13,)."""
        return np.array(astuple(self))

    def instant(self, k: int) -> float:
        """The instant of sample k, s: late by up to the jitter, the first on time."""
        t = k * self.period
        return t + self.jitter * uniform(self.seed, k, 0) if self.jitter > 0.0 and k > 0 else t

    def read(self, y: float, k: int) -> float:
        """What the sensor reads at sample k."""
        noisy = y + self.noise * normal(self.seed, k) if self.noise > 0.0 else y
        if not (self.resolution > 0.0 and math.isfinite(noisy)):
            return noisy
        return float(np.rint(noisy / self.resolution)) * self.resolution

    def filtered(self, read: float, before: float, k: int) -> float:
        """What the controller makes of it, from what it made of the sample before."""
        return read if k == 0 or self.gain == 1.0 else before + self.gain * (read - before)

    def command(self, v: float, before: float) -> float:
        """The command, from v and the command before."""
        wanted = v + self.zone if v > 0.0 else v - self.zone if v < 0.0 else v
        return _between(_between(wanted, before - self.reach, before + self.reach), self.lower, self.upper)

    def u_of(self, command: float) -> float:
        """What is left of a command beyond the dead zone that the controller adds: u."""
        return _left(command, self.zone)

    def channels(self, limits: Array, command: float) -> Array:
        """W for a command, shape (nw,).

        Args:
            limits: shape (nw, 4): offset, slope, lower and upper limit of each channel.
            command: what the valve is told.
        """
        w = np.empty(len(limits))
        w[0] = self.u_of(command)
        valve = _left(command, self.own)
        for j, (offset, slope, lower, upper) in enumerate(limits.tolist()[1:], start=1):
            w[j] = _between(offset + slope * valve, lower, upper)
        return w

    @property
    def rest(self) -> float:
        """The command before the first sample."""
        return _between(0.0, self.lower, self.upper)


SIZE: Final = len(fields(Chain))


def is_looped(manifest: Manifest) -> bool:
    """Whether the sampled loop of a model has a sensor, an actuator or a clock to simulate."""
    return looped(manifest.chain)


def make_chain(manifest: Manifest, values: Mapping[str, float], period: float) -> Chain:
    """The numbers of a run.

    Args:
        manifest: the model.
        values: of all parameters by name, the plant's own included.
        period: T, s.
    """
    rows = chain_rows(manifest, {name: np.array([value]) for name, value in values.items()}, period)
    return Chain(*rows[0].tolist())


def chain_rows(manifest: Manifest, columns: Mapping[str, Array], period: float) -> Array:
    """The numbers of many runs, shape (runs, 13); see `make_chain`."""

    def of(key: str, default: float) -> Any:
        return columns[manifest.chain[key]] if key in manifest.chain else default

    limit = columns.get(manifest.limit, math.nan)
    zone, corner = of("dead_zone", 0.0), of("filter", math.inf)
    entries = Chain(
        zone=zone,
        own=columns.get(f"{manifest.chain.get('dead_zone')}{OWN_SUFFIX}", zone),
        lower=of("lower", -limit),  # type: ignore[arg-type]  # a column, here and below
        upper=of("upper", limit),  # type: ignore[arg-type]
        reach=of("rate", math.inf) * period,
        delay=of("delay", 0.0),
        samples=of("delay_samples", 0.0),
        jitter=of("jitter", 0.0),
        resolution=of("resolution", 0.0),
        noise=of("noise", 0.0),
        seed=of("seed", 0.0),
        gain=-np.expm1(-corner * period),
        period=period,
    )
    count = len(next(iter(columns.values())))
    table = [np.broadcast_to(entry, count) for entry in astuple(entries)]
    return np.column_stack(table).astype(np.float64)


def first_readings(rows: Array, y: Array) -> Array:
    """What the sensors of many runs read at the first sample, shape (runs,).

    Args:
        rows: from `chain_rows`.
        y: y(0), shape (runs,).
    """
    chain = Chain(*rows.T)
    seeds, places = np.unique(chain.seed, return_inverse=True)
    drawn = np.array([normal(seed, 0) for seed in seeds.tolist()])[places]
    noisy = np.where(chain.noise > 0.0, y + chain.noise * drawn, y)
    resolved = (chain.resolution > 0.0) & np.isfinite(noisy)
    steps = np.where(resolved, chain.resolution, 1.0)
    return np.where(resolved, np.rint(noisy / steps) * steps, noisy)


def longest_history(rows: Array) -> int:
    """The most commands that wait in any of some runs, from `chain_rows`."""
    return max((Chain(*row).history for row in np.unique(rows, axis=0).tolist()), default=0)


def actuator_of(evaluator: Evaluator, p: Array) -> Actuator:
    """The modes of a model's actuator at some parameters, its dead zone included."""
    manifest = evaluator.manifest
    limits = evaluator.call("actuation", p)[0]
    if "dead_zone" not in manifest.chain:
        return make_actuator(limits)
    chain = make_chain(manifest, dict(zip(manifest.parameter_names, p.tolist(), strict=False)), 1.0)
    return make_actuator(limits, Valve(chain.zone, chain.own, chain.lower, chain.upper))


def mixed(x: int) -> int:
    """SplitMix64's step (Steele, Lea, Flood 2014)."""
    x = (x + 0x9E3779B97F4A7C15) & _WORD
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & _WORD
    return x ^ (x >> 31)


def uniform(seed: float, k: int, draw: int) -> float:
    """A number between 0 and 1, both excluded, of a sample's draw."""
    bits = mixed((mixed((mixed(int(seed)) + k) & _WORD) + draw) & _WORD)
    return (float(bits >> 11) + 0.5) * 2.0**-53


def ln(x: float) -> float:
    """Natural logarithm of x > 0, by the series of the inverse hyperbolic tangent: equal bits everywhere."""
    m, e = math.frexp(x)
    if m < 0.70710678118654752:
        m, e = m * 2.0, e - 1
    f = (m - 1.0) / (m + 1.0)
    square, total = f * f, 0.0
    for k in range(23, 0, -2):
        total = total * square + 1.0 / k
    return 2.0 * f * total + e * _LN2


def normal(seed: float, k: int) -> float:
    """A standard normal number of a sample, by Marsaglia's polar method."""
    draw = 1
    while True:
        a = 2.0 * uniform(seed, k, draw) - 1.0
        b = 2.0 * uniform(seed, k, draw + 1) - 1.0
        square = a * a + b * b
        if 0.0 < square < 1.0:
            return a * math.sqrt(-2.0 * ln(square) / square)
        draw += 2


def _between(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


def _left(command: float, zone: float) -> float:
    """What is left of a command beyond a dead zone."""
    return command - _between(command, -zone, zone)
