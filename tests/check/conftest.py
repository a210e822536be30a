"""The paper's model under check, once a worker, and a tally of mutants."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject, load_subject


@pytest.fixture(scope="session")
def paper(root: Path, cache: Path) -> Subject:
    """The paper's model with its committed folder; the derived parts are made when they are asked for."""
    return load_subject(root / "models" / "paper.toml", os.environ, lambda _line: None)


@pytest.fixture(scope="session")
def adaptive(root: Path, cache: Path) -> Subject:
    """Return the paper's model with estimates."""
    return load_subject(root / "models" / "paper-adaptive.toml", os.environ, lambda _line: None)


Tally = Callable[[str, str, GateResult], None]


@pytest.fixture
def tally(record_property: Callable[[str, object], None]) -> Iterator[Tally]:
    """Take note of what a gate said of a mutant: ``tally(gate, mutant, result)``.

    The table goes to the end of the test report; no mutant may survive the gate meant for it.
    """
    rows: list[tuple[str, str, GateResult]] = []
    yield lambda gate, mutant, result: rows.append((gate, mutant, result))
    lines = [
        f"{gate:24s} {'caught  ' if caught(result) else 'SURVIVED'} {mutant}" for gate, mutant, result in rows
    ]
    print("\n".join(lines))
    record_property("mutants", "\n".join(lines))
    assert rows, "no mutants were made"
    assert [(gate, mutant) for gate, mutant, result in rows if not caught(result)] == []


def caught(result: GateResult) -> bool:
    """Whether a gate failed on a mutant."""
    return result.verdict is Verdict.FAILED
