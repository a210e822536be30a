"""Mutants of the generated C: every operation, argument and literal of the kernels, one change at a time.

Each mutant is one C function. All mutants of a kernel are compiled in one go, unoptimised, and judged on
points and references that are prepared once; so that hundreds of them take seconds.
"""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen.check.gates import derivatives, interpreter, symbolic
from pmjoint_codegen.check.inputs.points import batches
from pmjoint_codegen.check.result import GateResult
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.kernels.evaluator import Kind
from pmjoint_codegen.manifest import Function

Array = npt.NDArray[np.float64]
Tally = Callable[[str, str, GateResult], None]
Mutant = tuple[str, str]  # what was changed, the whole body

BINARY = re.compile(r"^  (a\d+)=\((a\d+|[\d.e-]+)([-+*/])(a\d+|[\d.e-]+)\);$")
NEGATION = re.compile(r"^  (a\d+)=\(-(a\d+)\);$")
SQUARE = re.compile(r"^  (a\d+)=casadi_sq\((a\d+)\);$")
ARGUMENT = re.compile(r"^  (a\d+)=arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0;$")
RESULT = re.compile(r"^  if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=(a\d+);$")
# Printed kernels keep C's names for their inputs and results.
VALUE = re.compile(r"^    const double (a\d+) = (\S+) ([-+*/]) (\S+);$")
OPPOSITE = re.compile(r"^    const double (a\d+) = -(\S+);$")
CLIPPED = re.compile(r"^    const double (a\d+) = pmj_f(min|max)\((\S+), (\S+)\);$")
CALLED = re.compile(r"^    const double (a\d+) = (sin|cos)\((\S+)\);$")
TAKEN = re.compile(r"^    const double (\w+_\d+) = arg\[(\d+)\]\[(\d+)\];$")
ENTRY = re.compile(r"^    (\w+\[\d+\]) = (\S+);$")


def body_of(text: str, kernel: str) -> list[str]:
    """Lines of a kernel's body in ``kernels.c`` or ``loops.c``."""
    found = re.search(rf"/\* (?:pmjoint_)?{kernel}:\(", text)
    assert found is not None, kernel
    start = found.start()
    opened = text.index("{\n", start) + 2
    return text[opened : text.index("\n}", opened)].split("\n")


def changes(line: str, function: Function) -> Iterator[tuple[str, str]]:
    """Every single change of one line: what it is, and the line that takes its place."""
    if found := BINARY.match(line):
        to, a, sign, b = found.groups()
        other = {"+": "-", "-": "+", "*": "/", "/": "*"}[sign]
        yield f"{sign} becomes {other}", f"  {to}=({a}{other}{b});"
        yield f"drop what follows {sign}", f"  {to}={a};"
        yield f"drop what stands before {sign}", f"  {to}={b};"
        if sign in "-/":
            yield f"swap operands of {sign}", f"  {to}=({b}{sign}{a});"
        yield "a factor 1 + 1e-12", f"  {to}=({a}{sign}{b})*(1+1e-12);"
    elif found := NEGATION.match(line):
        yield "drop a minus", f"  {found[1]}={found[2]};"
    elif found := SQUARE.match(line):
        yield "drop a square", f"  {found[1]}={found[2]};"
    elif found := ARGUMENT.match(line):
        to, block, index = found[1], int(found[2]), int(found[3])
        size = function.inputs[block][1]
        for wrong in sorted({(index + 1) % size, (index - 1) % size} - {index}):
            label = function.inputs[block][0]
            yield f"{label}[{wrong}] for {label}[{index}]", f"  {to}=arg[{block}][{wrong}];"
    elif found := RESULT.match(line):
        yield f"result {found[1]}[{found[2]}] negated", f"  res[{found[1]}][{found[2]}]=-{found[3]};"


def printed_changes(line: str, function: Function) -> Iterator[tuple[str, str]]:
    """Every single change of one line that this project printed: a kernel's, or one of ``sampled.h``."""
    if found := VALUE.match(line):
        to, a, sign, b = found.groups()
        other = {"+": "-", "-": "+", "*": "/", "/": "*"}[sign]
        yield f"{sign} becomes {other}", f"    const double {to} = {a} {other} {b};"
        yield f"drop what follows {sign}", f"    const double {to} = {a};"
        yield f"drop what stands before {sign}", f"    const double {to} = {b};"
        # Not 1e-12: next to a large w, a small term's last digits are below the error bound of the sum.
        yield "a factor 1 + 1e-9", f"    const double {to} = ({a} {sign} {b}) * (1.0 + 1e-9);"
    elif found := OPPOSITE.match(line):
        yield "drop a minus", f"    const double {found[1]} = {found[2]};"
    elif found := CLIPPED.match(line):
        yield "drop a limit", f"    const double {found[1]} = {found[3]};"
        yield "drop all but a limit", f"    const double {found[1]} = {found[4]};"
    elif found := CALLED.match(line):
        other = {"sin": "cos", "cos": "sin"}[found[2]]
        yield f"{found[2]} becomes {other}", f"    const double {found[1]} = {other}({found[3]});"
    elif found := TAKEN.match(line):
        to, block, index = found[1], int(found[2]), int(found[3])
        label, size = function.inputs[block]
        for wrong in sorted({(index + 1) % size, (index - 1) % size} - {index}):
            yield f"{label}[{wrong}] for {label}[{index}]", f"    const double {to} = arg[{block}][{wrong}];"
    elif found := ENTRY.match(line):
        yield f"{found[1]} negated", f"    {found[1]} = -{found[2]};"


