"""Evaluation of v of (29) alone: one call, many values at once, and a step of the sampled controller."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np
import sympy as sp

from benchmarks import paper
from benchmarks.clock import interleaved
from benchmarks.paper import PLANT, STATES, Array, Sines
from benchmarks.peers.solver import load
from benchmarks.reference import ROOT
from benchmarks.report import Row, Section
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import read_tapes
from pmjoint_codegen.simulate.settings import make_settings

MANY: Final = 10_000
LAW: Final = "ours, ClosedLoop.law"
IN_PLACE: Final = "ours, in place"
CONTROL: Final = "ClosedLoop.control"
STEP: Final = "ours, Controller.step"
AGREEMENT: Final = 1e-9  # relative to the largest |v|
Calls = dict[str, Callable[[], Any]]


def run(quick: bool, folder: Path) -> Section:
    """Measure; build CasADi's C in `folder`."""
    section = Section(
        "Evaluation of v alone",
        "(29) of the paper's model from y, the controller's states, y_r and its derivatives: a call "
        f"with NumPy arrays, and one value out of {MANY} in one call. Ours: `law = ClosedLoop.law()`, "
        "called as `law(state, y, reference)`; in place, the arguments stand in its arrays already, as "
        "they do for CasADi's buffers. lambdify shares common subexpressions. CasADi's C for `external` is "
        "built with -O3 -march=native, ours without contraction for any processor. lambdify, numba and JAX "
        "are given gains and parameters as numbers; ours and CasADi take all of p. One call of ours gives z "
        "and alpha too. `Controller.step(y)` also evaluates the reference and updates the state.",
    )
    loop = ClosedLoop.load("paper", evaluator="compiled")
    states = np.random.default_rng(3).normal(size=(MANY, len(STATES)))
    t = np.random.default_rng(4).uniform(0.0, 20.0, MANY)
    references = np.stack([np.sin(t), np.cos(t), -np.sin(t)], axis=1)
    single = _single(loop, states[0], references[0], folder, section.absent)
    many = _many(loop, states, references, section.absent)
    _check(single | many, many[CONTROL](), single[LAW]())
    rounds = 5 if quick else 31
    one = interleaved(single, rounds, burst=200)
    for name in list(one)[1:]:
        in_place = name.endswith("buffer")
        ours = IN_PLACE if in_place else LAW
        if name != ours:
            section.add(Row("one call, in place" if in_place else "one call", one[ours], name, one[name]))
    section.add(Row("one call", one[LAW], "a microsecond", 1e-6, 1.0))
    controller = loop.controller()
    step = interleaved({STEP: lambda: controller.step(0.3)}, rounds, burst=200)[STEP]
    section.add(Row("one step of the sampled controller", step, "two microseconds", 2e-6, 1.0))
    batched = interleaved(many, rounds)
    for name in list(batched)[1:]:
        section.add(Row("one value of many", batched[CONTROL] / MANY, name, batched[name] / MANY))
    return section


def _single(loop: ClosedLoop, X: Array, y_r: Array, folder: Path, absent: list[str]) -> Calls:
    s, y, p = X[2:].copy(), X[:1].copy(), make_settings(loop.manifest).p
    law, at, prepared = loop.law(), float(y[0]), loop.law()
    prepared(s, at, y_r)
    calls: Calls = {
        LAW: lambda: law(s, at, y_r),
        IN_PLACE: prepared.evaluate,
        f"ours, {CONTROL}": lambda: loop.control(s, at, y_r),
    }
    written = _lambdified("math")
    arguments = [*X.tolist(), *y_r.tolist()[:2]]
    calls["lambdify, math"] = lambda: written(*arguments)
    graph = _casadi_law()
    given = [ca.DM(item) for item in (y, s, y_r, p)]
    calls["CasADi interpreted, DM"] = lambda: graph(*given)[2]
    calls["CasADi interpreted, buffer"] = _buffered(graph, y, s, y_r, p)
    try:
        outer = _external(graph, folder)
        calls["casadi.external, DM"] = lambda: outer(*given)[2]
        calls["casadi.external, buffer"] = _buffered(outer, y, s, y_r, p)
    except (OSError, subprocess.CalledProcessError) as error:
        absent.append(f"casadi.external: {error}")
    try:
        compiled = _numba()
        calls["numba"] = lambda: compiled(X, y_r)
    except ImportError as error:
        absent.append(f"numba: no {error.name}")
    return calls


