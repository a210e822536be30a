"""The errors z obey their own equation in simulation, whatever the actuator's limit: every shipped model."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.check.oracles.truth import estimation_errors
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.workspace import find_model
from pmjoint_derive import Derivation, Model, derive, real_symbol

MODELS = sorted(path.stem for path in (Path(__file__).parents[2] / "models").glob("*.toml"))
STEP = 2e-4  # s


@cache
def derived(name: str) -> Derivation:
    """The derivation of a shipped model, made once a session."""
    path = find_model(name)
    return derive(model_of(read_document(path), str(path)))


def rates(values: Array) -> Array:
    """Central differences of fourth order at the inner rows."""
    return (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * STEP)


def column(run: Run, model: Model, name: str) -> Array:
    if not name.startswith("epsilon"):
        return run[name]
    if model.adaptation is None:
        return run[f"x{name[7:]}"] - run[f"x_hat{name[7:]}"]
    return estimation_errors(run, model)[:, int(name[7:]) - 1]  # with the true values, which no run knows


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("share", [1.0, 0.2])
def test_z_obeys_its_equation(name: str, share: float) -> None:
    derivation = derived(name)
    model = derivation.model
    loop = ClosedLoop.load(name)
    limit = {item.name: item.value for item in loop.manifest.parameters}[loop.manifest.limit] * share
    run = loop.simulate(
        horizon=0.4,
        output_step=STEP,
        parameters={loop.manifest.limit: limit},
        tolerance=1e-13,
        controller="continuous",
    )
    numbers = {real_symbol(key): value for key, value in run.settings.parameters.items()}
    for i in range(1, loop.manifest.rho + 1):
        wanted = derivation.expanded(f"z{i}_dot").xreplace(numbers)
        symbols = sorted(wanted.free_symbols, key=str)
        reference = derivation.equations
        columns = [
            np.array([float(reference[s.name].expression.subs(real_symbol("t"), t)) for t in run.t])
            if s.name.endswith("y_r") and s.name != "y_r"
            else column(run, model, s.name)
            for s in symbols
        ]
        expected = np.broadcast_to(sp.lambdify(symbols, wanted)(*columns), run.t.shape)[2:-2]
        found = rates(run[f"z{i}"])
        quiet = np.ones(found.shape, dtype=bool)
        for t, _ in run.switches:  # z'' jumps there, and differences across the jump are of first order
            quiet &= np.abs(run.t[2:-2] - t) > 3 * STEP
        scale = np.max(np.abs(expected)) + np.max(np.abs(run[f"z{i}"])) / STEP * 1e-6
        assert np.max(np.abs(found - expected)[quiet]) <= 1e-5 * scale
