"""Says in captions why runs are missing in figures of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.sweep.metrics import INVALID
from pmjoint_codegen.sweep.region import held

if TYPE_CHECKING:
    import xarray as xr


def absence(mark: str, dataset: xr.Dataset, *names: str) -> str:
    """Why runs are missing in a figure of these metrics, for the caption; empty if none are."""
    status = dataset["status"]
    reasons = []
    invalid, failed = status == INVALID, ~status.isin((INVALID, int(Status.DONE), int(Status.DIVERGED)))
    if bool((~held(dataset) & ~invalid & ~failed).any()):
        reasons.append("the joint diverges")
    if bool(invalid.any()):
        reasons.append("the values break a rule of the design")
    if bool(failed.any()):
        reasons.append("the run failed")
    if "settling_s" in names and bool((held(dataset) & dataset["settling_s"].isnull()).any()):
        reasons.append("it has not settled by the end, or e(0) = 0")
    return f"{mark}: {', or '.join(reasons)}." if reasons else ""


def unsettled(dataset: xr.Dataset) -> str:
    """What white cells of a region are, for the caption; empty if there are none."""
    undefined = held(dataset) & dataset["settling_s"].isnull()
    return " White: not settled by the end, or e(0) = 0." if bool(undefined.any()) else ""
