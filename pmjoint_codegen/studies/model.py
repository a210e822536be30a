"""The model that a study simulates: a name, a path, or a loop that is already loaded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmjoint_codegen.brief import brief
from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.provision import Provided, Reference, Source, provide_document
from pmjoint_codegen.studies.watch import Notify

Model = str | Path | ClosedLoop


@dataclass(frozen=True)
class Subject:
    """A model that has been read, with what a study changes of it.

    Attributes:
        source: of the model, with the options of the loop it came from.
        task: a reference that only the runs know, such as an array or a function; None for none.
    """

    source: Source
    task: object = None

    __repr__ = brief

    @property
    def environment(self) -> Mapping[str, str]:
        """For compiler and cache folder."""
        return os.environ if self.source.environment is None else self.source.environment

    def provide(self, notify: Notify, *, saturation: str | None = None) -> Provided:
        """Find or make the kernels; raises the errors of `provision.provide`."""
        source = self.source
        return provide_document(
            source.file,
            source.document,
            reference=source.reference,
            disturbance=source.disturbance,
            saturation=source.saturation or saturation,
            environment=self.environment,
            notify=notify,
            lanes=True,
        )

    @property
    def runs(self) -> dict[str, Any]:
        """The keyword of the runs' settings for the task, if there is one."""
        return {} if self.task is None else {"reference": self.task}


def subject_of(
    model: Model | Subject,
    reference: object = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    environment: Mapping[str, str] | None = None,
) -> Subject:
    """Read a model, or take a loop's; what is given here wins over the loop's own options.

    Args:
        model: name, path of a model file, or a loop made by `ClosedLoop.load`.
        reference: an expression, data as in a model file, an array, or a function of t; see
            `ClosedLoop.simulate`.
        disturbance: one expression per state.
        saturation: ``compensator``, ``clip`` or ``braking``.
        environment: for compiler and cache folder.

    Raises:
        ModelError: the model cannot be found or read.
        UsageError: a loop that was not loaded from a model file.
    """
    if isinstance(model, Subject):  # its reference, disturbance and saturation are settled
        return model
    source = model.source if isinstance(model, ClosedLoop) else Source.of(model)
    if source is None:
        raise UsageError("was not loaded from a model file", where="model", remedy="use ClosedLoop.load")
    told: Reference = source.reference
    task = None
    if isinstance(reference, str | Mapping):
        told = reference
    elif reference is not None:  # data that a model file cannot hold: kernels for all data serve it
        told, task = {"steps": [[0.0, 0.0]]}, reference
    return Subject(
        Source(
            source.file,
            source.document,
            None,
            told,
            source.disturbance if disturbance is None else tuple(disturbance),
            source.saturation if saturation is None else saturation,
            source.environment if environment is None else environment,
        ),
        task,
    )
