"""Ctrl-C and SIGTERM at any moment: one line, the shell's exit code, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal was closed"}
PATIENCE_S = 60
WAYS = {
    "module": ("-m", "pmjoint_codegen"),
    "script": ("-c", "from pmjoint_codegen.cli.main import main; main()"),
}
SLEEPER = (
    "open({mark!r}, 'w').close(); import time\ntry:\n    time.sleep(60)\nexcept KeyboardInterrupt as e:\n    "
)


def wait_for(mark: Path, child: subprocess.Popen[str]) -> None:
    """Wait until a child says that it is where it should be."""
    end = time.monotonic() + PATIENCE_S
    while not mark.exists() and child.poll() is None and time.monotonic() < end:
        time.sleep(0.01)


def stopped(
    command: Sequence[str], mark: Path, number: signal.Signals, cwd: Path, **environment: str
) -> tuple[int, str]:
    """Exit code and messages of a command that gets a signal once `mark` is there."""
    child = subprocess.Popen(
        [sys.executable, *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env={**os.environ, **environment},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    wait_for(mark, child)
    child.send_signal(number)
    try:
        return child.wait(PATIENCE_S), child.communicate()[1]
    finally:
        child.kill()


def assert_stopped(outcome: tuple[int, str], number: signal.Signals) -> None:
    """One line, and the code that a shell gives."""
    assert outcome == (128 + number, f"pmjoint: {WORDS[number]}\n")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("module", ["click", "numpy"])
@pytest.mark.parametrize("converted", [False, True], ids=["as-it-is", "as-an-import-error"])
def test_an_interrupted_import_is_one_line(way: str, module: str, converted: bool, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    end = "raise ImportError('NumPy is broken') from None" if converted else "raise"
    (tmp_path / "late").mkdir()
    (tmp_path / "late" / f"{module}.py").write_text(SLEEPER.format(mark=str(mark)) + end + "\n")
    path = os.pathsep.join([str(tmp_path / "late"), os.environ.get("PYTHONPATH", "")])
    command = (*WAYS[way], "simulate", "paper", "--no-figures")
    assert_stopped(stopped(command, mark, signal.SIGINT, tmp_path, PYTHONPATH=path), signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_while_compiling_leaves_nothing(number: signal.Signals, tmp_path: Path) -> None:
    mark, cache, temporary = tmp_path / "mark", tmp_path / "cache", tmp_path / "tmp"
    cache.mkdir(mode=0o700)
    temporary.mkdir()
    compiler = tmp_path / "cc"
    compiler.write_text(f'#!/bin/sh\ntouch "${{TMPDIR:-/tmp}}/half.o" {mark}\nexec sleep 60\n')
    compiler.chmod(0o700)
    known = {"PMJOINT_CACHE": str(cache), "CC": str(compiler), "TMPDIR": str(temporary)}
    command = (*WAYS["module"], "simulate", "paper", "--no-figures", "--out", "out")
    assert_stopped(stopped(command, mark, number, tmp_path, **known), number)
    assert list(temporary.iterdir()) == []
    assert [path for path in cache.rglob("*") if path.is_file() or path.name.startswith(".")] == []
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("kind", ["writing", "sweep"])
def test_a_termination_while_writing_leaves_whole_files(kind: str, tmp_path: Path) -> None:
    mark, out, temporary = tmp_path / "mark", tmp_path / "out", tmp_path / "tmp"
    temporary.mkdir()
    hook = (
        "import time; from pathlib import Path\n"
        "def late(self, target):\n"
        f"    Path({str(mark)!r}).touch(); time.sleep(60)\n"
        "Path.replace = late\n"
        "from pmjoint_codegen.cli.main import main\nmain()\n"
    )
    arguments = {
        "writing": ("simulate", "paper", "--horizon", "0.1", "--no-figures"),
        "sweep": ("sweep", "paper", "--grid", "x1=0:1:3", "--horizon", "0.1", "--no-figures"),
    }[kind]
    known = {"TMPDIR": str(temporary)}
    outcome = stopped(("-c", hook, *arguments, "--out", str(out)), mark, signal.SIGTERM, tmp_path, **known)
    assert_stopped(outcome, signal.SIGTERM)
    assert list(temporary.iterdir()) == []
    assert [path.name for path in out.rglob("*") if path.is_file()] == []


def test_a_signal_that_the_caller_ignores_stays_ignored(tmp_path: Path) -> None:
    code = (
        "import signal; from pmjoint_codegen.cli.main import _listen; _listen(); print(signal.getsignal(1))"
    )
    command = ["nohup", sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, done.stdout) == (0, f"{signal.SIG_IGN}\n")
