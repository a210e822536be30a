"""``pmjoint plot``: redrawn figures, comparisons, refused folders; runs repeated from their record."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

KERNELS = () if find_compiler(os.environ) else ("--evaluator", "interpreted")
BASE = ("simulate", "paper", *KERNELS, "--horizon", "2", "--output-step", "0.02")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def figures(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def test_a_redrawn_run_has_the_figures_that_simulate_drew(tmp_path: Path) -> None:
    page = ("--width", "ieee", "--no-caption")
    assert run([*BASE, "--disturbance", "0", "--disturbance", "0", "--out", "a", *page]) == 0
    assert (tmp_path / "a" / "transient.csv").is_file()
    assert run(["plot", "a", "--out", "again", *page]) == 0
    drawn = figures(tmp_path / "a")
    assert len(drawn) == 7
    assert figures(tmp_path / "again") == drawn


def test_a_run_is_repeated_by_its_recorded_command(tmp_path: Path) -> None:
    (tmp_path / "a b").mkdir()
    reference = tmp_path / "a b" / "r.csv"
    reference.write_text("t,y\n0,0\n1,0.3\n2,0.1\n3,0\n4,0.2\n5,0\n")
    given = [*BASE, "--set", "c1=20", "--reference", "a b/r.csv", "--reference-filter", "20", "--no-figures"]
    assert run(given) == 0
    first = tmp_path / "runs" / "paper"
    record = json.loads((first / "run.json").read_text())
    assert record["command"] == shlex.join(["pmjoint", *given])
    assert str(tmp_path) not in (first / "run.json").read_text()
    assert record["settings"]["reference"]["origin"]["file"] == "r.csv"
    assert {"pmjoint", "python", "numpy", "casadi", "sympy"} <= record["versions"].keys()
    _, *words = shlex.split(record["command"])
    assert run([*words, "--out", "again"]) == 0
    for name in ("trajectory.csv", "transient.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (first / name).read_bytes()


def test_the_same_run_has_the_same_record(tmp_path: Path) -> None:
    for _ in range(2):
        assert run([*BASE, "--no-figures"]) == 0
        (tmp_path / "runs" / "paper").rename(tmp_path / f"kept{len(list(tmp_path.iterdir()))}")
    first, second = (folder / "run.json" for folder in tmp_path.glob("kept*"))
    assert first.read_bytes() == second.read_bytes()


def test_a_second_run_removes_every_figure_of_the_first(tmp_path: Path) -> None:
    assert run([*BASE, "--out", "a"]) == 0
    for kind in ("pdf", "svg"):
        assert run(["plot", "a", "--signals", "y+y_r,e", "--format", kind]) == 0
        assert (tmp_path / "a" / f"signals_y+y_r_e.{kind}").is_file()
    assert run(["plot", "a", "a", "--out", "a"]) == 0
    assert run([*BASE, "--start", "matched", "--set", "u_max=1e6", "--no-figures", "--out", "a"]) == 0
    left = {path.name for path in (tmp_path / "a").iterdir()}
    assert left == {"trajectory.csv", "summary.json", "run.json"}


def test_runs_are_compared_in_a_table_and_one_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*BASE, "--no-figures", "--out", "a"]) == 0
    assert run([*BASE, "--no-figures", "--set", "c1=25", "--out", "b"]) == 0
    capsys.readouterr()
    assert run(["plot", "a", "b"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].split() == ["a", "b", "difference"]
    assert said[1].split() == ["c1", "15", "1/s", "25", "1/s"]
    assert said[-1].split() == ["files", "runs/comparison/comparison.png"]
    assert run(["plot", "a", "b", "--json", "--format", "svg"]) == 0
    told = json.loads(capsys.readouterr().out)
    ends = [json.loads((tmp_path / name / "summary.json").read_text())["ise"] for name in "ab"]
    assert told["summary"]["ise"]["values"] == ends
    assert told["summary"]["ise"]["differences"] == [0.0, ends[1] - ends[0]]
    assert [item["label"] for item in told["runs"]] == ["c1 = 15", "c1 = 25"]
    assert told["signals"]["v"]["largest"][1] == pytest.approx(334.418, abs=1e-3)
    assert "c1" not in told["signals"]
    assert told["files"] == ["runs/comparison/comparison.svg"]


def test_plotting_needs_neither_model_nor_kernels_nor_symbolic_tools(tmp_path: Path) -> None:
    model = Path(__file__).parents[2] / "models" / "paper.toml"
    shutil.copy(model, tmp_path / "mine.toml")
    assert run(["simulate", "mine.toml", *BASE[2:], "--no-figures", "--out", "a"]) == 0
    (tmp_path / "mine.toml").unlink()
    program = (
        "import sys\n"
        "from pmjoint_codegen.cli.main import run\n"
        "assert run(['plot', 'a', '--signals', 'y']) == 0\n"
        "print(*({'sympy', 'casadi', 'pydantic', 'pint'} & sys.modules.keys()))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        ("nothing", "b: is not a folder; allowed: a folder that pmjoint simulate wrote"),
        ("empty", "b: is not the folder of a run"),
        ("near", "did you mean runs/b?"),
        ("old", "b: has no run.json: an earlier version wrote it"),
        ("text", "b/run.json: is not the record of a run; repeat the run"),
        ("schema", "b/run.json: was written by another version; repeat the run: pmjoint simulate paper"),
        (
            "field",
            "b/run.json: is not a whole record of a run, or of another version; repeat the run: pmjoint",
        ),
        ("rows", "b/trajectory.csv: has changed since run.json was written; repeat the run: pmjoint"),
        ("columns", "b/trajectory.csv: has other columns than its record"),
        ("absent", "b/trajectory.csv: is missing"),
    ],
)
def test_what_is_no_run_is_refused_in_one_line(
    harm: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    if harm == "empty":
        folder.mkdir()
    elif harm != "nothing":
        out = "runs/b" if harm == "near" else "b"
        assert run([*BASE, "--no-figures", "--out", out]) == 0
    record, table = folder / "run.json", folder / "trajectory.csv"
    if harm == "old":
        record.unlink()
    elif harm == "text":
        record.write_text("[1]")
    elif harm == "absent":
        table.unlink()
    elif harm == "rows":
        table.write_bytes(table.read_bytes()[:-5])
    elif harm in ("schema", "field", "columns"):
        contents = json.loads(record.read_text())
        if harm == "schema":
            contents["schema"] = 0
        elif harm == "field":
            del contents["settings"]["horizon"]
        else:
            from pmjoint_codegen.storage import sha256

            table.write_text(table.read_text().replace("t,y,y_r,e,x1", "t,y,y_r,e,extra,x1", 1))
            lines = table.read_text().splitlines()
            table.write_text("\n".join([lines[0], *(f"{line},0" for line in lines[1:])]) + "\n")
            contents["files"]["trajectory.csv"] = sha256(table.read_bytes())
        record.write_text(json.dumps(contents))
    capsys.readouterr()
    assert run(["plot", "b"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert said in line


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        ("y,speed", "signals: there is no column 'speed'"),
        ("y+u", "signals: 'y+u' has the units V and rad; separate them by a comma"),
        ("xhat1", "did you mean x_hat1?"),
    ],
)
def test_signals_that_cannot_be_drawn_are_named(
    signals: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*BASE, "--no-figures", "--out", "a"]) == 0
    capsys.readouterr()
    assert run(["plot", "a", "--signals", signals]) == 2
    assert said in capsys.readouterr().err


def test_a_copied_model_does_not_overwrite_the_runs_of_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*BASE, "--no-figures"]) == 0
    text = (Path(__file__).parents[2] / "models" / "paper.toml").read_text()
    (tmp_path / "mine.toml").write_text(text)
    before = (tmp_path / "runs" / "paper" / "run.json").read_bytes()
    capsys.readouterr()
    copied = ["simulate", "mine.toml", *BASE[2:], "--no-figures"]
    assert run(copied) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("pmjoint: runs/paper: holds a run of ")
    assert line.endswith("change `name` in mine.toml, or give --out")
    assert (tmp_path / "runs" / "paper" / "run.json").read_bytes() == before
    assert run([*copied, "--out", "runs/paper"]) == 0
    assert run(copied) == 0  # its own
    (tmp_path / "mine.toml").rename(tmp_path / "renamed.toml")
    assert run(["simulate", "renamed.toml", *copied[2:]]) == 0
