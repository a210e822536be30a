"""``trajectory.parquet``: columns of doubles, for PlotJuggler and for tables of any language.

PlotJuggler asks for the column of the time, which is ``t``. Each field has the metadata ``unit`` and
``description``; the schema has those of `Trajectory.metadata`. In a data frame of pandas, ``attrs["units"]``
has the units, as in `Run.to_dataframe`.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from pmjoint_codegen.logs.trajectory import Trajectory, as_json


def write(trajectory: Trajectory, stream: BinaryIO) -> None:
    """Write the table with pyarrow."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = [
        pa.field(
            column.name,
            pa.float64(),
            nullable=False,
            metadata={"unit": column.unit, "description": column.about},
        )
        for column in trajectory.columns
    ]
    attributes = {"model": trajectory.model, "units": {item.name: item.unit for item in trajectory.columns}}
    metadata = {**trajectory.metadata(), "PANDAS_ATTRS": as_json(attributes)}
    schema = pa.schema(fields, metadata=metadata)
    arrays = [pa.array(np.ascontiguousarray(column.values)) for column in trajectory.columns]
    # Trajectories hardly ever repeat a value: a dictionary of them would only grow the file.
    pq.write_table(pa.Table.from_arrays(arrays, schema=schema), stream, use_dictionary=False)
