"""Current: every byte of ``generated/<name>/`` equals fresh output of the model and the tools."""

from __future__ import annotations

from collections.abc import Mapping

from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.emit.pipeline import Artifacts, generate
from pmjoint_codegen.emit.staleness import REMEDIES, Verdict, compare, read_folder
from pmjoint_codegen.workspace import called


def check(subject: Subject) -> GateResult:
    """Regenerate in memory, and compare."""
    return judge(subject, read_folder(subject.folder), generate(subject.document, subject.model))


def judge(subject: Subject, files: Mapping[str, bytes], fresh: Artifacts) -> GateResult:
    """Check a folder's files against fresh output.

    Args:
        subject: the model.
        files: name -> content of the existing files.
        fresh: the files that would be written.
    """
    comparison = compare(files, fresh.files, fresh.manifest)
    differing = {name for name, text in fresh.files.items() if files.get(name) != text.encode()} | set(
        files
    ) - set(fresh.files)
    if comparison.verdict is Verdict.CURRENT:
        return passed(f"files that differ, of {len(files)} regenerated", 0, 0)
    remedy = REMEDIES[comparison.verdict].format(name=called(subject.file))
    changes = [str(item) for item in comparison.changes if item.before is not None]
    findings = (*comparison.details, *changes, f"to fix it: {remedy}")
    first = Difference(
        str(subject.folder), min(differing), "", "as generated", comparison.verdict.value, "", ""
    )
    return failed(f"{comparison.verdict.value}: {comparison.details[0]}", len(differing), 0, first, findings)
