"""Seven runs with features narrower than a step, against rows made with small steps and given break points.

The rows are of DOP853 at rtol 1e-12, with steps of at most 2 ms and kinks given as break points; filters and
compensator of the sampled runs by the matrix exponential. Each case is run as one run, compiled and
interpreted, and as a sweep of one.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.provision import provide
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

Array = npt.NDArray[np.float64]

FILE = Path(__file__).parent.parent / "reference" / "features.json"


@dataclass(frozen=True)
class Feature:
    """One run and what it must give.

    Attributes:
        name: of the case.
        model: the shipped model it changes.
        args: options of ``pmjoint simulate``, name and value in turn.
        columns: names of the columns, t first.
        rows: the reference, shape (instants, columns), instants evenly spaced.
        tol: what the run may be off by, relative to 1 + |value|.
    """

    name: str
    model: str
    args: tuple[str, ...]
    columns: tuple[str, ...]
    rows: Array
    tol: float

    @cached_property
    def options(self) -> dict[str, list[str]]:
        """Values by option."""
        found: dict[str, list[str]] = {}
        for option, value in zip(self.args[::2], self.args[1::2], strict=True):
            found.setdefault(option, []).append(value)
        return found

    @property
    def changes(self) -> dict[str, Any]:
        """What makes another model of the shipped one."""
        (reference,) = self.options["--reference"]
        return {"reference": reference, "disturbance": self.options.get("--disturbance")}

    @property
    def asked(self) -> dict[str, Any]:
        """Settings of the run, with the reference's instants as output; anything else is default."""
        last = float(self.rows[-1, 0])
        found: dict[str, Any] = {"horizon": last, "output_step": last / (len(self.rows) - 1)}
        if "--x0" in self.options:
            found["x0"] = [float(entry) for entry in self.options["--x0"][0].split(",")]
        if "--controller" in self.options:
            found["controller"] = self.options["--controller"][0]
            found["sample_time"] = float(self.options["--sample-time"][0])
        return found

    def verify(self, found: Array) -> None:
        """Compare columns, shape (instants, columns), with the reference."""
        off = np.abs(found - self.rows) / (1.0 + np.abs(self.rows))
        row, column = np.unravel_index(np.argmax(np.where(np.isnan(off), np.inf, off)), off.shape)
        said = f"{self.columns[column]} at t = {self.rows[row, 0]:g} s is {found[row, column]!r}"
        assert off[row, column] <= self.tol, f"{said}; right: {self.rows[row, column]!r}"


FEATURES = tuple(
    Feature(
        case["name"],
        case["model"],
        tuple(case["args"]),
        tuple(case["columns"]),
        np.array(case["rows"]),
        case["tol"],
    )
    for case in json.loads(FILE.read_text(encoding="utf-8"))
)


@pytest.fixture(params=FEATURES, ids=lambda feature: feature.name)
def feature(request: pytest.FixtureRequest) -> Feature:
    case: Feature = request.param
    return case


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
def test_one_run_sees_what_is_narrow(feature: Feature, evaluator: str) -> None:
    if evaluator == "compiled" and find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    loop = ClosedLoop.load(feature.model, evaluator, notify=lambda line: None, **feature.changes)
    run = loop.simulate(**feature.asked)
    feature.verify(np.column_stack([run.t if name == "t" else run[name] for name in feature.columns]))


def test_a_sweep_of_one_sees_what_is_narrow(feature: Feature) -> None:
    """At the tolerance of one run: a sweep's own default is not meant for 2e-8."""
    if find_compiler(os.environ) is None:
        pytest.skip("the batch loops are compiled")
    provided = provide(
        feature.model, environment=os.environ, notify=lambda line: None, lanes=True, **feature.changes
    )
    manifest = provided.manifest
    asked = feature.asked
    x0 = asked.get("x0", manifest.simulation.x0)
    plan = make_plan((f"x1={x0[0]!r}",), (), None, 0, "latin-hypercube")
    request = make_request(manifest, plan, tolerance=DEFAULT_TOLERANCE, **asked)
    library = library_of(make_inputs(provided.folder), os.environ)
    (rows,) = simulate_chunk(library, request, plan.columns(0, 1)).trajectories
    names = [*(state.name for state in manifest.states), "v"]
    values = {"t": feature.rows[:, 0]} | dict(zip(names, rows.T, strict=False))
    feature.verify(np.column_stack([values[name] for name in feature.columns]))


def test_a_wrong_row_is_noticed(feature: Feature) -> None:
    """What the reference is off by at most is 2e-8: a change of 3e-8 anywhere fails, and so does a NaN."""
    feature.verify(feature.rows.copy())
    for change in (3e-8, np.nan):
        wrong = feature.rows.copy()
        wrong[-1, -1] += change * (1.0 + abs(wrong[-1, -1]))
        with pytest.raises(AssertionError, match="right:"):
            feature.verify(wrong)
