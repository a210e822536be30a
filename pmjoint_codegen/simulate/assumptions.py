"""Settings of a run that its source does not state, for captions and for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen.simulate.estimates import LEAKAGE, estimates, is_frozen, leaking, stale_defaults
from pmjoint_codegen.values import COMPENSATOR

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


def remarks(run: Record) -> tuple[str, ...]:
    """What a reader of an adaptive run must know: leakage that is faster than learning, and plain clipping.

    Leakage acts within the gain, so an estimate is pulled to its prior at the rate of both together. With a
    range that rate is the one in its middle; it vanishes at its ends.
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
    found += [
        f"{name} came to {end}, an end of its range, and is as long in coming back: less gain, a wider "
        "range, or leakage"
        for name, end in _ends_reached(run)
    ]
    found += stale_defaults(run)
    if not is_frozen(run) and not values[COMPENSATOR]:
        found.append("plain clipping misleads estimates, which may destroy the loop: keep the compensator")
    return tuple(found)
