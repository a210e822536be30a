"""The record of one simulation: only data, which summaries, tables and figures read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.settings import Settings

COMMAND: Final = "y_cmd"  # column of a reference that is data, before its filter
RATE: Final = "theta_dot"  # of a joint: the rate of y, whose x2 is a coordinate of the design


def reports_rate(manifest: Manifest) -> bool:
    """Whether a run of a model has the column `RATE`, and its peak."""
    return any(item.name == RATE for item in manifest.signals)


@dataclass(frozen=True, repr=False)
class Record(Mapping[str, Array]):
    """A simulated trajectory with its model and settings.

    It is a mapping of columns: ``run["x1"]``, ``"x1" in run``, ``dict(run)``; they are views, not copies.

    Attributes:
        manifest: the model, with the units of all columns.
        settings: of the run.
        evaluator: ``compiled`` or ``interpreted``.
        status: how it ended; anything except `Status.DONE` is a failure, and the trajectory stops there.
        message: the same as a sentence.
        t: output instants, s, shape (rows,).
        states: shape (rows, nX).
        signals: shape (rows, number of signals).
        switches: (t, mode label) at every saturation switch, s; -1, 0, 1 for u at its lower limit, inside, at
            its upper.
        initial_mode: mode label at t = 0.
        peaks: name -> (largest magnitude, its instant in s) of every state, v, e and, if it is
            reported, `RATE`; on the dense output.
        ise: integral of e^2 over the time reached.
        settling_s: the last instant at which |e| exceeds 2 % of |e(0)|, on the dense output, s; None if
            |e| exceeds it at the horizon, e(0) is 0 or NaN, or the run ended early.
        steps: accepted integration steps.
        wall_s: duration of the run, s.
        sticks: (from, to) of every interval in which a kink held the plant, as Coulomb friction does, s.
    """

    manifest: Manifest
    settings: Settings
    evaluator: str
    status: Status
    message: str
    t: Array
    states: Array
    signals: Array
    switches: tuple[tuple[float, int], ...]
    initial_mode: int
    peaks: Mapping[str, tuple[float, float]]
    ise: float
    settling_s: float | None
    steps: int
    wall_s: float
    sticks: tuple[tuple[float, float], ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns."""
        return ("t", *self._places, *([COMMAND] if self.settings.reference is not None else []))

    @cached_property
    def _command(self) -> Array:
        """The unfiltered reference, where it is data."""
        reference = self.settings.reference
        assert reference is not None
        return reference.values(self.t)

    @property
    def reference_text(self) -> str:
        """The reference in one line."""
        reference = self.settings.reference
        return self.manifest.simulation.reference if reference is None else reference.command.text

    def __getitem__(self, column: str) -> Array:
        """One column, shape (rows,), read-only; a copy of it can be written.

        Raises:
            KeyError: there is no such column; the message lists them.
        """
        if column == "t":
            return _read_only(self.t)
        if column == COMMAND and self.settings.reference is not None:
            return _read_only(self._command)
        try:
            table, index = self._places[column]
        except KeyError:
            raise KeyError(f"no column {column!r}; columns: {', '.join(self.columns)}") from None
        return _read_only((self.states if table == "states" else self.signals)[:, index])

    def __iter__(self) -> Iterator[str]:
        """The names of all columns, in their order."""
        return iter(self.columns)

    def __len__(self) -> int:
        """Number of columns."""
        return len(self.columns)

    def __repr__(self) -> str:
        """Say in five lines what the run was and how it ended."""
        from pmjoint_codegen.simulate.shown import text

        return text(self)

    @cached_property
    def _places(self) -> Mapping[str, tuple[str, int]]:
        signals = {item.name: ("signals", i) for i, item in enumerate(self.manifest.signals)}
        return signals | {item.name: ("states", i) for i, item in enumerate(self.manifest.states)}


def _read_only(values: Array) -> Array:
    """A view through which the run's own data cannot be changed."""
    view = values.view()
    view.setflags(write=False)
    return view
