"""How far a trajectory of the paper's model is from the reference that was computed independently."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.paper import STATES, Array

ROOT = Path(__file__).resolve().parent.parent
REFERENCE = ROOT / "tests" / "reference" / "paper_sin.csv"
LISTED = {"Xi1": "Xi11", "Xi2": "Xi21"}  # the file's names, where they differ


@cache
def listed() -> tuple[Array, Array]:
    """Return the instants, s, shape (rows,), and the states there, shape (rows, 10)."""
    with REFERENCE.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    states = [[float(line[LISTED.get(name, name)]) for name in STATES] for line in lines]
    return np.array([float(line["t"]) for line in lines]), np.array(states)


def error(grid: Array, states: Array) -> float:
    """Return the largest difference from the reference in any state at any listed instant.

    Args:
        grid: instants of `states`, s; the listed ones are among them.
        states: shape (len(grid), 10).
    """
    instants, expected = listed()
    rows = [int(np.abs(grid - t).argmin()) for t in instants]
    if not np.allclose(grid[rows], instants, atol=1e-9):
        raise ValueError("the grid leaves out instants of the reference")
    return float(np.abs(states[rows] - expected).max())
