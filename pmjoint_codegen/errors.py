"""Every error that the package raises on purpose, as one tree.

    PmjointError                 where, what and remedy; ``str()`` is one clear line
      UsageError        exit 2   bad option, unknown ``--set`` name, unwritable ``--out``
        ResourceError   exit 3   a resource failed: a full disk, a quota, a failing device
      ModelError        exit 2   model file: missing, not UTF-8, unknown key, bad expression, no such plant
      StaleError        exit 1   ``generated/`` does not follow from the model, or was edited by hand
        OtherVersionError exit 1 written by another version of this package
      CheckFailed       exit 1   a check found a difference
      MissingToolError  exit 3   a required compiler or extra is absent; the remedy installs it
      BuildError        exit 3   the compiler failed; ``output`` holds all its output
      SimulationError   exit 3   a run failed; ``run`` holds the trajectory so far and its status

Only the command line turns an error into an exit code; all other code raises.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable
from typing import Any, ClassVar

__all__ = [
    "BuildError",
    "CheckFailed",
    "MissingToolError",
    "ModelError",
    "OtherVersionError",
    "PmjointError",
    "ResourceError",
    "SimulationError",
    "StaleError",
    "UsageError",
    "did_you_mean",
    "installing",
    "quoted",
]

_LONGEST_QUOTE = 60  # characters of foreign text that a message repeats


def quoted(value: object) -> str:
    """Show a user's value in a message: text in quotes, cut if it is long."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 200:
        return "a whole number of more than 60 digits"  # which Python may refuse to print
    shown = repr(value[: _LONGEST_QUOTE + 1]) if isinstance(value, str) else str(value)
    return shown if len(shown) <= _LONGEST_QUOTE else shown[: _LONGEST_QUOTE - 4] + " ..."


def did_you_mean(asked: str, known: Iterable[str], shown: Callable[[str], str] = repr) -> str:
    """Suggest the known name closest to a wrong one, with a space after it; empty if none is close."""
    from difflib import get_close_matches  # slow to import, and used for wrong names only

    close = get_close_matches(asked[:300], list(known), n=1)
    return f"did you mean {shown(close[0])}? " if close else ""


def installing(requirement: str) -> str:
    """Give the line that installs a package for the running interpreter, whichever `pip` the shell finds."""
    return f"{shlex.quote(sys.executable or 'python3')} -m pip install '{requirement}'"


def _one_line(text: str) -> str:
    """Fold whitespace and escape what does not print: a message is one line and cannot steer a terminal."""
    folded = " ".join(text.split())
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in folded)


class PmjointError(Exception):
    """What went wrong, where, and what the user can do about it.

    ``str()`` gives ``where: what; remedy`` on one line, without empty parts.
    """

    exit_code: ClassVar[int] = 3

    def __init__(self, what: str, *, where: str = "", remedy: str = "") -> None:
        """Keep the three parts; ``where`` is a file, key or option, ``remedy`` what is allowed or helps."""
        super().__init__(what, where, remedy)
        self.what = _one_line(what)
        self.where = _one_line(where)
        self.remedy = _one_line(remedy)

    def __str__(self) -> str:
        """Give the one line that a user reads."""
        place = f"{self.where}: " if self.where else ""
        advice = f"; {self.remedy}" if self.remedy else ""
        return f"{place}{self.what}{advice}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle all attributes: a worker process passes its error to the parent."""
        return _restore, (type(self), self.__dict__)


class UsageError(PmjointError):
    """The command or call asks for something impossible: an option, a name, a folder."""

    exit_code = 2


class ModelError(PmjointError):
    """The model file is absent, unreadable, malformed, or describes no model of the class."""

    exit_code = 2


class StaleError(PmjointError):
    """Generated files no longer follow from the model, or were edited by hand."""

    exit_code = 1


class OtherVersionError(StaleError):
    """``generated/`` is whole, but its manifest holds other fields than this version writes."""


class CheckFailed(PmjointError):  # noqa: N818 - a finding, not a malfunction
    """A check found a difference between generated code and the symbolic reference."""

    exit_code = 1


class MissingToolError(PmjointError):
    """A compiler or an optional package is absent; ``remedy`` is the line that installs it."""


class BuildError(PmjointError):
    """The C compiler failed; ``output`` is the whole text that it printed, unshortened."""

    def __init__(self, what: str, *, where: str = "", remedy: str = "", output: str = "") -> None:
        """Keep the compiler's text beside the one line."""
        super().__init__(what, where=where, remedy=remedy)
        self.output = output


class ResourceError(UsageError):
    """The request is valid, but a resource failed: a full disk, a quota, a failing device.

    Code that catches unwritable files sees a `UsageError`; the exit code is that of a failed run.
    """

    exit_code = 3


class SimulationError(PmjointError):
    """A run ended early; ``run`` is the run, with its status and the trajectory so far."""

    def __init__(self, what: str, *, where: str = "", remedy: str = "", run: object = None) -> None:
        """Keep the run beside the one line."""
        super().__init__(what, where=where, remedy=remedy)
        self.run = run


def _restore(kind: type[PmjointError], attributes: dict[str, Any]) -> PmjointError:
    """Rebuild a pickled error of any kind from its attributes."""
    error = kind(attributes["what"], where=attributes["where"], remedy=attributes["remedy"])
    error.__dict__.update(attributes)
    return error
