"""``trajectory.mat``: a MAT-file of level 5 for MATLAB and GNU Octave.

It holds four structs: ``trajectory`` with a column vector for each column; ``units`` and ``meanings`` with a
text under the same fields; ``run`` with the model, its hash, the parameters and the summary as JSON text.
Text beyond ASCII, as in a unit of µV, is right in MATLAB; GNU Octave 7 cuts its last characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from io import BytesIO
from typing import BinaryIO, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.logs.trajectory import Trajectory, as_json

LONGEST: Final = 63  # characters of a MATLAB name
LARGEST: Final = 2**31 - 1  # bytes of a variable in a file of level 5
_HEADER: Final = 116  # bytes of text at the file's start, in which SciPy writes the time of day
_KEYWORDS: Final = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor persistent"  # noqa: SIM905 - words
    " return spmd switch try while".split()
)


def write(trajectory: Trajectory, stream: BinaryIO) -> None:
    """Write the file with SciPy, without the time of day.

    Raises:
        UsageError: more numbers than a file of level 5 can have.
    """
    from scipy.io import savemat

    if sum(column.values.nbytes for column in trajectory.columns) > LARGEST:
        raise UsageError(
            f"the run has {len(trajectory.t)} rows, more than a MAT-file of level 5 can have",
            remedy="choose a longer output step, or another format",
        )
    fields = names([column.name for column in trajectory.columns])
    columns = list(zip(fields, trajectory.columns, strict=True))
    parameters = zip(names(trajectory.parameters), trajectory.parameters.values(), strict=True)
    contents = {
        "trajectory": {field: np.ascontiguousarray(column.values) for field, column in columns},
        "units": {field: column.unit for field, column in columns},
        "meanings": {field: column.about for field, column in columns},
        "run": {
            "model": trajectory.model,
            "title": trajectory.title,
            "model_hash": trajectory.model_hash,
            "pmjoint_version": trajectory.version,
            "parameters": dict(parameters),
            "summary": as_json(trajectory.summary),
        },
    }
    buffer = BytesIO()
    savemat(buffer, contents, long_field_names=True, oned_as="column")
    buffer.seek(0)
    title = f"MATLAB 5.0 MAT-file, trajectory of {trajectory.model}, pmjoint-codegen {trajectory.version}"
    buffer.write(title.encode("ascii", "replace")[:_HEADER].ljust(_HEADER))
    stream.write(buffer.getbuffer())


def names(given: Iterable[str]) -> tuple[str, ...]:
    """Names that MATLAB takes as fields, as close to the given ones as it allows, no two the same."""
    found: list[str] = []
    for name in given:
        valid = re.sub(r"[^A-Za-z0-9_]", "_", name)
        valid = valid if valid[:1].isalpha() else f"x{valid}"
        valid = f"{valid}_" if valid in _KEYWORDS else valid[:LONGEST]
        number = 2
        unique = valid
        while unique in found:
            unique = f"{valid[: LONGEST - 1 - len(str(number))]}_{number}"
            number += 1
        found.append(unique)
    return tuple(found)
