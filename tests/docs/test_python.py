"""docs/python.md: its code runs without a warning and prints what the page shows, to the character."""

from __future__ import annotations

import os
import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

import pmjoint_codegen
from pmjoint_codegen.compile.compiler import find_compiler

pytest.importorskip("control")
pytest.importorskip("casadi")
pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps need a compiler")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"
BLOCK = re.compile(
    r"(<!-- needs (\w+) -->\n)?^```python\n(.*?)^```$(?:\n\n^```text\n(.*?)^```$)?", re.DOTALL | re.MULTILINE
)


def test_the_code_prints_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    blocks = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    assert len(blocks) >= 10
    for _, needed, code, shown in blocks:
        if needed and needed not in pmjoint_codegen.__all__:
            continue
        printed = StringIO()
        with redirect_stdout(printed):
            exec(compile(code, "python.md", "exec"), names)
        assert printed.getvalue() == shown, code
    files = {path.name for path in tmp_path.iterdir()}
    assert {"overview.png", "paper-tuned.toml", "trajectory.csv", "tuned.png"} <= files
    assert "ise" in names["data"]
