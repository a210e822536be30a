"""No step of a continuous run carries an estimate out of its range."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pmjoint_codegen.simulate.run as simulate_run
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.loops.ranges import keep_in_ranges, ranged_states, ranges_of
from pmjoint_codegen.simulate.assumptions import remarks

ENDS = {"b0_hat": (0.3, 6.0), "d1_hat": (-3.0, 3.0)}
NEAR = {"d1_guess": float(np.nextafter(3.0, 0.0)), "gamma_b0": 0.0, "gamma_d1": 0.0}
Load = Callable[[str], ClosedLoop]


@pytest.fixture(scope="module")
def forced(tmp_path_factory: pytest.TempPathFactory) -> Load:
    """Load the paper's adaptive example, which may be clipped, with compiled or interpreted kernels."""
    folder = tmp_path_factory.mktemp("forced")
    root = Path(__file__).resolve().parent.parent.parent
    text = (root / "models" / "paper-adaptive.toml").read_text(encoding="utf-8")
    file = folder / "model.toml"
    file.write_text(text.replace("leakage = 0.0", "leakage = 0.0\nforce = true"), encoding="utf-8")
    environment = {**os.environ, "PMJOINT_CACHE": str(folder / "cache")}

    def load(kind: str) -> ClosedLoop:
        return ClosedLoop.load(file, evaluator=kind, environment=environment, notify=lambda line: None)

    return load


def test_a_state_beyond_its_ends_is_put_inside(forced: Load) -> None:
    loop = forced("interpreted")
    manifest = loop.manifest
    p = np.array([item.value for item in manifest.parameters])
    ranges = ranges_of(manifest, p)
    assert [manifest.states[int(place)].name for place in ranges[:, 0]] == ["b0_hat", "d1_hat"]
    assert ranged_states(manifest).shape == (2, 3)
    X = np.zeros(manifest.nX)
    X[ranges[:, 0].astype(int)] = 0.3 - 1e-9, 3.0
    keep_in_ranges(ranges, X)
    found = X[ranges[:, 0].astype(int)]
    assert 0.3 < found[0] < 0.3 + 1e-11 and 3.0 - 1e-11 < found[1] < 3.0
    X[ranges[:, 0].astype(int)] = 1.2, -0.5
    keep_in_ranges(ranges, X)
    assert X[ranges[:, 0].astype(int)].tolist() == [1.2, -0.5]


@pytest.mark.parametrize(
    ("kind", "horizon", "tolerance"),
    [("compiled", 1.0, 1e-8), ("compiled", 1.0, 1e-10), ("interpreted", 0.05, 1e-8)],
)
def test_estimates_that_clipping_drives_to_their_ends_stay_inside(
    forced: Load, kind: str, horizon: float, tolerance: float
) -> None:
    run = forced(kind).simulate(
        compensator=False, parameters={"gamma_d1": 20.0}, horizon=horizon, tolerance=tolerance
    )
    for name, (low, high) in ENDS.items():
        assert low < run[name].min() and run[name].max() < high
    if kind == "compiled":  # the other run is too short for that
        assert any("came to an end of its range" in text for text in remarks(run))
        assert any("clipping" in text for text in remarks(run))


@pytest.mark.parametrize("kind", ["compiled", "interpreted"])
def test_a_step_does_not_end_nearer_to_an_end(
    forced: Load, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulate_run, "keep_rows_in_ranges", lambda ranges, rows: None)  # the loop alone
    run = forced(kind).simulate(parameters=NEAR, horizon=0.5)
    assert run["d1_hat"][0] == NEAR["d1_guess"]
    assert run["d1_hat"][-1] < 3.0 - 2e-15


def test_rows_are_put_inside_too(forced: Load) -> None:
    run = forced("compiled").simulate(parameters=NEAR, horizon=0.05)
    assert run["d1_hat"].max() < 3.0 - 2e-15


def test_a_run_that_keeps_away_from_its_ends_is_not_remarked(forced: Load) -> None:
    assert remarks(forced("compiled").simulate(horizon=1.0)) == ()


def test_lanes_stay_inside_too(forced: Load) -> None:
    pytest.importorskip("xarray")
    from pmjoint_codegen import sweep

    still = {name: value for name, value in NEAR.items() if name != "gamma_b0"}
    near = sweep(forced("compiled"), grid={"gamma_b0": [0.0, 1.0]}, parameters=still, horizon=0.05)
    assert np.all(near["final_d1_hat"].values < 3.0 - 2e-15)
    data = sweep(forced("compiled"), grid={"gamma_b0": [0.5, 1.0, 2.0]}, saturation="clip", horizon=1.0)
    for name, (low, high) in ENDS.items():
        final = data[f"final_{name}"].values
        assert np.all((low < final) & (final < high))
