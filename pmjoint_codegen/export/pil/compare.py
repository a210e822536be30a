"""A processor's answers against this machine's, and against the derived bound on rounding errors.

Both are judged as `pmjoint_codegen.export.elsewhere` says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.elsewhere import library_functions, step_ratios
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.records import Answer, Array, other_bits


@dataclass(frozen=True)
class Agreement:
    """One precision's answers compared.

    Attributes:
        values: how many were compared.
        other_bits: how many have other bits than the host's.
        ratio: largest difference of a step from the equations, relative to its bound.
    """

    values: int
    other_bits: int
    ratio: float


def compare(export: Export, given: Array, target: Answer, host: Answer, place: str) -> Agreement:
    """Compare a processor's answers with the host's and with the bound.

    Args:
        export: the controller.
        given: the samples, shape (samples, inputs), as they were before rounding to the precision.
        target: the processor's answers.
        host: this machine's, to the same samples.
        place: for messages.

    Raises:
        CheckFailed: bits differ though no function of the library is called, or a step is beyond the bound.
    """
    differing = other_bits(target, host)
    if differing.any() and not library_functions(export.program):
        row, column = (int(i) for i in np.argwhere(differing)[0])
        name = target.layout.columns.values[column]
        a, b = (float(item.column(name)[row]) for item in (host, target))
        told = f"{name} at sample {row} is {b!r}, on this machine {a!r}"
        raise CheckFailed(f"{int(differing.sum())} values have other bits: {told}", where=place)
    samples = given.astype(target.layout.real).astype(np.float64)
    ratio = step_ratios(export, samples, {name: target.column(name) for name in target.layout.columns.values})
    worst = np.unravel_index(np.argmax(ratio), ratio.shape)
    if not ratio[worst] <= 1.0:
        name = target.layout.columns.values[int(worst[1])]
        told = f"{name} at sample {int(worst[0]) + 1} is off by {ratio[worst]:.3g} times its derived bound"
        raise CheckFailed(told, where=place)
    return Agreement(differing.size, int(differing.sum()), float(ratio[worst]))
