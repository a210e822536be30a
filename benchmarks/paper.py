"""The paper's closed loop written by hand: what the peers are given to integrate.

Plain arithmetic, so that the same lines serve floats, NumPy rows, JAX, numba and heyoka's expressions: the
caller brings sin and cos. States in the kernels' order: x1 x2 xi1 xi2 Xi1 Xi2 lambda1 lambda2 r1 r2.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STATES: Final = ("x1", "x2", "xi1", "xi2", "Xi1", "Xi2", "lambda1", "lambda2", "r1", "r2")
X0: Final = (1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
HORIZON: Final = 20.0  # s
GAINS: Final = (15.0, 15.0, 0.1, 0.1, 1.0, 1.0, 6.0, 8.0)  # c1 c2 e1 e2 ck1 ck2 k1 k2
PLANT: Final = (0.2, 2.0, 10.0)  # d1 b0 u_max


class Sines(NamedTuple):
    """sin and cos of t and of x2, computed by whoever calls."""

    sin_t: Any
    cos_t: Any
    sin_x2: Any


def control(X: Any, sines: Sines, d1: Any, b0: Any) -> Any:
    """Return v of (29), for n = rho = 2, from the ten states."""
    c1, c2, e1, e2, ck1, ck2, _, k2 = GAINS
    x1, _, xi1, xi2, _, Xi2, l1, l2, r1, r2 = X
    Xi1 = X[4]
    slope = -(c1 + e1) / b0
    z1 = x1 - sines.sin_t - r1
    omega = xi2 + d1 * Xi2
    alpha = (-(c1 + e1) * z1 - omega - ck1 * r1) / b0
    z2 = l2 - alpha - (sines.cos_t + r2) / b0
    rate = (
        slope * (b0 * l2 + omega)
        - (k2 * (x1 - xi1) + d1 * (x1 - k2 * Xi1)) / b0
        - slope * sines.cos_t
        + (c1 + e1 - ck1) / b0 * (r2 - ck1 * r1)
    )
    return rate - b0 * z1 - (c2 + e2 * slope * slope) * z2 + k2 * l1 - (ck2 * r2 + sines.sin_t) / b0


def rates(X: Any, u: Any, v: Any, sines: Sines, d1: Any, b0: Any) -> tuple[Any, ...]:
    """Return the ten rates of (11), (14), (23), (37) under the delivered u."""
    _, _, _, _, ck1, ck2, k1, k2 = GAINS
    x1, x2, xi1, xi2, Xi1, Xi2, l1, l2, r1, r2 = X
    return (
        x2,
        d1 * x1 + b0 * u + 0.1 * sines.sin_x2 * sines.cos_t,
        xi2 + k1 * (x1 - xi1),
        k2 * (x1 - xi1),
        Xi2 - k1 * Xi1,
        x1 - k2 * Xi1,
        l2 - k1 * l1,
        u - k2 * l1,
        r2 - ck1 * r1,
        b0 * (u - v) - ck2 * r2,
    )
