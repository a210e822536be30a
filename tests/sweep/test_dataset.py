"""The dataset: what it says of itself, in every format, and that it is there before the chunks go."""

from __future__ import annotations

import errno
import json
import resource
import shutil
import tracemalloc
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.errors import MissingToolError, UsageError
from pmjoint_codegen.loops.batch import loops_hash
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.sweep.chunks import Result
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import Store

from .conftest import Case, files, sweep

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.sweep import blocks, dataset, formats
from pmjoint_codegen.sweep.totals import totals


def test_chunks_go_when_the_dataset_is_on_the_disk_and_stay_when_it_cannot_be(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reference: dict[str, bytes]
) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    execute(store, case.inputs, threads=2, scheduler=None, tell=lambda done: None)

    def full(folder: Path) -> None:
        assert files(folder) == reference
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(dataset, "settle", full)
        with pytest.raises(UsageError, match=r"sweep\.zarr: cannot be written \(no space left on device\)"):
            dataset.assemble(store, case.manifest)
    assert {path.name for path in tmp_path.iterdir()} == {"request.json", "chunks"}
    assert not store.missing()


def test_an_absent_extra_is_named_with_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingToolError, match=r"pip install 'pmjoint-codegen\[sweep\]'"):
        formats.require(())


def test_each_format_needs_its_own_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"xarray", "zarr", "h5netcdf", "h5py", "pandas"}
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name if name in there else None)
    formats.require(())
    for kind, absent in {"netcdf": "dask", "parquet": "pyarrow", "dask": "distributed"}.items():
        with pytest.raises(MissingToolError, match=f"^{absent} is needed"):
            formats.require((kind,))


