"""The generated code: kernels, files, and the line of each term of the law."""

from __future__ import annotations

import re
from itertools import groupby

from pmjoint_codegen.dossier.facts import Absent, Facts, Traced
from pmjoint_codegen.dossier.markup import absent, chapter, code, paragraph, plain, prose, table, tag
from pmjoint_codegen.manifest import FILE_NAME, Function
from pmjoint_codegen.report.mathml import formula, inline_symbol


def generated_chapter(facts: Facts) -> str:
    """Kernels with inputs, outputs and operations; files; the term-to-line map."""
    functions = facts.manifest.functions
    total = sum(item.operations for item in functions)
    words = (
        f"{total} elementary operations in {len(functions)} functions. All arguments are vectors of doubles; "
        "no function allocates or keeps state."
    )
    return chapter(
        "code",
        "Generated code",
        tag("h3", "Kernels", id="kernels"),
        paragraph(words),
        table(
            ("function", "what it computes", "inputs", "outputs", "operations"),
            map(_kernel, functions),
            right=(4,),
        ),
        tag("h3", "Files", id="files"),
        _files(facts),
        tag("h3", "From terms to lines", id="terms"),
        _terms(facts.trace),
    )


def _kernel(item: Function) -> tuple[str, ...]:
    numbers = f" {plain(item.equation)}" if item.equation else ""
    sides = (", ".join(f"{name}[{size}]" for name, size in side) for side in (item.inputs, item.outputs))
    return code(item.name), _about(item.about) + numbers, *map(code, sides), str(item.operations)


def _about(text: str) -> str:
    """A description, in which the names of other kernels stand as names."""
    parts = re.split(r"\b([a-z]+(?:_[a-z]+)+)\b", text)
    return "".join(code(part) if k % 2 else prose(part) for k, part in enumerate(parts))


def _files(facts: Facts) -> str:
    rows = []
    for name, recorded in sorted(facts.manifest.files.items()):
        size = (facts.provided.folder / name).stat().st_size
        rows.append((code(name), str(size), code(recorded[:16])))
    words = f"The hashes are in {code(FILE_NAME)}, by which a run refuses a file that was edited by hand."
    return paragraph(words) + table(("file", "bytes", "SHA-256, first 16 digits"), rows, right=(1,))


def _terms(trace: Traced | Absent) -> str:
    if isinstance(trace, Absent):
        return absent(trace.reason)
    words = (
        f"The controller that {code('pmjoint export')} writes: {code(trace.file)} has a line for each term. "
        f"The gate {code('export')} puts each equation together again from these lines and compares it with "
        "the derivation."
    )
    rows = []
    for key, group in groupby(trace.entries, key=lambda entry: (entry["equation"], entry["number"])):
        for k, entry in enumerate(group):
            text = trace.lines[entry["line"] - 1].strip()
            name = f"{inline_symbol(key[0])} {plain(key[1])}" if k == 0 else ""
            rows.append((str(entry["line"]), name, formula(entry["term"]), code(text)))
    return paragraph(words) + table(("line", "equation", "term", "C"), rows)
