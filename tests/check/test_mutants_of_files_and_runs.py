"""Mutants of generated files, of C that misbehaves and of trajectories, against the gates meant for them."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from pmjoint_codegen.check import trajectory
from pmjoint_codegen.check.gates import (
    certificate,
    compilers,
    current,
    golden,
    independent,
    invariants,
    proof,
)
from pmjoint_codegen.check.oracles import heyoka_loop
from pmjoint_codegen.check.oracles.certificate import certify
from pmjoint_codegen.check.result import GateResult
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.table import GATES, run_gate
from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.emit.staleness import read_folder
from pmjoint_codegen.simulate.run import Run

Files = dict[str, bytes]
Tally = Callable[[str, str, GateResult], None]


def replaced(files: Files, name: str, old: bytes, new: bytes) -> Files:
    """Files with one text changed in one of them."""
    assert old in files[name], f"{name} holds no {old!r}"
    return {**files, name: files[name].replace(old, new, 1)}


def stale_folders(files: Files) -> Mapping[str, Files]:
    """Ways in which a committed folder goes wrong."""
    return {
        "a stale header: another equation number": replaced(files, "kernels.h", b"(29)", b"(28)"),
        "a stale header: a declaration lost": replaced(files, "kernels.h", b"pmjoint_law(", b"pmjoint_raw("),
        "a banner of another version": replaced(files, "kernels.c", b"sympy 1.", b"sympy 0."),
        "one sign in the C": replaced(files, "kernels.c", b"+a07", b"-a07"),
        "a literal cut to 12 digits": replaced(files, "loops.c", b"0.3333333333333333", b"0.333333333333"),
        "one sign in the derivation": replaced(files, "derivation.md", b"- c_2 z_2", b"+ c_2 z_2"),
        "one operation of the tape": replaced(files, "kernels.tape", b" add ", b" sub "),
        "a default value in model.json": replaced(files, "model.json", b'"value": 0.2', b'"value": 0.3'),
        "a name in model.json": replaced(files, "model.json", b'"xi1"', b'"xi9"'),
        "kernels.h lost": {name: data for name, data in files.items() if name != "kernels.h"},
        "model.json lost": {name: data for name, data in files.items() if name != "model.json"},
        "a file too many": {**files, "notes.txt": b"by hand"},
        "nothing there": {},
    }


def test_stale_and_edited_folders_are_not_current(paper: Subject, tally: Tally) -> None:
    fresh, files = generate(paper.document, paper.model), read_folder(paper.folder)
    for what, folder in stale_folders(files).items():
        tally("current", what, current.judge(paper, folder, fresh))


def test_changed_models_make_the_folder_stale(paper: Subject, tally: Tally) -> None:
    files = read_folder(paper.folder)
    design = {**paper.document["design"], "c": [15, 16]}
    plant = {**paper.document["plant"], "disturbance": ["0", "0.2*sin(x2)*cos(t)"]}
    for what, change in {
        "gain c2 = 16": {"design": design},
        "twice the disturbance": {"plant": plant},
    }.items():
        from pmjoint_codegen.modelfile import model_of

        document = {**paper.document, **change}
        fresh = generate(document, model_of(document, "changed"))
        tally("current", what, current.judge(paper, files, fresh))


LAW = "/* pmjoint_law:("
BODIES: Mapping[str, tuple[str, str]] = {  # what -> (gate, statement at the head of `law`)
    "a variable that nobody uses": ("warnings", "int stray;"),
    "a double squeezed into an int": ("warnings", "int stray = arg[0][0]; (void) stray;"),
    "a comparison of signed and unsigned": ("warnings", "if (mem < sizeof(double)) return 1;"),
    "a call without declaration": ("warnings", "undeclared(mem);"),
    "memory from the heap": ("objects", "extern void *malloc(unsigned long); if (mem) *res = malloc(8);"),
    "a counter that remembers": ("objects", "static int calls; ++calls; if (calls < 0) return 1;"),
    "text to the terminal": ("objects", 'extern int puts(const char *); if (mem) puts("v");'),
    "a recursion": ("objects", "if (mem > 0) return pmjoint_law(arg, res, iw, w, mem - 1);"),
    "a read past the end": ("sanitizers", "if (arg[0][1] > 1e300) return 1;"),
    "a read before the beginning": ("sanitizers", "if (arg[0][-1] > 1e300) return 1;"),
    "a write past the end": ("sanitizers", "res[2][1] = 0;"),
    "a null pointer followed": ("sanitizers", "if (w[0] > 1e300) return 1;"),
    "an overflow of int": ("sanitizers", "if (mem + 2147483647 + (int) (arg[3][1] > 0) < 0) return 1;"),
    "a shift by too much": ("sanitizers", "if (1 << (mem + 40)) return 0;"),
    "a result that is not written": ("valgrind", "if (arg[0][0] == arg[0][0]) return 0;"),
    "an uninitialised value that decides": ("valgrind", "if (res[0][0] > 1) res[0][0] = 1;"),
}


def with_statement(subject: Subject, statement: str) -> dict[str, str]:
    """The generated C with one statement at the head of ``law``'s body."""
    files = compilers.sources(subject)
    text = files["kernels.c"]
    opened = text.index("{\n", text.index(LAW)) + 2
    return {**files, "kernels.c": f"{text[:opened]}  {statement}\n{text[opened:]}"}


