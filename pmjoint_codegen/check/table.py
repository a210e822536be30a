"""The flat table of gates, and the functions that run them.

Each gate is a function from `Subject` to `GateResult`. A name selects its gate, or all gates whose names
begin with it: ``trajectory`` selects four.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from pmjoint_codegen.check.gates import (
    certificate,
    compilers,
    current,
    derivatives,
    exported,
    exported_loop,
    golden,
    guards,
    independent,
    interpreter,
    invariants,
    lanes,
    proof,
    symbolic,
)
from pmjoint_codegen.check.result import GateResult, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.errors import PmjointError, StaleError, UsageError, did_you_mean, quoted
from pmjoint_derive.progress import Stage, unwatched


@dataclass(frozen=True)
class Gate:
    """One row of the table.

    Attributes:
        name: of the gate.
        check: the function.
        needs_generated: whether it reads ``generated/<name>/``.
        outside: whether it waits for other programs, so it can run in parallel with the others.
        about: the checked side against the reference.
    """

    name: str
    check: Callable[[Subject], GateResult]
    needs_generated: bool = True
    outside: bool = False
    about: str = ""


GATES: Final = (
    Gate(
        "current",
        current.check,
        needs_generated=False,
        about="generated/<name>/ against fresh output of the model and the tools",
    ),
    Gate(
        "proof",
        proof.check,
        needs_generated=False,
        about="the certificate's identities against zero, with symbolic gains",
    ),
    Gate("interpreter", interpreter.check, about="CasADi's interpreter against compiled C, bit for bit"),
    Gate(
        "lanes",
        lanes.check,
        about="functions over lanes, as compiled for sweeps, against their tapes, bit for bit",
    ),
    Gate(
        "symbolic",
        symbolic.check,
        about="compiled C against the derivation at 60 digits, within a derived error bound",
    ),
    Gate(
        "guards",
        guards.check,
        about="bounds of the step control's kernels against the derivation at complex points",
    ),
    Gate(
        "derivatives",
        derivatives.check,
        about="emitted partial derivatives against algorithmic differentiation of alpha",
    ),
    Gate("trajectory.golden", golden.check, about="the default run against the reviewed one"),
    Gate("trajectory.invariants", invariants.check, about="runs against invariants of the theory"),
    Gate("trajectory.certificate", certificate.check, about="V along the run against (35)"),
    Gate(
        "trajectory.independent",
        independent.check,
        about="the default run and drawn ones against heyoka on the derivation's expressions",
    ),
    Gate(
        "export",
        exported.check,
        about="exported C against the sampled run, sample by sample, within derived bounds",
    ),
    Gate(
        "export.loop",
        exported_loop.check,
        about="exported C in closed loop against the sampled run, within a propagated bound",
    ),
    Gate("compilers.gcc", compilers.check_gcc, outside=True, about="the generated C against all warnings"),
    Gate(
        "compilers.clang", compilers.check_clang, outside=True, about="the generated C against all warnings"
    ),
    Gate(
        "compilers.sanitizers",
        compilers.check_sanitizers,
        outside=True,
        about="every kernel against memory errors and undefined behaviour",
    ),
    Gate(
        "compilers.valgrind",
        compilers.check_valgrind,
        outside=True,
        about="every kernel against uninitialised values",
    ),
    Gate(
        "compilers.objects",
        compilers.check_objects,
        outside=True,
        about="the object files against allocation, static mutable state and recursion",
    ),
    Gate(
        "compilers.cppcheck", compilers.check_cppcheck, outside=True, about="the generated C against cppcheck"
    ),
)


def select(names: Sequence[str]) -> tuple[Gate, ...]:
    """The gates that some names select, in the order of the table; all of them for no name.

    Raises:
        UsageError: a name selects no gate.
    """
    for name in names:
        if not any(_stands_for(name, gate) for gate in GATES):
            known = ", ".join(gate.name for gate in GATES)
            remedy = f"{_guess(name)}gates: {known}"
            raise UsageError(f"no gate is called {quoted(name)}", where="--gate", remedy=remedy)
    return tuple(gate for gate in GATES if not names or any(_stands_for(name, gate) for name in names))


def _guess(name: str) -> str:
    """Suggest the gate, or common prefix of several, closest to a wrong name."""
    meant = {gate.name.rpartition(".")[-1]: gate.name for gate in GATES}
    meant |= {word: word for gate in GATES for word in (gate.name, gate.name.partition(".")[0])}
    return did_you_mean(name, meant, meant.__getitem__)


def _stands_for(name: str, gate: Gate) -> bool:
    return gate.name == name or gate.name.startswith(f"{name}.")


def run_gates(
    subject: Subject, gates: Sequence[Gate] = GATES, stage: Stage = unwatched
) -> Iterator[GateResult]:
    """Run gates on one model; yield each result in the table's order as soon as it exists.

    Gates that mostly wait for compilers run in a second thread meanwhile. After an interruption no further
    gate starts.

    Args:
        subject: the model.
        gates: which.
        stage: called with the current gate.
    """
    obstacle = _obstacle(subject) if any(gate.needs_generated for gate in gates) else ""
    if not obstacle and any(gate.outside for gate in gates):
        _prepare(subject)
    with ThreadPoolExecutor(max_workers=1) as beside:
        waiting = {
            gate.name: beside.submit(run_gate, subject, gate, obstacle) for gate in gates if gate.outside
        }
        try:
            for count, gate in enumerate(gates, start=1):
                stage(f"gate {gate.name}, {count} of {len(gates)}", 0.0)
                yield waiting[gate.name].result() if gate.outside else run_gate(subject, gate, obstacle)
        except BaseException:
            beside.shutdown(wait=False, cancel_futures=True)
            raise


def _prepare(subject: Subject) -> None:
    """Compute the data common to both threads before they start, and all that the second wants of CasADi."""
    _ = subject.manifest, subject.compiler
    with suppress(Exception):  # a gate that asks for it meets the same error, and reports it
        _ = subject.fed


def _obstacle(subject: Subject) -> str:
    """Why ``generated/<name>/`` cannot be read, or nothing."""
    try:
        _ = subject.manifest, subject.tapes
    except (StaleError, OSError, ValueError, IndexError) as error:
        return f"nothing sound is generated: {' '.join(str(error).split())[:200]}"
    return ""


def run_gate(subject: Subject, gate: Gate, obstacle: str = "") -> GateResult:
    """Run one gate; an error of the model makes it fail, with the error as the reason.

    So does any exception caused by results of faulty code, such as a run without a row: the other gates and
    the report are still completed.

    Args:
        subject: the model.
        gate: the gate.
        obstacle: why generated files cannot be read, if so.
    """
    begun = time.perf_counter()
    if obstacle and gate.needs_generated:
        result = not_run(obstacle)
    else:
        try:
            result = gate.check(subject)
        except PmjointError as error:
            result = failed(str(error))
        except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
            words = f"{type(error).__name__} {error}".strip()
            result = failed(f"nothing sound to judge: {' '.join(words.split())[:200]}")
    return dataclasses.replace(result, name=gate.name, seconds=time.perf_counter() - begun)
