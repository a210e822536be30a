"""The boundary: whatever happens below, a line on standard error and an exit code."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest

import pmjoint_codegen
from pmjoint_codegen import errors
from pmjoint_codegen.cli import main
from pmjoint_codegen.cli.commands import COMMANDS


def fail_with(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Let every command raise."""

    def raise_it(arguments: list[str]) -> int:
        raise error

    monkeypatch.setattr(main, "_invoke", raise_it)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UsageError("is 0", where="horizon"), 2),
        (errors.ModelError("unknown key", where="a.toml"), 2),
        (errors.StaleError("was edited by hand"), 1),
        (errors.CheckFailed("a difference"), 1),
        (errors.MissingToolError("no compiler"), 3),
        (errors.SimulationError("diverged"), 3),
        (KeyboardInterrupt(), 130),
        (click.Abort(), 130),
        (OSError(28, "No space left on device", "x.csv"), 3),
        (ZeroDivisionError("division by zero"), 3),
        (RecursionError("maximum recursion\ndepth exceeded"), 3),
        (MemoryError(), 3),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else str(value),
)
def test_each_error_is_one_line_and_its_exit_code(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("PMJOINT_TRACEBACK", raising=False)
    fail_with(monkeypatch, error)
    assert main.run(["derive", "paper"]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert captured.err.startswith("pmjoint: ")


def test_a_compilers_words_are_shown_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "kernels.c:1: error: x\n" * 400
    fail_with(monkeypatch, errors.BuildError("the compiler failed", output=words))
    assert main.run([]) == 3
    assert capsys.readouterr().err == f"{words}pmjoint: the compiler failed\n"


def test_a_bug_asks_for_a_report_and_shows_its_place_on_demand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(monkeypatch, ZeroDivisionError("division by zero"))
    monkeypatch.delenv("PMJOINT_TRACEBACK", raising=False)
    main.run([])
    quiet = capsys.readouterr().err
    assert "report" in quiet
    assert "Traceback" not in quiet
    monkeypatch.setenv("PMJOINT_TRACEBACK", "1")
    main.run([])
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("module", "brought_by"),
    [
        ("sympy", "pmjoint-codegen[derive]"),
        ("pandas", "pmjoint-codegen[sweep]"),
        ("matplotlib", "matplotlib"),
        ("scipy", "scipy"),
        ("_cffi_backend", "cffi"),
    ],
)
def test_a_missing_package_is_named_with_the_line_that_installs_it(
    module: str, brought_by: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(monkeypatch, ModuleNotFoundError(f"No module named '{module}'", name=module))
    assert main.run([]) == 3
    error = capsys.readouterr().err
    assert f"{shlex.quote(sys.executable)} -m pip install '{brought_by}'" in error
    assert "bug" not in error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["simulat"], "no command 'simulat'"),
        (["simulate"], "missing argument 'MODEL'"),
        (["simulate", "paper", "--bogus"], "--bogus"),
        (["simulate", "paper", "--horizon"], "--horizon"),
        (["simulate", "paper", "--horizon", "x"], "--horizon"),
        (["derive", "paper", "--format", "word"], "--format"),
        (["--bogus"], "--bogus"),
    ],
)
def test_misuse_is_one_line_that_points_to_the_help(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert said in captured.err
    assert "--help" in captured.err


def test_without_a_command_the_help_is_shown_as_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([]) == 2
    assert "Commands:" in capsys.readouterr().err


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_lists_every_command_with_its_line(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([flag]) == 0
    out = capsys.readouterr().out
    for entry in COMMANDS:
        assert entry.name in out
        assert entry.line in out


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["--version"]) == 0
    assert capsys.readouterr().out == f"pmjoint {pmjoint_codegen.__version__}\n"


def python(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run this interpreter."""
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.parametrize(
    "arguments", [["--help"], ["simulate", "--help"], ["derive", "--help"], ["doctor", "--help"]]
)
def test_help_imports_nothing_heavy(arguments: list[str], root: Path) -> None:
    code = (
        "import sys; from pmjoint_codegen.cli.main import run; code = run(sys.argv[1:]); "
        "heavy = {'numpy', 'sympy', 'casadi', 'matplotlib', 'pydantic', 'rich', 'cffi', 'pmjoint_derive'}; "
        "heavy &= set(sys.modules); "
        "sys.exit(f'imported {heavy}' if heavy else code)"
    )
    done = python("-c", code, *arguments, cwd=root)
    assert done.returncode == 0, done.stderr


def test_a_reader_that_leaves_early_is_no_error(root: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "pmjoint_codegen", "derive", "paper", "--format", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=root,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as stderr:
        assert stderr.read() == b""
    assert process.wait() == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_under_standard_output_is_one_line_and_3(root: Path) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "pmjoint_codegen", "doctor"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            cwd=root,
            check=False,
        )
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert "no space left" in done.stderr


def test_the_package_runs_as_a_module(tmp_path: Path, root: Path) -> None:
    done = python("-m", "pmjoint_codegen", "--version", cwd=tmp_path, PYTHONPATH=str(root))
    assert done.returncode == 0
    assert done.stdout.startswith("pmjoint ")


@pytest.mark.parametrize(
    "arguments",
    [["simulate", "paper", "--horizon", "{}"], ["{}"], ["sweep", "paper", "--grid", "{}"]],
    ids=lambda arguments: arguments[0],
)
def test_a_message_repeats_no_more_than_can_be_read(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run([text.format("a" * 5000) for text in arguments]) == 2
    said = capsys.readouterr().err
    assert len(said) < 1500 and "aaa ... " in said and len(said.splitlines()) == 1


def test_an_output_that_cannot_be_written_is_said_before_the_audit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pmjoint_codegen.cli import audit

    monkeypatch.setattr(audit, "_findings", lambda: pytest.fail("audited"))
    assert main.run(["audit", "--out", str(tmp_path / "none" / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_an_axis_without_finite_ends_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for axis in ("x1=inf:inf:2", "x1=nan:1:3", "x1=-inf:0:3"):
        assert main.run(["sweep", "paper", "--grid", axis]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
