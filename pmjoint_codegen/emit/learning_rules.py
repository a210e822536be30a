"""Rules for guesses, ranges and gains of estimates, which a run may set like any other number."""

from __future__ import annotations

from collections.abc import Iterator

from pmjoint_codegen.values import COMPENSATOR, Rule
from pmjoint_derive.adaptation import (
    LEAKAGE,
    LS_FORGETTING,
    LS_K_MAX,
    LS_KAPPA,
    LS_P0,
    RHO_GAMMA,
    RHO_GUESS,
    RHO_LEAKAGE,
    Adaptation,
    Entry,
)

_POSITIVE, _NOT_NEGATIVE = "a number greater than 0", "a number of 0 or greater"


def learning_rules(adaptation: Adaptation | None) -> tuple[Rule, ...]:
    """What a controller that guesses or estimates assumes of its own numbers; none for one that does not.

    The true values obey no rule: one outside its range is allowed, and leaves no V.

    Args:
        adaptation: of the model.
    """
    return () if adaptation is None else tuple(_rules(adaptation))


def _rules(adaptation: Adaptation) -> Iterator[Rule]:
    tuned = adaptation.least_squares is None
    for entry in adaptation.entries:
        yield from _of_range(entry)
        if entry.place == 0:
            yield _of_leading(entry, adaptation)
        if entry.unknown and tuned:
            yield _not_negative(entry.gamma.name)
    if not adaptation.unknown:
        return
    if not adaptation.force:
        what = "plain clipping misleads the estimates, which destroys the loop"
        allowed = "1 (on); 0 where the model file has force = true in [adaptation]"
        yield Rule(COMPENSATOR, "positive", (COMPENSATOR,), what, allowed)
    if tuned:
        yield _not_negative(LEAKAGE.name)
    if adaptation.inverse is not None:
        yield _not_negative(RHO_GAMMA.name)
        yield _not_negative(RHO_LEAKAGE.name)
        yield _signed(RHO_GUESS.name, adaptation.sign, "1/b_m")
    if adaptation.least_squares is not None:
        yield Rule(LS_KAPPA.name, "positive", (LS_KAPPA.name,), "", _POSITIVE)
        yield Rule(LS_P0.name, "positive", (LS_P0.name,), "", _POSITIVE)
        yield _not_negative(LS_FORGETTING.name)
        trace = f"{len(adaptation.unknown)}*{LS_P0.name}"
        what, allowed = "less than the initial trace of the gain matrix", f"at least {trace}"
        yield Rule(LS_K_MAX.name, "nonnegative", (f"{LS_K_MAX.name} - {trace}",), what, allowed)


def _of_range(entry: Entry) -> Iterator[Rule]:
    """The estimate starts inside its range."""
    if not entry.unknown or entry.range is None:
        return
    guess, (low, high) = entry.guess_symbol.name, (end.name for end in entry.ends)
    what, allowed = f"not inside the range of {entry.estimate}", f"a number between {low} and {high}"
    yield Rule(guess, "positive", (f"{guess} - {low}",), what, allowed)
    yield Rule(guess, "positive", (f"{high} - {guess}",), what, allowed)


def _of_leading(entry: Entry, adaptation: Adaptation) -> Rule:
    """The sign of b_m is known, and the law divides by what stands for it."""
    guess = entry.guess_symbol.name
    if not entry.unknown:
        return Rule(guess, "nonzero", (guess,), "", "a number other than 0")
    if entry.range is None:
        return _signed(guess, adaptation.sign, "b_m")
    low, high = (end.name for end in entry.ends)
    what = f"the range of {entry.estimate} contains 0, and the law divides by it"
    return Rule(low, "positive", (f"{low}*{high}",), what, f"{low} and {high} of one sign")


def _signed(name: str, sign: int, what: str) -> Rule:
    """The law was derived for one sign of b_m."""
    term = name if sign > 0 else f"-{name}"
    side = "greater" if sign > 0 else "less"
    return Rule(
        name, "positive", (term,), f"another sign of {what} than the model's", f"a number {side} than 0"
    )


def _not_negative(name: str) -> Rule:
    return Rule(name, "nonnegative", (name,), "", _NOT_NEGATIVE)