def _many(loop: ClosedLoop, X: Array, y_r: Array, absent: list[str]) -> Calls:
    s, y, p = X[:, 2:].copy(), X[:, :1].copy(), make_settings(loop.manifest).p
    written = _lambdified("numpy")
    columns = [*np.ascontiguousarray(X.T), *np.ascontiguousarray(y_r.T)[:2]]
    mapped = _casadi_law().map(MANY)
    given = [ca.DM(item.T) for item in (y, s, y_r)]
    repeated = ca.DM(np.tile(p[:, np.newaxis], (1, MANY)))
    calls: Calls = {
        CONTROL: lambda: loop.control(s, y[:, 0], y_r),
        "lambdify, numpy": lambda: written(*columns),
        "CasADi interpreted, map": lambda: mapped(*given, repeated)[2],
    }
    try:
        from benchmarks.peers import jax_loop

        calls["JAX, vmap"] = jax_loop.control_many(X, y_r)
    except ImportError as error:
        absent.append(f"JAX: no {error.name}")
    return calls


def _check(calls: Calls, many: Array, one: Array) -> None:
    """Make sure that all compute the same; CasADi's buffers hold theirs until asked."""
    for name, call in calls.items():
        found = np.asarray(call(), dtype=float).reshape(-1)
        expected = many.reshape(-1) if found.size > 1 else np.asarray(one).reshape(-1)
        if not np.abs(found - expected).max() <= AGREEMENT * np.abs(many).max():
            raise SystemExit(f"benchmarks: {name} computes another v")


def _lambdified(module: str) -> Callable[..., Any]:
    X = sp.symbols(STATES)
    y_r, rate = sp.symbols("y_r rate")
    v = paper.control(X, Sines(y_r, rate, None), *(sp.Float(value) for value in PLANT[:2]))
    written: Callable[..., Any] = sp.lambdify([*X, y_r, rate], v, modules=module, cse=True)
    return written


def _casadi_law() -> Any:
    tapes = read_tapes((ROOT / "generated" / "paper" / "kernels.tape").read_text(encoding="utf-8"))
    return rebuild(tapes["law"])


def _buffered(function: Any, *arguments: Array) -> Callable[[], Array]:
    """Return a call through CasADi's buffers, its fastest way from Python."""
    buffer, trigger = function.buffer()
    outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, item in enumerate(arguments):
        buffer.set_arg(i, item.data)
    for i, item in enumerate(outputs):
        buffer.set_res(i, item.data)

    def call(_keep: object = (buffer, arguments)) -> Array:
        trigger()
        return outputs[2]

    return call


def _external(law: Any, folder: Path) -> Any:
    generator = ca.CodeGenerator("law_external.c")
    generator.add(law)
    generator.generate(f"{folder}/")
    source, target = folder / "law_external.c", folder / "law_external.so"
    command = [*os.environ.get("CC", "cc").split(), "-O3", "-march=native", "-fPIC", "-shared"]
    subprocess.run([*command, str(source), "-o", str(target), "-lm"], check=True, capture_output=True)
    return ca.external(law.name(), str(target))


def _numba() -> Callable[[Array, Array], float]:
    numba = load("numba")

    control = numba.njit(paper.control)
    sines, (d1, b0) = Sines, PLANT[:2]

    def law(X: Array, y_r: Array) -> float:
        known = sines(y_r[0], y_r[1], 0.0)
        all_ = (X[0], X[1], X[2], X[3], X[4], X[5], X[6], X[7], X[8], X[9])
        result: float = control(all_, known, d1, b0)
        return result

    compiled: Callable[[Array, Array], float] = numba.njit(law)
    return compiled
