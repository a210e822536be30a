"""How high should the Taylor coefficients go? The paper's run with kernels of several orders, side by side.

    python -m benchmarks.orders [MODEL] [TOLERANCE ...]

A higher order takes longer steps at more work each; the table shows where the two balance. Times are medians
of interleaved runs, in process, with the default output grid.
"""

from __future__ import annotations

import os
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.clock import interleaved
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.kernels import compiled
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.workspace import find_model

ORDERS = (10, 12, 14, 16, 18, 20, 24)


def loop_of_order(model: str, order: int, folder: Path) -> ClosedLoop:
    """Return a model's closed loop with coefficients up to `order`, generated and built in `folder`."""
    path = find_model(model)
    document = read_document(path)
    artifacts = generate(document, model_of(document, str(path)), order)
    target = folder / str(order)
    target.mkdir(parents=True)
    for name, text in artifacts.files.items():
        (target / name).write_text(text, encoding="utf-8")
    compiler = find_compiler(os.environ, print)
    if compiler is None:
        raise SystemExit("benchmarks.orders: no C compiler was found")
    return ClosedLoop(compiled.load(target, artifacts.manifest, compiler, folder, usable_levels(os.environ)))


def main(arguments: list[str]) -> None:
    """Print one row an order: operations, steps and time for each tolerance."""
    model = arguments[0] if arguments else "paper"
    tolerances = [float(text) for text in arguments[1:]] or [1e-10]
    with tempfile.TemporaryDirectory() as name:
        loops = {order: loop_of_order(model, order, Path(name)) for order in ORDERS}
        for tolerance in tolerances:
            runs = {str(order): partial(loop.simulate, tolerance=tolerance) for order, loop in loops.items()}
            times = interleaved(runs, 25)
            print(f"{model}, tolerance {tolerance:g}\norder  operations  steps  time (us)")
            for order, loop in loops.items():
                operations = loop.manifest.function("taylor").operations
                steps = loop.simulate(tolerance=tolerance).steps
                print(f"{order:5}  {operations:10}  {steps:5}  {times[str(order)] * 1e6:9.0f}")


if __name__ == "__main__":
    main(sys.argv[1:])
