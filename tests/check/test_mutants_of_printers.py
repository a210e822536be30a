"""Mutants of the printers: one wrong template, helper or rule at a time, and the gate that sees it.

A small function holds every operation, so that a fault in any template shows in it. Each mutant is printed,
compiled and judged as a kernel of a model would be.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen import operations
from pmjoint_codegen.check.gates import interpreter, lanes
from pmjoint_codegen.check.inputs.points import Batch, batches
from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.library import FLAGS, build
from pmjoint_codegen.emit import lane_text, scalar_text
from pmjoint_codegen.emit.functions import build_functions, lane_functions
from pmjoint_codegen.emit.print_c import steps
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.emit.vocabulary import neutral_entry
from pmjoint_codegen.kernels.declarations import exported
from pmjoint_codegen.kernels.evaluator import Kernel, Kind
from pmjoint_codegen.kernels.interpreted import InterpretedEvaluator
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.manifest import Function, Manifest
from pmjoint_codegen.operations import OPERATIONS, Operation

Array = npt.NDArray[np.float64]
Tally = Callable[[str, str, GateResult], None]
WORD = re.compile(r"\{\d\}|[<>!]=|(?<![\d.])[01]\.0(?![\d.e])|[-+*/<>]")
OPERAND = re.compile(r"\b([a-zA-Z]\w*)\[(\d+)\]")
OTHERS = {
    "+": "-", "-": "+", "*": "/", "/": "*", "0.0": "0.5", "1.0": "1.5",
    "<": ">", ">": "<", "<=": "<", ">=": ">", "!=": "==", "{0}": "({0} + 1.0)", "{1}": "({1} + 1.0)",
}  # fmt: skip


def everything(name: str) -> ca.Function:
    """A function that holds every operation that a kernel may hold, and two quotients by one divisor."""
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 2)
    x, y, z = a[0], a[1], a[2]
    unary = [
        -x,
        x * x,
        2 * x,
        1 / z,
        ca.sqrt(x),
        ca.exp(y),
        ca.log(x),
        ca.tan(y),
        ca.tanh(y),
        ca.atan(y),
        ca.sinh(y),
        ca.cosh(y),
        ca.fabs(y),
        ca.sign(z),
    ]
    pair = [ca.sin(x), ca.cos(x), ca.sin(y), ca.cos(z)]
    binary = [x + y, y - z, x * z, x / y, b[0] / b[1], z / b[1], x**1.3, x**y, ca.fmin(y, z), ca.fmax(y, z)]
    literal = [ca.fmin(y, 0.5), ca.fmax(y, -0.5), x / 3, 0.7 - z]
    return ca.Function(
        name, [a, b], [ca.vertcat(*unary, *pair), ca.vertcat(*binary, *literal)], ["a", "b"], ["f", "g"]
    )


def points(function: Function) -> list[Batch]:
    """Signs, zeros of both signs and magnitudes of all kinds."""
    random = np.random.default_rng(7)
    sizes = [size for _, size in function.inputs]
    edges = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1.0, -1.0, 5e-324, 2e6])
    kinds: dict[str, Callable[[int], Array]] = {
        "both signs": lambda size: random.uniform(-3.0, 3.0, (60, size)),
        "positive": lambda size: random.uniform(0.1, 3.0, (60, size)),
        "edges": lambda size: random.choice(edges, (600, size)),
    }
    return [Batch(kind, tuple(draw(size) for size in sizes)) for kind, draw in kinds.items()]


def changed(text: str) -> Iterator[tuple[str, str]]:
    """A template, or a line of C, with one word of it changed, in every way."""
    for found in WORD.finditer(text):
        wrong = text[: found.start()] + OTHERS[found[0]] + text[found.end() :]
        yield f"{wrong} for {text}", wrong


def moved(line: str) -> Iterator[tuple[str, str]]:
    """A line of C with the entry before it in place of one entry of an argument."""
    for found in OPERAND.finditer(line):
        if found.start() < line.index("="):
            continue
        other = f"{found[1]}[{int(found[2]) - 1}]"
        if found[2] != "0":
            wrong = line[: found.start()] + other + line[found.end() :]
            yield f"{wrong} for {line}", wrong


def wrong_tables(column: str) -> Iterator[tuple[str, tuple[Operation, ...]]]:
    """Every table with one spelling wrong: a word changed, or the form of another operation."""
    forms = [str(getattr(item, column)) for item in OPERATIONS]
    for place, form in enumerate(forms):
        # A form of the same shape: any other does not compile, as literals go to calls as values.
        shape = ("{1}" in form, "(" in form)
        alike = sorted({other for other in forms if ("{1}" in other, "(" in other) == shape})
        other = alike[(alike.index(form) + 1) % len(alike)]
        for what, wrong in (*changed(form), (f"{other} for {form}", other)):
            given: dict[str, Any] = {column: wrong}
            row = replace(OPERATIONS[place], **given)
            yield what, (*OPERATIONS[:place], row, *OPERATIONS[place + 1 :])


def printed(
    monkeypatch: pytest.MonkeyPatch, column: str, print_c: Callable[[ca.Function], str]
) -> Iterator[tuple[str, str]]:
    """What is wrong and the C of ``mutant_0``, ``mutant_1``, ..., each printed with one wrong spelling."""
    for i, (what, table) in enumerate(wrong_tables(column)):
        with monkeypatch.context() as patch:
            patch.setattr(operations, "OPERATIONS", table)
            yield what, print_c(everything(f"mutant_{i}"))


@pytest.fixture
def compiler(paper: Subject) -> Compiler:
    """The compiler of a run."""
    if paper.compiler is None:
        pytest.skip("no C compiler")
    return paper.compiler


def test_the_function_holds_every_operation() -> None:
    held = {step.operation for step in steps(tape_of(everything("f")))} - {"output"}
    assert held == {item.name for item in OPERATIONS}


class Lanes:
    """Functions of lanes in C, and what the gate `lanes` says of each."""

    def __init__(self, compiler: Compiler, cache: Path, function: ca.Function, texts: Sequence[str]) -> None:
        self.tape = tape_of(function)
        header = Path(batch.__file__).with_name("c_batch") / lanes.HEADER
        sources = {
            "lanes.c": "\n".join([f'#include "{lanes.HEADER}"', *texts]).encode(),
            lanes.HEADER: header.read_bytes(),
        }
        level = usable_levels(os.environ)[0]
        self.target = batch.Target(build(sources, compiler, cache, flags=batch.level_flags(level)), level)
        self.elementary = lanes.elementary_of(self.target, compiler, cache)

    def judge(self, i: int, where: Callable[[Function], list[Batch]] = points) -> GateResult:
        """The gate's result for ``mutant_i``."""
        return lanes.compare([replace(self.tape, name=f"mutant_{i}")], self.target, self.elementary, where)


