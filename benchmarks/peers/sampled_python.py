"""One sampled run in plain Python, for numba: as ``c/sampled_by_hand.c``, with RK4 for the plant."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.paper import Array


def march(x: Array, p: Array, h: Array, T: float, samples: int) -> Array:
    """Return the state after `samples` samples; p as `by_hand.parameters` has it, h the hold's matrices."""
    d1, b0, limit, c1, c2, e1, e2, ck1, ck2, k1, k2 = p
    E, G, R, Q = h[0:4], h[4:8], h[8:12], h[12:16]
    slope = -(c1 + e1) / b0
    x1, x2, xi1, xi2, Xi1, Xi2, l1, l2, r1, r2 = x
    ise = most_e = most_v = 0.0
    for i in range(samples):
        t = i * T
        s, c = math.sin(t), math.cos(t)
        z1 = x1 - s - r1
        omega = xi2 + d1 * Xi2
        z2 = l2 - (-(c1 + e1) * z1 - omega - ck1 * r1) / b0 - (c + r2) / b0
        rate = (
            slope * (b0 * l2 + omega)
            - (k2 * (x1 - xi1) + d1 * (x1 - k2 * Xi1)) / b0
            - slope * c
            + (c1 + e1 - ck1) / b0 * (r2 - ck1 * r1)
        )
        v = rate - b0 * z1 - (c2 + e2 * slope * slope) * z2 + k2 * l1 - (ck2 * r2 + s) / b0
        u = min(max(v, -limit), limit)
        ise += T * (x1 - s) ** 2
        most_e, most_v = max(most_e, abs(x1 - s)), max(most_v, abs(v))
        # xi, Xi, lambda, r: exact over the hold, with y and u held
        drive = b0 * (u - v)
        in1, in2 = k1 * x1, k2 * x1
        xi1, xi2 = (
            E[0] * xi1 + E[1] * xi2 + G[0] * in1 + G[1] * in2,
            E[2] * xi1 + E[3] * xi2 + G[2] * in1 + G[3] * in2,
        )
        Xi1, Xi2 = E[0] * Xi1 + E[1] * Xi2 + G[1] * x1, E[2] * Xi1 + E[3] * Xi2 + G[3] * x1
        l1, l2 = E[0] * l1 + E[1] * l2 + G[1] * u, E[2] * l1 + E[3] * l2 + G[3] * u
        r1, r2 = R[0] * r1 + R[1] * r2 + Q[1] * drive, R[2] * r1 + R[3] * r2 + Q[3] * drive
        # the plant by RK4
        middle, end = math.cos(t + T / 2), math.cos(t + T)
        f1 = d1 * x1 + b0 * u + 0.1 * math.sin(x2) * c
        y2 = x2 + T / 2 * f1
        f2 = d1 * (x1 + T / 2 * x2) + b0 * u + 0.1 * math.sin(y2) * middle
        y3 = x2 + T / 2 * f2
        f3 = d1 * (x1 + T / 2 * y2) + b0 * u + 0.1 * math.sin(y3) * middle
        y4 = x2 + T * f3
        f4 = d1 * (x1 + T * y3) + b0 * u + 0.1 * math.sin(y4) * end
        x1 += T / 6 * (x2 + 2 * (y2 + y3) + y4)
        x2 += T / 6 * (f1 + 2 * (f2 + f3) + f4)
    return np.array([x1, x2, xi1, xi2, Xi1, Xi2, l1, l2, r1, r2, ise, most_e, most_v])
