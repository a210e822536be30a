"""The page's runs against the command line: every column of random settings, by the printed command."""

from __future__ import annotations

import csv
import json
import random
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from pmjoint_codegen.cli.simulate import command as simulate

from .conftest import Shown, opened
from .devtools import Browser, Tab

TOLERANCE = 1e-9  # of every column, relative to max(1, its largest value): a run's own local error is 1e-10
EVERY = 20  # rows
RUNS = {"paper": 10, "lagging": 4, "chained": 6, "adaptive": 4}
ESTIMATED = {"b0": 2.0, "b0_guess": 1.2, "d1": 0.2, "d1_guess": -0.5, "gamma_b0": 1.0, "gamma_d1": 1.0}


def drawn(name: str, seed: int) -> Iterator[dict[str, Any]]:
    """Settings as a reader might choose them; the first are the model's own."""
    draw = random.Random(seed)

    def near(value: float, factor: float = 1.5) -> float:
        return float(f"{value * factor ** draw.uniform(-1, 1):.4g}")

    kinds = {"paper": ("compensator", "clip", "braking")}.get(name, ("compensator", "clip"))
    gains = {"lagging": {"c1": 10, "c2": 10, "c3": 10, "ck1": 20, "ck2": 20, "ck3": 20}}.get(
        name, {"c1": 12, "c2": 12, "ck1": 1.5, "ck2": 1.5}
    )
    own = {"lagging": "J_plant"}.get(name, "b0_plant")
    yield {}
    for i in range(1, RUNS[name]):
        values: dict[str, float] = {key: near(value) for key, value in gains.items()}
        values["u_max"] = near({"lagging": 2.0}.get(name, 8.0))
        if name == "paper" and i == 4:  # the command derives the model anew
            values |= {"reference_gain": near(0.7), "reference_rate": near(1.2), "load": draw.uniform(-1, 1)}
        if name == "chained":
            values |= {key: near(value) for key, value in {"noise": 2e-4, "rate": 300, "filter": 250}.items()}
        if name == "adaptive":
            values |= {key: near(value) for key, value in ESTIMATED.items()} | {
                "leakage": draw.uniform(0, 0.01)
            }
        sampled = i % 2 == 0 if name != "chained" else i != 1
        size = {"lagging": 0.05}.get(name, 1.5)
        yield {
            "saturation": "compensator" if name == "adaptive" else kinds[i % len(kinds)],
            "controller": "sampled" if sampled else "continuous",
            "sample_time": draw.choice([0.001, 0.002]),
            "start": draw.choice(["zero", "matched"]),
            "horizon": {"lagging": 3.0, "chained": 3.0}.get(name, 20.0),
            "x0": [round(draw.uniform(-size, size), 3) for _ in range({"lagging": 2}.get(name, 2))]
            + [0.0] * {"lagging": 2}.get(name, 0),
            "values": values,
            "factors": {} if name == "adaptive" else {own: near(1.0, 1.2)},
        }


def looked(tab: Tab, change: Mapping[str, Any]) -> dict[str, Any]:
    """What the page computes for settings that differ from the model's own."""
    found: dict[str, Any] = tab.evaluate(f"probe.run({json.dumps(change)}, {EVERY})")
    return found


def by_command(text: str, folder: Path) -> tuple[dict[str, np.ndarray[Any, Any]], dict[str, Any]]:
    """Columns and summary of the run that a command line makes."""
    words = shlex.split(text)
    assert words[:2] == ["pmjoint", "simulate"]
    done = CliRunner().invoke(
        simulate, [*words[2:], "--no-figures", "--out", str(folder)], standalone_mode=False
    )
    assert done.exception is None, (text, done.exception, done.output)
    with (folder / "trajectory.csv").open(newline="") as stream:
        names, *rows = csv.reader(stream)
    table = np.array(rows, dtype=float)
    summary = json.loads((folder / "summary.json").read_text())
    return {name: table[:, i] for i, name in enumerate(names)}, summary


