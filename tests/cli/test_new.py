"""``pmjoint new``: what it writes simulates at once, explains every key, and overwrites nothing."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.new import TEMPLATES
from pmjoint_codegen.modelfile.adaptation import AdaptationSpec
from pmjoint_codegen.modelfile.bench import SensorSpec
from pmjoint_codegen.modelfile.joint import JointSpec
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.modelfile.schema import DesignSpec, ModelSpec, PlantSpec, SimulationSpec
from pmjoint_codegen.modelfile.system import SystemSpec


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder."""
    monkeypatch.chdir(tmp_path)


KINDS = [
    ([], "joint"),
    (["--joint"], "joint"),
    (["--system"], "system"),
    (["--plant"], "plant"),
]


@pytest.mark.parametrize(("options", "kind"), KINDS)
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
    if kind == "plant":  # the others have an encoder
        assert abs(summary["final_e"]) < 0.05 * max(abs(value) for value in summary["x0"])
    assert summary["pressures"] is None or not summary["pressures"]["P1"]["clipped"]


@pytest.mark.parametrize(("kind", "period", "bound"), [("joint", 0.01, 5e-3), ("system", 0.005, 1e-3)])
def test_a_new_joint_tracks_at_the_rate_of_its_bench(
    kind: str, period: float, bound: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """As it is written: with its encoder, at its sample time; max |e| in rad after the start, t > 1 s."""
    assert run(["new", "elbow", f"--{kind}"]) == 0
    assert run(["simulate", "elbow", "--no-figures", "--evaluator", "interpreted", "--json"]) == 0
    printed = capsys.readouterr()
    summary = json.loads(printed.out[printed.out.index("{") :])
    assert "too fast" not in printed.err and "may be unstable" not in printed.err
    assert (summary["controller"], summary["sample_time"], summary["start"]) == ("sampled", period, "matched")
    rows = np.genfromtxt("runs/elbow/trajectory.csv", delimiter=",", names=True)
    late = rows["t"] > 1.0
    assert np.max(np.abs(rows["e"][late])) <= bound
    counts = rows["y_m"] / np.radians(summary["parameters"]["count"])
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert np.max(np.abs(rows["y_r"])) > 0.3


def test_the_joint_is_written_as_a_data_sheet_has_it() -> None:
    document = read_document(TEMPLATES / "joint.toml")
    units = {item["unit"] for item in document["joint"].values() if isinstance(item, dict)}
    assert {"mm", "kg cm^2", "bar", "bar/V"} <= units
    assert "torque" in document["joint"]["keep"] and document["design"]["input_scale"] == "auto"


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


@pytest.mark.parametrize("kind", ["joint", "system", "plant"])
def test_templates_show_every_key(kind: str) -> None:
    text = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    physics = {"joint": JointSpec, "system": SystemSpec, "plant": PlantSpec}
    tables: list[Any] = [DesignSpec, SimulationSpec, SensorSpec, AdaptationSpec, physics[kind]]
    keys = [key for table in tables for key in table.model_fields]
    assert [key for key in keys if f"\n{key} " not in text and f"\n# {key} " not in text] == []
    document = read_document(TEMPLATES / f"{kind}.toml")
    allowed = {field.alias or key for key, field in ModelSpec.model_fields.items()}
    assert set(document) <= allowed