def over_lanes(function: ca.Function) -> str:
    """A function over lanes in C, without the include."""
    return lane_text.lanes_source([tape_of(function)], "").partition("\n\n")[2]


def over_doubles(function: ca.Function) -> str:
    """A kernel in C, without the include."""
    return scalar_text.straight_kernel(tape_of(function))


def test_the_printer_of_lanes_is_right(compiler: Compiler, cache: Path) -> None:
    assert (
        Lanes(compiler, cache, everything("f"), [over_lanes(everything("mutant_0"))]).judge(0).verdict
        is Verdict.PASSED
    )


def test_every_fault_of_the_printer_of_lanes_is_caught(
    monkeypatch: pytest.MonkeyPatch, compiler: Compiler, cache: Path, tally: Tally
) -> None:
    mutants = list(printed(monkeypatch, "lanes", over_lanes))
    # What stands in no template: the shared inverse of a divisor, and the pair of sine and cosine.
    for right, wrong in (
        ("inverse_b_1 = 1.0 /", "inverse_b_1 = 1.5 /"),
        ("inverse_b_1 = 1.0 / b[1]", "inverse_b_1 = 1.0 / b[0]"),
        ("a[2] * inverse_b_1", "a[2] / inverse_b_1"),
        ("b[0] * inverse_b_1", "b[0] / b[1]"),
        ("pmj_sincos(a[0]", "pmj_sincos(a[1]"),
        ("&a28, &a30", "&a30, &a28"),
        ("g[13] = a62;", "g[13] = a62 + a[0][1];"),
    ):
        text = over_lanes(everything(f"mutant_{len(mutants)}"))
        assert text.count(right) == 1
        mutants.append((f"{wrong} for {right}", text.replace(right, wrong)))
    library = Lanes(compiler, cache, everything("f"), [text for _, text in mutants])
    for i, (what, _) in enumerate(mutants):
        tally("lanes", what, library.judge(i))


def of_a_positive(line: str, lines: list[str]) -> bool:
    """Whether a line takes the magnitude of the inverse of a square, whose sign says nothing."""
    found = re.search(r"pmj_max\((a\d+), -\1\)", line)
    inverse = found and re.search(rf"pmj_lanes {found[1]} = 1\.0 / (a\d+);", "\n".join(lines))
    square = inverse and re.search(rf"pmj_lanes {inverse[1]} = (\S+) \* \1;", "\n".join(lines))
    return bool(square)


