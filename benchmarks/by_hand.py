"""The yardstick in C, ``c/sampled_by_hand.c``: compiled for this processor with all that GCC allows."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import cffi
import numpy as np

from benchmarks.cvodes import Array

SOURCE = Path(__file__).resolve().parent / "c" / "sampled_by_hand.c"
FLAGS = ("-O3", "-march=native", "-Wno-psabi", "-fPIC", "-shared")
DECLARATION = (
    "void by_hand_many(double *x, const double *p, const double *h, double T, long long n, long long runs,"
    " double *m);"
)


class ByHand:
    """One build of the source, scalar (width 1) or in vectors."""

    def __init__(self, folder: Path, width: int) -> None:
        """Compile it into a folder."""
        library = folder / f"by_hand_{width}.so"
        vectors = [f"-DHAND_WIDTH={width}"] if width > 1 else []
        subprocess.run(
            ["gcc", *FLAGS, *vectors, str(SOURCE), "-o", str(library), "-lmvec", "-lm"], check=True
        )
        self.ffi: Any = cffi.FFI()
        self.ffi.cdef(DECLARATION)
        self.lib: Any = self.ffi.dlopen(str(library))

    def simulate(self, x0: Array, p: Array, hold: Array, sample_time: float, samples: int) -> Array:
        """Return X after that many samples, shape (runs, nX); the compensator is on."""
        x, own, m = x0.copy(), np.ascontiguousarray(p[:, :-1]), np.empty((len(x0), 4))
        held = [self.ffi.from_buffer("double[]", array) for array in (x, own, hold, m)]
        self.lib.by_hand_many(held[0], held[1], held[2], sample_time, samples, len(x), held[3])
        return x
