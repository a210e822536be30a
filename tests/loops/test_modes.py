from __future__ import annotations

import numpy as np
import pytest

from pmjoint_codegen.loops.modes import make_actuator


def test_the_papers_actuator_has_three_modes() -> None:
    actuator = make_actuator(np.array([0.0, 1.0, -10.0, 10.0]))
    assert actuator.thresholds.tolist() == [-10.0, 10.0]
    assert actuator.modes.tolist() == [[-10.0, 0.0], [0.0, 1.0], [10.0, 0.0]]
    assert actuator.labels == (-1, 0, 1)


@pytest.mark.parametrize(
    "channels",
    [
        [(0.0, 1.0, -1.0, 3.0), (2.0, 0.5, 0.0, 5.0), (2.0, -0.5, 0.0, 5.0)],  # two pressures, in opposition
        [
            (0.0, 1.0, -1.0, 1.0),
            (1.0, 0.0, 0.0, 5.0),
            (9.0, 0.0, 0.0, 5.0),
            (-9.0, 0.0, 0.0, 5.0),
        ],  # constants
        [
            (0.0, 1.0, -np.inf, 2.0),
            (0.0, 2.0, -2.0, 2.0),
            (1.0, -1.0, 0.0, np.inf),
        ],  # one-sided, shared thresholds
        [(0.0, 1.0, -np.inf, np.inf)],
    ],
)
def test_every_mode_is_what_clipping_gives_between_its_thresholds(channels: list[tuple[float, ...]]) -> None:
    actuator = make_actuator(np.array(channels).ravel())
    thresholds = actuator.thresholds
    assert np.all(np.diff(thresholds) > 0)
    assert actuator.modes.shape == (len(thresholds) + 1, 2 * len(channels))
    for v in np.random.default_rng(1).uniform(-20.0, 20.0, size=500):
        mode = int(np.searchsorted(thresholds, v))
        for j, (offset, slope, lower, upper) in enumerate(channels):
            expected = min(max(offset + slope * v, lower), upper)
            given, gain = actuator.modes[mode, 2 * j : 2 * j + 2]
            assert given + gain * v == pytest.approx(expected, abs=1e-14)
        lower, upper = channels[0][2:]
        assert actuator.labels[mode] == int(v > upper) - int(v < lower)
