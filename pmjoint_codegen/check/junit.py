"""Gate results as a JUnit file, which continuous integration systems show, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final
from xml.etree import ElementTree

from pmjoint_codegen.check.result import GateResult, Verdict, failed, not_run, passed

FINGERPRINT: Final = "fingerprint"


@dataclass(frozen=True)
class Recorded:
    """Results of a model from a file.

    Attributes:
        fingerprint: of the model, its generated files and the program; empty if the file has none.
        results: of its gates.
    """

    fingerprint: str
    results: tuple[GateResult, ...]


def junit(results: Mapping[str, Sequence[GateResult]], fingerprints: Mapping[str, str] | None = None) -> str:
    """One suite per model, one case per gate.

    Args:
        results: model name -> its gates' results.
        fingerprints: model name -> `Subject.fingerprint`, by which a reader tells whether the results are
            those of a model as it is.
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
        if fingerprints is not None:
            _properties(suite, {FINGERPRINT: fingerprints[model]})
        for gate in gates:
            _case(suite, model, gate)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def read_junit(text: str) -> dict[str, Recorded]:
    """Read a file that `junit` wrote, by model.

    A gate counts as passed only if its figure is within its bound, whatever the file calls it.

    Raises:
        ValueError: it is no such file.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"is not XML: {error}") from None
    if root.tag != "testsuites" or root.get("name") != "pmjoint check":
        raise ValueError("is no JUnit file of pmjoint check")
    return {
        suite.get("name", ""): Recorded(
            _property(suite, FINGERPRINT), tuple(map(_result, suite.findall("testcase")))
        )
        for suite in root.findall("testsuite")
    }


def _result(case: ElementTree.Element) -> GateResult:
    detail, *findings = (case.findtext("system-out") or "").split("\n")
    figure, bound = (_number(_property(case, name)) for name in ("figure", "bound"))
    failure, skipped = case.find("failure"), case.find("skipped")
    if skipped is not None:
        result = not_run(detail)
    elif failure is not None:
        result = failed(detail, figure, bound, findings=tuple((failure.text or "").splitlines()))
    else:
        result = passed(detail, figure, bound, *findings)
    return replace(result, name=case.get("name", ""), seconds=_number(case.get("time")) or 0.0)


def _number(text: str | None) -> float | None:
    return float(text) if text else None


def _property(element: ElementTree.Element, name: str) -> str:
    found = element.find(f"properties/property[@name='{name}']")
    return "" if found is None else found.get("value", "")


def _properties(parent: ElementTree.Element, values: Mapping[str, str]) -> None:
    group = ElementTree.SubElement(parent, "properties")
    for name, value in values.items():
        ElementTree.SubElement(group, "property", name=name, value=value)


def _count(gates: Sequence[GateResult], verdict: Verdict) -> int:
    return sum(gate.verdict is verdict for gate in gates)


def _case(suite: ElementTree.Element, model: str, gate: GateResult) -> None:
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"check.{model}", name=gate.name, time=f"{gate.seconds:.3f}"
    )
    measured = {"figure": gate.figure, "bound": gate.bound}
    known = {name: repr(value) for name, value in measured.items() if value is not None}
    if known:
        _properties(case, known)
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
