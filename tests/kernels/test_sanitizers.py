"""The C loops under sanitizers: ``pmjoint check`` watches the generated kernels, this their callers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FLAGS = "-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer"
RUNS = """
import contextlib, sys
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError

loop = ClosedLoop.load(sys.argv[1], "compiled")
for controller in ("continuous", "sampled"):
    for asked in (
        {"horizon": 2.0},
        {"horizon": 1.0, "sample_time": 0.003, "output_step": 0.1},  # rows and samples that do not meet
        {"horizon": 0.3, "sample_time": 0.1},  # holds of several steps
        {"horizon": 1e-9, "sample_time": 1e-9},
        {"horizon": 0.1, "tolerance": 1e-14},
        {"horizon": 0.1, "x0": [1e9, 1e9]},
        {"horizon": 0.1, "x0": [1e200, 1e200]},
    ):
        with contextlib.suppress(SimulationError):  # the last two diverge and overflow
            loop.simulate(controller=controller, **asked)
print("done")
"""


def test_the_loops_touch_only_their_memory_and_leave_nothing_undefined(root: Path, tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    library = Path(
        subprocess.run(
            ["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
        ).stdout.strip()
    )
    if not library.is_absolute():
        pytest.skip("no sanitizer library")
    environment = {
        **os.environ,
        "CC": f"gcc {FLAGS}",
        "PMJOINT_CACHE": str(tmp_path),
        "PYTHONPATH": str(root),
        "LD_PRELOAD": str(library),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python's own
    }
    model = str(root / "models" / "paper.toml")
    done = subprocess.run(
        [sys.executable, "-c", RUNS, model], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr[:4000]
