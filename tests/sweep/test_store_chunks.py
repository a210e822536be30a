"""What counts as a chunk that is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.sweep.chunks import Result
from pmjoint_codegen.sweep.store import Store

from .conftest import Case


@pytest.mark.parametrize("columns", [1, 0, -1])
def test_a_chunk_of_another_shape_is_made_again(case: Case, tmp_path: Path, columns: int) -> None:
    """Such as one that another version, with other metrics, has left."""
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    first, *others = store.starts()
    table = np.zeros((store.length(first), len(Column) + store.size + columns))
    store.keep(first, Result(table, np.empty(0)))
    assert store.missing() == (others if columns == 0 else [first, *others])


def test_a_chunk_that_is_cut_short_is_made_again(case: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    first = store.starts()[0]
    store.keep(first, Result(np.zeros((store.length(first), len(Column) + store.size)), np.empty(0)))
    (file,) = (tmp_path / "chunks").glob("*.npy")
    file.write_bytes(file.read_bytes()[:-8])
    assert first in store.missing()
