"""What is compared: a model as it is, or as it was in a revision of git (``MODEL@REV``)."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pmjoint_codegen.emit.staleness import read_folder, tampering
from pmjoint_codegen.errors import ModelError, StaleError
from pmjoint_codegen.identity import model_hash
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.review.checkout import check_out
from pmjoint_codegen.review.revision import Revision, find_revision
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.workspace import find_model, generated_root

SHORT: Final = 10  # digits of a commit


@dataclass(frozen=True)
class Side:
    """One of two models.

    Attributes:
        file: its model file, in a temporary folder for a revision.
        called: the model as asked.
        shown: the model file in the working tree.
        revision: that it is of, or None for the working tree.
        derived: whether the revision has no generated folder that follows from its model file, so that the
            model is derived by this version of the program.
    """

    file: Path
    called: str
    shown: Path
    revision: Revision | None = None
    derived: bool = False

    @property
    def commit(self) -> str:
        """The short commit; nothing for the working tree."""
        return self.revision.commit[:SHORT] if self.revision else ""

    @property
    def origin(self) -> str:
        """Revision and commit in words; nothing for the working tree."""
        if self.revision is None:
            return ""
        told = f"revision {self.revision.name}, commit {self.commit}"
        return f"{told}, derived by this version" if self.derived else told


def split(asked: str) -> tuple[Path, str | None]:
    """The model file, and the revision after an ``@``; a file whose name has an ``@`` is taken as it is.

    Raises:
        ModelError: there is no such model.
    """
    ends = [k for k, sign in enumerate(asked) if sign == "@" and k > 0]
    failure: ModelError | None = None
    for end in (None, *ends):
        try:
            return find_model(asked[:end]), None if end is None else asked[end + 1 :]
        except ModelError as error:
            # of the shortest name, as a revision such as HEAD@{1} may have an @ too
            failure = error if end in (None, *ends[:1]) else failure
    assert failure is not None  # the loop has run
    raise failure


@contextmanager
def opened(asked: str, revision: str | None = None) -> Iterator[Side]:
    """Find a model, and write its files into a temporary folder if a revision is asked for.

    Args:
        asked: ``MODEL`` or ``MODEL@REV``.
        revision: of an option, for a model without an ``@REV``.

    Raises:
        ModelError: no such model, or its file at the revision cannot be read.
        UsageError: no repository, no such revision, or no such model in it.
        MissingToolError: git is not installed.
    """
    file, own = (find_model(asked), revision) if revision is not None else split(asked)
    if own is None:
        yield Side(file, asked, file)
        return
    found = find_revision(file, own, where="--rev" if revision is not None else asked)
    with scratch("pmjoint-report") as root:
        earlier = check_out(file, found, root)
        derived = not _follows(earlier)
        called = asked if revision is None else f"{asked}@{revision}"
        yield Side(earlier, called, file, found, derived)


def _follows(file: Path) -> bool:
    """Whether the generated folder follows from the model file; otherwise it is removed."""
    document = read_document(file)
    folder = generated_root(file) / str(document.get("name"))
    try:
        manifest, edits = tampering(read_folder(folder))
        follows = manifest is not None and not edits and manifest.model_hash == model_hash(document)
    except StaleError:  # of another version, whose kernels this one cannot run
        follows = False
    if not follows:
        shutil.rmtree(folder, ignore_errors=True)
    return follows
