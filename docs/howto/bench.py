"""A controller that runs a rig in real time, and what it measured of its clock and of the tracking.

    python docs/howto/bench.py --seconds 5

The rig is another process, ``rig.py``, which this script starts. Replace `Connection` by your hardware.
"""

from __future__ import annotations

import argparse
import gc
import math
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.controller import Controller

READING, COMMAND = struct.Struct("<dd"), struct.Struct("<d")  # see rig.py
# The paper's compensator takes seconds to forget; its filters are slow for a rig with other numbers.
GAINS = {"c1": 8.0, "c2": 8.0, "ck1": 10.0, "ck2": 10.0, "k1": 40.0, "k2": 400.0}
SPIN = 3e-4  # s before a sample: sleeping ends late, so the rest is waited for


class Connection:
    """The rig, as a controller sees it."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.answers = self.socket.makefile("rb")

    def read(self) -> tuple[float, float]:
        """The angle in rad, and the mean of what the valve delivered since the last reading, in V."""
        self.socket.sendall(b"r")
        y, applied = READING.unpack(self.answers.read(READING.size))
        return y, applied

    def write(self, u: float) -> None:
        """Tell the valve, in V."""
        self.socket.sendall(b"w" + COMMAND.pack(u))

    def close(self) -> None:
        """Hang up."""
        self.answers.close()
        self.socket.close()


def wait_until(instant: float) -> float:
    """Sleep, then spin, until an instant; how late it has become, s."""
    left = instant - time.perf_counter()
    if left > SPIN:
        time.sleep(left - SPIN)
    while (late := time.perf_counter() - instant) < 0.0:
        pass
    return late


def control(rig: Connection, controller: Controller, samples: int) -> list[tuple[float, float, float]]:
    """Take samples in real time: of each how late it was, s, how long the step took, s, and y - y_r, rad.

    A late sample does not move those after it: sample k belongs to k T.
    """
    T, log = controller.sample_time, []
    begun = time.perf_counter() + 0.01
    for k in range(samples):
        late = wait_until(begun + k * T)
        y, applied = rig.read()
        y_r = math.sin(k * T), math.cos(k * T), -math.sin(k * T)
        before = time.perf_counter()
        u = controller.step(y, y_r, u_applied=applied)
        took = time.perf_counter() - before
        rig.write(u)
        log.append((late, took, y - y_r[0]))
    return log


def quantiles(values: list[float], unit: float) -> str:
    """Median, 99 % and largest of some values."""
    ordered = sorted(values)
    chosen = (ordered[len(ordered) // 2], ordered[len(ordered) * 99 // 100], ordered[-1])
    return ", ".join(f"{value / unit:.1f}" for value in chosen)


def report(log: list[tuple[float, float, float]], T: float) -> str:
    """The lines that this script prints."""
    late, took, error = map(list, zip(*log, strict=True))
    settled = [abs(e) for e in error[len(error) // 2 :]]
    rms = (sum(e * e for e in settled) / len(settled)) ** 0.5
    return "\n".join(
        [
            f"samples        {len(log)} of {1e3 * T:g} ms",
            f"late by        {quantiles(late, 1e-6)} us (median, 99 %, largest)",
            f"step took      {quantiles(took, 1e-6)} us (median, 99 %, largest)",
            f"missed         {sum(value > T for value in late)} samples, late by more than {1e3 * T:g} ms",
            f"|y - y_r|      {abs(error[0]):.4f} rad first, {settled[-1]:.4f} last",
            f"second half    {rms:.4f} rad rms, {max(settled):.4f} largest",
        ]
    )


def main() -> None:
    """Start the rig, control it, print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--sample-time", type=float, default=0.005)
    asked = parser.parse_args()
    controller = ClosedLoop.load("paper").controller(
        sample_time=asked.sample_time, parameters=GAINS, start="matched"
    )
    program = [sys.executable, str(Path(__file__).with_name("rig.py"))]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        rig = Connection(int(process.stdout.readline()))
        gc.disable()  # its pauses are longer than a step
        try:
            log = control(rig, controller, round(asked.seconds / asked.sample_time))
        finally:
            gc.enable()
            rig.close()
    print(report(log, asked.sample_time))


if __name__ == "__main__":
    main()
