"""The loops' numbers stand once in C and once in Python: the two are the same."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from pmjoint_codegen.loops import constants
from pmjoint_codegen.loops.quadrature import short_steps
from pmjoint_codegen.loops.status import Status

LOOPS = Path(constants.__file__).parent
DEFINITION = re.compile(r"^#define (PMJ_)?(\w+) +(\S.*?) *(?:/\*.*)?$", re.MULTILINE)
MEMORY = {"MAX_ORDER", "MAX_NODES"}  # of C alone: sizes of its arrays


def in_c(text: str) -> dict[str, object]:
    """The constants of a header, without their prefix; `{1, 2}` is a tuple."""
    found = {}
    for prefix, name, value in DEFINITION.findall(text):
        assert prefix, f"{name} has no prefix"
        found[name] = ast.literal_eval(value.replace("{", "(").replace("}", ")"))
    return found


def in_python() -> dict[str, object]:
    """The same of the twins: constants, ends of runs, and the rule of short holds."""
    rule = {"SHORT_NODES": short_steps().nodes, "SHORT_WEIGHTS": short_steps().weights}
    numbers = {name: value for name, value in vars(constants).items() if name.isupper()}
    return {**numbers, **{status.name: int(status) for status in Status}, **rule}


@pytest.fixture(scope="module")
def header() -> str:
    return (LOOPS / "c" / "pmjoint_constants.h").read_text(encoding="utf-8")


def test_c_and_python_have_the_same_constants(header: str) -> None:
    found = in_c(header)
    assert {name: value for name, value in found.items() if name not in MEMORY} == in_python()
    assert found.keys() >= MEMORY


def test_a_constant_that_differs_or_is_missing_is_seen(header: str) -> None:
    other = header.replace("PMJ_GROWTH 2.5", "PMJ_GROWTH 2.25")
    assert in_c(other)["GROWTH"] != in_python()["GROWTH"]
    assert "GROWTH" not in in_c(header.replace("#define PMJ_GROWTH 2.5\n", ""))


def test_no_loop_defines_a_shared_constant_again(header: str) -> None:
    names = {*in_c(header), *in_python()}
    again = [
        f"{path.name}: {name}"
        for path in sorted([*LOOPS.rglob("*.[ch]"), *LOOPS.glob("*.py")])
        if path.name not in ("pmjoint_constants.h", "constants.py", "status.py")
        for name in re.findall(
            r"^(?:#define (?:PMJ_)?)?([A-Z_]+)(?:: Final =| [\d.{(])", path.read_text(), re.MULTILINE
        )
        if name in names
    ]
    assert again == []
