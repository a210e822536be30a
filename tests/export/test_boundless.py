"""What no precision can hold: refused in one line, and never a literal that is no number."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import DOUBLE, FLOAT
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import Derivation, derive

NO_NUMBER = re.compile(r"\b(nan|inf)(\.0)?f?\b")
Documents = Callable[[str], Mapping[str, Any]]


def learner(documents: Documents, gain: float) -> Derivation:
    """Derive a model of first order whose estimates move by far in a sample."""
    found = dict(documents("first-order"))
    found["adaptation"] = {**found["adaptation"], "gain": {"b0": gain, "d1": gain}, "leakage": 0.0}
    return derive(model_of(found, "first-order"))


def test_float_is_refused_where_its_errors_have_no_bound_and_double_is_not(documents: Documents) -> None:
    derivation, identity = learner(documents, 1e9), Identity("fast", "0" * 64, "test")
    with pytest.raises(
        ModelError, match=r"no finite bound .* float .*--precision double, lower gains of \[ad"
    ):
        export_c(derivation, identity, FLOAT)
    assert not NO_NUMBER.search(export_c(derivation, identity, DOUBLE).source)
    with pytest.raises(ModelError, match=r"double do to .*; give lower gains of \[adaptation\]"):
        export_c(learner(documents, 1e200), identity, DOUBLE)


@pytest.mark.parametrize("value", [1e39, -math.inf, math.nan])
def test_no_literal_is_written_that_is_no_number_of_its_type(value: float) -> None:
    with pytest.raises(ModelError, match="no finite number of the C type float"):
        FLOAT.literal(value)
    assert (FLOAT.literal(0.1), DOUBLE.literal(1e39)) == ("0.1f", "1e+39")


def fast(folder: Path, gain: float) -> Path:
    """Write the paper's model with estimates of another gain."""
    text = (Path(__file__).parents[2] / "models" / "paper-adaptive.toml").read_text(encoding="utf-8")
    own = "gain    = { b0 = 1.0, d1 = 1.0 }"
    assert own in text
    file = folder / "paper-adaptive.toml"
    file.write_text(text.replace(own, f"gain = {{ b0 = {gain}, d1 = {gain} }}"), encoding="utf-8")
    return file


def test_the_command_says_it_in_one_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = fast(tmp_path, 1e30), tmp_path / "out"
    assert run(["export", str(file), "--target", "c", "--precision", "float", "--out", str(out)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "no finite bound" in line]
    assert line.startswith("pmjoint: ") and "--precision double" in line
    assert not list(out.glob("*"))


def test_a_bound_that_says_nothing_is_called_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = fast(tmp_path, 1e3)
    words = ["export", str(file), "--target", "c", "--precision", "float", "--out", str(tmp_path / "out")]
    assert run([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["y_error_bound"] is None
    assert run(words) == 0
    assert "no useful bound on what float does to y" in capsys.readouterr().out
