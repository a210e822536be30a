"""The table of operations: its readers know every row, and a row is all that a new function takes."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

from pmjoint_codegen import operations
from pmjoint_codegen.check.gates import guards, symbolic
from pmjoint_codegen.check.oracles import rounding
from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.check.table import run_gates, select
from pmjoint_codegen.emit import balls, recurrences
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.operations import OPERATIONS, Operation, by_name, by_sympy, functions

MODEL = """\
schema = 1
name   = "functions"
title  = "Functions"
source = "made for this test"
[parameters]
d1    = { value = 0.2, unit = "1/s^2", about = "stiffness" }
b0    = { value = 2.0, unit = "rad/(s^2 V)", about = "input gain" }
u_max = { value = 9.0, unit = "V", about = "limit" }
[plant]
order = 1
phi   = ["PHI"]
Phi   = [["y"]]
theta = ["d1"]
b     = ["b0"]
sigma = "0.5 + cosh(y/4)"
disturbance = ["0.1*atan(x1)*sinh(sin(t))"]
[actuator]
limit = "u_max"
[design]
c = [3]
e = [0.1]
ck = [1]
k = [4]
[simulation]
reference   = "sin(t)"
x0          = [0.2]
horizon     = 1.0
output_step = 0.1
sample_time = 0.01
"""
NEW = "atanh(sin(y)/2)"
ATANH = Operation(
    name="atanh",
    opcodes=("OP_ATANH",),
    scalar="atanh({0})",
    lanes="pmj_each(atanh, {0})",
    recurrence=lambda r: r.inverse_slope("atanh", r.one_plus_square(-1)),
    ball=lambda b: b.bounded(
        "atanh", lambda c, r: b.inverse_hyperbolic(r / b.positive(1.0 - c * c - b.ca.fabs(c) * r))
    ),
    rounding=lambda r: r.library("atanh", 2.5, lambda x, e, value: e / (1.0 - (abs(x) + e) ** 2)),
    written=True,
    sympy="atanh",
    numpy="arctanh",
    feature=0.0,
)


def generated(folder: Path, phi: str = NEW) -> Subject:
    """The model, generated beside its file."""
    (folder / "models").mkdir()
    file = folder / "models" / "functions.toml"
    file.write_text(MODEL.replace("PHI", phi), encoding="utf-8")
    regenerate([str(file)])
    return load_subject(file, os.environ, lambda _line: None)


def test_every_column_that_is_a_rule_has_one() -> None:
    for item in OPERATIONS:
        for column, module in ((item.ball, balls), (item.rounding, rounding)):
            assert column is None or callable(column(module)), item.name
        rule = item.recurrence and item.recurrence(recurrences)
        assert rule is None or isinstance(rule, recurrences.Recurrence), item.name


def test_no_two_rows_share_a_name_or_one_of_casadis_numbers() -> None:
    numbers = [getattr(ca, opcode) for item in OPERATIONS for opcode in item.opcodes]
    assert len(by_name()) == len(OPERATIONS) and len(set(numbers)) == len(numbers)
    assert len(by_sympy()) == sum(bool(item.sympy) for item in OPERATIONS)


def test_the_template_of_a_new_model_names_every_function(root: Path) -> None:
    text = (root / "pmjoint_codegen" / "cli" / "templates" / "plant.toml").read_text(encoding="utf-8")
    assert f"functions: {' '.join(functions())}\n" in text


def test_a_function_that_is_in_no_row_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="unknown function 'atanh'"):
        generated(tmp_path)


def test_a_new_function_is_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the model file to C on doubles and lanes, against sixty digits and against heyoka."""
    monkeypatch.setattr(operations, "OPERATIONS", (*OPERATIONS, ATANH))
    subject = generated(tmp_path, f"{NEW} + atan(2*y) + sinh(y/3)")
    gates = ("interpreter", "lanes", "guards", "trajectory.independent")
    verdicts = {result.name: result.verdict for result in run_gates(subject, select(gates))}
    assert verdicts == dict.fromkeys(gates, Verdict.PASSED)
    assert at_sixty_digits(subject).verdict is Verdict.PASSED
    for file, text in (("kernels.c", "atanh("), ("loops.c", "atanh(a"), ("lanes.c", "pmj_each(atanh, a")):
        assert text in (subject.folder / file).read_text(encoding="utf-8")


def at_sixty_digits(subject: Subject) -> GateResult:
    """What the gate `symbolic` says of the Taylor coefficients at a few points."""
    function = subject.manifest.function("taylor")
    prepared = symbolic.prepare(subject, function, 3)
    results = list(subject.interpreted.call("taylor", *prepared.arguments))
    return symbolic.conclude([symbolic.judge(prepared, results)])


WRONG: dict[str, tuple[Callable[[Subject], GateResult], dict[str, Any]]] = {
    "recurrence": (
        at_sixty_digits,
        {"recurrence": lambda r: r.inverse_slope("atanh", r.one_plus_square(1))},
    ),
    "ball": (guards.check, {"ball": lambda b: b.bounded("atanh", lambda c, r: 0.0 * r)}),
}


@pytest.mark.parametrize("column", WRONG)
def test_a_wrong_column_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, column: str) -> None:
    judge, wrong = WRONG[column]
    monkeypatch.setattr(operations, "OPERATIONS", (*OPERATIONS, replace(ATANH, **wrong)))
    assert judge(generated(tmp_path)).verdict is Verdict.FAILED
