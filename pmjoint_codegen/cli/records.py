"""The record of a run on the command line: the command that made it, and whose run a folder holds."""

from __future__ import annotations

import shlex
from contextlib import suppress
from pathlib import Path

import click

from pmjoint_codegen.errors import ModelError, UsageError


def recorded_command() -> str:
    """The present command line, quoted for a shell, as the user typed it."""
    given = click.get_current_context().find_root().obj or ()
    return shlex.join(["pmjoint", *given])


def check_owner(folder: Path, model: str) -> None:
    """Refuse to overwrite the run of another model file whose `name` is the same, as after copying a file.

    Args:
        folder: of results, named after the model.
        model: name or path, as it was given.

    Raises:
        UsageError: the folder holds the run of another file that still exists.
    """
    from pmjoint_codegen.simulate.folder import recorded_model
    from pmjoint_codegen.workspace import find_model, is_stream

    before = recorded_model(folder)
    if before is None or before == model:
        return
    with suppress(ModelError, OSError):  # a file that was renamed or moved: its runs are this one's
        old, new = find_model(before), find_model(model)
        if not is_stream(old) and not is_stream(new) and not old.samefile(new):
            raise UsageError(
                f"holds a run of {old}, and {new} has the same name in it",
                where=str(folder),
                remedy=f"change `name` in {new}, or give --out",
            )
