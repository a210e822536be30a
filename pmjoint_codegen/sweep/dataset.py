"""A finished sweep as one labelled dataset: dimensions of the grid, units, seed, hashes and versions."""

from __future__ import annotations

import errno
import json
import math
import os
import platform
import shutil
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen import __version__
from pmjoint_codegen.errors import MissingToolError, installing
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import explained, settle
from pmjoint_codegen.sweep.drive import NEEDED
from pmjoint_codegen.sweep.metrics import Column, Quantity, quantities, status_meanings
from pmjoint_codegen.sweep.plan import DRAW
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.store import Store

if TYPE_CHECKING:
    import xarray as xr

FORMATS: Final = ("zarr", "netcdf", "parquet")
MEMORY: Final = 2**26  # bytes of the variables that are written in one pass over the chunks
PART: Final = 2**20  # numbers in one file of the dataset
_INTEGERS: Final = (Column.STATUS, Column.STEPS, Column.SWITCHES, Column.FINAL_SATURATED)


def require(formats: Iterable[str]) -> None:
    """Make sure that the packages for these formats (or ``dask``) are there, before long work.

    Raises:
        MissingToolError: one is absent; the message has the line that installs it.
    """
    needed = {
        "zarr": ("xarray", "zarr"),
        "netcdf": ("h5netcdf", "h5py"),
        "parquet": ("pandas", "pyarrow"),
        "dask": ("distributed",),
    }
    from importlib.util import find_spec

    for name in dict.fromkeys(package for kind in ("zarr", *formats) for package in needed[kind]):
        if find_spec(name) is None:
            raise MissingToolError(f"{name} is needed for sweeps", remedy=f"install it: {installing(NEEDED)}")


def import_ahead() -> None:
    """Import what writing needs in a thread of its own, while the C loops compute and leave Python alone.

    Nothing depends on it: an import that fails there fails again, and is reported, where it is needed.
    """

    def work() -> None:
        with suppress(Exception):
            import_module("zarr")

    Thread(target=work, name="import-ahead", daemon=True).start()


def assemble(store: Store, manifest: Manifest) -> None:
    """Write ``sweep.zarr`` from the chunks, whole or not at all; then remove the chunks.

    Zarr alone writes it: xarray, which reads it, takes longer to import than many sweeps to compute. A few
    variables are in memory at a time.

    Raises:
        UsageError: the folder cannot be written; the chunks still stand.
    """
    staged = store.folder / f".{store.dataset.name}.new"
    shutil.rmtree(staged, ignore_errors=True)
    with explained(store.dataset):
        try:
            _fill(staged, store, manifest)
            settle(staged)  # the chunks, which hold all that was computed, go next
            staged.rename(store.dataset)
        finally:
            shutil.rmtree(staged, ignore_errors=True)
    store.clear_chunks()


