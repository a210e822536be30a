"""What a contestant for one continuous run is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from benchmarks.paper import Array


@dataclass(frozen=True)
class Solver:
    """An integrator of the paper's closed loop.

    Attributes:
        label: its name.
        settings: accuracy settings to choose from, the loosest first: tolerances, or steps in s.
        make: (setting, instants from 0 in s) -> a call that integrates once and returns the states there.
    """

    label: str
    settings: tuple[float, ...]
    make: Callable[[float, Array], Callable[[], Array]]


def load(name: str) -> Any:
    """Import a peer's package, which may be absent and whose types do not matter here; raises ImportError."""
    return import_module(name)