def test_numbers_of_things_are_whole_and_trajectories_are_no_rows(case: Case, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    plan = make_plan(("x1=-2:2:5", "c1=-1,15"), (), None, 0, "sobol")
    request = make_request(case.manifest, plan, horizon=1.0, output_step=0.1)
    store = sweep(replace(case, request=request), tmp_path)
    data, streamed = dataset.read(store.dataset), dataset.read(store.dataset, streamed=True)
    whole = {name for name, item in data.data_vars.items() if item.dtype == np.int64}
    assert whole == {"status", "steps", "switches", "final_saturated", "held"}
    assert data["trajectory_e"].shape == (5, 2, 11)
    frame = import_module("pandas").read_parquet(formats.export(store.dataset, "parquet"))
    assert len(frame) == plan.runs
    assert list(frame.columns) == json.loads(data.attrs["variables"])
    assert streamed["trajectory_e"].chunks is not None
    assert streamed.identical(data)


def test_the_dataset_says_what_it_is(case: Case, tmp_path: Path) -> None:
    store = sweep(case, tmp_path, threads=2)
    data = dataset.read(store.dataset)
    assert dict(data["ise"].sizes) == case.request.plan.dimensions
    assert data["ise"].attrs["units"] == "rad^2 s"
    assert data["x1"].attrs["units"] == "rad"
    assert data["b0"].dims == ("draw",)
    assert data.attrs["model_hash"] == case.manifest.model_hash
    assert data.attrs["request_hash"] == case.request.hash
    assert (data.attrs["kernels"], data.attrs["loops"]) == (case.request.kernels, loops_hash())
    assert data.attrs["seed"] == 3
    columns = case.request.plan.columns(0, case.request.plan.runs)
    flat = data.stack(run=tuple(case.request.plan.dimensions))
    assert np.array_equal(flat["x1"].values, columns["x1"])
    assert np.array_equal(flat["b0"].values, columns["b0"])
    flags = dict(
        zip(data["status"].attrs["flag_values"], data["status"].attrs["flag_meanings"].split(), strict=True)
    )
    assert {flags[int(value)] for value in np.unique(data["status"].values)} == {
        "done",
        "diverged",
        "not_simulated",
    }


def test_the_parts_that_a_dataset_is_written_in_do_not_change_it(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part here is less than a chunk, then more than one run's trajectory, then a piece of one."""
    plan = make_plan(("x1=-2:2:5", "c1=-1,15", "x2=0:1:3"), (), None, 0, "sobol")
    request = make_request(case.manifest, plan, horizon=1.0, output_step=0.01)
    whole = dataset.read(sweep(replace(case, request=request), tmp_path / "whole").dataset)
    for size in (7, 250, 60):
        monkeypatch.setattr(blocks, "BLOCK", size)
        store = sweep(replace(case, request=request), tmp_path / str(size))
        assert dataset.read(store.dataset).identical(whole)


def test_memory_to_write_a_dataset_does_not_grow_with_it(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At its most are a part's rows and copies of a few columns, beside what Zarr itself needs."""
    monkeypatch.setattr(blocks, "BLOCK", 2**12)

    def peak(runs: int) -> int:
        plan = make_plan((f"x1=0:1:{runs}",), (), None, 0, "sobol")
        store = Store(tmp_path / str(runs), make_request(case.manifest, plan), case.manifest.nX)
        store.open()
        for start in store.starts():
            table = np.zeros((store.length(start), len(Column) + store.size))
            store.keep(start, Result(table, np.empty(0)))
        tracemalloc.start()
        try:
            dataset.assemble(store, case.manifest)
            totals(store.dataset)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    few, many = peak(2**13), peak(2**17)
    part = 8 * 2**12 * (len(Column) + case.manifest.nX)
    axis_and_metric = 8 * 2**17 * 4  # the axis as asked for, as numbers; the one metric of those that hold
    assert few > part
    assert many < few + axis_and_metric < 8 * 2**17 * (len(Column) + case.manifest.nX)


@pytest.mark.parametrize("kind", ["netcdf", "parquet"])
def test_a_format_is_the_same_in_however_many_parts(
    case: Case, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip({"netcdf": "h5py", "parquet": "pyarrow"}[kind])
    store = sweep(case, tmp_path, threads=2)
    path = formats.export(store.dataset, kind)
    whole = _opened(path, 1)
    shutil.rmtree(store.dataset)
    monkeypatch.setattr(blocks, "BLOCK", 700)
    formats.export(sweep(case, tmp_path, threads=2).dataset, kind)
    again = _opened(path, len(list(blocks.blocks(tuple(case.request.plan.dimensions.values())))))
    assert again.equals(whole)
    assert again.attrs == whole.attrs


def _opened(path: Path, groups: int) -> Any:
    if path.suffix == ".nc":
        return import_module("xarray").load_dataset(path, engine="h5netcdf")
    assert import_module("pyarrow.parquet").ParquetFile(path).num_row_groups == groups
    return import_module("pandas").read_parquet(path)


def test_variables_stand_in_one_order_however_they_are_found(case: Case, tmp_path: Path) -> None:
    samples = [f"{name}~uniform(1,2)" for name in ("x2", "c1", "x1", "b0", "k1", "ck2", "e1")]
    plan = make_plan(("compensator=0,1",), tuple(samples), 2, 0, "sobol")
    store = sweep(replace(case, request=make_request(case.manifest, plan, horizon=0.1)), tmp_path)
    names = [str(name) for name in dataset.read(store.dataset).variables]
    results = json.loads(dataset.read(store.dataset).attrs["variables"])
    assert names == [*results, *sorted({*names} - {*results})]
    assert len(names) == len(results) + len(samples) + 2


@pytest.mark.parametrize("kind", ["netcdf", "parquet"])
def test_other_formats_hold_the_same_numbers(case: Case, tmp_path: Path, kind: str) -> None:
    pytest.importorskip({"netcdf": "h5py", "parquet": "pyarrow"}[kind])
    store = sweep(case, tmp_path, threads=2)
    data = dataset.read(store.dataset)
    path = formats.export(store.dataset, kind)
    if kind == "netcdf":
        import xarray as xr

        with xr.open_dataset(path, engine="h5netcdf") as again:
            assert np.array_equal(again["ise"].values, data["ise"].values, equal_nan=True)
            assert again["ise"].attrs["units"] == "rad^2 s"
    else:
        frame = import_module("pandas").read_parquet(path)
        assert len(frame) == case.request.plan.runs
        assert np.array_equal(frame["ise"].values, data["ise"].values.ravel(), equal_nan=True)
        assert frame.attrs["units"]["ise"] == "rad^2 s"
        assert frame.attrs["units"]["x1"] == "rad"
        assert import_module("pyarrow.parquet").read_table(path).to_pandas().attrs == frame.attrs


@pytest.mark.parametrize("kind", ["netcdf", "parquet"])
def test_an_export_that_finds_no_room_is_said_so_and_leaves_nothing(
    case: Case, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip({"netcdf": "h5py", "parquet": "pyarrow"}[kind])
    store = sweep(case, tmp_path, threads=2)
    size = dataset.read(store.dataset).nbytes
    there = set(tmp_path.iterdir())
    if kind == "netcdf":  # HDF5 itself crashes where a disk is full
        monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=size - 1))
        words = "sweep.nc: cannot be written .no space left"
    else:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        words = r"sweep.parquet: cannot be written \(.*file too large"
    try:
        with pytest.raises(UsageError, match=words):
            formats.export(store.dataset, kind)
    finally:
        if kind == "parquet":
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert set(tmp_path.iterdir()) == there


def test_trajectories_are_kept_when_asked_for(case: Case, tmp_path: Path) -> None:
    plan = make_plan(("x1=-2:2:5", "c1=-1,15"), (), None, 0, "sobol")
    request = make_request(case.manifest, plan, horizon=1.0, output_step=0.25)
    store = sweep(replace(case, request=request), tmp_path)
    data = dataset.read(store.dataset)
    assert data["trajectory_v"].attrs["units"] == "V"
    assert dict(data["trajectory_x1"].sizes) == {"x1": 5, "c1": 2, "t": 5}
    assert np.all(np.isnan(data["trajectory_x1"].sel(c1=-1.0).values))
    good = data.sel(c1=15.0)
    assert np.array_equal(good["trajectory_x1"].isel(t=0).values, data["x1"].values)
    assert np.array_equal(good["trajectory_x2"].isel(t=-1).values, good["final_x2"].values)
    miss = (
        good["trajectory_e"].isel(t=-1).values - good["final_e"].values
    )  # the polynomial's end, and a new one's start
    assert np.max(np.abs(miss)) <= 64 * request.tolerance  # the defect that a step may have
