"""A run as a table of pandas or a dataset of xarray, with units."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pmjoint_codegen.errors import MissingToolError, installing
from pmjoint_codegen.simulate.trajectory import csv_columns, labels

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from pmjoint_codegen.simulate.record import Record


def dataframe(run: Record) -> pd.DataFrame:
    """The columns of ``trajectory.csv``, with t as the index; ``attrs["units"]`` has the unit of each.

    Raises:
        MissingToolError: pandas is not installed.
    """
    pandas = _required("pandas")
    names = csv_columns(run.manifest)
    index = pandas.Index(run.t, name="t")
    table: pd.DataFrame = pandas.DataFrame({name: run[name] for name in names if name != "t"}, index=index)
    known = labels(run)
    table.attrs = {"model": run.manifest.name, "units": {name: known[name][0] for name in names}}
    return table


def dataset(run: Record) -> xr.Dataset:
    """The same as variables along the dimension t, each with its unit and its meaning.

    Raises:
        MissingToolError: xarray is not installed.
    """
    xarray = _required("xarray")
    known = labels(run)
    variables = {
        name: ("t", run[name], {"units": known[name][0], "long_name": known[name][1]})
        for name in csv_columns(run.manifest)
    }
    made: xr.Dataset = xarray.Dataset(
        {name: variable for name, variable in variables.items() if name != "t"},
        coords={"t": variables["t"]},
        attrs={"model": run.manifest.name, "model_hash": run.manifest.model_hash, "status": run.status.name},
    )
    return made


def _required(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        remedy = f"install it: {installing('pmjoint-codegen[sweep]')}"
        raise MissingToolError(f"{name} is needed for this", remedy=remedy) from None
