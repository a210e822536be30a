"""Flags of step and init: the same names and values in C and in every language that wraps it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pmjoint_codegen.export.bindings import matlab, wasm
from pmjoint_codegen.export.source import TEMPLATES


@pytest.mark.parametrize(
    ("path", "form"),
    [
        (wasm.FOLDER / "controller.mjs.in", r"^export const ([A-Z_]+) = (\d+);"),
        (wasm.FOLDER / "controller.d.mts.in", r"^export const ([A-Z_]+): (\d+);"),
        (matlab.FOLDER / "controller.m.in", r"^ +([A-Z_]+) = (\d+);"),
    ],
)
def test_a_wrapper_has_the_flags_of_the_header(path: Path, form: str) -> None:
    header = (TEMPLATES / "controller.h.in").read_text(encoding="utf-8")
    declared = dict(re.findall(r"^#define @NAME@_((?:BAD_|CLAMPED)\w*) +(\d+)", header, re.MULTILINE))
    assert {"BAD_INPUT", "BAD_PARAMETER", "CLAMPED"} <= declared.keys()
    assert dict(re.findall(form, path.read_text(encoding="utf-8"), re.MULTILINE)) == declared
    read_me = (path.parent / "README.md.in").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in read_me for name in declared.keys() - {"BAD_PARAMETER"})  # which is of init