def _fill(folder: Path, store: Store, manifest: Manifest) -> None:
    """Write attributes and variables."""
    import zarr

    group = zarr.create_group(folder, zarr_format=3, attributes=_attributes(store.request, manifest))
    for name, variable in (*_coordinates(store.request, manifest), *_variables(store, manifest)):
        array = group.create_array(
            name,
            shape=variable.values.shape,
            dtype=variable.values.dtype,
            chunks=_chunks(variable.values.shape),
            dimension_names=variable.dimensions,
            fill_value=np.nan if variable.values.dtype == np.float64 else 0,
            attributes=variable.attributes,
        )
        array[...] = variable.values


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Cut along the first dimensions alone, into parts of at most `PART` numbers: each part costs time."""
    sizes = list(shape)
    for i in range(len(sizes)):
        sizes[i] = max(1, min(sizes[i], PART // math.prod(sizes[i + 1 :])))
    return tuple(sizes)


def column(path: Path, name: str) -> Array:
    """One variable of a dataset, a value a run, in the order of the runs."""
    import zarr

    return np.asarray(zarr.open_array(path / name, mode="r")[...]).reshape(-1)


def read(path: Path) -> xr.Dataset:
    """Open a dataset."""
    import xarray as xr

    dataset = xr.open_zarr(path, consolidated=False, chunks=None)
    order = json.loads(dataset.attrs["variables"])
    more = sorted(str(name) for name in dataset.data_vars if str(name) not in order)
    ordered: xr.Dataset = dataset[[*order, *more]]
    return ordered


def export(dataset: xr.Dataset, folder: Path, kind: str) -> Path:
    """Write the dataset in another format beside it; gives the file.

    Args:
        dataset: of the sweep.
        folder: of the sweep.
        kind: ``netcdf`` or ``parquet``; Parquet has a row a run and holds no trajectories.

    Raises:
        UsageError: the file cannot be written.
    """
    path = folder / {"netcdf": "sweep.nc", "parquet": "sweep.parquet"}[kind]
    staged = path.with_name(f".{path.name}.new")
    with explained(path):
        try:
            if kind == "netcdf":
                _check_room(folder, dataset.nbytes)
                dataset.to_netcdf(staged, engine="h5netcdf")
            else:
                _frame(dataset).to_parquet(staged)
            staged.replace(path)
        finally:
            staged.unlink(missing_ok=True)
    return path


def _check_room(folder: Path, size: int) -> None:
    """Refuse beforehand what a disk cannot hold: HDF5 crashes where it cannot write."""
    if shutil.disk_usage(folder).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _frame(dataset: xr.Dataset) -> Any:  # pandas is untyped here
    """A row a run, with the attributes of the dataset, and the unit of every column and index among them."""
    runs = dataset.drop_dims("t", errors="ignore")
    frame = runs.to_dataframe()
    units = {str(name): item.attrs["units"] for name, item in runs.variables.items() if "units" in item.attrs}
    frame.attrs = {**dataset.attrs, "units": units}
    return frame


@dataclass(frozen=True)
class _Variable:
    """An array of the dataset.

    Attributes:
        dimensions: names.
        values: an entry for each place.
        attributes: units and words.
    """

    dimensions: tuple[str, ...]
    values: npt.NDArray[Any]
    attributes: dict[str, Any]


def _coordinates(request: Request, manifest: Manifest) -> Iterator[tuple[str, _Variable]]:
    """The axes, the number of the draw, and what was drawn."""
    plan = request.plan
    units = _units(manifest)
    for axis in plan.axes:
        yield axis.name, _Variable((axis.name,), np.array(axis.values), units[axis.name])
    if plan.samples:
        yield DRAW, _Variable((DRAW,), np.arange(plan.draws), {})
    for name, values in plan.drawn.items():
        yield name, _Variable((DRAW,), values, units[name])


def _attributes(request: Request, manifest: Manifest) -> dict[str, Any]:
    """All that the result depends on; ``coordinates`` names, as CF has it, those that are no dimension."""
    versions = {"pmjoint_codegen": __version__, "python": platform.python_version(), "numpy": np.__version__}
    drawn = {"coordinates": " ".join(request.plan.drawn)} if request.plan.samples else {}
    return drawn | {
        "title": f"Sweep of {manifest.title}",
        "source": manifest.source,
        "model": manifest.name,
        "model_hash": manifest.model_hash,
        "kernels": request.kernels,
        "loops": request.loops,
        "sampler": request.sampler,
        "request_hash": request.hash,
        "seed": request.plan.seed,
        "method": request.plan.method,
        "parameters": json.dumps(_parameters(request, manifest)),
        "x0": json.dumps(request.x0),
        "reference": request.reference,
        "disturbance": json.dumps(request.disturbance),
        "horizon": request.horizon,
        "controller": request.controller,
        "sample_time": request.sample_time,
        "tolerance": request.tolerance,
        "samples": json.dumps([[s.name, s.law, s.first, s.second] for s in request.plan.samples]),
        "variables": json.dumps([item.name for item in quantities(manifest)]),
        "versions": json.dumps(versions),
    }


def _parameters(request: Request, manifest: Manifest) -> dict[str, float]:
    """Values where nothing is varied; the plant's own only where they were set, since others follow."""
    values = dict(zip(manifest.parameter_names, request.p, strict=True))
    return {name: value for name, value in values.items() if name not in manifest.own or name in request.own}


def _units(manifest: Manifest) -> dict[str, dict[str, str]]:
    states = {item.name: (item.unit, item.about) for item in manifest.states[: manifest.nx]}
    parameters = {item.name: (item.unit, item.about) for item in manifest.parameters}
    return {name: {"units": u, "long_name": about} for name, (u, about) in (states | parameters).items()}


def _variables(store: Store, manifest: Manifest) -> Iterator[tuple[str, _Variable]]:
    """What is reported of every run, as many variables in memory at a time as `MEMORY` holds."""
    items = quantities(manifest)
    together = max(1, MEMORY // (8 * store.request.plan.runs))
    for first in range(0, len(items), together):
        some = items[first : first + together]
        for index, (item, values) in enumerate(
            zip(some, store.columns(first, len(some)), strict=True), first
        ):
            yield item.name, _variable(store.request, index, item, values)
    if store.request.output_step:
        yield from _trajectories(store, manifest)


def _variable(request: Request, index: int, item: Quantity, values: Array) -> _Variable:
    dimensions = request.plan.dimensions
    attributes: dict[str, Any] = {"units": item.unit, "long_name": item.about}
    if index == Column.STATUS:
        meanings = status_meanings()
        attributes |= {"flag_values": list(meanings), "flag_meanings": " ".join(meanings.values())}
    shaped = values.reshape(tuple(dimensions.values()))
    if index in _INTEGERS:
        return _Variable(tuple(dimensions), np.nan_to_num(shaped).astype(np.int64), attributes)
    return _Variable(tuple(dimensions), shaped, attributes)


def _trajectories(store: Store, manifest: Manifest) -> Iterator[tuple[str, _Variable]]:
    """One variable a signal, over the sweep's dimensions and t."""
    dimensions = store.request.plan.dimensions
    times = store.request.times()
    names = trajectory_names(manifest)
    values = store.trajectories().reshape(*dimensions.values(), len(times), len(names))
    units = {item.name: item.unit for item in (*manifest.states, *manifest.signals)}
    yield "t", _Variable(("t",), times, {"units": "s"})
    for i, name in enumerate(names):
        yield f"trajectory_{name}", _Variable((*dimensions, "t"), values[..., i], {"units": units[name]})


def trajectory_names(manifest: Manifest) -> tuple[str, ...]:
    """What trajectories are kept of, in the batch library's order."""
    return (*(state.name for state in manifest.states), "v", "e")
