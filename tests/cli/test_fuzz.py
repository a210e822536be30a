"""Hostile command lines: a documented exit code, one line that helps, and never a traceback."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from hypothesis import strategies as st

from pmjoint_codegen.cli import main

EXIT_CODES = {0, 1, 2, 3}
NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "-0.0",
    "0",
    "1e308",
    "-1e308",
    "5e-324",
    "9" * 400,
    "",
    " ",
    "1_0",
    "0x10",
    "١",
]
TEXTS = [
    "",
    " ",
    "\x01\x1b[2J",
    "\t\n",
    "é≤\u202e",
    "\udcff",
    "a" * 5000,
    "--",
    "=",
    ",",
    ":",
    "~",
    "%s",
    "{}",
    "'",
]
PATHS = [
    "",
    ".",
    "..",
    "/",
    "/dev/null",
    "/dev/full",
    "/nonexistent/x",
    "pyproject.toml",
    "\udcff",
    "a" * 300,
]
MODELS = [
    "paper",
    "",
    " ",
    "nothing",
    ".",
    "/dev/null",
    "/dev/zero",
    "\x1b",
    "a" * 5000,
    "\udcff",
    "paper.toml",
]

number = st.sampled_from([*NUMBERS, "1", "0.1", "-1"])
text = st.sampled_from(TEXTS)
anything = st.one_of(number, text)
axis = st.builds("{}={}:{}:{}".format, st.sampled_from(["x1", "c1", "", "y", "é"]), number, number, number)
draw = st.builds(
    "{}~{}({},{})".format,
    st.sampled_from(["x1", "d1", ""]),
    st.sampled_from(["normal", "uniform", "loguniform", "x"]),
    number,
    number,
)
setting = st.builds(
    "{}={}".format, st.sampled_from(["c1", "u_max", "d1_plant", "", "nothing", "é", "\x1b"]), anything
)
expression = st.one_of(
    text,
    number,
    st.sampled_from(["sin(t)", "1/0", "t**t**t", "x1", "y_r", "(" * 300, "log(-1)", "__import__('os')"]),
)
path = st.sampled_from(PATHS)
RUN = {
    "--set": setting,
    "--x0": st.lists(anything, max_size=4).map(",".join),
    "--horizon": anything,
    "--sample-time": anything,
    "--controller": text,
    "--max-step": anything,
    "--divergence": anything,
    "--tolerance": anything,
}
OPTIONS: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "simulate": {
        **RUN,
        "--reference": expression,
        "--disturbance": expression,
        "--output-step": anything,
        "--evaluator": text,
        "--out": path,
    },
    "sweep": {
        **RUN,
        "--grid": axis,
        "--sample": draw,
        "--runs": anything,
        "--seed": anything,
        "--threads": anything,
        "--format": text,
        "--out": path,
    },
    "tune": {
        **RUN,
        "--gain": st.one_of(setting, axis),
        "--objective": expression,
        "--max-v": anything,
        "--perturb": draw,
        "--plants": anything,
        "--generations": anything,
        "--population": anything,
        "--seed": anything,
        "--out": path,
    },
    "derive": {"--format": text},
    "regenerate": {"--check": st.just(None)},
    "check": {"--gate": text, "--junit": path},
    "audit": {"--format": text, "--out": st.sampled_from(["", "/", ".", "/nonexistent/x"])},
    "new": {"--out": path, "--plant": st.just(None)},
    "doctor": {"--json": st.just(None), "--bogus": anything},
}
MINIMAL = {
    "simulate": ["--horizon", "0.01", "--no-figures"],
    "sweep": ["--no-figures", "--grid", "x1=0:1:2", "--horizon", "0.01"],
}


NAMED = {
    "simulate": ["paper"],
    "check": [name for name in MODELS if name != "paper"],  # all gates take minutes
    "regenerate": [name for name in MODELS if name != "paper"],
    "new": [name for name in MODELS if name != "paper"],  # it would stand before the one that others run
}


@st.composite
def command_lines(draw_from: st.DrawFn) -> list[str]:
    """A command with options that exist, at least one of them hostile, perhaps given twice."""
    command = draw_from(st.sampled_from(sorted(OPTIONS)))
    words = [command, *MINIMAL.get(command, [])]
    for name in draw_from(st.lists(st.sampled_from(sorted(OPTIONS[command])), min_size=1, max_size=3)):
        value = draw_from(OPTIONS[command][name])
        words += [name] if value is None else [name, value]
    if command not in ("audit", "doctor"):
        words.append(draw_from(st.sampled_from(NAMED.get(command, MODELS))))
    return words


def judge(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run a command line and hold its words against what is documented."""
    code = main.run(words)
    captured = capsys.readouterr()
    assert code in EXIT_CODES, words
    assert "Traceback" not in captured.err, words
    assert "unexpected" not in captured.err, (words, captured.err)
    if code == 2:
        assert captured.err.strip(), words
        last = captured.err.splitlines()[-1]
        assert last.startswith("pmjoint"), (words, captured.err)
        assert ";" in last, (words, last)
        assert last.isprintable(), (words, last)


@hypothesis.settings(
    max_examples=60, suppress_health_check=[*hypothesis.HealthCheck], derandomize=True, database=None
)
@hypothesis.given(words=command_lines())
def test_a_hostile_command_line(
    words: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # every example runs in one folder: what an earlier one left must not spoil a later one
    monkeypatch.chdir(tmp_path)
    judge(words, capsys)
    left = [name for _, _, names in os.walk(tmp_path) for name in names if ".tmp-" in name or ".new-" in name]
    assert left == []
