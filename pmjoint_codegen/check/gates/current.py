"""Current: every byte of ``generated/<name>/`` is what the model and the tools give."""

from __future__ import annotations

from collections.abc import Mapping

from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.emit.pipeline import Artifacts, generate
from pmjoint_codegen.emit.staleness import REMEDIES, Verdict, compare, read_folder
from pmjoint_codegen.workspace import called


def check(subject: Subject) -> GateResult:
    """Generate anew, in memory, and compare."""
    return judge(subject, read_folder(subject.folder), generate(subject.document, subject.model))


def judge(subject: Subject, files: Mapping[str, bytes], fresh: Artifacts) -> GateResult:
    """Hold a folder's files against what would be written.

    Args:
        subject: the model.
        files: name -> content of what stands there.
        fresh: what would be written.
    """
    comparison = compare(files, fresh.files, fresh.manifest)
    differing = {name for name, text in fresh.files.items() if files.get(name) != text.encode()} | set(
        files
    ) - set(fresh.files)
    if comparison.verdict is Verdict.CURRENT:
        return passed(f"files that differ, of {len(files)} generated anew", 0, 0)
    remedy = REMEDIES[comparison.verdict].format(name=called(subject.file))
    changes = [
        f"{item.name}: {item.before} -> {item.after}"
        for item in comparison.changes
        if item.before is not None
    ]
    findings = (*comparison.details, *changes, f"to mend it: {remedy}")
    first = Difference(
        str(subject.folder), min(differing), "", "as generated", comparison.verdict.value, "", ""
    )
    return failed(f"{comparison.verdict.value}: {comparison.details[0]}", len(differing), 0, first, findings)
