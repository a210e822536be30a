"""Random numbers of sensor and clock against published values and SciPy; the valve's modes."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy import stats

from pmjoint_codegen.loops.chain import Chain, ln, mixed, normal, uniform
from pmjoint_codegen.loops.modes import Valve, make_actuator


def chain(**changed: float) -> Chain:
    usual = {
        "zone": 0.0,
        "own": 0.0,
        "lower": -10.0,
        "upper": 10.0,
        "reach": math.inf,
        "delay": 0.0,
        "samples": 0.0,
        "jitter": 0.0,
        "resolution": 0.0,
        "noise": 0.0,
        "seed": 1.0,
        "gain": 1.0,
        "period": 0.01,
    }
    return Chain(**(usual | changed))


def test_splitmix_gives_its_published_sequence() -> None:
    # The first numbers of SplitMix64 from the seed 1234567, as in its authors' test.
    golden, state = 0x9E3779B97F4A7C15, 1234567
    found = [mixed((state + i * golden) % 2**64) for i in range(3)]
    assert found == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_the_logarithm_is_right_to_two_roundings() -> None:
    x = np.concatenate([np.geomspace(1e-300, 1e300, 4001), 1.0 + np.linspace(-0.4, 0.6, 4001)])
    found = np.array([ln(value) for value in x.tolist()])
    assert np.max(np.abs(found - np.log(x)) / np.maximum(np.abs(np.log(x)), 1e-16)) < 5e-16


@pytest.mark.parametrize("seed", [0.0, 1.0, 2.0**53])
def test_noise_is_normal_and_independent_of_its_neighbours(seed: float) -> None:
    count = 4000
    found = np.array([normal(seed, k) for k in range(count)])
    assert stats.kstest(found, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(found[1:], found[:-1])[0, 1]) < 4 / math.sqrt(count)
    even = np.array([uniform(seed, k, 0) for k in range(count)])
    assert stats.kstest(even, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(found, even)[0, 1]) < 4 / math.sqrt(count)


def test_seeds_differ_and_a_sample_s_number_depends_on_nothing_else() -> None:
    assert normal(3.0, 17) == normal(3.0, 17)
    assert len({normal(float(seed), 17) for seed in range(100)}) == 100


def test_a_reading_is_a_multiple_of_the_resolution_nearest_to_y() -> None:
    coarse = chain(resolution=0.25)
    readings = {0.1: 0.0, 0.13: 0.25, -0.13: -0.25, 0.125: 0.0, 0.375: 0.5}  # ties to even
    assert {y: coarse.read(y, 3) for y in readings} == readings


def test_samples_are_late_by_less_than_the_jitter_and_the_first_on_time() -> None:
    late = chain(jitter=0.004)
    lateness = np.array([late.instant(k) - 0.01 * k for k in range(1000)])
    assert lateness[0] == 0.0
    assert 0.0 < lateness[1:].min() < 1e-4 and 0.0039 < lateness.max() < 0.004


@pytest.mark.parametrize(
    ("v", "before", "expected"),
    [
        (0.0, 0.0, 0.0),
        (0.1, 0.0, 0.6),
        (-0.1, 0.0, -0.6),
        (4.0, 0.0, 1.0),
        (4.0, 1.5, 2.0),
        (-9.0, 0.0, -1.0),
    ],
)
def test_a_command_crosses_the_dead_zone_slowly_and_within_limits(
    v: float, before: float, expected: float
) -> None:
    assert chain(zone=0.5, reach=1.0, lower=-1.5, upper=2.0).command(v, before) == expected


def dead(q: float, width: float) -> float:
    return math.copysign(max(abs(q) - width, 0.0), q)


def test_the_valve_s_modes_are_its_definition_at_every_v() -> None:
    random, worst = np.random.default_rng(5), 0.0
    widths, limits = (0.0, 0.5, 0.65, 1.3, 3.0), (0.0, 0.4, 2.0, 6.0)
    for zone, own, low, upper in product(widths, widths, limits, limits):
        if low == upper == 0.0:
            continue
        channels = [0.0, 1.0, dead(-low, zone), dead(upper, zone), 0.3, 2.0, -3.0, 2.5, 0.0, -1.5, -2.0, 7.0]
        actuator = make_actuator(np.array(channels), Valve(zone, own, -low, upper))
        for v in random.uniform(-9.0, 9.0, 40):
            g = actuator.modes[int(np.sum(v > actuator.thresholds))]
            q = min(max(v + zone * np.sign(v), -low), upper)
            valve = dead(q, own)
            expected = [
                dead(q, zone),
                min(max(0.3 + 2.0 * valve, -3.0), 2.5),
                min(max(-1.5 * valve, -2.0), 7.0),
            ]
            found = [g[2 * j] + g[2 * j + 1] * v for j in range(3)]
            worst = max(worst, float(np.max(np.abs(np.array(found) - expected))))
    assert worst < 1e-14 * 20