@pytest.mark.parametrize("name", list(RUNS))
def test_its_runs_are_those_of_the_command_it_prints(
    name: str, browser: Browser, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Every column, the switches and the figures; the link gives the settings back."""
    shown: Shown = request.getfixturevalue(name)
    tab = opened(browser, shown.address)
    worst = 0.0
    for i, change in enumerate(drawn(name, seed=16)):
        found = looked(tab, change)
        assert found["status"] == 1, change
        assert found["same"] and not found["notice"], change
        columns, summary = by_command(found["command"], tmp_path / str(i))
        assert set(found["columns"]) == set(columns) - {"t", "y_cmd"}  # a command before its filter
        for column, values in found["columns"].items():
            expected = columns[column][::EVERY]
            apart = np.abs(np.array(values) - expected).max() / max(1.0, np.abs(expected).max())
            worst = max(worst, float(apart))
            assert apart <= TOLERANCE, (found["command"], column, apart)
        assert found["ise"] == pytest.approx(summary["ise"], rel=TOLERANCE)
        assert found["saturated"] == pytest.approx(summary["saturated_s"], rel=TOLERANCE, abs=TOLERANCE)
        assert found["peak"][0] == pytest.approx(np.abs(columns["v"]).max(), rel=0.5)
    tab.close()
    print(f"{name}: {RUNS[name]} runs, largest difference {worst:.2g}")


def test_v_is_that_of_the_certificate(tab: Tab) -> None:
    """V(0) against (30) with P from a Kronecker system; at zero filters epsilon(0) = x0."""
    found = looked(tab, {})
    values = found["values"]
    A0 = np.array([[-values["k1"], 1.0], [-values["k2"], 0.0]])
    system = np.kron(A0.T, np.eye(2)) + np.kron(np.eye(2), A0.T)
    P = np.linalg.solve(system, -2.0 * np.eye(2).reshape(-1)).reshape(2, 2)
    z = np.array([found["columns"][name][0] for name in ("z1", "z2")])
    epsilon = np.array([1.5, 0.0])
    weight = 1 / (2 * values["e1"]) + 1 / (2 * values["e2"])
    assert found["V"] == pytest.approx(float(z @ z / 2 + weight * epsilon @ P @ epsilon), rel=1e-12)


def test_estimates_start_at_their_guesses_and_have_plots(browser: Browser, adaptive: Shown) -> None:
    tab = opened(browser, adaptive.address)
    found = looked(tab, {"values": {"d1_guess": 0.75}})["columns"]
    assert (found["b0_hat"][0], found["d1_hat"][0]) == (1.2, 0.75)
    assert found["V"][-1] < found["V"][0]
    near = {"d1_guess": float(np.nextafter(3.0, 0.0)), "gamma_b0": 0.0, "gamma_d1": 0.0}
    assert set(looked(tab, {"values": near})["columns"]["d1_hat"]) == {
        near["d1_guess"]
    }  # as in a command's run
    titles = tab.evaluate(
        "[...document.querySelectorAll('figcaption .title')].map((node) => node.textContent)"
    )
    assert {"Estimate of b₀", "Estimate of d₁", "Lyapunov function"} <= set(titles)
    rows = tab.evaluate(
        "[...document.querySelectorAll('#controls .row input[type=range]')].map((node) => node.id)"
    )
    assert {"row-b0", "row-b0_guess", "row-b0_high", "row-gamma_d1", "row-leakage"} <= set(rows)
    assert "u at a limit" in tab.evaluate("document.body.textContent")
    tab.close()


def test_v_without_a_value_has_no_plot(browser: Browser, adaptive: Shown) -> None:
    """A true value outside its range leaves none; a value inside brings the plot back, in its size."""
    tab = opened(browser, adaptive.address)
    size = "(c => [c.width, c.height])(document.getElementById('plot-lyapunov'))"
    hidden = "document.getElementById('plot-lyapunov').closest('figure').hidden"
    before = tab.evaluate(size)
    tab.evaluate("document.getElementById('table').open = true")
    for value, gone in ((7.0, True), (2.0, False)):
        tab.evaluate(f"explorer.settings.values.b0 = {value}, explorer.update(), explorer.table()")
        assert tab.evaluate(hidden) is gone
        heads = tab.evaluate("[...document.querySelectorAll('#rows thead th')].map((th) => th.textContent)")
        assert any(head.startswith("V") for head in heads) is not gone
    assert tab.evaluate(size) == before
    tab.close()


def test_plain_clipping_is_offered_only_where_it_is_allowed(
    browser: Browser, adaptive: Shown, paper: Shown
) -> None:
    kinds = "[...document.querySelectorAll('input[name=saturation]')].map((node) => node.value)"
    for page, offered in ((adaptive, []), (paper, ["compensator", "braking", "clip"])):
        tab = opened(browser, f"{page.address}#saturation=clip")
        assert tab.evaluate(kinds) == offered
        assert {*page.page.saturations} == {*offered} or page.page.saturations == ("compensator",)
        assert ("left out: saturation=clip" in tab.evaluate("probe.text('notice')")) is (not offered)
        assert tab.evaluate("probe.hidden('alert')")
        tab.close()


def test_the_command_names_what_was_set(tab: Tab) -> None:
    assert looked(tab, {})["command"] == "pmjoint simulate paper"
    change = {
        "saturation": "clip",
        "controller": "sampled",
        "x0": [-1, 0.5],
        "values": {"c1": 20, "reference_gain": 2, "load": -0.5},
        "factors": {"b0_plant": 0.9},
    }
    words = shlex.split(looked(tab, change)["command"])
    assert words[2:] == [
        *("paper", "--set", "c1=20", "--set", "b0_plant=1.8"),
        *("--reference", "(2)*(sin(((1)*t))) + (0)"),
        *("--disturbance", "0", "--disturbance", "(1)*(0.1*sin(x2)*cos(t)) + (-0.5)"),
        *("--x0=-1,0.5", "--saturation", "clip", "--controller", "sampled"),
    ]
