"""A finished sweep as one labelled dataset: dimensions of the grid, units, seed, hashes and versions."""

from __future__ import annotations

import json
import platform
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen import __version__
from pmjoint_codegen.chain import SAMPLE_TIME
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.logits import reported_states
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import explained, settle, write_text
from pmjoint_codegen.sweep.blocks import Block, block_shape, blocks
from pmjoint_codegen.sweep.metrics import HELD, quantities, status_meanings, values_of
from pmjoint_codegen.sweep.plan import CODES, DRAW, SATURATION
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.store import Store
from pmjoint_codegen.sweep.sums import as_text, sums_of

if TYPE_CHECKING:
    import xarray as xr
    import zarr


def import_ahead() -> None:
    """Import the libraries for writing in a separate thread, while the C loops compute without Python's lock.

    Nothing depends on it: an import that fails here fails again, and is reported, where it is needed.
    """

    def work() -> None:
        with suppress(Exception):
            import_module("zarr")

    Thread(target=work, name="import-ahead", daemon=True).start()


def assemble(store: Store, manifest: Manifest) -> None:
    """Write ``sweep.zarr`` from the chunks, whole or not at all; then remove the chunks.

    Only Zarr writes it: xarray, which reads it, takes longer to import than many sweeps take to compute.
    Memory use does not grow with the sweep.

    Raises:
        UsageError: the folder cannot be written, and the chunks remain; or a chunk is damaged.
    """
    if store.missing():
        raise UsageError(
            "chunks were removed or altered while the sweep was running",
            where=str(store.folder),
            remedy="repeat the same command: it recomputes these",
        )
    with staging(store) as staged:
        fill(staged, store, manifest)
        settle(staged)  # the chunks, which hold all results, are removed next
        record(store, sums_of(staged))  # first, so that no dataset exists without hashes
        staged.rename(store.dataset)
    store.clear_chunks()


@contextmanager
def staging(store: Store) -> Iterator[Path]:
    """Name a folder beside the dataset to write in, and remove its leftovers.

    Raises:
        UsageError: the block failed because of the file system.
    """
    staged = store.folder / f".{store.dataset.name}.new"
    shutil.rmtree(staged, ignore_errors=True)
    with explained(store.dataset):
        try:
            yield staged
        finally:
            shutil.rmtree(staged, ignore_errors=True)


def record(store: Store, sums: Mapping[str, str]) -> None:
    """Write the hashes of a dataset's files, by their names in it, to `store.sums`."""
    text = as_text({f"{store.dataset.name}/{name}": digest for name, digest in sums.items()})
    write_text(store.sums, text)


def fill(folder: Path, store: Store, manifest: Manifest, wanted: Collection[str] | None = None) -> None:
    """Write attributes and variables.

    Args:
        folder: to be created.
        store: of the sweep; its chunks hold the data.
        manifest: the model.
        wanted: files of metrics and trajectories that are needed; None: all. Attributes, axes and draws,
            which need no chunk, are always written.
    """
    import zarr

    request = store.request
    group = zarr.create_group(folder, zarr_format=3, attributes=_attributes(request, manifest))
    for name, variable, values in _coordinates(request, manifest):
        _create(group, name, variable)[...] = values
    arrays = [_create(group, *item) for item in _metrics(request, manifest)]
    _pour(arrays, lambda i, j: values_of(manifest, store.table(i, j), request.horizon), wanted)
    if request.output_step:
        arrays = [_create(group, *item) for item in _trajectories(request, manifest)]
        _pour(arrays, store.trajectories, wanted)


def names(store: Store, manifest: Manifest) -> frozenset[str]:
    """Names of all variables of a dataset, which are its folders."""
    items = (*_coordinates(store.request, manifest), *_metrics(store.request, manifest))
    more = _trajectories(store.request, manifest) if store.request.output_step else ()
    return frozenset(item[0] for item in (*items, *more))


def runs_in(store: Store, manifest: Manifest, files: Collection[str]) -> Iterator[tuple[int, int]]:
    """Give the runs (first, and the one after the last) in some of a dataset's files."""
    request = store.request
    each = request.instants
    for name, variable in _metrics(request, manifest):
        for part in blocks(variable.shape):
            if part_file(name, variable.shape, part) in files:
                yield part.start, part.stop
    for name, variable in _trajectories(request, manifest) if each else ():
        for part in blocks(variable.shape):
            if part_file(name, variable.shape, part) in files:
                yield part.start // each, -(-part.stop // each)


