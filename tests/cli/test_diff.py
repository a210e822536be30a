"""``pmjoint diff`` in real repositories, whose folders have spaces in their names."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.cli.diff import lines
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.emit.changes import Change, Content
from pmjoint_codegen.review.difference import Difference, Version
from pmjoint_codegen.storage import sha256

OUTPUT = pytest.CaptureFixture[str]


def git(folder: Path, *arguments: str) -> str:
    """Run git in a folder as nobody in particular, and return what it prints."""
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org", "-c", "commit.gpgsign=false"]
    line = ["git", *who, "-c", "init.defaultBranch=main", *arguments]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def commit(project: Path, subject: str) -> None:
    """Commit all that stands in a project."""
    git(project, "add", "-A")
    git(project, "commit", "-q", "-m", subject)


@pytest.fixture
def project(tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project with the paper's model, generated and committed; stand in it."""
    top = tmp_path / "all my work"
    project = top / "my joint"
    (project / "models").mkdir(parents=True)
    shutil.copy(root / "models" / "paper.toml", project / "models")
    shutil.copytree(root / "generated" / "paper", project / "generated" / "paper")
    (project / "golden").mkdir()
    for name in ("paper.csv", "paper.switches.csv"):
        shutil.copy(root / "golden" / name, project / "golden")
    git(top, "init", "-q")
    commit(top, "begin")
    monkeypatch.chdir(project)
    return project


def edit(file: Path, *pairs: tuple[str, str]) -> None:
    """Change a file at one place for each pair."""
    text = file.read_text(encoding="utf-8")
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")


def stiffen(project: Path) -> None:
    """Give the joint a stiffening spring: one parameter and one term."""
    spring = 'd3 = { value = -0.5, unit = "1/(rad^2 s^2)", about = "spring" }\n'
    parameters = "[parameters]"
    text = (project / "models" / "paper.toml").read_text(encoding="utf-8")
    begin = next(line for line in text.splitlines() if line.startswith(parameters)) + "\n"
    edit(
        project / "models" / "paper.toml",
        (begin, begin + spring),
        ('phi   = ["0", "0"]', 'phi = ["0", "d3*y**3"]'),
    )


