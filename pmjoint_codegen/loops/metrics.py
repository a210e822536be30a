"""The metrics of each run in a batch: one row per metric, from its C expression to its label in figures.

A run's numbers are those of ``summary.json``: peaks and instants are taken on the dense output in both. A run
that ends early has no ``settling_s`` in either: nobody knows what it would have done.
`rows_header` gives the C loops the rows' expressions; a row needs no other code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Self


@dataclass(frozen=True)
class Row:
    """One metric.

    Attributes:
        unit: physical unit; ``{e}`` and ``{v}`` mean those of the model's signals.
        about: one line for the reader.
        at_end: C expression of its value when run ``w`` of ``runs`` (``pmj_runs``) ends with ``status`` and
            with the error ``e``; empty if it is the sum of `added`.
        added: C expression that each accepted ``step`` (``pmj_span``) adds, on all lanes; or empty.
        integer: whether it is a whole number.
        of_kinks: whether only models with a kink that can hold the plant have it.
        words: its label in figures. A metric with a label is in the totals and can be a tuning objective.
        logarithmic: whether a logarithmic scale suits it.
        mapped: whether a sweep over two axes draws a map of it.
    """

    unit: str
    about: str
    at_end: str = ""
    added: str = ""
    integer: bool = False
    of_kinks: bool = False
    words: str = ""
    logarithmic: bool = False
    mapped: bool = False


class Column(IntEnum):
    """Columns of `Outcome.metrics`, by number; each has its `Row`."""

    row: Row

    def __new__(cls, row: Row) -> Self:
        """Number the rows in their order."""
        column = int.__new__(cls, len(cls.__members__))
        column._value_ = len(cls.__members__)
        column.row = row
        return column

    @property
    def variable(self) -> str:
        """Its name in datasets, totals, figures and objectives."""
        return self.name.lower()

    STATUS = Row("1", "how the run ended", at_end="(double)status", integer=True)
    T_END = Row("s", "time reached", at_end="runs->t[w]")
    STEPS = Row("1", "integration steps", at_end="runs->steps[w]", integer=True)
    SWITCHES = Row(
        "1",
        "times that u entered or left a limit",
        at_end="(double)runs->lanes[w].switches",
        integer=True,
    )
    ISE = Row(
        "{e}^2 s",
        "integral of e^2",
        added="step->h * step->square",
        words="integral of $e^2$",
        logarithmic=True,
        mapped=True,
    )
    MAX_ABS_E = Row("{e}", "largest |e|", at_end="runs->metrics.max_e[w]", words="largest $|e|$")
    SETTLING_S = Row(
        "s",
        "last instant at which |e| exceeds 2 % of |e(0)|; none if it does at the end",
        at_end="status == PMJ_DONE && runs->metrics.band[w] > 0.0 ? runs->metrics.settling[w] : NAN",
        words="settling",
        mapped=True,
    )
    SATURATED_S = Row(
        "s",
        "time that u spends at a limit",
        added="step->h * step->limited",
        words="time at a limit",
        mapped=True,
    )
    MAX_ABS_V = Row(
        "{v}",
        "largest |v|",
        at_end="runs->metrics.max_v[w]",
        words="largest $|v|$",
        logarithmic=True,
        mapped=True,
    )
    FINAL_E = Row("{e}", "e at the end", at_end="e")
    FINAL_SATURATED = Row("1", "1 where u is at a limit at the end", at_end="runs->limited[w]", integer=True)
    STUCK_S = Row("s", "time that a kink holds the plant", added="step->h * step->stuck", of_kinks=True)
    STICKS = Row(
        "1",
        "times that a kink began to hold the plant",
        at_end="(double)runs->lanes[w].sticks",
        integer=True,
        of_kinks=True,
    )


REPORTED: Final[Mapping[str, Column]] = {column.variable: column for column in Column if column.row.words}


def rows_header() -> str:
    """``metric_rows.h``: the rows for the C loops, as lists for a macro of (column, expression)."""
    added = [f"    ROW({column:d}, {column.row.added})" for column in Column if column.row.added]
    at_end = [
        f"    ROW({column:d}, {column.row.at_end or f'runs->metrics.sums[{column:d}][w]'})"
        for column in Column
    ]
    lists = (("PMJ_ADDED", added), ("PMJ_AT_END", at_end))
    defined = [" \\\n".join([f"#define {name}(ROW)", *rows]) for name, rows in lists]
    return "\n".join(
        [
            "/* The rows of pmjoint_codegen/loops/metrics.py. */",
            "#ifndef PMJOINT_METRIC_ROWS_H",
            "#define PMJOINT_METRIC_ROWS_H",
            f"#define PMJ_METRICS {len(Column)}",
            *defined,
            "#endif",
            "",
        ]
    )


def last_exit(horizon: float) -> float:
    """The instant, s, after which leaving the settling band means that a run has not settled.

    It lies below the horizon by the rounding of an end that the loops add up from steps.
    """
    return horizon * (1.0 - 1e-12)
