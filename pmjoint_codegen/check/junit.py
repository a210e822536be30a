"""Gate results as a JUnit file, which continuous integration systems show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

from pmjoint_codegen.check.result import GateResult, Verdict


def junit(results: Mapping[str, Sequence[GateResult]]) -> str:
    """One suite per model, one case per gate.

    Args:
        results: model name -> its gates' results.
    """
    root = ElementTree.Element("testsuites", name="pmjoint check")
    for model, gates in results.items():
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=model,
            tests=str(len(gates)),
            failures=str(_count(gates, Verdict.FAILED)),
            skipped=str(_count(gates, Verdict.NOT_RUN)),
            errors="0",
            time=f"{sum(gate.seconds for gate in gates):.3f}",
        )
        for gate in gates:
            _case(suite, model, gate)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _count(gates: Sequence[GateResult], verdict: Verdict) -> int:
    return sum(gate.verdict is verdict for gate in gates)


def _case(suite: ElementTree.Element, model: str, gate: GateResult) -> None:
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"check.{model}", name=gate.name, time=f"{gate.seconds:.3f}"
    )
    if gate.verdict is Verdict.FAILED:
        failure = ElementTree.SubElement(case, "failure", message=_printable(gate.detail))
        failure.text = _printable(
            "\n".join([*([str(gate.difference)] if gate.difference else []), *gate.findings])
        )
    elif gate.verdict is Verdict.NOT_RUN:
        ElementTree.SubElement(case, "skipped", message=_printable(gate.detail))
    output = ElementTree.SubElement(case, "system-out")
    output.text = _printable("\n".join([gate.detail, *gate.findings]))


def _printable(text: str) -> str:
    """Text without the control characters that XML forbids."""
    return "".join(c if c in "\n\t" or c.isprintable() else "?" for c in text)
