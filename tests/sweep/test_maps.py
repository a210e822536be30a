"""Figures of a sweep, and what they claim: which runs hold the joint, and where no controller can."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.sweep.drive import drive
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.reach import Border, border, held
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import MADE_OF_IT, Store

from .conftest import Case

xr = pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.sweep import dataset, maps  # noqa: E402 - after the check for their packages


def made(
    case: Case, folder: Path, grid: tuple[str, ...], sample: tuple[str, ...] = (), **settings: object
) -> Any:
    plan = make_plan(grid, sample, 40 if sample else None, 0, "sobol")
    request = make_request(case.manifest, plan, **settings)  # type: ignore[arg-type]
    store = Store(folder, request, case.manifest.nX)
    store.open()
    drive(store, case.kit, threads=2, scheduler=None, tell=lambda done: None)
    dataset.assemble(store, case.manifest)
    return dataset.read(store.dataset)


@pytest.mark.parametrize(
    ("grid", "sample", "stems"),
    [
        (
            ("x1=-90:90:7", "x2=-20:20:5", "compensator=0,1"),
            (),
            {"region", "map_ise", "map_max_abs_v", "map_settling_s", "map_saturated_s"},
        ),
        (
            ("c1=5:20:4", "c2=5:20:3", "d1=0.1,0.2,0.3"),
            (),
            {"map_ise", "map_max_abs_v", "map_settling_s", "map_saturated_s"},
        ),
        (("c1=5:20:4",), (), {"curves"}),
        (("compensator=0,1",), ("d1~normal(0.2,0.02)",), {"histograms"}),
        (("compensator=0,1",), (), set()),
    ],
)
def test_dimensions_call_for_their_figures(
    case: Case, tmp_path: Path, grid: tuple[str, ...], sample: tuple[str, ...], stems: set[str]
) -> None:
    data = made(case, tmp_path, grid, sample, horizon=3.0)
    first = maps.write_maps(data, case.manifest, tmp_path)
    assert {path.stem for path in first} == stems
    assert {path.name for path in first} <= set(MADE_OF_IT)
    pictures = [path.read_bytes() for path in first]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert [path.read_bytes() for path in maps.write_maps(data, case.manifest, tmp_path)] == pictures


def test_the_border_is_where_the_actuator_just_balances_the_unstable_mode(case: Case) -> None:
    values = dict(zip(case.manifest.parameter_names, case.request.p, strict=True))
    line = border(case.manifest, values)
    assert line is not None
    assert line == Border(math.sqrt(0.2), (2 * 10 - 0.1) / 0.2)
    # There, q = x1 + x2/slope obeys q' = slope q + b0 u/slope + d/slope, and u = -u_max leaves q' = 0.
    assert line.slope * line.offset - (2.0 * 10.0 - 0.1) / line.slope == pytest.approx(0.0, abs=1e-12)
    assert border(case.manifest, {**values, "d1": -0.2}) is None
    assert border(case.manifest, {name: value for name, value in values.items() if name != "b0"}) is None
    assert border(replace(case.manifest, nw=2), values) is None


@pytest.mark.parametrize(
    ("grid", "fixed", "limit"),
    [
        ((), {}, (2.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0": 3.0}, (3.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0_plant": 3.0}, (3.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0": 3.0, "b0_plant": 2.0}, (2.0 * 10.0 - 0.1) / 0.2),
        (("b0=2,3",), {}, None),
        (("b0_plant=2,3",), {}, None),
    ],
)
def test_the_border_is_that_of_the_true_plant(
    case: Case, tmp_path: Path, grid: tuple[str, ...], fixed: dict[str, float], limit: float | None
) -> None:
    data = made(case, tmp_path, ("x1=0,1", "x2=0,1", *grid), parameters=fixed, horizon=0.1)
    line = border(case.manifest, maps._fixed(data))
    assert (line and line.offset) == limit


def test_no_run_beyond_the_border_is_held_and_clipping_holds_all_but_its_edge(
    case: Case, tmp_path: Path
) -> None:
    data = made(case, tmp_path, ("x1=-110:110:111",), x0=(0.0, 0.0), compensator=False, horizon=30.0)
    x1 = data["x1"].values
    good = held(data).values
    assert not np.any(good[np.abs(x1) > 100.5])
    assert np.all(good[np.abs(x1) < 98.0])
    law = made(case, tmp_path / "law", ("x1=-110:110:111",), x0=(0.0, 0.0), horizon=30.0)
    lost = ~held(law).values
    assert np.all(lost[np.abs(x1) > 72.5])
    assert not np.any(lost[np.abs(x1) < 68.0])
