"""The sampled loop's two functions: the rows that they are composed from, and the C that a loop takes in."""

from __future__ import annotations

import ctypes
import math
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit.functions import build_functions
from pmjoint_codegen.emit.pipeline import Artifacts
from pmjoint_codegen.emit.sampling import HOLD_ORDER, PLANT_ORDER, SAMPLED, sampled_sizes
from pmjoint_codegen.emit.scalar_text import sampled_header, wrapper
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_derive import Derivation

EPSILON = np.finfo(float).eps
SPECIAL = (0.0, -0.0, 1.5, -2.0, math.inf, -math.inf, math.nan)


@pytest.fixture(scope="module")
def kernels(paper: Derivation) -> dict[str, ca.Function]:
    return build_functions(paper, 2)


def point(function: ca.Function, seed: int) -> list[np.ndarray]:
    generator = np.random.default_rng(seed)
    return [generator.uniform(0.5, 2.0, function.size1_in(i)) for i in range(function.n_in())]


def close(found: np.ndarray, wanted: np.ndarray, operations: int) -> bool:
    """Equal up to one rounding an operation, relative to the largest entry."""
    return bool(np.max(np.abs(found - wanted)) <= operations * EPSILON * max(1.0, np.max(np.abs(wanted))))


@pytest.mark.parametrize("seed", range(5))
def test_one_sample_is_the_law_the_actuator_the_plant_and_the_update(
    kernels: dict[str, ca.Function], seed: int
) -> None:
    t, X, h, p = point(kernels["sample"], seed)
    v, w, c, s_next = (np.array(part).ravel() for part in kernels["sample"](t, X, h, p))
    y_r = kernels["reference"](t, p)
    wanted = float(kernels["law"](X[0], X[2:], y_r, p)[2])
    assert close(v, np.array([wanted]), 300)
    assert w[0] == pytest.approx(np.clip(wanted, -p[2], p[2]), rel=300 * EPSILON)
    coefficients = c.reshape(HOLD_ORDER + 1, 3)
    assert np.array_equal(coefficients[0], [*X[:2], X[0] - np.sin(t[0])])
    rates, e = (np.array(part).ravel() for part in kernels["plant"](t, X[:2], w, p))
    assert close(coefficients[1, :2], rates, 100)
    assert np.array_equal(coefficients[0, 2:], e)
    assert close(s_next, np.array(kernels["sampled_update"](X[0], X[2:], y_r, w[0], v, h, p)).ravel(), 300)
    more = np.array(kernels["plant_taylor"](t, X[:2], w, p)).reshape(PLANT_ORDER + 1, 3)
    assert close(more[: HOLD_ORDER + 1], coefficients, 300)


def test_the_error_is_a_channel_of_its_own(kernels: dict[str, ca.Function]) -> None:
    t, x, w, p = point(kernels["plant_taylor"], 3)
    c = np.array(kernels["plant_taylor"](t, x, w, p)).reshape(PLANT_ORDER + 1, 3)
    k = np.arange(PLANT_ORDER + 1)
    sine = np.sin(t[0] + k * np.pi / 2) / np.cumprod(np.maximum(k, 1))  # coefficients of y_r = sin t
    assert close(c[:, 2], c[:, 0] - sine, 100)


def test_the_header_holds_sizes_and_the_function(
    artifacts: Artifacts, paper: Derivation, kernels: dict[str, ca.Function]
) -> None:
    header = artifacts.files["sampled.h"]
    for name, size in sampled_sizes(vocabulary(paper), kernels).items():
        assert f"#define {name} {size}\n" in header
    for name in SAMPLED:
        assert header.count(f"static inline void pmj_{name}(") == 1
        assert artifacts.files["loops.c"].count(f"    pmj_{name}(arg[0]") == 1
    assert all(len(line) <= 120 for line in header.splitlines())


def test_every_operation_is_that_of_the_interpreter(tmp_path: Path) -> None:
    """Bit for bit, at zeros of either sign, infinities and NaN; their bits alone may be others."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    entries = [
        *(x + y, x - y, x * y, x / y, -x, 2 * x, x * x, 1 / x, ca.fmin(x, y), ca.fmax(x, y), ca.fabs(x)),
        *(ca.sign(x), ca.sqrt(x), ca.sin(x), ca.cos(x), ca.tan(x), ca.tanh(x), ca.exp(x), ca.log(x), x**1.7),
        *(ca.atan(x), ca.sinh(x), ca.cosh(x)),
    ]
    function = ca.Function("f", [x, y], [ca.vertcat(*entries)], ["x", "y"], ["z"])
    text = sampled_header([tape_of(function)], {}, "") + wrapper(tape_of(function))
    (tmp_path / "f.c").write_text(text)
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
    subprocess.run(["cc", *flags, "f.c", "-o", "f.so", "-lm"], cwd=tmp_path, check=True)
    call, pointer = ctypes.CDLL(str(tmp_path / "f.so")).pmjoint_f, ctypes.POINTER(ctypes.c_double)
    for a in SPECIAL:
        for b in SPECIAL:
            found = np.empty(len(entries))
            arguments = [np.array([a]), np.array([b])]
            arg = (pointer * 2)(*(array.ctypes.data_as(pointer) for array in arguments))
            assert call(arg, (pointer * 1)(found.ctypes.data_as(pointer)), None, None, 0) == 0
            wanted = np.array(function(a, b)).ravel()
            differing = found.view(np.int64) != wanted.view(np.int64)
            assert not np.any(differing & ~(np.isnan(found) & np.isnan(wanted))), (a, b)
