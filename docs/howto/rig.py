"""A simulated rig behind a socket: a joint that moves in real time, with a noisy sensor and a slow valve.

    python docs/howto/rig.py          # prints the port, serves one controller, and ends with it

It stands for hardware, so it shares nothing with the controller: it imports nothing of the package and has
its own numbers and integration (Runge and Kutta's method of order 4 in steps of at most 0.5 ms).

Messages: ``r`` asks for a reading. The answer is two doubles, the angle in rad and the mean of what the valve
delivered since the reading before, in V. ``w`` and a double is a command in V, which acts `DELAY` later.
"""

from __future__ import annotations

import math
import random
import socket
import struct
import time
from collections import deque

STIFFNESS, GAIN = 0.25, 1.9  # 1/s^2, rad/(s^2 V); the controller believes in 0.2 and 2
LIMIT, DELAY, NOISE = 10.0, 0.002, 2e-4  # V, s, rad
LONGEST = 5e-4  # s, of a step
READING, COMMAND = struct.Struct("<dd"), struct.Struct("<d")

State = tuple[float, float]  # angle, rad; its rate, rad/s


def rates(t: float, x: State, u: float) -> State:
    """The joint's rates under an input u."""
    angle, rate = x
    return rate, STIFFNESS * angle + GAIN * u + 0.1 * math.sin(rate) * math.cos(t)


def step(t: float, x: State, u: float, h: float) -> State:
    """The joint one step of h seconds later."""

    def at(k: State, part: float) -> State:
        return x[0] + part * k[0], x[1] + part * k[1]

    k1 = rates(t, x, u)
    k2 = rates(t + h / 2, at(k1, h / 2), u)
    k3 = rates(t + h / 2, at(k2, h / 2), u)
    k4 = rates(t + h, at(k3, h), u)
    return (
        x[0] + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0]),
        x[1] + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1]),
    )


class Rig:
    """The joint, its valve and its sensor; `t` is the time that it has reached, s."""

    def __init__(self, angle: float) -> None:
        self.t, self.x, self.u = 0.0, (angle, 0.0), 0.0
        self.waiting: deque[tuple[float, float]] = deque()  # when a command acts, and which
        self.noise, self.integral, self.read_at = random.Random(1), 0.0, 0.0

    def command(self, u: float, now: float) -> None:
        """Take a command, which acts later."""
        self.waiting.append((now + DELAY, min(max(u, -LIMIT), LIMIT)))

    def read(self, now: float) -> tuple[float, float]:
        """The noisy angle now, and the mean of u since the last reading."""
        self.move(now)
        since, self.read_at = now - self.read_at, now
        mean, self.integral = (self.integral / since if since > 0.0 else self.u), 0.0
        return self.x[0] + self.noise.gauss(0.0, NOISE), mean

    def move(self, now: float) -> None:
        """Integrate until now, each command from when it acts."""
        while self.t < now:
            if self.waiting and self.waiting[0][0] <= self.t:
                self.u = self.waiting.popleft()[1]
                continue
            end = min(now, self.t + LONGEST, self.waiting[0][0] if self.waiting else math.inf)
            self.x = step(self.t, self.x, self.u, end - self.t)
            self.integral += self.u * (end - self.t)
            self.t = end


def serve(connection: socket.socket, rig: Rig) -> None:
    """Answer one controller until it hangs up; time begins with its first message."""
    begun = None
    with connection, connection.makefile("rb") as messages:
        while kind := messages.read(1):
            now = time.perf_counter()
            begun = now if begun is None else begun
            if kind == b"r":
                connection.sendall(READING.pack(*rig.read(now - begun)))
            else:
                rig.command(COMMAND.unpack(messages.read(COMMAND.size))[0], now - begun)


def main() -> None:
    """Listen on a free port of this machine, and say which."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        serve(connection, Rig(angle=0.3))


if __name__ == "__main__":
    main()
