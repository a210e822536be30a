"""``pmjoint report`` of revisions: the page of both, and what the command refuses in one line."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.check.subject import load_subject
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.review.earlier import earlier
from tests.cli.test_diff import OUTPUT, commit, edit, git


@pytest.fixture
def project(tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project with the paper's model committed, and its c1 changed since; stand in it."""
    project = tmp_path / "my joint"
    (project / "models").mkdir(parents=True)
    shutil.copy(root / "models" / "paper.toml", project / "models")
    shutil.copytree(root / "generated" / "paper", project / "generated" / "paper")
    git(project, "init", "-q")
    commit(project, "begin")
    edit(project / "models" / "paper.toml", ("c  = [15, 15]", "c  = [20, 15]"))
    monkeypatch.chdir(project)
    return project


def test_a_model_stands_beside_what_it_was(project: Path, cache: Path, capsys: OUTPUT) -> None:
    assert run(["report", "paper", "--rev", "HEAD", "--out", "both.html"]) in (0, 1)
    page = (project / "both.html").read_text(encoding="utf-8")
    assert "<h1>paper@HEAD and paper</h1>" in page
    (row,) = re.findall(r"<tr>(?:(?!</tr>).)*<code>c1</code>.*?</tr>", page, re.DOTALL)
    assert [value for value in ("15.0", "20.0") if value in row] == ["15.0", "20.0"]
    assert str(project.parent) not in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["paper", "--rev", "none"], "--rev: the repository has no revision 'none'"),
        (["nothing@HEAD", "paper"], "nothing"),
        (["paper", "paper", "--rev", "HEAD"], "--rev: compares one model; name both"),
        (["paper@HEAD", "paper", "--full"], "--full: belongs to a report of one model"),
    ],
)
def test_what_cannot_be_compared_is_refused(
    project: Path, capsys: OUTPUT, arguments: list[str], words: str
) -> None:
    assert run(["report", *arguments]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "reporting on" not in line]
    assert len(said) == 1 and words in said[0]


def test_a_fault_of_an_earlier_model_names_its_revision(project: Path) -> None:
    file = project / "models" / "paper.toml"
    edit(file, ("c  = [20, 15]", "c  = [-1, 15]"))
    commit(project, "break")
    with pytest.raises(ModelError, match=r"paper.toml at HEAD"), earlier(file, "HEAD") as path:
        load_subject(path, {}, print)
