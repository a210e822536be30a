"""A dataset whose files were removed, replaced or cut off: which, and how it is made whole again.

Results are the same byte for byte whenever they are computed. So what is damaged is computed and written as
the whole sweep was, beside the dataset, and takes the damaged files' places; the others stay untouched.
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
    """What of a dataset is not what was written.

    Attributes:
        files: names in the dataset: removed, altered, or put where only the sweep writes.
        starts: first runs of the chunks that must be computed to write them anew.
    """

    files: tuple[str, ...]
    starts: tuple[int, ...]


def find_damage(store: Store, manifest: Manifest) -> Damage:
    """Read a whole dataset and compare it with what was recorded when it was written.

    Args:
        store: of the sweep; its dataset exists.
        manifest: the model.

    Raises:
        UsageError: nothing is recorded of it, so that nothing can be said.
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
    """Write the damaged files anew, from chunks that were made for it and go afterwards.

    Args:
        store: of the sweep; the chunks that `damage` names are made.
        manifest: the model.
        damage: what `find_damage` found.

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
            "is missing or unreadable: nothing says whether the dataset beside it is what was computed",
            where=str(store.sums),
            remedy="--restart computes the sweep anew; or give another --out",
        )
    return {name.partition("/")[2]: digest for name, digest in sums.items()}


def _standing(dataset: Path, variables: frozenset[str]) -> set[str]:
    """Files in the folders of the sweep's own variables: Zarr reads them wherever they come from."""
    paths = (path for path in dataset.rglob("*") if not path.is_dir())
    files = (path.relative_to(dataset) for path in paths)
    return {file.as_posix() for file in files if file.parts[0] in variables}


def _replace(source: Path, dataset: Path, name: str) -> None:
    """Move a file to its place; leave that empty where there is none: Zarr omits parts without content."""
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
