"""What a reader is told of an adaptive run: estimates, V, the error of frozen estimates, leakage."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.summary_table import summary_table
from pmjoint_codegen.simulate.assumptions import FAST, remarks, sentence
from pmjoint_codegen.simulate.compare import compare
from pmjoint_codegen.simulate.estimates import (
    estimates,
    frozen_error,
    frozen_parameters,
    is_adaptive,
    is_frozen,
)
from pmjoint_codegen.simulate.figures import draw, look_of, overview
from pmjoint_codegen.simulate.folder import Origin, read_folder, write_run
from pmjoint_codegen.simulate.page import PRINTED, Page, page_of
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.sheets import overview_panels, sheets
from pmjoint_codegen.simulate.style import styled
from pmjoint_codegen.simulate.symbols import symbol
from tests.figure_texts import flaws

NAMES = ("paper-adaptive", "joint-load")
SMALL = page_of("paper", "ieee", caption=True)


@pytest.fixture(scope="module", params=NAMES)
def loop(request: pytest.FixtureRequest) -> ClosedLoop:
    return ClosedLoop.load(cast("str", request.param))


@pytest.fixture(scope="module")
def run(loop: ClosedLoop) -> Run:
    return loop.simulate()


@pytest.fixture(scope="module")
def frozen(loop: ClosedLoop) -> Run:
    return loop.simulate(parameters=frozen_parameters(loop.manifest))


def test_estimates_start_at_guesses_and_name_the_plants_own_values(run: Run) -> None:
    values = run.settings.parameters
    found = estimates(run)
    assert [item.name for item in found] == [name for name in run.columns if name.endswith("_hat")]
    for item in found:
        assert run[item.name][0] == item.guess == values[f"{item.of}_guess"]
        assert item.truth == values[item.of]
        assert item.range is not None
        assert np.all((item.range[0] < run[item.name]) & (run[item.name] < item.range[1]))


def test_the_truth_is_that_of_the_run(loop: ClosedLoop) -> None:
    name = estimates(loop.simulate())[0].of
    moved = loop.simulate(parameters={name: 1.1 * loop.simulate().settings.parameters[name]})
    assert estimates(moved)[0].truth == moved.settings.parameters[name]
    assert estimates(moved)[0].guess == estimates(loop.simulate())[0].guess


def test_a_run_says_what_did_not_follow_another_guess(loop: ClosedLoop) -> None:
    """The file's priors follow its guesses; a run that sets a guess leaves them where they are."""
    name = estimates(loop.simulate(horizon=0.1))[0].of
    guess = loop.simulate(horizon=0.1).settings.parameters[f"{name}_guess"] + 1e-3
    moved = {f"{name}_guess": guess, "leakage": 1e-9}
    said = remarks(loop.simulate(horizon=0.1, parameters=moved))
    assert [text for text in said if text.startswith(f"{name}_prior is still")]
    for right in ({f"{name}_prior": guess}, {"leakage": 0.0}):
        assert not any(
            "is still" in text for text in remarks(loop.simulate(horizon=0.1, parameters=moved | right))
        )


def test_other_controllers_have_no_estimates() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.1)
    assert not is_adaptive(run.manifest) and not estimates(run) and is_frozen(run)
    assert not {"estimates", "V"} & run.summary.keys()
    assert not remarks(run)


def test_frozen_estimates_stay_and_the_error_is_another(run: Run, frozen: Run) -> None:
    assert is_frozen(frozen) and not is_frozen(run)
    for item in estimates(frozen):
        assert np.all(frozen[item.name] == item.guess)
    assert frozen.ise > run.ise


def test_the_summary_and_the_table_have_both_ends(run: Run) -> None:
    table = summary_table(run, (), ())
    for item in estimates(run):
        told = run.summary["estimates"][item.name]
        assert (told["first"], told["final"]) == (run[item.name][0], run[item.name][-1])
        assert (told["true"], told["of"], told["range"]) == (item.truth, item.of, list(item.range or ()))
        assert f"the plant's {item.of} = {item.truth:.6g}" in table
    assert run.summary["V"] == {"first": run["V"][0], "final": run["V"][-1]}
    assert "identif" not in table


def test_figures_show_estimates_v_and_the_frozen_error(run: Run, frozen: Run) -> None:
    *_, shown, errors = sheets(run, frozen_error(frozen))
    assert (shown.stem.partition("_")[2], errors.stem.partition("_")[2]) == ("adaptation", "adaptive_error")
    for item, panel in zip(estimates(run), shown.panels, strict=False):
        truth, estimate = (line.curve(run) for line in panel.lines)
        assert np.all(truth[1] == item.truth) and np.array_equal(estimate[1], run[item.name])
        assert "range" in panel.remark
    V = shown.panels[-1]
    assert [line.column for line in V.lines] == ["V"]
    assert draw(run, shown).axes[-1].get_yscale() == "log"
    for panel in errors.panels:
        beside, own = (line.curve(run)[1] for line in panel.lines)
        assert np.array_equal(beside, frozen["e"]) and np.array_equal(own, run["e"])


def test_a_frozen_run_that_ended_early_is_drawn_as_far_as_it_went(run: Run, frozen: Run) -> None:
    rows = len(frozen.t) // 3
    early = replace(frozen, t=frozen.t[:rows], states=frozen.states[:rows], signals=frozen.signals[:rows])
    figure = draw(run, sheets(run, frozen_error(early))[-1])
    assert np.size(figure.axes[-1].lines[0].get_xdata()) == rows