def compared(capsys: OUTPUT, *arguments: str) -> dict[str, Any]:
    """Run ``pmjoint diff --json`` and return its document."""
    capsys.readouterr()
    assert run(["diff", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def refused(capsys: OUTPUT, code: int, *arguments: str) -> str:
    """Run ``pmjoint diff``, require an exit code and one line, and return the line."""
    capsys.readouterr()
    assert run(["diff", *arguments]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1, captured.err
    return captured.err


def test_nothing_differs_from_what_is_committed(project: Path, capsys: OUTPUT) -> None:
    assert run(["diff", "paper"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("paper\n  before  generated/paper at HEAD\n  after   generated/paper\n\n")
    assert [line.partition(":")[0] for line in said.splitlines() if "are the same" in line] == [
        "equations",
        "values",
    ]
    assert said.endswith("generated code\n  of the same size\n\ngolden trajectory\n  the same\n")


def test_a_new_term_shows_in_equations_values_and_sizes(project: Path, capsys: OUTPUT) -> None:
    """The same before and after the folder is regenerated, and as `regenerate` tells it."""
    stiffen(project)
    derived = compared(capsys, "paper")
    assert derived["after"] == "the model file, derived now: generated/paper does not follow from it"
    names = [change["name"] for change in derived["equations"]]
    assert [name for name in names if name in ("x2_dot", "xi2_dot", "v")] == ["x2_dot", "xi2_dot", "v"]
    law = derived["equations"][names.index("xi2_dot")]
    assert "d3*y**3" in law["after"] and "d3" not in law["before"]
    values = {change["name"]: (change["before"], change["after"]) for change in derived["values"]}
    assert values == {
        "d3": (None, -0.5),
        "unit of d3": (None, "1/(rad^2 s^2)"),
        "meaning of d3": (None, "spring"),
    }
    operations = {change["name"]: change for change in derived["operations"]}
    assert operations["taylor"]["after"] > operations["taylor"]["before"]
    assert "kernels.c" in {change["name"] for change in derived["sizes"]}

    assert run(["diff", "paper"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert run(["regenerate", "paper"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert {line.strip() for line in told if line[4:6] in ("- ", "+ ")} == {
        line.strip() for line in shown if line[2:4] in ("- ", "+ ")
    }
    written = compared(capsys, "paper")
    assert written["after"] == "generated/paper"
    assert {**written, "after": ""} == {**derived, "after": ""}
    after = {path.name: path.stat().st_size for path in (project / "generated" / "paper").iterdir()}
    assert {change["name"]: change["after"] for change in written["sizes"]}.items() <= after.items()


def test_any_revision_can_be_compared_with(project: Path, capsys: OUTPUT) -> None:
    stiffen(project)
    assert run(["regenerate"]) == 0
    commit(project, "stiffen")
    git(project, "tag", "stiff")
    edit(project / "models" / "paper.toml", ("value = 0.2,", "value = 0.3,"))
    assert compared(capsys, "paper", "--rev", "stiff")["equations"] == []
    found = compared(capsys, "models/paper.toml", "--rev", "main~1")
    assert {change["name"] for change in found["values"]} >= {"d1", "d3"}
    assert "v" in {change["name"] for change in found["equations"]}
    assert found["before"] == "generated/paper at main~1"


def test_golden_figures_show_what_the_loop_does_otherwise(project: Path, capsys: OUTPUT) -> None:
    rows = project / "golden" / "paper.csv"
    lines = rows.read_text(encoding="utf-8").splitlines()
    last = lines[-1].split(",")
    last[1] = repr(float(last[1]) + 0.25)
    rows.write_text("\n".join([*lines[:-1], ",".join(last)]) + "\n", encoding="utf-8")
    switches = project / "golden" / "paper.switches.csv"
    switches.write_text(switches.read_text(encoding="utf-8") + "19.5,1\n", encoding="utf-8")
    golden = compared(capsys, "paper")["golden"]
    figures = {item["name"]: (item["before"], item["after"]) for item in golden["figures"]}
    assert figures.keys() == {"x1 at the end (rad)", "saturation switches", "last switch (s)"}
    assert figures["x1 at the end (rad)"][1] - figures["x1 at the end (rad)"][0] == pytest.approx(0.25)
    assert figures["saturation switches"] == (3, 4)
    assert figures["last switch (s)"][1] == 19.5
    assert golden["deviation"] == pytest.approx(0.25)
    assert run(["diff", "paper"]) == 0
    said = capsys.readouterr().out
    assert "  saturation switches  3         ->  4\n" in said
    assert said.endswith("  largest difference 0.25, relative to max(1, |value|)\n")


@pytest.mark.parametrize(
    ("content", "told"),
    [(None, "no golden/paper.csv"), ("t,v\n0,x\n", "golden/paper.csv is damaged: "), ("t,v\n0,1\n", "")],
)
def test_golden_files_that_cannot_be_compared_are_named(
    project: Path, capsys: OUTPUT, content: str | None, told: str
) -> None:
    rows = project / "golden" / "paper.csv"
    rows.unlink()
    if content is not None:
        rows.write_text(content, encoding="utf-8")
    assert run(["diff", "paper"]) == 0
    _, _, said = capsys.readouterr().out.partition("golden trajectory\n")
    assert (f"  before  golden/paper.csv at HEAD\n  after   {told}" in said) == bool(told)
    assert ("other columns or instants" in said) == (not told)


def test_a_side_without_its_generated_folder_is_derived(project: Path, capsys: OUTPUT) -> None:
    shutil.rmtree(project / "generated")
    commit(project, "generate nothing")
    found = compared(capsys, "paper")
    fault = "generated/paper at HEAD is missing"
    assert found["before"] == f"the model file at HEAD, derived now: {fault}"
    assert found["after"] == "the model file, derived now: generated/paper is missing"
    assert found["equations"] == found["values"] == found["sizes"] == []
    assert compared(capsys, "paper", "--rev", "HEAD~1")["equations"] == []
    assert not (project / "generated").exists()


def test_a_folder_edited_by_hand_is_not_believed(project: Path, capsys: OUTPUT) -> None:
    edit(project / "generated" / "paper" / "derivation.md", ("+ k_2 v_{0,1}", "- k_2 v_{0,1}"))
    found = compared(capsys, "paper")
    assert found["after"] == "the model file, derived now: generated/paper was edited by hand"
    assert found["sizes"] == []


def test_what_another_version_wrote_is_read_as_it_stands(project: Path, capsys: OUTPUT) -> None:
    manifest = project / "generated" / "paper" / "model.json"
    contents = json.loads(manifest.read_text(encoding="utf-8"))
    contents |= {"schema": 1, "colour": "blue", "contents_hash": ""}
    contents["functions"][0]["operations"] += 5
    text = json.dumps(contents, indent=1, ensure_ascii=False) + "\n"
    digest = sha256(text.encode())
    manifest.write_text(text.replace('"contents_hash": ""', f'"contents_hash": "{digest}"'), encoding="utf-8")
    commit(project, "as another version writes it")
    found = compared(capsys, "paper")
    assert found["before"] == "generated/paper at HEAD"
    assert found["after"] == "generated/paper"
    assert found["equations"] == found["operations"] == []
    (operations,) = compared(capsys, "paper", "--rev", "HEAD~1")["operations"]
    assert operations["after"] - operations["before"] == 5


def test_sizes_are_told_with_their_growth() -> None:
    version = Version("paper", "", Content({}, {}, {}, {}, {}), "", None)
    sizes = (Change("kernels.h", 6507, 6506), Change("kernels.c", 100, 150), Change("a.c", None, 5))
    operations = (Change("law", 200, 100), Change("old", 7, None))
    told = list(lines(Difference(version, version, (), (), operations, sizes, (), None)))
    assert told[told.index("generated code") + 1].splitlines() == [
        "  kernels.h  6507  ->  6506 bytes      +0.0 %",
        "  kernels.c  100   ->  150 bytes       +50.0 %",
        "  a.c        none  ->  5 bytes",
        "  law        200   ->  100 operations  -50.0 %",
        "  old        7     ->  none",
    ]


def test_nothing_is_checked_out_or_written(project: Path, capsys: OUTPUT) -> None:
    stiffen(project)
    before = {path: path.stat().st_mtime_ns for path in project.rglob("*") if ".git" not in path.parts}
    head = git(project, "rev-parse", "HEAD"), git(project, "status", "--porcelain")
    compared(capsys, "paper")
    assert {
        path: path.stat().st_mtime_ns for path in project.rglob("*") if ".git" not in path.parts
    } == before
    assert (git(project, "rev-parse", "HEAD"), git(project, "status", "--porcelain")) == head


def test_each_thing_that_is_missing_is_one_line_with_a_remedy(
    project: Path, capsys: OUTPUT, tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "no revision 'v9'; `git log --oneline`" in refused(capsys, 2, "paper", "--rev", "v9")
    assert "no revision '--all'" in refused(capsys, 2, "paper", "--rev=--all")
    assert "no model is called 'papr'" in refused(capsys, 2, "papr")

    other = project / "models" / "other one.toml"
    shutil.copy(project / "models" / "paper.toml", other)
    said = refused(capsys, 2, str(other.relative_to(project)))
    assert "models/other one.toml: is not in revision HEAD; " in said
    assert "git log --oneline -- 'models/other one.toml'" in said

    alone = tmp_path / "no repository"
    alone.mkdir()
    shutil.copy(root / "models" / "paper.toml", alone)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    said = refused(capsys, 2, str(alone / "paper.toml"))
    assert "git says: not a git repository" in said and "keep the model in a repository" in said
    git(alone, "init", "-q")
    assert "no revision 'HEAD'" in refused(capsys, 2, str(alone / "paper.toml"))

    monkeypatch.setenv("PATH", str(alone))
    assert "git is not installed; install it" in refused(capsys, 3, "paper")


def test_a_model_file_that_was_broken_is_named_with_its_revision(project: Path, capsys: OUTPUT) -> None:
    model = project / "models" / "paper.toml"
    good = model.read_text(encoding="utf-8")
    for bad in ("name = \n", good.replace('"sin(t)"', '"sin(q)"')):
        model.write_text(bad, encoding="utf-8")
        commit(project, "break it")
        model.write_text(good, encoding="utf-8")
        said = refused(capsys, 2, "paper")
        assert said.startswith("pmjoint: models/paper.toml at HEAD: "), said
