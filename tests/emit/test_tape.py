"""Tapes say what CasADi's functions do: rebuilt from text, they give the same bits."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit.functions import build_functions
from pmjoint_codegen.emit.tape import tapes_of
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import read_tapes, write_tapes
from pmjoint_derive import Derivation


def test_every_kernel_rebuilt_from_its_tape_gives_the_same_bits(paper: Derivation) -> None:
    functions = build_functions(paper, 8)
    tapes = read_tapes(write_tapes(tapes_of(functions.values())))
    generator = np.random.default_rng(1)
    assert list(tapes) == list(functions)
    for name, function in functions.items():
        again = rebuild(tapes[name])
        assert (again.name_in(), again.name_out()) == (function.name_in(), function.name_out())
        for _ in range(5):
            point = [generator.normal(scale=3.0, size=function.size1_in(i)) for i in range(function.n_in())]
            first, second = (
                np.concatenate([np.array(out) for out in f.call(point)]) for f in (function, again)
            )
            np.testing.assert_array_equal(first, second)


def test_all_operations_survive() -> None:
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    values = [-a, a * a, 2 * a, 1 / a, ca.sqrt(a), ca.sin(a), ca.cos(a), ca.tan(a), ca.tanh(a), ca.exp(a)]
    values += [ca.log(a), a + b, a - b, a * b, a / b, a**2.5, a**b, ca.fmin(a, b), ca.fmax(a, b), ca.SX(0.1)]
    values += [ca.fabs(b - 2), ca.sign(a - 1)]
    function = ca.Function("f", [x], [ca.vertcat(*values)], ["x"], ["y"])
    again = rebuild(read_tapes(write_tapes(tapes_of([function])))["f"])
    np.testing.assert_array_equal(np.array(again([0.7, 1.3])), np.array(function([0.7, 1.3])))


def test_an_operation_without_a_name_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(ModelError, match="kernel f"):
        tapes_of([ca.Function("f", [x], [ca.floor(x)])])
