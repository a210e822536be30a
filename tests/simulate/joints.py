"""Model files of one measured joint with further torques, and the same physics typed once more in numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Array = npt.NDArray[np.float64]
Event = Callable[[float, Array, float, float], float]
COULOMB_TORQUE = 0.6  # N m

FILE = """schema = 1
name = "drawn-joint"
title = "A joint with further torques"
source = "geometry of a measured bench; gravity, friction and disturbance chosen"
[joint]
keep = {keep}
{torques}
J = {{ value = 500, unit = "kg cm^2" }}
b_v = 0.109
r = {{ value = 15, unit = "mm" }}
l0 = 0.185
eps0 = 0.15
C1 = 8.032e-3
C2 = -1.285e-2
C3 = 3.2e-3
C4 = 0
k0 = {{ value = 0.5, unit = "bar/V" }}
u0 = 5
k_u = {{ value = 0.5, unit = "bar/V" }}
P_max = {{ value = 5, unit = "bar" }}
{tau}
[parameters]
u_max = {{ value = 5, unit = "V" }}
m = {{ value = 2500, unit = "g" }}
g = {{ value = 9.81, unit = "m/s^2" }}
l = {{ value = 12, unit = "cm" }}
Fc = {{ value = 600, unit = "N mm" }}
soft = {{ value = 1, unit = "deg/s" }}
[actuator]
limit = "u_max"
[design]
bandwidth = 20
input_scale = "auto"
[simulation]
reference = "0.3*(1 - cos(t))"
x0 = [0.15, -0.3]
horizon = 3
"""
GRAVITY = '"-m*g*l*sin(theta)"'
COULOMB = '"-Fc*sign(theta_dot)"'
SMOOTH = '"-Fc*tanh(theta_dot/soft)"'
SHAKEN = '"0.2*sin(3*t) + 0.1*theta*theta_dot - 4*max(abs(theta) - 0.4, 0)*sign(theta)"'


def write_joint(folder: Path, keep: Sequence[str], *, lagged: bool, **torques: str) -> Path:
    """Write the file; `torques` are keys of ``[joint]``, quoted as in TOML."""
    lines = "\n".join(f"{key} = {text}" for key, text in torques.items())
    text = FILE.format(
        keep=str(list(keep)).replace("'", '"'),
        torques=lines,
        tau='tau = { value = 200, unit = "ms" }' if lagged else "",
    )
    path = folder / "drawn-joint.toml"
    path.write_text(text)
    return path


@dataclass(frozen=True)
class Bench:
    """The joint in numbers, in SI units.

    Attributes:
        J: inertia of the plant.
        lagged: whether pressures lag.
        gravity: whether it acts.
        friction: "none", "smooth" or "coulomb".
        shaken: whether the disturbance acts.
    """

    J: float = 0.05
    lagged: bool = False
    gravity: bool = False
    friction: str = "none"
    shaken: bool = False
    P0: float = field(default=2.5e5)

    def commands(self, u: float) -> tuple[float, float]:
        """Pressures that the valves are told."""
        first, second = (min(max(self.P0 + side * 5e4 * u, 0.0), 5e5) for side in (1, -1))
        return first, second

    def load(self, t: float, theta: float, speed: float, P1: float, P2: float) -> float:
        """All torques but Coulomb's friction, N m."""
        r, stretch = 0.015, 0.015 * theta / 0.185

        def force(P: float, eps: float) -> float:
            return P * (8.032e-3 * eps**2 - 1.285e-2 * eps + 3.2e-3)

        total = r * (force(P1, 0.15 + stretch) - force(P2, 0.15 - stretch)) - 0.109 * speed
        if self.gravity:
            total -= 2.5 * 9.81 * 0.12 * math.sin(theta)
        if self.friction == "smooth":
            total -= COULOMB_TORQUE * math.tanh(speed / math.radians(1))
        if self.shaken:
            stop = 4 * max(abs(theta) - 0.4, 0) * math.copysign(1, theta)
            total += 0.2 * math.sin(3 * t) + 0.1 * theta * speed - stop
        return total

    def rates(self, t: float, state: Array, u: float, side: float) -> list[float]:
        """Of theta, theta_dot, P1, P2; `side` of Coulomb's friction is 0 where it is stuck or absent."""
        theta, speed, P1, P2 = state
        stuck = self.friction == "coulomb" and side == 0.0
        friction = side * COULOMB_TORQUE if self.friction == "coulomb" else 0.0
        acceleration = 0.0 if stuck else (self.load(t, theta, speed, P1, P2) - friction) / self.J
        lag = [(c - P) / 0.2 for c, P in zip(self.commands(u), (P1, P2), strict=True)]
        return [speed, acceleration, *(lag if self.lagged else (0.0, 0.0))]

    def after_hold(self, u: float, begin: float, end: float, state: Array) -> Array:
        """Theta, theta_dot, P1, P2 at the end of one hold, from those at its begin."""
        t, state = begin, state.copy()
        if not self.lagged:
            state[2:] = self.commands(u)
        while t < end:
            side = self._side(t, state)
            found = solve_ivp(
                self.rates,
                (t, end),
                state,
                "DOP853",
                args=(u, side),
                events=self._ends(side),
                rtol=1e-12,
                atol=1e-14,
            )
            t, state = float(found.t[-1]), found.y[:, -1]
            if self.friction == "coulomb" and t < end:
                state[1] = 0.0
        return state

    def _side(self, t: float, state: Array) -> float:
        """The side of Coulomb's friction from here on."""
        if self.friction != "coulomb":
            return 0.0
        if state[1]:
            return math.copysign(1.0, state[1])
        net = self.load(t, *state)
        return 0.0 if abs(net) < COULOMB_TORQUE * (1 - 1e-12) else math.copysign(1.0, net)

    def _ends(self, side: float) -> list[Event]:
        """What ends a phase: a slip comes to rest, or the load tears the joint off."""
        if self.friction != "coulomb":
            return []

        def rest(_t: float, state: Array, _u: float, _side: float) -> float:
            return float(state[1]) * side

        def torn(t: float, state: Array, _u: float, _side: float) -> float:
            return COULOMB_TORQUE - abs(self.load(t, *state))

        event = rest if side else torn
        for key, value in {"terminal": True, "direction": -1}.items():  # as SciPy reads them
            setattr(event, key, value)
        return [event]