@pytest.mark.parametrize("page", [PRINTED, SMALL], ids=["printed", "a column"])
def test_texts_of_the_figures_lie_apart(page: Page, run: Run, frozen: Run) -> None:
    look = look_of(page)
    for sheet in sheets(run, frozen_error(frozen))[-2:]:
        with styled(look):
            figure = draw(run, sheet, page=page)
        assert not flaws(figure, look), sheet.stem
    assert not flaws(overview(run, page=page), look)


def test_the_frozen_error_comes_back_from_the_folder(run: Run, frozen: Run, tmp_path: Path) -> None:
    files = write_run(run, tmp_path, Origin(), frozen=frozen_error(frozen))
    assert tmp_path / "frozen.csv" in files
    found = read_folder(tmp_path).frozen
    assert found is not None
    assert np.array_equal(found.t, frozen.t) and np.array_equal(found.e, frozen["e"])
    write_run(run, tmp_path, Origin())
    assert not (tmp_path / "frozen.csv").exists() and read_folder(tmp_path).frozen is None


def test_compared_runs_have_a_panel_for_each_estimate(run: Run, frozen: Run) -> None:
    labels = [axes.get_ylabel() for axes in compare(run, frozen).plot().axes]
    for item in estimates(run):
        assert any(label.startswith(symbol(item.name)) for label in labels)


def test_leakage_that_is_faster_than_learning_is_named(loop: ClosedLoop, run: Run) -> None:
    assert not remarks(run)
    gains = [value for name, value in run.settings.parameters.items() if name.startswith("gamma_")]
    at_once = 2.0 * FAST / max(gains)
    told = remarks(loop.simulate(parameters={"leakage": at_once}, horizon=0.01))
    assert told and "2 1/s" in told[0] and "leakage" in told[0]
    assert len(told) == sum(gain * at_once > FAST for gain in gains)
    assert not remarks(loop.simulate(parameters={"leakage": 0.9 * FAST / max(gains)}, horizon=0.01))


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("b0_hat", r"$\hat{b}_{0}$"),
        ("w_hat", r"$\hat{w}$"),
        ("rho_hat", r"$\hat{\varrho}$"),
        ("theta1_hat", r"$\hat{\theta}_{1}$"),
        ("mass_hat", r"$\widehat{\mathrm{mass}}$"),
        ("gamma_b0", r"$\gamma_{b_{0}}$"),
        ("b0_guess", r"$b_{0}^{\mathrm{guess}}$"),
        ("chi1", r"$\chi_{1}$"),
        ("x_hat2", r"$\hat{x}_{2}$"),
    ],
)
def test_estimates_have_a_hat(name: str, written: str) -> None:
    assert symbol(name) == written


@pytest.mark.parametrize("value", [7.0, 0.3, -2.0])
def test_a_true_value_outside_its_range_is_named_and_leaves_no_v(value: float, tmp_path: Path) -> None:
    run = ClosedLoop.load("paper-adaptive").simulate(parameters={"b0": value}, horizon=0.1)
    said = f"b0 = {value:g} is outside the range of b0_hat, 0.3 to 6: nothing is proved and V has no value"
    assert said in remarks(run) and said in run.summary["remarks"] and said in sentence(run)
    assert "V" not in run.summary
    table = summary_table(run, (), ())
    assert said in table and "\n  V " not in table
    shown = next(sheet for sheet in sheets(run) if sheet.stem.endswith("adaptation"))
    assert len(shown.panels) == len(estimates(run)) and "V$" not in shown.caption
    assert all(line.column != "V" for panel in overview_panels(run) for line in panel.lines)
    assert read_folder_remarks(run, tmp_path) == list(remarks(run))


def read_folder_remarks(run: Run, folder: Path) -> list[str]:
    """The remarks of ``summary.json``."""
    write_run(run, folder, Origin())
    found: list[str] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["remarks"]
    return found


@pytest.mark.parametrize(
    ("table", "values", "said"),
    [
        ("guess = { b0 = 1.5 }", {"b0": -2.0}, "b0 = -2 has the other sign than b0_guess = 1.5"),
        ("guess = { b0 = -1.5 }", {}, "b0 = 2 has the other sign than b0_guess = -1.5"),
        (
            'unknown = ["b0"]\nform = "inverse"\nguess = { b0 = 1.2 }\ngain = { b0 = 2.0 }\n'
            "inverse = { gain = 0.1 }",
            {"b0": -2.0},
            "b0 = -2 has the other sign than b0_guess = 1.2",
        ),
    ],
)
def test_the_other_sign_of_b_m_is_named(
    table: str, values: dict[str, float], said: str, root: Path, tmp_path: Path
) -> None:
    file = tmp_path / "signed.toml"
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    text = text.replace('"paper"', '"signed"').replace("[design]", f"[adaptation]\n{table}\n\n[design]")
    file.write_text(text, encoding="utf-8")
    loop = ClosedLoop.load(file)
    told = remarks(loop.simulate(parameters=values, horizon=0.02))
    assert told[0].startswith(f"{said}, so v acts the wrong way: nothing is proved")
    guess = loop.simulate(horizon=0.02).settings.parameters["b0_guess"]
    right = remarks(loop.simulate(parameters={"b0": 2.0 if guess > 0 else -2.0}, horizon=0.02))
    assert not any("sign" in remark for remark in right)


def test_true_values_inside_their_ranges_need_no_word(run: Run) -> None:
    assert not remarks(run) and run.summary["remarks"] == []


def test_a_frozen_run_is_not_said_to_adapt(run: Run, frozen: Run) -> None:
    captions = [sheets(item)[-1].caption for item in (run, frozen)]
    assert captions == [
        "Tracking error with adaptation.",
        "Tracking error with estimates that stay at their guesses.",
    ]
