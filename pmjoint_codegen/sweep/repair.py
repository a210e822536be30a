"""Finds and repairs files of a dataset that were removed, replaced or truncated.

Results are the same byte for byte whenever they are computed. So the damaged parts are recomputed and written
like the whole sweep, beside the dataset, and then replace the damaged files; the others stay untouched.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import settle, sha256_file
from pmjoint_codegen.sweep.dataset import fill, names, record, runs_in, staging
from pmjoint_codegen.sweep.store import Store
from pmjoint_codegen.sweep.sums import is_sound, recorded


@dataclass(frozen=True)
class Damage:
    """The damage to a dataset.

    Attributes:
        files: names in the dataset: removed, altered, or foreign.
        starts: first runs of the chunks that must be computed to rewrite them.
    """

    files: tuple[str, ...]
    starts: tuple[int, ...]


def find_damage(store: Store, manifest: Manifest) -> Damage:
    """Read a whole dataset and compare it with the hashes recorded when it was written.

    Args:
        store: of the sweep; its dataset exists.
        manifest: the model.

    Raises:
        UsageError: there is no record of its hashes.
    """
    sums = _sums(store)
    altered = {name for name, digest in sums.items() if not is_sound(store.dataset / name, digest)}
    files = altered | (_standing(store.dataset, names(store, manifest)) - set(sums))
    ranges = list(runs_in(store, manifest, files)) if files else []
    needed = (
        start
        for start in store.starts()
        if any(first < start + store.length(start) and start < stop for first, stop in ranges)
    )
    return Damage(tuple(sorted(files)), tuple(needed))


def mend(store: Store, manifest: Manifest, damage: Damage) -> None:
    """Rewrite the damaged files from chunks that were computed for this and are removed afterwards.

    Args:
        store: of the sweep; the chunks that `damage` names exist.
        manifest: the model.
        damage: the result of `find_damage`.

    Raises:
        UsageError: the dataset cannot be written.
    """
    sums = {name: digest for name, digest in _sums(store).items() if name not in damage.files}
    with staging(store) as staged:
        fill(staged, store, manifest, damage.files)
        settle(staged)
        for name in damage.files:
            _replace(staged / name, store.dataset, name)
            if (store.dataset / name).is_file():
                sums[name] = sha256_file(store.dataset / name)
        record(store, sums)
    store.clear_chunks()


def _sums(store: Store) -> dict[str, str]:
    """Recorded hashes by the names in the dataset."""
    sums = recorded(store.sums)
    if sums is None:
        raise UsageError(
            "is missing or unreadable, so the dataset beside it cannot be verified",
            where=str(store.sums),
            remedy="--restart recomputes the sweep; or give another --out",
        )
    return {name.partition("/")[2]: digest for name, digest in sums.items()}


def _standing(dataset: Path, variables: frozenset[str]) -> set[str]:
    """Files in the folders of the sweep's own variables: Zarr reads them whatever their origin."""
    paths = (path for path in dataset.rglob("*") if not path.is_dir())
    files = (path.relative_to(dataset) for path in paths)
    return {file.as_posix() for file in files if file.parts[0] in variables}


def _replace(source: Path, dataset: Path, name: str) -> None:
    """Move a file to its place; leave that empty if there is none: Zarr omits parts without content."""
    target = dataset / name
    for folder in reversed(target.relative_to(dataset).parents):
        place = dataset / folder
        if place.is_symlink() or (place.exists() and not place.is_dir()):
            place.unlink()
        place.mkdir(exist_ok=True)
    if target.is_dir() and not target.is_symlink():
        shutil.rmtree(target)
    if source.is_file():
        os.replace(source, target)
    else:
        target.unlink(missing_ok=True)
