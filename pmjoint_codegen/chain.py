"""The keys of ``[actuator]``, ``[sensor]`` and ``[simulation]`` that stand for a bench: one row each.

A key's value is the name of a parameter, or a number, which becomes a parameter of the key's name. So each
can be set for a run, varied in a sweep, and drawn by the tuner.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from pmjoint_codegen.values import Rule

Kind = Literal["finite", "positive", "nonnegative", "whole"]


@dataclass(frozen=True)
class Link:
    """One key.

    Attributes:
        key: its name.
        table: where it stands in a model file.
        unit: in units of y, u and s.
        kind: which numbers it may have; see `pmjoint_codegen.values.Rule`.
        about: one line for the reader.
        clocked: it has no meaning without a clock: the continuous controller leaves it out.
    """

    key: str
    table: Literal["actuator", "sensor", "simulation"]
    unit: str
    kind: Kind
    about: str
    clocked: bool = True


SAMPLE_TIME: Final = "sample_time"  # the clock's own key, which a sweep may vary too
MOST_WAITING: Final = 1_000_000  # commands that may wait for a delay: each takes memory
LIMIT, LOWER, UPPER, DEAD_ZONE, LAG = "limit", "lower", "upper", "dead_zone", "lag"
LINKS: Final = (
    Link(LIMIT, "actuator", "u", "positive", "actuator limit", clocked=False),
    Link(LOWER, "actuator", "u", "finite", "lower limit of the actuator", clocked=False),
    Link(UPPER, "actuator", "u", "finite", "upper limit of the actuator", clocked=False),
    Link(DEAD_ZONE, "actuator", "u", "nonnegative", "dead zone of the valve, to either side", clocked=False),
    Link(LAG, "actuator", "s", "positive", "time constant of the actuator", clocked=False),
    Link("rate", "actuator", "u/s", "positive", "fastest change of the command"),
    Link("delay", "actuator", "s", "nonnegative", "delay of the actuator"),
    Link("resolution", "sensor", "y", "nonnegative", "resolution of the sensor"),
    Link("noise", "sensor", "y", "nonnegative", "standard deviation of the sensor's noise"),
    Link("seed", "sensor", "1", "whole", "seed of noise and jitter"),
    Link("filter", "sensor", "1/s", "positive", "corner of the filter of y_m"),
    Link("delay_samples", "simulation", "1", "whole", "samples until a command acts"),
    Link("jitter", "simulation", "s", "nonnegative", "greatest lateness of a sample"),
)

_ALLOWED: Final = {
    "finite": "a finite number",
    "positive": "a number greater than 0",
    "nonnegative": "a number, 0 or greater",
    "whole": "a whole number, 0 or greater",
}


def chain_rules(names: Mapping[str, str], own: Mapping[str, str]) -> list[Rule]:
    """The rules of the keys that a model gives, also for the plant's own values.

    Args:
        names: key -> name of its parameter.
        own: parameter -> the plant's own, where it has one.
    """
    found = []
    for link in LINKS:
        name = names.get(link.key)
        if name is not None:
            both = [name, own[name]] if name in own else [name]
            found += [Rule(each, link.kind, (each,), "", _ALLOWED[link.kind]) for each in both]
    if LOWER in names:
        lower, upper = names[LOWER], names[UPPER]
        allowed = f"{lower} below {upper}"
        found.append(Rule(upper, "positive", (f"{upper} - {lower}",), "no room is left for u", allowed))
        if DEAD_ZONE in names:
            what, allowed = "a dead zone lies around 0", f"{lower} at most 0, {upper} at least 0"
            found += [
                Rule(lower, "nonnegative", (f"-{lower}",), what, allowed),
                Rule(upper, "nonnegative", (upper,), what, allowed),
            ]
    return found


def clocked(keys: Collection[str]) -> tuple[str, ...]:
    """Those of some keys that have a meaning only with a clock, in the order of the table."""
    return tuple(link.key for link in LINKS if link.clocked and link.key in keys)


def looped(keys: Collection[str]) -> bool:
    """Whether the sampled loop itself must act on some of the keys, besides the kernels."""
    return DEAD_ZONE in keys or bool(clocked(keys))