def judge_of(subject: Subject, gate: str, files: Mapping[str, str]) -> GateResult:
    """What one of the compilers' gates says of some sources."""
    assert subject.compiler is not None
    cc = subject.compiler.command
    watch = ["valgrind", "--quiet", "--error-exitcode=9", "--exit-on-first-error=yes"]
    judges: Mapping[str, Callable[[], GateResult]] = {
        "warnings": lambda: compilers.warnings(cc[0], files),
        "objects": lambda: compilers.objects(cc, files),
        "sanitizers": lambda: compilers.watched(
            subject, [*cc, *compilers.BITS, *compilers.SANITIZERS], [], files
        ),
        "valgrind": lambda: compilers.watched(subject, [*cc, *compilers.BITS], watch, files),
    }
    return judges[gate]()


@pytest.mark.parametrize("gate", ["warnings", "objects", "sanitizers", "valgrind"])
def test_misbehaving_c_is_caught(paper: Subject, tally: Tally, gate: str) -> None:
    if gate == "valgrind" and shutil.which("valgrind") is None:
        pytest.skip("no valgrind")
    for what, (meant, statement) in BODIES.items():
        if meant == gate:
            tally(f"compilers.{gate}", what, judge_of(paper, gate, with_statement(paper, statement)))


def test_a_parameter_that_only_looks_like_the_convention_is_caught(paper: Subject, tally: Tally) -> None:
    files = compilers.sources(paper)
    stray = "\nint stray(double unused_input);\nint stray(double unused_input) { return 0; }\n"
    result = compilers.warnings("cc", {**files, "kernels.c": files["kernels.c"] + stray})
    tally("compilers.gcc", "an unused parameter of our own", result)


def test_cppcheck_catches_what_it_should(paper: Subject, tally: Tally) -> None:
    if shutil.which("cppcheck") is None:
        pytest.skip("no cppcheck")
    files = with_statement(paper, "double a[2]; a[0] = 1; a[2] = a[0]; (void) a;")
    tally("compilers.cppcheck", "an index out of bounds", compilers.cppcheck(files))


def moved(run: Run, column: str, factor: float, shift: float) -> Run:
    """A run with one signal changed."""
    place = next(i for i, item in enumerate(run.manifest.signals) if item.name == column)
    signals = run.signals.copy()
    signals[:, place] = signals[:, place] * factor + shift
    return dataclasses.replace(run, signals=signals)


