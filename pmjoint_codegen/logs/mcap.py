"""``trajectory.mcap``: JSON messages that Foxglove plots as they stand, a topic for each part of the loop.

A message has the time t in s and the topic's columns; its log time is t in ns. The JSON schema of a topic
has the unit and the meaning of each column. The metadata record ``run`` has those of `Trajectory.metadata`,
and the summary is attached as ``summary.json``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import BinaryIO, Final

from pmjoint_codegen.logs.trajectory import Column, Trajectory, as_json

NANOSECONDS: Final = 1e9
_ROWS: Final = 4096  # turned into numbers of Python at a time


def write(trajectory: Trajectory, stream: BinaryIO) -> None:
    """Write the file with the mcap package; messages of all topics stand in the order of time."""
    from mcap.writer import Writer

    writer = Writer(stream)
    writer.start(profile="", library=f"pmjoint-codegen {trajectory.version}")
    writer.add_metadata("run", trajectory.metadata())
    summary = json.dumps(trajectory.summary, indent=1, ensure_ascii=False) + "\n"
    writer.add_attachment(0, 0, "summary.json", "application/json", summary.encode())
    channels = []
    for group, columns in trajectory.groups.items():
        schema = writer.register_schema(
            f"pmjoint.{group}", "jsonschema", as_json(schema_of((trajectory.columns[0], *columns))).encode()
        )
        channel = writer.register_channel(f"/{group}", "json", schema)
        channels.append((channel, [column.name for column in columns], columns))
    for start in range(0, len(trajectory.t), _ROWS):
        part = slice(start, start + _ROWS)
        rows = [
            (channel, names, zip(*(column.values[part].tolist() for column in columns), strict=True))
            for channel, names, columns in channels
        ]
        for sequence, t in enumerate(trajectory.t[part].tolist(), start=start):
            stamp = round(t * NANOSECONDS)
            for channel, names, values in rows:
                message = _message(t, names, next(values))
                writer.add_message(channel, stamp, message, stamp, sequence)
    writer.finish()  # type: ignore[no-untyped-call]


def schema_of(columns: Sequence[Column]) -> dict[str, object]:
    """The JSON schema of a topic's messages."""
    return {
        "type": "object",
        "properties": {
            column.name: {
                "type": "number",
                "description": f"{column.about} [{column.unit}]",
                "unit": column.unit,
            }
            for column in columns
        },
    }


def _message(t: float, names: Sequence[str], values: Sequence[float]) -> bytes:
    """One message. JSON has no infinities, in which a failed run may end: such values are left out."""
    seen = {name: value for name, value in zip(names, values, strict=True) if math.isfinite(value)}
    return json.dumps({"t": t, **seen}, separators=(",", ":")).encode()
