"""The dataset of a sweep in other formats, written with little memory, and the packages for each."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmjoint_codegen.errors import MissingToolError, installing
from pmjoint_codegen.storage import explained
from pmjoint_codegen.sweep.blocks import blocks
from pmjoint_codegen.sweep.dataset import read
from pmjoint_codegen.sweep.executor import NEEDED

if TYPE_CHECKING:
    import xarray as xr


def require(formats: Iterable[str]) -> None:
    """Check that the packages for these formats (or ``dask``) are installed, before long work.

    Raises:
        MissingToolError: one is absent; the message has the line that installs it.
    """
    needed = {
        "zarr": ("xarray", "zarr"),
        "netcdf": ("dask", "h5netcdf", "h5py"),
        "parquet": ("pandas", "pyarrow"),
        "dask": ("distributed",),
    }
    from importlib.util import find_spec

    for name in dict.fromkeys(package for kind in ("zarr", *formats) for package in needed[kind]):
        if find_spec(name) is None:
            raise MissingToolError(f"{name} is needed for sweeps", remedy=f"install it: {installing(NEEDED)}")


def export(dataset: Path, kind: str) -> Path:
    """Write a dataset in another format beside it; returns the file.

    Args:
        dataset: folder of ``sweep.zarr``.
        kind: ``netcdf`` or ``parquet``; Parquet has one row per run and no trajectories.

    Raises:
        UsageError: the file cannot be written.
    """
    name, write = {"netcdf": ("sweep.nc", _netcdf), "parquet": ("sweep.parquet", _parquet)}[kind]
    path = dataset.with_name(name)
    staged = path.with_name(f".{name}.new")
    with explained(path):
        try:
            write(dataset, staged)
            staged.replace(path)
        finally:
            staged.unlink(missing_ok=True)
    return path


def _netcdf(dataset: Path, path: Path) -> None:
    """Let Dask process one part at a time; its threads would only wait for one another here."""
    import dask

    data = read(dataset, streamed=True)
    if shutil.disk_usage(path.parent).free < data.nbytes:  # HDF5 crashes if it cannot write
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with dask.config.set(scheduler="synchronous"):
        data.to_netcdf(path, engine="h5netcdf")


def _parquet(dataset: Path, path: Path) -> None:
    """One row per run, one row group per part; attributes and units where pandas and Arrow expect them."""
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")  # untyped
    runs = read(dataset).drop_dims("t", errors="ignore")
    lengths = runs["status"].sizes
    head = _rows(runs, [slice(1)] * len(lengths))
    head.attrs = {**runs.attrs, "units": _units(runs)}
    schema = arrow.Table.from_pandas(head).schema  # Arrow reads attributes here; pandas reads them elsewhere
    schema = schema.with_metadata({**schema.metadata, b"PANDAS_ATTRS": json.dumps(head.attrs).encode()})
    with parquet.ParquetWriter(path, schema) as writer:
        for part in blocks(tuple(lengths.values())):
            writer.write_table(arrow.Table.from_pandas(_rows(runs, part.selection), schema=schema))


def _rows(runs: xr.Dataset, selection: Iterable[slice]) -> Any:  # pandas is untyped here
    return runs.isel(dict(zip(runs["status"].dims, selection, strict=True))).to_dataframe()


def _units(runs: xr.Dataset) -> dict[str, str]:
    """The unit of every column and index."""
    return {str(name): item.attrs["units"] for name, item in runs.variables.items() if "units" in item.attrs}
