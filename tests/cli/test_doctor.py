"""``pmjoint doctor`` on machines with and without compiler, cache, packages and tools."""

from __future__ import annotations

import json
import os
import shutil
from importlib import metadata
from pathlib import Path

import pytest

from pmjoint_codegen.cli import doctor
from pmjoint_codegen.cli.main import run

pytestmark = pytest.mark.usefixtures("no_ziglang")  # its first use in a new cache takes seconds


def found(environment: dict[str, str]) -> dict[str, doctor.Finding]:
    """Examine a machine and look findings up by name."""
    return {finding.name: finding for finding in doctor.examine(environment)}


def test_json_is_one_document_with_a_meaning_for_each_finding(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    names = [item["name"] for item in record["findings"]]
    assert {"python", "C compiler", "cache", "sympy", "casadi", "pydantic", "matplotlib", "clang"} <= set(
        names
    )
    for item in record["findings"]:
        assert item["state"] in {"ok", "absent", "differs"}
        assert item["meaning"]
        assert item["found"] or item["state"] == "absent"


def test_the_table_has_a_line_for_each_finding(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor"]) == 0
    out = capsys.readouterr().out
    for name in ("python", "C compiler", "cache", "numpy", "cppcheck"):
        assert f"\n  {name} " in out


def test_without_a_compiler_it_says_what_that_means(tmp_path: Path) -> None:
    finding = found({"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)})["C compiler"]
    assert finding.state == "absent"
    assert "interpreted" in finding.meaning


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_compiler_is_shown_with_its_version(tmp_path: Path) -> None:
    finding = found({"PATH": os.environ["PATH"], "PMJOINT_CACHE": str(tmp_path)})["C compiler"]
    assert finding.state == "ok"
    assert any(character.isdigit() for character in finding.found)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_compiler_that_compiles_nothing_is_not_well(tmp_path: Path) -> None:
    environment = {"PATH": os.environ["PATH"], "PMJOINT_CACHE": str(tmp_path)}
    for cc, fault in (("cc -no-such-option", "-no-such-option"), ("false", "exit code 1")):
        finding = found({**environment, "CC": cc})["C compiler"]
        assert finding.state == "differs"
        assert finding.found
        for part in (fault, "CC=", "libc6-dev"):
            assert part in finding.meaning


def test_another_version_than_the_pinned_one_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: "0.0.1" if name == "casadi" else real(name))
    finding = found({"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)})["casadi"]
    assert finding.state == "differs"
    assert doctor.pinned()["casadi"].removeprefix("==") in finding.meaning


def test_an_absent_package_comes_with_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = metadata.version

    def version(name: str) -> str:
        if name == "sympy":
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(metadata, "version", version)
    finding = found({"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)})["sympy"]
    assert finding.state == "absent"
    assert f"pip install 'sympy{doctor.pinned()['sympy']}'" in finding.meaning


def test_what_only_sweeps_need_is_looked_for_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", version)
    absent = found({"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)})
    for name in ("xarray", "zarr", "distributed"):
        assert absent[name].state == "absent"
        assert "-m pip install 'pmjoint-codegen[sweep]'" in absent[name].meaning


def test_a_program_that_cannot_run_does_not_stop_the_examination(tmp_path: Path) -> None:
    (tmp_path / "clang").write_text("no program at all")
    (tmp_path / "clang").chmod(0o755)
    finding = found({"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)})["clang"]
    assert finding.state == "ok"
    assert finding.found == str(tmp_path / "clang")


def test_a_cache_that_others_may_write_is_a_finding_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    (shared / "mine").mkdir(mode=0o700)
    for folder, guilty in ((shared, shared), (shared / "mine", shared)):
        findings = found({"PATH": "", "PMJOINT_CACHE": str(folder)})
        asked = findings["cache asked for"]
        assert (asked.state, asked.found) == ("differs", str(folder))
        assert f"other users may write to {guilty}" in asked.meaning and "PMJOINT_CACHE" in asked.meaning
        assert findings["cache"].state == "ok" and findings["cache"].found != str(folder)
    assert capsys.readouterr().err.count("cache") == 0  # the table says it
    shared.chmod(0o755)
    assert "cache asked for" not in found({"PATH": "", "PMJOINT_CACHE": str(shared / "mine")})