def mutants_of(text: str, function: Function) -> list[Mutant]:
    """Every mutant of a kernel with one changed line."""
    lines = body_of(text, function.name)
    return [
        (f"{function.name}: {what}, for{line}", "\n".join([*lines[:place], replacement, *lines[place + 1 :]]))
        for place, line in enumerate(lines)
        for what, replacement in (*changes(line, function), *printed_changes(line, function))
    ]


HEAD = """\
#include <math.h>
#define casadi_real double
#define casadi_int long long int
static double casadi_sq(double x) { return x*x; }
static double casadi_fmin(double x, double y) { return fmin(x, y); }
static double casadi_fmax(double x, double y) { return fmax(x, y); }
static double pmj_fmin(double x, double y) { return fmin(x, y); }
static double pmj_fmax(double x, double y) { return fmax(x, y); }
double pmj_keep(double x);
double pmj_keep(double x) { return casadi_sq(casadi_fmin(x, casadi_fmax(x, pmj_fmin(x, pmj_fmax(x, 0))))); }
"""
SIGNATURE = "const double** arg, double** res, long long int* iw, double* w, int mem"


def compiled(
    folder: Path, mutants: Sequence[Mutant], flags: Sequence[str] = ("-O0", "-ffp-contract=off")
) -> ctypes.CDLL:
    """All mutants of one kernel in one library, as functions ``mutant_0``, ``mutant_1``, ..."""
    functions = [f"int mutant_{i}({SIGNATURE}) {{\n{body}\n}}" for i, (_, body) in enumerate(mutants)]
    (folder / "mutants.c").write_text(HEAD + "\n".join(functions))
    command = ["cc", "-std=c99", "-w", "-fPIC", "-shared", *flags, "mutants.c", "-o", "mutants.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "mutants.so"))


def evaluate(function: Function, call: ctypes._NamedFuncPointer, arguments: Sequence[Array]) -> list[Array]:
    """Call one mutant at every point."""
    points, pointer = len(arguments[0]), ctypes.POINTER(ctypes.c_double)
    results = [np.zeros((points, size)) for _, size in function.outputs]
    for row in range(points):
        held = [np.ascontiguousarray(array[row]) for array in arguments]
        arg = (pointer * len(held))(*(array.ctypes.data_as(pointer) for array in held))
        res = (pointer * len(results))(*(array[row].ctypes.data_as(pointer) for array in results))
        call(arg, res, None, None, 0)
    return results


def source(subject: Subject) -> str:
    return "\n".join((subject.folder / name).read_text() for name in ("kernels.c", "loops.c"))


@pytest.mark.parametrize(
    "kernel", ["law", "partials", "filters", "compensator", "estimate", "plant", "sampled_update"]
)
def test_every_change_of_a_kernel_is_outside_the_error_bound(
    paper: Subject, tmp_path: Path, tally: Tally, kernel: str
) -> None:
    function = paper.manifest.function(kernel)
    mutants = mutants_of(source(paper), function)
    library = compiled(tmp_path, mutants)
    prepared = symbolic.prepare(paper, function, 3)
    for i, (what, _) in enumerate(mutants):
        results = evaluate(function, library[f"mutant_{i}"], prepared.arguments)
        tally("symbolic", what, symbolic.conclude([symbolic.judge(prepared, results)]))


def scalar_mutants(text: str, function: Function) -> list[Mutant]:
    """Every mutant with one changed line of a function of ``sampled.h``."""
    start = text.index(f"static inline void pmj_{function.name}(")
    opened = text.index("{\n", start) + 2
    lines = text[opened : text.index("\n}", opened)].split("\n")
    pointers = [
        *(f"    const double *{label} = arg[{i}];" for i, (label, _) in enumerate(function.inputs)),
        *(f"    double *{label} = res[{i}];" for i, (label, _) in enumerate(function.outputs)),
    ]
    return [
        (
            f"{function.name}: {what}, for{line}",
            "\n".join(
                ["{", *pointers, *lines[:place], replacement, *lines[place + 1 :], "}", "    return 0;"]
            ),
        )
        for place, line in enumerate(lines)
        for what, replacement in printed_changes(line, function)
    ]


def test_every_change_of_what_the_sampled_loop_takes_in_is_outside_the_error_bound(
    paper: Subject, tmp_path: Path, tally: Tally
) -> None:
    function = paper.manifest.function("sample")
    mutants = scalar_mutants((paper.folder / "sampled.h").read_text(), function)
    library = compiled(tmp_path, mutants)
    prepared = symbolic.prepare(paper, function, 3)
    for i, (what, _) in enumerate(mutants):
        results = evaluate(function, library[f"mutant_{i}"], prepared.arguments)
        tally("symbolic", what, symbolic.conclude([symbolic.judge(prepared, results)]))


def test_every_literal_cut_to_12_digits_is_outside_the_error_bound(
    paper: Subject, tmp_path: Path, tally: Tally
) -> None:
    function = paper.manifest.function("taylor")
    body = "\n".join(body_of(source(paper), "taylor"))
    literals = sorted(set(re.findall(r"\d\.\d{13,}(?:e-\d+)?", body)))
    cut = [(f"taylor: {text} cut to 12 digits", text, f"{float(text):.11e}") for text in literals]
    mutants = [(what, body.replace(text, short)) for what, text, short in cut if float(short) != float(text)]
    library = compiled(tmp_path, mutants)
    prepared = symbolic.prepare(paper, function)
    for i, (what, _) in enumerate(mutants):
        results = evaluate(function, library[f"mutant_{i}"], prepared.arguments)
        tally("symbolic", what, symbolic.conclude([symbolic.judge(prepared, results)]))


class Mutated:
    """An evaluator whose results for one kernel are a mutant's."""

    kind: Kind = "compiled"

    def __init__(self, subject: Subject, name: str, call: ctypes._NamedFuncPointer) -> None:
        assert subject.compiled is not None
        self._name, self._call, self._true = name, call, subject.compiled
        self.manifest = subject.manifest
        self.kernel = self._true.kernel

    def call(self, name: str, *arrays: npt.ArrayLike) -> tuple[Array, ...]:
        if name != self._name:
            return self._true.call(name, *arrays)
        points = [np.asarray(array, dtype=np.float64) for array in arrays]
        return tuple(evaluate(self.manifest.function(name), self._call, points))


def contracted(text: str) -> str:
    """The first product that is summed at once, as one fused operation: what contraction does."""
    pattern = re.compile(r"  (a\d+)=\((a\d+)\*(a\d+)\);\n  (a\d+)=\((a\d+)\+\1\);")
    return pattern.sub(r"  \1=(\2*\3);\n  \4=fma(\2,\3,\5);", text, count=1)


def test_rounding_that_differs_in_one_bit_is_caught_by_the_interpreter(
    paper: Subject, tmp_path: Path, tally: Tally
) -> None:
    text = "\n".join(body_of(source(paper), "law"))
    first_quotient = re.search(r"  (a\d+)=\((a\d+)/(a\d+)\);", text)
    assert first_quotient is not None and contracted(text) != text
    to, a, b = first_quotient.groups()
    mutants = [
        ("law: one fused multiply-add", contracted(text)),
        (
            "law: a quotient by way of the reciprocal",
            text.replace(first_quotient[0], f"  {to}=({a}*(1/{b}));", 1),
        ),
        ("law: an argument in single precision", re.sub(r"arg\[0\]\[0\]", "(float)arg[0][0]", text, count=1)),
        (
            "law: a sum rounded to single precision",
            re.sub(r"=\((a\d+\+a\d+)\);", r"=(float)(\1);", text, count=1),
        ),
        ("law: a negative zero lost", re.sub(r"=\(-(a\d+)\);", r"=(0-\1);", text, count=1)),
    ]
    library = compiled(tmp_path, mutants)
    for i, (what, _) in enumerate(mutants):
        mutated = Mutated(paper, "law", library[f"mutant_{i}"])
        tally("interpreter", what, interpreter.compare(paper.interpreted, mutated, 20))


def test_contraction_by_the_compiler_is_caught_by_the_interpreter(
    paper: Subject, tmp_path: Path, tally: Tally
) -> None:
    if "fma" not in Path("/proc/cpuinfo").read_text().split():
        pytest.skip("this processor fuses nothing")
    body = "\n".join(body_of(source(paper), "law"))
    # Not -Ofast: a library linked with it turns subnormal numbers off in the whole process.
    reordered = ("-fassociative-math", "-freciprocal-math", "-fno-signed-zeros", "-fno-trapping-math")
    for flags in (("-O2", "-mfma", "-ffp-contract=fast"), ("-O3", "-ffp-contract=off", *reordered)):
        (folder := tmp_path / flags[0]).mkdir()
        library = compiled(folder, [("law", body)], flags)
        mutated = Mutated(paper, "law", library.mutant_0)
        tally(
            "interpreter",
            f"compiled with {' '.join(flags)}",
            interpreter.compare(paper.interpreted, mutated, 20),
        )


def test_every_changed_derivative_is_caught(paper: Subject, tmp_path: Path, tally: Tally) -> None:
    function = paper.manifest.function("partials")
    mutants = mutants_of(source(paper), function)
    library = compiled(tmp_path, mutants)
    found = batches(paper.interpreted, function, 5, derivatives.SEED, extreme=False)
    arguments = [np.concatenate(arrays) for arrays in zip(*(batch.arguments for batch in found), strict=True)]
    for i, (what, _) in enumerate(mutants):
        (results,) = evaluate(function, library[f"mutant_{i}"], arguments)
        tally("derivatives", what, derivatives.compare(paper, arguments, results))