def part_file(name: str, shape: tuple[int, ...], part: Block) -> str:
    """Name of the file in a dataset that holds a part of a variable."""
    sizes = block_shape(shape)
    place = (str(piece.start // size) for piece, size in zip(part.selection, sizes, strict=True))
    return "/".join((name, "c", *place))


def _create(group: zarr.Group, name: str, variable: _Variable) -> zarr.Array[Any]:
    return group.create_array(
        name,
        shape=variable.shape,
        dtype=variable.dtype,
        chunks=block_shape(variable.shape),
        dimension_names=variable.dimensions,
        fill_value=np.nan if variable.dtype == np.float64 else 0,
        attributes=variable.attributes,
    )


def _pour(
    arrays: Sequence[zarr.Array[Any]], rows: Callable[[int, int], Array], wanted: Collection[str] | None
) -> None:
    """Fill arrays of one shape, part by part, with the columns that `rows` returns for a range."""
    for part in blocks(arrays[0].shape):
        if wanted is not None and not any(
            part_file(array.basename, array.shape, part) in wanted for array in arrays
        ):
            continue
        block = rows(part.start, part.stop)
        for array, values in zip(arrays, block.T, strict=True):
            if array.dtype == np.int64:
                values = np.nan_to_num(values)
            array[part.selection] = values.astype(array.dtype).reshape(part.shape)


def read(path: Path, *, streamed: bool = False) -> xr.Dataset:
    """Open a dataset; a variable is read when its values are needed, and not kept.

    Args:
        path: of ``sweep.zarr``.
        streamed: in Dask's arrays, so that whole variables pass through little memory.
    """
    import xarray as xr

    chunks: dict[str, int] | None = {} if streamed else None
    dataset = xr.open_dataset(path, engine="zarr", consolidated=False, cache=False, chunks=chunks)
    order = json.loads(dataset.attrs["variables"])
    more = sorted(str(name) for name in dataset.variables if str(name) not in order)  # found in any order
    ordered: xr.Dataset = dataset[[*order, *more]]
    return ordered


@dataclass(frozen=True)
class _Variable:
    """An array of the dataset.

    Attributes:
        lengths: of its dimensions, by name.
        attributes: units and descriptions.
        dtype: of its numbers.
    """

    lengths: Mapping[str, int]
    attributes: dict[str, Any]
    dtype: type[np.float64 | np.int64] = np.float64

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names."""
        return tuple(self.lengths)

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths."""
        return tuple(self.lengths.values())


def _coordinates(
    request: Request, manifest: Manifest
) -> Iterator[tuple[str, _Variable, npt.NDArray[np.float64 | np.int64]]]:
    """The axes, numbers of the draws, drawn values, instants of trajectories, each with its values."""
    plan = request.plan
    units = _units(manifest)
    for axis in plan.axes:
        yield axis.name, _Variable({axis.name: len(axis.values)}, units[axis.name]), plan.grid[axis.name]
    draws = {DRAW: plan.draws}
    if plan.samples:
        yield DRAW, _Variable(draws, {}, np.int64), np.arange(plan.draws)
    for name, values in plan.drawn.items():
        yield name, _Variable(draws, units[name]), values
    if request.output_step:
        yield "t", _Variable({"t": request.instants}, {"units": "s"}), request.times()


def _attributes(request: Request, manifest: Manifest) -> dict[str, Any]:
    """All that the result depends on; ``coordinates`` names, by the CF rules, those that are no dimension."""
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
        "start": request.start,
        "disturbance": json.dumps(request.disturbance),
        "horizon": request.horizon,
        "controller": request.controller,
        "sample_time": 0.0 if SAMPLE_TIME in request.plan.names else request.sample_time,
        "tolerance": request.tolerance,
        "samples": json.dumps([[s.name, s.law, s.first, s.second] for s in request.plan.samples]),
        "variables": json.dumps([item.name for item in quantities(manifest)]),
        "versions": json.dumps(versions),
    }


def _parameters(request: Request, manifest: Manifest) -> dict[str, float]:
    """Values where nothing is varied; the plant's own only where set, since the others follow."""
    values = manifest.written(dict(zip(manifest.parameter_names, request.p, strict=False)))
    return {name: value for name, value in values.items() if name not in manifest.own or name in request.own}


def _units(manifest: Manifest) -> dict[str, dict[str, Any]]:
    states = {item.name: (item.unit, item.about) for item in manifest.start.variables}
    parameters = {item.name: (item.unit, item.about) for item in manifest.parameters}
    clock = {SAMPLE_TIME: ("s", "sample time")}
    found: dict[str, dict[str, Any]] = {
        name: {"units": u, "long_name": about} for name, (u, about) in (states | parameters | clock).items()
    }
    words = {"flag_values": list(CODES.values()), "flag_meanings": " ".join(CODES)}
    return {**found, SATURATION: {"units": "1", "long_name": "what is done about a saturated input", **words}}


def _metrics(request: Request, manifest: Manifest) -> Iterator[tuple[str, _Variable]]:
    """The results of every run, in the order of the tables."""
    for item in quantities(manifest):
        attributes: dict[str, Any] = {"units": item.unit, "long_name": item.about}
        if item.name == Column.STATUS.variable:
            meanings = status_meanings()
            attributes |= {"flag_values": list(meanings), "flag_meanings": " ".join(meanings.values())}
        if item.name == HELD:
            attributes |= {"flag_values": [0, 1], "flag_meanings": "lost held"}
        dtype = np.int64 if item.integer else np.float64
        yield item.name, _Variable(request.plan.dimensions, attributes, dtype)


def _trajectories(request: Request, manifest: Manifest) -> Iterator[tuple[str, _Variable]]:
    """One variable per signal, over the sweep's dimensions and t."""
    lengths = {**request.plan.dimensions, "t": request.instants}
    units = {item.name: item.unit for item in (*manifest.states, *manifest.signals)}
    for name in trajectory_names(manifest):
        yield f"trajectory_{name}", _Variable(lengths, {"units": units[name]})


def trajectory_names(manifest: Manifest) -> tuple[str, ...]:
    """The signals of trajectories, in the batch library's order."""
    return (*reported_states(manifest), "v", "e")
