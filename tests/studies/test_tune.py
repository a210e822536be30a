"""`pmjoint_codegen.tune(...)`: the command's gains in one call."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen import ClosedLoop, ModelError, Tuned, UsageError, tune
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.terminal import as_json
from pmjoint_codegen.compile.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="tuning needs a compiler")


@pytest.fixture(scope="module")
def tuned() -> Tuned:
    limits: dict[str, Any] = {"max_v": 150, "perturb": {"b0": "uniform(1.6, 2.4)"}, "plants": 3}
    return tune("paper", gains={"c": (3, 60), "e1": None}, generations=3, population=3, horizon=4.0, **limits)


def test_gains_and_file_are_those_of_the_command(
    tuned: Tuned, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = ["--generations", "3", "--population", "3", "--horizon", "4", "--no-figure", "--json"]
    limits = ["--max-v", "150", "--perturb", "b0~uniform(1.6,2.4)", "--plants", "3"]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    file = tmp_path / "a" / "mine.toml"
    options = ["--gain", "c=3:60", "--gain", "e1", "--out", str(file)]
    assert run(["tune", "paper", *quick, *limits, *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {**told, "files": []} == json.loads(as_json({**tuned.summary, "files": []}))
    written = tuned.write(tmp_path / "b" / "mine.toml")
    assert written.read_bytes() == file.read_bytes()
    assert tuned.write(written) == written  # its own file may be replaced
    run_of_it = ClosedLoop.load(written, notify=lambda line: None).simulate(horizon=4.0)
    assert run_of_it.ise == pytest.approx(tuned.summary["nominal"]["ise"]["after"], rel=1e-4)


def test_the_result_is_short_and_draws_itself(tuned: Tuned) -> None:
    text = repr(tuned)
    assert text.startswith("<Tuned paper: ise ")
    assert "c1 " in text
    assert len(text) < 300
    assert tuned.cost == tuned.summary["worst"]["objective"]["after"]
    assert len(tuned.plot().axes) == 4


def test_a_file_that_is_not_tunes_own_is_kept(tuned: Tuned, tmp_path: Path) -> None:
    file = tmp_path / "other.toml"
    file.write_text("name = 'mine'\n", encoding="utf-8")
    with pytest.raises(UsageError, match="exists already"):
        tuned.write(file)
    with pytest.raises(UsageError, match=r"NAME\.toml"):
        tuned.write(tmp_path / "gains.json")


def test_a_model_that_changed_since_is_not_rewritten(root: Path, tmp_path: Path) -> None:
    model = tmp_path / "mine.toml"
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8").replace('"paper"', '"mine"', 1)
    model.write_text(text, encoding="utf-8")
    loop = ClosedLoop.load(model, notify=lambda line: None)
    quick: dict[str, Any] = {"generations": 1, "population": 1, "horizon": 1.0, "gains": "c1=14:60"}
    found = tune(loop, **quick, notify=lambda line: None)
    model.write_text(text.replace("[1.5, 0.0]", "[1.4, 0.0]"), encoding="utf-8")
    with pytest.raises(ModelError, match="has changed since it was read"):
        found.write(tmp_path / "other.toml")


@pytest.mark.parametrize(
    ("asked", "match"),
    [
        ({"gains": {"c1": 3}}, "gains, c1: is 3"),
        ({"gains": {"c1": (1, "x")}}, "gains, c1: is 'x'"),
        ({"over": "best"}, "over: is 'best'"),
        ({"perturb": {"b0": 2}}, "perturb, b0: is 2"),
    ],
)
def test_what_cannot_be_is_refused(asked: dict[str, Any], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        tune("paper", **asked)