@pytest.mark.parametrize(
    "name",
    [
        "taylor_lanes",
        "rates_lanes",
        "guard_lanes",
        "plant_lanes",
        "plant_guard_lanes",
        "sample_lanes",
        "arrive_lanes",
    ],
)
def test_changes_of_the_functions_over_lanes_are_caught(
    paper: Subject, compiler: Compiler, cache: Path, tally: Tally, name: str
) -> None:
    functions = build_functions(paper.derivation, paper.manifest.order)
    function = lane_functions(functions, neutral_entry(paper.derivation))[name]
    text = over_lanes(function)
    assert text.strip() in (paper.folder / "lanes.c").read_text()
    lines = text.split("\n")
    mutants = [
        (f"{name}: {what.strip()}", [*lines[:place], wrong, *lines[place + 1 :]])
        for place, line in enumerate(lines)
        if " = " in line and not of_a_positive(line, lines)
        for what, wrong in (*changed(line), *moved(line))
    ][:: max(len(lines) // (400 if "guard" in name else 40), 1)]
    texts = [
        "\n".join(body).replace(f"pmj_{name}(", f"pmj_mutant_{i}(", 1) for i, (_, body) in enumerate(mutants)
    ]
    library = Lanes(compiler, cache, function, texts)

    def of_the_gate(mutant: Function) -> list[Batch]:
        # The name is part of the seed of the points.
        count = interpreter.POINTS if "guard" in name else 40
        return batches(paper.interpreted, replace(mutant, name=name), count, interpreter.SEED, extreme=True)

    for i, (what, _) in enumerate(mutants):
        tally("lanes", what, library.judge(i, of_the_gate))


class Called:
    """An evaluator of one kernel, compiled from a text."""

    kind: Kind = "compiled"

    def __init__(self, manifest: Manifest, folder: Path, text: str) -> None:
        self.manifest = manifest
        folder.mkdir()
        (folder / "kernel.c").write_text(text)
        flags = [flag for flag in FLAGS if flag != "-O2"]
        subprocess.run(["cc", *flags, "kernel.c", "-o", "kernel.so", "-lm"], cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "kernel.so"))

    def kernel(self, name: str) -> Kernel:
        """Not for one point: the gate calls over rows."""
        raise NotImplementedError(name)

    def call(self, name: str, *arrays: npt.ArrayLike) -> tuple[Array, ...]:
        """Evaluate the kernel row by row, in CasADi's convention."""
        function, pointer = self.manifest.function(name), ctypes.POINTER(ctypes.c_double)
        given = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
        results = tuple(np.zeros((len(given[0]), size)) for _, size in function.outputs)
        for row in range(len(given[0])):
            arg, res = (
                (pointer * len(side))(*(array[row].ctypes.data_as(pointer) for array in side))
                for side in (given, results)
            )
            getattr(self.library, exported(name))(arg, res, None, None, 0)
        return results


class Scalars:
    """Kernels in C, and what the gate `interpreter` says of each."""

    def __init__(self, manifest: Manifest) -> None:
        tape = tape_of(everything("mutant_0"))
        self.function = Function("mutant_0", tape.inputs, tape.outputs, "", "", 0)
        self.manifest = manifest
        self.tape = tape

    def judge(self, folder: Path, text: str, names: Sequence[str]) -> list[GateResult]:
        """The gate's result for every kernel of a text."""
        functions = tuple(replace(self.function, name=name) for name in names)
        compiled = Called(replace(self.manifest, functions=functions), folder, text)
        tapes = {name: replace(self.tape, name=name) for name in names}
        results = []
        for function in functions:
            compiled.manifest = replace(self.manifest, functions=(function,))
            interpreted = InterpretedEvaluator(compiled.manifest, tapes)
            results.append(interpreter.compare(interpreted, compiled, 40))
        return results


HEAD = "#include <math.h>\n"


def test_the_printer_of_kernels_is_right(paper: Subject, tmp_path: Path) -> None:
    text = HEAD + scalar_text.HELPERS + over_doubles(everything("mutant_0"))
    (result,) = Scalars(paper.manifest).judge(tmp_path / "right", text, ["mutant_0"])
    assert result.verdict is Verdict.PASSED


def test_every_fault_of_the_printer_of_kernels_is_caught(
    paper: Subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tally: Tally
) -> None:
    mutants = list(printed(monkeypatch, "scalar", over_doubles))
    text = "\n".join([HEAD, scalar_text.HELPERS, *(text for _, text in mutants)])
    names = [f"mutant_{i}" for i in range(len(mutants))]
    results = Scalars(paper.manifest).judge(tmp_path / "templates", text, names)
    for (what, _), result in zip(mutants, results, strict=True):
        tally("interpreter", what, result)


def test_every_fault_of_a_helper_of_kernels_is_caught(paper: Subject, tmp_path: Path, tally: Tally) -> None:
    lines = scalar_text.HELPERS.split("\n")
    kernel = over_doubles(everything("mutant_0"))
    scalars = Scalars(paper.manifest)
    for place, line in enumerate(lines):
        for what, wrong in changed(line) if "return" in line else ():
            text = "\n".join([HEAD, *lines[:place], wrong, *lines[place + 1 :], kernel])
            (result,) = scalars.judge(tmp_path / str(len(list(tmp_path.iterdir()))), text, ["mutant_0"])
            tally("interpreter", what, result)
