"""The paper's model under check, once a worker, and a tally of mutants."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject, load_subject


@pytest.fixture(scope="session")
def paper(root: Path, cache: Path) -> Subject:
    """The paper's model with its committed folder; the derived parts are made when they are asked for."""
    return load_subject(root / "models" / "paper.toml", os.environ, lambda _line: None)


@dataclass
class Tally:
    """Which mutant was caught by which gate."""

    rows: list[tuple[str, str, GateResult]] = field(default_factory=list)

    def add(self, gate: str, mutant: str, result: GateResult) -> None:
        """Take note of what the gate said of a mutant."""
        self.rows.append((gate, mutant, result))

    def table(self) -> str:
        """One line a mutant: the gate meant for it, the change, what came of it."""
        return "\n".join(
            f"{gate:24s} {'caught  ' if caught(result) else 'SURVIVED'} {mutant}"
            for gate, mutant, result in self.rows
        )

    def survivors(self) -> list[str]:
        """Mutants that passed the gate meant for them."""
        return [f"{gate}: {mutant}: {result.detail}" for gate, mutant, result in self.rows if not caught(result)]


def caught(result: GateResult) -> bool:
    """Whether a gate failed on a mutant."""
    return result.verdict is Verdict.FAILED


@pytest.fixture
def tally(record_property: Callable[[str, object], None]) -> Iterator[Tally]:
    """Collect mutants; the table goes to the end of the test report, and no mutant may survive."""
    kept = Tally()
    yield kept
    print(kept.table())
    record_property("mutants", kept.table())
    assert kept.rows, "no mutants were made"
    assert kept.survivors() == []
