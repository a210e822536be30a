"""All files of a model in a revision, written to a folder of their own."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from pmjoint_codegen.check.gates import golden
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.review.revision import Revision
from pmjoint_codegen.workspace import generated_root


@contextmanager
def named_as(file: Path, earlier: Path, revision: Revision) -> Iterator[None]:
    """Let errors of a model in a temporary folder name the user's file and the revision instead."""
    try:
        yield
    except ModelError as error:
        key = error.where.removeprefix(str(earlier))  # a path in the temporary folder is of no use
        where = f"{file} at {revision.name}{key}"
        raise ModelError(error.what, where=where, remedy=error.remedy) from error


def check_out(file: Path, revision: Revision, root: Path) -> Path:
    """Write a model file, its generated folder, golden files and data as they are in a revision.

    Args:
        file: the model file in the working tree.
        revision: of the same repository.
        root: an empty folder that stands for the repository's top folder.

    Returns:
        the model file below `root`.

    Raises:
        UsageError: the revision has no such model.
        ModelError: its model file cannot be read.
    """
    if not revision.export(file, root):
        raise UsageError(
            f"is not in revision {revision.name}",
            where=str(file),
            remedy=f"choose one that has it: git log --oneline -- {shlex.quote(str(file))}",
        )
    earlier = root / revision.path_of(file)
    with named_as(file, earlier, revision):
        document = read_document(earlier)
    name = str(document.get("name"))
    simulation = document.get("simulation")
    reference = simulation.get("reference") if isinstance(simulation, Mapping) else None
    data = reference.get("file") if isinstance(reference, Mapping) else None
    paths = [generated_root(file) / name, *golden.files_of(file, name)]
    for path in (*paths, *([file.parent / data] if isinstance(data, str) else [])):
        revision.export(path, root)
    return earlier
