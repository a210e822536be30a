"""A compiler that notes each of its calls, in front of the real one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import Compiler, find_compiler


@dataclass(frozen=True)
class Counter:
    """A compiler and the file in which it notes its calls."""

    compiler: Compiler
    log: Path

    @property
    def calls(self) -> int:
        """How often the compiler ran."""
        return len(self.log.read_text().splitlines()) if self.log.exists() else 0


@pytest.fixture(scope="session")
def real_compiler() -> str:
    found = find_compiler(os.environ)
    if found is None:
        pytest.skip("no C compiler")
    return found.command[0]


@pytest.fixture
def counting(tmp_path: Path, real_compiler: str) -> Callable[[str], Counter]:
    """Make a counting compiler that runs a shell line before it compiles."""

    def make(before: str = ":") -> Counter:
        script = tmp_path / "counting-cc"
        log = tmp_path / "calls"
        script.write_text(f'#!/bin/sh\necho called >> "{log}"\n{before}\nexec "{real_compiler}" "$@"\n')
        script.chmod(0o755)
        found = find_compiler({"CC": str(script), "PATH": os.environ["PATH"]})
        assert found is not None
        return Counter(found, log)

    assert shutil.which("sh")
    return make
