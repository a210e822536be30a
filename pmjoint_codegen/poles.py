"""Poles and roots as text, multiple ones once although rounding splits them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

_REACHES: Final = (0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of close poles, relative to the largest
_SAME_POLYNOMIAL: Final = 1e-12  # relative change of a coefficient
_REAL: Final = 1e-9  # imaginary part of a real pole, relative to the largest


def poles_text(poles: npt.ArrayLike, digits: int = 6) -> str:
    """Show poles or roots, multiple ones once: ``-20 (twice)``, though rounding splits them.

    Rounding moves an m-fold root by the m-th root of its own size. Close ones are one wherever that changes
    no coefficient of their polynomial by more than rounding does.

    Args:
        poles: numbers in the order wanted.
        digits: significant ones to show.
    """
    shown = []
    for pole, count in _multiple(np.asarray(poles, dtype=np.complex128).ravel()):
        real, imaginary = pole.real + 0, pole.imag  # + 0 drops the sign of a negative zero
        text = f"{complex(real, imaginary):.{digits}g}" if imaginary else f"{real:.{digits}g}"
        shown.append(text if count == 1 else f"{text} ({'twice' if count == 2 else f'{count} times'})")
    return ", ".join(shown)


def _multiple(poles: npt.NDArray[np.complex128]) -> list[tuple[complex, int]]:
    """The poles with their multiplicities."""
    size = float(np.max(np.abs(poles), initial=0.0))
    if not 0.0 < size < math.inf:
        return [(complex(pole), 1) for pole in poles]
    units = poles / size
    wanted = np.poly(units)
    for reach in _REACHES:
        groups = _close(units, reach)
        means = [complex(np.mean(units[group])) for group in groups]
        repeated = [mean for mean, group in zip(means, groups, strict=True) for _ in group]
        if np.all(np.abs(np.poly(repeated) - wanted) <= _SAME_POLYNOMIAL * np.abs(wanted)):
            real = (complex(mean.real) if abs(mean.imag) < _REAL else mean for mean in means)
            return [(mean * size, len(group)) for mean, group in zip(real, groups, strict=True)]
    return [(complex(pole), 1) for pole in poles]


def _close(points: npt.NDArray[np.complex128], reach: float) -> list[list[int]]:
    """Group points that are joined by distances up to a reach, in the points' order."""
    groups: list[list[int]] = []
    for k, point in enumerate(points):
        near = [group for group in groups if np.min(np.abs(points[group] - point)) <= reach]
        merged = sorted([k, *(i for group in near for i in group)])
        groups = sorted([*(group for group in groups if group not in near), merged])
    return groups
