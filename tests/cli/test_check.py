"""``pmjoint check``: exit codes, the report of a first difference, JSON and JUnit."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from pmjoint_codegen.cli import main
from pmjoint_codegen.cli.check import command
from pmjoint_codegen.emit.regenerate import regenerate


@pytest.fixture
def workshop(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the paper's model, its generated code and golden trajectory, as the current directory."""
    for name in ("models/paper.toml", "golden/paper.csv", "golden/paper.switches.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(root / name, tmp_path / name)
    shutil.copytree(root / "generated" / "paper", tmp_path / "generated" / "paper")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ask(*arguments: str) -> tuple[int, str]:
    """Run the command without the outermost error handling."""
    found = CliRunner().invoke(command, list(arguments), standalone_mode=False)
    assert found.exception is None, found.exception
    return int(found.return_value), found.stdout


def edit(folder: Path, old: str, new: str) -> None:
    """Change one text in the generated C."""
    file = folder / "generated" / "paper" / "kernels.c"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_a_sound_model_gives_one_line_a_gate(workshop: Path) -> None:
    code, out = ask("models/paper.toml", "--gate", "proof", "--gate", "derivatives")
    assert code == 0
    lines = [line for line in out.splitlines() if line.startswith("  ") and not line.startswith("   ")]
    assert [line.split()[:2] for line in lines] == [["proof", "passed"], ["derivatives", "passed"]]
    assert "f = 0.2215" in out and "squares given away" in out


def test_a_changed_run_is_told_as_one_quantity_and_how_to_accept_it(workshop: Path) -> None:
    file = workshop / "golden" / "paper.csv"
    lines = file.read_text().splitlines()
    row = lines[-1].split(",")
    lines[-1] = ",".join([row[0], repr(float(row[1]) + 0.5), *row[2:]])
    file.write_text("\n".join(lines) + "\n")
    code, out = ask("models/paper.toml", "--gate", "trajectory.golden")
    assert code == 1
    figure = re.search(r"failed +(\S+) against 1e-09", out)
    assert figure is not None and f"{figure[1]} of its scale, bound 1e-09" in out
    assert "changed on purpose: pmjoint check paper --update-golden writes it anew" in out


def test_a_count_of_faults_is_told_without_a_bound(workshop: Path) -> None:
    code, out = ask("models/paper.toml", "--gate", "interpreter")
    assert code == 0 and "passed   0 " in out and "<=" not in out


def test_code_that_gives_no_run_fails_its_gates_and_the_report_is_whole(workshop: Path) -> None:
    """Not the exit code 3 of a command that could not do its work: the code is bad, and the gates say so."""
    file = workshop / "generated" / "paper" / "loops.c"
    text = file.read_text()
    start = text.index("/* taylor:(")
    place = text.index("c[0] = ", start)
    file.write_text(text[:place] + "c[0] = 0.0/0.0 + " + text[place + len("c[0] = ") :])
    report = workshop / "check.xml"
    gates = ("--gate", "trajectory", "--gate", "derivatives")
    code, out = ask("models/paper.toml", *gates, "--junit", str(report))
    assert code == 1
    assert "trajectory.golden       failed" in out
    assert "the run ended early: a state or the control stopped being a finite number" in out
    assert "derivatives             passed" in out
    assert len(ElementTree.parse(report).getroot().findall(".//testcase")) == 5


def test_a_changed_sign_is_reported_where_it_shows(workshop: Path) -> None:
    body = (workshop / "generated/paper/kernels.c").read_text()
    law = body[body.index("/* pmjoint_law:(") :]
    line = next(line for line in law.splitlines() if "=(-" in line)
    edit(workshop, line, line.replace("(-", "("))
    code, out = ask("models/paper.toml", "--gate", "symbolic")
    assert code == 1
    for word in ("failed", "law, alpha1", "point", "y=[", "expected", "found", "error", "bound"):
        assert word in out


def test_json_is_one_document_with_every_gate(workshop: Path) -> None:
    edit(workshop, "kernels. Generated", "KERNELS. Generated")
    code, out = ask("models/paper.toml", "--json", "--gate", "current", "--gate", "trajectory.golden")
    gates = json.loads(out)
    assert code == 1
    assert [(gate["gate"], gate["verdict"]) for gate in gates] == [
        ("current", "failed"),
        ("trajectory.golden", "passed"),
    ]
    assert gates[0]["difference"]["entry"] == "kernels.c"
    assert gates[1]["bound"] == 1e-9 and gates[1]["difference"] is None


@pytest.mark.parametrize("name", ["paper.csv", "paper.switches.csv"])
def test_half_a_golden_trajectory_is_a_failure_that_names_the_missing_half(workshop: Path, name: str) -> None:
    (workshop / "golden" / name).unlink()
    code, out = ask("models/paper.toml", "--gate", "trajectory.golden")
    assert code == 1 and f"golden/{name} is gone" in out and "--update-golden" in out


def test_a_difference_is_reported_with_plain_numbers(workshop: Path) -> None:
    golden = workshop / "golden" / "paper.csv"
    golden.write_text(golden.read_text().replace("\n0.1,", "\n0.1,9", 1))
    code, out = ask("models/paper.toml", "--gate", "trajectory.golden")
    assert code == 1 and "point     t=0.1 s" in out and "np.float64" not in out


def test_junit_holds_failures_and_what_was_not_run(workshop: Path) -> None:
    for name in ("paper.csv", "paper.switches.csv"):
        (workshop / "golden" / name).unlink()
    edit(workshop, "kernels. Generated", "KERNELS. Generated")
    names = [word for gate in ("current", "proof", "trajectory.golden") for word in ("--gate", gate)]
    code, _ = ask("models/paper.toml", "--junit", "out.xml", *names)
    suite = ElementTree.parse("out.xml").getroot()[0]
    assert code == 1
    assert (suite.get("tests"), suite.get("failures"), suite.get("skipped")) == ("3", "1", "1")
    kinds = [[child.tag for child in case] for case in suite.iter("testcase")]
    measured = ["properties", "failure", "system-out"], ["properties", "system-out"]
    assert kinds == [*measured, ["skipped", "system-out"]]


def test_an_unwritable_report_is_said_before_any_gate_runs(
    workshop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(workshop / "models" / "paper.toml" / "out.xml")
    assert main.run(["check", "models/paper.toml", "--gate", "proof", "--junit", out]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"pmjoint: {out}: cannot be written")


@pytest.mark.usefixtures("no_ziglang")
@pytest.mark.parametrize("extra", [[], ["--json"]])
def test_where_no_gate_could_look_that_is_said_and_is_no_success(
    workshop: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], extra: list[str]
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    gates = ["--gate", "symbolic", "--gate", "derivatives", "--gate", "compilers.gcc"]
    assert main.run(["check", "models/paper.toml", *gates, *extra, "--junit", "out.xml"]) == 3
    captured = capsys.readouterr()
    assert captured.out.count("not run") == 3 and (workshop / "out.xml").exists()
    lines = captured.err.splitlines()
    assert lines == [
        "pmjoint: nothing was checked: no C compiler (symbolic, derivatives); no gcc (compilers.gcc)"
    ]
    assert main.run(["check", "models/paper.toml", *gates, "--gate", "trajectory.golden"]) == 0


def test_every_model_is_checked_when_none_is_named(workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pmjoint_codegen.workspace.known_models", lambda: ("paper",))
    code, out = ask("--gate", "derivatives")
    assert code == 0 and out.startswith("paper: ")


def test_golden_trajectories_are_written_on_demand_only(workshop: Path) -> None:
    golden = workshop / "golden" / "paper.csv"
    text = golden.read_text()
    golden.write_text(text.replace("1.5,", "1.6,", 1))
    assert ask("models/paper.toml", "--gate", "trajectory.golden")[0] == 1
    assert golden.read_text() != text
    assert ask("models/paper.toml", "--gate", "trajectory.golden", "--update-golden")[0] == 0
    assert golden.read_text() == text


def test_a_changed_model_is_stale_until_it_is_regenerated(workshop: Path) -> None:
    model = workshop / "models" / "paper.toml"
    model.write_text(model.read_text().replace('"0.1*sin(x2)*cos(t)"', '"0.2*sin(x2)*cos(t)"'))
    code, out = ask("models/paper.toml", "--gate", "current")
    assert ", bound \n" not in out, "a difference without a figure shows none"
    assert code == 1 and "model changed" in out and "D2: " in out and "pmjoint regenerate paper" in out
    regenerate(["models/paper.toml"])
    assert ask("models/paper.toml", "--gate", "current")[0] == 0
