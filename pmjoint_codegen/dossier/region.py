"""From where the loop recovers: a small grid over the plant's first two initial states, or its only one."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pmjoint_codegen.provision import provide
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.sweep.build_inputs import make_inputs
from pmjoint_codegen.sweep.dataset import assemble, read
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.maps import region_figure
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.region import border, held
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import Store

CELLS: Final = (32, 24)  # of the grid; even, as an error that starts at 0 has no settling time
BEYOND: Final = 1.2  # reach of the grid, relative to the border
AROUND: Final = 3.0  # otherwise, relative to the largest values of the default run


@dataclass(frozen=True)
class Map:
    """The region.

    Attributes:
        svg: the picture.
        runs: how many were simulated.
        held: how many of them keep the output bounded.
        command: draws the same.
        words: what the map shows.
        plane: whether it is over two states; else over one.
    """

    svg: bytes
    runs: int
    held: int
    command: str
    words: str
    plane: bool


def draw_region(file: Path, run: Run, environment: Mapping[str, str], notify: Callable[[str], None]) -> Map:
    """Simulate the grid and draw it.

    Args:
        file: the model's.
        run: the default run, whose extent chooses the grid where the theory does not.
        environment: for compiler and cache folder.
        notify: called with one line for the user.

    Raises:
        MissingToolError: no compiler.
        BuildError: the compiler failed.
        UsageError: the model cannot be swept.
    """
    from pmjoint_codegen.workspace import called

    provided = provide(file, environment=environment, notify=notify, lanes=True)
    manifest = provided.manifest
    names = manifest.start.names[:2]
    reach, known = _reach(run)
    grid = tuple(
        f"{name}={-size:.4g}:{size:.4g}:{cells}"
        for name, size, cells in zip(names, reach, CELLS, strict=False)
    )
    plan = make_plan(grid, (), None, 0, "latin-hypercube")
    request = make_request(manifest, plan)
    with tempfile.TemporaryDirectory(prefix="pmjoint-report-") as place:
        store = Store(Path(place) / "sweep", request, manifest.nX)
        store.open(restart=False)
        inputs = make_inputs(provided.folder)
        execute(store, inputs, threads=2, scheduler=None, tell=lambda done: None)
        assemble(store, manifest)
        dataset = read(store.dataset).load()
        kept = int(held(dataset).sum())
        svg = region_figure(dataset, manifest)
    options = " ".join(f"--grid {axis}" for axis in grid)
    words = (
        "dashed: beyond it, no input within the limit counters the worst disturbance"
        if known
        else "no border beyond which every controller fails is known in closed form for this plant"
    )
    return Map(svg, plan.runs, kept, f"pmjoint sweep {called(file)} {options}", words, len(grid) > 1)


def _reach(run: Run) -> tuple[tuple[float, float], bool]:
    """Largest initial values, and whether they come from the border of the theory."""
    manifest = run.manifest
    values = manifest.stated(run.settings.parameters)
    line = border(manifest, {**dict(zip(manifest.parameter_names, run.settings.p, strict=False)), **values})
    if line is not None and line.offset > 0 and len(manifest.start.names) > 1:
        return (BEYOND * line.offset, BEYOND * line.offset * line.slope), True
    sizes = []
    for k, name in enumerate(manifest.start.names[:2]):
        column = run["y"] if k == 0 else _rates(run, name)
        peak = float(np.max(np.abs(column))) if column.size else 0.0
        sizes.append(AROUND * max(peak, abs(float(run.settings.x0[k]))) or 1.0)
    first = sizes[0]
    return (first, sizes[1] if len(sizes) > 1 else first), False


def _rates(run: Run, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The second initial state along the run: a rate, or a state of the plant's own form."""
    if re.search("dot|rate", name):
        return np.asarray(np.gradient(run["y"], run.t), dtype=np.float64)
    column = name if name in run.columns else "x2"
    return np.asarray(run[column], dtype=np.float64)
