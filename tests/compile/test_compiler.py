from __future__ import annotations

import os
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import find_compiler


def program(folder: Path, name: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


def test_cc_comes_first_and_keeps_its_flags(tmp_path: Path) -> None:
    program(tmp_path, "cc")
    mine = program(tmp_path, "my compiler")
    found = find_compiler({"PATH": str(tmp_path), "CC": f"'{mine}' -m64 -DX='a b'"})
    assert found is not None
    assert found.command == (str(mine), "-m64", "-DX=a b")


def test_a_relative_path_in_cc_still_leads_there_from_the_folder_of_a_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = program(tmp_path / "bin", "cc")
    monkeypatch.chdir(tmp_path)
    for env in ({"PATH": "", "CC": "bin/cc"}, {"PATH": "bin", "CC": "cc"}, {"PATH": "bin"}):
        found = find_compiler(env)
        assert found is not None
        assert found.command == (str(mine),)


@pytest.mark.parametrize("present", [("cc", "gcc", "clang"), ("gcc", "clang"), ("clang",)])
def test_without_cc_the_first_known_program_on_the_path_is_taken(
    tmp_path: Path, present: tuple[str, ...]
) -> None:
    for name in present:
        program(tmp_path, name)
    found = find_compiler({"PATH": str(tmp_path), "CC": " "})
    assert found is not None
    assert found.command == (str(tmp_path / present[0]),)


def test_cc_that_names_nothing_is_said_and_passed_over(tmp_path: Path) -> None:
    program(tmp_path, "gcc")
    lines: list[str] = []
    found = find_compiler({"PATH": str(tmp_path), "CC": "no-such-program -O1"}, lines.append)
    assert found is not None
    assert found.command == (str(tmp_path / "gcc"),)
    assert len(lines) == 1
    assert "no-such-program" in lines[0]


@pytest.mark.usefixtures("no_ziglang")
def test_no_program_is_none(tmp_path: Path) -> None:
    assert find_compiler({"PATH": str(tmp_path)}) is None


@pytest.mark.usefixtures("no_ziglang")
def test_unbalanced_quote_in_cc_is_no_crash(tmp_path: Path) -> None:
    assert find_compiler({"PATH": str(tmp_path), "CC": "'cc"}) is None


def test_identity_changes_when_the_compiler_is_replaced_behind_a_link(tmp_path: Path) -> None:
    real = program(tmp_path, "gcc-12")
    (tmp_path / "cc").symlink_to(real)
    env = {"PATH": str(tmp_path)}
    before = find_compiler(env)
    os.utime(real, ns=(1, 1))
    after = find_compiler(env)
    assert before is not None
    assert after is not None
    assert before.command == after.command
    assert before.identity != after.identity
