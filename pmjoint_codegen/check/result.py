"""The result of a gate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """How a gate ended; a gate that could not run is never ``passed``."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Difference:
    """The first place where two sides disagree.

    Attributes:
        kernel: which function, or which file, tool or statement.
        entry: which of its results.
        point: the arguments, as text that can be pasted.
        expected: value of the reference.
        found: value of the checked side.
        error: distance of the two.
        bound: largest allowed error.
    """

    kernel: str
    entry: str
    point: str
    expected: str
    found: str
    error: str
    bound: str

    def __str__(self) -> str:
        """All fields, one line per item."""
        rows = {
            "where": f"{self.kernel}, {self.entry}",
            "point": self.point,
            "expected": self.expected,
            "found": self.found,
            "error": f"{self.error}, bound {self.bound}" if self.error or self.bound else "",
        }
        return "\n".join(f"{label:9s} {value}" for label, value in rows.items() if value)


@dataclass(frozen=True)
class GateResult:
    """Outcome of one gate for one model.

    Attributes:
        verdict: passed, failed or not run.
        figure: the measured value, or None if there is nothing to measure.
        bound: largest allowed figure.
        detail: one line: the meaning of the figure, or why the gate failed or could not run.
        difference: the first difference, when there is one.
        findings: everything else worth reading, one line each.
        name: of the gate, from the table: `table.run_gate` adds it.
        seconds: its duration, likewise.

    Raises:
        ValueError: the verdict is passed and the figure is not within its bound; nan never is.
    """

    verdict: Verdict
    figure: float | None
    bound: float | None
    detail: str
    difference: Difference | None = None
    findings: tuple[str, ...] = ()
    name: str = ""
    seconds: float = 0.0

    def __post_init__(self) -> None:
        """Refuse to pass a figure outside its bound, whoever makes the result."""
        if self.verdict is Verdict.PASSED and not within(self.figure, self.bound):
            raise ValueError(f"cannot pass: {self.figure} is not within {self.bound}")


def within(figure: float | None, bound: float | None) -> bool:
    """Whether a figure is a number, and at most its bound if it has one; nan is neither."""
    if figure is None:
        return True
    return not math.isnan(figure) and (bound is None or figure <= bound)


def passed(
    detail: str, figure: float | None = None, bound: float | None = None, *findings: str
) -> GateResult:
    """A gate that found nothing; it still fails if its figure is nan or beyond its bound."""
    if not within(figure, bound):
        why = f"{figure} is not within {'any bound' if bound is None else bound}: {detail}"
        return failed(why, figure, bound, findings=findings)
    return GateResult(Verdict.PASSED, figure, bound, detail, findings=findings)


def failed(
    detail: str,
    figure: float | None = None,
    bound: float | None = None,
    difference: Difference | None = None,
    findings: tuple[str, ...] = (),
) -> GateResult:
    """A gate that found a difference."""
    return GateResult(Verdict.FAILED, figure, bound, detail, difference=difference, findings=findings)


def not_run(reason: str) -> GateResult:
    """A gate that could not run."""
    return GateResult(Verdict.NOT_RUN, None, None, reason)
