"""A finished sweep as one labelled dataset: dimensions of the grid, units, seed, hashes and versions."""

from __future__ import annotations

import json
import platform
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen import __version__
from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.drive import INSTALL
from pmjoint_codegen.sweep.metrics import Column, Quantity, quantities, status_meanings
from pmjoint_codegen.sweep.plan import DRAW
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.store import Store

if TYPE_CHECKING:
    import xarray as xr

FORMATS: Final = ("zarr", "netcdf", "parquet")
_INTEGERS: Final = (Column.STATUS, Column.STEPS, Column.SWITCHES)


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
            raise MissingToolError(f"{name} is needed for sweeps", remedy=f"install it: {INSTALL}")


def assemble(store: Store, manifest: Manifest) -> None:
    """Write ``sweep.zarr`` from the chunks, whole or not at all; then remove the chunks.

    One variable is in memory at a time.

    Raises:
        UsageError: the folder cannot be written.
    """
    staged = store.folder / f".{store.dataset.name}.new"
    shutil.rmtree(staged, ignore_errors=True)
    header = _header(store.request, manifest)
    header.to_zarr(staged, mode="w", consolidated=False, zarr_format=3)
    for index, item in enumerate(quantities(manifest)):
        one = _variable(store, header, index, item)
        one.to_zarr(staged, mode="a", consolidated=False, zarr_format=3)
    if store.request.output_step:
        _trajectories(store, header, manifest).to_zarr(staged, mode="a", consolidated=False, zarr_format=3)
    shutil.rmtree(store.dataset, ignore_errors=True)
    staged.rename(store.dataset)
    store.clear_chunks()


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
    """
    path = folder / {"netcdf": "sweep.nc", "parquet": "sweep.parquet"}[kind]
    staged = path.with_name(f".{path.name}.new")
    if kind == "netcdf":
        dataset.to_netcdf(staged, engine="h5netcdf")
    else:
        frame = dataset.drop_dims("t", errors="ignore").to_dataframe()
        frame.attrs = dict(dataset.attrs)
        frame.to_parquet(staged)
    staged.replace(path)
    return path


def _header(request: Request, manifest: Manifest) -> xr.Dataset:
    """Coordinates and attributes, without results."""
    import xarray as xr

    plan = request.plan
    units = _units(manifest)
    coordinates: dict[str, Any] = {
        axis.name: (axis.name, np.array(axis.values), units[axis.name]) for axis in plan.axes
    }
    if plan.samples:
        coordinates[DRAW] = (DRAW, np.arange(plan.draws))
    drawn = {name: (DRAW, values, units[name]) for name, values in plan.drawn.items()}
    return xr.Dataset(coords={**coordinates, **drawn}, attrs=_attributes(request, manifest))


def _attributes(request: Request, manifest: Manifest) -> dict[str, Any]:
    versions = {"pmjoint_codegen": __version__, "python": platform.python_version(), "numpy": np.__version__}
    return {
        "title": f"Sweep of {manifest.title}",
        "source": manifest.source,
        "model": manifest.name,
        "model_hash": manifest.model_hash,
        "kernels": request.kernels,
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


def _variable(store: Store, header: xr.Dataset, index: int, item: Quantity) -> xr.Dataset:
    dimensions = store.request.plan.dimensions
    values = store.column(index).reshape(tuple(dimensions.values()))
    attributes: dict[str, Any] = {"units": item.unit, "long_name": item.about}
    if index in _INTEGERS:
        values = np.nan_to_num(values).astype(np.int64)
    if index == Column.STATUS:
        meanings = status_meanings()
        attributes |= {"flag_values": list(meanings), "flag_meanings": " ".join(meanings.values())}
    return header.assign({item.name: (tuple(dimensions), values, attributes)})[[item.name]].drop_vars(
        list(header.coords)
    )


def _trajectories(store: Store, header: xr.Dataset, manifest: Manifest) -> xr.Dataset:
    """One variable a signal, over the sweep's dimensions and t."""
    dimensions = store.request.plan.dimensions
    times = store.request.times()
    names = trajectory_names(manifest)
    values = store.trajectories().reshape(*dimensions.values(), len(times), len(names))
    units = {item.name: item.unit for item in (*manifest.states, *manifest.signals)}
    variables = {
        f"trajectory_{name}": ((*dimensions, "t"), values[..., i], {"units": units[name]})
        for i, name in enumerate(names)
    }
    return (
        header.assign_coords(t=("t", times, {"units": "s"})).assign(variables).drop_vars(list(header.coords))
    )


def trajectory_names(manifest: Manifest) -> tuple[str, ...]:
    """What trajectories are kept of, in the batch library's order."""
    return (*(state.name for state in manifest.states), "v", "e")
