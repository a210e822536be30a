"""Settings of a run that its source does not state, for captions and for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen.simulate.estimates import (
    GUESS,
    INITIAL_GAIN,
    LEAKAGE,
    LYAPUNOV,
    estimates,
    guesses,
    has_lyapunov,
    is_frozen,
    leaking,
    stale_defaults,
)
from pmjoint_codegen.values import COMPENSATOR, ZERO

FAST: Final = 1.0  # 1/s, of leakage times gain
AT_AN_END: Final = 1e-5  # of a range

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

# Models whose source states neither the reference nor the horizon of its figures -> the reference assumed for
# it: a run's own manifest holds whatever reference was given for it.
_SILENT_SOURCES: Mapping[str, str] = MappingProxyType({"paper": "sin(t)"})


def assumed(run: Record) -> tuple[str, ...]:
    """List the settings that only the model file states, because the model's source does not."""
    return tuple(text for text, given in _settings(run) if not given) if _is_silent(run) else ()


def stated(run: Record) -> tuple[str, ...]:
    """List reference, horizon and sample time of a model whose source states them."""
    return () if _is_silent(run) else tuple(text for text, _ in _settings(run))


def _is_silent(run: Record) -> bool:
    return run.manifest.name in _SILENT_SOURCES


def _settings(run: Record) -> tuple[tuple[str, bool], ...]:
    """The reference, the horizon and a sampled controller's sample time; and whether each was given."""
    settings, simulation = run.settings, run.manifest.simulation
    assumption = _SILENT_SOURCES.get(run.manifest.name, run.reference_text)
    found = [
        (f"y_r = {run.reference_text}", run.reference_text != assumption),
        (f"horizon {settings.horizon:g} s", settings.horizon != simulation.horizon),
    ]
    if settings.controller == "sampled":
        period = settings.sample_time
        found.append((f"sample time {period:g} s", period != simulation.sample_time))
    return tuple(found)


def changes(run: Record) -> tuple[str, ...]:
    """List the differences from the model file, such as ``c1 = 20``.

    These are parameters, gains and initial states and, if the source does not state them, the settings
    that would otherwise be assumed. `stated` has those of the others.
    """
    manifest, settings = run.manifest, run.settings
    defaults = {item.name: item.value for item in manifest.parameters}
    stated = manifest.stated(settings.parameters)
    found = [text for text, given in _settings(run) if given and _is_silent(run)]
    differing = {
        name: value for name, value in stated.items() if value != defaults[name] or name in manifest.own
    }
    units = {item.name: item.unit for item in manifest.parameters if item.name in manifest.scales}
    found += [_said(name, value, units.get(name, "")) for name, value in manifest.written(differing).items()]
    if settings.start != manifest.simulation.start:
        found.append(f"{settings.start} start")
    if tuple(settings.x0.tolist()) != manifest.simulation.x0:
        found.append(f"x(0) = ({', '.join(f'{value:g}' for value in settings.x0)})")
    return tuple(found)


def _said(name: str, value: float, unit: str) -> str:
    if name == COMPENSATOR:
        return f"compensator {'on' if value else 'off'}"
    return f"{name} = {value:g} {unit}".rstrip()


def sentence(run: Record, notes: Sequence[str] = ()) -> str:
    """Describe all of it in a sentence or two, for a caption.

    Args:
        run: what is captioned.
        notes: further changes that the run itself cannot recognise as such.
    """
    parts = parts_of(run, notes)
    return " ".join(f"{label}: {', '.join(items)}." for label, items in parts.items() if items)


def parts_of(run: Record, notes: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """The same, each part a list of settings by its label."""
    return {
        "Assumed, not stated in the paper": assumed(run),
        "Settings": stated(run),
        "Changed": (*changes(run), *notes),
        "Note": remarks(run),
    }


def _ends_reached(run: Record) -> Iterator[tuple[str, str]]:
    """Each estimate that came to an end of its range, where its gain has vanished, and the end."""
    for item in estimates(run):
        if item.range is not None:
            low, high = item.range
            near = AT_AN_END * (high - low)
            if float(np.min(run[item.name])) - low <= near:
                yield item.name, f"{low:g}"
            if high - float(np.max(run[item.name])) <= near:
                yield item.name, f"{high:g}"


def _unproved(run: Record) -> Iterator[str]:
    """Each true value that the design excludes: outside its range, or b_m of the other sign."""
    end = "nothing is proved and V has no value" if _lost(run) else "nothing is proved"
    outside = [
        (item, item.range)
        for item in estimates(run)
        if item.range is not None and not item.range[0] < item.truth < item.range[1]
    ]
    for item, (low, high) in outside:
        of = f"the range of {item.name}, {low:g} to {high:g}"
        yield f"{item.of} = {item.truth:g} is outside {of}: {end}"
    told = {item.of for item, _ in outside}
    for guess in guesses(run):
        truth = guess.truth if guess.leading and guess.of not in told else None
        if truth is not None and truth * guess.value < 0:
            other = f"the other sign than {guess.of}{GUESS} = {guess.value:g}"
            yield f"{guess.of} = {truth:g} has {other}, so v acts the wrong way: {end}"


def _lost(run: Record) -> bool:
    """Whether a run has a column V without a value."""
    return LYAPUNOV in run.columns and not has_lyapunov(run)


def _leaks(run: Record) -> Iterator[str]:
    """Leakage that is faster than learning.

    It acts within the gain, so an estimate is pulled to its prior at the rate of both together. With a range
    that rate is the one in its middle; it vanishes at its ends.
    """
    values = run.settings.parameters
    found = [
        f"{item.name} is pulled to {prior} at {rate:.4g} 1/s, {gain} times {leakage}"
        for item in estimates(run)
        for gain, leakage, prior in [leaking(item.name)]
        if gain in values and (rate := values[gain] * values[leakage]) > FAST
    ]
    if found:
        found[-1] += (
            f"; above {FAST:g} 1/s an estimate forgets sooner than it learns: set {LEAKAGE} to 0 or less gain"
        )
    yield from found


def remarks(run: Record) -> tuple[str, ...]:
    """What a reader of an adaptive run must know: what takes its proof away, or misleads its estimates."""
    values = run.settings.parameters
    found = [*_unproved(run), *_leaks(run)]
    found += [
        f"{name} came to {end}, an end of its range, and is as long in coming back: less gain, a wider "
        "range, or leakage"
        for name, end in _ends_reached(run)
    ]
    found += stale_defaults(run)
    if is_frozen(run):
        return tuple(found)
    if INITIAL_GAIN in values and run.settings.start == ZERO:
        found.append(
            "least squares needs the matched start: from filters at 0 the first prediction error is none of "
            "the parameters"
        )
    if not values[COMPENSATOR]:
        found.append("plain clipping misleads estimates, which may destroy the loop: keep the compensator")
    return tuple(found)
