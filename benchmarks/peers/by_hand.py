"""The sampled closed loop in C, written by hand for this one model: scalar, and in vectors."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.paper import GAINS, PLANT, Array
from benchmarks.peers.solver import load

SOURCE: Final = Path(__file__).resolve().parent.parent / "c" / "sampled_by_hand.c"
# As fast as the compiler may: this machine's instructions, contraction; no -ffast-math, which would make
# NaN and the order of sums meaningless.
FLAGS: Final = ("-O3", "-march=native", "-std=gnu11", "-ffp-contract=fast", "-fno-math-errno",
                "-fno-trapping-math", "-Wno-psabi", "-fPIC", "-shared")  # fmt: skip
METRICS: Final = 4  # ISE, max |e|, max |v|, time at a limit


@dataclass(frozen=True)
class ByHand:
    """A built library.

    Attributes:
        width: trajectories side by side.
        many: the C function.
    """

    width: int
    many: Any

    def run(self, x0: Array, p: Array, hold: Array, sample_time: float, samples: int) -> tuple[Array, Array]:
        """Simulate rows of x0 and p, whose number the width divides; final states and metrics."""
        x, p = x0.copy(), np.ascontiguousarray(p)
        metrics = np.empty((len(x), METRICS))
        h = np.ascontiguousarray(hold)
        self.many(_pointer(x), _pointer(p), _pointer(h), sample_time, samples, len(x), _pointer(metrics))
        return x, metrics


def build(folder: Path, width: int = 1) -> ByHand:
    """Compile for `width` lanes, 1 being plain scalar code; raises OSError where that cannot be."""
    target = folder / f"by_hand_{width}.so"
    define = [f"-DHAND_WIDTH={width}"] if width > 1 else []
    libraries = ["-lmvec", "-lm"] if width > 1 else ["-lm"]
    command = [
        *os.environ.get("CC", "cc").split(),
        *FLAGS,
        *define,
        str(SOURCE),
        "-o",
        str(target),
        *libraries,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"the hand-written C does not compile here: {done.stderr.splitlines()[-1:]}")
    function = ctypes.CDLL(str(target)).by_hand_many
    pointer, number, count = ctypes.POINTER(ctypes.c_double), ctypes.c_double, ctypes.c_longlong
    function.argtypes = [pointer, pointer, pointer, number, count, count, pointer]
    function.restype = None
    return ByHand(width, function)


def parameters(runs: int) -> Array:
    """Return d1 b0 u_max c1 c2 e1 e2 ck1 ck2 k1 k2 of every run, shape (runs, 11)."""
    return np.tile(np.array([*PLANT, *GAINS]), (runs, 1))


def numba_march() -> Callable[..., Array]:
    """Return the same arithmetic in Python, compiled by numba: (x, hold, T, samples) -> final state."""
    numba = load("numba")

    from benchmarks.peers.sampled_python import march

    compiled: Callable[..., Array] = numba.njit(march)
    return compiled


def _pointer(array: Array) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
