"""Estimates where they can be: inside their ranges, and a gain matrix that is positive definite.

Outside, the adaptive law divides by zero, or V has the logarithm of a negative number. No run gets there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.manifest import LOGIT, Function, Manifest

Array = npt.NDArray[np.float64]

INSIDE: Final = (0.02, 0.98)  # of a range
NEAR: Final = (0.5, 2.0)  # times where an estimate without a range starts
SHARE: Final = 0.1  # of the gain matrix's diagonal, next to it


def place_estimates(
    manifest: Manifest, function: Function, arguments: tuple[Array, ...], random: np.random.Generator
) -> None:
    """Move the estimates among a kernel's inputs to where they can be, in place.

    Args:
        manifest: of the model; one without estimates changes nothing.
        function: the kernel.
        arguments: its points, one array per input, shape (points, size).
        random: chooses the places.
    """
    given = {label: array for (label, _), array in zip(function.inputs, arguments, strict=True)}
    label = next((label for label in ("X", "s") if label in given), None)
    if label is None or "p" not in given or "Theta" not in manifest.blocks:
        return
    first = 0 if label == "X" else manifest.nx
    p = {item.name: given["p"][:, i] for i, item in enumerate(manifest.parameters)}
    for place, values in _placed(manifest, p, random):
        given[label][:, place - first] = values


def order_ranges(manifest: Manifest, values: Array, random: np.random.Generator) -> None:
    """Let drawn ranges have their ends in order and their guess and prior inside, in place.

    Each was drawn for itself, so the ends of narrow ranges come out crossed, and guesses near an end outside.
    What is in order stays.

    Args:
        manifest: of the model.
        values: drawn parameters, shape (points, size).
        random: chooses places inside.
    """
    at = {item.name: i for i, item in enumerate(manifest.parameters)}
    for name in [name.removesuffix("_low") for name in at if name.endswith("_low")]:
        if not (name + "_high" in at and name + "_guess" in at):
            continue
        ends = [at[name + "_low"], at[name + "_high"]]
        values[:, ends] = np.sort(values[:, ends], axis=1)
        low, high = values[:, ends].T
        for inner in (name + "_guess", name + "_prior"):
            if inner in at:
                value = values[:, at[inner]]
                out = ~((low < value) & (value < high))
                place = random.uniform(*INSIDE, int(np.sum(out)))
                value[out] = low[out] + place * (high - low)[out]


def _placed(
    manifest: Manifest, p: Mapping[str, Array], random: np.random.Generator
) -> Iterator[tuple[int, Array]]:
    """Index among the states, and values, of every estimate."""
    count = len(next(iter(p.values())))
    first, last = manifest.blocks["Theta"]
    for i in range(first, last):
        name = manifest.states[i].name
        if name.endswith(LOGIT):
            low, high, guess = (
                p[f"{name.removesuffix(LOGIT)}_{which}"] for which in ("low", "high", "guess")
            )
            place = random.uniform(*INSIDE, count)
            yield i, np.log(place / (1 - place)) - np.log((guess - low) / (high - guess))
        else:
            yield i, p[f"{name.removesuffix('_hat')}_guess"] * random.uniform(*NEAR, count)
    for i in range(*manifest.blocks.get("rho", (0, 0))):
        yield i, p["rho_guess"] * random.uniform(*NEAR, count)
    first, last = manifest.blocks.get("Gamma", (0, 0))
    starts = manifest.start.guesses[first - manifest.nx : last - manifest.nx]
    for i, start in enumerate(starts, start=first):
        if start:
            yield i, p[start] * random.uniform(*NEAR, count)
        else:
            yield i, SHARE * p["ls_P0"] * random.uniform(-1.0, 1.0, count)
