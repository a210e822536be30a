"""The printed C of the Taylor kernel: the interpreter's operations, in one straight line."""

from __future__ import annotations

import re

import casadi as ca

from pmjoint_codegen.emit.scalar_text import straight_kernel
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.kernels.tape import Tape


def tape(entries: ca.SX, x: ca.SX, t: ca.SX) -> Tape:
    return tape_of(ca.Function("f", [t, x], [entries], ["t", "x"], ["c"]))


def test_every_entry_is_read_once_and_every_value_written_once() -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    text = straight_kernel(tape(ca.vertcat(ca.sin(x[1]) * t, ca.cos(x[1]) + t, x[0] / 3), x, t))
    assert sorted(re.findall(r"= (arg\[\d\]\[\d\]);", text)) == ["arg[0][0]", "arg[1][0]", "arg[1][1]"]
    names = re.findall(r"const double (\w+) =", text)
    assert len(names) == len(set(names))
    assert [int(place) for place in re.findall(r"c\[(\d)\] = ", text)] == [0, 1, 2]
    assert "*sz_arg = 2;" in text and "*sz_res = 1;" in text


def test_literals_round_trip() -> None:
    t, x = ca.SX.sym("t"), ca.SX.sym("x", 2)
    text = straight_kernel(tape(ca.vertcat(x[0] * (1 / 3), t * 1e-300), x, t))
    assert {float(found) for found in re.findall(r"[\d.]+e-\d+|\d\.\d{9,}", text)} == {1 / 3, 1e-300}
