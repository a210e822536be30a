"""``pmjoint report MODEL@REV OTHER`` in a real repository."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.dossier.versions import opened, split
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.workspace import find_model
from tests.cli.test_diff import commit, git

OUTPUT = pytest.CaptureFixture[str]


@pytest.fixture
def project(tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project whose model `m` was the joint at the tag `old` and is the paper's now; stand in it."""
    project = tmp_path / "my project"
    for name in ("joint", "paper"):
        shutil.copytree(root / "generated" / name, project / "generated" / name)
    (project / "models").mkdir()
    git(project, "init", "-q")
    for name, tag in (("joint", "old"), ("paper", "new")):
        shutil.copy(root / "models" / f"{name}.toml", project / "models" / "m.toml")
        commit(project, tag)
        git(project, "tag", tag)
    monkeypatch.chdir(project)
    return project


def refused(capsys: OUTPUT, *arguments: str) -> str:
    """Run ``pmjoint report``, require exit code 2 and one line, and return the line."""
    capsys.readouterr()
    assert run(["report", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    line = captured.err.splitlines()[-1]
    assert all("reporting on" in other for other in captured.err.splitlines()[:-1])
    return line


def test_a_revision_beside_the_working_tree(project: Path, capsys: OUTPUT) -> None:
    assert run(["report", "m", "--rev", "old", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    short = git(project, "rev-parse", "old")[:10]
    file = f"joint-{short}-paper-report.html"
    assert record == {"model": "m@old", "other": "m", "files": [file]}
    page = Path(file).read_text(encoding="utf-8")
    assert f"revision old, commit {short}</dd>" in page
    assert "<title>m@old and m: report</title>" in page
    assert Manifest.read(project / "generated" / "joint").title in page
    assert "pmjoint-report-" not in page  # the temporary folder
    assert git(project, "status", "--porcelain").split() == ["??", f"{file}"]


def test_a_revision_is_read_from_its_own_files(project: Path) -> None:
    with opened("m@old") as before, opened("m@new") as after:
        for side, name in ((before, "joint"), (after, "paper")):
            assert f'"{name}"' in side.file.read_text(encoding="utf-8")
            assert side.file != project / "models" / "m.toml" and not side.derived
    assert not before.file.exists()


def test_a_generated_folder_that_does_not_follow_is_not_used(project: Path) -> None:
    file = project / "generated" / "paper" / "derivation.md"
    file.write_text("by hand", encoding="utf-8")
    commit(project, "edit")
    with opened("m@HEAD") as side:
        assert side.derived and side.origin.endswith(", derived by this version")
        assert not (side.file.parents[1] / "generated" / "paper").exists()
    assert file.exists()


def test_a_file_whose_name_has_an_at_sign_is_found_first(project: Path) -> None:
    assert split("m@old") == (find_model("m"), "old")
    assert split("m@HEAD@{0}") == (find_model("m"), "HEAD@{0}")
    assert split("m@feature/x") == (find_model("m"), "feature/x")
    shutil.copy(project / "models" / "m.toml", project / "models" / "m@old.toml")
    assert split("m@old") == (find_model("m@old"), None)
    assert split("m@old@new") == (find_model("m"), "old@new")


def test_each_thing_that_is_missing_is_one_line(
    project: Path, capsys: OUTPUT, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "m@v9: the repository has no revision 'v9'" in refused(capsys, "m@v9", "m")
    assert "--rev: the repository has no revision 'v9'" in refused(capsys, "m", "--rev", "v9")
    assert "no model is called 'k'" in refused(capsys, "k@old", "m")
    shutil.copy(project / "models" / "m.toml", project / "models" / "fresh.toml")
    assert "models/fresh.toml: is not in revision old; " in refused(capsys, "fresh@old", "m")
    alone = tmp_path / "alone.toml"
    shutil.copy(project / "models" / "m.toml", alone)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert "git says: not a git repository" in refused(capsys, str(alone), "--rev", "old")


def test_options_that_do_not_go_together_are_refused(project: Path, capsys: OUTPUT) -> None:
    assert "pmjoint report m@old m;" in refused(capsys, "m@old")
    assert "MODEL@REV" in refused(capsys, "m", "m", "--rev", "old")
    assert "--full is for the report of one model" in refused(capsys, "m", "m", "--full")
    assert "--check is for the report of one model" in refused(
        capsys, "m", "--rev", "old", "--check", "models/m.toml"
    )


def test_a_fault_of_an_earlier_model_names_its_revision(project: Path, capsys: OUTPUT) -> None:
    file = project / "models" / "m.toml"
    text = file.read_text(encoding="utf-8")
    assert "c  = [15, 15]" in text
    file.write_text(text.replace("c  = [15, 15]", "c  = [-1, 15]"), encoding="utf-8")
    commit(project, "break")
    git(project, "tag", "bad")
    file.write_text(text, encoding="utf-8")
    assert "models/m.toml at bad: design.c" in refused(capsys, "m@bad", "m")
