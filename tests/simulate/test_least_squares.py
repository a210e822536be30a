"""Least squares in a run: estimates that stand still, and the start that they need."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, sweep
from pmjoint_codegen.cli.main import run as command
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.simulate.assumptions import remarks
from pmjoint_codegen.simulate.estimates import estimates, frozen_parameters, is_frozen


@pytest.fixture(scope="module")
def squares(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    text = (root / "models" / "paper-adaptive.toml").read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if not line.startswith(("gain ", "leakage "))]
    changed = "\n".join(kept).replace('"paper-adaptive"', '"squares"')
    changed = changed.replace('unknown = ["b0"', 'estimator = "least_squares"\nunknown = ["b0"')
    file = tmp_path_factory.mktemp("models") / "squares.toml"
    file.write_text(changed, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def loop(squares: Path) -> ClosedLoop:
    return ClosedLoop.load(squares)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_from_a_gain_matrix_of_0_estimates_stay_at_their_guesses(loop: ClosedLoop, controller: str) -> None:
    run = loop.simulate(
        parameters=frozen_parameters(loop.manifest), controller=controller, start="matched", horizon=2.0
    )
    assert is_frozen(run)
    for item in estimates(run):
        assert np.all(run[item.name] == item.guess)
    assert not any(run[name].any() for name in ("Gamma11", "Gamma12", "Gamma22"))


def test_a_trace_that_forgetting_divides_by_is_not_0(loop: ClosedLoop) -> None:
    with pytest.raises(UsageError, match="ls_k_max: is 0; allowed: a number greater than 0"):
        loop.simulate(parameters={"ls_P0": 0.0, "ls_k_max": 0.0})


def test_figures_have_the_run_with_estimates_at_their_guesses(
    squares: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(["simulate", str(squares), "--start", "matched", "--out", str(tmp_path / "run")]) == 0
    assert (tmp_path / "run" / "frozen.csv").exists()
    assert "figure8_adaptive_error" in capsys.readouterr().out


def test_a_sweep_reaches_a_gain_matrix_of_0(squares: Path, tmp_path: Path) -> None:
    found = sweep(
        str(squares), grid={"ls_P0": [0.0, 5.0]}, start="matched", horizon=2.0, out=tmp_path / "sweep"
    )
    first, moving = found["ise"].values
    assert np.isfinite([first, moving]).all() and first != moving


def test_a_start_with_filters_at_0_is_named(loop: ClosedLoop) -> None:
    """The first prediction error then holds y(0), which no parameter makes."""
    told = "least squares needs the matched start"
    assert remarks(loop.simulate(horizon=0.1, start="zero"))[0].startswith(told)
    assert not remarks(loop.simulate(horizon=0.1, start="matched"))
    frozen = frozen_parameters(loop.manifest)
    assert not remarks(loop.simulate(horizon=0.1, start="zero", parameters=frozen))


def test_without_v_nothing_is_said_of_it(loop: ClosedLoop) -> None:
    run = loop.simulate(horizon=0.1, start="matched", parameters={"d1": 4.0})
    assert remarks(run) == ("d1 = 4 is outside the range of d1_hat, -3 to 3: nothing is proved",)
