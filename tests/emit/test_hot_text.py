"""The printed C of the Taylor kernels: the same operations as the interpreter's, in plain straight lines."""

from __future__ import annotations

import re

import casadi as ca
import pytest

from pmjoint_codegen.emit.hot_text import hot_source
from pmjoint_codegen.errors import ModelError


def function(entries: ca.SX, x: ca.SX, t: ca.SX) -> ca.Function:
    return ca.Function("f", [t, x], [entries], ["t", "x"], ["c"])


def test_every_entry_is_read_once_and_every_value_written_once() -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    text = hot_source(function(ca.vertcat(ca.sin(x[1]) * t, ca.cos(x[1]) + t, x[0] / 3), x, t))
    assert re.findall(r"= (arg\[\d\]\[\d\]);", text).count("arg[1][1]") == 1
    names = re.findall(r"const double (\w+) =", text)
    assert len(names) == len(set(names))
    assert [int(place) for place in re.findall(r"c\[(\d)\] = ", text)] == [0, 1, 2]
    assert "/* f:(t,x[2])->(c[3]) */" in text
    assert "if (sz_arg) *sz_arg = 2;" in text


def test_literals_round_trip() -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    text = hot_source(function(ca.vertcat(x[0] * (1 / 3), t * 1e-300), x, t))
    assert {float(found) for found in re.findall(r"\d\.\d{16}e[+-]\d+", text)} == {1 / 3, 1e-300}


def test_an_operation_without_a_form_is_refused() -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    with pytest.raises(ModelError, match="no form in C"):
        hot_source(function(ca.erf(x[0]), x, t))
