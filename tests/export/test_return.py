"""Estimates at the end of a narrow range come back, in float as in double."""

from __future__ import annotations

import math
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.package import export_c
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import DOUBLE, FLOAT, Precision
from pmjoint_codegen.modelfile import model_of
from pmjoint_derive import derive

MODEL = Path(__file__).with_name("narrow-range.toml")
T, SUBSTEPS = 0.002, 10
TURN, SAMPLES = 4000, 6000  # the load is beyond the range up to the former


def estimates(precision: Precision, cache: Path) -> np.ndarray:
    """Drive the C: a load of 95, which no estimate within 83 to 87 explains, then one of 84."""
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    model = model_of(tomllib.loads(MODEL.read_text(encoding="utf-8")), str(MODEL))
    export = export_c(derive(model), Identity("narrow-range", "0" * 64, "test"), precision)
    loaded, x, found = Exported.load(export, compiler, cache), 1.5, []
    loaded.init(x, np.array([0.0, 2.2]))
    for k in range(SAMPLES):
        t, load = k * T, 95.0 if k < TURN else 84.0
        y_r = np.array([math.sin(t) + 0.3 * math.sin(4 * t), math.cos(t) + 1.2 * math.cos(4 * t)])
        assert loaded.step(x, y_r) == 0
        found.append(loaded.state.w_hat)
        for _ in range(SUBSTEPS):
            x += T / SUBSTEPS * (0.5 * x / (1 + x * x) + load - 60.0 * loaded.output.u - 0.7 * x)
    return np.array(found)


def test_an_estimate_comes_back_from_the_end_of_its_range_in_float_as_in_double(cache: Path) -> None:
    double, single = estimates(DOUBLE, cache), estimates(FLOAT, cache)
    step = 87.0 * FLOAT.roundoff
    assert 87.0 - double[TURN - 1] < step  # nearer to the end than a float can tell
    assert 83.9 < double[-1] < 84.3
    assert np.max(np.abs(single - double)) < 0.01
