"""The compiler that the package ziglang brings: found last, needs no home, and computes the same bits."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.check.bits import different_bits
from pmjoint_codegen.cli import doctor
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile import zig_cc
from pmjoint_codegen.compile.compiler import Compiler, find_compiler, install_line
from pmjoint_codegen.compile.library import build
from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.export.fmu.archive import Builder
from pmjoint_codegen.kernels import compiled

pytest.importorskip("ziglang", reason="the package ziglang is not installed")
LEVELS = ("-march=x86-64", "-march=x86-64-v2", "-march=x86-64-v3", "-march=x86-64-v4")


@pytest.fixture
def bare(cache: Path) -> dict[str, str]:
    """Return the environment of a machine without compiler and home."""
    return {"PATH": "", "PMJOINT_CACHE": str(cache)}


@pytest.fixture
def ziglang(bare: dict[str, str]) -> Compiler:
    found = find_compiler(bare)
    assert found is not None
    return found


def test_it_is_taken_where_no_other_is_found(ziglang: Compiler, bare: dict[str, str], tmp_path: Path) -> None:
    assert ziglang.package == ziglang.shown == "ziglang"
    clang = tmp_path / "clang"
    clang.write_text("#!/bin/sh\n")
    clang.chmod(0o755)
    found = find_compiler({**bare, "PATH": str(tmp_path)})
    assert found is not None
    assert found.command == (str(clang),)


def test_cc_can_ask_for_it(ziglang: Compiler, bare: dict[str, str]) -> None:
    lines: list[str] = []
    assert find_compiler({**bare, "PATH": os.environ["PATH"], "CC": "ziglang"}, lines.append) == ziglang
    assert not lines


def test_it_is_not_loaded_and_not_looked_for_where_there_is_another(tmp_path: Path) -> None:
    (tmp_path / "cc").write_text("#!/bin/sh\n")
    (tmp_path / "cc").chmod(0o755)
    program = """
import importlib.util, json, os, sys
asked, real = [], importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: asked.append(name) or real(name, *rest)
from pmjoint_codegen.compile.compiler import find_compiler
found = [bool(find_compiler({"PATH": sys.argv[1]})), asked == [], find_compiler({"PATH": ""}).package]
print(json.dumps([*found, asked, "ziglang" in sys.modules]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], check=True, capture_output=True, text=True
    )
    assert json.loads(done.stdout) == [True, True, "ziglang", ["ziglang"], False]


@pytest.mark.parametrize("model", ["paper", "joint-exact"])
def test_its_trajectories_have_the_bits_of_the_systems_compiler(
    root: Path, bare: dict[str, str], model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = find_compiler(os.environ)
    if known is None or known.package:
        pytest.skip("no C compiler of the system to compare with")
    file = root / "models" / f"{model}.toml"
    monkeypatch.delenv("HOME", raising=False)  # of the compiler, which inherits the process's environment
    built: list[str] = []

    def noted(sources: Mapping[str, bytes], compiler: Compiler, *rest: Any, **others: Any) -> Path:
        built.append(compiler.package)
        return build(sources, compiler, *rest, **others)

    monkeypatch.setattr(compiled, "build", noted)
    lines: list[str] = []
    loops = [ClosedLoop.load(file, "compiled", environment=env, notify=lines.append) for env in (None, bare)]
    assert not lines
    assert set(built) == {"", "ziglang"}
    for controller in ("continuous", "sampled"):
        first, second = (loop.simulate(horizon=2.0, controller=controller) for loop in loops)
        assert len(first.t) > 100
        for name in first.columns:
            assert not different_bits(np.asarray(first[name]), np.asarray(second[name])).any(), name


def test_it_is_told_by_doctor(bare: dict[str, str]) -> None:
    findings = {finding.name: finding for finding in doctor.examine(bare)}
    found = findings["C compiler"]
    assert found.state == "ok" and found.meaning.startswith("ziglang: ") and "clang" in found.found
    assert findings["ziglang"].state == "ok"


def test_the_line_of_a_run_without_compiler_names_the_extra() -> None:
    assert "apt-get install gcc, or " in install_line()
    assert install_line().endswith("-m pip install 'pmjoint-codegen[compiler]'")


def test_levels_are_spelled_as_zig_does_and_a_build_is_for_every_processor() -> None:
    spelled = [zig_cc.arguments([level])[-1] for level in LEVELS]
    assert spelled == ["-march=x86_64", "-march=x86_64_v2", "-march=x86_64_v3", "-march=x86_64_v4"]
    assert "-mcpu=baseline" in zig_cc.arguments(["-O2"])
    assert not any("baseline" in text for level in LEVELS for text in zig_cc.arguments([level]))


@pytest.mark.parametrize(("flags", "trapped"), [((), False), (("-fsanitize=undefined",), True)])
def test_undefined_behaviour_is_trapped_only_on_request(
    ziglang: Compiler, tmp_path: Path, flags: tuple[str, ...], trapped: bool
) -> None:
    (tmp_path / "sum.c").write_text("int sum(int a, int b);\nint sum(int a, int b) { return a + b; }\n")
    command = [*ziglang.command, *flags, "-O0", "-S", "sum.c", "-o", "sum.s"]
    subprocess.run(command, cwd=tmp_path, check=True, env={})
    assert ("ubsan" in (tmp_path / "sum.s").read_text()) is trapped


@pytest.mark.usefixtures("no_ziglang")
def test_what_only_ziglang_can_build_names_the_extra_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(MissingToolError, match="ziglang is needed to build for aarch64-darwin") as told:
        Builder.by_ziglang("aarch64-darwin", os.environ)
    assert "pmjoint-codegen[compiler]" in told.value.remedy
    for asked in (["explorer"], ["export", "paper", "--target", "wasm"]):
        assert run([*asked, "--out", str(tmp_path / "made")]) == 3
        said = capsys.readouterr().err.splitlines()[-1]
        assert "ziglang is needed to compile for WebAssembly" in said and "[compiler]" in said
    assert not (tmp_path / "made").is_file()
