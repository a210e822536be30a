"""What the report does not cover."""

from __future__ import annotations

from collections.abc import Iterator

from pmjoint_codegen.check.oracles.certificate import Certificate
from pmjoint_codegen.dossier.facts import Absent, Facts
from pmjoint_codegen.dossier.markup import chapter, code, items, plain
from pmjoint_codegen.simulate.estimates import is_adaptive
from pmjoint_codegen.simulate.settings import left_out


def limits_chapter(facts: Facts) -> str:
    """A list of what nobody should read into the report."""
    return chapter("limits", "What is not covered", items(limits(facts)))


def limits(facts: Facts) -> Iterator[str]:
    """One HTML line for each limit, those of this model first."""
    if facts.checks.failed:
        yield f"Gates failed: {', '.join(code(row.gate.name) for row in facts.checks.failed)}."
    if facts.checks.open:
        yield f"Gates that were not run: {', '.join(code(row.gate.name) for row in facts.checks.open)}."
    for part, what in (
        (facts.run, "the default run"),
        (facts.sampled, "the sampled run"),
        (facts.margins, "the margins"),
        (facts.region, "the region of recovery"),
        (facts.trace, "the lines of the terms"),
    ):
        if isinstance(part, Absent):
            yield f"There is no account of {what}: {plain(part.reason)}."
    if isinstance(facts.certificate, Certificate) and facts.certificate.Y is None:
        yield "The disturbance has no stated bound, so there is no ultimate bound of the error."
    keys = left_out(facts.manifest, "continuous")
    if keys:
        yield f"The proof and the continuous run leave out what needs a clock: {plain(', '.join(keys))}."
    yield (
        "The proof bounds z and the estimation error. It bounds neither the output nor the compensator’s "
        "state r while the input is saturated: no input within the limit can, if the plant is unstable."
    )
    yield "The proof is in real numbers and continuous time. Rounding and sampling are measured, not proved."
    yield "Margins are those of a linearisation; the region is a grid of runs up to the horizon."
    adaptive = is_adaptive(facts.manifest)
    if adaptive:
        yield (
            "The proof needs the plant’s own values within the ranges of their estimates, and the sign of "
            "b_m. It does not say where estimates end: they are no identified parameters."
        )
    which = "Parameters that are not estimated" if adaptive else "Parameters of the plant"
    yield f"{which} are taken as known. A mismatch is simulated only where it is asked for."
    yield "No experiment is part of this report."
