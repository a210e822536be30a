"""Drawn settings: limits of u and initial states, the same in every session.

A model's own run saturates at most once, from one state, at round numbers. Errors that depend on where v
meets a limit, and on how that limit rounds, show only elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.manifest import Manifest

Array = npt.NDArray[np.float64]

LIMITS: Final = (0.2, 1.2)  # times the model's limit: most of it, and beyond what other channels allow
DECADES: Final = (
    -2.0,
    0.0,
)  # of |x(0)|, relative to max(1, the model's): strong saturation, and next to none


@dataclass(frozen=True)
class Draw:
    """One drawn setting.

    Attributes:
        limit: of u, in its unit.
        x0: initial plant states, shape (nx,).
    """

    limit: float
    x0: Array


def drawn_limits(manifest: Manifest, draw: Draw) -> dict[str, float]:
    """Values of the limits in a draw: where lower and upper are two, both in proportion."""
    usual = _usual(manifest)
    largest = max(map(abs, usual.values()))
    return {
        name: draw.limit if value == largest else value * (draw.limit / largest)
        for name, value in usual.items()
    }


def _usual(manifest: Manifest) -> dict[str, float]:
    values = {item.name: item.value for item in manifest.parameters}
    return {name: values[name] for name in manifest.limit_parameters}


def draws(manifest: Manifest) -> Iterator[Draw]:
    """An endless sequence of settings of one model, seeded by its name.

    Args:
        manifest: gives names, the limit and the usual initial state.
    """
    random = np.random.default_rng([*manifest.name.encode()])
    usual = max(map(abs, _usual(manifest).values()))
    size = np.maximum(1.0, np.abs(manifest.simulation.x0))
    while True:
        limit = usual * random.uniform(*LIMITS)
        signs = random.choice([-1.0, 1.0], manifest.nx)
        yield Draw(float(limit), signs * size * 10.0 ** random.uniform(*DECADES, manifest.nx))
