"""The formats of trajectories, one row each, and how a file in one of them is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pmjoint_codegen import storage
from pmjoint_codegen.errors import MissingToolError, UsageError, did_you_mean, installing, quoted

if TYPE_CHECKING:
    from pmjoint_codegen.logs.trajectory import Trajectory


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: on the command line, and the ending of its files.
        about: who reads it, in a few words.
        module: has ``write(trajectory, stream)``; imported when it is used.
        package: that it needs besides those of every installation, or empty.
    """

    name: str
    about: str
    module: str
    package: str = ""


FORMATS: Final = (
    Format("csv", "text", "pmjoint_codegen.logs.text"),
    Format("parquet", "PlotJuggler, data frames", "pmjoint_codegen.logs.parquet", "pyarrow"),
    Format("mat", "MATLAB, GNU Octave", "pmjoint_codegen.logs.matlab"),
    Format("mcap", "Foxglove", "pmjoint_codegen.logs.mcap", "mcap"),
)


def available(name: str, where: str) -> Format:
    """A format that can be written here.

    Args:
        name: of the format.
        where: what asked for it, for messages.

    Raises:
        UsageError: there is no such format.
        MissingToolError: its package is not installed.
    """
    known = {item.name: item for item in FORMATS}
    if name not in known:
        allowed = ", ".join(known)
        raise UsageError(
            f"is {quoted(name)}", where=where, remedy=f"{did_you_mean(name, known)}allowed: {allowed}"
        )
    found = known[name]
    try:
        import_module(found.package or found.module)
    except ImportError:
        remedy = f"install it: {installing('pmjoint-codegen[logs]')}"
        raise MissingToolError(f"{found.package} is needed for {name} files", remedy=remedy) from None
    return found


def save(make: Callable[[], Trajectory], path: Path) -> None:
    """Write a trajectory in the format of a path's ending, atomically.

    Args:
        make: the trajectory; called once the format is known to be available.
        path: of the file.

    Raises:
        UsageError: an ending that is no format, or a file that cannot be written.
        MissingToolError: the format's package is not installed.
    """
    found = available(path.suffix.removeprefix(".").lower(), f"the ending of {path}")
    trajectory = make()
    with storage.writing(path) as stream:
        import_module(found.module).write(trajectory, stream)
