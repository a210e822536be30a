"""A model as it was in a revision of git, in a temporary folder with all that it reads."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pmjoint_codegen.check.gates import golden
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.review.revision import find_revision
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.workspace import generated_root


@contextmanager
def earlier(file: Path, revision: str) -> Iterator[Path]:
    """Write a model's folder as it was, with its generated and golden files; all are gone after the block.

    An error about the model that leaves the block names the file and the revision, not the temporary folder.

    Args:
        file: the model file in the working tree.
        revision: any name that git knows.

    Yields:
        the model file in the temporary folder.

    Raises:
        UsageError: no repository, no such revision, or no such model in it.
        MissingToolError: git is not installed.
        ModelError: it cannot be read or derived.
    """
    found = find_revision(file, revision)
    with scratch("pmjoint-revision") as root:
        if not found.export(file, root):
            raise UsageError(
                f"is not in revision {found.name}",
                where=str(file),
                remedy=f"choose one that has it: git log --oneline -- {shlex.quote(str(file))}",
            )
        path = root / found.path_of(file)
        try:
            name = str(read_document(path).get("name"))
            for needed in (file.parent, generated_root(file) / name, *golden.files_of(file, name)):
                found.export(needed, root)
            yield path
        except ModelError as error:
            if not error.where.startswith(str(path)):
                raise
            key = error.where.removeprefix(str(path))  # a path in the temporary folder is of no use
            raise ModelError(error.what, where=f"{file} at {found.name}{key}", remedy=error.remedy) from error
