"""``pmjoint new``: what it writes simulates at once, explains every key, and overwrites nothing."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.new import TEMPLATES
from pmjoint_codegen.modelfile.joint import JointSpec
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.modelfile.schema import DesignSpec, ModelSpec, PlantSpec, SimulationSpec


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("options", "kind"), [([], "joint"), (["--joint"], "joint"), (["--plant"], "plant")])
def test_a_new_model_simulates_at_once(
    options: list[str], kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["new", "elbow", *options]) == 0
    assert "next: pmjoint simulate models/elbow.toml" in capsys.readouterr().out
    document = read_document(Path("models/elbow.toml"))
    assert document["name"] == "elbow"
    assert kind in document
    assert run(["simulate", "elbow", "--no-figures", "--evaluator", "interpreted", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["model"] == "elbow"
    assert summary["status"] == "done"
    assert abs(summary["final_e"]) < 0.05 * max(abs(value) for value in summary["x0"])
    assert summary["pressures"] is None or not summary["pressures"]["P1"]["clipped"]


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "mine.toml").write_text("mine")
    os.symlink("nowhere", tmp_path / "models" / "link.toml")
    for name in ("mine", "link"):
        assert run(["new", name]) == 2
        assert f"models/{name}.toml: exists already; choose another name" in capsys.readouterr().err
    assert (tmp_path / "models" / "mine.toml").read_text() == "mine"
    assert (tmp_path / "models" / "link.toml").is_symlink()


@pytest.mark.parametrize("name", ["", "a b", "../up", "-x", "ä", "a" * 65, "x.toml", "a\n"])
def test_a_bad_name_is_one_clear_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new", "--", name]) == 2
    error = capsys.readouterr().err
    assert "is not a valid model name; allowed: letters, digits, - and _" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_another_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new", "knee", "--plant", "--out", "my designs/legs"]) == 0
    assert (tmp_path / "my designs" / "legs" / "knee.toml").is_file()
    (command,) = (line[6:] for line in capsys.readouterr().out.splitlines() if line.startswith("next: "))
    assert shlex.split(command) == ["pmjoint", "simulate", "my designs/legs/knee.toml"]


def test_a_folder_that_cannot_be_written_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    Path("models").write_text("in the way")
    assert run(["new", "knee"]) == 2
    assert capsys.readouterr().err.startswith("pmjoint: models: cannot be written")


@pytest.mark.parametrize("kind", ["joint", "plant"])
def test_templates_show_every_key(kind: str) -> None:
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    tables: list[Any] = [DesignSpec, SimulationSpec, JointSpec if kind == "joint" else PlantSpec]
    keys = [key for table in tables for key in table.model_fields]
    assert [key for key in keys if f"\n{key} " not in text and f"\n# {key} " not in text] == []
    document = read_document(TEMPLATES / f"{kind}.toml")
    allowed = {field.alias or key for key, field in ModelSpec.model_fields.items()}
    assert set(document) <= allowed
