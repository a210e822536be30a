"""A run as a table and as a dataset: the numbers of ``trajectory.csv``, with units."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import MissingToolError


@pytest.fixture(scope="module", params=["paper", "data"])
def run(request: pytest.FixtureRequest) -> Run:
    data = {"reference": {"steps": [[0, 0.1]], "filter": 9}} if request.param == "data" else {}
    return ClosedLoop.load("paper").simulate(horizon=0.2, **data)  # type: ignore[arg-type]


def test_a_table_is_what_the_csv_file_is(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    run.to_csv(tmp_path / "trajectory.csv")
    table = run.to_dataframe()
    header = (tmp_path / "trajectory.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.split(",") == [table.index.name, *table.columns]
    read = np.loadtxt(tmp_path / "trajectory.csv", delimiter=",", skiprows=1)
    assert np.array_equal(table.reset_index().to_numpy(), read)
    assert table.attrs["units"].keys() == {"t", *table.columns}
    assert table.attrs["units"]["u"] == "V" and table.attrs["units"]["t"] == "s"


def test_a_dataset_has_the_same_numbers_with_their_units(run: Run) -> None:
    pytest.importorskip("xarray")
    dataset, table = run.to_xarray(), run.to_dataframe()
    assert list(dataset.data_vars) == list(table.columns)
    assert dataset["t"].values.tobytes() == run.t.tobytes()
    for name in table.columns:
        assert dataset[name].values.tobytes() == np.ascontiguousarray(run[name]).tobytes()
        assert dataset[name].attrs["units"] == table.attrs["units"][name]
        assert dataset[name].attrs["long_name"]
    assert dataset.attrs["status"] == "DONE"


@pytest.mark.parametrize(("package", "method"), [("pandas", "to_dataframe"), ("xarray", "to_xarray")])
def test_an_absent_package_is_named(
    run: Run, package: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingToolError, match=rf"^{package} is needed .*pmjoint-codegen\[sweep\]"):
        getattr(run, method)()
