"""Compact Taylor code: small, at the full order, and the same numbers as straight lines."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.compile.library import LIBRARY, build
from pmjoint_codegen.emit.compact import Compact, compact_function, compact_where_long, literally
from pmjoint_codegen.emit.functions import build_functions
from pmjoint_codegen.emit.pipeline import TAYLOR_ORDER, Artifacts, generate
from pmjoint_codegen.emit.scalar_text import HELPERS, compact_kernel
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.emit.taylor import taylor_function
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Derivation, derive

Array = npt.NDArray[np.float64]
POINTS = 20


@pytest.fixture(scope="module")
def file(root: Path) -> Path:
    """A third-order model whose phi and sigma are rational, logarithmic and hyperbolic."""
    return root / "tests" / "reference" / "third-nonlinear.toml"


@pytest.fixture(scope="module")
def third(file: Path) -> Artifacts:
    """What it generates."""
    document = read_document(file)
    return generate(document, model_of(document, str(file)))


@pytest.fixture(scope="module")
def loop(file: Path) -> ca.Function:
    """Its closed loop inside one saturation mode."""
    derivation = derive(model_of(read_document(file), str(file)))
    return build_functions(derivation, 2)["closed_loop"]


@pytest.fixture(scope="module")
def compact(loop: ca.Function) -> Compact:
    """Its Taylor kernel in two phases an order."""
    return compact_function("taylor", loop, TAYLOR_ORDER, state="X")


def points(function: ca.Function) -> Iterator[list[Array]]:
    """Arguments of a function, drawn."""
    random = np.random.default_rng(5)
    for _ in range(POINTS):
        yield [random.uniform(-1.0, 1.5, function.size1_in(i)) for i in range(function.n_in())]


def test_a_large_model_is_small_at_the_full_order(third: Artifacts) -> None:
    sizes = {name: len(text.encode()) for name, text in third.files.items()}
    assert third.manifest.order == TAYLOR_ORDER
    assert sum(size for name, size in sizes.items() if name in ("kernels.c", "loops.c")) <= 400_000
    assert sizes["lanes.c"] <= 500_000


def test_a_small_model_stays_straight_lines(paper: Derivation, artifacts: Artifacts) -> None:
    loop = build_functions(paper, 2)["closed_loop"]
    assert compact_where_long("taylor", loop, TAYLOR_ORDER, state="X") is None
    assert all("taylor_rise" not in text for text in artifacts.files.values())


def test_compact_code_agrees_with_straight_lines(loop: ca.Function, compact: Compact) -> None:
    """Row by row, within the roundings of sums that add up in another order."""
    straight, unrolled = taylor_function("taylor", loop, TAYLOR_ORDER, state="X"), compact.unrolled()
    for point in points(loop):
        one, other = (
            np.array(function.call(point)[0]).reshape(TAYLOR_ORDER + 1, -1)
            for function in (straight, unrolled)
        )
        size = np.abs(one).max(axis=1, keepdims=True)
        assert np.all(np.abs(one - other) <= 2e-12 * size)


def test_first_coefficients_are_derivatives_along_the_loop(loop: ca.Function, compact: Compact) -> None:
    """Of X, v and e, against algorithmic differentiation of the right-hand side."""
    inputs = [ca.SX.sym(label, loop.size1_in(i)) for i, label in enumerate(loop.name_in())]
    t, X = inputs[:2]
    rates, *others = loop.call(inputs)
    channels = ca.vertcat(X, *others)
    slopes = ca.Function("slopes", inputs, [ca.jtimes(channels, X, rates) + ca.jacobian(channels, t)])
    unrolled = compact.unrolled()
    for point in points(loop):
        expected = np.array(slopes.call(point)[0]).ravel()
        found = np.array(unrolled.call(point)[0]).reshape(TAYLOR_ORDER + 1, -1)[1]
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("order", [1, 2, 7, TAYLOR_ORDER])
def test_compiled_code_has_the_bits_of_the_unrolled_function(
    loop: ca.Function, order: int, tmp_path: Path
) -> None:
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    compact = compact_function("taylor", loop, order, state="X")
    unrolled = compact.unrolled()
    source = f"#include <math.h>\n{HELPERS}\n{compact_kernel(tape_of(unrolled), compact)}\n"
    tmp_path.chmod(0o700)
    kernel = ctypes.CDLL(
        str(build({"taylor.c": source.encode()}, compiler, tmp_path) / LIBRARY)
    ).pmjoint_taylor
    pointer = ctypes.POINTER(ctypes.c_double)
    for point in points(loop):
        found = np.full(unrolled.numel_out(0), np.nan)
        arguments = (pointer * len(point))(*(array.ctypes.data_as(pointer) for array in point))
        kernel(arguments, (pointer * 1)(found.ctypes.data_as(pointer)), None, None, 0)
        expected = np.array(unrolled.call(point)[0]).ravel()
        np.testing.assert_array_equal(found.view(np.int64), expected.view(np.int64))


def test_the_interpreter_keeps_every_operation(compact: Compact) -> None:
    """With CasADi's rules on, ``x (1/y)`` would become ``x/y``."""
    unrolled = compact.unrolled()
    again = rebuild(tape_of(unrolled))
    for point in points(unrolled):
        one, other = (np.array(function.call(point)[0]).ravel() for function in (unrolled, again))
        np.testing.assert_array_equal(one.view(np.int64), other.view(np.int64))


def test_casadi_simplifies_again_afterwards() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    with pytest.raises(ZeroDivisionError), literally():
        assert str(x * (1 / y)) != str(x / y)
        raise ZeroDivisionError
    assert str(x * (1 / y)) == str(x / y)