def test_changed_golden_trajectories_are_noticed(paper: Subject, tally: Tally) -> None:
    assert paper.compiled is not None
    true = golden.read(*golden.paths(paper))
    found = trajectory.trajectory_of(trajectory.default_run(paper.compiled))

    def values(row: int, column: int, by: float) -> trajectory.Trajectory:
        changed = true.values.copy()
        changed[row, column] += by * max(1.0, abs(changed[row, column]))
        return dataclasses.replace(true, values=changed)

    (t, mode), *later = true.switches
    mutants = {
        "x1 off by 2e-9 in the last row": values(-1, 0, 2e-9),
        "v off by 2e-9 of its size at t = 0": values(0, -1, 2e-9),
        "r2 not a number": values(7, 9, np.nan),
        "two columns exchanged": dataclasses.replace(true, values=true.values[:, [1, 0, *range(2, 11)]]),
        "a switch 2e-9 s late": dataclasses.replace(true, switches=((t + 2e-9, mode), *later)),
        "a switch lost": dataclasses.replace(true, switches=tuple(later)),
        "a switch into the other limit": dataclasses.replace(true, switches=((t, -mode or 1), *later)),
        "a row lost": dataclasses.replace(true, t=true.t[1:], values=true.values[1:]),
        "other columns": dataclasses.replace(true, names=("x2", *true.names[1:])),
    }
    for what, changed in mutants.items():
        tally("trajectory.golden", what, trajectory.compare(changed, found, "golden"))


def test_other_loops_are_not_the_golden_one(paper: Subject, tally: Tally) -> None:
    assert paper.compiled is not None
    true = golden.read(*golden.paths(paper))
    for name, value in {
        "c1": 15 + 1e-6,
        "b0": 2.001,
        "ck2": 1.01,
        "k1": 6.0001,
        "compensator": 0.0,
        "u_max": 10.001,
    }.items():
        found = trajectory.trajectory_of(trajectory.default_run(paper.compiled, {name: value}))
        tally(
            "trajectory.golden",
            f"{name} = {value}",
            trajectory.compare(true, found, "golden"),
        )


def test_other_loops_are_not_heyokas(paper: Subject, tally: Tally) -> None:
    heyoka = pytest.importorskip("heyoka")
    assert paper.compiled is not None
    defaults = trajectory.default_run(paper.compiled).settings
    loop = heyoka_loop.Loop(heyoka, paper, defaults.parameters)
    expected = independent.reference(loop, paper, defaults)
    scales = loop.scales(expected, defaults.parameters["u_max"])
    for name, value in {"c2": 15.001, "d1": 0.2001, "u_max": 10.001}.items():
        found = trajectory.trajectory_of(trajectory.default_run(paper.compiled, {name: value}))
        result = trajectory.compare(expected, found, "heyoka", scales)
        tally("trajectory.independent", f"{name} = {value}", result)


def test_broken_invariants_are_noticed(paper: Subject, tally: Tally) -> None:
    assert paper.compiled is not None
    run = trajectory.default_run(paper.compiled)
    for column, factor, shift in (("e", 1 + 1e-12, 0.0), ("z1", -1.0, 0.0), ("e", 1.0, 1e-14)):
        finding = invariants.errors_add_up(moved(run, column, factor, shift))
        tally("trajectory.invariants", f"{factor} {column} + {shift}", invariants.judge([finding]))
    noisy = invariants.quiet_findings(paper.compiled)  # as if a disturbance were none
    tally("trajectory.invariants", "a disturbance that should not be there", invariants.judge(noisy))


def test_v_that_rises_is_noticed(paper: Subject, tally: Tally) -> None:
    assert paper.compiled is not None
    run = trajectory.default_run(paper.compiled)
    true = certify(paper.derivation, proof.design_values(paper.derivation), 0.1)
    assert true.Y is not None
    rising = run.signals.copy()
    rising[:, [item.name for item in run.manifest.signals].index("z2")] += np.linspace(0, 10, len(run.t))
    mutants = {
        "V falls faster than it does": (run, dataclasses.replace(true, f=60.0)),
        "no disturbance": (moved(run, "z1", 1e3, 0.0), dataclasses.replace(true, Y=0.0)),
        "z2 that grows": (dataclasses.replace(run, signals=rising), dataclasses.replace(true, Y=0.0)),
    }
    for what, (changed, constants) in mutants.items():
        tally("trajectory.certificate", what, certificate.decrease(changed, constants))


def test_a_smaller_bound_than_the_disturbance_is_noticed(paper: Subject, tally: Tally) -> None:
    model = dataclasses.replace(paper.model, disturbance_bound=0.05)
    gate = next(gate for gate in GATES if gate.name == "trajectory.certificate")
    tally(gate.name, "disturbance_bound = 0.05", run_gate(dataclasses.replace(paper, model=model), gate))
