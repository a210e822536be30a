"""The vector instructions that the compiler may use here: the widest that this processor has.

A library is built for one level, and its name in the cache contains it. So machines that share a cache
folder never load code that they cannot run. Results do not depend on the level: every lane rounds as a single
double does (see ``pmjoint_lanes.h``).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pmjoint_codegen.errors import UsageError

VARIABLE: Final = "PMJOINT_VECTOR_LEVEL"
_CPUINFO: Final = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Level:
    """A set of vector instructions.

    Attributes:
        name: as in `VARIABLE`.
        flags: of the compiler.
        width: doubles in a vector register.
        features: of the processor, by Linux's names, that it requires.
    """

    name: str
    flags: tuple[str, ...]
    width: int
    features: frozenset[str]


def known_levels() -> tuple[Level, ...]:
    """All levels, the widest first; the last one runs everywhere."""
    v3 = frozenset(["avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"])
    v4 = v3 | frozenset(["avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"])
    return (
        Level("x86-64-v4", ("-march=x86-64-v4",), 8, v4),
        Level("x86-64-v3", ("-march=x86-64-v3",), 4, v3),
        Level("baseline", (), 2, frozenset()),
    )


def usable_levels(environment: Mapping[str, str], cpuinfo: str | None = None) -> tuple[Level, ...]:
    """The levels that this machine can run, the widest first.

    Args:
        environment: `VARIABLE` caps the level.
        cpuinfo: text of Linux' list of processors; read from the system when None.

    Raises:
        UsageError: `VARIABLE` names no level.
    """
    levels = known_levels()
    names = [level.name for level in levels]
    wanted = environment.get(VARIABLE, "").strip() or names[0]
    if wanted not in names:
        raise UsageError(f"is {wanted!r}", where=VARIABLE, remedy=f"allowed: {', '.join(names)}")
    features = _features(_read() if cpuinfo is None else cpuinfo)
    return tuple(level for level in levels[names.index(wanted) :] if level.features <= features)


def _read() -> str:
    try:
        return _CPUINFO.read_text(encoding="utf-8") if os.uname().machine == "x86_64" else ""
    except OSError:
        return ""


def _features(cpuinfo: str) -> frozenset[str]:
    """The features that every processor of the list has."""
    lists = [set(line.partition(":")[2].split()) for line in cpuinfo.splitlines() if line.startswith("flags")]
    return frozenset(set.intersection(*lists)) if lists else frozenset()
