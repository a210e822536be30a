"""The table of docs/saturation.md: `python -m docs.saturation` prints it.

Every row is one design of the paper's joint in five scenarios; every entry comes from a run of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import SimulationError

STRIP = 100.0  # rad, b0 u_max/d1: beyond it no input brings the joint back
LOST = "lost"
HEAD = (
    "design (start)",
    "sin t: ISE/settling/max v",
    "settling from 10, 50, 90 rad; limit",
    "ISE at u_max = 1, 2, 5",
    "step of 5; 50",
    "load 2: ISE",
)


@dataclass(frozen=True)
class Row:
    """One design.

    Attributes:
        name: as the table writes it.
        saturation: what is done about a saturated input.
        start: of the controller.
        gains: ck1 and ck2, or the share `braking` too.
        bold: whether it is the one to take.
    """

    name: str
    saturation: str
    start: str
    gains: dict[str, float] = field(default_factory=dict)
    bold: bool = False


def decay(ck1: float, ck2: float | None = None, **braking: float) -> dict[str, float]:
    """The gains of a compensator."""
    return {"ck1": ck1, "ck2": ck1 if ck2 is None else ck2, **braking}


ROWS = (
    Row("paper, ck = 1 (zero)", "compensator", "zero"),
    Row("clip (zero)", "clip", "zero"),
    Row("clip (matched)", "clip", "matched"),
    Row("ck = (√d1, 15) (matched)", "compensator", "matched", decay(0.2**0.5, 15.0)),
    Row("ck = 1 (matched)", "compensator", "matched"),
    Row("ck = 3 (matched)", "compensator", "matched", decay(3.0)),
    Row("ck = 12 (zero)", "compensator", "zero", decay(12.0)),
    Row("ck = 12 (matched)", "compensator", "matched", decay(12.0)),
    Row("braking 12, 0.5 (matched)", "braking", "matched", decay(12.0, braking=0.5), bold=True),
    Row("braking 12, 0.7 (matched)", "braking", "matched", decay(12.0, braking=0.7)),
    Row("braking 20, 0.9 (matched)", "braking", "matched", decay(20.0, braking=0.9)),
)


@cache
def loop(braking: bool, reference: str | None, load: str | None) -> ClosedLoop:
    """The paper's joint, with its own reference and disturbance where none is given."""
    return ClosedLoop.load(
        "paper",
        saturation="braking" if braking else None,
        reference=reference,
        disturbance=None if load is None else ("0", load),
        notify=lambda line: None,
    )


@dataclass(frozen=True)
class Scenario:
    """What the joint is asked to do.

    Attributes:
        reference: y_r; None: sin t.
        load: disturbance of x2'; None: the paper's.
        horizon: s.
    """

    reference: str | None = None
    load: str | None = None
    horizon: float = 20.0

    def run(self, row: Row, x1: float = 1.5, **parameters: float) -> Run | None:
        """One design in it, or None where it diverges."""
        try:
            found = loop(row.saturation == "braking", self.reference, self.load).simulate(
                x0=(x1, 0.0),
                start=row.start,
                compensator=row.saturation != "clip",
                horizon=self.horizon,
                parameters={**row.gains, **parameters},
                divergence=1e5,
            )
        except SimulationError:
            return None
        return found if found.summary["held"] else None


TRACKING = Scenario()
QUIET = Scenario("0", "0", 120.0)
LOADED = Scenario("0", "2")


def said(value: float, digits: int = 3) -> str:
    """A number with so many digits, never as a power of ten."""
    return f"{float(f'{value:.{digits}g}'):.10g}"


def shown(run: Run | None, *texts: Callable[[Run], str]) -> str:
    """What a run gives, or that the joint is lost."""
    return LOST if run is None else "/".join(text(run) for text in texts)


def ise(run: Run) -> str:
    """The integral of e^2."""
    return said(run.ise)


def settling(run: Run) -> str:
    """The time until the error stays within 2 % of its start."""
    return "none" if run.settling_s is None else said(run.settling_s)


def cells(row: Row) -> list[str]:
    """One line of the table."""
    tracking = shown(TRACKING.run(row), ise, settling, lambda run: said(run.peaks["v"][0]))
    returns = ", ".join(shown(QUIET.run(row, x1), settling) for x1 in (10.0, 50.0, 90.0))
    limits = ", ".join(shown(TRACKING.run(row, u_max=u), ise) for u in (1.0, 2.0, 5.0))
    steps = "; ".join(shown(Scenario(y, "0", 120.0).run(row, 0.0), settling) for y in ("5", "50"))
    return [
        row.name,
        tracking,
        f"{returns}; {said(limit(row), 4)}",
        limits,
        steps,
        shown(LOADED.run(row), ise),
    ]


def limit(row: Row) -> float:
    """The largest x1(0) at rest from which the joint returns, in rad, by bisection to 0.01."""
    low, high = 0.5 * STRIP, STRIP
    if QUIET.run(row, STRIP - 0.01) is not None:
        return STRIP
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if QUIET.run(row, middle) is not None else (low, middle)
    return low


def table() -> str:
    """The table in Markdown."""
    lines: list[Sequence[str]] = [HEAD, ["---"] * len(HEAD)]
    for row in ROWS:
        name, *others = cells(row)
        lines.append([f"**{name}**" if row.bold else name, *others])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    print(table())
