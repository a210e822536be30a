"""Interpreter = C: CasADi's virtual machine and compiled C agree bit for bit."""

from __future__ import annotations

from pmjoint_codegen.check.bits import Answers, judge
from pmjoint_codegen.check.inputs.features import Features
from pmjoint_codegen.check.inputs.points import batches
from pmjoint_codegen.check.result import GateResult, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.kernels.evaluator import Evaluator

SEED = 20200501
POINTS = 120  # of each kind


def check(subject: Subject) -> GateResult:
    """Compare every kernel on random and on hard points."""
    if subject.compiled is None:
        return not_run("no C compiler")
    return compare(subject.interpreted, subject.compiled, features=subject.features)


def compare(
    interpreted: Evaluator, compiled: Evaluator, count: int = POINTS, features: Features | None = None
) -> GateResult:
    """Compare two evaluators, kernel by kernel.

    Args:
        interpreted: one side.
        compiled: the other side; its manifest says which kernels there are.
        count: points of each kind.
        features: of the model; see `batches`.
    """
    functions = compiled.manifest.functions
    answers = (
        Answers(
            function,
            batch,
            interpreted.call(function.name, *batch.arguments),
            compiled.call(function.name, *batch.arguments),
        )
        for function in functions
        for batch in batches(interpreted, function, count, SEED, extreme=True, features=features)
    )
    return judge(answers, f"{len(functions)} kernels")
