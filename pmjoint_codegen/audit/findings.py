"""The record that every examination ends in, and how a display of equations becomes one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.judgement import Evaluate, Link, Proofs, Verdict, judge_lines, no_proofs, verdict
from pmjoint_codegen.audit.notation import Scope, chain, names, value
from pmjoint_codegen.audit.paper import DESIGN, JOINT
from pmjoint_codegen.report.notation import text_expression

Setting = Callable[[Sequence[str]], Evaluate]  # further definitions -> how to evaluate


@dataclass(frozen=True)
class Evidence:
    """One computed fact.

    Attributes:
        label: what was computed.
        value: a number, or an expression or list as text.
        unit: physical unit; empty where there is none.
    """

    label: str
    value: float | str
    unit: str = ""


@dataclass(frozen=True)
class Finding:
    """What became of one display or claim of the paper.

    Attributes:
        number: the paper's number, or a name.
        title: what it is about.
        verdict: by comparison.
        summary: one sentence for the table.
        printed: the display, in the notation of `pmjoint_codegen.audit.notation`.
        corrected: what should stand there, in the same notation; empty when nothing is wrong.
        derived: what follows from the model, as text; empty where the printed form is all there is.
        reading: a doubt about how the print is to be read; empty when there is none.
        evidence: computed facts.
    """

    number: str
    title: str
    verdict: Verdict
    summary: str
    printed: tuple[str, ...] = ()
    corrected: tuple[str, ...] = ()
    derived: tuple[str, ...] = ()
    reading: str = ""
    evidence: tuple[Evidence, ...] = ()


@dataclass(frozen=True)
class Remedy:
    """A proposed correction, to be judged like the print.

    Attributes:
        edits: (printed, corrected) pieces of text. Where the print does not hold the printed piece, or is
            wrong in some other way as well, the remedy does not help.
        given: ``name = value``: what must be said besides.
    """

    edits: tuple[tuple[str, str], ...] = ()
    given: tuple[str, ...] = ()

    def mend(self, lines: tuple[str, ...]) -> tuple[str, ...]:
        """The lines with every edit made."""
        for before, after in self.edits:
            lines = tuple(line.replace(before, after) for line in lines)
        return lines


@dataclass(frozen=True)
class Case:
    """A display before the judge.

    Attributes:
        context: what it is compared with.
        number: of the display.
        calm: the summary when every link holds.
        corrected: the summary when the remedy was needed.
        otherwise: verdict when every link holds.
        setting: how its expressions are evaluated; by default as the design part's.
        proofs: for inequalities.
        remedy: proposed correction.
        derived: what follows from the model, as text.
        reading: a doubt about the print, shown when the remedy was needed.
    """

    context: Context
    number: str
    calm: str
    corrected: str = ""
    otherwise: Verdict = Verdict.FOLLOWS
    setting: Setting | None = None
    proofs: Proofs = field(default_factory=no_proofs)
    remedy: Remedy | None = None
    derived: tuple[str, ...] = ()
    reading: str = ""

    def judged(self, *evidence: Evidence) -> Finding:
        """Judge the display; ``evidence`` is kept beside what the judge finds."""
        display = self.context.paper[self.number]
        setting = self.setting or design(self.context)
        printed = judge_lines(display.lines, setting(()), self.proofs)
        found = verdict(printed, self._mended(display.lines, setting), self.otherwise)
        mended = found is Verdict.CORRECTED
        summaries = {Verdict.CORRECTED: self.corrected, Verdict.FAILS: "the printed relation does not hold"}
        return Finding(
            number=self.number,
            title=display.title,
            verdict=found,
            summary=summaries.get(found, self.calm),
            printed=display.lines,
            corrected=self._correction(display.lines) if mended else (),
            derived=self.derived,
            reading=self.reading if mended else "",
            evidence=(*_faults(printed), *evidence),
        )

    def _mended(self, lines: tuple[str, ...], setting: Setting) -> tuple[Link, ...]:
        if self.remedy is None:
            return ()
        return judge_lines(self.remedy.mend(lines), setting(self.remedy.given), self.proofs)

    def _correction(self, lines: tuple[str, ...]) -> tuple[str, ...]:
        """Where the corrected lines first leave the printed ones, and what must be said besides."""
        if self.remedy is None:
            return ()
        pairs = zip(lines, self.remedy.mend(lines), strict=True)
        return (
            *(_first_change(before, after) for before, after in pairs if before != after),
            *self.remedy.given,
        )


def _first_change(before: str, after: str) -> str:
    """The first relation of a chain that differs from the printed one."""
    return next(relation for relation in _relations(after) if relation not in _relations(before))


def _relations(line: str) -> list[str]:
    sides, signs = chain(line)
    return [f"{left} {sign} {right}" for left, sign, right in zip(sides, signs, sides[1:], strict=False)]


def design(context: Context, law: bool = False) -> Setting:
    """Evaluate in the design part: in primitive symbols, with the derived law for v if wanted."""

    def given(definitions: Sequence[str]) -> Evaluate:
        known = _definitions(definitions, context.scope(DESIGN))
        return lambda text: _replaced(context.value(text, law), known)

    return given


def joint(context: Context, meaning: Mapping[sp.Symbol, sp.Expr]) -> Setting:
    """Evaluate in the physical part, some symbols put in terms of others."""
    scope = context.scope(JOINT)

    def given(definitions: Sequence[str]) -> Evaluate:
        known = {**meaning, **_definitions(definitions, scope)}
        return lambda text: _replaced(value(text, scope), known)

    return given


def _definitions(lines: Sequence[str], scope: Scope) -> dict[sp.Symbol, sp.Expr]:
    return {value(chain(line)[0][0], scope): value(chain(line)[0][1], scope) for line in lines}


def _replaced(item: Any, known: Mapping[sp.Symbol, sp.Expr]) -> Any:
    return item.xreplace(dict(known))


def derived_text(context: Context, *names: str) -> tuple[str, ...]:
    """Equations of the derivation as text, without the input scale, which the paper does not have."""
    equations, unscaled = context.derivation.equations, {context.signals.input_scale: sp.Integer(1)}
    return tuple(
        f"{name} = {text_expression(equations[name].expression.xreplace(unscaled))}" for name in names
    )


def undefined(context: Context, name: str, shown: str) -> tuple[Evidence, ...]:
    """Where a symbol is used, and which displays have it on their left."""
    used, defined = [], []
    for number, display in context.paper.items():
        if any(name in names(line) for line in display.lines):
            used.append(number)
        if any(line.startswith(f"{name} =") for line in display.lines):
            defined.append(number)
    return (
        Evidence(f"{shown} is used in", ", ".join(used)),
        Evidence("and defined in", ", ".join(defined) or "no display"),
    )


def units_of(context: Context, *terms: str) -> Evidence:
    """Units of terms that a display adds."""
    listed = ", ".join(term.replace("**", "^") for term in terms)
    return Evidence(f"units of {listed}", ", ".join(str(context.unit(term)) for term in terms))


def one_unit(context: Context, *terms: str) -> bool:
    """Whether terms have one unit, so that their sum is independent of the units chosen."""
    return len({frozenset(context.unit(term).powers.items()) for term in terms}) == 1


def yes(fact: object) -> str:
    """A fact that is true or not, as a value of evidence."""
    return "yes" if fact else "no"


def _faults(printed: tuple[Link, ...]) -> tuple[Evidence, ...]:
    """What the judge found wrong, link by link."""
    several = len(printed) > 1
    return tuple(
        Evidence(
            f"relation {place} of {len(printed)} does not hold" if several else "does not hold", link.remark
        )
        for place, link in enumerate(printed, start=1)
        if not link.holds
    )
