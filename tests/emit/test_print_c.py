"""The printer: one value a line, and no literal but those that the dialect writes."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import pytest

from pmjoint_codegen.emit.lane_text import dialect as lanes
from pmjoint_codegen.emit.print_c import Dialect, definition, print_c, signature
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.operations import OPERATIONS

CALL = re.compile(r"\b([a-z]\w*)\(")
STRICT = ["-std=c99", "-Wdouble-promotion", "-Wunsuffixed-float-constants", "-Wconversion", "-Werror"]


def floats(literal: str = "f") -> Dialect:
    """Single precision: C's functions and literals with an f at their end."""
    return Dialect(
        "float",
        spelling=lambda operation: CALL.sub(r"\1f(", operation.scalar),
        literal=lambda value: f"{value!r}{literal}",
    )


def everything() -> Tape:
    """A tape with every operation, on variables and beside literals."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    entries = [
        *(x + y, x - y, x * y, x / y, -x, 2 * x, x * x, 1 / x, x**1.7, ca.fmin(x, 0.5), ca.fmax(0.25, y)),
        *(item.of(ca)(x) for item in OPERATIONS if item.arity == 1 and item.apply is None),
        *(y + 0.1, 1e-7 - x, 3 / y, 1e20 * x, ca.SX(0.75)),
    ]
    return tape_of(ca.Function("f", [x, y], [ca.vertcat(*entries)], ["x", "y"], ["z"]))


def unit(dialect: Dialect) -> str:
    """The tape as a function, with declarations of what C has not."""
    tape = everything()
    declared = ["#include <math.h>", "float pmj_fminf(float, float);", "float pmj_fmaxf(float, float);"]
    head = signature(tape, "void f(", dialect.number)
    return (
        "\n".join(
            [*declared, "float pmj_signf(float);", f"{head};", definition(tape, head, print_c(tape, dialect))]
        )
        + "\n"
    )


def accepted(text: str, folder: Path) -> bool:
    """Whether a compiler finds neither a double literal nor an expression in double precision."""
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    (folder / "f.c").write_text(text)
    return not subprocess.run(["gcc", *STRICT, "-fsyntax-only", "f.c"], cwd=folder, check=False).returncode


def test_the_tape_holds_every_operation() -> None:
    names = {item.operation for item in everything().instructions} - {"input", "const", "output"}
    assert names == {item.name for item in OPERATIONS}


def test_a_dialect_of_floats_never_becomes_double(tmp_path: Path) -> None:
    text = unit(floats())
    assert "1.0f / x[0]" in text and "0.1f" in text and "1e-07f" in text and "= 0.75f;" in text
    body = text.partition("{")[2]
    literals = re.findall(r"(?<![\w.\[])(\d+(?:\.\d+)?(?:e[-+]?\d+)?\w*)(?![\w\]])", body)
    assert len(literals) > 5 and all(literal.endswith("f") for literal in literals)
    assert accepted(text, tmp_path)


def test_a_literal_of_double_precision_would_be_seen(tmp_path: Path) -> None:
    assert not accepted(unit(floats("")), tmp_path)


def test_literals_inside_a_spelling_are_typed_too() -> None:
    text = "\n".join(print_c(everything(), Dialect("v", lanes().spelling, lambda value: f"L({value})", "{}")))
    assert "pmj_all(L(1.0))" in text and "L(1.0) / x[0]" in text
    assert re.findall(r"(?<!L\()(?<![\w.\[-])\d+\.\d+", text) == []
