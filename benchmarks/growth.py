"""What a model's order costs: derivation, emission and compile times, size of the C, and one run.

    python -m benchmarks.growth [N ...]

First the third-order model of tests/reference, whose phi and sigma are rational, logarithmic and hyperbolic.
Then, for each N, 4 by default, two members of the class with n = rho = N: one linear, one with nonlinear phi
and sigma. Derivation, emission and compilation are those of a single run with an empty cache, timed once. The
C includes ``loops.c``, but not the C of sweeps.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from math import comb
from pathlib import Path
from typing import Any

from benchmarks.reference import ROOT
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.kernels import compiled
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive

HEAD = (
    "model            derive (s)  emit (s)  compile (s)  C (kB)  lanes.c (kB)  law  order  steps  run (ms)  "
    "max |e| after 5 s"
)
THIRD = ROOT / "tests" / "reference" / "third-nonlinear.toml"
RUNS = 20
NONLINEAR = ("-y**3/5", "sin(y)", "y**2/10", "cos(y)/5")


def member(n: int, *, nonlinear: bool) -> dict[str, Any]:
    """Return a model file's document with n = rho; e shrinks with the square of what it multiplies."""
    phi = [NONLINEAR[i % 4] if nonlinear else "0" for i in range(n)]
    return {
        "schema": 1,
        "name": f"{'nonlinear' if nonlinear else 'linear'}-{n}",
        "parameters": {"d1": {"value": -1.0}, "b0": {"value": 2.0}, "u_max": {"value": 40.0}},
        "plant": {
            "order": n,
            "phi": phi,
            "Phi": [*([["0"]] * (n - 1)), ["y"]],
            "theta": ["d1"],
            "b": ["b0"],
            "sigma": "1 + y**2/10" if nonlinear else "1",
            "disturbance": [*(["0"] * (n - 1)), "0.1*cos(t)"],
        },
        "actuator": {"limit": "u_max"},
        "design": {
            "c": [2.0] * n,
            "e": [0.1 * 100.0**-i for i in range(n)],
            "ck": [2.0] * n,
            "k": [float(comb(n, i) * 3**i) for i in range(1, n + 1)],  # all poles at -3
        },
        "simulation": {"reference": "0.3*sin(t)", "x0": [0.1] + [0.0] * (n - 1), "horizon": 20.0},
    }


def row(document: dict[str, Any], folder: Path) -> str:
    """Return one model's line of the table."""
    compiler = find_compiler(os.environ, print)
    if compiler is None:
        raise SystemExit("benchmarks.growth: no C compiler was found")
    model = model_of(document, document["name"])
    marks = [time.perf_counter()]
    derive(model)
    marks.append(time.perf_counter())
    artifacts = generate(document, model, lanes=False)  # derives once more
    marks.append(time.perf_counter())
    source = folder / document["name"]
    source.mkdir()
    for name, text in artifacts.files.items():
        (source / name).write_text(text, encoding="utf-8")
    marks.append(time.perf_counter())
    loop = ClosedLoop(compiled.load(source, artifacts.manifest, compiler, folder, usable_levels(os.environ)))
    marks.append(time.perf_counter())
    run = min((loop.simulate() for _ in range(RUNS)), key=lambda run: run.wall_s)
    derivation = marks[1] - marks[0]
    size = sum(len(artifacts.files[name]) for name in ("kernels.c", "loops.c"))
    lanes = len(generate(document, model).files["lanes.c"])
    late = float(abs(run["e"][run.t >= 5.0]).max())
    return (
        f"{document['name']:15}  {derivation:10.1f}  {marks[2] - marks[1] - derivation:8.1f}  "
        f"{marks[4] - marks[3]:11.1f}  {size / 1e3:6.0f}  {lanes / 1e3:12.0f}  "
        f"{artifacts.manifest.function('law').operations:3}  {artifacts.manifest.order:5}  {run.steps:5}  "
        f"{run.wall_s * 1e3:8.2f}  {late:17.2g}"
    )


def main(arguments: list[str]) -> None:
    """Print the table."""
    print(HEAD)
    with tempfile.TemporaryDirectory() as name:
        print(row(read_document(THIRD), Path(name)), flush=True)
        for n in [int(text) for text in arguments] or [4]:
            for nonlinear in (False, True):
                print(row(member(n, nonlinear=nonlinear), Path(name)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
