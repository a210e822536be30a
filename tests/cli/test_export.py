"""``pmjoint export``: the folder that it writes, and what it refuses."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.export.targets.target import TARGETS
from pmjoint_codegen.identity import model_hash
from pmjoint_codegen.modelfile.reader import read_document


def test_the_folder_has_the_files_of_the_interface(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "controller"
    out.mkdir()
    (out / "mine.txt").write_text("kept", encoding="utf-8")
    assert run(["export", "paper", "--target", "c", "--out", str(out), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    names = {"pmjoint_paper.h", "pmjoint_paper.c", "Makefile", "README.md", "trace.json"}
    assert names <= set(record["files"])
    assert {path.name for path in out.iterdir()} == {*record["files"], "mine.txt"}
    whole = model_hash(read_document(root / "models" / "paper.toml"))
    assert whole in (out / "pmjoint_paper.c").read_text(encoding="utf-8")
    assert record["model_hash"] == whole


def test_float_is_float_throughout(tmp_path: Path) -> None:
    assert run(["export", "paper", "--target", "c", "--precision", "float", "--out", str(tmp_path)]) == 0
    source = (tmp_path / "pmjoint_paper.c").read_text(encoding="utf-8")
    assert "double" not in source and "frexpf(" in source


def test_an_export_is_the_same_each_time(tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert run(["export", "joint", "--target", "c", "--out", str(tmp_path / name)]) == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["export", "paper", "--target", "c"], "--out"),
        (["export", "paper", "--target", "fortran", "--out", "x"], "fortran"),
        (["export", "nothing", "--target", "c", "--out", "x"], "nothing"),
    ],
)
def test_bad_usage_is_told(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == 2
    assert told in capsys.readouterr().err


def test_several_targets_get_a_folder_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = [option for item in TARGETS for option in ("--target", item.name)]
    assert run(["export", "paper", *asked, "--out", str(tmp_path), "--json"]) == 0
    records = json.loads(capsys.readouterr().out)
    found = records["targets"] if len(TARGETS) > 1 else [records]
    assert [record["target"] for record in found] == [item.name for item in TARGETS]
    for record in found:
        assert all((Path(record["folder"]) / name).is_file() for name in record["files"])


@pytest.mark.skipif(shutil.which("make") is None or shutil.which("cc") is None, reason="no make or compiler")
def test_run_builds_and_tests_what_was_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", "paper", "--target", "c", "--run", "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ran"] == "self test and example: all holds"


@pytest.mark.skipif(shutil.which("make") is None, reason="no make")
@pytest.mark.usefixtures("no_ziglang")
def test_run_without_a_compiler_says_what_installs_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "make").symlink_to(shutil.which("make") or "")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.delenv("CC", raising=False)
    assert run(["export", "paper", "--target", "c", "--run", "--out", str(tmp_path / "c")]) == 3
    assert "a C compiler is needed" in capsys.readouterr().err
