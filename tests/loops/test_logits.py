"""An estimate with a range is moved by its logit, which has no end, and stays inside for any run."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.loops.logits import inside, logit_states, place_of, put_estimates, reach_of
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.assumptions import remarks

ENDS = {"b0_hat": (0.3, 6.0), "d1_hat": (-3.0, 3.0)}
CLIPPED: dict[str, Any] = {"compensator": False, "horizon": 20.0, "output_step": 0.01}
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


@pytest.fixture(scope="module")
def clipped(forced: Load) -> Run:
    return forced("compiled").simulate(**CLIPPED)


def test_clipping_drives_logits_far_and_the_run_is_still_the_solution(clipped: Run) -> None:
    """ISE, late |e| and the peak of v as of another integrator, in other coordinates: heyoka's 106.1719."""
    assert clipped.summary["status"] == "done"
    assert clipped.summary["ise"] == pytest.approx(106.17, abs=0.01)
    assert np.max(np.abs(clipped["e"][clipped["t"] > 13.0])) == pytest.approx(4.68, abs=0.005)
    assert clipped.summary["max_abs_v"] == pytest.approx(70711.7, rel=1e-4)
    assert np.min(clipped["b0_logit"]) < -1e5  # far beyond the limit of divergence, which does not count here
    for name, (low, high) in ENDS.items():
        assert low < clipped[name].min() and clipped[name].max() < high


def test_it_says_that_estimates_are_at_their_ends(clipped: Run, forced: Load) -> None:
    said = remarks(clipped)
    assert any("b0_hat came to 0.3" in text for text in said)
    assert any("d1_hat came to 3" in text for text in said)
    assert remarks(forced("compiled").simulate(horizon=1.0)) == ()


def test_a_sampled_run_that_is_kept_just_inside_says_so_too(forced: Load) -> None:
    run = forced("compiled").simulate(controller="sampled", sample_time=0.01, compensator=False, horizon=2.0)
    assert np.max(np.abs(run["b0_logit"])) == 14.0
    assert any("b0_hat came to 0.3" in text for text in remarks(run))


def test_interpreted_runs_and_lanes_go_as_far(forced: Load) -> None:
    short = CLIPPED | {"horizon": 0.3}
    run = forced("compiled").simulate(**short)
    other = forced("interpreted").simulate(**short)
    places = list(logit_states(run.manifest))
    assert np.max(np.abs(run.states[:, places])) > 100.0
    assert np.allclose(run.states, other.states, rtol=1e-8, atol=1e-8)
    pytest.importorskip("xarray")
    from pmjoint_codegen import sweep

    grid = {"gamma_b0": [0.5, 1.0, 2.0]}
    data = sweep(forced("compiled"), grid=grid, saturation="clip", horizon=20.0, tolerance=1e-10)
    assert np.all(data["status"].values == Status.DONE)
    assert data["ise"].values[1] == pytest.approx(106.17, abs=0.01)
    for name, (low, high) in ENDS.items():
        final = data[f"final_{name}"].values
        assert np.all((low < final) & (final < high))


@pytest.mark.parametrize("kind", ["compiled", "interpreted"])
def test_other_states_still_end_a_run_that_diverges(forced: Load, kind: str) -> None:
    with pytest.raises(SimulationError, match=r"chi2 passed 1\.55"):
        forced(kind).simulate(divergence=1.55, x0=(1.5, 0.5), horizon=1.0)


def test_only_logits_may_go_anywhere(forced: Load) -> None:
    manifest = forced("interpreted").manifest
    reach = reach_of(manifest, 7.0)
    assert [manifest.states[place].name for place in np.flatnonzero(np.isinf(reach))] == [
        "b0_logit",
        "d1_logit",
    ]
    assert set(reach[np.isfinite(reach)]) == {7.0}
    assert not logit_states(ClosedLoop.load("paper").manifest)


def test_the_estimate_is_where_its_kernel_has_it(forced: Load) -> None:
    run = forced("compiled").simulate(horizon=2.0)
    X = run.states.copy()
    put_estimates(run.manifest, np.tile(run.settings.p, (len(X), 1)), X)
    for place, name in zip(logit_states(run.manifest), ENDS, strict=True):
        assert np.allclose(X[:, place], run[name], rtol=1e-14, atol=1e-14)
        assert X[0, place] == run.settings.parameters[f"{name[:-4]}_guess"]


def test_a_place_is_the_guess_at_zero_and_an_end_far_away() -> None:
    guess, low, high = (np.array([value]) for value in (1.2, 0.3, 6.0))
    assert place_of(np.zeros(1), guess, low, high) == 1.2
    assert place_of(np.array([-1e5]), guess, low, high) == pytest.approx(0.3, abs=1e-15)
    assert inside(place_of(np.array([1e5]), guess, low, high), low, high) == np.nextafter(6.0, 0.0)
    logit = np.log((2.0 - 0.3) / (6.0 - 2.0)) - np.log((1.2 - 0.3) / (6.0 - 1.2))
    assert place_of(np.array([logit]), guess, low, high) == pytest.approx(2.0, rel=1e-15)
