"""A sweep in a few numbers: those of the whole dataset, in whatever parts it is read."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.sweep.metrics import status_meanings
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.region import held, held_share
from pmjoint_codegen.sweep.request import make_request

from .conftest import Case, sweep

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.loops.metrics import REPORTED
from pmjoint_codegen.sweep import blocks, dataset
from pmjoint_codegen.sweep.totals import totals


@pytest.mark.parametrize("size", [blocks.BLOCK, 500])
def test_totals_are_those_of_the_whole(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    store = sweep(case, tmp_path, threads=2)
    data = dataset.read(store.dataset)
    good = held(data).values
    words = status_meanings()
    ends = Counter(words[int(value)] for value in data["status"].values.ravel())
    monkeypatch.setattr(blocks, "BLOCK", size)
    found = totals(store.dataset)
    assert found.status == ends
    assert len(found.status) == 3
    assert found.held == good.sum()
    assert held_share(data) == good.mean()
    assert 0 < found.held < good.size
    for name in REPORTED:
        values = data[name].values[good]
        quantiles = found.quantiles[name]
        assert quantiles is not None
        expected = np.percentile(values[np.isfinite(values)], (5, 50, 95))
        assert list(quantiles.values()) == expected.tolist()


def test_no_run_that_holds_has_no_quantiles(case: Case, tmp_path: Path) -> None:
    plan = make_plan(("x1=200,300",), (), None, 0, "sobol")
    lost = replace(case, request=make_request(case.manifest, plan, horizon=30.0))
    found = totals(sweep(lost, tmp_path).dataset)
    assert found.held == 0
    assert set(found.quantiles.values()) == {None}
