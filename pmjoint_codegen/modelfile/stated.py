"""What ``[adaptation]`` says of each entry of Theta, and the numbers that follow where it says nothing.

An estimate may be wrong by half its range: a share of the square of that is its gain. The share of a load is
greater, since a load is all that keeps the output from where it should be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.adaptation import INVERSE, LEAST_SQUARES, AdaptationSpec
from pmjoint_codegen.modelfile.entries import Slot, slot_called
from pmjoint_derive.adaptation import Entry

SHARE: Final = 0.3  # gamma over the square of half a range
SHARE_OF_LOAD: Final = 4.0

Pair = tuple[float, float]


@dataclass(frozen=True)
class Stated:
    """What a file says of one entry.

    Attributes:
        slot: the entry.
        name: what the file calls it.
        unknown: whether it is estimated.
        guess: None where the file gives none; so are the others.
        range: least and greatest.
        gain: gamma.
        prior: where leakage pulls to.
    """

    slot: Slot
    name: str
    unknown: bool
    guess: float | None
    range: tuple[float, ...] | None
    gain: float | None
    prior: float | None


def stated_of(table: AdaptationSpec, slots: tuple[Slot, ...], where: str) -> tuple[Stated, ...]:
    """What a file says of each entry that it names, in the order of Theta.

    Args:
        table: ``[adaptation]``.
        slots: entries of Theta.
        where: file at the start of a message.

    Raises:
        ModelError: a name that is none, or two names of one entry.
    """
    keys: Mapping[str, tuple[str, ...]] = {
        "unknown": table.names_unknown,
        **{key: tuple(getattr(table, key)) for key in ("guess", "range", "gain", "prior")},
    }
    called: dict[int, str] = {}
    for key, names in keys.items():
        for i, name in enumerate(names, start=1):
            place = f"adaptation.unknown, entry {i}" if key == "unknown" else f"adaptation.{key}.{name}"
            slot = slot_called(name, place, slots, where)
            other = called.setdefault(slot.place, name)
            if other != name:
                raise ModelError(
                    f"{name} and {other} are one entry",
                    where=f"{where}: {place}",
                    remedy="call it by one of these names",
                )
            if key == "unknown" and name in names[: i - 1]:
                raise ModelError(
                    f"{quoted(name)} is there twice", where=f"{where}: {place}", remedy="give it once"
                )
    return tuple(
        Stated(
            slots[place],
            name,
            name in keys["unknown"],
            *(getattr(table, key).get(name) for key in ("guess", "range", "gain", "prior")),
        )
        for place, name in sorted(called.items())
    )


def entry_of(item: Stated, table: AdaptationSpec, y: float, where: str) -> Entry:
    """One entry, its numbers checked, and those that follow.

    Args:
        item: what the file says of it.
        table: ``[adaptation]``.
        y: how many SI units the unit of y is.
        where: file at the start of a message.

    Raises:
        ModelError: a number that this entry cannot have, or none where nothing gives it.
    """
    slot, name = item.slot, item.name
    if not item.unknown:
        _refuse_for_known(item, where)
    value = 0.0 if slot.load else slot.value
    guess = value if item.guess is None else item.guess
    ends = _range(item, where)
    if slot.leading:
        _check_leading(item, guess, ends, table, where)
    if ends is not None:
        _check_inside(item, guess, ends, where)
    gain = _gain(item, ends, y, where) if item.unknown and table.estimator != LEAST_SQUARES else 0.0
    return Entry(
        name=name,
        place=slot.place,
        guess=guess,
        unknown=item.unknown,
        range=ends,
        gain=gain,
        prior=guess if item.prior is None else item.prior,
        unit=slot.unit,
        about=slot.about,
    )


def _refuse_for_known(item: Stated, where: str) -> None:
    """A known entry may have a guess, for good; nothing else of it is used."""
    for key in ("range", "gain", "prior"):
        if getattr(item, key) is not None:
            raise ModelError(
                f"has no effect, since {item.name} is not unknown",
                where=f"{where}: adaptation.{key}.{item.name}",
                remedy=f'add "{item.name}" to unknown, or leave this out',
            )


def _range(item: Stated, where: str) -> Pair | None:
    """The range as a pair that ascends."""
    if item.range is None:
        return None
    if len(item.range) == 2 and item.range[0] < item.range[1]:
        return item.range[0], item.range[1]
    raise ModelError(
        f"is {list(item.range)}",
        where=f"{where}: adaptation.range.{item.name}",
        remedy="allowed: [least, greatest], two different numbers",
    )


def _check_leading(item: Stated, guess: float, ends: Pair | None, table: AdaptationSpec, where: str) -> None:
    """B_m has a sign, which the controller knows: neither guess nor range nor estimate may lose it."""
    name = item.name
    of_range, of_guess = f"{where}: adaptation.range.{name}", f"{where}: adaptation.guess.{name}"
    if guess == 0:
        raise ModelError(
            "is 0, and with b_m = 0 no input acts", where=of_guess, remedy="allowed: another number"
        )
    if not item.unknown:
        return
    if ends is None:
        if table.form != INVERSE:
            raise ModelError(
                f"is missing, so {name}_hat may pass 0, and the law divides by it",
                where=of_range,
                remedy='give a range without 0, or form = "inverse"',
            )
        if item.guess is None:
            raise ModelError(
                f"is missing, and so is a range of {name}: one of them states the sign of b_m",
                where=of_guess,
                remedy="give a guess",
            )
        return
    if ends[0] <= 0 <= ends[1]:
        raise ModelError(
            f"{list(ends)} contains 0, and the sign of b_m must be known",
            where=of_range,
            remedy="allowed: two numbers greater than 0, or two less than 0",
        )
    if guess * ends[0] < 0:
        sign = "positive" if ends[0] > 0 else "negative"
        raise ModelError(
            f"{_said(item, guess)}, but the range {list(ends)} is {sign}",
            where=of_guess,
            remedy="give guess and range of one sign",
        )


def _check_inside(item: Stated, guess: float, ends: Pair, where: str) -> None:
    """Guess and prior lie in the open range: at its ends the gain is 0, and beyond them negative."""
    for key, number in (("guess", guess), ("prior", item.prior)):
        if number is not None and not ends[0] < number < ends[1]:
            said = _said(item, number) if key == "guess" else f"is {number:g}"
            raise ModelError(
                f"{said}, not within the range {list(ends)}",
                where=f"{where}: adaptation.{key}.{item.name}",
                remedy=f"allowed: a number greater than {ends[0]:g} and less than {ends[1]:g}",
            )


def _said(item: Stated, guess: float) -> str:
    return f"is {guess:g}" if item.guess is not None else f"is by default {guess:g}, the value of {item.name}"


def _gain(item: Stated, ends: Pair | None, y: float, where: str) -> float:
    """The gain, or what half the range makes of it, for errors of one SI unit of y."""
    if item.gain is not None:
        return item.gain
    if ends is None:
        raise ModelError(
            "is missing, and so is a range, from which it would follow",
            where=f"{where}: adaptation.gain.{item.name}",
            remedy="give gain or range",
        )
    share = SHARE_OF_LOAD if item.slot.load else SHARE
    return share * ((ends[1] - ends[0]) / 2 * y) ** 2
