"""Objectives: what the language means, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.tune.objective import read_objective


def test_a_weighted_sum_is_what_it_says() -> None:
    metrics = np.arange(20.0).reshape(2, 10)
    objective = read_objective("2*(ise + 0.25*max_abs_v)/4 - -settling_s")
    expected = 0.5 * metrics[:, Column.ISE] + 0.125 * metrics[:, Column.MAX_ABS_V]
    np.testing.assert_array_equal(objective(metrics), expected + metrics[:, Column.SETTLING_S])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1",
        "ise + 1",
        "-ise",
        "ise - 2*max_abs_v",
        "ise*ise",
        "1/ise",
        "ise/0",
        "ise**2",
        "status",
        "ise + nothing",
        "__import__('os')",
        "ise if 1 else 2",
        "1e400*ise",
        "True*ise",
        "ise +",
        "(" * 150 + "ise",
        "ise" + " + ise" * 100,
    ],
)
def test_what_is_no_weighted_sum_of_metrics_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--objective"):
        read_objective(text)
