"""What the report does not cover."""

from __future__ import annotations

from collections.abc import Iterator

from pmjoint_codegen.check.gates.proof import no_certificate
from pmjoint_codegen.check.oracles.certificate import Certificate
from pmjoint_codegen.dossier.facts import Absent, Decay, Facts
from pmjoint_codegen.dossier.markup import chapter, code, items, plain
from pmjoint_codegen.report.mathml import inline_symbol
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
    if isinstance(facts.frozen, Absent):
        yield f"There is no run without adaptation to compare with: {plain(facts.frozen.reason)}."
    if isinstance(facts.certificate, Certificate | Decay) and facts.certificate.Y is None:
        yield "The disturbance has no stated bound, so there is no ultimate bound of the error."
    keys = left_out(facts.manifest, "continuous")
    if keys:
        yield f"The proof and the continuous run leave out what needs a clock: {plain(', '.join(keys))}."
    yield _bounded(facts)
    yield "The proof is in real numbers and continuous time. Rounding and sampling are measured, not proved."
    yield "Margins are those of a linearisation; the region is a grid of runs up to the horizon."
    adaptive = is_adaptive(facts.manifest)
    if adaptive:
        yield from _needed(facts)
    which = "Parameters that are not estimated" if adaptive else "Parameters of the plant"
    yield f"{which} are taken as known. A mismatch is simulated only where it is asked for."
    yield "No experiment is part of this report."


def _bounded(facts: Facts) -> str:
    """What the proof bounds, if anything."""
    design = facts.derivation.design
    if not design.certifies or no_certificate(facts.derivation):
        return "The identities of the proof bound nothing: this law has no Lyapunov function."
    estimates = is_adaptive(facts.manifest)
    bounded = (
        "z, the estimation error and the errors of the estimates"
        if estimates
        else "z and the estimation error"
    )
    state = inline_symbol("chi" if estimates else "r")
    return (
        f"The proof bounds {bounded}. It bounds neither the output nor the compensator’s state {state} while "
        "the input is saturated: no input within the limit can, if the plant is unstable."
    )


def _needed(facts: Facts) -> Iterator[str]:
    """What the proof of a design with estimates needs, and what nobody learns from it."""
    if not no_certificate(facts.derivation):
        b_m = inline_symbol(f"b{facts.derivation.plant.m}")
        yield (
            "The proof needs the plant’s own values within the ranges of their estimates, and the sign of "
            f"{b_m}."
        )
    yield "Nothing says where estimates end: they are no identified parameters."
