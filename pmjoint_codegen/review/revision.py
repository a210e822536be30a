"""A model's files in a revision of git, read without a checkout."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

from pmjoint_codegen.errors import MissingToolError, UsageError, quoted
from pmjoint_codegen.workspace import is_stream


@dataclass(frozen=True)
class Revision:
    """A commit of the repository that a folder belongs to.

    Attributes:
        name: as given, such as ``HEAD~2``.
        commit: its full hash.
        root: the repository's top folder.
    """

    name: str
    commit: str
    root: Path

    def path_of(self, path: Path) -> Path:
        """Where a place in the working tree is in the repository; absolute for one outside it."""
        real = path.parent.resolve() / path.name
        return real.relative_to(self.root) if real.is_relative_to(self.root) else real

    def export(self, path: Path, target: Path) -> bool:
        """Write a file, or all that a folder holds, below `target` at its place in the repository.

        Args:
            path: a place in the working tree; it need not exist there.
            target: stands for the repository's top folder.

        Returns:
            whether the revision holds a file there.
        """
        inside = self.path_of(path)
        if inside.is_absolute():
            return False
        listed = _git(self.root, "ls-tree", "-r", "-z", "--full-tree", self.commit, "--", str(inside))
        found = [entry.split(b"\t", 1) for entry in listed.split(b"\0") if entry]
        for head, name in found:
            file = target / os.fsdecode(name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(_git(self.root, "cat-file", "blob", head.split()[2].decode()))
        return bool(found)


def find_revision(file: Path, name: str, *, where: str = "--rev") -> Revision:
    """Find a revision of the repository that a file is in.

    Args:
        file: need not be in the repository itself.
        name: any that git knows.
        where: the place of the name in messages.

    Raises:
        MissingToolError: git is not installed.
        UsageError: the file is in no repository, or no revision has that name.
    """
    if is_stream(file):
        raise UsageError("has no earlier revision", where=str(file), remedy="give the path of a file")
    folder = file.parent.resolve()
    root = Path(os.fsdecode(_git(folder, "rev-parse", "--show-toplevel").removesuffix(b"\n")))
    try:
        asked = f"{name}^{{commit}}"
        commit = _git(folder, "rev-parse", "--verify", "--quiet", "--end-of-options", asked)
    except UsageError:
        raise UsageError(
            f"the repository has no revision {quoted(name)}",
            where=where,
            remedy="`git log --oneline` and `git branch -a` list what it has; a shallow clone lacks most",
        ) from None
    return Revision(name, commit.decode().strip(), root)


def _git(folder: Path, *arguments: str) -> bytes:
    """What git prints.

    Raises:
        MissingToolError: git is not installed.
        UsageError: it fails; the message is the first line of its own.
    """
    try:
        done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, check=False)
    except FileNotFoundError:
        raise MissingToolError(
            "git is not installed", remedy="install it: it reads the earlier revision"
        ) from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().partition("\n")[0].removeprefix("fatal: ")
        remedy = "an earlier revision is read with git: keep the model in a repository"
        raise UsageError(f"git says: {said}", where=str(folder), remedy=remedy)
    return done.stdout
