"""Loops, laws and runs in other processes: copied by model and settings, not by what belongs to a process."""

from __future__ import annotations

import copy
import multiprocessing
import os
import pickle
import shutil
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, SimulationError
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.law import Law


@pytest.fixture(params=["compiled", "interpreted"])
def loop(request: pytest.FixtureRequest, root: Path, tmp_path: Path, cache: Path) -> ClosedLoop:
    """A loop whose model file is gone once it is loaded."""
    pytest.importorskip("casadi")
    if request.param == "compiled" and find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    file = tmp_path / "paper.toml"
    shutil.copy(root / "models" / "paper.toml", file)
    loop = ClosedLoop.load(file, request.param, reference="0.3*sin(2*t)", notify=lambda line: None)
    file.unlink()
    return loop


def last_state(loop: ClosedLoop) -> bytes:
    """The end of a short run, bit for bit."""
    state: bytes = loop.simulate(horizon=0.5).states[-1].tobytes()
    return state


def value_of(law: Law) -> float:
    """The law's value at one state."""
    return law([0.1] * len(law.s), 0.2, [0.3] * len(law.y_r))


def test_a_copy_is_the_same_loop(loop: ClosedLoop) -> None:
    wanted = last_state(loop)
    for other in (pickle.loads(pickle.dumps(loop)), copy.deepcopy(loop), copy.copy(loop)):
        assert other.evaluator.kind == loop.evaluator.kind
        assert other.manifest == loop.manifest
        assert last_state(other) == wanted
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(loop))))
    assert last_state(again) == wanted


def test_a_law_is_copied_with_its_parameters_and_not_its_arrays(loop: ClosedLoop) -> None:
    law = loop.law(parameters={"c1": 20.0})
    wanted = value_of(law)
    for other in (pickle.loads(pickle.dumps(law)), copy.deepcopy(law)):
        assert not np.shares_memory(other.s, law.s)
        assert value_of(other) == wanted != value_of(loop.law())


def test_a_pool_of_new_processes_takes_loops_and_laws_and_gives_runs(loop: ClosedLoop) -> None:
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        run = pool.submit(loop.simulate, horizon=0.5).result()
        value = pool.submit(value_of_law, loop.law()).result()
        failed = pool.submit(loop.simulate, horizon=0.5, divergence=1.6, x0=[1.5, 50.0]).exception()
    assert run.states[-1].tobytes() == last_state(loop)
    assert run.summary["ise"] == loop.simulate(horizon=0.5).summary["ise"]
    assert value == value_of(loop.law())
    assert isinstance(failed, SimulationError) and failed.run is not None


def value_of_law(law: Law) -> float:
    """The same in the pool's process, and once more through what the law alone has."""
    assert law.evaluate() == law.evaluate()
    return value_of(law)


def test_an_evaluator_of_unknown_origin_says_so(loop: ClosedLoop) -> None:
    bare = copy.copy(loop.evaluator)
    bare.recipe = None
    with pytest.raises(TypeError, match=r"ClosedLoop\.load"):
        pickle.dumps(bare)
